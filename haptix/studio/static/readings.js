/** Numbers of the finger that was told of last, for reading and for screen readers. */

import { el } from "./dom.js";
import { WEBER_FRACTION } from "./telemetry.js";
import { texts } from "./texts.js";

/** @import { Telemetry, Track } from "./telemetry.js" */

const STILL_S = 1; // so long a number stays that is no longer new
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
    if (!track?.count) return;
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
