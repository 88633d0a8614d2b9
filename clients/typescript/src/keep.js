/**
 * What a page keeps across a reload or crash: in `localStorage`, or in the entry of the history,
 * where a browser refuses storage to an iframe of another site.
 */

/**
 * Return what is kept under a key; "" where there is nothing, or no page.
 * @param {string} key
 * @returns {string}
 */
export function kept(key) {
  try {
    return localStorage.getItem(key) ?? history.state?.[key] ?? "";
  } catch {
    return globalThis.history?.state?.[key] ?? "";
  }
}

/**
 * Keep a text under a key.
 * @param {string} key
 * @param {string} text
 */
export function keep(key, text) {
  try {
    localStorage.setItem(key, text);
  } catch {
    globalThis.history?.replaceState({ ...history.state, [key]: text }, "");
  }
}

/**
 * Return the word by which the service knows a page again that crashed or was reloaded.
 * @param {string} name the client's
 * @returns {string}
 */
export function wordOf(name) {
  if (!globalThis.history) return ""; // no page
  const key = `haptix app ${name}`;
  if (!kept(key)) keep(key, crypto.getRandomValues(new Uint32Array(4)).join("-"));
  return kept(key);
}
