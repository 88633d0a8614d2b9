/** How large a page is on the glass. No browser knows: a person measures something on it once, with a ruler.
 *
 * `screen.width` does not help: Chromium gives the same number however a person has zoomed the page. */

const KEY = "haptix.glass";
const [LEAST_MM, MOST_MM] = [20, 3000];

/** @typedef {{sides_px: number[], px_per_mm: number}} Glass sides of the screen, and its own pixels in a millimetre */

/** @type {Glass[]} */
let known = read();

/** Return the pixels of this page in a millimetre of the glass; 0 until a person has measured it on this screen. */
export function pxPerMm() {
  return (known.find(isHere)?.px_per_mm ?? 0) / zoom();
}

/**
 * Keep, in this browser, how wide something of the page is on the glass.
 * @param {number} width_px in CSS pixels
 * @param {number} width_mm 20 to 3000; with any other number the size is unknown again
 */
export function measured(width_px, width_mm) {
  known = known.filter((glass) => !isHere(glass));
  if (width_px > 0 && width_mm >= LEAST_MM && width_mm <= MOST_MM) {
    known.push({ sides_px: sides(), px_per_mm: (width_px * zoom()) / width_mm });
  }
  try {
    localStorage.setItem(KEY, JSON.stringify(known));
  } catch {
    // this page alone knows it
  }
}

function zoom() {
  return devicePixelRatio * (globalThis.visualViewport?.scale ?? 1);
}

/** Sides of the screen, the shorter one first: a person may turn it. */
function sides() {
  return [screen.width, screen.height].sort((one, other) => one - other);
}

/** @param {Glass} glass */
function isHere({ sides_px }) {
  return String(sides_px) === String(sides());
}

/** @returns {Glass[]} */
function read() {
  try {
    const kept = JSON.parse(localStorage.getItem(KEY) || "[]");
    return kept.filter((/** @type {Glass} */ { sides_px, px_per_mm }) => Array.isArray(sides_px) && px_per_mm > 0);
  } catch {
    return [];
  }
}
