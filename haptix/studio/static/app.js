/** The frame of the pages: header, state, STOP, pairing, messages, and which page is shown. */

import { History, Layout, START } from "./document.js";
import { el, fill } from "./dom.js";
import { picturesFrom } from "./pictures.js";
import { sentence, Service } from "./service.js";
import { texts } from "./texts.js";
import { choose, view } from "./view.js";

/** @import { Notice } from "./service.js" */
/** @import * as m from "../../../clients/typescript/types/messages.js" */

/**
 * What a page gets.
 * @typedef {object} App
 * @property {Service} service
 * @property {History<m.LayoutDocument>} history the layout that is edited and felt
 * @property {Layout} layout what the service has of it
 */

/** @typedef {{mount: (root: HTMLElement, app: App) => (() => void)}} Page `mount` returns what ends it */
/** @typedef {{path: string, load: () => Promise<Page>}} Entry */

/** @type {Entry[]} the first one opens at a bare start; its title is `texts.pages[path]` */
const PAGES = [
  { path: "play", load: () => import("./pages/play.js") },
  { path: "make", load: () => import("./pages/make.js") },
  { path: "screens", load: () => import("./pages/screens.js") },
  { path: "calibrate", load: () => import("./pages/calibrate.js") },
  { path: "sit", load: () => import("./pages/sit.js") },
];
const NOTICE_MS = 8000;
const service = new Service();
const history = new History(START);
/** @type {App} */
const app = { service, history, layout: new Layout(service, history) };
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
    if (number !== shown) return; // another one was asked for meanwhile
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
    const does = service.isArming.get() ? "arming" : (out?.state ?? "off");
    const state = phase !== "open" ? phase : others ? "observing" : does;
    whole.dataset.state = state;
    const name = service.isReal ? out?.device : texts.state.virtual;
    fill(word, texts.state[state], state === "armed" && name ? el("small", {}, ` · ${name}`) : null);
    word.title = out?.reason ?? "";
    const armed = out?.state === "armed" && !others;
    button.hidden = phase !== "open" || state === "arming";
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

/** What is wrong with service or driver, and what to do; it stays until that is mended. */
function trouble() {
  const text = el("p");
  const whole = el("div.trouble", { role: "alert", hidden: true }, text);
  const draw = () => {
    const { phase } = service.state.get();
    const out = service.output.get();
    const failed = phase === "open" && service.isReal && out?.state === "failed" && !service.isArming.get();
    const trouble_text = phase === "lost" ? texts.trouble.lost : failed ? texts.trouble.failed(out.reason) : "";
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
  return button;
}

/** The button of another site, so of another process: it works while this page's script hangs. */
function stop() {
  const other = location.hostname === "127.0.0.1";
  const src = other ? `http://localhost:${location.port}/stop` : "/stop";
  return el("iframe.stop", { src, title: texts.frame.stop });
}

/** Ask for the code while there is no token. */
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
      // Not modal: STOP beside it must stay in reach.
      dialog.show();
      code.focus();
    } else if (phase !== "pair" && dialog.open) dialog.close();
    main.inert = phase === "pair";
  });
  return dialog;
}

/** Messages that go by themselves; errors stay until they are closed. */
function notices() {
  const list = el("div.notices", { role: "log", "aria-label": texts.frame.notices });
  service.notices.on((all) => {
    for (const notice of all.slice(all.findIndex((each) => each === seen) + 1)) add(notice);
    seen = all.at(-1) ?? seen;
  });
  /** @param {Notice} notice */
  function add({ kind, sentence: text }) {
    const same = [...list.children].find((each) => each.firstChild?.textContent === text);
    same?.remove();
    const close = el("button.small", { type: "button", "aria-label": texts.frame.close }, "×");
    const shownNotice = el("div.notice", {}, el("span", {}, text), close);
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

addEventListener("keydown", (event) => {
  if (event.key === "Escape") void service.attempt(() => service.stop());
});
// A page that is left or loaded again gives the lease back; else it is kept for its return.
addEventListener("pagehide", () => void service.session?.ask("bye").catch(() => {}));
addEventListener("hashchange", () => void route());
document.body.prepend(header(), trouble(), main, pairing(), notices());
picturesFrom(service);
void service.start();
void route();
