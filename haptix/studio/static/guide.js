/** The first visit: five steps to one's own layout; a step ends when the person has done it. */

import { el, fill, store, stored } from "./dom.js";
import { texts } from "./texts.js";

/** @import { App } from "./app.js" */

const t = texts.guide;
const KEY = "haptix.guide"; // the steps that are done, in this browser
const STEPS = /** @type {const} */ (["add", "move", "turn", "feel", "keep"]);

/** Shows the next step, until all are done or the person ends the guide. @param {Omit<App, "guide">} app */
export function guide({ service, history, saved }) {
  const done = new Set(stored(KEY).split(" "));
  const element = el("section.guide", { "aria-label": t.title });
  const does = (/** @type {string} */ step) => {
    if (done.has(step)) return;
    done.add(step);
    store(KEY, [...done].join(" ").trim());
    show();
  };
  const show = () => {
    const step = STEPS.find((one) => !done.has(one));
    element.hidden = done.has("ended");
    fill(element,
      el("p", { role: "status" }, el("strong", {}, step ? t.step(STEPS.indexOf(step) + 1) : t.title), " ", step ? t.steps[step] : t.yours),
      el("div.row", {},
        step && el("a", { href: step === "feel" ? "#/play" : "#/make" }, t.there),
        step && el("button.small", { type: "button", onclick: () => does(step) }, t.skip),
        el("button.small", { type: "button", onclick: () => does("ended") }, t.end)));
  };
  const { did } = texts.make;
  history.document.on(() => {
    const { undo } = history.next;
    if (undo.startsWith(did.add(""))) does("add");
    if (undo === did.move || undo === did.place) does("move");
    if (undo === did.parameter) does("turn");
  });
  service.onContact(({ event }) => event === "enter" && does("feel"));
  saved.state.on((text) => text.startsWith(texts.make.saved("")) && does("keep"));
  show();
  return { element };
}
