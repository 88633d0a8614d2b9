/** Calibrate a screen: a guided page over the service's job, which asks before each step. */

import { bullets, el, facts, fill, save } from "../dom.js";
import { taskForm } from "../form.js";
import { isOver, Jobs } from "../jobs.js";
import { StrokePlots } from "../plots.js";
import { texts } from "../texts.js";

/** @import { App } from "../app.js" */
/** @import * as m from "../../../../clients/typescript/types/messages.js" */

const t = texts.calibrate;

/** @param {HTMLElement} root @param {App} app */
export function mount(root, app) {
  const { service } = app;
  /** @type {string} the job that is shown */
  let shown = "";
  const plots = new StrokePlots();
  const bar = el("progress", { max: 1, value: 0, "aria-label": t.progress });
  const steps = el("ol.steps", { "aria-label": t.stepsName });
  const now = el("section.sheet.set-up", { hidden: true, "aria-live": "polite" });
  const result_sheet = el("section.sheet.set-up", { hidden: true });
  const form = taskForm(service, "calibrations", t, async (values) => follow(await jobs.begin(values)));
  root.append(now, result_sheet, plots.element, form);

  /** @param {m.Job} job */
  async function follow(job) {
    shown = job.job;
    result_sheet.hidden = true;
    take(job);
    await jobs.watch(job);
  }

  /** @param {m.Job} job */
  function take(job) {
    if (job.job !== shown) return;
    if (job.trace) return plots.add(job.trace);
    const is_over = isOver(job);
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
      job.state === "asking" ? jobs.answerForm(job, t.answer, t.choices) : null,
      job.sentence ? el("p.told", { role: "alert" }, job.sentence) : null,
      is_over || job.choices?.length ? null : el("div.row", {}, el("button", { type: "button", onclick: () => jobs.cancel(job) }, t.end)));
    /** @type {HTMLElement | null} */ (now.querySelector("input, button.main"))?.focus();
    const { result } = job;
    if (result) {
      result_sheet.hidden = false;
      fill(result_sheet, ...report(result, () => void service.attempt(() => saveReport(String(result.name)))));
    }
  }

  /** @param {string} of */
  async function saveReport(of) {
    const answer = await service.rest("GET", `/v1/calibrations/${of}/report`);
    save(await answer.blob(), `${of}.html`);
  }

  const jobs = new Jobs(service, "calibration", take);
  jobs.open(async () => {
    // Continue a job that runs; another page may have begun it.
    const running = (await jobs.all()).find((job) => !isOver(job));
    if (running) await follow(running);
  });
  return () => {
    jobs.close();
    plots.close();
  };
}

/** Show the result to people. @param {Record<string, any>} result @param {() => void} save */
function report(result, save) {
  const { verdict, still_open = [], practice, failures = [], untested = [] } = result;
  const heading = el("h2", {}, t.report);
  if (still_open.length) return [heading, el("p", {}, t.open(still_open.length))];
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
  if (failures.length) rows.push([t.failures, bullets(failures)]);
  if (untested.length) rows.push([t.untested, bullets(untested)]);
  rows.push([t.installed, result.installed_for ? t.installedFor(result.installed_for) : t.notInstalled]);
  return [
    heading,
    el("dl.facts", {}, facts(rows)),
    el("div.row", {}, el("button", { type: "button", onclick: save }, t.save)),
  ];
}
