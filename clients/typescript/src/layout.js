/** The layout of a session by calls, for code that writes no documents. */

/** @import * as m from "../types/messages.js" */
/** @typedef {(ops: m.LayoutChange["ops"]) => Promise<m.LayoutReply>} Change */
/** @typedef {Omit<m.AddRegion, "op" | "name" | "material">} Place */

/** A region of the layout, by its name; each call is one change. */
export class Region {
  #change;

  /** @param {Change} change @param {string} name for `contact.region` */
  constructor(change, name) {
    this.#change = change;
    this.name = name;
  }

  /** Move it there within `over_s`; what is left out stays.
   * @param {Omit<m.MoveRegion, "op" | "name">} place */
  move(place) {
    return this.#change([{ op: "move", name: this.name, ...place }]);
  }

  /** Change what is given, in a cross-fade.
   * @param {Place & {material?: Record<string, any>}} fields */
  change(fields) {
    return this.#change([{ op: "change", name: this.name, ...fields }]);
  }

  /** Set the value of a control, such as a slider, 0 to 1.
   * @param {number} value */
  setValue(value) {
    return this.#change([{ op: "value", name: this.name, value }]);
  }

  /** Remove it; it fades out. */
  remove() {
    return this.#change([{ op: "remove", name: this.name }]);
  }
}

/** What is felt where; the service keeps it for who connects again. */
export class Layout {
  #change;
  #count = 0;

  /** @param {Change} change */
  constructor(change) {
    this.#change = change;
  }

  /**
   * Add a region and return it. Millimetres from the screen's corner; without a size it is as large
   * as its material. The name is made where none is given.
   * @param {Record<string, any>} material its document
   * @param {Place & {name?: string}} [place]
   * @returns {Promise<Region>}
   */
  async add(material, { name, ...place } = {}) {
    this.#count += 1;
    const region = new Region(this.#change, name ?? `region ${this.#count}`);
    await this.#change([{ op: "add", name: region.name, material, ...place }]);
    return region;
  }
}
