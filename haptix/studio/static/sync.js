/** The document on the service: what is edited is felt. */

import { difference } from "./history.js";
import { sentence } from "./service.js";

/** @import { Session } from "/client/haptix.js" */
/** @import { Service } from "./service.js" */
/** @import { History } from "./history.js" */
/** @import * as m from "../../../clients/typescript/types/messages.js" */

const GLIDE_S = 0.02;
const PLACES = ["x_mm", "y_mm", "rotation_deg"];

/**
 * Send the document at the begin of each session, and what changes in it.
 * @param {Service} service
 * @param {History<m.LayoutDocument>} history
 */
export function synchronise(service, history) {
  /** @type {m.LayoutDocument | null} what the service has */
  let known = null;
  let is_sending = false;

  async function send() {
    const { session } = service;
    if (is_sending || !session || !known) return;
    is_sending = true;
    try {
      for (let wanted = history.current; known && known !== wanted; wanted = history.current) {
        const ops = changes(known, wanted);
        if (ops === null) await session.layoutSet(wanted);
        else if (ops.length) await session.layoutChange(ops);
        if (known) known = wanted;
      }
    } catch (error) {
      service.notify("error", sentence(error));
    } finally {
      is_sending = false;
    }
  }

  service.onBegin.push(async (session) => {
    known = null;
    const wanted = history.current;
    await session.layoutSet(wanted);
    known = wanted;
    void send();
  });
  history.document.on(() => void send());
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
