/** The frame of the pages: header, state, STOP, pairing, messages, and which page is shown. */

import { History, Layout, START } from "./document.js";
import { el, fill, save, store, stored } from "./dom.js";
import { guide } from "./guide.js";
import { picturesFrom } from "./pictures.js";
import { SavedLayout } from "./saved.js";
import { sentence, Service } from "./service.js";
import { texts } from "./texts.js";
import { choose, view } from "./view.js";

/** @import { Notice } from "./service.js" */
/** @import * as m from "../../../clients/typescript/types/messages.js" */

/**
 * The objects that a page gets.
 * @typedef {object} App
 * @property {Service} service
 * @property {History<m.LayoutDocument>} history the layout that is edited and felt
 * @property {SavedLayout} saved its drafts, and what is kept
 * @property {Layout} layout its copy on the service, which is felt
 * @property {{element: HTMLElement}} guide of the first visit
 */

/** @typedef {{mount: (root: HTMLElement, app: App) => (() => void)}} Page `mount` returns a function that ends it */
/** @typedef {{path: string, load: () => Promise<Page>}} Entry */

/** @type {Entry[]} the first one opens at a bare start; its title is `texts.pages[path]` */
const PAGES = [
  { path: "play", load: () => import("./pages/play.js") },
  { path: "make", load: () => import("./pages/make.js") },
  { path: "screens", load: () => import("./pages/screens.js") },
  { path: "calibrate", load: () => import("./pages/calibrate.js") },
  { path: "sit", load: () => import("./pages/sit.js") },
  { path: "tasks", load: () => import("./pages/tasks.js") },
];
const NOTICE_MS = 8000;
const [FAULTS, MOST_FAULTS] = ["haptix.faults", 20];
const STOP_KEY = "F8"; // as stop.html shows it
const service = new Service();
const history = new History(START);
const parts = { service, history, saved: new SavedLayout(service, history), layout: new Layout(service, history) };
/** @type {App} */
const app = { ...parts, guide: guide(parts) };
const main = el("main", { id: "main", tabIndex: -1 });
/** @type {() => void} */
let leave = () => {};
let shown = 0;

