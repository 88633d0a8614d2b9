/** Regions on the board: choose, drag, resize and draw them by pointer and by keyboard. */

import { placeOf } from "./board.js";
import { el, fill } from "./dom.js";
import { texts } from "./texts.js";

/** @import { Board } from "./board.js" */
/** @import { History } from "./document.js" */
/** @import * as m from "../../../clients/typescript/types/messages.js" */
/** @typedef {{x_mm: number, y_mm: number, width_mm: number, height_mm: number}} Rectangle */

const t = texts.make;
const SMALLEST_MM = 2;
const DRAWN_MM = 4; // a shorter drag is a click
const ARROWS = /** @type {Record<string, [number, number]>} */ ({
  ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1],
});

export class Regions {
  /** @type {string} name of the chosen region, or "" */
  chosen = "";
  #layer = el("div.regions");
  /** @type {Map<string, HTMLElement>} */
  #boxes = new Map();
  #drawing = el("div.drawing", { hidden: true });
  #is_dragging = false;

  /**
   * @param {Board} board
   * @param {History<m.LayoutDocument>} history
   * @param {{choose: (name: string) => void, draw: (place: Rectangle) => void}} on
   */
  constructor(board, history, on) {
    this.board = board;
    this.history = history;
    this.on = on;
    board.element.append(this.#layer, this.#drawing);
    board.element.addEventListener("pointerdown", (event) => this.#begin(event));
  }

  /** Show the document's regions. @param {m.LayoutDocument} document */
  show(document) {
    const names = document.regions.map(({ name }) => name);
    if (!names.includes(this.chosen)) this.choose("");
    for (const [name, box] of this.#boxes) {
      if (names.includes(name)) continue;
      box.remove();
      this.#boxes.delete(name);
    }
    for (const name of names) if (!this.#boxes.has(name)) this.#boxes.set(name, this.#box(name));
    this.#layer.append(...names.map((name) => /** @type {HTMLElement} */ (this.#boxes.get(name))).filter((box) => !box.isConnected));
    if (this.#is_dragging) {
      this.board.document = document; // the plane stays where it is under the pointer
      this.board.draw();
      this.place();
    } else this.board.show(document);
  }

  /** Choose a region. @param {string} name */
  choose(name) {
    if (name === this.chosen) return;
    this.chosen = name;
    for (const [each, box] of this.#boxes) box.setAttribute("aria-pressed", String(each === name));
    this.on.choose(name);
  }

  /** Give a region the focus. @param {string} name */
  focus(name) {
    this.#boxes.get(name)?.focus();
  }

  /** Put the boxes where their regions are. */
  place() {
    for (const region of this.history.current.regions) {
      const element = this.#boxes.get(region.name);
      if (!element) continue;
      const { x, y, width, height } = placeOf(region);
      Object.assign(element.style, this.board.styleOf(region), { zIndex: String(10 + Math.round(region.z ?? 0)) });
      element.setAttribute("aria-label", t.region(region.name, width, height, x, y));
    }
  }

  /** @param {string} name */
  #box(name) {
    const corner = el("i.corner", { "aria-hidden": "true" });
    const box = el("button.region", { type: "button", "aria-pressed": "false", onfocus: () => this.choose(name) }, corner);
    box.addEventListener("pointerdown", (event) => this.#drag(event, name, event.target === corner));
    box.addEventListener("keydown", (event) => this.#key(event, name));
    return box;
  }

  /** @param {PointerEvent} event @param {string} name @param {boolean} sizes */
  #drag(event, name, sizes) {
    event.stopPropagation();
    const region = this.history.current.regions.find((each) => each.name === name);
    const box = this.#boxes.get(name);
    if (!region || !box || event.button) return;
    box.focus();
    box.setPointerCapture(event.pointerId);
    const from = this.board.place(event);
    const { x, y, width, height } = placeOf(region);
    this.#is_dragging = true;
    const end = new AbortController();
    box.addEventListener("pointermove", (/** @type {PointerEvent} */ moved) => {
      const to = this.board.place(moved);
      const snap = (/** @type {number} */ value) => (moved.altKey ? Math.round(10 * value) / 10 : Math.round(value));
      const [dx, dy] = [to.x_mm - from.x_mm, to.y_mm - from.y_mm];
      if (sizes) {
        const size = { width_mm: Math.max(SMALLEST_MM, snap(width + dx)), height_mm: Math.max(SMALLEST_MM, snap(height + dy)) };
        this.#change(name, t.did.size, size);
      } else this.#change(name, t.did.move, { x_mm: snap(x + dx), y_mm: snap(y + dy) });
    }, { signal: end.signal });
    const ends = () => {
      end.abort();
      this.#is_dragging = false;
      this.board.show(this.history.current);
    };
    for (const kind of ["pointerup", "pointercancel"]) box.addEventListener(kind, ends, { signal: end.signal });
  }

  /** @param {KeyboardEvent} event @param {string} name */
  #key(event, name) {
    const arrow = ARROWS[event.key];
    if (event.key === "Delete" || event.key === "Backspace") {
      event.preventDefault();
      this.remove(name);
    } else if (arrow) {
      event.preventDefault();
      const region = this.history.current.regions.find((each) => each.name === name);
      if (!region) return;
      const { x, y, width, height } = placeOf(region);
      const [dx, dy] = arrow;
      if (event.shiftKey) {
        this.#change(name, t.did.size, { width_mm: Math.max(SMALLEST_MM, width + dx), height_mm: Math.max(SMALLEST_MM, height + dy) });
      } else this.#change(name, t.did.move, { x_mm: x + dx, y_mm: y + dy });
    }
  }

  /** @param {string} name */
  remove(name) {
    this.history.change(t.did.remove(name), (draft) => {
      draft.regions = draft.regions.filter((region) => region.name !== name);
    });
  }

  /** @param {string} name @param {string} label @param {Partial<m.RegionDocument>} fields */
  #change(name, label, fields) {
    this.history.change(label, (draft) => {
      const region = draft.regions.find((each) => each.name === name);
      if (region) Object.assign(region, fields);
    }, `${label} ${name}`);
  }

  /** Draw a new region on a free place. @param {PointerEvent} event */
  #begin(event) {
    if (event.button) return;
    this.choose("");
    const { element } = this.board;
    const from = this.board.place(event);
    element.setPointerCapture(event.pointerId);
    const end = new AbortController();
    const rectangle = (/** @type {PointerEvent} */ to_event) => {
      const to = this.board.place(to_event);
      const [x, y] = [Math.min(from.x_mm, to.x_mm), Math.min(from.y_mm, to.y_mm)].map(Math.round);
      return { x_mm: x, y_mm: y, width_mm: Math.round(Math.abs(to.x_mm - from.x_mm)), height_mm: Math.round(Math.abs(to.y_mm - from.y_mm)) };
    };
    element.addEventListener("pointermove", (moved) => {
      const drawn = rectangle(moved);
      this.#drawing.hidden = false;
      Object.assign(this.#drawing.style, this.board.styleOf({ name: "", material: { kind: "noise" }, ...drawn }));
      fill(this.#drawing, `${drawn.width_mm} × ${drawn.height_mm} mm`);
    }, { signal: end.signal });
    element.addEventListener("pointerup", (up) => {
      end.abort();
      this.#drawing.hidden = true;
      const drawn = rectangle(up);
      if (Math.min(drawn.width_mm, drawn.height_mm) >= DRAWN_MM) this.on.draw(drawn);
    }, { signal: end.signal });
    element.addEventListener("pointercancel", () => {
      end.abort();
      this.#drawing.hidden = true;
    }, { signal: end.signal });
  }
}
