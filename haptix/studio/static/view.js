/** A person's choices for the pages: kept in this browser, and no part of a document. */

import { store, stored, Value } from "./dom.js";

const KEY = "haptix.view";

export const CHOICES = {
  /** @type {"system" | "light" | "dark"} */
  theme: "system",
  /** Where the normal force comes from. @type {"pressure" | "slider" | "assumed"} */
  force: "slider",
  force_n: 0.5,
  /** Normal force at full pressure of a pen [N]. */
  pressure_n: 1.0,
  /** Whether friction is drawn in grey, as friction maps have it. */
  is_grey: false,
  is_audible: false,
  /** Level of the sound [dB of full scale]. */
  volume_db: -30,
};

/** @typedef {typeof CHOICES} Choices */

/** @type {Value<Choices>} */
export const view = new Value({ ...CHOICES, ...read() });

/** Change some choices, and keep them.
 * @param {Partial<Choices>} changes */
export function choose(changes) {
  view.set({ ...view.get(), ...changes });
  store(KEY, JSON.stringify(view.get()));
}

/** @returns {Partial<Choices>} */
function read() {
  try {
    const kept = JSON.parse(stored(KEY) || "{}");
    const is_known = (/** @type {[string, unknown]} */ [key, value]) =>
      typeof value === typeof CHOICES[/** @type {keyof Choices} */ (key)];
    return Object.fromEntries(Object.entries(kept).filter(is_known));
  } catch {
    return {};
  }
}
