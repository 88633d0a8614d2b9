/** The layout on the service: drafts, which are saved automatically, and layouts that a person keeps. */

import { Refused } from "/client/haptix.js";
import { START } from "./document.js";
import { store, stored, Value } from "./dom.js";
import { sentence } from "./service.js";
import { texts } from "./texts.js";

/** @import { History } from "./document.js" */
/** @import { Service } from "./service.js" */
/** @import * as m from "../../../clients/typescript/types/messages.js" */
/** @typedef {{name: string, revision: number, unix_s: number}} Version */

const [DRAFT, NAME] = ["haptix.draft", "haptix.layout"]; // of this tab; a new tab begins with the last ones
const [AFTER_MS, AGAIN_MS] = [300, 2000];
const MOST_LAST_BYTES = 60_000; // a browser sends no more for a closed page
const t = texts.make;

export class SavedLayout {
  /** @type {Value<string>} the state of the last change, for people */
  state = new Value("");
  /** @type {Value<string>} */
  name = new Value(t.untitled);
  /** @type {Value<{label: string, act: () => Promise<void>} | null>} a remedy, if there is one */
  help = new Value(/** @type {{label: string, act: () => Promise<void>} | null} */ (null));
  /** Revision of the kept layout that this one was made from; "" if none is kept. */
  revision = "";
  #draft = { id: "", revision: "" };
  /** @type {m.LayoutDocument | null} the document that the service has, as draft or kept */
  #saved;
  #has_begun = false;
  #timer = 0;
  #release = () => {};
  /** @type {Promise<unknown>} all writes, one after the other */
  #turn = Promise.resolve();

