// An engine for a page: it runs in a worker, takes pointers, and gives blocks of friction and drive.

import { bytesOf, compileEngine, ProgramError } from "./core.js";

export { ProgramError };

export class Engine extends EventTarget {
  constructor(worker, { sampleRateHz, step, highestV }) {
    super();
    /** Where the engine runs. */
    this.worker = worker;
    /** Samples in a second. */
    this.sampleRateHz = sampleRateHz;
    /** Samples from one control point to the next. */
    this.step = step;
    /** Highest voltage of the drive. */
    this.highestV = highestV;
    worker.onmessage = ({ data }) => {
      for (const [type, detail] of Object.entries(data)) this.dispatchEvent(new CustomEvent(type, { detail }));
    };
  }

  /**
   * Load a program of a touch. A `ProgramError` says why one is refused.
   *
   * @param {string | URL | ArrayBuffer | Uint8Array} program address or bytes of a .hxp file
   */
  static async load(program) {
    const [module, bytes] = await Promise.all([compileEngine(), bytesOf(program)]);
    const worker = new Worker(new URL("./worker.js", import.meta.url), { type: "module" });
    const opened = new Promise((resolve, reject) => {
      worker.onerror = () => reject(new Error("the worker of the engine cannot be loaded"));
      worker.onmessage = ({ data }) => {
        if (data.opened) return resolve(data.opened);
        const error = new ProgramError(data.refused.code);
        error.message = data.refused.message;
        reject(error);
      };
    });
    worker.postMessage({ open: { module, program: bytes } });
    try {
      return new Engine(worker, await opened);
    } catch (error) {
      worker.terminate();
      throw error;
    }
  }

  addEventListener(type, ...listener) {
    if (type === "block") this.worker.postMessage({ hear: true }); // not before: each block costs the page
    super.addEventListener(type, ...listener);
  }

  /** Report a finger; `ms` is its time stamp, as events have it. */
  touch(id, xMm, yMm, { isDown = true, forceN = 0, ms = performance.now() } = {}) {
    this.worker.postMessage({
      touches: [{ id, xMm, yMm, forceN, isDown, ms: performance.timeOrigin + ms }],
    });
  }

  /**
   * Take the pointers on an element: a finger or a pen while it touches, a mouse while it is over it.
   *
   * @param {HTMLElement} element
   * @param {number} widthMm width of the element in the millimetres of the program
   * @param {{leftMm?: number, topMm?: number}} corner the place of its upper left corner
   * @returns {() => void} stops it
   */
  attach(element, widthMm, { leftMm = 0, topMm = 0 } = {}) {
    const down = new Set();
    const report = (events, isDown) => {
      const box = element.getBoundingClientRect();
      const mm = widthMm / box.width;
      const touches = events.map(({ pointerId, clientX, clientY, timeStamp }) => ({
        id: pointerId,
        xMm: leftMm + (clientX - box.left) * mm,
        yMm: topMm + (clientY - box.top) * mm,
        forceN: 0,
        isDown,
        ms: performance.timeOrigin + timeStamp,
      }));
      this.worker.postMessage({ touches });
    };
    const move = (event) => {
      const touches = event.pointerType === "mouse" || (event.buttons & 1) === 1;
      if (touches) {
        down.add(event.pointerId);
        const events = event.getCoalescedEvents?.() ?? [];
        report(events.length ? events : [event], true);
      }
    };
    const up = (event) => {
      if (event.type === "pointerup" && event.pointerType === "mouse") return;
      if (down.delete(event.pointerId)) report([event], false);
    };
    const listeners = {
      pointerdown: move,
      pointermove: move,
      pointerup: up,
      pointercancel: up,
      pointerleave: up,
    };
    for (const [type, listener] of Object.entries(listeners)) {
      element.addEventListener(type, listener);
    }
    element.style.touchAction = "none";
    return () => {
      for (const [type, listener] of Object.entries(listeners)) {
        element.removeEventListener(type, listener);
      }
    };
  }

  /** End the worker. */
  close() {
    this.worker.terminate();
    this.dispatchEvent(new Event("closed"));
  }
}