/** Show the page that the address names. */
async function route() {
  const path = location.hash.replace(/^#\//, "").split("/")[0];
  const entry = PAGES.find((page) => page.path === path) ?? PAGES[0];
  const number = ++shown;
  leave();
  leave = () => {};
  fill(main, el("p.quiet", {}, texts.frame.loading));
  const title = texts.pages[/** @type {keyof typeof texts.pages} */ (entry.path)];
  document.title = `${title} · ${texts.name}`;
  for (const link of document.querySelectorAll("nav a")) {
    const here = link.getAttribute("href") === `#/${entry.path}`;
    if (here) link.setAttribute("aria-current", "page");
    else link.removeAttribute("aria-current");
  }
  try {
    const page = await entry.load();
    if (number !== shown) return; // another page was requested meanwhile
    fill(main, el("h1.unseen", {}, title));
    main.className = entry.path;
    leave = page.mount(main, app);
  } catch (error) {
    fill(main, el("p", { role: "alert" }, `${texts.frame.failed} ${sentence(error)}`));
  }
}

function header() {
  const links = PAGES.map(({ path }) =>
    el("a", { href: `#/${path}` }, texts.pages[/** @type {keyof typeof texts.pages} */ (path)]),
  );
  return el(
    "header",
    {},
    el("a.skip", { href: "#main", onclick: skip }, texts.frame.skip),
    el("a.brand", { href: "#/play" }, "haptix"),
    el("nav", { "aria-label": texts.frame.pages }, links),
    output(),
    theme(),
    stop(),
  );
}

/** @param {Event} event */
function skip(event) {
  event.preventDefault();
  main.focus();
}

/** What the output does, and the button that changes it. */
function output() {
  const word = el("span.word", { role: "status" });
  const button = el("button.small", { type: "button" });
  const whole = el("div.output", {}, el("span.dot", { "aria-hidden": "true" }), word, button);
  const draw = () => {
    const { phase } = service.state.get();
    const [out, lease] = [service.output.get(), service.lease.get()];
    const others = lease !== null && lease.holder !== null && !lease.is_mine;
    const held = out?.paused ? "paused" : out?.muted || out?.person_muted ? "muted" : "armed";
    const played = out?.state === "armed" ? held : (out?.state ?? "off");
    const does = out?.lent_to ? "lent" : service.isArming.get() ? "arming" : played;
    const state = phase !== "open" ? phase : others && !out?.lent_to ? "observing" : does;
    whole.dataset.state = state;
    const device = service.isReal ? out?.device : texts.state.virtual;
    const more = { armed: device, lent: out?.lent_to, observing: texts.state[played].toLowerCase() };
    const name = more[/** @type {keyof typeof more} */ (state)];
    fill(word, texts.state[state], name ? el("small", {}, ` · ${name}`) : null);
    word.title = out?.reason ?? "";
    const armed = out?.state === "armed" && !others;
    button.hidden = phase !== "open" || state === "arming" || state === "lent";
    button.textContent = others ? texts.frame.takeOver : armed ? texts.frame.disarm : texts.frame.arm;
    button.title = armed ? "" : texts.frame.armHelp;
    button.onclick = () =>
      void service.attempt(() => (armed ? service.disarm() : service.arm(!lease?.is_mine)));
  };
  const { state, isArming, lease, inventory } = service;
  for (const value of [state, service.output, isArming, lease, inventory]) {
    /** @type {import("./dom.js").Value<any>} */ (value).on(draw);
  }
  return whole;
}

/** Fault of the service or the driver, and what to do; it stays until the fault is repaired. */
function trouble() {
  const text = el("p");
  const whole = el("div.trouble", { role: "alert", hidden: true }, text);
  const draw = () => {
    const { phase } = service.state.get();
    const out = service.output.get();
    const at = phase === "open" && out && !service.isArming.get() ? out.state : "off";
    const shown = at === "gone" || (service.isReal && (at === "failed" || at === "back")) ? at : null;
    const trouble_text = phase === "lost" ? texts.trouble.lost : shown ? texts.trouble[shown](out?.reason ?? "") : "";
    whole.hidden = !trouble_text;
    if (text.textContent !== trouble_text) text.textContent = trouble_text;
  };
  for (const value of [service.state, service.output, service.isArming]) {
    /** @type {import("./dom.js").Value<any>} */ (value).on(draw);
  }
  return whole;
}

function theme() {
  const order = /** @type {const} */ (["system", "light", "dark"]);
  const button = el("button.small.theme", {
    type: "button",
    onclick: () => choose({ theme: order[(order.indexOf(view.get().theme) + 1) % 3] }),
  });
  view.on(({ theme }) => {
    document.documentElement.dataset.theme = theme;
    button.textContent = { system: "◐", light: "○", dark: "●" }[theme];
    button.title = texts.frame.theme[theme];
    button.setAttribute("aria-label", texts.frame.theme[theme]);
  });
  // What is drawn on canvases has the colours of its time.
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => view.set({ ...view.get() }));
  return button;
}

/** The button is of another site, so of another process: it works while this page's script hangs. */
function stop() {
  const other = location.hostname === "127.0.0.1";
  const src = other ? `http://localhost:${location.port}/stop` : "/stop";
  return el("iframe.stop", { src, title: texts.frame.stop });
}

