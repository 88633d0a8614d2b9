/** Commands of a page: one table, of which its keys and its menu are made. */

import { el } from "./dom.js";

/**
 * `keys` are pressed for it, the first one stands in the menu; `can` tells whether it does anything now;
 * with `is_for_fields` the keys act in a text field too.
 * @typedef {{name: string, keys?: string[], act: () => unknown, can?: () => boolean, is_for_fields?: boolean}} Command
 */

const FIELDS = "textarea, select, input:not([type=range], [type=checkbox])";

/** Return the keys of a press, such as "Ctrl+Shift+Z". @param {KeyboardEvent} event */
function keysOf({ key, ctrlKey, metaKey, shiftKey, altKey }) {
  if (!key || altKey) return ""; // a browser that fills in a field sends presses without a key
  const letter = key.length === 1 ? key.toUpperCase() : key;
  return `${ctrlKey || metaKey ? "Ctrl+" : ""}${shiftKey ? "Shift+" : ""}${letter}`;
}

/** Let keys give commands; return a function that ends this. @param {Command[]} commands */
export function listen(commands) {
  const hear = (/** @type {KeyboardEvent} */ event) => {
    const keys = keysOf(event);
    const command = commands.find((each) => each.keys?.includes(keys));
    if (!command || event.defaultPrevented) return;
    const { target } = event;
    const is_in_field = target instanceof Element && target.matches(FIELDS);
    const is_text = keys === "Ctrl+C" && !getSelection()?.isCollapsed; // of the page, as anywhere else
    if ((is_in_field && !command.is_for_fields) || is_text || command.can?.() === false) return;
    event.preventDefault();
    command.act();
  };
  addEventListener("keydown", hear);
  return () => removeEventListener("keydown", hear);
}

/** Return a menu of commands. @param {string} title @param {Command[]} commands */
export function menuOf(title, commands) {
  const buttons = commands.map(({ name, keys, act }) => el("button.command", {
    type: "button", "aria-keyshortcuts": keys?.[0].replace("Ctrl", "Control"),
    onclick: () => {
      menu.open = false;
      menu.querySelector("summary")?.focus();
      act();
    },
  }, name, keys ? el("kbd", {}, keys[0]) : null));
  const menu = el("details.drop-down", {
    ontoggle: () => buttons.forEach((button, at) => void (button.disabled = commands[at].can?.() === false)),
  }, el("summary", {}, title), el("div.menu", {}, buttons));
  return menu;
}
