/** Pictures of regions: friction as brightness, drawn here until the service's own has come. */

import { el } from "./dom.js";

/** @import * as m from "../../../clients/typescript/types/messages.js" */

const PX_PER_MM = 6;
const MOST_PX = 900;
const MOST_KEPT = 200;
const COLUMNS = 320;
const LEVELS = 127.5; // (share + 0.5) * LEVELS is the byte of a place
const SETTLED_MS = 150; // a region that is drawn larger asks for one picture at its end
const VIRIDIS = [
  [68, 1, 84], [71, 45, 123], [59, 82, 139], [44, 114, 142], [33, 145, 140],
  [40, 174, 128], [94, 201, 98], [173, 220, 48], [253, 231, 37],
];

/** @type {((region: m.Region) => Promise<CanvasImageSource | null>) | null} */
let source = null;
/** @type {Map<string, CanvasImageSource>} */
const kept = new Map();
/** @type {Map<string, string>} what each region was last drawn with */
const newest = new Map();

/** Let the service draw: what a material asks for, for a finger that goes right.
 * @param {import("./service.js").Service} service */
export function picturesFrom(service) {
  source = async ({ material, width_mm, height_mm }) => {
    const asked = { material, width_mm, height_mm, columns: COLUMNS };
    return drawn(await (await service.rest("POST", "/v1/pictures", asked)).json());
  };
  kept.clear();
}

/**
 * Return a picture of a map of friction, as `POST /v1/pictures` gives it.
 * @param {{columns: number, rows: number, levels: string}} map
 */
export function drawn({ columns, rows, levels }) {
  return drawnBytes(columns, rows, bytesOf(levels));
}

/** Return the levels of a map as bytes. @param {string} levels in base64 */
export function bytesOf(levels) {
  return Uint8Array.from(atob(levels), (char) => char.charCodeAt(0));
}

/** @param {number} columns @param {number} rows @param {Uint8Array} bytes */
export function drawnBytes(columns, rows, bytes) {
  const canvas = el("canvas", { width: columns, height: rows });
  const context = /** @type {CanvasRenderingContext2D} */ (canvas.getContext("2d"));
  const image = context.createImageData(columns, rows);
  bytes.forEach((level, at) => {
    const [r, g, b] = shade(level / LEVELS - 0.5);
    image.data.set([r, g, b, 255], 4 * at);
  });
  context.putImageData(image, 0, 0);
  return canvas;
}

/** Return the colour of a share of the reachable friction: viridis, the ends held beyond.
 * @param {number} share */
export function shade(share) {
  const at = Math.min(Math.max(share, 0), 1) * (VIRIDIS.length - 1);
  const low = Math.min(Math.floor(at), VIRIDIS.length - 2);
  return VIRIDIS[low].map((value, i) => value + (VIRIDIS[low + 1][i] - value) * (at - low));
}

/**
 * Return the picture of a region. `again` is called when a better one has come.
 * @param {m.Region} region
 * @param {() => void} again
 * @returns {CanvasImageSource}
 */
export function pictureOf(region, again) {
  const { material, width_mm, height_mm, scale } = region;
  const key = JSON.stringify([material, width_mm, height_mm, scale]);
  const found = kept.get(key);
  if (found) return found;
  const first = draft(region);
  kept.set(key, first);
  for (const old of kept.keys()) {
    if (kept.size <= MOST_KEPT) break;
    kept.delete(old);
  }
  newest.set(region.name, key);
  const ask = source;
  setTimeout(async () => {
    if (!ask || newest.get(region.name) !== key) return;
    const picture = await ask(region).catch(() => null); // the draft stays
    if (!picture) return;
    kept.set(key, picture);
    again();
  }, SETTLED_MS);
  return first;
}

/** A quick picture of a material's character, not of its numbers. @param {m.Region} region */
function draft({ material, width_mm, height_mm }) {
  const [w, h] = [width_mm ?? 20, height_mm ?? 20];
  const zoom = Math.min(PX_PER_MM, MOST_PX / Math.max(w, h));
  const canvas = document.createElement("canvas");
  canvas.width = Math.max(1, Math.round(w * zoom));
  canvas.height = Math.max(1, Math.round(h * zoom));
  const context = /** @type {CanvasRenderingContext2D} */ (canvas.getContext("2d"));
  context.fillStyle = "#3d5c72";
  context.fillRect(0, 0, canvas.width, canvas.height);
  const period = Number(material.period_mm);
  if (period > 0) {
    for (let x = 0; x < canvas.width; x += 1) {
      const share = 0.5 + 0.5 * Math.sin((2 * Math.PI * x) / zoom / period);
      context.fillStyle = `rgb(255 255 255 / ${0.35 * share})`;
      context.fillRect(x, 0, 1, canvas.height);
    }
  }
  return canvas;
}
