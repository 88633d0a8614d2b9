/** Jobs of one kind on the service, also those that others began: begin, watch, answer and end them. */

import { el } from "./dom.js";

/** @import { Service } from "./service.js" */
/** @import * as m from "../../../clients/typescript/types/messages.js" */

const ENDED = ["done", "failed", "cancelled"];

/** @param {m.Job} job */
export function isOver(job) {
  return ENDED.includes(job.state);
}

export class Jobs {
  #end = () => {};
  #unsubscribe = () => {};

  /**
   * @param {Service} service
   * @param {string} kind
   * @param {(job: m.Job) => void} take called with each change of a watched job
   * @param {string} [route] where one is begun
   */
  constructor(service, kind, take, route = `${kind}s`) {
    this.service = service;
    this.kind = kind;
    this.take = take;
    this.route = route;
  }

  /** Listen to jobs from now on. @param {() => Promise<void>} onSession called with each session */
  open(onSession) {
    const { service } = this;
    this.#end = service.state.on(({ phase }) => {
      if (phase !== "open") return;
      this.#unsubscribe(); // from the session before
      const take = (/** @type {m.Job} */ job) => void (job.kind === this.kind && this.take(job));
      this.#unsubscribe = service.session?.on("job", take) ?? (() => {});
      void service.attempt(onSession);
    });
  }

  /** Begin a job; call `watch` for it. @param {Record<string, any>} body @returns {Promise<m.Job>} */
  async begin(body) {
    return (await this.service.rest("POST", `/v1/${this.route}`, body)).json();
  }

  /** Return all known jobs of this kind. @returns {Promise<m.Job[]>} */
  async all() {
    const jobs = /** @type {m.Job[]} */ (await (await this.service.rest("GET", "/v1/jobs")).json());
    return jobs.filter((job) => job.kind === this.kind);
  }

  /** Watch a job from now on. @param {m.Job} job */
  async watch(job) {
    const known = await this.service.session?.watch(job.job);
    if (known) this.take(known);
  }

  /** @param {m.Job} job @param {string} text */
  answer(job, text) {
    void this.service.attempt(() => this.service.rest("POST", `/v1/jobs/${job.job}/answer`, { text }));
  }

  /**
   * Where a person answers what a job asks: a button for each choice, or a line of text.
   * @param {m.Job} job @param {string} submit @param {Record<string, string>} [names] of choices
   */
  answerForm(job, submit, names = {}) {
    const { prompt, choices = [] } = job;
    if (choices.length) {
      const buttons = choices.map((choice, at) => el(at ? "button" : "button.main", { type: "button", onclick: () => this.answer(job, choice) }, names[choice] ?? choice));
      return el("div.field-of", {}, el("p.large", {}, prompt), el("div.row", {}, buttons));
    }
    const text = el("input", { id: `answer-${job.job}`, type: "text" });
    const onsubmit = (/** @type {Event} */ event) => {
      event.preventDefault();
      this.answer(job, text.value);
    };
    return el("form.field-of", { onsubmit }, el("label", { for: text.id }, prompt), el("div.row", {}, text, el("button.main", {}, submit)));
  }

  /** @param {m.Job} job */
  cancel(job) {
    void this.service.attempt(() => this.service.rest("DELETE", `/v1/jobs/${job.job}`));
  }

  close() {
    this.#end();
    this.#unsubscribe();
  }
}
