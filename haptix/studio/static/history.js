/** The document that is edited, with undo and redo by inverse patches. */

import { Value } from "./value.js";

/** @typedef {{path: (string | number)[], value?: unknown}} Patch without value: the key goes */
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

  /** What undo would take back, and redo do again; "" for nothing. */
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

  /** Take the last step back; whether there was one. */
  undo() {
    const step = this.#done.pop();
    if (!step) return false;
    this.#undone.push({ ...step, merge: "" });
    this.document.set(patched(this.current, step.back));
    return true;
  }

  /** Do again what was taken back. */
  redo() {
    const step = this.#undone.pop();
    if (!step) return false;
    this.#done.push(step);
    this.document.set(patched(this.current, step.forth));
    return true;
  }

  /** Begin with another document; nothing can be taken back.
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
