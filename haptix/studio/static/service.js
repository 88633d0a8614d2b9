/** The session with the service: pairing, the lease, the output, and REST. */

import { connect, pair, Refused } from "/client/haptix.js";
import { pause, store, stored, Value } from "./dom.js";
import { texts } from "./texts.js";

/** @import { Frame } from "/client/batches.js" */
/** @import { Session } from "/client/haptix.js" */
/** @import * as m from "../../../clients/typescript/types/messages.js" */
/**
 * @typedef {object} State
 * @property {"pair" | "connecting" | "open" | "lost"} phase
 * @property {string} reason the cause in a sentence, or ""
 */
/** @typedef {{label: string, act: () => void}} Help */
/** @typedef {{at: number, kind: "error" | "warning" | "note", sentence: string, help?: Help}} Notice */

const KEY = "haptix.token";
const URL_HERE = `${location.origin.replace(/^http/, "ws")}/v1/session`;
const RETRY_MS = 1000;
const ATTEMPTS = 4;
const MOST_NOTICES = 20;

export class Service {
  /** @type {Value<State>} */
  state = new Value(/** @type {State} */ ({ phase: "connecting", reason: "" }));
  /** @type {Value<m.Output | null>} state of the output */
  output = new Value(/** @type {m.Output | null} */ (null));
  /** @type {Value<m.Lease | null>} who holds it */
  lease = new Value(/** @type {m.Lease | null} */ (null));
  /** @type {Value<m.Inventory | null>} devices, finger, screen, kinds */
  inventory = new Value(/** @type {m.Inventory | null} */ (null));
  /** @type {Value<Notice[]>} messages for the person, the newest last */
  notices = new Value(/** @type {Notice[]} */ ([]));
  /** @type {Session | null} */
  session = null;
  /** @type {Value<boolean>} whether the engine prepares to play, which takes seconds */
  isArming = new Value(false);
  /** Called when a session begins and when it begins again, before anything is armed.
   * @type {((session: Session) => Promise<void>)[]} */
  onBegin = [];
  /** @type {Set<(frame: Frame & {names: string[]}) => void>} */
  #frames = new Set();
  /** @type {Set<(contact: m.Contact) => void>} */
  #contacts = new Set();
  /** @type {Record<string, number>} */
  #streams = {};
  #token = stored(KEY);

  /** Whether a person stands before a real driver, and must arm it by hand. */
  get isReal() {
    return this.inventory.get()?.devices.some((device) => device.is_real) ?? true;
  }

