/** Forces and speed of a calibration's stroke, as its instruments read them. Drawn by uPlot. */

import { el, fill } from "./dom.js";
import { texts } from "./texts.js";
import { axis, color, loadPlots, OPTIONS, Plot } from "./traces.js";

/** @import * as m from "../../../clients/typescript/types/messages.js" */
/** @typedef {NonNullable<m.Job["trace"]>} Trace */

const TOLERANCE = 0.15; // of the protocols; beyond it a stroke is asked for once more
const t = texts.calibrate;

/** Curves over the time of one stroke, on a band of what was asked for. */
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

  /** @param {number[]} t_s @param {number} asked @param {number[][]} curves */
  draw(t_s, asked, curves) {
    const level = (/** @type {number} */ share) => t_s.map(() => asked * share);
    this.plot.setData([t_s, level(1 - TOLERANCE), level(1 + TOLERANCE), ...curves]);
  }
}

/** The plots of the stroke that is made, or was made last. */
export class StrokePlots {
  #title = el("h3");
  #forces = el("div.plot.low");
  #speed = el("div.plot.low");
  element = el("section.sheet.set-up", { hidden: true, "aria-label": t.traces },
    this.#title,
    el("p", {}, key("wanted", t.normal), key("felt", t.tangential), key("band", t.asked)), this.#forces,
    el("p", {}, key("wanted", t.speed)), this.#speed);
  /** @type {StrokePlot[]} */
  #plots = [];
  /** @type {Trace | null} */
  #trace = null;
  #ended = false;

  /** Take what was read since the last time. @param {Trace} part */
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

/** @param {string} name @param {string} text */
function key(name, text) {
  const mark = el("i.key", { "aria-hidden": "true" });
  mark.style.background = `var(--${name})`;
  return el("span.keyed", {}, mark, text);
}
