/** Pictures of regions: friction as brightness, drawn here until the service's own has come. */

/** @import * as m from "../../../clients/typescript/types/messages.js" */

const PX_PER_MM = 6;
const MOST_PX = 900;
const MOST_KEPT = 200;

/** @type {((region: m.Region) => Promise<CanvasImageSource | null>) | null} */
let source = null;
/** @type {Map<string, CanvasImageSource>} */
const kept = new Map();

/** Say who makes pictures from documents; without, they are plain.
 * @param {(region: m.Region) => Promise<CanvasImageSource | null>} make */
export function picturesFrom(make) {
  source = make;
  kept.clear();
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
  const drawn = draft(region);
  kept.set(key, drawn);
  for (const old of kept.keys()) {
    if (kept.size <= MOST_KEPT) break;
    kept.delete(old);
  }
  void source?.(region).then(
    (picture) => {
      if (!picture) return;
      kept.set(key, picture);
      again();
    },
    () => {}, // the draft stays
  );
  return drawn;
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
