/**
 * A client of `haptix serve`, for pages and Node; it runs as it is and needs no package.
 *
 *     const h = await connect({name: "demo", token});
 *     await h.acquire(); await h.arm();
 *     canvas.onpointerdown = canvas.onpointermove = canvas.onpointerup = (e) => h.pointer(e);
 */

import { writeTouches } from "./batches.js";
import { Connection, http, now, URL_HERE } from "./connection.js";
import { Layout } from "./layout.js";
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
 * Return a token for this page, for the code that the terminal shows. Keep it in localStorage.
 * @param {{code: string, name: string, url?: string}} asked
 * @returns {Promise<string>}
 */
export async function pair({ code, name, url = URL_HERE }) {
  const headers = { "content-type": "application/json" };
  const body = JSON.stringify({ code, name });
  return (await (await http(url, "/v1/pair", { method: "POST", headers, body })).json()).token;
}

export { Lost, now, Refused } from "./connection.js";

/** A session with the service, made by `connect`. */
export class Session extends Connection {
  #batch = 0;
  /** @type {Record<string, number>} */
  #streams = {};
  /** @type {object | undefined} */
  #geometry;
  #pointers = new Pointers(10);
  /** @type {Set<string>} */
  #watched = new Set();
  /** What is felt where, by calls. */
  layout = new Layout((ops) => this.layoutChange(ops));

  /** The service keeps lease and layout for who resumes; these are of the session.
   * @protected @override */
  async restore() {
    this.#pointers = new Pointers(this.welcome.limits.fingers);
    if (this.#geometry) await this.ask("geometry", this.#geometry);
    if (Object.keys(this.#streams).length) await this.subscribe(this.#streams);
    for (const job of this.#watched) {
      await this.watch(job).catch(() => this.#watched.delete(job)); // another service knows none
    }
  }

  /** Ask for the lease on the output; with `takeover` also from who holds it.
   * @returns {Promise<m.Lease>} */
  acquire(takeover = false) {
    return this.ask("acquire", { takeover });
  }

  /** Give the lease back; 0 V first.
   * @returns {Promise<m.Done>} */
  release() {
    return this.ask("release");
  }

  /** Let touches be felt.
   * @returns {Promise<m.Output>} */
  arm() {
    return this.ask("arm");
  }

  /** End at 0 V and keep the lease.
   * @returns {Promise<m.Output>} */
  disarm() {
    return this.ask("disarm");
  }

  /** End at 0 V, whoever holds the output.
   * @returns {Promise<m.Done>} */
  stop() {
    return this.ask("stop");
  }

  /** Replace the layout.
   * @param {m.LayoutDocument} document
   * @returns {Promise<m.LayoutReply>} */
  layoutSet(document) {
    return this.ask("layout_set", { document });
  }

  /** Change the layout: all of `ops`, or nothing.
   * @param {m.LayoutChange["ops"]} ops
   * @returns {Promise<m.LayoutReply>} */
  layoutChange(ops) {
    return this.ask("layout_change", { ops });
  }

  /** Send a file that materials read, once; return `sha256:...`, by which a document calls it.
   * @param {Blob} file
   * @param {string} suffix what it is: ".png", ".jpg", ".wav" ...
   * @returns {Promise<string>} */
  async asset(file, suffix) {
    const hash = new Uint8Array(await crypto.subtle.digest("SHA-256", await file.arrayBuffer()));
    const digest = [...hash].map((byte) => byte.toString(16).padStart(2, "0")).join("");
    const headers = { authorization: `Bearer ${this.service.token}` };
    const path = `/v1/assets/${digest}?suffix=${encodeURIComponent(suffix)}`;
    await http(this.service.url, path, { method: "PUT", headers, body: file });
    return `sha256:${digest}`;
  }

  /** Say how pixels become millimetres: ``origin + turn(rotation) (px / px_per_mm)``.
   * @param {Omit<m.Geometry, "type" | "id">} geometry
   * @returns {Promise<m.Done>} */
  async geometry(geometry) {
    const done = await this.ask("geometry", geometry);
    this.#geometry = geometry;
    return done;
  }

  /** Play a transient effect; `effect_ended` tells its end by the same `effect_id`.
   * @param {object} effect
   * @returns {Promise<m.Playing>} */
  play(effect) {
    return this.ask("play", { effect });
  }

  /** End an effect.
   * @param {number} effect_id
   * @returns {Promise<m.Done>} */
  cancel(effect_id) {
    return this.ask("cancel", { effect_id });
  }

  /** Set the share of friction that is asked for, 0 to 1.
   * @param {number} value
   * @returns {Promise<m.Output>} */
  intensity(value) {
    return this.ask("intensity", { value });
  }

  /** Hold 0 V while time runs.
   * @param {boolean} on
   * @returns {Promise<m.Output>} */
  mute(on) {
    return this.ask("mute", { on });
  }

  /** Hold 0 V while time stands.
   * @param {boolean} on
   * @returns {Promise<m.Output>} */
  pause(on) {
    return this.ask("pause", { on });
  }

  /** Ask for streams, each with its rate [Hz]; 0 ends one. They come as `frame`.
   * @param {m.Subscribe["streams"]} streams
   * @returns {Promise<m.Subscribed>} */
  async subscribe(streams) {
    const found = await this.ask("subscribe", { streams });
    Object.assign(this.#streams, streams);
    this.columns = found.columns;
    return found;
  }

  /** Return how far a job is; `job` tells its changes until it ends.
   * @param {string} job
   * @returns {Promise<m.Job>} */
  async watch(job) {
    const found = await this.ask("watch", { job });
    this.#watched.add(job);
    return found;
  }

  /** Return devices and profiles.
   * @returns {Promise<m.Inventory>} */
  inventory() {
    return this.ask("inventory");
  }

  /**
   * Report touches in one batch of bytes; `t_s` is `now()`'s clock.
   * @param {readonly Touch[]} touches
   * @returns {boolean} whether there was a connection to send them over
   */
  touches(touches) {
    const most = this.welcome.limits.batch_touches;
    let sent = true;
    for (let at = 0; sent && at < touches.length; at += most) {
      sent = this.send(() => writeTouches(touches.slice(at, at + most), ++this.#batch));
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

  /** Take a finger off. */
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
