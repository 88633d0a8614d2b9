/** Regions on the board: choose, move, size, draw, copy and arrange them by pointer and by keyboard. */

import { aligned, distributed, freeName } from "./arrange.js";
import { boxOfRegion, placeOf } from "./board.js";
import { el, fill, store, stored, Value } from "./dom.js";
import { texts } from "./texts.js";

/** @import { Axis } from "./arrange.js" */
/** @import { Board } from "./board.js" */
/** @import { History } from "./document.js" */
/** @import * as m from "../../../clients/typescript/types/messages.js" */
/** @typedef {{x_mm: number, y_mm: number, width_mm: number, height_mm: number}} Rectangle */

const t = texts.make;
const SMALLEST_MM = 2;
const DRAWN_MM = 4; // a shorter drag is a click
const COPY_MM = 4; // a copy lies so far beside what it is of
const MOST_REGIONS = 256; // of a layout, for the service
const COPIED = "haptix.copied"; // in this browser, for all its pages
const ARROWS = /** @type {Record<string, [number, number]>} */ ({
  ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1],
});

const rounded = (/** @type {number} */ mm) => Math.round(1e3 * mm) / 1e3;

export class Regions {
  /** @type {string[]} names of the chosen regions; the last one's parameters are shown */
  chosen = [];
  /** Whether the next drag draws a region; else one on free ground chooses the regions that it meets. */
  draws = new Value(false);
  #layer = el("div.regions");
  /** @type {Map<string, HTMLElement>} */
  #boxes = new Map();
  #drawing = el("div.drawing", { hidden: true });
  #is_dragging = false;
  /** @type {string[]} */
  #names = [];

