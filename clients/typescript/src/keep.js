/**
 * What a page keeps across a reload or crash: in `localStorage` or, where a browser refuses that to an
 * iframe of another site, in a cookie that only this page within that site sees.
 */

const YEAR_S = 31_536_000;
/** @type {Map<string, string>} what this page has kept, should the browser keep nothing */
const here = new Map();

/**
 * Return what is kept under a key; "" where there is nothing, or no page.
 * @param {string} key
 * @returns {string}
 */
export function kept(key) {
  const known = here.get(key);
  if (known !== undefined) return known;
  try {
    return localStorage.getItem(key) ?? "";
  } catch {
    const begin = `${encodeURIComponent(key)}=`;
    const found = globalThis.document?.cookie.split("; ").find((each) => each.startsWith(begin));
    return decodeURIComponent(found?.slice(begin.length) ?? "");
  }
}

/**
 * Keep a text under a key.
 * @param {string} key
 * @param {string} text
 */
export function keep(key, text) {
  here.set(key, text);
  try {
    localStorage.setItem(key, text);
  } catch {
    if (!globalThis.document) return;
    const pair = `${encodeURIComponent(key)}=${encodeURIComponent(text)}`;
    document.cookie = `${pair}; Secure; SameSite=None; Partitioned; Path=/; Max-Age=${YEAR_S}`;
  }
}

/**
 * Return the word by which the service knows a page again that crashed or was reloaded.
 * @param {string} name the client's
 * @returns {string}
 */
export function wordOf(name) {
  if (!globalThis.document) return ""; // no page
  const key = `haptix app ${name}`;
  if (!kept(key)) keep(key, crypto.getRandomValues(new Uint32Array(4)).join("-"));
  return kept(key);
}
