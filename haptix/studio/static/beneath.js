/** The app's own picture beneath the regions: a guide for the eye, kept by this browser and never felt. */

import { Value } from "./dom.js";
import { texts } from "./texts.js";

const KEPT = "haptix.beneath"; // one picture for the name of each layout

/** @param {string} name */
const addressOf = (name) => `/beneath/${encodeURIComponent(name)}`;

export class Beneath {
  /** @type {Value<ImageBitmap | null>} */
  picture = new Value(/** @type {ImageBitmap | null} */ (null));
  #name = "";

  /** Show what is kept for a layout. @param {string} name */
  async open(name) {
    this.#name = name;
    const found = await (await caches.open(KEPT)).match(addressOf(name));
    const picture = found ? await createImageBitmap(await found.blob()) : null;
    if (this.#name === name) this.picture.set(picture); // else another one was opened meanwhile
  }

  /** Show a picture and keep it for the layout; rejects if it is none. @param {File} file */
  async take(file) {
    const picture = await createImageBitmap(file).catch(() => {
      throw new TypeError(texts.make.noPicture(file.name));
    });
    this.picture.set(picture);
    await (await caches.open(KEPT)).put(addressOf(this.#name), new Response(file));
  }

  async remove() {
    this.picture.set(null);
    await (await caches.open(KEPT)).delete(addressOf(this.#name));
  }

  /** Keep it for the layout's new name, or for its copy too. @param {string} from @param {string} to */
  async follow(from, to, is_copy = false) {
    const kept = await caches.open(KEPT);
    const found = await kept.match(addressOf(from));
    if (!found || from === to) return;
    await kept.put(addressOf(to), found);
    if (!is_copy) await kept.delete(addressOf(from));
    await this.open(to);
  }
}
