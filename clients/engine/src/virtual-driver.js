// In place of a driver: the curve of what would be felt, and its changes as sound.

const SOUND_LEAD_S = 0.03;

export class VirtualDriver extends EventTarget {
  #engine;
  #audio = null;
  #soundAt = 0;

  /**
   * @param {import("./engine.js").Engine} engine whose blocks it takes, in its worker
   * @param {HTMLCanvasElement} canvas for the curve, of any size that CSS gives it
   */
  constructor(engine, canvas) {
    super();
    this.#engine = engine;
    // What is drawn must not change the size of the canvas, whose pixels are those of the screen.
    canvas.style.containIntrinsicSize = `${canvas.width}px ${canvas.height}px`;
    canvas.style.contain = "size";
    const curve = canvas.transferControlToOffscreen();
    engine.worker.postMessage({ curve }, [curve]);
    engine.addEventListener("shown", ({ detail }) => this.dispatchEvent(new CustomEvent("shown", { detail })));
    engine.addEventListener("sound", ({ detail }) => this.#sound(detail));
    const look = () => {
      const pixel = globalThis.devicePixelRatio;
      const style = getComputedStyle(canvas);
      const colour = (name, other) => style.getPropertyValue(name).trim() || other;
      const size = (css) => Math.max(1, Math.round(css * pixel));
      const [width, height] = [size(canvas.clientWidth), size(canvas.clientHeight)];
      const colours = [colour("--wanted", "#cc6600"), colour("--felt", "#0066cc")];
      engine.worker.postMessage({ look: { width, height, pixel, colours } });
    };
    new ResizeObserver(look).observe(canvas);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", look);
    const themes = new MutationObserver(look);
    for (const one of [document.documentElement, document.body]) themes.observe(one, { attributes: true });
  }

  /** Friction wanted and felt by the first finger, the last 1.5 s; NaN without a finger. */
  async curve() {
    const got = new Promise((resolve) =>
      this.#engine.addEventListener("rows", ({ detail }) => resolve(detail), { once: true }),
    );
    this.#engine.worker.postMessage({ rows: true });
    return got;
  }

  /** Whether changes of friction are heard. A browser allows it after a click only. */
  get sounds() {
    return this.#audio !== null;
  }

  set sounds(on) {
    if (on && !this.#audio) this.#audio = new AudioContext();
    if (!on && this.#audio) {
      this.#audio.close();
      this.#audio = null;
    }
    this.#engine.worker.postMessage({ sounds: this.sounds });
  }

  #sound(changes) {
    if (!this.#audio) return;
    const perS = this.#engine.sampleRateHz / this.#engine.step;
    const samples = this.#audio.createBuffer(1, changes.length, perS);
    samples.copyToChannel(changes, 0);
    const source = this.#audio.createBufferSource();
    source.buffer = samples;
    source.connect(this.#audio.destination);
    const now = this.#audio.currentTime;
    if (this.#soundAt < now || this.#soundAt > now + 0.2) this.#soundAt = now + SOUND_LEAD_S;
    source.start(this.#soundAt);
    this.#soundAt += changes.length / perS;
  }
}
