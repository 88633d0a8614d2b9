/** An experiment with a participant: instructions, practice, trials, pauses; a second page watches. */

import { el, fill } from "../dom.js";
import { EXPERIMENTS, practiceOf } from "../experiments.js";
import { taskForm } from "../form.js";
import { isOver, Jobs } from "../jobs.js";
import { texts } from "../texts.js";

/** @import { App } from "../app.js" */
/** @import { Values } from "../form.js" */
/** @import { Job } from "../../../../clients/typescript/types/messages.js" */

const t = texts.sit;
const REST_EVERY = 20; // if the recipe does not say
const CONTINUE = "continue"; // the one answer to a rest
const NO = "no"; // or "yes", to continue an earlier session

/** @param {HTMLElement} root @param {App} app */
export function mount(root, app) {
  const { service } = app;
  let ended = false;
  /** @type {Job | null} the job that this page began */
  let job_here = null;
  /** @type {((job: Job, goes_on: boolean) => void) | null} */
  let follow = null;
  /** @type {Map<string, {job: Job, trials: number, at_ms: number}>} what the second page shows */
  const seen = new Map();
  const keys = new AbortController();
  const stage = el("div.stage", { hidden: true, role: "region", "aria-label": t.participant });
  const looking = el("div.looking");
  root.append(setUp(), el("section.sheet", {}, el("h2", {}, t.running), looking), stage);

  function setUp() {
    const which = el("select", { id: "which" },
      Object.keys(EXPERIMENTS).map((name) => el("option", { value: name }, t.experiments[name] ?? name)),
      el("option", { value: "" }, t.ownRecipe));
    const file = el("input", { id: "recipe", type: "file", accept: ".json" });
    const recipe_field = el("div.field-of", { hidden: true }, el("label", { for: "recipe" }, t.recipe), file, el("small", {}, t.recipeHelp));
    which.onchange = () => void (recipe_field.hidden = which.value !== "");
    const practice = el("input", { id: "practice", type: "checkbox", checked: true });
    return taskForm(service, "experiments", t, async (values) => {
      try {
        const recipe = which.value ? EXPERIMENTS[which.value] : JSON.parse(await (file.files?.[0]?.text() ?? Promise.reject(new TypeError(t.noRecipe))));
        await document.documentElement.requestFullscreen?.().catch(() => {}); // as large as it can be
        await participant({ ...values, recipe }, practice.checked && !recipe.practice);
      } finally {
        leave();
      }
    }, { log: `participant-${new Date().toISOString().slice(0, 10)}` }, {
      recipe: [el("div.field-of", {}, el("label", { for: "which" }, t.experiment), which), recipe_field],
    }, {
      fields: [el("label.check", {}, practice, t.practice)],
      links: [el("a", { href: "#/sit", target: "_blank" }, t.second)],
    });
  }

  /** @param {Values} values of the task @param {boolean} practises */
  async function participant(values, practises) {
    const { recipe, log } = values;
    stage.hidden = false;
    await screen(t.instructions(recipe.task ?? "2ifc"), t.ready);
    if (practises) {
      await run({ ...values, recipe: practiceOf(recipe), log: `${log}-practice` });
      await screen([t.practised], t.ready);
    }
    const result = await run(values);
    await screen([t.thanks, t.trials(Number(result?.trials ?? 0))], t.finish);
  }

  function leave() {
    stage.hidden = true;
    fill(stage);
    follow = null;
    job_here = null;
    if (document.fullscreenElement) void document.exitFullscreen();
  }

  /** Show sentences until the button or the space bar is pressed. @param {string[]} lines @param {string} button */
  function screen(lines, button) {
    return new Promise((resolve) => {
      const go = el("button.main.large", { type: "button", onclick: () => resolve(undefined) }, button);
      fill(stage, el("div.card", {}, lines.map((line) => el("p", {}, line)), go));
      go.focus();
    });
  }

  /** Run a recipe; return its result. @param {Values} values @returns {Promise<Job["result"]>} */
  async function run(values) {
    const { recipe } = values;
    fill(stage, el("div.card", {}, el("p", { role: "status" }, t.prepares)));
    const begun = await jobs.begin(values);
    let trials = 0;
    return new Promise((resolve, reject) => {
      follow = async (job, goes_on) => {
        job_here = job;
        if (job.state === "asking") {
          const rests = job.choices?.[0] === CONTINUE;
          const tires = !recipe.break_every && trials && trials % REST_EVERY === 0;
          if (rests || tires) await screen([t.rest(trials)], t.goOn);
          if (rests) return jobs.answer(job, CONTINUE);
          if (job.choices?.[0] === NO) return ask(job, job.prompt ?? "");
          trials += 1;
          ask(job, t.tasks[recipe.task ?? "2ifc"][1], trials);
        } else if (job.state === "running") {
          // Whether the last answer was right, if the recipe says so.
          const told_so = goes_on ? { right: t.right, wrong: t.wrong }[job.step ?? ""] : null;
          fill(stage, el("div.card", {}, told_so ? el("p", { role: "status" }, told_so) : null, el("p.large", { role: "status" }, t.feel), el("p.quiet", {}, t.feelHelp)));
        } else if (job.state === "done") resolve(job.result);
        else if (isOver(job)) reject(new Error(job.sentence || t.stopped));
      };
      job_here = begun;
      void service.attempt(() => jobs.watch(begun));
    });
  }

  /** @param {Job} job @param {string} words @param {number} [trial] none for what is asked beside trials */
  function ask(job, words, trial) {
    const answer = (/** @type {string} */ text) => jobs.answer(job, text);
    const { choices = [] } = job;
    const question = el("p.large", { role: "status" }, words);
    if (!choices.length) {
      const number = el("input.large", { type: "number", min: "1e-6", step: "any", required: true, "aria-label": t.number });
      const form = el("form.card", { onsubmit: (/** @type {Event} */ event) => {
        event.preventDefault();
        answer(number.value);
      } }, question, number, el("button.main.large", {}, t.give), el("p.quiet", {}, t.trialOf(trial ?? 0)));
      fill(stage, form);
      number.focus();
      return;
    }
    const buttons = choices.map((choice) =>
      el("button.choice", { type: "button", "data-key": choice, onclick: () => answer(choice) },
        el("b", {}, choice), t.choices[choice] ?? ""));
    const card = el("div.card", { tabIndex: -1 }, question,
      el("div.choices", {}, buttons), trial ? el("p.quiet", {}, t.trial(trial)) : null);
    fill(stage, card);
    card.focus(); // on neither: a space bar that is pressed by habit is no answer
  }

  /** @param {Job} job */
  function take(job) {
    if (ended) return;
    const before = seen.get(job.job);
    const is_new = job.state === "asking" && before?.job.state !== "asking" && ![CONTINUE, NO].includes(job.choices?.[0] ?? "");
    seen.set(job.job, { job, trials: (before?.trials ?? 0) + (is_new ? 1 : 0), at_ms: performance.now() });
    if (job_here?.job === job.job && (before?.job.state !== job.state || job.state === "running")) {
      void follow?.(job, before?.job.state === job.state);
    }
    look();
  }

  function look() {
    const rows = [...seen.values()].map(({ job, trials }) =>
      el("tr", {}, el("td", {}, t.states[job.state] ?? job.state), el("td", {}, String(job.result?.trials ?? trials)),
        el("td", {}, job.sentence || thresholdOf(job)),
        el("td", {}, isOver(job) ? null : el("button.small", { type: "button", onclick: () => jobs.cancel(job) }, t.end))));
    if (!rows.length) fill(looking, el("p.quiet", {}, t.none));
    else fill(looking, el("table", {}, el("thead", {}, el("tr", {}, t.columns.map((name) => el("th", { scope: "col" }, name)))), el("tbody", {}, rows)));
  }

  /** @param {Job} job */
  function thresholdOf({ result }) {
    if (!result || result.threshold_db === null || result.threshold_db === undefined) return "";
    return t.threshold(Number(result.threshold_db), Number(result.low_db), Number(result.high_db));
  }

  addEventListener("keydown", (event) => {
    if (stage.hidden || event.repeat) return;
    const choice = /** @type {HTMLElement | null} */ (stage.querySelector(`[data-key="${CSS.escape(event.key)}"]`));
    if (choice) choice.click();
  }, { signal: keys.signal });

  /** Show jobs that others began, too. */
  async function findJobs() {
    for (const job of await jobs.all()) if (!seen.has(job.job)) await jobs.watch(job);
    look();
  }
  const jobs = new Jobs(service, "experiment", take);
  jobs.open(findJobs);
  const timer = setInterval(() => {
    if (service.state.get().phase === "open" && stage.hidden) void findJobs().catch(() => {});
  }, 2000);
  look();
  return () => {
    ended = true;
    clearInterval(timer);
    keys.abort();
    jobs.close();
    if (job_here && !isOver(job_here)) void service.rest("DELETE", `/v1/jobs/${job_here.job}`).catch(() => {});
  };
}