  /**
   * @param {Board} board
   * @param {History<m.LayoutDocument>} history
   * @param {{choose: () => void, draw: (place: Rectangle) => void, refuse: (why: string) => void}} on
   */
  constructor(board, history, on) {
    this.board = board;
    this.history = history;
    this.on = on;
    board.element.append(this.#layer, this.#drawing);
    board.element.addEventListener("pointerdown", (event) => this.#begin(event));
  }

  /** The chosen regions, in the order in which they were chosen. */
  get regions() {
    const all = this.history.current.regions;
    return this.chosen.flatMap((name) => all.find((region) => region.name === name) ?? []);
  }

  /** Show the document's regions. @param {m.LayoutDocument} document */
  show(document) {
    const names = document.regions.map(({ name }) => name);
    const before = this.#names;
    this.#names = names;
    for (const [name, box] of this.#boxes) {
      if (names.includes(name)) continue;
      box.remove();
      this.#boxes.delete(name);
    }
    for (const name of names) if (!this.#boxes.has(name)) this.#boxes.set(name, this.#box(name));
    this.#layer.append(...names.map((name) => /** @type {HTMLElement} */ (this.#boxes.get(name))).filter((box) => !box.isConnected));
    // One that has another name at its place was renamed.
    const renamed = (/** @type {string} */ name) => (before.length === names.length ? names[before.indexOf(name)] : undefined);
    this.choose(this.chosen.flatMap((name) => (names.includes(name) ? name : renamed(name)) ?? []));
    if (this.#is_dragging) {
      this.board.document = document; // the plane stays where it is under the pointer
      this.board.draw();
      this.place();
    } else this.board.show(document);
  }

  /** Return names with those of their groups; the given ones come last. @param {string[]} names */
  #whole(names) {
    const all = this.history.current.regions;
    const groups = new Set(all.flatMap(({ name, group }) => (group && names.includes(name) ? group : [])));
    const others = all.filter(({ name, group }) => group && groups.has(group) && !names.includes(name));
    return [...others.map(({ name }) => name), ...names];
  }

  /** Choose regions instead of those that are chosen. @param {string[]} names */
  choose(names) {
    if (String(names) === String(this.chosen)) return;
    this.chosen = names;
    for (const [name, box] of this.#boxes) box.setAttribute("aria-pressed", String(names.includes(name)));
    this.on.choose();
  }

  /** Choose a region and its group beside the others, or no longer. @param {string} name */
  toggle(name) {
    const whole = this.#whole([name]);
    const others = this.chosen.filter((each) => !whole.includes(each));
    this.choose(this.chosen.includes(name) ? others : [...others, ...whole]);
  }

  /** Choose a region and give it the focus. @param {string} name */
  focus(name) {
    this.choose([name]);
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
    const box = el("button.region", {
      type: "button", "aria-pressed": "false",
      onfocus: () => this.chosen.includes(name) || this.choose(this.#whole([name])),
      onmousedown: (/** @type {Event} */ event) => event.preventDefault(), // a press with Shift gives no focus
    }, corner);
    box.addEventListener("pointerdown", (event) => this.#drag(event, name, event.target === corner));
    box.addEventListener("keydown", (event) => this.#key(event, name));
    return box;
  }

  /** @param {PointerEvent} event @param {string} name @param {boolean} sizes */
  #drag(event, name, sizes) {
    if (this.draws.get()) return;
    event.stopPropagation();
    const box = this.#boxes.get(name);
    if (!box || event.button) return;
    if (event.shiftKey && !sizes) {
      this.toggle(name);
      return;
    }
    if (sizes) this.choose([name]);
    else if (!this.chosen.includes(name)) this.choose(this.#whole([name]));
    box.focus();
    box.setPointerCapture(event.pointerId);
    const from = this.board.place(event);
    const starts = new Map(this.history.current.regions.map((region) => [region.name, placeOf(region)]));
    const start = starts.get(name);
    if (!start) return;
    const { x, y, width, height } = start;
    this.#is_dragging = true;
    let has_moved = false;
    const end = new AbortController();
    box.addEventListener("pointermove", (/** @type {PointerEvent} */ moved) => {
      const to = this.board.place(moved);
      const snap = (/** @type {number} */ value) => (moved.altKey ? Math.round(10 * value) / 10 : Math.round(value));
      const [dx, dy] = [to.x_mm - from.x_mm, to.y_mm - from.y_mm];
      if (sizes) {
        const size = { width_mm: Math.max(SMALLEST_MM, snap(width + dx)), height_mm: Math.max(SMALLEST_MM, snap(height + dy)) };
        this.#change(t.did.size, () => size);
        return;
      }
      const [right, down] = [snap(x + dx) - x, snap(y + dy) - y];
      has_moved ||= Math.hypot(dx, dy) * this.board.px_per_mm > 2;
      if (!has_moved) return;
      this.#change(t.did.move, (region) => {
        const at = starts.get(region.name) ?? placeOf(region);
        return { x_mm: rounded(at.x + right), y_mm: rounded(at.y + down) };
      });
    }, { signal: end.signal });
    const ends = () => {
      end.abort();
      this.#is_dragging = false;
      if (!has_moved && !sizes) this.choose(this.#whole([name]));
      this.board.show(this.history.current);
    };
    for (const kind of ["pointerup", "pointercancel"]) box.addEventListener(kind, ends, { signal: end.signal });
  }

  /** @param {KeyboardEvent} event @param {string} name */
  #key(event, name) {
    const arrow = ARROWS[event.key];
    if (!arrow) return;
    event.preventDefault();
    if (!this.chosen.length) this.choose([name]);
    const [dx, dy] = arrow;
    this.#change(event.shiftKey ? t.did.size : t.did.move, (region) => {
      const { x, y, width, height } = placeOf(region);
      if (!event.shiftKey) return { x_mm: rounded(x + dx), y_mm: rounded(y + dy) };
      return { width_mm: Math.max(SMALLEST_MM, width + dx), height_mm: Math.max(SMALLEST_MM, height + dy) };
    });
  }

  /** @param {string[]} names */
  remove(names = this.chosen) {
    this.history.change(t.did.remove(names.join(", ")), (draft) => {
      draft.regions = draft.regions.filter((region) => !names.includes(region.name));
    });
  }

  /** Give a region another name. @param {string} name @param {string} to */
  rename(name, to) {
    this.history.change(t.did.rename(name, to), (draft) => {
      const region = draft.regions.find((each) => each.name === name);
      if (region) region.name = to;
    });
  }

  /** Make the chosen regions a group, of which a click on the board chooses all. */
  group() {
    const group = freeName(t.groupName, this.#groups);
    this.#change(t.did.group, () => ({ group }), "");
  }

  /** Let the chosen regions be of no group. */
  ungroup() {
    this.history.change(t.did.ungroup, (draft) => {
      for (const region of draft.regions) if (this.chosen.includes(region.name)) delete region.group;
    });
  }

  get #groups() {
    return this.history.current.regions.flatMap(({ group }) => group ?? []);
  }

  /** Add copies of the chosen regions beside them. */
  duplicate() {
    this.#insert(this.regions, t.did.duplicate);
  }

  /** Remember the chosen regions for `paste`, here or in another page of this browser. */
  copy() {
    store(COPIED, JSON.stringify(this.regions));
  }

  /** Add copies of the regions that were copied last. */
  paste() {
    this.#insert(JSON.parse(stored(COPIED) || "[]"), t.did.paste);
  }

  /** @param {m.RegionDocument[]} regions @param {string} label */
  #insert(regions, label) {
    const all = this.history.current.regions;
    if (all.length + regions.length > MOST_REGIONS) {
      this.on.refuse(t.tooMany(MOST_REGIONS));
      return;
    }
    const names = all.map(({ name }) => name);
    /** @type {m.RegionDocument[]} */
    const copies = [];
    /** @type {Map<string, string>} groups of the copies */
    const groups = new Map();
    for (const region of regions) {
      const { group } = region;
      if (group && !groups.has(group)) groups.set(group, freeName(group, [...this.#groups, ...groups.values()]));
      const name = freeName(region.name, [...names, ...copies.map((copy) => copy.name)]);
      const { x, y } = placeOf(region);
      copies.push({ ...structuredClone(region), name, x_mm: rounded(x + COPY_MM), y_mm: rounded(y + COPY_MM), ...(group ? { group: groups.get(group) } : {}) });
    }
    this.history.change(label, (draft) => void draft.regions.push(...copies));
    this.choose(copies.map(({ name }) => name));
    this.#boxes.get(this.chosen.at(-1) ?? "")?.focus();
  }

  /** Align the chosen regions. @param {Axis} axis @param {number} share 0 begin, 0.5 middle, 1 end of all */
  align(axis, share) {
    this.#shift(t.did.align, axis, aligned(this.regions, axis, share));
  }

  /** Make the gaps between the chosen regions the same. @param {Axis} axis */
  distribute(axis) {
    this.#shift(t.did.distribute, axis, distributed(this.regions, axis));
  }

  /** @param {string} label @param {Axis} axis @param {number[]} moves_mm of the chosen ones */
  #shift(label, axis, moves_mm) {
    const { chosen } = this;
    this.#change(label, (region) => ({ [`${axis}_mm`]: rounded(placeOf(region)[axis] + moves_mm[chosen.indexOf(region.name)]) }), "");
  }

  /** Change fields of all chosen regions, in one step.
   * @param {string} label @param {(region: m.RegionDocument) => Partial<m.RegionDocument>} fieldsOf @param {string} [merge] */
  #change(label, fieldsOf, merge = `${label} ${this.chosen}`) {
    this.history.change(label, (draft) => {
      for (const region of draft.regions) if (this.chosen.includes(region.name)) Object.assign(region, fieldsOf(region));
    }, merge);
  }

  /** Draw a new region, or a frame around those to choose. @param {PointerEvent} event */
  #begin(event) {
    if (event.button) return;
    const draws = this.draws.get();
    const kept = event.shiftKey && !draws ? this.chosen : [];
    this.choose(kept);
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
      fill(this.#drawing, draws && `${drawn.width_mm} × ${drawn.height_mm} mm`);
    }, { signal: end.signal });
    const ends = () => {
      end.abort();
      this.#drawing.hidden = true;
      this.draws.set(false);
    };
    element.addEventListener("pointerup", (up) => {
      ends();
      const drawn = rectangle(up);
      if (!draws) this.choose([...kept, ...this.#whole(this.#met(drawn)).filter((name) => !kept.includes(name))]);
      else if (Math.min(drawn.width_mm, drawn.height_mm) >= DRAWN_MM) this.on.draw(drawn);
    }, { signal: end.signal });
    element.addEventListener("pointercancel", ends, { signal: end.signal });
  }

  /** Return the names of the regions that a frame meets. @param {Rectangle} frame */
  #met({ x_mm, y_mm, width_mm, height_mm }) {
    if (!width_mm && !height_mm) return []; // a click
    return this.history.current.regions.filter((region) => {
      const { left, top, width, height } = boxOfRegion(region);
      return left < x_mm + width_mm && left + width > x_mm && top < y_mm + height_mm && top + height > y_mm;
    }).map(({ name }) => name);
  }
}
