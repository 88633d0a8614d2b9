/** Calibrate a screen: a guided page over the service's job, which asks before each step. */

import { el, fill } from "../dom.js";
import { sentence } from "../service.js";
import { StrokePlots } from "../stroke-plots.js";
import { texts } from "../texts.js";

/** @import { App } from "../app.js" */
/** @import * as m from "../../../../clients/typescript/types/messages.js" */

const t = texts.calibrate;
const ENDED = ["done", "failed", "cancelled"];
const NAME = "[A-Za-z0-9][A-Za-z0-9_\\-]{0,79}";

/** @param {HTMLElement} root @param {App} app */
export function mount(root, app) {
  const { service } = app;
  /** @type {string} the job that is shown */
  let shown = "";
  const plots = new StrokePlots();
  const name = el("input", { id: "name", type: "text", required: true, pattern: NAME, value: t.practice });
  const minutes = el("input", { id: "minutes", type: "number", min: "2", max: "60", value: "3" });
  const told = el("p.told", { role: "alert" });
  const bar = el("progress", { max: 1, value: 0, "aria-label": t.progress });
  const steps = el("ol.steps", { "aria-label": t.stepsName });
  const now = el("section.sheet.set-up", { hidden: true, "aria-live": "polite" });
  const found = el("section.sheet.set-up", { hidden: true });
  const form = el("form.sheet.set-up", {
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
  told, el("div.row", {}, el("button.main", {}, t.begin)));
  root.append(now, found, plots.element, form);

  /** @param {m.Job} job */
  async function follow(job) {
    shown = job.job;
    found.hidden = true;
    take(job);
    take(await service.session?.watch(job.job));
  }

  /** @param {m.Job | undefined} job */
  function take(job) {
    if (!job || job.job !== shown) return;
    if (job.trace) return plots.add(job.trace);
    const is_over = ENDED.includes(job.state);
    form.hidden = !is_over; // what is to be done, and the curves of it, fit one screen
    now.hidden = false;
    bar.value = job.share ?? 0;
    const is_whole = job.state === "done" && !(/** @type {any} */ (job.result)?.still_open?.length);
    const passed = t.steps.findIndex(([step]) => step === job.step);
    fill(steps, t.steps.map(([step, title], at) => el("li", {
      "aria-current": step === job.step && !is_over ? "step" : null, className: at < passed || is_whole ? "done" : "",
    }, title)));
    fill(now, el("h2", {}, t.states[job.state] ?? job.state), steps, bar,
      job.state === "running" ? el("p.large", {}, t.working[job.step ?? ""]) : null,
      job.state === "asking" ? asks(job) : null,
      job.sentence ? el("p.told", { role: "alert" }, job.sentence) : null,
      is_over || job.choices?.length ? null : el("div.row", {}, el("button", { type: "button", onclick: () => void service.attempt(() => service.rest("DELETE", `/v1/jobs/${job.job}`)) }, t.end)));
    /** @type {HTMLElement | null} */ (now.querySelector("input, button.main"))?.focus();
    const { result } = job;
    if (result) {
      found.hidden = false;
      fill(found, ...report(result, () => void service.attempt(() => save(String(result.name)))));
    }
  }

  /** @param {m.Job} job */
  function asks({ job, prompt, choices = [] }) {
    const answer = (/** @type {string} */ text) =>
      void service.attempt(() => service.rest("POST", `/v1/jobs/${job}/answer`, { text }));
    if (choices.length) {
      return el("div.field-of", {}, el("p.large", {}, prompt),
        el("div.row", {}, choices.map((choice, at) => el(at ? "button" : "button.main", { type: "button", onclick: () => answer(choice) }, t.choices[choice] ?? choice))));
    }
    const text = el("input", { id: "answer", type: "text" });
    return el("form.field-of", { onsubmit: (/** @type {Event} */ event) => {
      event.preventDefault();
      answer(text.value);
    } }, el("label", { for: "answer" }, prompt), el("div.row", {}, text, el("button.main", {}, t.answer)));
  }

  /** @param {string} of */
  async function save(of) {
    const answer = await service.rest("GET", `/v1/calibrations/${of}/report`);
    const href = URL.createObjectURL(await answer.blob());
    el("a", { href, download: `${of}.html` }).click();
    setTimeout(() => URL.revokeObjectURL(href));
  }

  let unheard = () => {};
  const end = service.state.on(({ phase }) => {
    if (phase !== "open") return;
    unheard(); // of the session before
    unheard = service.session?.on("job", take) ?? unheard;
    // One that runs, perhaps begun by another page, is gone on with.
    void service.attempt(async () => {
      const jobs = /** @type {m.Job[]} */ (await (await service.rest("GET", "/v1/jobs")).json());
      const runs = jobs.find((job) => job.kind === "calibration" && !ENDED.includes(job.state));
      if (runs) await follow(runs);
    });
  });
  return () => {
    end();
    unheard();
    plots.close();
  };
}

/** What was found, for people. @param {Record<string, any>} result @param {() => void} save */
function report(result, save) {
  const { verdict, still_open = [], practice, failures = [], untested = [] } = result;
  const heading = el("h2", {}, t.report);
  if (still_open.length) return [heading, el("p", {}, t.open(still_open.length))];
  const list = (/** @type {string[]} */ items) => el("ul", {}, items.map((item) => el("li", {}, item)));
  /** @type {[string, string | Node][]} */
  const rows = [
    [t.verdict, el("b", { className: verdict }, t.verdicts[verdict] ?? verdict)],
    [t.worst, t.jnd(result.worst_jnd)],
    [t.strokesUsed, String(result.strokes_used)],
    [t.insulator, result.h0_nm === null ? t.undetermined : t.nanometres(result.h0_nm)],
  ];
  if (practice) {
    rows.push([t.truth, t.off(practice.true_h0_nm, practice.h0_error)]);
    rows.push([t.frictionOff, t.frictionErrors(practice.friction_error_median_jnd, practice.friction_error_worst_jnd)]);
  }
  if (failures.length) rows.push([t.failures, list(failures)]);
  if (untested.length) rows.push([t.untested, list(untested)]);
  rows.push([t.installed, result.installed_for ? t.installedFor(result.installed_for) : t.notInstalled]);
  return [
    heading,
    el("dl.facts", {}, rows.map(([key, value]) => el("div", {}, el("dt", {}, key), el("dd", {}, value)))),
    el("div.row", {}, el("button", { type: "button", onclick: save }, t.save)),
  ];
}
