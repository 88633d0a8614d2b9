/** The edited layout: undo and redo, its copy on the service, which is felt, and its file. */

import { Refused } from "/client/haptix.js";
import { PLACE } from "./board.js";
import { pause, Value } from "./dom.js";
import { sentence } from "./service.js";

/** @import { Session } from "/client/haptix.js" */
/** @import { Service } from "./service.js" */
/** @import * as m from "../../../clients/typescript/types/messages.js" */

/** @type {import("../../../clients/typescript/types/messages.js").LayoutDocument} */
export const START = {
  regions: [
    {
      name: "Ribs", x_mm: 0, y_mm: 0, width_mm: 56, height_mm: 34,
      material: { kind: "grating", period_mm: 2 },
    },
    {
      name: "Sand", x_mm: 60, y_mm: 0, width_mm: 56, height_mm: 34,
      material: { kind: "noise" },
    },
    {
      name: "Slider", x_mm: 0, y_mm: 40, width_mm: 80, height_mm: 16,
      material: { kind: "slider", travel_mm: 80, detents: 9 },
    },
    {
      name: "Button", x_mm: 92, y_mm: 40, width_mm: 24, height_mm: 16,
      material: { kind: "button", width_mm: 24, height_mm: 16 },
    },
  ],
};

/** @typedef {{path: (string | number)[], value?: unknown}} Patch without a value, the key is removed */
/** @typedef {{label: string, merge: string, at_ms: number, back: Patch[], forth: Patch[]}} Step */

const MOST_STEPS = 200;
const MERGE_MS = 1000; // a drag is one step

/** @template T */
export class History {
  /** @type {Step[]} */
  #done = [];
  /** @type {Step[]} */
  #undone = [];
  /** @type {Value<T>} the document; never change it in place */
  document;

  /** @param {T} document */
  constructor(document) {
    this.document = new Value(document);
  }

  /** @returns {T} */
  get current() {
    return this.document.get();
  }

  /** Labels of the steps that undo and redo would change; "" for none. */
  get next() {
    return { undo: this.#done.at(-1)?.label ?? "", redo: this.#undone.at(-1)?.label ?? "" };
  }

  /**
   * Change a copy of the document. Steps of the same `merge` that follow each other become one.
   * @param {string} label what undo says
   * @param {(draft: T) => void} recipe
   * @param {string} [merge]
   */
  change(label, recipe, merge = "") {
    const before = this.current;
    const after = structuredClone(before);
    recipe(after);
    const forth = difference(before, after);
    if (!forth.length) return;
    const back = difference(after, before);
    const last = this.#done.at(-1);
    const at_ms = performance.now();
    if (last && merge && last.merge === merge && at_ms - last.at_ms < MERGE_MS) {
      last.back = [...back, ...last.back];
      last.forth = [...last.forth, ...forth];
      last.at_ms = at_ms;
    } else {
      this.#done.push({ label, merge, at_ms, back, forth });
      if (this.#done.length > MOST_STEPS) this.#done.shift();
    }
    this.#undone = [];
    this.document.set(after);
  }

  /** Undo the last step; return whether there was one. */
  undo() {
    const step = this.#done.pop();
    if (!step) return false;
    this.#undone.push({ ...step, merge: "" });
    this.document.set(patched(this.current, step.back));
    return true;
  }

  /** Redo the step that was undone. */
  redo() {
    const step = this.#undone.pop();
    if (!step) return false;
    this.#done.push(step);
    this.document.set(patched(this.current, step.forth));
    return true;
  }

  /** Begin with another document; no step can be undone.
   * @param {T} document */
  open(document) {
    this.#done = [];
    this.#undone = [];
    this.document.set(document);
  }
}

/**
 * Return the patches that make `after` from `before`. Arrays of other length are replaced whole.
 * @param {any} before
 * @param {any} after
 * @param {(string | number)[]} [path]
 * @returns {Patch[]}
 */
export function difference(before, after, path = []) {
  if (Object.is(before, after)) return [];
  const are_objects = isObject(before) && isObject(after);
  const are_arrays = Array.isArray(before) && Array.isArray(after);
  if (!are_objects && !(are_arrays && before.length === after.length)) {
    return [{ path, value: after }];
  }
  const keys = are_arrays
    ? before.map((_, index) => index)
    : [...new Set([...Object.keys(before), ...Object.keys(after)])];
  return keys.flatMap((key) => {
    const here = [...path, key];
    if (are_objects && !(key in after)) return [{ path: here }];
    return difference(before[key], after[key], here);
  });
}

/**
 * Return a document with patches, in their order.
 * @template T
 * @param {T} document
 * @param {Patch[]} patches
 * @returns {T}
 */
export function patched(document, patches) {
  /** @type {any} */
  let whole = structuredClone(document);
  for (const { path, ...rest } of patches) {
    const value = structuredClone(rest.value);
    if (!path.length) {
      whole = value;
      continue;
    }
    const last = /** @type {string | number} */ (path.at(-1));
    const parent = path.slice(0, -1).reduce((part, key) => part[key], whole);
    if ("value" in rest) parent[last] = value;
    else delete parent[last];
  }
  return whole;
}

/** @param {unknown} part */
function isObject(part) {
  return typeof part === "object" && part !== null && !Array.isArray(part);
}

const GLIDE_S = 0.02;
const [ATTEMPTS, RETRY_MS] = [10, 500];
const PLACES = Object.keys(PLACE);

/** This page's layout on the service: the document, or for a while another layout. */
export class Layout {
  /** @type {m.LayoutDocument | null} what the service has */
  #known = null;
  /** @type {m.LayoutDocument | null} */
  #override = null;
  #is_sending = false;

  /** @param {Service} service @param {History<m.LayoutDocument>} history */
  constructor(service, history) {
    this.service = service;
    this.history = history;
    service.onBegin.push(async (session) => {
      this.#known = null;
      const wanted = this.#override ?? history.current;
      await setAt(session, wanted);
      this.#known = wanted;
      void this.#send();
    });
    history.document.on(() => void this.#send());
  }

  /** Replace the document on the service by another layout, until `restore`. @param {m.LayoutDocument} document */
  async override(document) {
    this.#override = document;
    await this.#send();
  }

  /** Put the document on the service again. */
  async restore() {
    this.#override = null;
    await this.#send();
  }

  async #send() {
    if (this.#is_sending) return;
    this.#is_sending = true;
    try {
      for (;;) {
        const { session } = this.service;
        const wanted = this.#override ?? this.history.current;
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
      await pause(RETRY_MS);
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
  const remaining = before.regions.filter((region) => names.has(region.name));
  // Regions of the same z lie in the order in which they were added.
  const in_order = after.regions.every((region, at) => at >= remaining.length || region.name === remaining[at].name);
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
    const patches = difference(was, region).filter(({ path: [key] }) => key !== "group"); // it is not felt
    if (patches.some((patch) => !("value" in patch) && patch.path.length === 1)) return null;
    const changed = [...new Set(patches.map(({ path }) => String(path[0])))];
    if (!changed.length) continue;
    const fields = Object.fromEntries(changed.map((key) => [key, /** @type {any} */ (region)[key]]));
    const moves = changed.every((key) => PLACES.includes(key));
    ops.push({ op: moves ? "move" : "change", name: region.name, ...fields, ...(moves ? { over_s: GLIDE_S } : {}) });
  }
  return ops;
}
