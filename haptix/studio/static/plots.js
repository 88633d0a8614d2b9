/** Curves drawn by uPlot: friction and its spectrum under a finger, and a calibration's strokes. */

import { el, fill, keyed } from "./dom.js";
import { WEBER_FRACTION } from "./telemetry.js";
import { texts } from "./texts.js";

/** @import { Track } from "./telemetry.js" */
/** @import * as m from "../../../clients/typescript/types/messages.js" */

const SHOWN_S = 1.5;
const PLOTTED = 500; // points of a curve; more than its pixels are useless
const LOWEST_HZ = 4;
const POINTS = 512; // of the spectrum
const TOLERANCE = 0.15; // of a calibration's protocol; beyond it a stroke is repeated
const t = texts.calibrate;

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

/** The curves' names with the marks of their colours. */
export const KEYS = Object.fromEntries(["wanted", "felt", "band"].map((name) =>
  [name, (/** @type {string} */ text) => el("span.keyed", {}, keyed(`var(--${name})`, text))]));

/** @param {string} name */
const color = (name) => () => getComputedStyle(document.documentElement).getPropertyValue(name);

const axis = () => ({
  stroke: color("--quiet"),
  grid: { stroke: color("--grid"), width: 0.5 },
  ticks: { show: false },
  font: "11px system-ui, sans-serif",
  labelFont: "11px system-ui, sans-serif",
  labelSize: 16,
  gap: 3,
});

/** A plot that fills its element. */
class Plot {
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

const OPTIONS = {
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
    const components = amplitudes(this.#signal);
    const hz = Array.from(components, (_, at) => at / (POINTS * step_s));
    const first = hz.findIndex((value) => value >= LOWEST_HZ);
    const jnd = Array.from(components, (value) => value / ((sum / count) * WEBER_FRACTION));
    this.plot.setData([hz.slice(first), jnd.slice(first)]);
  }
}

/**
 * Return amplitudes of a signal's components, its mean and its ends left out (Hann's window).
 * @param {ArrayLike<number>} signal POINTS long; NaN counts as the mean
 * @returns {Float64Array} POINTS / 2 amplitudes, from 0 Hz on, POINTS-ths of the rate apart
 */
export function amplitudes(signal) {
  let [sum, count] = [0, 0];
  for (let at = 0; at < POINTS; at += 1) {
    if (Number.isNaN(signal[at])) continue;
    sum += signal[at];
    count += 1;
  }
  const mean = sum / Math.max(count, 1);
  const [re, im] = [new Float64Array(POINTS), new Float64Array(POINTS)];
  for (let at = 0; at < POINTS; at += 1) {
    const value = Number.isNaN(signal[at]) ? 0 : signal[at] - mean;
    // In the order of reversed bits, for the transform in place.
    let reversed = 0;
    for (let bit = 1, from = at; bit < POINTS; bit <<= 1, from >>= 1) reversed = (reversed << 1) | (from & 1);
    re[reversed] = value * (0.5 - 0.5 * Math.cos((2 * Math.PI * at) / POINTS));
  }
  for (let half = 1; half < POINTS; half <<= 1) {
    for (let step = 0; step < half; step += 1) {
      const angle = (-Math.PI * step) / half;
      const [c, s] = [Math.cos(angle), Math.sin(angle)];
      for (let at = step; at < POINTS; at += 2 * half) {
        const other = at + half;
        const [x, y] = [re[other] * c - im[other] * s, re[other] * s + im[other] * c];
        re[other] = re[at] - x;
        im[other] = im[at] - y;
        re[at] += x;
        im[at] += y;
      }
    }
  }
  // A sine of amplitude 1 has a component of POINTS / 2, times the window's mean of a half.
  return Float64Array.from({ length: POINTS / 2 }, (_, at) => Math.hypot(re[at], im[at]) / (POINTS / 4));
}

/** @typedef {NonNullable<m.Job["trace"]>} Trace */

/** Curves over the time of one stroke, on a band around the requested value. */
class StrokePlot extends Plot {
  /** @param {Element} root @param {string} label @param {string[]} colors */
  constructor(root, label, colors) {
    const none = { stroke: color("--band"), width: 0, points: { show: false } };
    super(root, {
      ...OPTIONS,
      scales: {
        x: { time: false },
        y: { range: (/** @type {any} */ _, /** @type {number} */ low, /** @type {number} */ high) => /** @type {[number, number]} */ ([Math.min(0, low), Math.max(1e-3, high) * 1.1]) },
      },
      axes: [{ ...axis(), size: 24, label: texts.play.seconds }, { ...axis(), size: 44, label }],
      series: [{}, none, none, ...colors.map((name) => ({ stroke: color(name), width: 2, points: { show: false } }))],
      bands: [{ series: /** @type {[number, number]} */ ([2, 1]), fill: color("--band") }],
    }, [[0], [null], [null], ...colors.map(() => [null])]);
  }

  /** @param {number[]} t_s @param {number} target @param {number[][]} curves */
  draw(t_s, target, curves) {
    const level = (/** @type {number} */ share) => t_s.map(() => target * share);
    this.plot.setData([t_s, level(1 - TOLERANCE), level(1 + TOLERANCE), ...curves]);
  }
}

/** The plots of the present or the last stroke. */
export class StrokePlots {
  #title = el("h3");
  #forces = el("div.plot.low");
  #speed = el("div.plot.low");
  element = el("section.sheet.set-up", { hidden: true, "aria-label": t.traces },
    this.#title,
    el("p", {}, KEYS.wanted(t.normal), KEYS.felt(t.tangential), KEYS.band(t.asked)), this.#forces,
    el("p", {}, KEYS.wanted(t.speed)), this.#speed);
  /** @type {StrokePlot[]} */
  #plots = [];
  /** @type {Trace | null} */
  #trace = null;
  #ended = false;

  /** Add the readings since the last call. @param {Trace} part */
  add(part) {
    const { stroke, tries, t_s: [first] } = part;
    const whole = this.#trace;
    const goes_on = whole?.stroke === stroke && whole.tries === tries && first > (whole.t_s.at(-1) ?? 0);
    if (whole && goes_on) {
      for (const name of /** @type {const} */ (["t_s", "normal_force_n", "tangential_force_n", "speed_mm_per_s"])) {
        whole[name] = [...whole[name], ...part[name]];
      }
    } else this.#trace = part;
    void this.#draw();
  }

  close() {
    this.#ended = true;
    for (const plot of this.#plots) plot.close();
  }

  async #draw() {
    const first = this.element.hidden;
    this.element.hidden = false;
    if (first) {
      await loadPlots();
      if (this.#ended) return;
      this.#plots = [
        new StrokePlot(this.#forces, t.newtons, ["--wanted", "--felt"]),
        new StrokePlot(this.#speed, t.mmPerS, ["--wanted"]),
      ];
    }
    const trace = this.#trace;
    if (!trace || !this.#plots.length) return;
    fill(this.#title, t.trace(trace.stroke, trace.tries));
    const [forces, speed] = this.#plots;
    forces.draw(trace.t_s, trace.asked_normal_force_n, [trace.normal_force_n, trace.tangential_force_n]);
    speed.draw(trace.t_s, trace.asked_speed_mm_per_s, [trace.speed_mm_per_s]);
  }
}
