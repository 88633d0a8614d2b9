/** Where regions go when a person arranges them, and how their copies are called. */

import { boxOfRegion } from "./board.js";

/** @import * as m from "../../../clients/typescript/types/messages.js" */
/** @typedef {"x" | "y"} Axis */

const AXES = /** @type {const} */ ({ x: ["left", "width"], y: ["top", "height"] });

/** Return boxes along an axis, and the span of all. @param {m.RegionDocument[]} regions @param {Axis} axis */
function along(regions, axis) {
  const [from, length] = AXES[axis];
  const spans = regions.map(boxOfRegion).map((box) => ({ from: box[from], length: box[length] }));
  const low = Math.min(...spans.map((span) => span.from));
  return { spans, low, whole: Math.max(...spans.map((span) => span.from + span.length)) - low };
}

/**
 * Return how far each region moves to align them: at the begin (0), the middle (0.5) or the end (1) of all [mm].
 * @param {m.RegionDocument[]} regions @param {Axis} axis @param {number} share
 */
export function aligned(regions, axis, share) {
  const { spans, low, whole } = along(regions, axis);
  return spans.map(({ from, length }) => low + share * (whole - length) - from);
}

/**
 * Return how far each region moves, so that all gaps are the same and the outermost stay [mm].
 * @param {m.RegionDocument[]} regions @param {Axis} axis
 */
export function distributed(regions, axis) {
  const { spans, low, whole } = along(regions, axis);
  const gap = (whole - spans.reduce((sum, { length }) => sum + length, 0)) / (spans.length - 1);
  const moves = spans.map(() => 0);
  let at = low;
  const order = spans.map((_, index) => index).sort((a, b) => 2 * spans[a].from + spans[a].length - 2 * spans[b].from - spans[b].length);
  for (const index of order) {
    moves[index] = at - spans[index].from;
    at += spans[index].length + gap;
  }
  return moves;
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
