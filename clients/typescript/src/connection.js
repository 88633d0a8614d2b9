/** The connection of a session: hello, pings, answers by id, events, and connecting again. */

import { readFrame } from "./batches.js";
import { Calls } from "./calls.js";
import { kept, wordOf } from "./keep.js";
import { askPermission, obstacle } from "./local-network.js";

/** @import * as m from "../types/messages.js" */
/** @import { Frame } from "./batches.js" */
/** @typedef {{code: number, reason: string}} Ended */
/**
 * Events of `on`: the service's messages by their type, `frame` with the names of its columns,
 * `lost` when the connection broke and is tried again, `resumed` when it is there again and
 * disarmed, `closed` when nothing more comes.
 * @typedef {{[M in m.ServerMessage as M["type"]]: M}
 *   & {frame: Frame & {names: string[]}, lost: Ended, resumed: m.Welcome, closed: Ended}} Events
 */
/**
 * @typedef {object} Options
 * @property {string} name the client's name, shown in the list of sessions
 * @property {string} [url] where the service is
 * @property {string} [token] the access token; a page has kept that of `pair`
 * @property {() => string | Promise<string>} [code] asks a person for the code that the terminal shows, where
 *   this page is not paired
 * @property {(name: string) => Promise<{url?: string, token: string, app?: string, stop?: string}>} [find]
 *   gives both at each attempt, the app's word, by which it has its lease back after a crash, and STOP's own
 *   address: `find` of node.js
 * @property {new (url: string, protocol: string) => any} [WebSocket] where the runtime has none
 */

const PROTOCOL = "1.0";
const SUBPROTOCOL = "haptix.v1";
export const URL_HERE = "ws://127.0.0.1:7421/v1/session";
const WAIT_S = 25; // the service refuses what takes it more than 20 s
const [CLOSE_S, STOP_S] = [1, 1];
const [FIRST_S, LAST_S] = [0.1, 5]; // between two attempts to connect again
const MOST_REFUSALS = 4; // of the token: a service that begins opens its port before it writes the new one
const CLOSED = "this client is closed; connect again";
const OFFSETS = 64;
const [MOST_AT_ONCE, MOST_WAITING] = [64, 1000]; // batches of touches

/** The service refused a message; `code` and `path` say what and where. */
export class Refused extends Error {
  /** @param {{code: string, sentence: string, path?: string}} error */
  constructor({ code, sentence, path = "" }) {
    super(path ? `${sentence} (${path})` : sentence);
    this.name = "Refused";
    this.code = code;
    this.path = path;
  }
}

/** The connection is gone, or no answer came. */
export class Lost extends Error {
  name = "Lost";
}

/**
 * Ask the service of a session by HTTP; both may lie behind a path of a proxy.
 * @param {string} url @param {string} path @param {RequestInit} request
 */
export async function http(url, path, request) {
  const { origin, pathname } = new URL(url.replace(/^ws/, "http"));
  const behind = pathname.replace(/(\/v1\/session)?\/?$/, "");
  const answer = await fetch(new URL(`${origin}${behind}${path}`), request).catch(async () => {
    throw new Lost(await obstacle(url));
  });
  if (!answer.ok) throw new Refused(await answer.json());
  return answer;
}

/** Return the time of the clock that stamps touches and events of a page [s]. */
export function now() {
  return performance.now() / 1e3;
}

/** A rate limiter: `rate` items a second, and up to `most` at once. */
class Limiter {
  /** @param {number} rate @param {number} most */
  constructor(rate, most) {
    this.rate = rate;
    this.most = this.free = most;
    this.at_s = now();
  }

  /** Take some, and return how long to wait before the next [s].
   * @param {number} count */
  take(count) {
    const at_s = now();
    this.free = Math.min(this.most, this.free + (at_s - this.at_s) * this.rate) - count;
    this.at_s = at_s;
    return Math.max(0, -this.free / this.rate);
  }
}

