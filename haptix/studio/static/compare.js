/** Two materials felt by the same stroke, one after the other; blind if wanted. */

import { el, fill } from "./dom.js";
import { errorsOf } from "./readings.js";
import { replay } from "./strokes.js";
import { texts } from "./texts.js";

/** @import * as m from "../../../clients/typescript/types/messages.js" */
/** @import { App } from "./app.js" */
/** @import { Stroke, Point } from "./strokes.js" */
/** @import { Telemetry, Track } from "./telemetry.js" */

const PAUSE_MS = 700; // between two strokes, for the cross-fade and for the person
const SETTLE_MS = 400; // until what was felt at the end is told
const t = texts.compare;

/** Return the layout of one material alone, under all of a stroke.
 * @param {m.Region} region @param {Stroke} stroke @returns {m.LayoutDocument} */
export function alone(region, stroke) {
  const { name, material } = region;
  const [xs, ys] = [stroke.map((point) => point.x_mm), stroke.map((point) => point.y_mm)];
  const [x_mm, y_mm] = [Math.min(...xs) - 5, Math.min(...ys) - 5];
  const place = { x_mm, y_mm, width_mm: Math.max(...xs) + 5 - x_mm, height_mm: Math.max(...ys) + 5 - y_mm };
  return { regions: [{ name, material, ...place }] };
}

export class Comparison {
  #chosen = { a: el("select", { id: "compare-a" }), b: el("select", { id: "compare-b" }) };
  #blind = el("input", { type: "checkbox" });
  #told = el("div.told-comparison", { role: "status" });
  #start = el("button.main", { type: "button", onclick: () => void this.#run() }, t.start);
  /** @type {AbortController | null} */
  #running = null;

  /**
   * @param {App} app
   * @param {Telemetry} telemetry
   * @param {() => Stroke} stroke
   * @param {(point: Point) => void} shown
   */
  constructor(app, telemetry, stroke, shown) {
    this.app = app;
    this.telemetry = telemetry;
    this.stroke = stroke;
    this.shown = shown;
    this.element = el(
      "details.compare",
      { name: "tools" },
      el("summary", {}, t.title),
      el("p.quiet", {}, t.help),
      el("div.row", {},
        el("label", { for: "compare-a" }, "A"), this.#chosen.a,
        el("label", { for: "compare-b" }, "B"), this.#chosen.b,
        el("label.row", {}, this.#blind, t.blind),
        this.#start),
      this.#told,
    );
    this.end = app.history.document.on((document) => this.#offer(document));
  }

  close() {
    this.end();
    this.#running?.abort();
  }

  /** @param {m.LayoutDocument} document */
  #offer({ regions }) {
    Object.values(this.#chosen).forEach((select, at) => {
      const before = select.value;
      const names = regions.map(({ name }) => name);
      fill(select, names.map((name) => el("option", { value: name }, name)));
      select.value = names.includes(before) ? before : (names[at] ?? "");
    });
  }

  async #run() {
    const stroke = this.stroke();
    const { session } = this.app.service;
    if (this.#running || !session) return;
    if (!stroke.length) return fill(this.#told, t.needsStroke);
    const [a, b] = [this.#chosen.a.value, this.#chosen.b.value];
    const order = [a, b];
    if (this.#blind.checked && Math.random() < 0.5) order.reverse();
    const running = (this.#running = new AbortController());
    this.#start.disabled = true;
    /** @type {string[]} */
    const results = [];
    try {
      for (const [at, name] of order.entries()) {
        const region = this.app.history.current.regions.find((each) => each.name === name);
        if (!region) continue;
        const shownName = this.#blind.checked ? t.nameless[at] : name;
        fill(this.#told, t.plays(shownName));
        await this.app.layout.hold(alone(region, stroke));
        await pause(PAUSE_MS);
        await replay(session, stroke, this.shown, running.signal);
        await pause(SETTLE_MS);
        const track = this.telemetry.newest;
        results.push(track ? summary(track) : "");
        if (running.signal.aborted) return;
      }
      this.#answer(order, results);
    } catch (error) {
      this.app.service.notify("error", error instanceof Error ? error.message : String(error));
    } finally {
      await this.app.layout.release();
      this.#running = null;
      this.#start.disabled = false;
    }
  }

  /** @param {string[]} order @param {string[]} results */
  #answer(order, results) {
    const reveal = () =>
      fill(
        this.#told,
        el("table", {},
          order.map((name, at) =>
            el("tr", {}, el("th", { scope: "row" }, this.#blind.checked ? `${t.nameless[at]} = ${name}` : name), el("td", {}, results[at])),
          )),
      );
    if (!this.#blind.checked) return reveal();
    const choose = (/** @type {string} */ answer) => () => {
      reveal();
      this.#told.append(el("p", {}, t.answered(answer)));
    };
    fill(
      this.#told,
      el("p", {}, t.question),
      el("div.row", {}, [...t.nameless, t.same].map((answer) => el("button", { type: "button", onclick: choose(answer) }, answer))),
    );
  }
}

/** @param {Track} track */
function summary(track) {
  let [sum, squares, count] = [0, 0, 0];
  for (let row = track.first; row < track.known; row += 1) {
    const felt = track.at("felt", row);
    if (Number.isNaN(felt)) continue;
    [sum, squares, count] = [sum + felt, squares + felt ** 2, count + 1];
  }
  if (!count) return t.nothing;
  const mean = sum / count;
  const deviation = Math.sqrt(Math.max(squares / count - mean ** 2, 0));
  return t.result(mean, deviation, errorsOf(track)?.total ?? NaN);
}

/** @param {number} ms @returns {Promise<void>} */
function pause(ms) {
  return new Promise((resolve) => setTimeout(resolve, ms));
}
