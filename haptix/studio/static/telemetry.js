/** The service's telemetry of each finger: kept for some seconds in rings, and shown as numbers. */

import { el } from "./dom.js";
import { texts } from "./texts.js";

/** @import { Frame } from "/client/batches.js" */

export const WEBER_FRACTION = 0.11; // just-noticeable difference of friction over the friction
export const FIELDS = /** @type {const} */ (
  ["t", "x_mm", "y_mm", "normal_force_n", "wanted", "reached", "low", "high", "voltage_share", "felt", "force_n"]
);
/** @typedef {(typeof FIELDS)[number]} Field */

const ROWS = 4096;
const STALE_S = 2; // after this, a finger of the same number is a new one

/** The newest rows of one finger. */
export class Track {
  /** Number of all rows so far; row i lies at i % ROWS. */
  count = 0;
  /** Number of rows whose felt friction is known. */
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

  /** Add felt friction to the rows of the same time.
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

  /** Error of a row in JND: felt friction (or reached, if felt is not known yet) against wanted.
   * @param {number} row */
  error(row) {
    const [wanted, felt] = [this.at("wanted", row), this.at("felt", row)];
    return (felt - wanted) / (WEBER_FRACTION * wanted);
  }

  /** Whether screen and finger can give the wanted friction of a row.
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
  /** @type {Set<(track: Track, touch_id: number, from: number, to: number) => void>} called with
   * rows whose felt friction has come */
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

  /** The finger that was driven last. @returns {Track | undefined} */
  get newest() {
    let newest;
    for (const track of this.tracks.values()) if (track.end_s > (newest?.end_s ?? -Infinity)) newest = track;
    return newest;
  }
}

const STILL_S = 1; // an old number stays for so long
const OVER_S = 1; // the errors are of the last second

/** @typedef {{rows: number, reach: number, rendering: number, total: number, unreachable: number}} Errors */

/**
 * Return the parts of the error over the last second [JND, root mean square].
 * @param {Track} track
 * @returns {Errors | null}
 */
export function errorsOf(track) {
  const end = track.known;
  if (!end) return null;
  const until_s = track.at("t", end - 1);
  let [rows, reach, rendering, total, unreachable] = [0, 0, 0, 0, 0];
  for (let row = end - 1; row >= track.first && until_s - track.at("t", row) < OVER_S; row -= 1) {
    const [wanted, felt] = [track.at("wanted", row), track.at("felt", row)];
    if (Number.isNaN(felt) || Number.isNaN(wanted)) continue;
    const had = Math.min(Math.max(wanted, track.at("low", row)), track.at("high", row));
    const jnd = wanted * WEBER_FRACTION;
    rows += 1;
    unreachable += track.isReachable(row) ? 0 : 1;
    reach += ((had - wanted) / jnd) ** 2;
    rendering += ((felt - had) / jnd) ** 2;
    total += ((felt - wanted) / jnd) ** 2;
  }
  if (!rows) return null;
  const rms = (/** @type {number} */ sum) => Math.sqrt(sum / rows);
  return { rows, reach: rms(reach), rendering: rms(rendering), total: rms(total), unreachable: unreachable / rows };
}

/** Return the speed of the newest rows [mm/s]. @param {Track} track */
export function speedOf(track) {
  const [to, from] = [track.count - 1, Math.max(track.first, track.count - 20)];
  if (to <= from) return NaN;
  const [dx, dy] = [track.at("x_mm", to) - track.at("x_mm", from), track.at("y_mm", to) - track.at("y_mm", from)];
  return Math.hypot(dx, dy) / (track.at("t", to) - track.at("t", from));
}

/** Return what was felt last; NaN for a finger that rests, which feels nothing. @param {Track} track */
function lastFelt(track) {
  const end = track.known;
  for (let row = end - 1; row >= track.first && track.end_s - track.at("t", row) < STILL_S; row -= 1) {
    const felt = track.at("felt", row);
    if (!Number.isNaN(felt)) return felt;
  }
  return NaN;
}

