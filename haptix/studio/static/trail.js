/** The finger's trail on the board: drawn at once, and coloured by the error when that is known. */

import { el } from "./dom.js";
import { texts } from "./texts.js";

/** @import { Board } from "./board.js" */
/** @import { Cursor } from "./touching.js" */
/** @import { Track } from "./telemetry.js" */

const WIDTH_PX = 5;
const EDGE = "#fff";
const FRESH = "#8a949e";
/** Colours of Okabe and Ito that stand apart on light and dark, by the size of the error [JND]. */
export const SCALE = [
  { below: 0.25, color: "#009e73" },
  { below: 0.5, color: "#56b4e9" },
  { below: 1, color: "#e69f00" },
  { below: Infinity, color: "#d55e00" },
];
export const UNREACHABLE = "#cc79a7";

/** Name of a step of the scale. @param {number} index */
export function nameOf(index) {
  const last = index === SCALE.length - 1;
  return last ? texts.play.above(SCALE[index - 1].below) : texts.play.below(SCALE[index].below);
}

export class Trail {
  /** @type {{from: {x: number, y: number}, to: {x: number, y: number}}[]} */
  #fresh = [];
  /** @type {{track: Track, from: number, to: number}[]} */
  #felt = [];
  /** @type {Map<number, {x: number, y: number}>} */
  #last = new Map();
  #clears = false;
  /** @type {HTMLElement[]} */
  #cursors = [];

  /** @param {Board} board */
  constructor(board) {
    this.board = board;
  }

  /** @param {{touch_id: number, kind: string, x_mm: number, y_mm: number}} point */
  add({ touch_id, kind, x_mm, y_mm }) {
    const to = { x: x_mm, y: y_mm };
    const from = this.#last.get(touch_id);
    if (kind === "down" && !this.#last.size) this.#clears = true;
    if (from && kind === "move") this.#fresh.push({ from, to });
    if (kind === "up") this.#last.delete(touch_id);
    else this.#last.set(touch_id, to);
  }

  /** @param {Track} track @param {number} from @param {number} to */
  addFelt(track, from, to) {
    this.#felt.push({ track, from: Math.max(from - 1, track.first), to });
  }

  /** Draw the points that have come since the last frame. @param {Iterable<Cursor>} cursors */
  draw(cursors) {
    const { trail, px_per_mm } = this.board;
    const px = 1 / px_per_mm;
    if (this.#clears) this.board.clear(trail);
    this.#clears = false;
    trail.lineCap = "round";
    if (this.#fresh.length) {
      trail.beginPath();
      for (const { from, to } of this.#fresh) {
        trail.moveTo(from.x, from.y);
        trail.lineTo(to.x, to.y);
      }
      trail.lineWidth = WIDTH_PX * px;
      trail.strokeStyle = FRESH;
      trail.stroke();
      // An edge below the trail, so that every colour stands out from every picture.
      trail.globalCompositeOperation = "destination-over";
      trail.lineWidth = (WIDTH_PX + 5) * px;
      trail.strokeStyle = EDGE;
      trail.stroke();
      trail.globalCompositeOperation = "source-over";
      this.#fresh = [];
    }
    trail.lineWidth = WIDTH_PX * px;
    for (const part of this.#felt) this.#drawFelt(part);
    this.#felt = [];
    this.#point([...cursors]);
  }

  /** Show the fingers. Only their elements move, so that no frame draws the board again.
   * @param {Cursor[]} cursors */
  #point(cursors) {
    const { box, element, px_per_mm } = this.board;
    while (this.#cursors.length < cursors.length) {
      const cursor = el("i.cursor", { "aria-hidden": "true" });
      this.#cursors.push(cursor);
      element.append(cursor);
    }
    this.#cursors.forEach((cursor, at) => {
      const here = cursors[at];
      cursor.hidden = !here;
      if (!here) return;
      const [x, y] = [(here.x_mm - box.left) * px_per_mm, (here.y_mm - box.top) * px_per_mm];
      cursor.style.transform = `translate(${x}px, ${y}px)`;
    });
  }

  /** One path for each run of the same colour. @param {{track: Track, from: number, to: number}} part */
  #drawFelt({ track, from, to }) {
    const { trail } = this.board;
    let color = "";
    trail.save();
    trail.globalAlpha = 1;
    for (let row = from + 1; row < to; row += 1) {
      const next = colorOf(track, row);
      if (!next || track.at("t", row) - track.at("t", row - 1) > 0.02) {
        if (color) trail.stroke();
        color = "";
        continue;
      }
      if (next !== color) {
        if (color) trail.stroke();
        color = next;
        trail.strokeStyle = color;
        trail.beginPath();
        trail.moveTo(track.at("x_mm", row - 1), track.at("y_mm", row - 1));
      }
      trail.lineTo(track.at("x_mm", row), track.at("y_mm", row));
    }
    if (color) trail.stroke();
    trail.restore();
  }
}

/** @param {Track} track @param {number} row */
function colorOf(track, row) {
  const error = Math.abs(track.error(row));
  if (Number.isNaN(error)) return "";
  if (!track.isReachable(row)) return UNREACHABLE;
  return /** @type {{color: string}} */ (SCALE.find(({ below }) => error < below)).color;
}
