/** Pictures of regions: friction as brightness. The page draws one until the service's picture comes. */

import { now, Refused } from "/client/haptix.js";
import { el, pause } from "./dom.js";
import { view } from "./view.js";

/** @import { Service } from "./service.js" */
/** @import { Telemetry } from "./telemetry.js" */
/** @import * as m from "../../../clients/typescript/types/messages.js" */

const PX_PER_MM = 6;
const MOST_PX = 900;
const MOST_CACHED = 200;
const COLUMNS = 320;
const LEVELS = 127.5; // (share + 0.5) * LEVELS is the byte of a place
const SETTLED_MS = 150; // a region that is being resized requests its picture at the end
const LONGEST_WAIT_MS = 20_000;
const REFUSALS = ["message", "document", "unknown"]; // codes that a retry would get again
const FILM_COLUMNS = 120;
const RATE_HZ = 24;
const SEEN_S = 11; // time over which a material is checked for motion
const AHEAD_S = 0.6; // a second's pictures are requested so long before it begins
const VIRIDIS = [
  [68, 1, 84], [71, 45, 123], [59, 82, 139], [44, 114, 142], [33, 145, 140],
  [40, 174, 128], [94, 201, 98], [173, 220, 48], [253, 231, 37],
];

/** @type {((region: m.RegionDocument) => Promise<CanvasImageSource>) | null} */
let source = null;
/** @type {Map<string, CanvasImageSource>} */
const cache = new Map();
/** @type {Map<string, string>} what each region was last drawn with */
const newest = new Map();
/** @type {Map<string, Set<() => void>>} by what is drawn: who shows a draft of it, such as the boards of two pages */
const waiting = new Map();

/** Let the service draw the friction that a material asks for under a finger that moves right.
 * @param {import("./service.js").Service} service */
export function picturesFrom(service) {
  source = async ({ material, width_mm, height_mm }) => {
    const body = { material, width_mm, height_mm, columns: COLUMNS };
    const { columns, rows, levels } = await (await service.rest("POST", "/v1/pictures", body)).json();
    return painted(columns, rows, bytesOf(levels));
  };
  cache.clear();
}

/** Return the levels of a map as bytes. @param {string} levels in base64 */
export function bytesOf(levels) {
  return Uint8Array.from(atob(levels), (char) => char.charCodeAt(0));
}

/**
 * Return a picture of a map of friction, whose places have colours by their shares.
 * @param {number} columns @param {number} rows @param {Uint8Array} bytes
 * @param {(share: number, at: number) => number[]} [colorOf] red, green, blue, alpha
 */
export function painted(columns, rows, bytes, colorOf = (share) => [...shade(share), 255]) {
  const canvas = el("canvas", { width: columns, height: rows });
  const context = /** @type {CanvasRenderingContext2D} */ (canvas.getContext("2d"));
  const image = context.createImageData(columns, rows);
  bytes.forEach((level, at) => image.data.set(colorOf(level / LEVELS - 0.5, at), 4 * at));
  context.putImageData(image, 0, 0);
  return canvas;
}

/** Return the colour of a share of the reachable friction: viridis or grey, the ends held beyond.
 * @param {number} share */
export function shade(share) {
  const held = Math.min(Math.max(share, 0), 1);
  if (view.get().is_grey) return [255 * held, 255 * held, 255 * held];
  const at = held * (VIRIDIS.length - 1);
  const low = Math.min(Math.floor(at), VIRIDIS.length - 2);
  return VIRIDIS[low].map((value, i) => value + (VIRIDIS[low + 1][i] - value) * (at - low));
}

/**
 * Return the picture of a region; `again`, the same function each time, is called when a better one has come.
 * @param {m.RegionDocument} region
 * @param {() => void} again
 * @returns {CanvasImageSource}
 */
export function pictureOf(region, again) {
  const { material, width_mm, height_mm, scale } = region;
  const key = JSON.stringify([material, width_mm, height_mm, scale, view.get().is_grey]);
  newest.set(region.name, key);
  const cached = cache.get(key);
  waiting.get(key)?.add(again);
  if (cached) return cached;
  const first = draft(region);
  cache.set(key, first);
  for (const old of cache.keys()) {
    if (cache.size <= MOST_CACHED) break;
    cache.delete(old);
  }
  waiting.set(key, new Set([again]));
  void improve(region, key).finally(() => waiting.delete(key));
  return first;
}

/**
 * Replace a draft by the service's picture. If the service is busy or restarts, retry after longer
 * and longer pauses; if it refuses, the draft stays.
 * @param {m.RegionDocument} region @param {string} key
 */
async function improve(region, key) {
  for (let wait_ms = SETTLED_MS; wait_ms < LONGEST_WAIT_MS; wait_ms *= 3) {
    await pause(wait_ms);
    if (!source || ![...newest.values()].includes(key)) return;
    try {
      cache.set(key, await source(region));
      return waiting.get(key)?.forEach((again) => again());
    } catch (error) {
      if (error instanceof Refused && REFUSALS.includes(error.code)) return;
    }
  }
}