  /** Connect, with the code of the address if there is one. */
  async start() {
    const code = new URLSearchParams(location.hash.slice(1)).get("code");
    if (code) {
      window.history.replaceState(null, "", location.pathname);
      try {
        await this.#pair(code);
      } catch (error) {
        // A page that is opened again has a used code in its address, and knows its token.
        if (!this.#token) return this.state.set({ phase: "pair", reason: sentence(error) });
      }
    }
    await this.#open();
  }

  /** Pair by the code that the terminal shows; rejects with the reason.
   * @param {string} code */
  async pair(code) {
    await this.#pair(code);
    await this.#open();
  }

  /** Make the terminal show a code. */
  async showCode() {
    const answer = await fetch("/v1/pair/code", { method: "POST" });
    if (!answer.ok) throw new Refused(await answer.json());
  }

  /** Get the lease and arm the output.
   * @param {boolean} [takeover] */
  async arm(takeover = false) {
    const { session } = this;
    if (!session) return;
    this.isArming.set(true);
    try {
      await session.acquire(takeover);
      this.output.set(await session.arm());
    } finally {
      this.isArming.set(false);
    }
  }

  /** Learn the finger by its current, or no longer; an armed output is armed anew.
   * @param {boolean} on */
  async sense(on) {
    if (!this.session) return;
    await this.session.acquire(false);
    this.output.set(await this.session.sense(on));
    if (this.output.get()?.state === "armed") {
      await this.disarm();
      await this.arm();
    }
  }

  /** End at 0 V; the lease stays. */
  async disarm() {
    await this.session?.stop();
  }

  /** End at 0 V for all clients; this works without a session, too. */
  async stop() {
    await fetch("/stop", { method: "POST", keepalive: true });
  }

  /** Do something that may be refused; show the reason if it is.
   * @template T
   * @param {() => Promise<T>} act
   * @param {Help} [help] shown with the notice
   * @returns {Promise<T | undefined>} */
  async attempt(act, help) {
    try {
      return await act();
    } catch (error) {
      this.notify("error", sentence(error), help);
      return undefined;
    }
  }

  /** @param {Notice["kind"]} kind @param {string} text @param {Help} [help] */
  notify(kind, text, help) {
    const notice = { at: Date.now(), kind, sentence: text, help };
    this.notices.set([...this.notices.get(), notice].slice(-MOST_NOTICES));
  }

  /**
   * Ask by REST; rejects with `Refused`. `body` that is no Blob or string is sent as JSON.
   * @param {string} method
   * @param {string} path
   * @param {any} [body]
   * @param {Record<string, string>} [headers]
   * @param {RequestInit} [options]
   * @returns {Promise<Response>}
   */
  async rest(method, path, body, headers = {}, options = {}) {
    /** @type {Record<string, string>} */
    const sent = { authorization: `Bearer ${this.#token}`, ...headers };
    let content = body;
    if (body !== undefined && !(body instanceof Blob) && typeof body !== "string") {
      content = JSON.stringify(body);
      sent["content-type"] ??= "application/json";
    }
    const answer = await fetch(path, { ...options, method, headers: sent, body: content });
    if (!answer.ok) {
      const refusal = await answer.json().catch(() => ({}));
      const { code = "internal", sentence: why = `${method} ${path}: ${answer.status}` } = refusal;
      throw new Refused({ code, sentence: why, path: refusal.path });
    }
    return answer;
  }

  /**
   * Subscribe to streams while a page shows them; return a function that ends this. Streams that this
   * service does not have are left out.
   * @param {Record<string, number>} rates [Hz]
   * @param {(frame: Frame & {names: string[]}) => void} handler
   * @returns {() => void}
   */
  listen(rates, handler) {
    this.#frames.add(handler);
    Object.assign(this.#streams, rates);
    void this.#subscribe(rates);
    return () => {
      this.#frames.delete(handler);
      const none = Object.fromEntries(Object.keys(rates).map((name) => [name, 0]));
      for (const name of Object.keys(rates)) delete this.#streams[name];
      void this.#subscribe(none);
    };
  }

  /** Listen to contacts: enter, leave, press, release, detent.
   * @param {(contact: m.Contact) => void} handler
   * @returns {() => void} */
  onContact(handler) {
    this.#contacts.add(handler);
    return () => void this.#contacts.delete(handler);
  }

  /** @param {string} code */
  async #pair(code) {
    this.#token = await pair({ code, name: "studio", url: URL_HERE });
    store(KEY, this.#token);
  }

  async #open() {
    if (!this.#token) return this.state.set({ phase: "pair", reason: "" });
    this.state.set({ phase: "connecting", reason: "" });
    try {
      const session = await connect({ name: "studio", token: this.#token, url: URL_HERE });
      this.session = session;
      session.on("output", (output) => {
        this.output.set(output);
        if (output.state === "failed") this.#failed(output.reason);
      });
      session.on("lease", (lease) => this.lease.set(lease));
      session.on("inventory", (inventory) => this.inventory.set(inventory));
      session.on("warning", (warning) => this.notify("warning", warning.sentence));
      session.on("error", ({ code, sentence: why }) => {
        if (code === "clock") this.notify("warning", texts.frame.late); // touches of a busy page
        else this.notify("error", why);
      });
      session.on("frame", (frame) => this.#frames.forEach((handler) => handler(frame)));
      session.on("contact", (contact) => this.#contacts.forEach((handler) => handler(contact)));
      session.on("lost", ({ reason }) => this.#lost(reason));
      session.on("resumed", () => void this.#begin(session));
      session.on("closed", ({ reason }) => {
        this.session = null;
        this.#refused(reason);
      });
      await this.#begin(session);
    } catch (error) {
      if (error instanceof Refused) return this.#refused(error.message);
      this.#lost(sentence(error));
      setTimeout(() => void this.#open(), RETRY_MS);
    }
  }

  /** @param {Session} session */
  async #begin(session) {
    const { output, lease, inventory } = session.welcome;
    this.inventory.set(inventory);
    this.lease.set(lease);
    this.output.set(output);
    await this.#subscribe(this.#streams);
    for (const begin of this.onBegin) await this.attempt(() => begin(session));
    this.state.set({ phase: "open", reason: "" });
    // A person must arm a real driver by hand, here and after each loss.
    const is_free = lease.holder === null || lease.is_mine;
    if (!this.isReal && is_free) await this.#armVirtual();
  }

  /** A busy machine may need some attempts, since the first one loads the renderer. The lease of an app is taken by a
   * person's click only, also while it is kept for one that is gone. */
  async #armVirtual() {
    for (let left = ATTEMPTS; left > 0; left -= 1) {
      try {
        return await this.arm();
      } catch (error) {
        if (error instanceof Refused && error.code === "lease") return this.notify("note", texts.frame.keptForOther);
        if (left === 1 || !this.session) return this.notify("error", sentence(error));
        await pause(RETRY_MS);
      }
    }
  }

  /** @param {string} reason */
  #failed(reason) {
    if (!this.isReal) this.notify("warning", reason); // a real driver's fault is shown until it is repaired
    // With a virtual finger there is no danger, so no person has to arm again on a busy machine.
    const arm = () => this.output.get()?.state === "failed" && this.#armVirtual();
    if (!this.isReal && this.lease.get()?.is_mine) setTimeout(arm, RETRY_MS);
  }

  /** @param {string} reason */
  #lost(reason) {
    this.output.set(null);
    this.lease.set(null);
    this.state.set({ phase: "lost", reason });
  }

  /** @param {string} reason */
  #refused(reason) {
    this.#token = "";
    store(KEY, "");
    this.output.set(null);
    this.state.set({ phase: "pair", reason });
  }

  /** @param {Record<string, number>} streams */
  async #subscribe(streams) {
    for (const [name, rate] of Object.entries(streams)) {
      const stream = /** @type {any} */ ({ [name]: rate });
      // An older service has fewer streams; their displays stay empty.
      await this.session?.subscribe(stream).catch(() => {});
    }
  }
}

/** Return the sentence of an error, for people. @param {unknown} error */
export function sentence(error) {
  if (error instanceof Refused && error.path) return error.message.replace(` (${error.path})`, "");
  return error instanceof Error ? error.message : String(error);
}
