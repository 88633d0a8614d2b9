/**
 * A client of `haptix serve`, for pages and Node; it runs as it is and needs no package.
 *
 *     const h = await connect({name: "demo", token});
 *     await h.acquire(); await h.arm();
 *     canvas.onpointerdown = canvas.onpointermove = canvas.onpointerup = (e) => h.pointer(e);
 */

import { writeTouches } from "./batches.js";
import { Connection, http, now, Refused, URL_HERE } from "./connection.js";
import { keep } from "./keep.js";
import { Pointers } from "./pointers.js";

/** @import * as m from "../types/messages.js" */
/** @import { Options } from "./connection.js" */
/** @typedef {m.Touch & {coalesced?: boolean}} Touch */

/**
 * Open a session.
 * @param {Options} options
 * @returns {Promise<Session>}
 */
export async function connect(options) {
  const session = new Session(options);
  await session.open();
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

export { Lost, now, Refused } from "./connection.js";

/** A session with the service, made by `connect`. */
export class Session extends Connection {
  #batch = 0;
  #pointers = new Pointers(10);

  /** Send again what the service does not keep for who resumes. @protected @override */
  async restore() {
    this.#pointers = new Pointers(this.welcome.limits.fingers);
    await super.restore();
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
   * `element`; say `geometry` first. A pointer touches while a button is down.
   * @param {PointerEvent} event
   * @param {{element?: Element, normal_force_n?: number}} [options]
   * @returns {boolean}
   */
  pointer(event, { element, normal_force_n } = {}) {
    const target = element ?? /** @type {Element | null} */ (event.currentTarget);
    if (!target) throw new TypeError("pointer: expected an element; pass it outside of a handler");
    return this.touches(this.#pointers.touches(event, target, now(), normal_force_n));
  }
}
