/** Regions that move, drawn as they are at the time that is rendered now. */

import { now } from "/client/haptix.js";
import { bytesOf, drawnBytes } from "./pictures.js";

/** @import { Service } from "./service.js" */
/** @import { Telemetry } from "./telemetry.js" */
/** @import * as m from "../../../clients/typescript/types/messages.js" */
/**
 * Pictures of a second, by the second; none where nothing was seen to move.
 * @typedef {{seconds: Map<number, CanvasImageSource[]>, asked: number, stands: boolean}} Film
 */

const RATE_HZ = 24;
const COLUMNS = 120;
const SEEN_S = 11; // over which a material is looked at for whether it moves
const AHEAD_S = 0.6; // a second is asked for so long before it begins

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

  /** Time of the scene now [s]; NaN where nothing is rendered. */
  get scene_s() {
    const { stats, stats_s } = this.telemetry;
    const { session } = this.service;
    const output = this.service.output.get();
    if (!session || output?.state !== "armed" || !(stats.scene_s >= 0)) return NaN;
    return output.paused ? stats.scene_s : stats.scene_s + now() - session.clientTime(stats_s);
  }

  /** Whether it is time to draw what moves anew. @param {number} at_ms */
  isDue(at_ms) {
    if (at_ms - this.#drawn_ms < 950 / RATE_HZ) return false;
    this.#drawn_ms = at_ms;
    const due = this.#shows;
    this.#shows = false; // until a region is asked for that moves
    return due || Number.isNaN(this.#last) !== Number.isNaN(this.scene_s);
  }
  #last = NaN;

  /** Return a region's picture of now; null where it stands still, or is not known yet.
   * @param {m.Region} region */
  at(region) {
    const scene_s = (this.#last = this.scene_s);
    if (Number.isNaN(scene_s)) return null;
    const { material, width_mm, height_mm } = region;
    const key = JSON.stringify([material, width_mm, height_mm]);
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

  /** @param {Film} film @param {m.Region} region @param {number} second */
  async #ask(film, region, second) {
    const is_first = film.asked < 0;
    film.asked = second;
    try {
      // Much that asks for the time, such as a button's click, stands still for all that is seen.
      if (is_first) {
        const seen = await this.#frames(region, second, SEEN_S / RATE_HZ);
        film.stands = seen.every((frame) => frame.bytes.every((level, at) => level === seen[0].bytes[at]));
      }
      if (film.stands) return;
      const frames = await this.#frames(region, second, 1 / RATE_HZ);
      film.seconds.set(second, frames.map(({ columns, rows, bytes }) => drawnBytes(columns, rows, bytes)));
    } catch {
      film.stands = true; // the picture of its start is still there
    }
  }

  /** @param {m.Region} region @param {number} t_s @param {number} frame_s */
  async #frames({ material, width_mm, height_mm }, t_s, frame_s) {
    const asked = { material, width_mm, height_mm, columns: COLUMNS, t_s, frames: RATE_HZ, frame_s };
    const { columns, rows, levels } = await (await this.service.rest("POST", "/v1/pictures", asked)).json();
    const [bytes, size] = [bytesOf(levels), columns * rows];
    return Array.from({ length: RATE_HZ }, (_, at) => ({ columns, rows, bytes: bytes.subarray(at * size, (at + 1) * size) }));
  }
}
