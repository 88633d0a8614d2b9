// The curve of what would be felt, in the engine's worker: a page that is busy does not delay it.

const SHOWN_S = 1.5;
const KEPT = 4; // of so many control points one is drawn
const PICTURE_MS = 1000 / 15;
const PICTURES_PER_NUMBER = 2; // numbers that change faster are not read
const LOUD = 12; // of a change of friction of 1 from one point to the next, at full scale

export class Curve {
  /** Whether the page plays changes of friction as sound. */
  sounds = false;
  #to;
  #perS;
  #rows; // friction wanted and felt by the first finger, the latest last; NaN without one
  #low = Infinity;
  #high = 0;
  #image;
  #lines = [];
  #drawnMs = -Infinity;
  #pictures = 0;
  #before = NaN;

  /** @param {OffscreenCanvas} canvas */
  constructor(canvas, pointsPerS) {
    this.#to = canvas.getContext("2d");
    this.#perS = pointsPerS;
    const most = Math.round((SHOWN_S * pointsPerS) / KEPT);
    this.#rows = [0, 1].map(() => new Float32Array(most).fill(NaN));
  }

  get rows() {
    const [wantedMu, feltMu] = this.#rows;
    return { wantedMu, feltMu };
  }

  /** The canvas's size in pixels of the screen, how many are one of the page, and the colours of the lines. */
  look({ width, height, pixel, colours }) {
    const { canvas } = this.#to;
    if (canvas.width !== width || canvas.height !== height || !this.#image) {
      [canvas.width, canvas.height] = [width, height];
      this.#image = this.#to.createImageData(width, height);
    }
    this.#lines = colours.map((colour, i) => {
      this.#to.fillStyle = colour;
      const rgb = parseInt(this.#to.fillStyle.slice(1), 16);
      return { row: this.#rows[i], rgb: [rgb >> 16, (rgb >> 8) & 255, rgb & 255], thick: [4, 1.5][i] * pixel };
    });
    this.#draw();
  }

  take(block) {
    const { fingers, points, wantedMu, feltMu } = block;
    [wantedMu, feltMu].forEach((mu, i) => {
      const row = this.#rows[i];
      const count = Math.ceil(points / KEPT);
      row.copyWithin(0, count);
      for (let k = 0; k < count; k++) row[row.length - count + k] = fingers ? mu[k * KEPT] : NaN;
    });
    for (const mu of feltMu) {
      this.#low = Math.min(this.#low, mu);
      this.#high = Math.max(this.#high, mu);
    }
    if (this.sounds) postMessage({ sound: this.#sound(block) });
    const ms = performance.now();
    if (ms - this.#drawnMs < PICTURE_MS) return;
    this.#drawnMs = ms;
    this.#draw();
    const last = (mu) => (fingers ? mu[points - 1] : NaN);
    if (this.#pictures++ % PICTURES_PER_NUMBER === 0)
      postMessage({ shown: { wantedMu: last(wantedMu), feltMu: last(feltMu) } });
  }

  #sound({ fingers, points, feltMu }) {
    return Float32Array.from({ length: points }, (_, i) => {
      const mu = fingers ? feltMu[i] : NaN;
      const change = LOUD * (mu - this.#before);
      this.#before = mu;
      return Number.isFinite(change) ? Math.max(-1, Math.min(1, change)) : 0;
    });
  }

  /** Pixels, and not a path: of a path with thousands of points each picture costs a processor 10 ms. */
  #draw() {
    if (!this.#image || !(this.#high > this.#low)) return;
    const { width, height, data } = this.#image;
    const pixels = new Uint32Array(data.buffer).fill(0);
    const y = (mu) => height * (0.95 - (0.9 * (mu - this.#low)) / (this.#high - this.#low));
    for (const { row, rgb, thick } of this.#lines) {
      const full = (255 << 24) | (rgb[2] << 16) | (rgb[1] << 8) | rgb[0];
      const [tops, bottoms] = [new Float64Array(width).fill(height), new Float64Array(width)];
      for (let i = 1; i < row.length; i++) {
        if (Number.isNaN(row[i])) continue;
        const x = Math.floor((i * width) / row.length);
        const before = Number.isNaN(row[i - 1]) ? row[i] : row[i - 1]; // so that columns join
        tops[x] = Math.min(tops[x], y(Math.max(row[i], before)) - thick / 2);
        bottoms[x] = Math.max(bottoms[x], y(Math.min(row[i], before)) + thick / 2);
      }
      const reach = (thick - 1) >> 1;
      const share = (at, x, covered) => {
        const alpha = Math.max(0, covered) * 255;
        const to = 4 * (at * width + x);
        const beneath = (1 - alpha / 255) * data[to + 3];
        for (let k = 0; k < 3; k++) data[to + k] = (alpha * rgb[k] + beneath * data[to + k]) / (alpha + beneath);
        data[to + 3] = alpha + beneath;
      };
      for (let x = 0; x < width; x++) {
        let [top, bottom] = [tops[x], bottoms[x]];
        for (let near = Math.max(0, x - reach); near <= Math.min(width - 1, x + reach); near++) {
          top = Math.min(top, tops[near]);
          bottom = Math.max(bottom, bottoms[near]);
        }
        const [first, last] = [Math.ceil(top), Math.floor(bottom)];
        for (let at = first; at < last; at++) pixels[at * width + x] = full;
        if (top < bottom) {
          share(first - 1, x, first - top);
          share(last, x, bottom - last);
        }
      }
    }
    this.#to.putImageData(this.#image, 0, 0);
  }
}
