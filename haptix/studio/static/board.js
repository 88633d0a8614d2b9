/** The screen's plane in millimetres: regions, the trail of the finger, and where it is. */

import { el, Value } from "./dom.js";
import { pictureOf } from "./pictures.js";
import { texts } from "./texts.js";

/** @import * as m from "../../../clients/typescript/types/messages.js" */
/** @typedef {{left: number, top: number, width: number, height: number}} Box [mm] */

const MARGIN_MM = 4;
const SMALLEST_MM = [80, 50];
const LABEL_PX = 13;
const [BENEATH_MM, OVER_BENEATH] = [120, 0.6]; // width where the screen's is not known; opacity
const GRID_MM = [1, 2, 5, 10, 20, 50, 100, 200]; // the finest whose lines are not too close
const CLOSEST_PX = 24;
const [ZOOM_STEP, LEAST_ZOOM, MOST_ZOOM] = [1.5, 0.25, 16];
const ZOOM_A_PX = 0.002; // of a turned wheel

/** Return the box of all regions, in millimetres. @param {m.LayoutDocument} document @returns {Box} */
export function boxOf({ regions }) {
  const boxes = regions.map(boxOfRegion);
  const left = Math.min(0, ...boxes.map((box) => box.left)) - MARGIN_MM;
  const top = Math.min(0, ...boxes.map((box) => box.top)) - MARGIN_MM;
  const right = Math.max(SMALLEST_MM[0], ...boxes.map((box) => box.left + box.width));
  const bottom = Math.max(SMALLEST_MM[1], ...boxes.map((box) => box.top + box.height));
  return { left, top, width: right + MARGIN_MM - left, height: bottom + MARGIN_MM - top };
}

/** Return the box that a region lies in, turned or not. @param {m.RegionDocument} region @returns {Box} */
export function boxOfRegion(region) {
  const { x, y, width, height, turn } = placeOf(region);
  const [c, s] = [Math.abs(Math.cos(turn)), Math.abs(Math.sin(turn))];
  const [w, h] = [width * c + height * s, width * s + height * c];
  return { left: x + width / 2 - w / 2, top: y + height / 2 - h / 2, width: w, height: h };
}

/** Default place of a region. */
export const PLACE = { x_mm: 0, y_mm: 0, rotation_deg: 0 };

/** @param {m.RegionDocument} region */
export function placeOf(region) {
  const turn = ((region.rotation_deg ?? 0) * Math.PI) / 180;
  return {
    x: region.x_mm ?? 0, y: region.y_mm ?? 0, turn,
    width: region.width_mm ?? 20, height: region.height_mm ?? 20,
  };
}

export class Board {
  /** Pixels of the page for a millimetre. */
  px_per_mm = 4;
  /** Pixels of the page for a millimetre of the glass, where that is known: the board is to scale then. */
  real_px_per_mm = () => 0;
  /** @type {Box} */
  box = { left: 0, top: 0, width: 100, height: 60 };
  /** @type {m.LayoutDocument} */
  document = { regions: [] };
  /** Pictures of regions that move, where they are shown moving.
   * @type {(region: m.RegionDocument) => CanvasImageSource | null} */
  moving = () => null;
  /** A picture as wide as the screen beneath the regions, which are translucent then.
   * @type {ImageBitmap | null} */
  beneath = null;
  /** Called when the place of the plane on the page has changed. */
  onFit = () => {};
  /** Scale of what a person zoomed to, of the one at which all regions fit. */
  zoom = new Value(1);
  /** Size of the screen, whose corner is the plane's origin; null if it is not known.
   * @type {readonly number[] | null} */
  screen_mm = null;
  /** @type {{x_mm: number, y_mm: number, px_per_mm: number} | null} middle and scale that a person chose */
  #view = null;

  #picture = el("canvas", { "aria-hidden": "true" });
  #trail = el("canvas", { "aria-hidden": "true" });
  #again = () => this.draw();
  #observer = new ResizeObserver(() => this.fit());

