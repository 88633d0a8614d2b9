/** Tasks of the service without a page of their own: a form for each, its jobs and their results. */

import { el, facts, fill, save } from "../dom.js";
import { taskForm } from "../form.js";
import { isOver, Jobs } from "../jobs.js";
import { texts } from "../texts.js";

/** @import { App } from "../app.js" */
/** @import * as m from "../../../../clients/typescript/types/messages.js" */
/** @typedef {{route: string, kind: string, title: string, help: string}} TaskOf */

/** Kinds of job with a page of their own. */
const ELSEWHERE = ["calibration", "experiment"];
const MOST_ROWS = 200;
/** By the end of a name. @type {Record<string, string>} */
const UNITS = { n: "N", v: "V", hz: "Hz", mm: "mm", m: "m", s: "s", ms: "ms", pa: "Pa", a: "A", c: "C", jnd: "JND", db: "dB" };
const t = texts.tasks;

/** @param {HTMLElement} root @param {App} app */
export function mount(root, app) {
  const { service } = app;
  const list = el("nav.sheet.choose", { "aria-label": t.choose });
  const work = el("div.work");
  let leave = () => {};
  let is_left = false;
  root.append(list, work);
  const end = service.state.on(({ phase }) => {
    if (phase === "open" && !list.children.length) void service.attempt(show);
  });

  async function show() {
    const { paths } = await (await service.rest("GET", "/v1/openapi.json")).json();
    const tasks = tasksOf(paths);
    if (is_left || list.children.length) return;
    const route = location.hash.split("/")[2];
    const chosen = tasks.find((task) => task.route === route) ?? tasks[0];
    fill(list, el("h2", {}, t.choose), tasks.map((task) =>
      el("a", { href: `#/tasks/${task.route}`, "aria-current": task === chosen && "page" }, task.title)));
    leave = open(work, app, chosen);
  }
  return () => {
    is_left = true;
    end();
    leave();
  };
}

/** Return the tasks of a description of the service. @param {Record<string, any>} paths @returns {TaskOf[]} */
function tasksOf(paths) {
  return Object.entries(paths).flatMap(([path, { post }]) => {
    const kind = post?.["x-task"];
    if (!kind || ELSEWHERE.includes(kind)) return [];
    return { kind, route: path.replace("/v1/", ""), title: post.summary, help: post.description.split("\n\n")[0] };
  });
}

/** Show a task's form and jobs; return a function that ends this. @param {HTMLElement} work @param {App} app @param {TaskOf} task */
function open(work, { service, history }, task) {
  const cards = el("div.jobs", { "aria-live": "polite" });
  /** @type {Map<string, Card>} */
  const known = new Map();
  const jobs = new Jobs(service, task.kind, (job) => {
    if (job.trace) return;
    let card = known.get(job.job);
    if (!card) {
      known.set(job.job, (card = new Card(jobs, job)));
      cards.prepend(card.element);
    }
    card.take(job);
  }, task.route);
  /** @type {Record<string, any>} */
  const values = {};
  const form = taskForm(service, task.route, task, async (given) => {
    const job = await jobs.begin(given);
    await jobs.watch(job);
    known.get(job.job)?.element.scrollIntoView({ block: "nearest" });
  }, values,
    { material: () => [materialOf(history.document.get().regions, values)] });
  fill(work, form, cards);
  jobs.open(async () => {
    for (const job of await jobs.all()) await jobs.watch(job);
  });
  return () => jobs.close();
}

/** Return the control of a material: one of a layout's. @param {m.LayoutDocument["regions"]} regions @param {Record<string, any>} values */
function materialOf(regions, values) {
  const choose = () => void (values.material = regions[select.selectedIndex]?.material);
  const select = el("select", { id: "f-material", required: true, onchange: choose },
    regions.map(({ name }) => el("option", {}, name)));
  choose();
  return el("div.field-of", {}, el("label", { for: "f-material" }, t.material), select, el("small", {}, t.materialHelp));
}

/** One job: its progress, its questions, its result. */
class Card {
  element = el("section.sheet.set-up");
  #bar = el("progress", { max: 1, "aria-label": t.progress });
  #began_ms = 0;
  #is_found = false;

