/** Fingers on the board: pointers and keys become touches. */

import { now } from "/client/haptix.js";
import { Pointers } from "/client/pointers.js";
import { view } from "./view.js";

/** @import { Board } from "./board.js" */
/** @import { Service } from "./service.js" */
/** @import { Point } from "./strokes.js" */
/** @typedef {{x_mm: number, y_mm: number, touch_id: number}} Cursor */

const KEY_SPEED_MM_S = 60;
const KEY_STEP_MS = 8;
const [FINGERS, KEY_TOUCH] = [9, 9]; // pointers have numbers below that of the keyboard
const LEAST_N = 0.05;
const ARROWS = /** @type {Record<string, [number, number]>} */ ({
  ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1],
});
const KINDS = ["pointerdown", "pointermove", "pointerup", "pointercancel", "pointerleave"];

/** Return the normal force of an event [N]; undefined if the service assumes one.
 * @param {{pressure: number, pointerType: string}} event */
export function forceOf({ pressure, pointerType }) {
  const { force, force_n, pressure_n } = view.get();
  if (force === "assumed") return undefined;
  // A mouse always reports 0.5, which is no pressure.
  if (force === "pressure" && pointerType !== "mouse" && pressure > 0) {
    return Math.max(pressure * pressure_n, LEAST_N);
  }
  return force_n;
}

export class Touching {
  /** Where fingers are. @type {Map<number, Cursor>} */
  cursors = new Map();
  /** Called with each point, also of a replay. @type {Set<(t_s: number, point: Omit<Point, "t_s">) => void>} */
  onPoint = new Set();
  /** @type {{x: number, y: number} | null} the keyboard's finger */
  #key = null;
  #pressed = new Set();
  #timer = 0;
  #pointers = new Pointers(FINGERS);
  #end = new AbortController();

  /** @param {Board} board @param {Service} service */
  constructor(board, service) {
    this.board = board;
    this.service = service;
    const { element } = board;
    const { signal } = this.#end;
    for (const kind of KINDS) {
      element.addEventListener(kind, (event) => this.#pointer(/** @type {PointerEvent} */ (event)), { signal });
    }
    element.addEventListener("keydown", (event) => this.#keyDown(event), { signal });
    element.addEventListener("keyup", (event) => this.#keyUp(event), { signal });
    element.addEventListener("blur", () => this.#release(), { signal });
    element.addEventListener("contextmenu", (event) => event.preventDefault(), { signal });
    board.onFit = () => void this.geometry();
  }

  /** Begin with a session, which may be new: for it, the next move of each finger is a down. */
  begin() {
    this.#pointers.clear();
    for (const { touch_id, x_mm, y_mm } of [...this.cursors.values()]) {
      this.took(now(), { touch_id, kind: "up", x_mm, y_mm, normal_force_n: undefined });
    }
    void this.geometry();
  }

  /** Send the place of the board, so that pixels become millimetres. */
  async geometry() {
    const { box, px_per_mm } = this.board;
    await this.service.session
      ?.geometry({ px_per_mm, origin_mm: [box.left, box.top] })
      .catch(() => {}); // it is sent again in the next session
  }

  close() {
    this.#release();
    this.#end.abort();
    for (const touch_id of this.cursors.keys()) this.service.session?.lift(touch_id);
    this.cursors.clear();
  }

  /** Handle a point that was sent, of a pointer, a key, or a replay. @param {number} t_s @param {Omit<Point, "t_s">} point */
  took(t_s, point) {
    if (point.kind === "up") this.cursors.delete(point.touch_id);
    else this.cursors.set(point.touch_id, point);
    for (const handler of this.onPoint) handler(t_s, point);
  }

  /** @param {PointerEvent} event */
  #pointer(event) {
    const { element } = this.board;
    if (event.type === "pointerdown") {
      element.setPointerCapture(event.pointerId);
      element.focus({ preventScroll: true });
    }
    const touches = this.#pointers.touches(event, element, now(), forceOf(event));
    this.service.session?.touches(touches);
    for (const { t_s, touch_id = 0, kind = "move", x_px, y_px, normal_force_n } of touches) {
      const place = this.board.placeAt(Number(x_px), Number(y_px));
      this.took(t_s, { ...place, touch_id, kind, normal_force_n: normal_force_n ?? undefined });
    }
    // A frame is seen late: the ring is drawn where the finger will be, the trail where it was.
    const last = touches.at(-1);
    const ahead = last?.kind === "move" ? event.getPredictedEvents?.().at(-1) : null;
    const cursor = this.cursors.get(last?.touch_id ?? -1);
    if (ahead && cursor) this.cursors.set(cursor.touch_id, { ...cursor, ...this.board.place(ahead) });
  }

  /** @param {KeyboardEvent} event */
  #keyDown(event) {
    if (!(event.key in ARROWS) || event.ctrlKey || event.metaKey || event.altKey) return;
    event.preventDefault();
    this.#pressed.add(event.key);
    if (this.#timer) return;
    const { box } = this.board;
    this.#key ??= { x: box.left + box.width / 2, y: box.top + box.height / 2 };
    this.#keys("down");
    let before_s = now();
    this.#timer = setInterval(() => {
      const s = now();
      const directions = [...this.#pressed].map((key) => ARROWS[key]);
      const [dx, dy] = [0, 1].map((axis) => directions.reduce((sum, each) => sum + each[axis], 0));
      const step_mm = (KEY_SPEED_MM_S * (s - before_s)) / (Math.hypot(dx, dy) || 1);
      before_s = s;
      const key = /** @type {{x: number, y: number}} */ (this.#key);
      key.x = clamp(key.x + dx * step_mm, box.left, box.left + box.width);
      key.y = clamp(key.y + dy * step_mm, box.top, box.top + box.height);
      this.#keys("move");
    }, KEY_STEP_MS);
  }

  /** @param {KeyboardEvent} event */
  #keyUp(event) {
    this.#pressed.delete(event.key);
    if (!this.#pressed.size) this.#release();
  }

  #release() {
    this.#pressed.clear();
    if (!this.#timer) return;
    clearInterval(this.#timer);
    this.#timer = 0;
    this.#keys("up");
  }

  /** @param {"down" | "move" | "up"} kind */
  #keys(kind) {
    const { x, y } = /** @type {{x: number, y: number}} */ (this.#key);
    const normal_force_n = forceOf({ pressure: 0, pointerType: "mouse" });
    const point = { touch_id: KEY_TOUCH, kind, x_mm: x, y_mm: y, normal_force_n };
    const t_s = now();
    this.service.session?.touches([{ ...point, t_s }]);
    this.took(t_s, point);
  }
}

/** @param {number} value @param {number} low @param {number} high */
function clamp(value, low, high) {
  return Math.min(Math.max(value, low), high);
}
