/** The document on the service: what is edited is felt. */

import { Refused } from "/client/haptix.js";
import { PLACE } from "./board.js";
import { difference } from "./history.js";
import { sentence } from "./service.js";

/** @import { Session } from "/client/haptix.js" */
/** @import { Service } from "./service.js" */
/** @import { History } from "./history.js" */
/** @import * as m from "../../../clients/typescript/types/messages.js" */

const GLIDE_S = 0.02;
const [ATTEMPTS, AGAIN_MS] = [10, 500];
const PLACES = Object.keys(PLACE);

/** The layout that the service has of this page: the document, or for a while another one. */
export class Layout {
  /** @type {m.LayoutDocument | null} what the service has */
  #known = null;
  /** @type {m.LayoutDocument | null} */
  #held = null;
  #is_sending = false;

  /** @param {Service} service @param {History<m.LayoutDocument>} history */
  constructor(service, history) {
    this.service = service;
    this.history = history;
    service.onBegin.push(async (session) => {
      this.#known = null;
      const wanted = this.#held ?? history.current;
      await setAt(session, wanted);
      this.#known = wanted;
      void this.#send();
    });
    history.document.on(() => void this.#send());
  }

  /** Let another layout be felt than the document. @param {m.LayoutDocument} document */
  async hold(document) {
    this.#held = document;
    await this.#send();
  }

  /** Let the document be felt again. */
  async release() {
    this.#held = null;
    await this.#send();
  }

  async #send() {
    if (this.#is_sending) return;
    this.#is_sending = true;
    try {
      for (;;) {
        const { session } = this.service;
        const wanted = this.#held ?? this.history.current;
        if (!session || !this.#known || this.#known === wanted) break;
        const ops = changes(this.#known, wanted);
        if (ops === null) await session.layoutSet(wanted);
        else if (ops.length) await session.layoutChange(ops);
        if (this.#known) this.#known = wanted;
      }
    } catch (error) {
      this.service.notify("error", sentence(error));
    } finally {
      this.#is_sending = false;
    }
  }
}

/** Set a layout, also where an engine that starts on a busy machine answers late.
 * @param {Session} session @param {m.LayoutDocument} document */
async function setAt(session, document) {
  for (let left = ATTEMPTS; ; left -= 1) {
    try {
      return await session.layoutSet(document);
    } catch (error) {
      if (!left || !(error instanceof Refused) || error.code !== "device") throw error;
      await new Promise((resolve) => setTimeout(resolve, AGAIN_MS));
    }
  }
}

/**
 * Return the operations from one document to another; null where it must be set anew.
 * @param {m.LayoutDocument} before
 * @param {m.LayoutDocument} after
 * @returns {m.LayoutChange["ops"] | null}
 */
export function changes(before, after) {
  const old = new Map(before.regions.map((region) => [region.name, region]));
  const names = new Set(after.regions.map((region) => region.name));
  const kept = before.regions.filter((region) => names.has(region.name));
  // Regions lie in the order in which they came, where they have the same z.
  const in_order = after.regions.every((region, at) => at >= kept.length || region.name === kept[at].name);
  if (!in_order) return null;
  /** @type {any[]} */
  const ops = [];
  for (const { name } of before.regions) if (!names.has(name)) ops.push({ op: "remove", name });
  for (const region of after.regions) {
    const was = old.get(region.name);
    if (!was) {
      ops.push({ op: "add", ...region });
      continue;
    }
    const patches = difference(was, region);
    if (patches.some((patch) => !("value" in patch) && patch.path.length === 1)) return null;
    const changed = [...new Set(patches.map(({ path }) => String(path[0])))];
    if (!changed.length) continue;
    const fields = Object.fromEntries(changed.map((key) => [key, /** @type {any} */ (region)[key]]));
    const moves = changed.every((key) => PLACES.includes(key));
    ops.push({ op: moves ? "move" : "change", name: region.name, ...fields, ...(moves ? { over_s: GLIDE_S } : {}) });
  }
  return ops;
}
