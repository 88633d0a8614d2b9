/** The parameters of a material: drawn from the JSON Schema of its kind, with units and help. */

import { el, fill } from "./dom.js";
import { control, json } from "./form.js";
import { texts } from "./texts.js";

/** @import { Schema } from "./form.js" */
/** @typedef {Record<string, any>} Table */
/** @typedef {(path: (string | number)[], value: any) => void} Change */

const t = texts.make;
const LAST = ["low", "high", "target"]; // the level comes after the shape
const FILES = ["file", "heights", "normals"];
const FAMILIES = ["material", "signal"];
/** Kinds that change another material. */
const WRAPS = /** @type {Record<string, (of: Table) => Table>} */ ({
  moving: (of) => ({ kind: "moving", velocity_mm_s: [20, 0], of }),
  "by-speed": (of) => ({ kind: "by-speed", speed_mm_s: [0, 50, 200], share: [0.2, 0.6, 1], of }),
  "by-force": (of) => ({ kind: "by-force", normal_force_n: [0.2, 0.9], share: [0.15, 1], of }),
  envelope: (of) => ({
    kind: "envelope", loop: true, of,
    curve: { kind: "points", t_s: [0, 0.3, 0.6], values_at: [0.1, 1, 0.1] },
  }),
});

/** Return the definition of a kind.
 * @param {Schema} schema @param {string} kind @param {string} [family] @returns {Schema | undefined} */
function definitionOf(schema, kind, family = "material") {
  const ref = schema.$defs?.[family]?.discriminator?.mapping?.[kind];
  return ref && schema.$defs[ref.slice(ref.lastIndexOf("/") + 1)];
}

/** The fields of one material, and of those within it. */
export class Panel {
  element = el("div.panel");
  /** @type {Map<string, HTMLElement>} by the field's name, of the outer material */
  #effects = new Map();
  #drawn = "";
  /** @type {Table} as it is now: controls are drawn once, and values change under them */
  #material = {};
  #schema;
  #change;

  /** @param {Schema} schema @param {Change} change called with the path within the material */
  constructor(schema, change) {
    this.#schema = schema;
    this.#change = change;
  }