/** Ask for the pairing code while there is no token. */
function pairing() {
  const code = el("input", {
    id: "code", autocomplete: "off", spellcheck: false, maxLength: 9, size: 10, required: true,
    autocapitalize: "characters",
  });
  const problem = el("p.told", { role: "alert" });
  const show = el("button", {
    type: "button",
    onclick: async () => {
      try {
        await service.showCode();
        problem.textContent = texts.pair.shown;
      } catch (error) {
        problem.textContent = sentence(error);
      }
      code.focus();
    },
  }, texts.pair.show);
  const form = el(
    "form",
    {
      method: "dialog",
      onsubmit: async (/** @type {SubmitEvent} */ event) => {
        event.preventDefault();
        try {
          await service.pair(code.value);
          code.value = "";
        } catch (error) {
          problem.textContent = sentence(error);
          code.select();
        }
      },
    },
    el("h1", { id: "who" }, texts.pair.title),
    el("p", {}, texts.pair.why),
    el("label", { for: "code" }, texts.pair.code),
    el("div.row", {}, code, el("button.main", {}, texts.pair.enter)),
    el("p.quiet", {}, texts.pair.hint),
    show,
    problem,
  );
  const dialog = el("dialog.pair", { "aria-labelledby": "who" }, form);
  dialog.addEventListener("cancel", (event) => event.preventDefault());
  service.state.on(({ phase, reason }) => {
    if (phase === "pair" && !dialog.open) {
      problem.textContent = reason;
      // Not modal, so that STOP beside it can be pressed.
      dialog.show();
      code.focus();
    } else if (phase !== "pair" && dialog.open) dialog.close();
    main.inert = phase === "pair";
  });
  return dialog;
}

/** Messages that disappear by themselves, and errors, which stay until they are closed. */
function notices() {
  const list = el("div.notices", { role: "log", "aria-label": texts.frame.notices });
  service.notices.on((all) => {
    for (const notice of all.slice(all.findIndex((each) => each === seen) + 1)) add(notice);
    seen = all.at(-1) ?? seen;
  });
  /** @param {Notice} notice */
  function add({ kind, sentence: text, help }) {
    const same = [...list.children].find((each) => each.firstChild?.textContent === text);
    same?.remove();
    const close = el("button.small", { type: "button", "aria-label": texts.frame.close }, "×");
    const shownNotice = el("div.notice", {}, el("span", {}, text),
      help && el("button.small", { type: "button", onclick: help.act }, help.label), close);
    shownNotice.dataset.kind = kind;
    close.onclick = () => shownNotice.remove();
    list.append(shownNotice);
    while (list.children.length > 3) list.firstChild?.remove();
    if (kind !== "error") setTimeout(() => shownNotice.remove(), NOTICE_MS);
  }
  return list;
}
/** @type {Notice | undefined} */
let seen;

/** Close the menus that are open but not around `target`. @param {EventTarget | null} target */
function closeMenus(target) {
  const open = /** @type {HTMLDetailsElement[]} */ ([...document.querySelectorAll("details.drop-down[open]")]);
  const closed = open.filter((menu) => !menu.contains(/** @type {Node | null} */ (target)));
  for (const menu of closed) {
    if (menu.contains(document.activeElement)) menu.querySelector("summary")?.focus();
    menu.open = false;
  }
  return closed.length > 0;
}

/** Show an exception and keep it for a report; each sentence is shown once a visit. @param {unknown} error */
function fault(error) {
  const why = sentence(error);
  if (faults.has(why)) return;
  faults.add(why);
  const stack = error instanceof Error ? error.stack : "";
  const all = [...JSON.parse(stored(FAULTS) || "[]"), { sentence: why, stack, page: location.hash, at: new Date() }];
  store(FAULTS, JSON.stringify(all.slice(-MOST_FAULTS)));
  const act = () => save(new Blob([`{"browser": ${JSON.stringify(navigator.userAgent)}, "faults": ${stored(FAULTS)}}`]), "haptix-report.json");
  service.notify("error", texts.frame.fault(why), { label: texts.frame.report, act });
}
const faults = new Set();

addEventListener("error", ({ error }) => void (error && fault(error))); // else it is no exception
addEventListener("unhandledrejection", ({ reason }) => fault(reason));
addEventListener("pointerdown", ({ target }) => void closeMenus(target), { capture: true });
addEventListener("keydown", (event) => {
  if (event.key === STOP_KEY) void service.attempt(() => service.stop());
  else if (event.key === "Escape" && closeMenus(null)) event.preventDefault(); // a page would act on it too
});
// A page that is left or loaded again gives the lease back; else the service keeps it for its return.
addEventListener("pagehide", () => void service.session?.ask("bye").catch(() => {}));
addEventListener("hashchange", () => void route());
document.body.prepend(header(), trouble(), main, pairing(), notices());
picturesFrom(service);
void service.start();
void route();
