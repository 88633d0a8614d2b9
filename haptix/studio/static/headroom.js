/** Stripes over the board where a layout asks for friction that the screen cannot give. */

import { placeOf } from "./board.js";
import { el, Value } from "./dom.js";
import { bytesOf, painted } from "./pictures.js";
import { texts } from "./texts.js";

/** @import { Board } from "./board.js" */
/** @import { Service } from "./service.js" */
/** @import * as m from "../../../clients/typescript/types/messages.js" */
/** @typedef {{columns: number, rows: number, levels: string, below: number, above: number}} Map_ */

const COLUMNS = 160;
const WITHIN = 0.01;
const BELOW = [0, 114, 178], ABOVE = [213, 94, 0]; // of Okabe and Ito
const SETTLED_MS = 200;
const t = texts.make;

export class Headroom {
  is_shown = false;
  /** @type {Value<string>} in a sentence */
  summary = new Value("");
  #layer = el("div.headroom", { hidden: true, "aria-hidden": "true" });
  /** @type {Map<m.RegionDocument, HTMLCanvasElement>} */
  #drawn = new Map();
  #timer = 0;
  #number = 0;

  /** @param {Board} board @param {Service} service */
  constructor(board, service) {
    this.board = board;
    this.service = service;
    board.element.append(this.#layer);
  }

  /** Switch the stripes on or off; return whether they are on. */
  toggle() {
    this.is_shown = !this.is_shown;
    this.#layer.hidden = !this.is_shown;
    this.show(this.board.document);
    return this.is_shown;
  }

  /** @param {m.LayoutDocument} document */
  show(document) {
    clearTimeout(this.#timer);
    if (this.is_shown) this.#timer = setTimeout(() => void this.#draw(document), SETTLED_MS);
  }

  /** Put the maps where their regions are on the board. */
  place() {
    for (const [region, canvas] of this.#drawn) Object.assign(canvas.style, this.board.styleOf(region));
  }

  /** @param {m.LayoutDocument} document */
  async #draw(document) {
    const number = ++this.#number;
    /** @type {Map<m.RegionDocument, HTMLCanvasElement>} */
    const drawn = new Map();
    const parts = [];
    for (const region of document.regions) {
      const { width, height } = placeOf(region);
      const body = { material: region.material, width_mm: width, height_mm: height, columns: COLUMNS };
      try {
        const map = await (await this.service.rest("POST", "/v1/pictures", body)).json();
        drawn.set(region, mask(map));
        if (map.below + map.above > WITHIN / 2) parts.push(t.outside(region.name, map.below, map.above));
      } catch {
        parts.push(t.unknown(region.name));
      }
      if (number !== this.#number) return;
    }
    this.#drawn = drawn;
    this.#layer.replaceChildren(...drawn.values());
    this.place();
    this.summary.set(parts.length ? parts.join(" ") : t.allWithin);
  }
}

/** Return stripes where a map is out of reach. @param {Map_} map */
function mask({ columns, rows, levels }) {
  return painted(columns, rows, bytesOf(levels), (share, at) => {
    const color = share < -WITHIN ? BELOW : share > 1 + WITHIN ? ABOVE : null;
    const [x, y] = [at % columns, Math.floor(at / columns)];
    return color ? [...color, (x + y) % 4 < 2 ? 255 : 150] : [255, 255, 255, 60];
  });
}
