/**
 * A client of `haptix serve`, for pages and Node; it runs as it is and needs no package.
 *
 *     const h = await connect({name: "demo", token});
 *     await h.acquire(); await h.arm();
 *     canvas.onpointerdown = canvas.onpointermove = canvas.onpointerup = (e) => h.pointer(e);
 */

import { writeTouches } from "./batches.js";
import { Region } from "./calls.js";
import { Connection, http, now, Refused, URL_HERE } from "./connection.js";
import { keep, kept } from "./keep.js";
import { Pointers } from "./pointers.js";

/** @import * as m from "../types/messages.js" */
/** @import { Options } from "./connection.js" */
/** @typedef {m.Touch & {coalesced?: boolean}} Touch */
/**
 * @typedef {object} FeelOptions
 * @property {HTMLElement} [element] of a page: what is felt fills it, and its pointers are followed
 * @property {number} [px_per_mm] CSS pixels for a millimetre of this screen, 96 / 25.4 unless you measure it
 * @property {"none" | "vertical" | "horizontal"} [scroll] as in `follow`
 * @property {boolean} [person_asked] whether a person has asked for the voltage of a real driver, which is not
 *   armed otherwise; a virtual one always is
 */

/**
 * Open a session.
 * @param {Options} options
 * @returns {Promise<Session>}
 */
export async function connect(options) {
  const { name, url = URL_HERE, code } = options;
  const asks = async () => code !== undefined && (await pair({ code: await code(), name, url }));
  if (!options.find && !options.token && !kept(`haptix token ${url}`)) await asks();
  const session = new Session(options);
  await session.open().catch(async (error) => {
    if (!(error instanceof Refused && error.code === "access" && (await asks()))) throw error;
    await session.open(); // the token was of another service
  });
  return session;
}

/**
 * Return a token for this page, for the code that the terminal shows. It is kept for `connect`.
 * @param {{code: string, name: string, url?: string}} asked
 * @returns {Promise<string>}
 */
export async function pair({ code, name, url = URL_HERE }) {
  const headers = { "content-type": "application/json" };
  const body = JSON.stringify({ code, name });
  const { token } = await (await http(url, "/v1/pair", { method: "POST", headers, body })).json();
  keep(`haptix token ${url}`, token);
  return token;
}

/**
 * Open a session and fill an element, or the screen, with a material: a felt texture in one call. What is
 * returned has the `session`.
 * @param {object} material
 * @param {Options & FeelOptions} options
 * @returns {Promise<Region<Session>>}
 */
export async function feel(material, options) {
  const session = await connect(options);
  return session.feel(material, options).catch(async (error) => {
    await session.close();
    throw error;
  });
}

export { Lost, now, Refused } from "./connection.js";

const SLIDES_S = 0.15; // after the last report of another place
const FELT = "felt"; // name of the region that `feel` makes
const KINDS = ["pointerdown", "pointermove", "pointerup", "pointercancel", "pointerleave"];

/** A session with the service, made by `connect`. */
export class Session extends Connection {
  #batch = 0;
  #pointers = new Pointers(10);
  #has_told_dropped = false;
  #is_watching = false; // whether the page is hidden
  /** @type {Map<number, string>} where fingers are */
  #places = new Map();
  #slid_s = -Infinity;
  /** @type {{material: object, options: FeelOptions} | undefined} what `feel` shows */
  #felt;
  /** @type {m.Output | undefined} where it was felt when the connection was lost */
  #before;
  /** @type {(() => void) | undefined} */
  #unfollow;
  #isAgain = false; // whether it is felt again after a lost connection

  /** Send again what the service does not keep for who resumes. @protected @override */
  async restore() {
    this.#pointers.fingers = this.welcome.limits.fingers;
    this.#pointers.clear();
    await super.restore();
  }

  /** @override @param {string} type @param {object} [fields] */
  async ask(type, fields) {
    const answer = await super.ask(type, fields);
    if (type === "layout_set") this.#felt = undefined; // a layout of the app's own
    return answer;
  }

