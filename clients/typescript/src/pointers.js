/** A page's PointerEvents as touches. Predicted points are never sent: no finger was there. */

/** @typedef {import("../types/messages.js").Touch & {coalesced?: boolean}} Touch */

const OLDEST_S = 0.4; // the service refuses what is older than 0.5 s
const ENDS = ["pointerup", "pointercancel", "pointerleave", "lostpointercapture"];

/** Which pointers touch, and under which number. A finger, a pen's tip and a mouse's first button have
 * the bit 1 of `buttons`; a pen that hovers with its barrel's button pressed has others alone. */
export class Pointers {
  /** points that were left out: too old, or of more fingers than the service takes */
  dropped = { late: 0, fingers: 0 };
  /** @type {Map<number, {touch_id: number, type: string}>} */
  #down = new Map();

  /** @param {number} fingers */
  constructor(fingers) {
    this.fingers = fingers;
  }

  /**
   * Return the touches that an event tells, in CSS pixels of `element` from its corner, as if it were
   * not zoomed or scaled.
   * @param {PointerEvent} event
   * @param {Element} element
   * @param {number} now_s
   * @param {number} [normal_force_n] force, where something measures it; `pressure` is no force
   * @returns {Touch[]}
   */
  touches(event, element, now_s, normal_force_n) {
    const known = this.#down.get(event.pointerId);
    const ends = ENDS.includes(event.type) || (event.buttons & 1) === 0;
    if (ends && known === undefined) return [];
    // The lifts of others were lost: the first of its type is down alone.
    const isFirst = event.type === "pointerdown" && event.isPrimary;
    const found = isFirst ? this.lifts(now_s, (id, type) => type === event.pointerType && id !== event.pointerId) : [];
    const touch_id = known?.touch_id ?? this.#free();
    if (touch_id === undefined) {
      this.dropped.fingers += 1;
      return found;
    }
    const { left, top, width, height } = element.getBoundingClientRect();
    const { offsetWidth, offsetHeight } = /** @type {HTMLElement} */ (element);
    const [zoom_x, zoom_y] = [zoom(width, offsetWidth), zoom(height, offsetHeight)];
    const shift_s = ahead(event, now_s);
    /** @type {(each: PointerEvent, kind: "down" | "move" | "up") => Touch} */
    const touch = (each, kind) => ({
      t_s: each.timeStamp / 1e3 + shift_s,
      touch_id,
      kind,
      x_px: (each.clientX - left) / zoom_x,
      y_px: (each.clientY - top) / zoom_y,
      normal_force_n,
    });
    if (ends) {
      this.#down.delete(event.pointerId);
      const up = touch(event, "up");
      // A page that hung tells late of a lifted finger; it must not be refused for that.
      return [{ ...up, t_s: Math.max(up.t_s, now_s - OLDEST_S), normal_force_n: undefined }];
    }
    const several = event.getCoalescedEvents?.() ?? [];
    let comes = event.type === "pointerdown" || known === undefined;
    for (const each of several.length ? several : [event]) {
      const one = touch(each, comes ? "down" : "move");
      if (now_s - one.t_s > OLDEST_S) {
        this.dropped.late += 1;
        continue;
      }
      comes = false;
      this.#down.set(event.pointerId, { touch_id, type: event.pointerType });
      found.push({ ...one, coalesced: several.length > 1 });
    }
    return found;
  }

  /**
   * Lift pointers, all unless told which; for a tab that is hidden, say, where their events end.
   * @param {number} now_s
   * @param {(pointerId: number, pointerType: string) => boolean} [which]
   * @returns {Touch[]}
   */
  lifts(now_s, which = () => true) {
    const some = [...this.#down].filter(([id, { type }]) => which(id, type));
    for (const [id] of some) this.#down.delete(id);
    return some.map(([, { touch_id }]) => ({ t_s: now_s, touch_id, kind: "up" }));
  }

  /** Forget who touches: the next move of each is a down. */
  clear() {
    this.#down.clear();
  }

  #free() {
    const taken = new Set([...this.#down.values()].map((one) => one.touch_id));
    for (let id = 0; id < this.fingers; id += 1) if (!taken.has(id)) return id;
    return undefined;
  }
}

/** Return our clock minus that of the event's document [s]: in an iframe it counts from another origin.
 * @param {PointerEvent} event @param {number} now_s */
function ahead(event, now_s) {
  const clock = event.view?.performance;
  return clock === undefined || clock === performance ? 0 : now_s - clock.now() / 1e3;
}

/** Return how many pixels one of the element takes, by CSS zoom or a transform.
 * @param {number} shown @param {number} [own] a whole number */
function zoom(shown, own) {
  return own === undefined || Math.abs(shown - own) < 1 ? 1 : shown / own;
}
