/** A value that tells who listens when it changes. @template T */
export class Value {
  #value;
  /** @type {Set<(value: T) => void>} */
  #handlers = new Set();

  /** @param {T} value */
  constructor(value) {
    this.#value = value;
  }

  get() {
    return this.#value;
  }

  /** @param {T} value */
  set(value) {
    if (Object.is(value, this.#value)) return;
    this.#value = value;
    for (const handler of [...this.#handlers]) handler(value);
  }

  /**
   * Call a handler now and after each change; return what ends that.
   * @param {(value: T) => void} handler
   * @returns {() => void}
   */
  on(handler) {
    this.#handlers.add(handler);
    handler(this.#value);
    return () => void this.#handlers.delete(handler);
  }
}