  /** Whether a finger slides: where none does, friction is not felt. */
  get slides() {
    return now() - this.#slid_s < SLIDES_S;
  }

  /** Points of pointers that were left out so far; the first is told as `warning`, too. */
  get dropped() {
    const { late, fingers } = this.#pointers.dropped;
    return late + fingers;
  }

  /** Send a file that materials read, once; return `sha256:...`, by which a document calls it.
   * @param {Blob} file
   * @param {string} suffix what it is: ".png", ".jpg", ".wav" ...
   * @returns {Promise<string>} */
  async asset(file, suffix) {
    const most = this.welcome.limits.asset_bytes;
    if (file.size > most) { // the service would close the connection in the midst of the file
      const sentence = `the file has ${file.size} bytes; expected at most ${most}: send a smaller file`;
      throw new Refused({ code: "limit", sentence });
    }
    const hash = new Uint8Array(await crypto.subtle.digest("SHA-256", await file.arrayBuffer()));
    const digest = [...hash].map((byte) => byte.toString(16).padStart(2, "0")).join("");
    const headers = { authorization: `Bearer ${this.service.token}` };
    const path = `/v1/assets/${digest}?suffix=${encodeURIComponent(suffix)}`;
    await http(this.service.url, path, { method: "PUT", headers, body: file });
    return `sha256:${digest}`;
  }

