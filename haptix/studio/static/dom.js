/** Elements in one expression. */

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
 * Replace what an element holds.
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
