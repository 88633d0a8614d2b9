/** Make a layout: the gallery, regions on the board, the parameters of each, and files to take away. */

import { freeName } from "../arrange.js";
import { Beneath } from "../beneath.js";
import { Board, boxOf, PLACE, placeOf } from "../board.js";
import { layoutIn } from "../archive.js";
import { listen, menuOf } from "../commands.js";
import { el, fill, save } from "../dom.js";
import { schemaOf } from "../form.js";
import { Gallery } from "../gallery.js";
import { Headroom } from "../headroom.js";
import { Panel } from "../panel.js";
import { Regions } from "../regions.js";
import { sentence } from "../service.js";
import { texts } from "../texts.js";
import { choose, view } from "../view.js";

/** @import { App } from "../app.js" */
/** @import { Command } from "../commands.js" */
/** @import { Start } from "../gallery.js" */
/** @import * as m from "../../../../clients/typescript/types/messages.js" */

const t = texts.make;
const GAP_MM = 4;
const CHECKED_MS = 300;
const UNKNOWN_MM = 500;

/** @param {HTMLElement} root @param {App} app */
export function mount(root, app) {
  const { service, history, saved } = app;
  const document_ = root.ownerDocument;
  const board = new Board({ "aria-label": t.board, role: "group" });
  const headroom = new Headroom(board, service);
  const gallery = new Gallery(service, (start) => add(start));
  const regions = new Regions(board, history, {
    choose: () => showPanel(history.current),
    draw: (place) => add({ ...(gallery.chosen ?? t.drawn), ...place }, place),
    refuse: (why) => service.notify("error", why),
  });
  board.onFit = () => {
    regions.place();
    headroom.place();
  };
  /** @type {Panel | null} */
  let panel = null;
  let [checking, checked] = [0, 0];

  const [one, two, three] = [1, 2, 3].map((least) => () => regions.chosen.length >= least);
  /** @type {Command[]} */
  const edits = [
    { name: t.undo, keys: ["Ctrl+Z"], act: () => history.undo(), can: () => Boolean(history.next.undo) },
    { name: t.redo, keys: ["Ctrl+Y", "Ctrl+Shift+Z"], act: () => history.redo(), can: () => Boolean(history.next.redo) },
    { name: t.cut, keys: ["Ctrl+X"], can: one, act: () => {
      regions.copy();
      regions.remove();
    } },
    { name: t.copyRegions, keys: ["Ctrl+C"], can: one, act: () => regions.copy() },
    { name: t.paste, keys: ["Ctrl+V"], act: () => regions.paste() },
    { name: t.duplicate, keys: ["Ctrl+D"], can: one, act: () => regions.duplicate() },
    { name: t.rename, keys: ["F2"], can: one, act: () => document_.getElementById("r-name")?.focus() },
    { name: t.removeRegions, keys: ["Delete", "Backspace"], can: one, act: () => regions.remove() },
    { name: t.chooseAll, keys: ["Ctrl+A"], act: () => regions.choose(history.current.regions.map(({ name }) => name)) },
    { name: t.chooseNone, keys: ["Escape"], can: one, act: () => regions.choose([]) },
    { name: t.group, keys: ["Ctrl+G"], can: two, act: () => regions.group() },
    { name: t.ungroup, keys: ["Ctrl+Shift+G"], can: () => regions.regions.some(({ group }) => group), act: () => regions.ungroup() },
    { name: t.alignLeft, can: two, act: () => regions.align("x", 0) },
    { name: t.alignCentre, can: two, act: () => regions.align("x", 0.5) },
    { name: t.alignRight, can: two, act: () => regions.align("x", 1) },
    { name: t.alignTop, can: two, act: () => regions.align("y", 0) },
    { name: t.alignMiddle, can: two, act: () => regions.align("y", 0.5) },
    { name: t.alignBottom, can: two, act: () => regions.align("y", 1) },
    { name: t.distributeX, can: three, act: () => regions.distribute("x") },
    { name: t.distributeY, can: three, act: () => regions.distribute("y") },
    { name: t.beneath, act: () => picture.click() },
    { name: t.noBeneath, can: () => Boolean(board.beneath), act: () => beneath.remove() },
  ];
  const keep = { name: t.keep, keys: ["Ctrl+S"], is_for_fields: true, act: () => saved.attempt(() => saved.keep()) };
  const undo = el("button", { type: "button", onclick: edits[0].act }, t.undo);
  const redo = el("button", { type: "button", onclick: edits[1].act }, t.redo);
  const beneath = new Beneath();
  const picture = el("input", { type: "file", accept: "image/*", hidden: true, "aria-label": t.beneath, onchange: () => {
    const [file] = picture.files ?? [];
    if (file) void service.attempt(() => beneath.take(file));
    picture.value = "";
  } });
  const grey = el("button", { type: "button", title: t.greyHelp, onclick: () => choose({ is_grey: !view.get().is_grey }) }, t.grey);
  const draws = el("button", { type: "button", title: t.drawHelp, onclick: () => regions.draws.set(!regions.draws.get()) }, t.draw);
  const shows = el("button", {
    type: "button", "aria-pressed": "false", title: t.headroomHelp,
    onclick: () => {
      shows.setAttribute("aria-pressed", String(headroom.toggle()));
      reach.hidden = !headroom.is_shown;
    },
  }, t.headroom);
  const reach = el("p.reach", { hidden: true, role: "status" });
  headroom.summary.on((text) => void (reach.textContent = text));
  const state = el("span.quiet", { role: "status" });
  const helps = el("span");
  /** @type {(() => void)[]} */
  const ends = [];
  const list = el("ol.order", { "aria-label": t.order });
  const parameters = el("section.sheet.parameters", { "aria-label": t.parameters });
  const problem = el("p.told", { role: "alert" });
  const range = el("p.range");
  const several = el("p.range");
  const forms_menu = el("div.menu");
  const exports = el("details.drop-down", {}, el("summary.main", {}, t.export), forms_menu);
  root.append( // the regions first, for who comes by the Tab key; the style has the order that is seen
    el("section.bench", {},
      board.element,
      el("div.row.bar-of", {}, undo, redo, menuOf(t.edit, edits), draws, board.tools(), shows, grey, picture, naming(), exports),
      reach, el("div.hint-of", {}, el("p.quiet", {}, t.hint), el("span", {}, state, " ", helps))),
    gallery.element,
    el("div.side", {}, el("section.sheet", {}, app.guide.element, el("h2", {}, t.order), list), parameters),
  );

  /** Add a region. @param {Start} start @param {Partial<m.RegionDocument>} [place] */
  function add(start, place = {}) {
    const { regions: all } = history.current;
    const name = freeName(start.title, all.map((region) => region.name));
    const { width_mm, height_mm } = start;
    const material = structuredClone(start.document);
    const region = /** @type {m.RegionDocument} */ (JSON.parse(JSON.stringify(
      { name, material, ...freePlace(history.current, width_mm ?? 60, height_mm ?? 40), width_mm, height_mm, ...place })));
    history.change(t.did.add(name), (draft) => void draft.regions.push(region));
    regions.focus(name);
  }

  /** @param {m.LayoutDocument} document */
  function showList(document) {
    const at_focus = [...list.querySelectorAll("button")].findIndex((each) => each === document_.activeElement);
    const in_order = document.regions.map((region, index) => ({ region, index }));
    in_order.sort((a, b) => (b.region.z ?? 0) - (a.region.z ?? 0) || b.index - a.index);
    fill(list, in_order.map(({ region: { name, group } }, at) => el("li", {},
      el("button.small.name", { type: "button", "aria-pressed": String(regions.chosen.includes(name)), title: t.nameHelpOf, onclick: (/** @type {MouseEvent} */ { shiftKey }) => (shiftKey ? regions.toggle(name) : regions.focus(name)) }, name, group ? el("small", {}, ` ${group}`) : null),
      el("button.small", { type: "button", "aria-label": t.up(name), title: t.up(name), disabled: at === 0, onclick: () => lift(in_order, at, -1) }, "↑"),
      el("button.small", { type: "button", "aria-label": t.down(name), title: t.down(name), disabled: at === in_order.length - 1, onclick: () => lift(in_order, at, 1) }, "↓"),
      el("button.small", { type: "button", "aria-label": t.remove(name), title: t.remove(name), onclick: () => regions.remove([name]) }, "×"))));
    list.querySelectorAll("button")[at_focus]?.focus(); // it was made anew
    if (!in_order.length) fill(list, el("li.quiet", {}, t.empty));
  }

  /** Exchange two regions in the order, by their heights.
   * @param {{region: m.RegionDocument}[]} in_order @param {number} at @param {number} by */
  function lift(in_order, at, by) {
    const names = in_order.map(({ region }) => region.name);
    [names[at], names[at + by]] = [names[at + by], names[at]];
    history.change(t.did.order, (draft) => {
      for (const region of draft.regions) region.z = names.length - names.indexOf(region.name);
    });
  }

  /** @param {m.LayoutDocument} document */
  function showPanel(document) {
    const region = regions.regions.at(-1);
    showList(document);
    if (!region || !panel) {
      fill(parameters, el("h2", {}, t.parameters), el("p.quiet", {}, t.choose));
      return;
    }
    if (parameters.dataset.of !== region.name || !panel.element.isConnected) {
      parameters.dataset.of = region.name;
      fill(parameters, el("h2", {}, t.parametersOf(region.name)), several, range, problem, panel.element, placing(region));
      problem.textContent = range.textContent = "";
      parameters.scrollTop = 0;
    }
    several.textContent = regions.chosen.length > 1 ? t.several(regions.chosen.length, region.name) : "";
    panel.show(region.material, region.name);
    for (const [name, input] of Object.entries(places)) {
      if (input !== document_.activeElement) input.value = String(/** @type {any} */ (region)[name] ?? defaults[name]);
    }
    clearTimeout(checking);
    checking = setTimeout(() => void check(region), CHECKED_MS);
  }

  /** Ask how much of the material this screen can give. @param {m.RegionDocument} region */
  async function check(region) {
    const number = ++checked;
    try {
      const answer = await service.rest("POST", "/v1/materials/check", { material: region.material });
      const limits = await answer.json();
      if (number !== checked || ended) return;
      problem.textContent = "";
      range.textContent = t.range(limits.lowest_mu, limits.highest_mu, limits.range_jnd);
      panel?.tell(limits.effects_jnd);
    } catch (error) {
      if (number === checked) problem.textContent = sentence(error);
    }
  }

  /** @type {Record<string, HTMLInputElement>} */
  const places = {};
  const defaults = /** @type {Record<string, any>} */ ({ ...PLACE, width_mm: "", height_mm: "", opacity: 1, z: 0 });

  /** Where the region lies. @param {m.RegionDocument} region */
  function placing({ name }) {
    const fields = Object.keys(defaults).map((key) => {
      const input = el("input", {
        id: `r-${key}`, type: "number", step: "any",
        onchange: () => {
          const value = Number(input.value);
          if (input.value !== "" && input.checkValidity()) change(name, key, value);
        },
      });
      places[key] = input;
      return el("div.field", {}, el("label", { for: input.id }, t.place[key]), input, t.unit[key] ? el("span.unit", {}, t.unit[key]) : null);
    });
    const shape = el("select", { id: "r-shape", onchange: () => change(name, "shape", shape.value) },
      ["rectangle", "ellipse"].map((kind) => el("option", { value: kind, selected: history.current.regions.find((each) => each.name === name)?.shape === kind }, kind)));
    const called = el("input", {
      id: "r-name", type: "text", value: name, maxLength: 100, onfocus: () => called.select(),
      oninput: () => called.setCustomValidity(""),
      onchange: () => {
        const to = called.value.trim();
        const is_taken = to !== name && history.current.regions.some((each) => each.name === to);
        const is_name = to && !/[\p{Cc}\p{Cs}]/u.test(to);
        called.setCustomValidity(is_taken ? t.taken(to) : is_name ? "" : t.noName);
        if (called.reportValidity()) regions.rename(name, to);
      },
      onkeydown: (/** @type {KeyboardEvent} */ event) => {
        if (event.key === "Escape") called.value = name;
        if (!["Enter", "Escape"].includes(event.key)) return;
        called.blur(); // which changes the name
        if (called.validity.valid) regions.focus(called.value.trim());
      },
    });
    return el("details.placing", { open: true }, el("summary", {}, t.placing),
      el("div.field", {}, el("label", { for: called.id }, t.called), called), fields,
      el("div.field", {}, el("label", { for: "r-shape" }, t.shape), shape));
  }

  /** @param {string} name @param {string} key @param {any} value */
  function change(name, key, value) {
    history.change(t.did.place, (draft) => {
      const region = /** @type {any} */ (draft.regions.find((each) => each.name === name));
      if (region) region[key] = value;
    }, `${key} ${name}`);
  }

  /** Change a parameter of the chosen region's material. @param {(string | number)[]} path @param {any} value */
  function changeMaterial(path, value) {
    const name = regions.chosen.at(-1);
    history.change(t.did.parameter, (draft) => {
      const region = draft.regions.find((each) => each.name === name);
      if (!region) return;
      if (!path.length) region.material = value;
      else {
        /** @type {any} */
        const parent = path.slice(0, -1).reduce((part, key) => /** @type {any} */ (part)[key], /** @type {any} */ (region.material));
        const last = /** @type {string} */ (path.at(-1));
        if (value === undefined) delete parent[last];
        else parent[last] = value;
      }
    }, `${path.join(".")} ${name}`);
  }

  /** Give the layout, or a copy, another name; its picture follows. @param {() => Promise<unknown>} act */
  const called = (act, is_copy = false) => saved.attempt(async () => {
    const before = saved.name.get();
    await act();
    await beneath.follow(before, saved.name.get(), is_copy);
  });

  function naming() {
    const input = el("input.title", { type: "text", maxLength: 60, pattern: "[A-Za-z0-9][A-Za-z0-9 _.\\-]*", "aria-label": t.name, title: t.nameHelp,
      onchange: async () => {
        if (input.reportValidity()) await called(() => saved.rename(input.value));
        input.value = saved.name.get();
      } });
    ends.push(saved.name.on((name) => void (input.value = name)));
    const keeps = el("button", { type: "button", title: t.keepHelp, "aria-keyshortcuts": "Control+S", onclick: keep.act }, t.keep);
    const file = el("input", { type: "file", accept: ".zip", hidden: true, "aria-label": t.importFile, onchange: async () => {
      for (const each of file.files ?? []) await saved.attempt(() => openArchive(each));
      file.value = "";
    } });
    const menu = el("div.menu");
    const layouts = el("details.drop-down", { ontoggle: () => layouts.open && void saved.attempt(showLayouts) }, el("summary", {}, t.layouts), menu);

    async function showLayouts() {
      const name = saved.name.get();
      const [names, removed, drafts] = await Promise.all([saved.names(), saved.names(true), saved.drafts()]);
      const versions = saved.revision ? (await saved.versions(name)).slice(1) : [];
      const choice = (/** @type {string} */ text, /** @type {() => Promise<unknown>} */ act) => el("button", { type: "button", onclick: () => {
        layouts.open = false;
        void saved.attempt(act);
      } }, text);
      const list = (/** @type {string} */ title, /** @type {Node[]} */ choices) => choices.length ? [el("h3", {}, title), ...choices] : [];
      fill(menu,
        choice(t.fresh, () => saved.begin()), choice(t.copy, () => called(() => saved.duplicate(), true)), choice(t.importFile, async () => file.click()),
        saved.revision ? choice(t.removeIt(name), () => saved.remove()) : null,
        list(t.kept, names.map((each) => choice(each, () => saved.open(each)))), names.length ? null : el("p.quiet", {}, t.noneKept),
        list(t.versions, versions.map((each) => choice(t.version(each.revision, each.unix_s), () => saved.restore(each)))),
        list(t.drafts, drafts.map((each) => choice(t.draftOf(each.name, each.unix_s), () => saved.openDraft(each.id)))),
        list(t.removedOnes, removed.map((each) => choice(t.bringBack(each), () => saved.bringBack(each)))));
    }
    return el("span.row", {}, input, keeps, layouts, file);
  }

  /** Open a layout that was exported. @param {File} file */
  async function openArchive(file) {
    const { session } = service;
    if (!session) throw new TypeError(texts.state.lost);
    const layout = await layoutIn(file, (asset, suffix) => session.asset(asset, suffix));
    await saved.begin();
    history.change(t.did.add(file.name), (draft) => void (draft.regions = layout.regions));
  }

  /** @param {string[]} forms */
  function showExports(forms) {
    fill(forms_menu, ...forms.map((form) => el("button", {
      type: "button", onclick: () => {
        exports.open = false;
        void service.attempt(() => take(form));
      },
    }, el("b", {}, titleOf(form)), el("small", {}, t.forms[form]?.[1]))));
  }

  const titleOf = (/** @type {string} */ form) => t.forms[form]?.[0] ?? form;

  /** @param {string} form */
  async function take(form) {
    const document = history.current;
    const region = regions.regions.at(-1) ?? document.regions[0];
    if (!region) throw new TypeError(t.empty);
    const { y, height } = placeOf(region);
    state.textContent = t.exporting;
    const answer = await service.rest("POST", "/v1/exports", { document, form, y_mm: y + height / 2, title: saved.name.get() });
    save(await answer.blob(), `${saved.name.get().replaceAll(" ", "-")}-${form}.zip`);
    state.textContent = t.exported(titleOf(form));
  }

  board.element.addEventListener("dragover", (event) => event.preventDefault());
  board.element.addEventListener("drop", (event) => {
    event.preventDefault();
    const name = event.dataTransfer?.getData("text/haptix-preset");
    const preset = gallery.presets.find((preset) => preset.name === name);
    const { x_mm, y_mm } = board.place(event);
    if (preset) add(preset, { x_mm: Math.round(x_mm), y_mm: Math.round(y_mm) });
    else for (const file of event.dataTransfer?.files ?? []) {
      if (file.name.endsWith(".zip")) void saved.attempt(() => openArchive(file));
      else void gallery.take([file]);
    }
  });
  /** @returns {Promise<void>} */
  const loadPanel = () => service.attempt(async () => {
    const schema = await (await service.rest("GET", "/v1/kinds")).json();
    panel = new Panel(schema, changeMaterial);
    showPanel(history.current);
  }, { label: t.tryAgain, act: () => void loadPanel() });

  let ended = false;
  ends.push(
    service.inventory.on((inventory) => {
      // A screen whose profile has no size stands there larger than any.
      board.screen_mm = (inventory && inventory.screen_mm?.some((mm) => mm !== UNKNOWN_MM) && inventory.screen_mm) || null;
      board.draw();
    }),
    listen([...edits, keep]),
    saved.name.on((name) => void service.attempt(() => beneath.open(name))),
    beneath.picture.on((bitmap) => {
      board.beneath = bitmap;
      board.fit();
    }),
    view.on(({ is_grey }) => {
      grey.setAttribute("aria-pressed", String(is_grey));
      board.draw();
    }),
    regions.draws.on((is_on) => draws.setAttribute("aria-pressed", String(is_on))),
    history.document.on((document) => {
      regions.show(document);
      showPanel(document);
      headroom.show(document);
      const { undo: back, redo: again } = history.next;
      [undo.disabled, redo.disabled] = [!back, !again];
      undo.title = back && t.undoes(back);
      redo.title = again && t.redoes(again);
    }),
    saved.state.on((text) => void (state.textContent = text)),
    saved.help.on((help) => fill(helps, help && el("button.small", { type: "button", onclick: () => void saved.attempt(help.act) }, help.label))),
    service.state.on(({ phase }) => {
      if (phase !== "open" || panel) return;
      void loadPanel();
      void service.attempt(async () => showExports((await schemaOf(service, "exports")).properties.form.enum));
      void service.attempt(() => gallery.load());
    }),
  );
  return () => {
    ended = true;
    for (const end of ends) end();
    board.close();
  };
}

/**
 * Return a place beside or below all regions.
 * @param {m.LayoutDocument} document @param {number} width @param {number} height
 */
function freePlace(document, width, height) {
  if (!document.regions.length) return { x_mm: 0, y_mm: 0 };
  const boxes = document.regions.map(placeOf);
  const is_free = (/** @type {number} */ x, /** @type {number} */ y) => boxes.every((box) =>
    x >= box.x + box.width || x + width <= box.x || y >= box.y + box.height || y + height <= box.y);
  const whole = boxOf(document);
  const xs = [0, ...boxes.map((box) => box.x + box.width + GAP_MM)];
  const ys = [0, ...boxes.map((box) => box.y + box.height + GAP_MM)];
  const places_left = ys.flatMap((y) => xs.map((x) => ({ x, y }))).filter(({ x, y }) => is_free(x, y));
  // The one that makes the plane grow least.
  const grows = (/** @type {{x: number, y: number}} */ { x, y }) =>
    Math.max(x + width, whole.left + whole.width) * Math.max(y + height, whole.top + whole.height) + 1e-3 * (x + y);
  places_left.sort((a, b) => grows(a) - grows(b));
  return { x_mm: Math.round(places_left[0].x), y_mm: Math.round(places_left[0].y) };
}
