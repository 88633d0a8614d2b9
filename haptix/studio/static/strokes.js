/** Strokes: record them on the board, replay them with the same times, save and compare them. */

import { now } from "/client/haptix.js";
import { el, fill, pause } from "./dom.js";
import { errorsOf } from "./telemetry.js";
import { texts } from "./texts.js";

/** @import { Session } from "/client/haptix.js" */
/** @import { App } from "./app.js" */
/** @import { Telemetry, Track } from "./telemetry.js" */
/** @import * as m from "../../../clients/typescript/types/messages.js" */
/**
 * @typedef {object} Point
 * @property {number} t_s since the stroke's begin
 * @property {number} touch_id
 * @property {"down" | "move" | "up"} kind
 * @property {number} x_mm
 * @property {number} y_mm
 * @property {number | undefined} normal_force_n undefined: the service assumes one
 */
/** @typedef {Point[]} Stroke */

const LONGEST_S = 60;
const STEP_MS = 8;

/** Keeps what a finger does from the first down to the last up. */
export class StrokeRecorder {
  /** @type {Stroke} */
  points = [];
  #begin_s = NaN;

  /** Whether there is a whole stroke. */
  get isWhole() {
    return this.points.length > 2;
  }

  /** @param {number} t_s @param {Omit<Point, "t_s">} point */
  add(t_s, point) {
    if (Number.isNaN(this.#begin_s)) {
      if (point.kind !== "down") return;
      this.#begin_s = t_s;
    }
    if (t_s - this.#begin_s > LONGEST_S && point.kind !== "up") return;
    this.points.push({ ...point, t_s: t_s - this.#begin_s });
  }

  clear() {
    this.points = [];
    this.#begin_s = NaN;
  }
}

/**
 * Touch as recorded; resolves when it is over.
 * @param {Session} session
 * @param {Stroke} stroke
 * @param {(point: Point) => void} shown called as each point is sent
 * @param {AbortSignal} signal ends it before
 * @returns {Promise<void>}
 */
export async function replay(session, stroke, shown, signal) {
  const begin_s = now();
  let next = 0;
  while (next < stroke.length && !signal.aborted) {
    const elapsed_s = now() - begin_s;
    const due = [];
    for (; next < stroke.length && stroke[next].t_s <= elapsed_s; next += 1) due.push(stroke[next]);
    if (due.length) {
      session.touches(due.map(({ t_s, ...touch }) => ({ ...touch, t_s: begin_s + t_s })));
      due.forEach(shown);
    }
    await pause(STEP_MS);
  }
  if (signal.aborted) {
    for (const touch_id of new Set(stroke.map((point) => point.touch_id))) session.lift(touch_id);
  }
}

/** Return a stroke of one finger as the CSV that `haptix render` takes.
 * @param {Stroke} stroke @param {number} force_n where none was known */
export function toCsv(stroke, force_n) {
  const finger = stroke[0].touch_id;
  const rows = stroke
    .filter((point) => point.touch_id === finger && point.kind !== "up")
    .map(({ t_s, x_mm, y_mm, normal_force_n }) =>
      [t_s.toFixed(6), x_mm.toFixed(4), y_mm.toFixed(4), (normal_force_n ?? force_n).toFixed(4)].join(","),
    );
  return ["t_s,x_mm,y_mm,normal_force_n", ...rows, ""].join("\n");
}

const PAUSE_MS = 700; // between two strokes, for the cross-fade and for the person
const SETTLE_MS = 400; // until the felt friction of the stroke's end has come
const t = texts.compare;

/** Return the layout of one material alone, under all of a stroke.
 * @param {m.RegionDocument} region @param {Stroke} stroke @returns {m.LayoutDocument} */
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
  #message = el("div.told-comparison", { role: "status" });
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
      this.#message,
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
    if (!stroke.length) return fill(this.#message, t.needsStroke);
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
        fill(this.#message, t.plays(shownName));
        await this.app.layout.override(alone(region, stroke));
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
      await this.app.layout.restore();
      this.#running = null;
      this.#start.disabled = false;
    }
  }

  /** @param {string[]} order @param {string[]} results */
  #answer(order, results) {
    const reveal = () =>
      fill(
        this.#message,
        el("table", {},
          order.map((name, at) =>
            el("tr", {}, el("th", { scope: "row" }, this.#blind.checked ? `${t.nameless[at]} = ${name}` : name), el("td", {}, results[at])),
          )),
      );
    if (!this.#blind.checked) return reveal();
    const choose = (/** @type {string} */ answer) => () => {
      reveal();
      this.#message.append(el("p", {}, t.answered(answer)));
    };
    fill(
      this.#message,
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
