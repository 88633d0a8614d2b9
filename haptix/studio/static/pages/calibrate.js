/** Calibrate a screen: a guided page over the service's job, which asks before each step. */

import { el, fill } from "../dom.js";
import { sentence } from "../service.js";
import { texts } from "../texts.js";

/** @import { App } from "../app.js" */
/**
 * @typedef {{job: string, kind: string, state: string, share: number, prompt: string,
 *   choices: string[], sentence: string, result: Record<string, any> | null}} Job
 */

const t = texts.calibrate;
const ENDED = ["done", "failed", "cancelled"];
const NAME = "[A-Za-z0-9][A-Za-z0-9_\\-]{0,79}";

/** @param {HTMLElement} root @param {App} app */
export function mount(root, app) {
  const { service } = app;
  /** @type {string} the job that is shown */
  let shown = "";
  const name = el("input", { id: "name", type: "text", required: true, pattern: NAME, value: t.practice });
  const minutes = el("input", { id: "minutes", type: "number", min: "2", max: "60", value: "3" });
  const begin = el("button.main", {}, t.begin);
  const told = el("p.told", { role: "alert" });
  const bar = el("progress", { max: 1, value: 0, "aria-label": t.progress });
  const now = el("section.sheet.set-up", { hidden: true, "aria-live": "polite" });
  root.append(
    el("form.sheet.set-up", {
      onsubmit: async (/** @type {SubmitEvent} */ event) => {
        event.preventDefault();
        told.textContent = "";
        try {
          const asked = { name: name.value, minutes: Number(minutes.value) };
          await follow(await (await service.rest("POST", "/v1/calibrations", asked)).json());
        } catch (error) {
          told.textContent = sentence(error);
        }
      },
    },
    el("h2", {}, t.title), el("p", {}, t.help),
    el("div.field-of", {}, el("label", { for: "name" }, t.name), name, el("small", {}, t.nameHelp)),
    el("div.field-of", {}, el("label", { for: "minutes" }, t.minutes), minutes),
    told, el("div.row", {}, begin)),
    now);

  /** @param {Job} job */
  async function follow(job) {
    shown = job.job;
    take(job);
    take(await /** @type {any} */ (service.session)?.ask("watch", { job: job.job }));
  }

  /** @param {Job | undefined} job */
  function take(job) {
    if (!job || job.job !== shown) return;
    const is_over = ENDED.includes(job.state);
    begin.disabled = !is_over;
    now.hidden = false;
    bar.value = job.share;
    fill(now, el("h2", {}, t.states[job.state] ?? job.state), bar,
      job.state === "asking" ? asks(job) : null,
      job.sentence ? el("p.told", { role: "alert" }, job.sentence) : null,
      job.result ? report(job.result) : null,
      is_over ? null : el("button", { type: "button", onclick: () => void service.attempt(() => service.rest("DELETE", `/v1/jobs/${job.job}`)) }, t.end));
    now.querySelector("input")?.focus();
  }

  /** @param {Job} job */
  function asks({ job, prompt, choices }) {
    const answer = (/** @type {string} */ text) =>
      void service.attempt(() => service.rest("POST", `/v1/jobs/${job}/answer`, { text }));
    if (choices.length) {
      return el("div.field-of", {}, el("p", {}, prompt),
        el("div.row", {}, choices.map((choice) => el("button.main", { type: "button", onclick: () => answer(choice) }, choice))));
    }
    const text = el("input", { id: "answer", type: "text" });
    return el("form.field-of", { onsubmit: (/** @type {Event} */ event) => {
      event.preventDefault();
      answer(text.value);
    } }, el("label", { for: "answer" }, prompt), el("div.row", {}, text, el("button.main", {}, t.answer)));
  }

  let unheard = () => {};
  const end = service.state.on(({ phase }) => {
    if (phase !== "open") return;
    unheard(); // of the session before
    unheard = /** @type {any} */ (service.session)?.on("job", take);
    // One that runs, perhaps begun by another page, is gone on with.
    void service.attempt(async () => {
      const jobs = /** @type {Job[]} */ (await (await service.rest("GET", "/v1/jobs")).json());
      const runs = jobs.find((job) => job.kind === "calibration" && !ENDED.includes(job.state));
      if (runs) await follow(runs);
    });
  });
  return () => {
    end();
    unheard();
  };
}

/** @param {Record<string, any>} result */
function report(result) {
  const text = (/** @type {any} */ value) => (value && typeof value === "object" ? JSON.stringify(value) : String(value));
  return el("dl.facts", {}, Object.entries(result).map(([key, value]) =>
    el("div", {}, el("dt", {}, key.replaceAll("_", " ")), el("dd", {}, text(value)))));
}
