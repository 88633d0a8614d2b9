// A driver that the engine's worker plays: the page has it chosen, armed and stopped.

import { DriverError } from "./driver.js";
import { chooseDevice } from "./links.js";

let opened = 0;

export class PageDriver extends EventTarget {
  #number = ++opened; // the worker plays the driver that was opened last
  #worker;
  #asked = 0;
  #waiting = new Map();
  #unlisten = new AbortController();

  constructor(engine) {
    super();
    this.#worker = engine.worker;
    /** Whether strokes are played. */
    this.isArmed = false;
    const { signal } = this.#unlisten;
    const hear = ({ detail: { number, id, isArmed, failed, error } }) => {
      if (number !== this.#number) return;
      this.isArmed = isArmed;
      const { resolve, reject } = this.#waiting.get(id) ?? {};
      this.#waiting.delete(id);
      if (error) reject(told(error));
      else resolve?.();
      if (failed) this.dispatchEvent(new CustomEvent("failed", { detail: told(failed) }));
    };
    engine.addEventListener("driver", hear, { signal });
    const end = () => {
      this.isArmed = false;
      this.#unlisten.abort();
      for (const { reject } of this.#waiting.values()) reject(new DriverError("the engine is closed; load it again"));
    };
    engine.addEventListener("closed", end, { signal });
    const leave = () => this.stop().catch(() => {});
    document.addEventListener("visibilitychange", () => document.visibilityState === "hidden" && leave(), { signal });
    globalThis.addEventListener("pagehide", leave, { signal });
  }

  /**
   * Open a driver that a person chooses from the browser's list, in the listener of a click. A page that is hidden or closed, and an
   * engine that dies, end at 0 V; a page that is busy does not.
   *
   * @param {"usb" | "hid" | "serial" | "virtual"} kind
   * @param {import("./engine.js").Engine} engine
   */
  static async open(kind, engine, { ceilingV, maxSlewVPerS, ...options } = {}) {
    const { alike } = await chooseDevice(kind, options);
    if (alike > 1) throw new DriverError("several drivers alike were chosen: withdraw all but one in the browser's site settings");
    const driver = new PageDriver(engine);
    const limits = Object.fromEntries(Object.entries({ ceilingV, maxSlewVPerS }).filter(([, limit]) => limit !== undefined));
    try {
      await driver.#ask("open", { kind, options: { ...options, again: true }, limits });
    } catch (error) {
      driver.#unlisten.abort();
      throw error;
    }
    return driver;
  }

  async #ask(name, how) {
    if (this.#isClosed) throw new DriverError("the driver is closed; open it again");
    const id = ++this.#asked;
    this.#worker.postMessage({ drive: { number: this.#number, id, name, how } });
    return new Promise((resolve, reject) => this.#waiting.set(id, { resolve, reject }));
  }

  get #isClosed() {
    return this.#unlisten.signal.aborted;
  }

  /** Arm, and play the engine's strokes. Only within a person's click or key. */
  async arm() {
    if (!navigator.userActivation.isActive)
      throw new DriverError("a driver is armed by a person: call arm() in the listener of a click");
    return this.#ask("arm");
  }

  /** Ramp to 0 V and disarm. */
  async stop() {
    if (!this.#isClosed) await this.#ask("stop");
  }

  /** Stop, and close the link. */
  async close() {
    if (!this.#isClosed) await this.#ask("close");
    this.#unlisten.abort();
  }
}

const told = ({ name, message }) => Object.assign(new DriverError(message), { name });
