// PointerEvents of made-up fingers, pens and mice by the rules of Pointer Events 3 (buttons, chorded
// buttons, primary pointers), as touches, with what truly touches:
//   node pointer_events.mjs FIRST COUNT REPORTS INTERVAL_MS
// prints a line of JSON a sequence: [[pointers that touch, [[ms, touch_id, kind, x_px, y_px] ...]] ...]
import { Pointers } from "../../../clients/typescript/src/pointers.js";

const [first, count, reports, interval_ms] = process.argv.slice(2).map(Number);
const BOX = { left: 0, top: 0, width: 800, height: 400 };
const ELEMENT = { getBoundingClientRect: () => BOX, offsetWidth: 800, offsetHeight: 400 };

/** mulberry32: the same numbers on each machine */
function chances(seed) {
  return () => {
    seed = (seed + 0x6d2b79f5) | 0;
    let t = Math.imul(seed ^ (seed >>> 15), 1 | seed);
    t = (t + Math.imul(t ^ (t >>> 7), 61 | t)) ^ t;
    return ((t ^ (t >>> 14)) >>> 0) / 4294967296;
  };
}

function sequence(seed) {
  const chance = chances(seed);
  const pick = (list) => list[Math.floor(chance() * list.length)];
  const pointers = new Pointers(10);
  const near = new Map(); // pointerId: {type, x, y, buttons}
  let number = 10;
  const rows = [];
  for (let report = 0; report < reports; report += 1) {
    const ms = report * interval_ms;
    const found = [];
    const send = (type, id, of) => {
      const event = {
        type, pointerId: id, pointerType: of.type, isPrimary: of.isPrimary, buttons: of.buttons, timeStamp: ms,
        clientX: of.x, clientY: of.y, getCoalescedEvents: () => [],
      };
      found.push(...pointers.touches(event, ELEMENT, ms / 1e3));
    };
    const place = { x: 100 + 600 * chance(), y: 50 + 300 * chance() };
    const what = chance();
    const type = pick(["touch", "touch", "pen", "mouse"]);
    const id = type === "touch" ? pick([...near.keys()].filter((key) => key > 10)) : type === "pen" ? 2 : 1;
    const of = near.get(id);
    if (of === undefined || (type === "touch" && what < 0.3 && near.size < 5)) {
      // A finger is there as it touches; a pen or mouse comes above the surface.
      const isPrimary = type !== "touch" || ![...near.keys()].some((key) => key > 10);
      const one = { type, isPrimary, ...place, buttons: type === "touch" ? 1 : 0 };
      const own = type === "touch" ? (number += 1) : id;
      near.set(own, one);
      send(type === "touch" ? "pointerdown" : "pointermove", own, one);
    } else if (what < 0.55) {
      of.x = Math.min(800, of.x + 3 * chance());
      send("pointermove", id, of);
    } else if (type === "touch" || what < 0.62) {
      // It ends: lifted, taken by the browser to scroll, or out of reach.
      const wasDown = (of.buttons & 1) !== 0;
      of.buttons = 0;
      near.delete(id);
      if (wasDown) send(pick(["pointerup", "pointercancel"]), id, of);
      send("pointerleave", id, of);
    } else {
      // One button changes: the tip or first one (1), or the barrel's or second one (2). The first
      // to go down and the last to come up have events of their own, the others are moves.
      const before = of.buttons;
      of.buttons ^= pick([1, 1, 2]);
      send(before === 0 ? "pointerdown" : of.buttons === 0 ? "pointerup" : "pointermove", id, of);
    }
    const touching = [...near.values()].filter((one) => one.buttons & 1).length;
    rows.push([touching, found.map((one) => [1e3 * one.t_s, one.touch_id, one.kind, one.x_px, one.y_px])]);
  }
  return rows;
}

for (let seed = first; seed < first + count; seed += 1) process.stdout.write(`${JSON.stringify(sequence(seed))}\n`);
