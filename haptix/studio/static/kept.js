/** The layout as the service keeps it: written two seconds after the last change. */

import { Refused } from "/client/haptix.js";
import { sentence } from "./service.js";
import { texts } from "./texts.js";
import { Value } from "./value.js";

/** @import { App } from "./app.js" */

const KEY = "haptix.layout";
const AFTER_MS = 2000;
const t = texts.make;

export class Kept {
  /** @type {Value<string>} what became of it, for people */
  state = new Value("");
  #timer = 0;
  #etag = "";
  #name = localStorage.getItem(KEY) || t.untitled;
  /** @type {unknown} the document that is kept */
  #known = null;

  /** @param {App} app */
  constructor(app) {
    this.app = app;
    this.end = app.history.document.on((document) => {
      if (this.#known === null) this.#known = document; // what there was at the start needs no writing
      if (this.#known === document) return;
      clearTimeout(this.#timer);
      this.#timer = setTimeout(() => void this.write(), AFTER_MS);
      this.state.set(t.changed);
    });
  }

  get name() {
    return this.#name;
  }

  /** Go on under another name. @param {string} name */
  rename(name) {
    this.#name = name.trim() || t.untitled;
    this.#etag = "";
    localStorage.setItem(KEY, this.#name);
    return this.write();
  }

  /** Names of all that are kept. @returns {Promise<string[]>} */
  async names() {
    return (await this.app.service.rest("GET", "/v1/layouts")).json();
  }

  /** Open a layout. @param {string} name */
  async open(name) {
    clearTimeout(this.#timer);
    const answer = await this.app.service.rest("GET", `/v1/layouts/${encodeURIComponent(name)}`);
    const document = await answer.json();
    this.#etag = answer.headers.get("etag") ?? "";
    this.#name = name;
    localStorage.setItem(KEY, name);
    this.#known = document;
    this.app.history.open(document);
    this.state.set(t.opened(name));
  }

  /** Write it now. */
  async write() {
    clearTimeout(this.#timer);
    const document = this.app.history.current;
    /** @type {Record<string, string>} */
    const headers = this.#etag ? { "if-match": this.#etag } : {};
    try {
      const path = `/v1/layouts/${encodeURIComponent(this.#name)}`;
      const answer = await this.app.service.rest("PUT", path, document, headers);
      this.#etag = answer.headers.get("etag") ?? "";
      this.#known = document;
      this.state.set(t.saved(this.#name));
    } catch (error) {
      this.state.set(t.unsaved);
      if (error instanceof Refused && error.code === "order") this.#etag = "";
      this.app.service.notify("error", sentence(error));
    }
  }

  close() {
    this.end();
    if (this.#known !== this.app.history.current) void this.write();
  }
}
