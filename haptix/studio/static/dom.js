/** Tools of all pages: elements in one expression, and values with listeners. */

/** @typedef {Node | string | number | null | undefined | false} Child */

/**
 * Make an element. A prop that is a function listens (`onclick`); one with a dash, or `role`, `for`
 * and `list`, is an attribute; `style` is an object; all others are properties.
 * @template {keyof HTMLElementTagNameMap} K
 * @param {K | `${K}.${string}`} tag "div.card.wide"
 * @param {Record<string, any>} [props]
 * @param {...(Child | Child[])} children
 * @returns {HTMLElementTagNameMap[K]}
 */
export function el(tag, props = {}, ...children) {
  const [name, ...classes] = tag.split(".");
  const made = document.createElement(name);
  if (classes.length) made.className = classes.join(" ");
  for (const [key, value] of Object.entries(props)) {
    if (value === undefined) continue;
    if (key === "style") Object.assign(made.style, value);
    else if (key.includes("-") || ["role", "for", "list", "d"].includes(key)) {
      if (value !== false && value !== null) made.setAttribute(key, value === true ? "" : value);
    } else /** @type {any} */ (made)[key] = value;
  }
  made.append(...children.flat().filter(isShown).map(shown));
  return /** @type {any} */ (made);
}

/**
 * Replace the children of an element.
 * @param {Element} element
 * @param {...(Child | Child[])} children
 */
export function fill(element, ...children) {
  element.replaceChildren(...children.flat().filter(isShown).map(shown));
}

/** @param {Child} child @returns {child is Node | string | number} */
function isShown(child) {
  return child !== null && child !== undefined && child !== false;
}

/** @param {Node | string | number} child */
function shown(child) {
  return child instanceof Node ? child : String(child);
}

/** A value that calls its listeners when it changes. @template T */
export class Value {
  #value;
  /** @type {Set<(value: T) => void>} */
  #handlers = new Set();

  /** @param {T} value */
  constructor(value) {
    this.#value = value;
  }

  get() {
    return this.#value;
  }

  /** @param {T} value */
  set(value) {
    if (Object.is(value, this.#value)) return;
    this.#value = value;
    for (const handler of [...this.#handlers]) handler(value);
  }

  /**
   * Call a handler now and after each change; return a function that ends this.
   * @param {(value: T) => void} handler
   * @returns {() => void}
   */
  on(handler) {
    this.#handlers.add(handler);
    handler(this.#value);
    return () => void this.#handlers.delete(handler);
  }
}

/** A text with the mark of its curve's colour. @param {string} color of CSS @param {string} text */
export function keyed(color, text) {
  return [el("i.key", { "aria-hidden": "true", style: { background: color } }), text];
}

/** Names and values, for a list of facts. @param {[string, Child][]} rows */
export function facts(rows) {
  return rows.map(([name, value]) => el("div", {}, el("dt", {}, name), el("dd", {}, value)));
}

/** @param {string[]} items */
export function bullets(items) {
  return el("ul", {}, items.map((item) => el("li", {}, item)));
}

/** Let the browser save a file. @param {Blob} content @param {string} download its name */
export function save(content, download) {
  const href = URL.createObjectURL(content);
  el("a", { href, download }).click();
  setTimeout(() => URL.revokeObjectURL(href));
}

/** @param {number} ms @returns {Promise<void>} */
export function pause(ms) {
  return new Promise((resolve) => setTimeout(resolve, ms));
}

/** Return a text that this browser keeps between visits; "" where there is none.
 * @param {string} key */
export function stored(key) {
  try {
    return localStorage.getItem(key) ?? "";
  } catch {
    return "";
  }
}

/** Keep a text for the next visit, where the browser keeps any. @param {string} key @param {string} text */
export function store(key, text) {
  try {
    if (text) localStorage.setItem(key, text);
    else localStorage.removeItem(key);
  } catch {
    // the next visit begins anew
  }
}
