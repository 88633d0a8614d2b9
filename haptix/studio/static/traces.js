/** Curves of a finger: friction against time, and its spectrum. Drawn by uPlot. */

import { el } from "./dom.js";
import { amplitudes, POINTS } from "./spectrum.js";
import { WEBER_FRACTION } from "./telemetry.js";
import { texts } from "./texts.js";

/** @import { Track } from "./telemetry.js" */

const SHOWN_S = 1.5;
const PLOTTED = 500; // points of a curve; more than pixels are of no use
const LOWEST_HZ = 4;

/** @type {Promise<void> | undefined} */
let loading;

/** Load uPlot, once. */
export function loadPlots() {
  loading ??= new Promise((resolve, reject) => {
    document.head.append(
      el("link", { rel: "stylesheet", href: "/studio/vendor/uPlot.min.css" }),
      el("script", { src: "/studio/vendor/uPlot.min.js", onload: () => resolve(), onerror: reject }),
    );
  });
  return loading;
}

/** @param {string} name */
export const color = (name) => () => getComputedStyle(document.documentElement).getPropertyValue(name);

export const axis = () => ({
  stroke: color("--quiet"),
  grid: { stroke: color("--grid"), width: 0.5 },
  ticks: { show: false },
  font: "11px system-ui, sans-serif",
  labelFont: "11px system-ui, sans-serif",
  labelSize: 16,
  gap: 3,
});

/** A plot that fills its element. */
export class Plot {
  /** @param {Element} root @param {Omit<uPlot.Options, "width" | "height">} options
   * @param {uPlot.AlignedData} data */
  constructor(root, options, data) {
    const size = () => ({ width: root.clientWidth, height: root.clientHeight });
    this.plot = new uPlot({ ...options, ...size() }, data, /** @type {HTMLElement} */ (root));
    this.observer = new ResizeObserver(() => this.plot.setSize(size()));
    this.observer.observe(root);
  }

  close() {
    this.observer.disconnect();
    this.plot.destroy();
  }
}

export const OPTIONS = {
  legend: { show: false },
  cursor: { show: false },
  padding: /** @type {[number, number, number, number]} */ ([6, 10, 0, 0]),
};

/** Friction wanted and felt, with the reachable band, of the last second and a half. */
export class FrictionPlot extends Plot {
  #data = [0, 0, 0, 0, 0].map(() => /** @type {(number | null)[]} */ ([]));

  /** @param {Element} root */
  constructor(root) {
    const options = {
      ...OPTIONS,
      scales: { x: { time: false, range: () => /** @type {[number, number]} */ ([-SHOWN_S, 0]) } },
      axes: [
        { ...axis(), size: 24, label: texts.play.seconds, space: 60, values: (/** @type {any} */ _, /** @type {number[]} */ at) => at.map((s) => s.toFixed(1)) },
        { ...axis(), size: 44, label: texts.play.friction },
      ],
      series: [
        {},
        { stroke: color("--band"), width: 0, points: { show: false } },
        { stroke: color("--band"), width: 0, points: { show: false } },
        { stroke: color("--wanted"), width: 2, points: { show: false } },
        { stroke: color("--felt"), width: 1.5, points: { show: false } },
      ],
      bands: [{ series: /** @type {[number, number]} */ ([2, 1]), fill: color("--band") }],
    };
    super(root, options, [[0], [null], [null], [null], [null]]);
  }

  /** @param {Track} track */
  draw(track) {
    const end_s = track.end_s;
    let from = track.count;
    while (from > track.first && track.at("t", from - 1) > end_s - SHOWN_S) from -= 1;
    const step = Math.max(1, Math.ceil((track.count - from) / PLOTTED));
    const [t, low, high, wanted, felt] = this.#data;
    for (const column of this.#data) column.length = 0;
    let before = NaN;
    for (let row = Math.ceil(from / step) * step; row < track.count; row += step) {
      const at_s = track.at("t", row) - end_s;
      if (at_s - before > 0.05) {
        t.push(before + 1e-4); // the finger was off, or nothing was played
        for (const column of [low, high, wanted, felt]) column.push(null);
      }
      before = at_s;
      t.push(at_s);
      low.push(track.at("low", row));
      high.push(track.at("high", row));
      wanted.push(track.at("wanted", row));
      const value = track.at("felt", row);
      felt.push(Number.isNaN(value) ? null : value);
    }
    this.plot.setData(/** @type {any} */ (this.#data));
  }
}

/** Amplitudes of what was felt, in JND, from 4 Hz to half the rate of the rows. */
export class SpectrumPlot extends Plot {
  #signal = new Float64Array(POINTS);

  /** @param {Element} root */
  constructor(root) {
    const ticks = [5, 10, 20, 50, 100, 200, 500];
    const options = {
      ...OPTIONS,
      scales: {
        x: { time: false, distr: /** @type {3} */ (3), range: () => /** @type {[number, number]} */ ([LOWEST_HZ, 500]) },
        y: { range: (/** @type {any} */ _, /** @type {number} */ _low, /** @type {number} */ high) => /** @type {[number, number]} */ ([0, Math.max(1, high * 1.1)]) },
      },
      axes: [
        {
          ...axis(), size: 24, label: texts.play.hertz, filter: (/** @type {any} */ _, /** @type {number[]} */ at) => at, splits: () => ticks,
          values: (/** @type {any} */ _, /** @type {number[]} */ at) => at.map((hz) => (hz === null ? "" : String(hz))),
        },
        { ...axis(), size: 44, label: texts.play.jnd },
      ],
      series: [{}, { stroke: color("--felt"), fill: color("--soft"), width: 1.5, points: { show: false } }],
    };
    super(root, options, [[LOWEST_HZ], [null]]);
  }

  /** @param {Track} track */
  draw(track) {
    if (track.known - track.first < POINTS) return;
    let sum = 0;
    let count = 0;
    for (let at = 0; at < POINTS; at += 1) {
      const value = track.at("felt", track.known - POINTS + at);
      this.#signal[at] = value;
      if (!Number.isNaN(value)) [sum, count] = [sum + value, count + 1];
    }
    const step_s = (track.at("t", track.known - 1) - track.at("t", track.known - POINTS)) / (POINTS - 1);
    const found = amplitudes(this.#signal);
    const hz = Array.from(found, (_, at) => at / (POINTS * step_s));
    const first = hz.findIndex((one) => one >= LOWEST_HZ);
    const jnd = Array.from(found, (value) => value / ((sum / count) * WEBER_FRACTION));
    this.plot.setData([hz.slice(first), jnd.slice(first)]);
  }
}
