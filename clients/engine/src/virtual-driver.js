// In place of a driver: the curve of what would be felt, and its changes as sound.

const SHOWN_S = 1.5;
const KEPT = 4; // of so many control points one is drawn
const SOUND_LEAD_S = 0.03;
const LOUD = 12; // of a change of friction of 1 from one point to the next, at full scale

export class VirtualDriver {
  #canvas;
  #perS;
  #wanted = [];
  #felt = [];
  #reach = { low: Infinity, high: 0 };
  #audio = null;
  #soundAt = 0;
  #before = NaN;
  #asked = false;

  /**
   * @param {import("./engine.js").Engine} engine whose blocks it takes
   * @param {HTMLCanvasElement} canvas for the curve
   */
  constructor(engine, canvas) {
    this.#canvas = canvas;
    this.#perS = engine.sampleRateHz / engine.step;
    engine.addEventListener("block", ({ detail }) => this.#take(detail));
    this.#ask();
  }

  /** Friction wanted and felt by the first finger, the last ones of `SHOWN_S`; NaN without a finger. */
  get curve() {
    return { wantedMu: [...this.#wanted], feltMu: [...this.#felt] };
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
  }

  #take(block) {
    for (let i = 0; i < block.points; i += KEPT) {
      this.#wanted.push(block.fingers ? block.wantedMu[i] : NaN);
      this.#felt.push(block.fingers ? block.feltMu[i] : NaN);
    }
    const most = Math.round((SHOWN_S * this.#perS) / KEPT);
    for (const row of [this.#wanted, this.#felt]) row.splice(0, Math.max(row.length - most, 0));
    for (const mu of block.feltMu) {
      this.#reach.low = Math.min(this.#reach.low, mu);
      this.#reach.high = Math.max(this.#reach.high, mu);
    }
    if (this.#audio) this.#sound(block);
    this.#ask();
  }

  #sound(block) {
    const samples = this.#audio.createBuffer(1, block.points, this.#perS);
    const out = samples.getChannelData(0);
    for (let i = 0; i < block.points; i++) {
      const mu = block.fingers ? block.feltMu[i] : NaN;
      const change = LOUD * (mu - this.#before);
      out[i] = Number.isFinite(change) ? Math.max(-1, Math.min(1, change)) : 0;
      this.#before = mu;
    }
    const source = this.#audio.createBufferSource();
    source.buffer = samples;
    source.connect(this.#audio.destination);
    const now = this.#audio.currentTime;
    if (this.#soundAt < now || this.#soundAt > now + 0.2) this.#soundAt = now + SOUND_LEAD_S;
    source.start(this.#soundAt);
    this.#soundAt += block.points / this.#perS;
  }

  #ask() {
    if (this.#asked) return;
    this.#asked = true;
    requestAnimationFrame(() => {
      this.#asked = false;
      this.#draw();
    });
  }

  #draw() {
    const { width, height } = this.#canvas;
    const to = this.#canvas.getContext("2d");
    const style = getComputedStyle(this.#canvas);
    to.clearRect(0, 0, width, height);
    const { low, high } = this.#reach;
    if (!(high > low)) return;
    const most = Math.round((SHOWN_S * this.#perS) / KEPT);
    const x = (i, count) => width * (1 - (count - i) / most);
    const y = (mu) => height * (0.95 - (0.9 * (mu - low)) / (high - low));
    const pixel = width / (this.#canvas.clientWidth || width); // of the page
    const line = (row, colour, thick) => {
      to.strokeStyle = colour;
      to.lineWidth = thick * pixel;
      to.beginPath();
      row.forEach((mu, i) => {
        const goesOn = i > 0 && !Number.isNaN(row[i - 1]);
        if (!Number.isNaN(mu)) to[goesOn ? "lineTo" : "moveTo"](x(i, row.length), y(mu));
      });
      to.stroke();
    };
    line(this.#wanted, style.getPropertyValue("--wanted").trim() || "#c60", 4);
    line(this.#felt, style.getPropertyValue("--felt").trim() || "#06c", 1.5);
  }
}
