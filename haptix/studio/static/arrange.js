/** Where regions go when a person arranges them, and how their copies are called. */

import { boxOfRegion } from "./board.js";

/** @import * as m from "../../../clients/typescript/types/messages.js" */
/** @typedef {"x" | "y"} Axis */

const AXES = /** @type {const} */ ({ x: ["left", "width"], y: ["top", "height"] });

/** Return what each region moves with: the same key for those of a group, unless all are of that group.
 * @param {m.RegionDocument[]} regions */
function unitsOf(regions) {
  const groups = new Set(regions.map(({ group }) => group));
  return regions.map(({ group }, at) => (group && groups.size > 1 ? group : at));
}

/** Return the span of each unit along an axis, which unit each region is of, and the span of all.
 * @param {m.RegionDocument[]} regions @param {Axis} axis */
function along(regions, axis) {
  const [from, length] = AXES[axis];
  const units = unitsOf(regions);
  const keys = [...new Set(units)];
  const spans = keys.map((key) => spanOf(regions.filter((_, at) => units[at] === key).map(boxOfRegion).map((box) => ({ from: box[from], length: box[length] }))));
  const { from: low, length: whole } = spanOf(spans);
  return { spans, low, whole, at: units.map((unit) => keys.indexOf(unit)) };
}

/** @param {{from: number, length: number}[]} spans */
function spanOf(spans) {
  const from = Math.min(...spans.map((span) => span.from));
  return { from, length: Math.max(...spans.map((span) => span.from + span.length)) - from };
}

/**
 * Return how far each region moves to align them: at the begin (0), the middle (0.5) or the end (1) of all [mm].
 * A group moves as one.
 * @param {m.RegionDocument[]} regions @param {Axis} axis @param {number} share
 */
export function aligned(regions, axis, share) {
  const { spans, low, whole, at } = along(regions, axis);
  return at.map((unit) => low + share * (whole - spans[unit].length) - spans[unit].from);
}

/**
 * Return how far each region moves, so that all gaps are the same and the outermost stay [mm]. A group moves as one.
 * @param {m.RegionDocument[]} regions @param {Axis} axis
 */
export function distributed(regions, axis) {
  const { spans, low, whole, at: units } = along(regions, axis);
  const gap = (whole - spans.reduce((sum, { length }) => sum + length, 0)) / Math.max(1, spans.length - 1);
  const moves = spans.map(() => 0);
  let at = low;
  const order = spans.map((_, index) => index).sort((a, b) => 2 * spans[a].from + spans[a].length - 2 * spans[b].from - spans[b].length);
  for (const index of order) {
    moves[index] = at - spans[index].from;
    at += spans[index].length + gap;
  }
  return units.map((unit) => moves[unit]);
}

/** Return a name that is not taken: of a copy, the next number. @param {string} title @param {Iterable<string>} names */
export function freeName(title, names) {
  const taken = new Set(names);
  if (!taken.has(title)) return title;
  const base = title.replace(/ \d+$/, "");
  let number = 2;
  while (taken.has(`${base} ${number}`)) number += 1;
  return `${base} ${number}`;
}
