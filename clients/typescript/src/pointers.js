/** A page's PointerEvents as touches. Predicted points are never sent: no finger was there. */

/** @typedef {import("../types/messages.js").Touch & {coalesced?: boolean}} Touch */

const OLDEST_S = 0.4; // the service refuses what is older than 0.5 s
const ENDS = ["pointerup", "pointercancel", "pointerleave", "lostpointercapture"];

/** Which pointers touch, and under which number. A pointer touches while a button is down. */
export class Pointers {
  /** @param {number} fingers */
  constructor(fingers) {
    this.fingers = fingers;
    /** @type {Map<number, number>} */
    this.ids = new Map();
  }

  /**
   * Return the touches that an event tells, in CSS pixels from the corner of `element`.
   * @param {PointerEvent} event
   * @param {Element} element
   * @param {number} now_s
   * @param {number} [normal_force_n] force, where something measures it; `pressure` is no force
   * @returns {Touch[]}
   */
  touches(event, element, now_s, normal_force_n) {
    const { left, top } = element.getBoundingClientRect();
    /** @type {Touch[]} */
    const found = [];
    const known = this.ids.get(event.pointerId);
    const ends = ENDS.includes(event.type) || event.buttons === 0;
    if (ends && known === undefined) return found;
    const touch_id = known ?? this.#free();
    if (touch_id === undefined) return found; // more fingers than the service takes
    /** @type {(each: PointerEvent, kind: "down" | "move" | "up") => Touch} */
    const touch = (each, kind) => ({
      t_s: each.timeStamp / 1e3,
      touch_id,
      kind,
      x_px: each.clientX - left,
      y_px: each.clientY - top,
      normal_force_n,
    });
    if (ends) {
      this.ids.delete(event.pointerId);
      const up = touch(event, "up");
      // A page that hung tells late of a lifted finger; it must not be refused for that.
      return [{ ...up, t_s: Math.max(up.t_s, now_s - OLDEST_S) }];
    }
    const several = event.getCoalescedEvents?.() ?? [];
    for (const each of several.length ? several : [event]) {
      if (now_s - each.timeStamp / 1e3 > OLDEST_S) continue;
      const kind = this.ids.has(event.pointerId) ? "move" : "down";
      this.ids.set(event.pointerId, touch_id);
      found.push({ ...touch(each, kind), coalesced: several.length > 1 });
    }
    return found;
  }

  /** Forget who touches: the next move of each is a down. */
  clear() {
    this.ids.clear();
  }

  #free() {
    const taken = new Set(this.ids.values());
    for (let id = 0; id < this.fingers; id += 1) if (!taken.has(id)) return id;
    return undefined;
  }
}