  /** @param {Record<string, any>} props of the element */
  constructor(props) {
    this.element = el("div.board", props, this.#picture, this.#trail);
    this.#observer.observe(this.element);
    this.trail = /** @type {CanvasRenderingContext2D} */ (this.#trail.getContext("2d"));
    this.element.addEventListener("wheel", (event) => {
      if (event.ctrlKey || event.metaKey) this.zoomBy(Math.exp(-ZOOM_A_PX * event.deltaY), event);
      else if (this.#view) this.pan(-event.deltaX, -event.deltaY);
      else return; // the page scrolls
      event.preventDefault();
    }, { passive: false });
    // The first listener: with the middle button nobody touches and chooses.
    this.element.addEventListener("pointerdown", (event) => {
      if (event.button !== 1) return;
      event.stopImmediatePropagation();
      event.preventDefault();
      const end = new AbortController();
      addEventListener("pointermove", ({ movementX, movementY }) => this.pan(movementX, movementY), { signal: end.signal });
      for (const kind of ["pointerup", "pointercancel"]) addEventListener(kind, () => end.abort(), { signal: end.signal });
    }, { capture: true });
  }

  /** Zoom about a place of the page, or about the middle. @param {number} by @param {{clientX: number, clientY: number}} [at] */
  zoomBy(by, at) {
    const now = this.zoom.get();
    const ratio = Math.min(Math.max(now * by, LEAST_ZOOM), MOST_ZOOM) / now;
    const middle = this.#middle;
    const { x_mm, y_mm } = at ? this.place(at) : middle;
    const share = 1 - 1 / ratio; // the place stays where it is
    this.#view = {
      x_mm: middle.x_mm + share * (x_mm - middle.x_mm), y_mm: middle.y_mm + share * (y_mm - middle.y_mm),
      px_per_mm: this.px_per_mm * ratio,
    };
    this.fit();
  }

  /** Move what is shown. @param {number} right_px @param {number} down_px */
  pan(right_px, down_px) {
    const { px_per_mm } = this;
    const { x_mm, y_mm } = this.#middle;
    this.#view = { x_mm: x_mm - right_px / px_per_mm, y_mm: y_mm - down_px / px_per_mm, px_per_mm };
    this.fit();
  }

  get #middle() {
    return this.placeAt(this.element.clientWidth / 2, this.element.clientHeight / 2);
  }

  /** Show all regions again. */
  showAll() {
    this.#view = null;
    this.fit();
  }

  /** Return the buttons that zoom. */
  tools() {
    const t = texts.zoom;
    const button = (/** @type {string} */ text, /** @type {string} */ name, /** @type {() => void} */ onclick) =>
      el("button.small", { type: "button", "aria-label": name, title: name, onclick }, text);
    const all = button("", t.all, () => this.showAll());
    this.zoom.on((zoom) => {
      all.textContent = `${Math.round(100 * zoom)} %`;
      all.setAttribute("aria-label", `${all.textContent}: ${t.all}`); // a person may say what stands there
    });
    return el("span.zoom", { role: "group", "aria-label": t.title },
      button("−", t.out, () => this.zoomBy(1 / ZOOM_STEP)), all, button("+", t.in, () => this.zoomBy(ZOOM_STEP)));
  }

  /** Show a layout. @param {m.LayoutDocument} document */
  show(document) {
    this.document = document;
    this.fit();
  }

  close() {
    this.#observer.disconnect();
  }

  /** Return the style of an element that lies over a region. @param {m.RegionDocument} region */
  styleOf(region) {
    const { x, y, width, height, turn } = placeOf(region);
    const [left, top, wide, high] = [x - this.box.left, y - this.box.top, width, height].map((mm) => `${mm * this.px_per_mm}px`);
    return { left, top, width: wide, height: high, transform: `rotate(${turn}rad)` };
  }

  /** Fit the board into the free space of the page: to scale, where that is known and has room; or as a person zoomed. */
  fit() {
    const { clientWidth: width, clientHeight: height } = this.element;
    if (!width || !height) return;
    const box = boxOf(this.document);
    if (this.beneath) {
      const [wide, high] = this.#beneath_mm;
      box.width = Math.max(box.width, wide + MARGIN_MM - box.left);
      box.height = Math.max(box.height, high + MARGIN_MM - box.top);
    }
    const fits = Math.min(width / box.width, height / box.height);
    const whole_px = Math.min(fits, this.real_px_per_mm() || fits);
    const whole = { x_mm: box.left + box.width / 2, y_mm: box.top + box.height / 2, px_per_mm: whole_px };
    const { x_mm, y_mm, px_per_mm } = this.#view ?? whole;
    this.zoom.set(px_per_mm / whole_px);
    box.left = x_mm - width / px_per_mm / 2;
    box.top = y_mm - height / px_per_mm / 2;
    const ratio = devicePixelRatio;
    for (const canvas of [this.#picture, this.#trail]) {
      canvas.width = Math.round(width * ratio);
      canvas.height = Math.round(height * ratio);
      const context = /** @type {CanvasRenderingContext2D} */ (canvas.getContext("2d"));
      const scale = px_per_mm * ratio;
      context.setTransform(scale, 0, 0, scale, -box.left * scale, -box.top * scale);
    }
    Object.assign(this, { box, px_per_mm });
    this.draw();
    this.onFit();
  }

  /** Size of the picture beneath. */
  get #beneath_mm() {
    const wide = this.screen_mm?.[0] ?? BENEATH_MM;
    return [wide, this.beneath ? (wide * this.beneath.height) / this.beneath.width : 0];
  }

  /** Return the place of a pointer on the plane [mm]. @param {{clientX: number, clientY: number}} event */
  place(event) {
    const { left, top } = this.element.getBoundingClientRect();
    return this.placeAt(event.clientX - left, event.clientY - top);
  }

  /** Return a place on the plane [mm]. @param {number} x_px @param {number} y_px from the board's corner */
  placeAt(x_px, y_px) {
    return { x_mm: this.box.left + x_px / this.px_per_mm, y_mm: this.box.top + y_px / this.px_per_mm };
  }

  /** Clear a picture or the trail. @param {CanvasRenderingContext2D} context */
  clear(context) {
    const { canvas } = context;
    context.save();
    context.resetTransform();
    context.clearRect(0, 0, canvas.width, canvas.height);
    context.restore();
  }

  draw() {
    const context = /** @type {CanvasRenderingContext2D} */ (this.#picture.getContext("2d"));
    const style = getComputedStyle(this.element);
    const [grid, ink] = [style.getPropertyValue("--grid"), style.getPropertyValue("--ink")];
    this.clear(context);
    if (this.beneath) {
      const [wide, high] = this.#beneath_mm;
      context.drawImage(this.beneath, 0, 0, wide, high);
    }
    this.#drawGrid(context, grid, style.getPropertyValue("--quiet"));
    const px = 1 / this.px_per_mm;
    if (this.screen_mm) {
      const [wide, high] = this.screen_mm;
      context.lineWidth = 2 * px;
      context.setLineDash([8 * px, 4 * px]);
      context.strokeStyle = style.getPropertyValue("--quiet");
      context.strokeRect(0, 0, wide, high);
      context.setLineDash([]);
    }
    const in_order = [...this.document.regions].sort((a, b) => (a.z ?? 0) - (b.z ?? 0));
    for (const region of in_order) {
      const { x, y, width, height, turn } = placeOf(region);
      context.save();
      context.translate(x + width / 2, y + height / 2);
      context.rotate(turn);
      context.translate(-width / 2, -height / 2);
      context.beginPath();
      if (region.shape === "ellipse") {
        context.ellipse(width / 2, height / 2, width / 2, height / 2, 0, 0, 2 * Math.PI);
      } else if (Array.isArray(region.shape)) {
        region.shape.forEach(([px_mm, py_mm]) => context.lineTo(px_mm, py_mm));
        context.closePath();
      } else context.roundRect(0, 0, width, height, 1);
      context.save();
      context.clip();
      const picture = this.moving(region) ?? pictureOf(region, this.#again);
      context.globalAlpha = (region.opacity ?? 1) * (this.beneath ? OVER_BENEATH : 1);
      context.imageSmoothingEnabled = true;
      context.drawImage(picture, 0, 0, width, height);
      context.restore();
      context.lineWidth = px;
      context.strokeStyle = grid;
      context.stroke();
      // The name, readable on any picture.
      context.font = `600 ${LABEL_PX * px}px system-ui, sans-serif`;
      const wide = context.measureText(region.name).width;
      context.globalAlpha = 0.86;
      context.fillStyle = style.getPropertyValue("--sheet");
      context.beginPath();
      context.roundRect(5 * px, 5 * px, wide + 12 * px, (LABEL_PX + 8) * px, 4 * px);
      context.fill();
      context.globalAlpha = 1;
      context.fillStyle = ink;
      context.fillText(region.name, 11 * px, (LABEL_PX + 8) * px);
      context.restore();
    }
  }

  /** @param {CanvasRenderingContext2D} context @param {string} grid @param {string} ink */
  #drawGrid(context, grid, ink) {
    const { clientWidth, clientHeight } = this.element;
    const px = 1 / this.px_per_mm;
    const [right, bottom] = [this.box.left + clientWidth * px, this.box.top + clientHeight * px];
    context.lineWidth = px;
    context.strokeStyle = grid;
    context.globalAlpha = 0.55;
    context.beginPath();
    const step = GRID_MM.find((mm) => mm * this.px_per_mm >= CLOSEST_PX) ?? 500;
    const from = (/** @type {number} */ start) => Math.ceil(start / step) * step;
    for (let x = from(this.box.left); x < right; x += step) {
      context.moveTo(x, this.box.top);
      context.lineTo(x, bottom);
    }
    for (let y = from(this.box.top); y < bottom; y += step) {
      context.moveTo(this.box.left, y);
      context.lineTo(right, y);
    }
    context.stroke();
    context.globalAlpha = 1;
    context.fillStyle = ink;
    context.font = `${11 * px}px system-ui, sans-serif`;
    context.textAlign = "center";
    for (let x = from(this.box.left + 8 * px); x < right - 44 * px; x += step) {
      context.fillText(x === 0 ? "0" : `${x}`, x, bottom - 5 * px);
    }
    context.textAlign = "right";
    context.fillText("mm", right - 6 * px, bottom - 5 * px);
    context.textAlign = "left";
  }
}