/** Draw a rough picture of a material's character; its numbers are not exact. @param {m.RegionDocument} region */
function draft({ material, width_mm, height_mm }) {
  const [w, h] = [width_mm ?? 20, height_mm ?? 20];
  const zoom = Math.min(PX_PER_MM, MOST_PX / Math.max(w, h));
  const canvas = document.createElement("canvas");
  canvas.width = Math.max(1, Math.round(w * zoom));
  canvas.height = Math.max(1, Math.round(h * zoom));
  const context = /** @type {CanvasRenderingContext2D} */ (canvas.getContext("2d"));
  context.fillStyle = "#3d5c72";
  context.fillRect(0, 0, canvas.width, canvas.height);
  const period = "period_mm" in material ? Number(material.period_mm) : 0;
  if (period > 0) {
    const across = Math.ceil(Math.hypot(canvas.width, canvas.height));
    context.rotate(((Number("orientation_deg" in material && material.orientation_deg) || 0) * Math.PI) / 180);
    for (let x = -across; x < across; x += 1) {
      const share = 0.5 + 0.5 * Math.sin((2 * Math.PI * x) / zoom / period);
      context.fillStyle = `rgb(255 255 255 / ${0.35 * share})`;
      context.fillRect(x, -across, 1, 2 * across);
    }
  }
  return canvas;
}

/**
 * Pictures by the second; none if nothing moves.
 * @typedef {{seconds: Map<number, CanvasImageSource[]>, asked: number, stands: boolean}} Film
 */

/** Regions that move, drawn as they are at the time that is rendered now. */
export class Films {
  /** @type {Map<string, Film>} by what is drawn */
  #films = new Map();
  #drawn_ms = 0;
  #shows = false;

  /** @param {Service} service @param {Telemetry} telemetry */
  constructor(service, telemetry) {
    this.service = service;
    this.telemetry = telemetry;
  }

  /** Present time of the scene [s]; NaN if nothing is rendered. */
  get scene_s() {
    const { stats, stats_s } = this.telemetry;
    const { session } = this.service;
    const output = this.service.output.get();
    if (!session || output?.state !== "armed" || !(stats.scene_s >= 0)) return NaN;
    return output.paused ? stats.scene_s : stats.scene_s + now() - session.clientTime(stats_s);
  }

  /** Whether it is time to draw the moving regions again. @param {number} at_ms */
  isDue(at_ms) {
    if (at_ms - this.#drawn_ms < 950 / RATE_HZ) return false;
    this.#drawn_ms = at_ms;
    const due = this.#shows;
    this.#shows = false; // until a region is asked for that moves
    return due || Number.isNaN(this.#last) !== Number.isNaN(this.scene_s);
  }
  #last = NaN;

  /** Return a region's present picture; null if it stands still or is not known yet.
   * @param {m.RegionDocument} region */
  at(region) {
    const scene_s = (this.#last = this.scene_s);
    if (Number.isNaN(scene_s)) return null;
    const { material, width_mm, height_mm } = region;
    const key = JSON.stringify([material, width_mm, height_mm, view.get().is_grey]);
    let film = this.#films.get(key);
    if (!film) {
      film = { seconds: new Map(), asked: -1, stands: false };
      this.#films.set(key, film);
      if (this.#films.size > 20) this.#films.delete([...this.#films.keys()][0]);
    }
    if (film.stands) return null;
    this.#shows = true;
    const second = Math.floor(scene_s);
    const wanted = film.asked < second ? second : Math.floor(scene_s + AHEAD_S);
    if (wanted > film.asked) void this.#ask(film, region, wanted);
    for (const old of film.seconds.keys()) if (old < second) film.seconds.delete(old);
    const frames = film.seconds.get(second);
    return frames?.[Math.floor((scene_s - second) * frames.length)] ?? null;
  }

  /** @param {Film} film @param {m.RegionDocument} region @param {number} second */
  async #ask(film, region, second) {
    const is_first = film.asked < 0;
    film.asked = second;
    try {
      // Many materials that depend on time, such as a button's click, do not change their picture.
      if (is_first) {
        const seen = await this.#frames(region, second, SEEN_S / RATE_HZ);
        film.stands = seen.every((frame) => frame.bytes.every((level, at) => level === seen[0].bytes[at]));
      }
      if (film.stands) return;
      const frames = await this.#frames(region, second, 1 / RATE_HZ);
      film.seconds.set(second, frames.map(({ columns, rows, bytes }) => painted(columns, rows, bytes)));
    } catch {
      film.stands = true; // the picture of its start is still there
    }
  }

  /** @param {m.RegionDocument} region @param {number} t_s @param {number} frame_s */
  async #frames({ material, width_mm, height_mm }, t_s, frame_s) {
    const body = { material, width_mm, height_mm, columns: FILM_COLUMNS, t_s, frames: RATE_HZ, frame_s };
    const { columns, rows, levels } = await (await this.service.rest("POST", "/v1/pictures", body)).json();
    const [bytes, size] = [bytesOf(levels), columns * rows];
    return Array.from({ length: RATE_HZ }, (_, at) => ({ columns, rows, bytes: bytes.subarray(at * size, (at + 1) * size) }));
  }
}
