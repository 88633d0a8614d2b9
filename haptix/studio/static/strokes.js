/** Strokes: recorded from the board, sent again with the same times, kept as CSV. */

import { now } from "/client/haptix.js";

/** @import { Session } from "/client/haptix.js" */
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
    await new Promise((resolve) => setTimeout(resolve, STEP_MS));
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