/** What `Session` sends its messages over. */
export class Connection extends Calls {
  /** @type {m.Welcome} what the service said at first: limits, devices, profiles */
  welcome = /** @type {any} */ (undefined);
  /** @type {m.Lease} who holds the output, by the last message */
  lease = /** @type {any} */ (undefined);
  /** @type {m.Output} what the output does, by the last message */
  output = /** @type {any} */ (undefined);

  /** where the service is; @protected */
  service = { url: "", token: "" };
  #options;
  /** @type {any} */
  #socket;
  /** @type {string | undefined} where STOP has a path that no other client can crowd */
  #stop;
  #is_opening = false;
  #is_closing = false;
  #id = 0;
  #last_message_s = 0;
  /** @type {ReturnType<typeof setInterval> | undefined} */
  #watch;
  /** @type {Map<number, {resolve: (m: any) => void, reject: (e: Error) => void}>} */
  #pending = new Map();
  /** @type {Map<string, Set<(event: any) => void>>} */
  #handlers = new Map();
  /** @type {Record<string, string[]>} names of the columns of each stream; @protected */
  columns = {};
  /** @type {Map<string, m.Contact>} the last of each finger and region */
  #on = new Map();
  /** @type {number[]} */
  #offsets = [];
  /** @type {{geometry?: object, subscribe?: {streams: object}}} what the service does not keep */
  #replayed = {};
  /** @type {Set<string>} jobs */
  #watched = new Set();
  /** @type {{bytes: ArrayBuffer, count: number}[]} batches of touches */
  #waiting = [];
  /** @type {ReturnType<typeof setTimeout> | undefined} until the next may be sent */
  #later;
  /** @type {Limiter[]} */
  #limiters = [];

  /** @param {Options} options */
  constructor(options) {
    super();
    this.#options = options;
  }