/** What sensing knows of the finger, and how sure. */
export class Sensed {
  /** @param {(on: boolean) => void} choose */
  constructor(choose) {
    const t = texts.play.sensing;
    this.box = el("input", { type: "checkbox", onchange: () => choose(this.box.checked) });
    const [state, attraction, force] = [el("output"), el("dd", {}, "–"), el("dd", {}, "–")];
    this.values = { state, attraction, force };
    this.element = el("div", {}, el("h2", {}, t.title),
      el("label.check", { title: t.help }, this.box, t.on), " ", state,
      el("dl.readings", {}, el("div", {}, el("dt", {}, t.attraction), attraction), el("div", {}, el("dt", {}, t.force), force)));
  }

  /** @param {Telemetry} telemetry @param {boolean} isOn */
  draw({ stats }, isOn) {
    const t = texts.play.sensing;
    this.box.checked = isOn;
    const isKnown = isOn && stats.sensing >= 0;
    this.values.state.textContent = isKnown ? t.states[stats.sensing] : "";
    this.values.attraction.textContent = isKnown ? t.within(stats.attraction.toFixed(2), stats.attraction_sd) : "–";
    this.values.force.textContent = isKnown ? t.within(`${stats.sensed_force_n.toFixed(2)} N`, stats.sensed_force_sd) : "–";
  }
}

const NUMBERS = /** @type {const} */ (["wanted", "felt", "force", "speed", "voltage", "reaction"]);

/** The newest values, and bars of the error's parts. */
export class Readings {
  constructor() {
    /** @type {Record<string, HTMLElement>} */
    this.values = Object.fromEntries(NUMBERS.map((name) => [name, el("dd", {}, "–")]));
    const pairs = NUMBERS.map((name) =>
      el("div", { "data-name": name }, el("dt", {}, texts.play.numbers[name]), this.values[name]),
    );
    this.element = el("dl.readings", {}, pairs);
    const parts = /** @type {const} */ (["rendering", "reach", "total"]);
    this.bars = parts.map((name) => {
      const [bar, value] = [el("i"), el("span", {}, "–")];
      const row = el("div.bar", {}, el("span", {}, texts.play.parts[name]), el("b", {}, bar), value);
      row.title = texts.play.partsHelp[name];
      return { name, bar, value, row };
    });
    this.unreachable = el("small");
    this.errors = el("div.errors", {}, this.bars.map(({ row }) => row), this.unreachable);
  }

  /** @param {Telemetry} telemetry @param {string} source of the force */
  draw(telemetry, source) {
    const track = telemetry.newest;
    const { values } = this;
    const { reaction_s } = telemetry.stats;
    values.reaction.textContent = reaction_s > 0 ? `${(1e3 * reaction_s).toFixed(1)} ms` : "–";
    if (!track) return;
    const row = track.count - 1;
    values.wanted.textContent = track.at("wanted", row).toFixed(3);
    const felt = lastFelt(track);
    values.felt.textContent = Number.isNaN(felt) ? "–" : felt.toFixed(3);
    values.force.textContent = `${track.at("normal_force_n", row).toFixed(2)} N `;
    values.force.append(el("small", {}, source));
    values.speed.textContent = `${speedOf(track).toFixed(0)} mm/s`;
    values.voltage.textContent = `${(100 * track.at("voltage_share", row)).toFixed(0)} % `;
    values.voltage.append(el("small", {}, texts.play.ofHighest));
    const errors = errorsOf(track);
    if (!errors) return;
    for (const { name, bar, value } of this.bars) {
      bar.style.width = `${Math.min(100 * errors[name], 100)}%`;
      value.textContent = `${errors[name].toFixed(2)} JND`;
    }
    this.unreachable.textContent = texts.play.unreachable(Math.round(100 * errors.unreachable));
  }
}