  /**
   * Report touches in one batch of bytes; `t_s` is `now()`'s clock. Faster than the service takes
   * them they wait, and what is asked meanwhile passes them.
   * @param {readonly Touch[]} touches
   * @returns {boolean} whether they are sent, or wait: false without a connection, or while 1000 wait
   */
  touches(touches) {
    const most = this.welcome.limits.batch_touches;
    let sent = true;
    for (const touch of touches) this.#follow(touch);
    for (let at = 0; sent && at < touches.length; at += most) {
      const some = touches.slice(at, at + most);
      const lifts = some.some(({ kind }) => kind === "up");
      sent = this.send(() => writeTouches(some, ++this.#batch), some.length, lifts);
    }
    return sent;
  }

  /**
   * Report one touch, now unless it says when.
   * @param {Omit<Touch, "t_s"> & {t_s?: number}} touch
   * @returns {boolean}
   */
  touch(touch) {
    return this.touches([{ t_s: now(), ...touch }]);
  }

  /** Take a finger off.
   * @returns {boolean} */
  lift(touch_id = 0) {
    return this.touch({ touch_id, kind: "up" });
  }

  /**
   * Report what a PointerEvent tells, coalesced points included, in CSS pixels from the corner of
   * `element`; say `geometry` first. A pointer touches while its first button is down.
   * @param {PointerEvent} event
   * @param {{element?: Element, normal_force_n?: number}} [options]
   * @returns {boolean}
   */
  pointer(event, { element, normal_force_n } = {}) {
    const target = element ?? /** @type {Element | null} */ (event.currentTarget);
    if (!target) throw new TypeError("pointer: expected an element; pass it outside of a handler");
    this.#watchPage();
    const touches = this.#pointers.touches(event, target, now(), normal_force_n);
    if (this.dropped && !this.#has_told_dropped) {
      this.#has_told_dropped = true;
      const { late } = this.#pointers.dropped;
      const why = late ? "it was told 0.4 s late, so the page is busy" : `the service takes ${this.#pointers.fingers} fingers`;
      const sentence = `a touch was left out: ${why}; from now on \`dropped\` counts such touches`;
      this.emit("warning", { type: "warning", id: 0, sentence });
    }
    return this.touches(touches);
  }

  /**
   * Report the pointers of an element, until the function that is returned is called. Without `scroll` a
   * finger on it scrolls nothing; with it, a stroke in that direction scrolls the page, and one across is felt.
   * @param {HTMLElement | SVGElement} element
   * @param {{scroll?: "none" | "vertical" | "horizontal", normal_force_n?: number}} [options]
   * @returns {() => void}
   */
  follow(element, { scroll = "none", normal_force_n } = {}) {
    const ends = new AbortController();
    for (const kind of KINDS) {
      const reports = (/** @type {Event} */ event) => this.pointer(/** @type {PointerEvent} */ (event), { element, normal_force_n });
      element.addEventListener(kind, reports, { signal: ends.signal });
    }
    const before = element.style.touchAction;
    element.style.touchAction = { none: "none", vertical: "pan-y pinch-zoom", horizontal: "pan-x pinch-zoom" }[scroll];
    return () => {
      ends.abort();
      element.style.touchAction = before;
      this.#lift();
    };
  }

  /**
   * Fill an element, or the screen, with a material and arm: all that it takes to feel one. What was felt
   * before is replaced. After a lost connection it is felt again, where it was felt until then: the layout as it
   * was changed since, or on a service that was begun anew this material, with intensity, mute and pause as they
   * were. A virtual driver is armed by itself; after `stop`, `release` or a layout of the app's own nothing is.
   * @param {object} material
   * @param {FeelOptions} [options]
   * @returns {Promise<Region<Session>>}
   */
  async feel(material, options = {}) {
    const { element, scroll, person_asked = false } = options;
    await this.#show(material, options);
    this.#unfollow?.();
    this.#unfollow = element && this.follow(element, { scroll });
    if (!this.#isAgain) {
      this.#isAgain = true;
      this.on("lost", () => {
        const was_felt = this.#felt && this.lease.is_mine && this.output.state !== "off";
        this.#before = was_felt ? this.output : undefined;
      });
      this.on("resumed", () => void this.#feelAgain().catch((error) => console.warn(error)));
    }
    if (person_asked) await this.arm();
    else await this.#armVirtual();
    return new Region(this, FELT);
  }

  /** @param {object} material @param {FeelOptions} options */
  async #show(material, options) {
    const { element, px_per_mm = 96 / 25.4 } = options;
    const [width_mm, height_mm] = element
      ? [element.offsetWidth / px_per_mm, element.offsetHeight / px_per_mm]
      : this.welcome.inventory.screen_mm;
    if (element) await this.geometry({ px_per_mm });
    await this.acquire();
    const place = { x_mm: 0, y_mm: 0, width_mm, height_mm };
    await this.layoutSet({ regions: [{ name: FELT, material: /** @type {any} */ (material), ...place }] });
    this.#felt = { material, options };
  }

  async #armVirtual() {
    if (!this.welcome.inventory.devices.some((device) => device.is_real)) await this.arm();
    else console.warn("the driver is real: call `arm` once a person asks for its voltage");
  }

  /** Arm again what was felt before the connection was lost. */
  async #feelAgain() {
    const { intensity, muted, paused } = this.#before ?? {};
    if (!this.#felt || intensity === undefined) return;
    if (!this.lease.is_mine) { // a service that was begun anew: it has no layout
      await this.#show(this.#felt.material, this.#felt.options);
      await this.intensity(intensity);
      await this.mute(muted);
      await this.pause(paused);
    }
    await this.#armVirtual();
  }

  /** @param {Touch} touch */
  #follow({ touch_id = 0, kind, t_s, x_px, y_px, x_mm, y_mm }) {
    if (kind === "up") return void this.#places.delete(touch_id);
    const place = `${x_px ?? x_mm} ${y_px ?? y_mm}`;
    const before = this.#places.get(touch_id);
    if (kind !== "down" && before !== undefined && before !== place) this.#slid_s = t_s;
    this.#places.set(touch_id, place);
  }

  /** A hidden page hears of no finger any more. */
  #watchPage() {
    if (this.#is_watching) return;
    this.#is_watching = true;
    globalThis.document?.addEventListener("visibilitychange", () => document.hidden && this.#lift());
  }

  #lift() {
    const lifts = this.#pointers.lifts(now());
    if (lifts.length) this.touches(lifts);
  }
}