  /** Connect and say hello; `connect` has done it. */
  async open() {
    this.#is_opening = true;
    try {
      const { name } = this.#options;
      const found = (await this.#options.find?.(name)) ?? { ...this.#options, app: wordOf(name) };
      const { url = URL_HERE, app = "" } = found;
      this.#stop = "stop" in found ? found.stop : undefined;
      const token = found.token ?? kept(`haptix token ${url}`);
      this.service = { url, token };
      if (this.#is_closing) throw new Lost("closed");
      const Socket = this.#options.WebSocket ?? globalThis.WebSocket;
      if (!Socket) {
        throw new TypeError("this runtime has no WebSocket: pass that of the package ws, as connect({WebSocket})");
      }
      await askPermission(url);
      const socket = new Socket(url, SUBPROTOCOL);
      this.#socket = socket;
      socket.binaryType = "arraybuffer";
      await new Promise((resolve, reject) => {
        socket.onopen = resolve;
        socket.onerror = () => {}; // onclose follows
        socket.onclose = async () => reject(new Lost(await obstacle(url)));
      });
      socket.onmessage = (/** @type {MessageEvent} */ event) => this.#onMessage(socket, event.data);
      socket.onclose = (/** @type {Ended} */ event) => this.#lost(socket, event);
      this.#offsets = []; // pings follow the welcome at once, perhaps in the same piece
      const resume = this.welcome?.resume;
      this.welcome = await this.ask("hello", { protocol: PROTOCOL, client: name, token, resume, app });
      ({ lease: this.lease, output: this.output } = this.welcome);
      const { batches_per_s, touches_per_s, batch_touches } = this.welcome.limits;
      this.#limiters = [new Limiter(batches_per_s, MOST_AT_ONCE)];
      this.#limiters.push(new Limiter(touches_per_s, batch_touches));
      await this.restore();
      this.#watchSilence(socket);
    } catch (error) {
      const socket = this.#socket;
      this.#socket = undefined;
      socket?.close();
      throw error;
    } finally {
      this.#is_opening = false;
    }
  }

  /** Send again what the service does not keep for a client that resumes. @protected */
  async restore() {
    for (const [type, fields] of Object.entries(this.#replayed)) await this.ask(type, fields);
    for (const job of this.#watched) {
      await this.ask("watch", { job }).then(
        (state) => this.emit("job", state), // it may have ended since
        (error) => {
          if (!(error instanceof Refused)) throw error;
          this.#watched.delete(job); // another service knows none
        },
      );
    }
  }

  /**
   * Send or queue a batch of touches; return whether that was possible.
   * @param {() => ArrayBuffer} write
   * @param {number} count touches in it
   * @param {boolean} lifts whether a finger goes up: that is never left out
   * @protected
   */
  send(write, count, lifts) {
    if (this.#socket?.readyState !== 1 || this.#is_opening) return false;
    if (this.#waiting.length >= MOST_WAITING && !lifts) return false;
    this.#waiting.push({ bytes: write(), count });
    this.#pass();
    return true;
  }

  #pass() {
    while (this.#waiting.length && this.#later === undefined && this.#socket?.readyState === 1) {
      const { bytes, count } = /** @type {any} */ (this.#waiting.shift());
      this.#socket.send(bytes);
      const [batches, touches] = this.#limiters;
      const wait_s = Math.max(batches.take(1), touches.take(count));
      const passes = () => {
        this.#later = undefined;
        this.#pass();
      };
      if (wait_s > 0) this.#later = setTimeout(passes, wait_s * 1e3);
    }
  }

  /**
   * End at 0 V, whoever holds the output, by both paths; the holder keeps the lease.
   * @override
   */
  async stop() {
    const request = { method: "POST", signal: AbortSignal.timeout(1e3 * STOP_S) };
    const pressing = this.#stop && fetch(this.#stop, request).catch(() => {});
    try {
      return await super.stop();
    } finally {
      await pressing; // it must not stop what is armed next
    }
  }

  /** Leave: 0 V first, and the lease is free for others. */
  async close() {
    const socket = this.#socket;
    this.#is_closing = true;
    clearInterval(this.#watch);
    if (!socket) return;
    const leave = async () => {
      if (this.lease.is_mine) await this.ask("release");
      await this.ask("bye");
    };
    await Promise.race([leave().catch(() => {}), sleep(CLOSE_S)]);
    socket.close(1000);
    this.#lost(socket, { code: 1000, reason: "closed" });
  }

  /**
   * Call `handler` with each event of a kind; return what ends that.
   * @template {keyof Events} K
   * @param {K} kind
   * @param {(event: Events[K]) => void} handler
   * @returns {() => void}
   */
  on(kind, handler) {
    const handlers = this.#handlers.get(kind) ?? new Set();
    this.#handlers.set(kind, handlers.add(handler));
    return () => void handlers.delete(handler);
  }

  /**
   * Send a message and return its answer; rejects with `Refused` or `Lost`.
   * @override
   * @param {string} type
   * @param {object} [fields]
   * @returns {Promise<any>}
   */
  async ask(type, fields = {}) {
    if (this.#socket?.readyState !== 1) throw new Lost(this.#is_closing ? CLOSED : `${type}: the connection to the service is gone`);
    const id = ++this.#id;
    /** @type {ReturnType<typeof setTimeout> | undefined} */
    let timer;
    let answer;
    try {
      answer = await new Promise((resolve, reject) => {
        this.#pending.set(id, { resolve, reject });
        const late = () => reject(new Lost(`${type}: no answer within ${WAIT_S} s`));
        timer = setTimeout(late, WAIT_S * 1e3);
        this.#socket.send(JSON.stringify({ type, id, ...fields }));
      });
    } finally {
      clearTimeout(timer);
      this.#pending.delete(id);
    }
    this.#remember(type, fields);
    return answer;
  }

  /** @param {string} type @param {any} fields */
  #remember(type, fields) {
    if (type === "geometry") this.#replayed.geometry = fields;
    if (type === "watch") this.#watched.add(fields.job);
    if (type === "subscribe") {
      const streams = { ...this.#replayed.subscribe?.streams, ...fields.streams };
      this.#replayed.subscribe = { streams };
    }
  }

  /** Return a time of the service's clock by this one's [s], late by a message's way at most.
   * @param {number} service_s */
  clientTime(service_s) {
    return service_s + Math.min(...this.#offsets);
  }

  /** @param {any} socket @param {string | ArrayBuffer} data */
  #onMessage(socket, data) {
    if (socket !== this.#socket) return;
    this.#last_message_s = now();
    if (typeof data !== "string") {
      const frame = readFrame(data);
      this.emit("frame", { ...frame, names: this.columns[frame.stream] ?? [] });
      return;
    }
    const message = JSON.parse(data);
    if (message.type === "ping") {
      const clock_s = now();
      socket.send(JSON.stringify({ type: "pong", n: message.n, clock_s }));
      this.#offsets = [...this.#offsets.slice(1 - OFFSETS), clock_s - message.clock_s];
    }
    if (message.type === "lease") this.lease = message;
    if (message.type === "output") this.output = message;
    if (message.type === "subscribed") this.columns = message.columns; // frames may follow at once
    const answer = this.#pending.get(message.id);
    if (!answer) this.emit(message.type, message);
    else if (message.type === "error") answer.reject(new Refused(message));
    else answer.resolve(message);
  }

  /** Tell that fingers are on no region any more: nothing comes over a lost connection. */
  #leaveAll() {
    for (const contact of [...this.#on.values()]) {
      const ends = contact.event === "press" ? ["release", "leave"] : ["leave"];
      for (const event of ends) this.emit("contact", { ...contact, event, t_s: now(), value: null });
    }
  }

  /** @param {m.Contact} contact */
  #note(contact) {
    const place = `${contact.touch_id} ${contact.region}`;
    if (contact.event === "leave") this.#on.delete(place);
    else if (contact.event !== "detent") this.#on.set(place, contact);
  }

  /** @param {string} kind @param {any} event @protected */
  emit(kind, event) {
    if (kind === "contact") this.#note(event);
    for (const handler of this.#handlers.get(kind) ?? []) {
      try {
        handler(event);
      } catch (error) {
        queueMicrotask(() => {
          throw error; // reported by the page; the next handler is called nevertheless
        });
      }
    }
  }

  /** @param {any} socket @param {Ended} ended */
  #lost(socket, { code, reason }) {
    if (socket !== this.#socket) return;
    this.#socket = undefined;
    this.#waiting = [];
    clearTimeout(this.#later);
    this.#later = undefined;
    clearInterval(this.#watch);
    this.#leaveAll();
    for (const { reject } of this.#pending.values()) reject(new Lost(`it closed: ${code} ${reason}`));
    if (this.#is_opening) return; // `open` throws
    if (this.#is_closing) this.emit("closed", { code, reason });
    else {
      this.emit("lost", { code, reason });
      void this.#reconnect();
    }
  }

  async #reconnect() {
    let refusals = 0;
    for (let wait_s = FIRST_S; !this.#is_closing; wait_s = Math.min(2 * wait_s, LAST_S)) {
      await sleep(wait_s);
      if (this.#is_closing) break;
      try {
        await this.open();
        this.emit("resumed", this.welcome);
        return;
      } catch (error) {
        if (error instanceof Refused && (error.code !== "access" || ++refusals === MOST_REFUSALS)) {
          this.emit("closed", { code: 4403, reason: error.message });
          return;
        }
      }
    }
    this.emit("closed", { code: 1000, reason: "closed" });
  }

  /**
   * A service that hangs, or a machine that slept, closes no socket. Timers may be late where
   * messages are not, so two checks in a row must find silence.
   * @param {any} socket
   */
  #watchSilence(socket) {
    const { idle_s } = this.welcome.keep_alive;
    let looks = 0;
    clearInterval(this.#watch);
    this.#watch = setInterval(() => {
      looks = now() - this.#last_message_s > 2 * idle_s ? looks + 1 : 0;
      if (looks < 2) return;
      this.#lost(socket, { code: 1006, reason: "the service is silent" });
      socket.close();
    }, idle_s * 1e3);
  }
}

/** @param {number} seconds @returns {Promise<void>} */
function sleep(seconds) {
  return new Promise((resolve) => setTimeout(resolve, seconds * 1e3));
}
