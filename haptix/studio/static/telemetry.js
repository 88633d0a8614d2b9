/** What the service tells of each finger, kept for some seconds in rings. */

/** @import { Frame } from "/client/batches.js" */

export const WEBER_FRACTION = 0.11; // just-noticeable difference of friction over the friction
export const FIELDS = /** @type {const} */ (
  ["t", "x_mm", "y_mm", "normal_force_n", "wanted", "reached", "low", "high", "voltage_share", "felt", "force_n"]
);
/** @typedef {(typeof FIELDS)[number]} Field */

const ROWS = 4096;
const STALE_S = 2; // a finger of the same number after that begins anew

/** Rows of one finger, the oldest forgotten. */
export class Track {
  /** Rows that came in all; row i lies at i % ROWS. */
  count = 0;
  /** Rows of which it is known what was felt. */
  known = 0;
  /** @type {Record<Field, Float64Array>} */
  columns = /** @type {any} */ (
    Object.fromEntries(FIELDS.map((name) => [name, new Float64Array(ROWS).fill(NaN)]))
  );

  /** First row that is still there. */
  get first() {
    return Math.max(0, this.count - ROWS);
  }

  /** @param {Field} field @param {number} row */
  at(field, row) {
    return this.columns[field][row % ROWS];
  }

  /** Time of the newest row [s], of the service's clock. */
  get end_s() {
    return this.count ? this.at("t", this.count - 1) : -Infinity;
  }

  /** @param {Frame & {names: string[]}} frame */
  addFriction({ rows, columns, names, t0_s, step_s }) {
    for (let at = 0; at * columns < rows.length; at += 1) {
      if (Number.isNaN(rows[at * columns])) continue; // got no drive
      const slot = this.count % ROWS;
      for (const name of FIELDS) this.columns[name][slot] = NaN;
      this.columns.t[slot] = t0_s + at * step_s;
      names.forEach((name, column) => {
        const ring = this.columns[/** @type {Field} */ (name)];
        if (ring) ring[slot] = rows[at * columns + column];
      });
      this.count += 1;
    }
  }

  /** Put what was felt beside the rows of the same time.
   * @param {Frame & {names: string[]}} frame */
  addFelt({ rows, columns, names, t0_s, step_s }) {
    const [mu, force] = [names.indexOf("mu"), names.indexOf("force_n")];
    let row = Math.max(this.first, this.known);
    for (let at = 0; at * columns < rows.length; at += 1) {
      const t = t0_s + at * step_s;
      while (row < this.count && this.at("t", row) < t - step_s / 2) row += 1;
      if (row >= this.count) break;
      if (this.at("t", row) > t + step_s / 2) continue;
      this.columns.felt[row % ROWS] = rows[at * columns + mu];
      this.columns.force_n[row % ROWS] = rows[at * columns + force];
      this.known = row + 1;
    }
  }

  /** Error of a row in JND: felt, or reached while that is not known, against wanted.
   * @param {number} row */
  error(row) {
    const [wanted, felt] = [this.at("wanted", row), this.at("felt", row)];
    return (felt - wanted) / (WEBER_FRACTION * wanted);
  }

  /** Whether what was wanted of a row can be had on this screen and finger.
   * @param {number} row */
  isReachable(row) {
    const [wanted, low, high] = [this.at("wanted", row), this.at("low", row), this.at("high", row)];
    const slack = WEBER_FRACTION * wanted * 0.01; // rounding to 32 bits, no difference to feel
    return wanted >= low - slack && wanted <= high + slack;
  }
}

/** All fingers, and the service's own numbers. */
export class Telemetry {
  /** @type {Map<number, Track>} */
  tracks = new Map();
  /** @type {Record<string, number>} the newest row of `stats` */
  stats = {};
  /** Time of that row [s], of the service's clock. */
  stats_s = NaN;
  /** @type {Set<(track: Track, touch_id: number, from: number, to: number) => void>} told of rows
   * whose felt friction has come */
  onFelt = new Set();

  /** @param {Frame & {names: string[]}} frame */
  add(frame) {
    const stream = /** @type {string} */ (frame.stream);
    if (stream === "stats") {
      const last = frame.rows.length - frame.columns;
      this.stats_s = frame.t0_s + (last / frame.columns) * frame.step_s;
      frame.names.forEach((name, column) => (this.stats[name] = frame.rows[last + column]));
      return;
    }
    let track = this.tracks.get(frame.touch_id);
    if (!track || (stream === "friction" && frame.t0_s - track.end_s > STALE_S)) {
      track = new Track();
      this.tracks.set(frame.touch_id, track);
    }
    if (stream === "friction") track.addFriction(frame);
    else if (stream === "felt") {
      const from = Math.max(track.first, track.known);
      track.addFelt(frame);
      for (const handler of this.onFelt) handler(track, frame.touch_id, from, track.known);
    }
  }

  /** The finger that was told of last. @returns {Track | undefined} */
  get newest() {
    let found;
    for (const track of this.tracks.values()) if (!found || track.end_s > found.end_s) found = track;
    return found;
  }
}