  /** @param {Service} service @param {History<m.LayoutDocument>} history */
  constructor(service, history) {
    this.service = service;
    this.history = history;
    this.#saved = history.current; // the initial layout need not be written
    service.onBegin.push(() => this.#begin());
    history.document.on((document) => {
      if (document !== this.#saved) this.#later(AFTER_MS);
    });
    addEventListener("pagehide", () => this.#leave());
    addEventListener("beforeunload", (event) => this.state.get() === t.unsaved && event.preventDefault());
  }

  get #is_saved() {
    return this.#saved === this.history.current;
  }

  /** Write changes as a draft, then do something else.
   * @template T @param {() => Promise<T>} [then] @returns {Promise<T>} */
  #after(then) {
    const turn = this.#turn.then(async () => {
      await this.#write();
      return /** @type {T} */ (await then?.());
    });
    this.#turn = turn.catch(() => {});
    return turn;
  }

  /** @param {number} after_ms */
  #later(after_ms) {
    clearTimeout(this.#timer);
    this.state.set(t.changed);
    this.#timer = setTimeout(() => void this.#after().catch(() => {}), after_ms);
  }

  /** Continue this tab's draft, the last written draft, or the last kept layout. */
  async #begin() {
    if (!this.#has_begun && !this.history.next.undo) {
      const is_new = sessionStorage.getItem(DRAFT) === null;
      if (is_new) sessionStorage.setItem(DRAFT, "");
      const id = is_new ? stored(DRAFT) : sessionStorage.getItem(DRAFT);
      const name = is_new ? stored(NAME) : sessionStorage.getItem(NAME);
      const absent = (/** @type {unknown} */ error) => {
        if (!(error instanceof Refused)) throw error;
        if (error.code !== "unknown") this.service.notify("error", sentence(error));
        return false;
      };
      const is_drafted = id && (await this.openDraft(id).then(() => true, absent));
      if (!is_drafted && name) await this.open(name).catch(absent);
    }
    this.#has_begun = true;
    if (!this.#is_saved) this.#later(0);
  }

  get #body() {
    const made_from = this.revision ? Number(JSON.parse(this.revision)) : null;
    return { name: this.name.get(), made_from, document: this.history.current };
  }

  /** @returns {Promise<void>} */
  async #write() {
    clearTimeout(this.#timer);
    if (!this.#has_begun || this.#is_saved) return;
    const body = this.#body;
    if (!this.#draft.id) await this.#claim(crypto.randomUUID());
    try {
      this.#draft.revision = await this.#put(`/v1/drafts/${this.#draft.id}`, body, this.#draft.revision);
    } catch (error) {
      if (error instanceof Refused && error.code === "stale") {
        this.#forget(); // another program has written that one
        return this.#write();
      }
      this.#later(AGAIN_MS);
      this.state.set(t.unsaved);
      throw error;
    }
    this.#saved = body.document;
    store(DRAFT, this.#draft.id);
    if (this.#is_saved) this.state.set(t.drafted);
  }

  /** @param {string} path @param {any} body @param {string} revision @returns {Promise<string>} */
  async #put(path, body, revision) {
    const answer = await this.service.rest("PUT", path, body, revision ? { "if-match": revision } : {});
    return answer.headers.get("etag") ?? "";
  }

  /** Lock a draft for this page until it closes, unless another page has locked it.
   * @param {string} id @returns {Promise<boolean>} whether this page has it */
  async #claim(id, revision = "") {
    const is_own = await new Promise((resolve) => {
      void navigator.locks.request(DRAFT + id, { ifAvailable: true }, (lock) => {
        resolve(lock !== null);
        return lock && new Promise((release) => void (this.#release = () => release(null)));
      });
    });
    if (is_own) {
      this.#draft = { id, revision };
      sessionStorage.setItem(DRAFT, id);
    }
    return is_own;
  }

  #leave() {
    if (!this.#has_begun || this.#is_saved) return;
    const id = this.#draft.id || crypto.randomUUID();
    const { revision } = this.#draft;
    const text = JSON.stringify(this.#body);
    sessionStorage.setItem(DRAFT, id);
    const headers = { "content-type": "application/json", ...(revision ? { "if-match": revision } : {}) };
    const keepalive = text.length < MOST_LAST_BYTES;
    void this.service.rest("PUT", `/v1/drafts/${id}`, text, headers, { keepalive }).catch(() => {});
  }

  /** Keep the layout under its name, over the one that it was made from. */
  keep() {
    return this.#after(async () => {
      const [document, name] = [this.history.current, this.name.get()];
      try {
        this.revision = await this.#put(pathOf(name), document, this.revision);
      } catch (error) {
        if (error instanceof Refused && error.code === "stale") {
          this.help.set({ label: t.copy, act: () => this.duplicate() });
        }
        throw error;
      }
      this.#saved = document;
      await this.#endDraft();
      this.#open(name);
      this.#tell(t.saved(name));
      if (!this.#is_saved) this.#later(AFTER_MS);
    });
  }

  /** Keep the layout under a name that no layout has. */
  async duplicate() {
    const names = await this.names();
    const base = this.name.get().replace(/ \d+$/, "");
    let number = 2;
    while (names.includes(`${base} ${number}`)) number += 1;
    this.revision = "";
    this.name.set(`${base} ${number}`);
    await this.keep();
  }

  /** Rename the layout, and its kept one. @param {string} to */
  rename(to) {
    return this.#after(async () => {
      const name = to.trim() || t.untitled;
      if (name === this.name.get()) return;
      if (this.revision) {
        const headers = { "if-match": this.revision };
        await this.service.rest("POST", `${pathOf(this.name.get())}/rename`, { to: name }, headers);
        this.#open(name);
      }
      this.name.set(name);
      this.#tell(t.renamed(name));
      if (this.revision && !this.#draft.id) return;
      this.#saved = null;
      this.#later(0);
    });
  }

  /** Remove the kept layout; `help` brings it back. */
  remove() {
    return this.#after(async () => {
      const name = this.name.get();
      await this.service.rest("DELETE", pathOf(name), undefined, { "if-match": this.revision });
      await this.#begins(START, t.untitled);
      this.#tell(t.removed(name), { label: t.bringBack(name), act: () => this.bringBack(name) });
    });
  }

  /** Keep a removed layout again. @param {string} name */
  async bringBack(name) {
    const [last] = await this.versions(name);
    const document = await this.#version(name, last.revision);
    await this.#put(pathOf(name), document, "");
    await this.open(name);
  }

  /** Begin a layout without a region. */
  begin() {
    return this.#after(async () => {
      await this.#begins({ regions: [] }, t.untitled);
      this.#tell("");
    });
  }

  /** Open a kept layout; drafts of others stay. @param {string} name */
  open(name) {
    return this.#after(async () => {
      const answer = await this.service.rest("GET", pathOf(name));
      if (!(await this.#begins(await answer.json(), name, answer.headers.get("etag") ?? ""))) return;
      this.#open(name);
      this.#tell(t.opened(name));
    });
  }

  /** Continue a draft. @param {string} id */
  openDraft(id) {
    return this.#after(async () => {
      const answer = await this.service.rest("GET", `/v1/drafts/${id}`);
      const { name, made_from, document } = await answer.json();
      const is_open = await this.#begins(document, name, made_from ? JSON.stringify(String(made_from)) : "");
      if (!is_open) return;
      const is_own = await this.#claim(id, answer.headers.get("etag") ?? "");
      this.#tell(t.openedDraft(name));
      if (is_own) return;
      this.#saved = null; // this page continues with a copy
      this.#later(0);
    });
  }

  /** Go back to a version; this is a change that can be undone. @param {Version} version */
  async restore({ name, revision }) {
    const { regions } = await this.#version(name, revision);
    this.history.change(t.did.restore(revision), (draft) => void (draft.regions = regions));
  }

  /** Return the names of all kept layouts, or of the removed ones. @returns {Promise<string[]>} */
  async names(removed = false) {
    return (await this.service.rest("GET", `/v1/layouts?removed=${removed}`)).json();
  }

  /** Versions of a layout, the newest first. @param {string} name @returns {Promise<Version[]>} */
  async versions(name) {
    return (await this.service.rest("GET", `${pathOf(name)}/versions`)).json();
  }

  /** Return all drafts except this one, with the names of their layouts. @returns {Promise<{id: string, name: string, unix_s: number}[]>} */
  async drafts() {
    /** @type {Version[]} */
    const all = await (await this.service.rest("GET", "/v1/drafts")).json();
    return Promise.all(all.filter(({ name }) => name !== this.#draft.id).slice(0, 20).map(async ({ name: id, unix_s }) =>
      ({ id, unix_s, name: (await (await this.service.rest("GET", `/v1/drafts/${id}`)).json()).name })));
  }

  /** @param {string} name @param {number} revision @returns {Promise<m.LayoutDocument>} */
  async #version(name, revision) {
    return (await this.service.rest("GET", `${pathOf(name)}/versions/${revision}`)).json();
  }

  /** Show another layout after all changes of this one are saved; at the start, not over changes.
   * @param {m.LayoutDocument} document @param {string} name */
  async #begins(document, name, revision = "") {
    if (!this.#has_begun && this.history.next.undo) return false;
    while (this.#has_begun && !this.#is_saved) await this.#write();
    this.#saved = document;
    this.revision = revision;
    this.#forget();
    this.name.set(name);
    this.history.open(document);
    return true;
  }

  /** @param {string} text @param {{label: string, act: () => Promise<void>} | null} help */
  #tell(text, help = null) {
    this.state.set(text);
    this.help.set(help);
  }

  async #endDraft() {
    const { id, revision } = this.#draft;
    this.#forget();
    // If another tab has continued and written the draft since, it stays.
    if (id) await this.service.rest("DELETE", `/v1/drafts/${id}`, undefined, { "if-match": revision }).catch(() => {});
  }

  /** Begin with a kept layout at the next visit. @param {string} name */
  #open(name) {
    sessionStorage.setItem(NAME, name);
    store(NAME, name);
  }

  #forget() {
    if (stored(DRAFT) === this.#draft.id) store(DRAFT, "");
    sessionStorage.setItem(DRAFT, "");
    sessionStorage.setItem(NAME, "");
    this.#draft = { id: "", revision: "" };
    this.#release();
  }

  /** Do what a person requested; show the reason if it is refused. @param {() => Promise<unknown>} act */
  attempt(act) {
    return this.service.attempt(async () => {
      try {
        await act();
      } catch (error) {
        this.state.set(sentence(error));
        throw error;
      }
    });
  }
}

/** @param {string} name */
function pathOf(name) {
  return `/v1/layouts/${encodeURIComponent(name)}`;
}
