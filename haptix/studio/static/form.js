/** Controls and forms drawn from JSON Schema: of materials, and of the tasks that the service declares. */

import { el, fill } from "./dom.js";
import { sentence } from "./service.js";
import { texts } from "./texts.js";

/** @import { Child } from "./dom.js" */
/** @import { Service } from "./service.js" */
/** @typedef {Record<string, any>} Schema */
/** @typedef {Record<string, any>} Values */

const t = texts.form;

/** Return the schema of the body of a route. @param {Service} service @param {string} route @returns {Promise<Schema>} */
export async function schemaOf(service, route) {
  const { paths, components } = await (await service.rest("GET", "/v1/openapi.json")).json();
  const { $ref } = paths[`/v1/${route}`].post.requestBody.content["application/json"].schema;
  return components.schemas[$ref.slice($ref.lastIndexOf("/") + 1)];
}

/**
 * Return a form that begins a task: a field for each parameter in the order of declaration, required
 * ones first.
 * @param {Service} service
 * @param {string} route
 * @param {{title: string, help: string}} head
 * @param {(values: Values) => Promise<unknown>} begin
 * @param {Values} [values] initial values of fields, in place of the defaults
 * @param {Record<string, Child[] | (() => Child[])>} [own] the page's own controls, by parameter
 * @param {{fields?: Child[], links?: Child[]}} [more] the page's children below the fields and beside the button
 */
export function taskForm(service, route, head, begin, values = {}, own = {}, more = {}) {
  const problem = el("p.told", { role: "alert" });
  const form = el("form.sheet.set-up", {
    onsubmit: async (/** @type {SubmitEvent} */ event) => {
      event.preventDefault();
      problem.textContent = "";
      try {
        await begin(values);
      } catch (error) {
        problem.textContent = sentence(error);
      }
    },
  });
  void service.attempt(async () => {
    const { properties, required = [] } = await schemaOf(service, route);
    const names = Object.keys(properties).sort((one, other) => Number(required.includes(other)) - Number(required.includes(one)));
    const fields = names.flatMap((name) => {
      const field = properties[name];
      const parts = own[name];
      if (parts) return typeof parts === "function" ? parts() : parts;
      values[name] ??= field.default ?? (required.includes(name) ? field.examples?.[0] : undefined);
      const input = control(field, values[name], (to) => (values[name] = to), `f-${name}`);
      if (input instanceof HTMLInputElement && input.type === "checkbox") return el("label.check", {}, input, field.title);
      if (input instanceof HTMLInputElement) input.required = required.includes(name) || typeof field.default === "number";
      const label = el("label", { for: `f-${name}` }, field.title, field["x-unit"] ? ` [${field["x-unit"]}]` : null);
      return el("div.field-of", {}, label, input, field.description ? el("small", {}, field.description) : null);
    });
    fill(form, el("h2", {}, head.title), el("p", {}, head.help), ...fields, ...(more.fields ?? []), problem,
      el("div.row", {}, el("button.main", {}, t.begin), ...(more.links ?? [])));
  });
  return form;
}

/**
 * Return the control of a value.
 * @param {Schema} field @param {any} value @param {(to: any) => void} change @param {string} id
 * @returns {HTMLElement}
 */
export function control(field, value, change, id) {
  /** @type {Schema[]} */
  const ways = [field, ...(field.anyOf ?? [])];
  const way = (/** @type {string[]} */ ...types) => ways.find(({ type }) => types.includes(type));
  // Texts with examples are names that the service knows.
  const choices = ways.find((each) => each.enum)?.enum ?? (way("string") && !way("array") && field.examples);
  if (choices) {
    const none = way("null") ? [el("option", { value: "" }, t.usual)] : [];
    const select = el("select", { id, onchange: () => change(select.value || undefined) },
      none, choices.map((/** @type {string} */ choice) => el("option", { value: choice, selected: choice === value }, choice)));
    return select;
  }
  if (way("boolean") && typeof value !== "object") {
    const box = el("input", { id, type: "checkbox", checked: Boolean(value), onchange: () => change(box.checked) });
    return box;
  }
  const words = way("array")?.items?.type === "string";
  if (words && (value ?? []).every((/** @type {any} */ item) => typeof item === "string")) {
    const input = el("input", {
      id, type: "text", value: (value ?? []).join(", "),
      onchange: () => change(input.value.split(",").map((word) => word.trim()).filter(Boolean)),
    });
    return input;
  }
  const number = way("number", "integer");
  if (number && typeof (value ?? 0) === "number") {
    const { type, minimum, maximum } = number;
    const input = el("input", {
      id, type: "number", step: type === "integer" ? "1" : "any", min: minimum, max: maximum, value: value ?? "",
      onchange: () => change(input.value === "" ? undefined : Number(input.value)),
    });
    return input;
  }
  if (Array.isArray(value) ? value.every((item) => typeof item === "number") : ["number", "integer"].includes(way("array")?.items?.type)) {
    const input = el("input.row-of", {
      id, type: "text", value: (value ?? []).join(", "),
      onchange: () => {
        const numbers = input.value.split(/[\s,;]+/).filter(Boolean).map(Number);
        if (numbers.some(Number.isNaN)) input.setCustomValidity(t.numbers);
        else change(numbers);
        input.reportValidity();
      },
      oninput: () => input.setCustomValidity(""),
    });
    return input;
  }
  const text = way("string");
  if (text && typeof (value ?? "") === "string") {
    const input = el("input", {
      id, type: "text", pattern: text.pattern?.replace(/^\^|\$$/g, ""), value: value ?? "",
      onchange: () => change(input.value || undefined),
    });
    return input;
  }
  return json(value, change, field.title, id);
}

/** A control for all other values: a text field with their JSON.
 * @param {any} value @param {(to: any) => void} change @param {string} title @param {string} id */
export function json(value, change, title, id) {
  const area = el("textarea", {
    id, rows: 4, spellcheck: false, "aria-label": title,
    value: value === undefined ? "" : JSON.stringify(value, null, 1),
    onchange: () => {
      try {
        change(area.value.trim() ? JSON.parse(area.value) : undefined);
        area.setCustomValidity("");
      } catch {
        area.setCustomValidity(t.json);
      }
      area.reportValidity();
    },
  });
  return el("details.json", {}, el("summary", {}, t.asJson), area);
}