  /**
   * Show the material of a region; fields that have the focus stay as they are typed. Another region has controls of
   * its own: those of the last one would keep what this one's material leaves out.
   * @param {Table} material @param {string} region
   */
  show(material, region) {
    this.#material = material;
    const form = JSON.stringify([region, shapeOf(material)]);
    if (form === this.#drawn) return this.#update(material, []);
    this.#drawn = form;
    this.#effects.clear();
    fill(this.element, this.#fields(material, []));
    return undefined;
  }

  /** Say what a step of each field changes [JND]. @param {Record<string, number>} effects */
  tell(effects) {
    for (const [name, element] of this.#effects) {
      const jnd = effects[name];
      element.textContent = jnd === undefined ? "" : t.effect(jnd);
    }
  }

  /** @param {Table} material @param {(string | number)[]} path @param {string} [family] @returns {HTMLElement} */
  #fields(material, path, family = "material") {
    const definition = definitionOf(this.#schema, material.kind, family);
    const title = definition?.title ?? material.kind;
    if (!definition) return el("fieldset", {}, el("legend", {}, title), this.#json(material, path, title));
    const names = Object.keys(definition.properties).filter((name) => !["kind", "schema_version"].includes(name));
    names.sort((a, b) => LAST.indexOf(a) - LAST.indexOf(b));
    return el("fieldset", {},
      el("legend", {}, title), el("p.quiet", {}, plain(definition.description)),
      family === "material" ? this.#wrapping(material, path) : this.#json(material, path, title),
      names.map((name) => this.#field(definition.properties[name], material, [...path, name])));
  }

  /** Buttons that put a material into another, or take it out. @param {Table} material @param {(string | number)[]} path */
  #wrapping(material, path) {
    const kinds = Object.keys(WRAPS).filter((kind) => kind !== material.kind);
    const is_wrap = material.kind in WRAPS && material.of;
    const select = el("select", {
      "aria-label": t.wrap,
      onchange: () => this.#change(path, WRAPS[select.value](this.#at(path))),
    }, el("option", { value: "" }, t.wrap), kinds.map((kind) => el("option", { value: kind }, t.wraps[kind])));
    const as = FILES.find((name) => String(material[name] ?? "").startsWith("sha256:"));
    return el("div.row", {}, select,
      is_wrap ? el("button.small", { type: "button", onclick: () => this.#change(path, this.#at(path).of) }, t.unwrap) : null,
      as && material.width_mm ? this.#reading(material, path, as) : null);
  }

  /** @param {(string | number)[]} path @returns {Table} */
  #at(path) {
    return path.reduce((part, key) => part[key], this.#material);
  }

  /** Buttons for the kinds of material that a picture can become. @param {Table} material @param {(string | number)[]} path @param {string} file name of its field */
  #reading(material, path, file) {
    const field = /** @type {Record<string, string>} */ ({ photograph: "file", relief: "heights", heights: "file" });
    const select = el("select", {
      "aria-label": t.reading,
      onchange: () => {
        const { width_mm, [file]: asset } = this.#at(path);
        this.#change(path, { kind: select.value, [field[select.value]]: asset, width_mm });
      },
    }, Object.keys(field).map((kind) => el("option", { value: kind, selected: kind === material.kind }, t.readings[kind])));
    return select;
  }

  /** @param {Schema} field @param {Table} material @param {(string | number)[]} path */
  #field(field, material, path) {
    const name = String(path.at(-1));
    const value = material[name] ?? field.default;
    const [id, help] = [`p-${path.join("-")}`, plain(field.description)];
    const ways = [field, ...(field.anyOf ?? [])];
    const family = FAMILIES.find((each) => ways.some((way) => way.$ref === `#/$defs/${each}`));
    if (family) {
      if (value && typeof value === "object") return this.#fields(value, path, family);
      if (family === "material" && !ways.some((way) => way.type === "number")) return el("p.quiet", {}, `${field.title}: ${t.noMaterial}`);
    }
    const effect = path.length === 1 ? el("small.effect") : null;
    if (effect) this.#effects.set(name, effect);
    const unit = field["x-unit"] ? el("span.unit", {}, field["x-unit"]) : null;
    const label = el("label", { for: id, title: help }, field.title);
    return el("div.field", { title: help }, label, this.#control(field, value, path, id), unit, effect);
  }

  /** @param {Schema} field @param {any} value @param {(string | number)[]} path @param {string} id */
  #control(field, value, path, id) {
    const change = (/** @type {any} */ to) => this.#change(path, to);
    if (field["x-range"] && (typeof value === "number" || value === undefined)) {
      return this.#number(field, value, change, id);
    }
    const names_file = typeof value === "string" && !field.enum && !field.anyOf?.some((/** @type {Schema} */ way) => way.enum);
    if (names_file) return el("output", { id }, shortened(value));
    return control(field, value, change, id);
  }

  /** @param {Schema} field @param {number | undefined} value @param {(to: number) => void} change @param {string} id */
  #number(field, value, change, id) {
    const [low, high] = field["x-range"];
    const step = field["x-step"];
    const exact = el("input", { id, type: "number", step: "any", value: value ?? "" });
    const slider = el("input", {
      type: "range", min: String(low), max: String(Math.max(high, value ?? high)), step: String(step),
      value: String(value ?? low), tabIndex: -1, "aria-hidden": "true",
      oninput: () => {
        exact.value = slider.value;
        change(Number(slider.value));
      },
    });
    exact.onchange = () => {
      if (exact.value === "" || !exact.checkValidity()) return;
      slider.value = exact.value;
      change(Number(exact.value));
    };
    return el("span.number", {}, slider, exact);
  }

  /** @param {any} value @param {(string | number)[]} path @param {string} title */
  #json(value, path, title) {
    return json(value, (to) => this.#change(path, to), title, `p-${path.join("-")}`);
  }

  /** Put new values into the controls that are there. @param {Table} material @param {(string | number)[]} path */
  #update(material, path) {
    for (const [name, value] of Object.entries(material)) {
      if (value && typeof value === "object" && !Array.isArray(value) && value.kind) this.#update(value, [...path, name]);
      const control = /** @type {any} */ (this.element.querySelector(`[id="p-${[...path, name].join("-")}"]`));
      if (!control || control === document.activeElement) continue;
      if (control.type === "checkbox") control.checked = value;
      else if (control.tagName === "TEXTAREA") control.value = JSON.stringify(value, null, 1);
      else if (Array.isArray(value) && control.type === "text") control.value = value.join(", ");
      else if (control.tagName === "OUTPUT") control.value = shortened(String(value));
      else if (typeof value !== "object") {
        control.value = String(value);
        const slider = control.parentElement?.querySelector("input[type=range]");
        if (slider) slider.value = String(value);
      }
    }
  }
}

/** Return the kinds and the names and types of the fields, which decide which controls there are.
 * @param {any} value @returns {any} */
function shapeOf(value) {
  if (Array.isArray(value)) return value.every((item) => typeof item === "number") ? "row" : value;
  if (!value || typeof value !== "object") return typeof value;
  const entries = Object.entries(value).map(([key, part]) => [key, key === "kind" ? part : shapeOf(part)]);
  return Object.fromEntries(entries.filter(([key, part]) => key === "kind" || key === "of" || part === "row" || typeof part === "object"));
}

/** Return the begin of a file's hash, or another text whole. @param {string} text */
function shortened(text) {
  return text.replace(/^(sha256:.{6}).*/, "$1…");
}

/** Remove the marks of Python's documentation from a text. @param {string | undefined} text */
function plain(text = "") {
  return text.replaceAll("`", "").replaceAll(/; see haptix[\w.]*/g, "").replaceAll(/ see haptix[\w.]*\.?/g, "");
}