  /** @param {Jobs} jobs @param {m.Job} job */
  constructor(jobs, job) {
    this.jobs = jobs;
    this.job = job.job;
  }

  /** @param {m.Job} job */
  take(job) {
    if (this.#is_found) return;
    const { state, share = 0, sentence, result } = job;
    if (state !== "queued") this.#began_ms ||= performance.now();
    this.#bar.value = share;
    const left_s = share && ((performance.now() - this.#began_ms) / 1e3) * (1 / share - 1);
    fill(this.element, el("h2", {}, t.states[state]),
      isOver(job) ? null : this.#bar,
      state === "running" ? el("p.quiet", {}, t.share(share, left_s)) : null,
      state === "asking" ? this.jobs.answerForm(job, t.answer) : null,
      sentence ? el("p.told", { role: "alert" }, sentence) : null,
      isOver(job) ? null : el("div.row", {}, el("button", { type: "button", onclick: () => this.jobs.cancel(job) }, t.end)));
    if (!result) return;
    this.#is_found = true;
    const files = el("div.files");
    this.element.append(...shown(result), files);
    void this.jobs.service.attempt(() => this.#addFiles(files));
  }

  /** Link the files that it has written, and show its pictures. @param {HTMLElement} files */
  async #addFiles(files) {
    const { service } = this.jobs;
    const all = `/v1/jobs/${this.job}/files`;
    /** @type {string[]} */
    const names = await (await service.rest("GET", all)).json();
    const read = async (/** @type {string} */ name) => (await service.rest("GET", `${all}/${name}`)).blob();
    for (const name of names) {
      const last = name.slice(name.lastIndexOf("/") + 1);
      if (last.endsWith(".png")) {
        const src = URL.createObjectURL(await read(name));
        files.append(el("img", { src, alt: last, onload: () => URL.revokeObjectURL(src) }));
      }
      const href = `#/tasks/${last}`;
      const keep = async (/** @type {Event} */ event) => {
        event.preventDefault();
        await service.attempt(async () => save(await read(name), last));
      };
      files.append(el("a", { href, onclick: keep }, last));
    }
  }
}

/** Show a result: numbers and words as a list, lists of rows as tables, the rest as JSON.
 * @param {Record<string, any>} result @returns {HTMLElement[]} */
function shown(result) {
  const plain = Object.entries(result).filter(([, value]) => value === null || typeof value !== "object");
  const others = Object.entries(result).filter(([, value]) => value !== null && typeof value === "object");
  const parts = plain.length ? [el("dl.facts", {}, facts(plain.map(([name, value]) => [titleOf(name), text(value)])))] : [];
  return [...parts, ...others.map(([name, value]) => {
    if (Array.isArray(value) && value.length && value.every((row) => row && typeof row === "object" && !Array.isArray(row))) return table(titleOf(name), value);
    return el("details", {}, el("summary", {}, titleOf(name)), el("pre", { tabIndex: 0 }, JSON.stringify(value, null, 1)));
  })];
}

/** @param {string} caption @param {Record<string, any>[]} rows */
function table(caption, rows) {
  const columns = Object.keys(rows[0]);
  const cells = (/** @type {Record<string, any>} */ row) => columns.map((column) => el("td", {}, text(row[column])));
  return el("div.looking", { tabIndex: 0, role: "group", "aria-label": caption }, el("table", {},
    el("thead", {}, el("tr", {}, columns.map((column) => el("th", { scope: "col" }, titleOf(column))))),
    el("tbody", {}, rows.slice(0, MOST_ROWS).map((row) => el("tr", {}, cells(row))))),
  rows.length > MOST_ROWS ? el("small", {}, t.more(rows.length - MOST_ROWS)) : null);
}

/** @param {string} name */
function titleOf(name) {
  const words = name.split("_");
  const unit = words.length > 1 && UNITS[words[words.length - 1]];
  const title = (unit ? words.slice(0, -1) : words).join(" ");
  return `${title[0].toUpperCase()}${title.slice(1)}${unit ? ` [${unit}]` : ""}`;
}

/** @param {unknown} value */
function text(value) {
  if (typeof value === "number") return String(Number(value.toPrecision(5)));
  if (value === null || value === undefined) return "–";
  return typeof value === "object" ? JSON.stringify(value) : String(value);
}
