/**
 * `navigator.playHaptics(effect, intensity)` of the WICG's proposal, over the service:
 *
 *     polyfill(() => session);
 *     navigator.playHaptics("tick", 0.5);
 *
 * Without a session that may play, `navigator.vibrate` does what it can; a browser's own comes first.
 */

/** @import { Session } from "./haptix.js" */
/** @typedef {"hint" | "edge" | "tick" | "align" | "success" | "error"} Effect */

const VIBRATIONS_MS = { hint: [10], edge: [40], tick: [8], align: [10, 30, 10], success: [10, 60, 20], error: [40, 40, 40] };
/** Effects that are several of the service's: which, when [s], and how strong. */
const SEVERAL = /** @type {const} */ ({
  success: [["tick", 0, 0.7], ["tick", 0.12, 1]],
  error: [["edge", 0, 1], ["edge", 0.16, 1], ["edge", 0.32, 1]],
});

/**
 * Play an effect; return whether anything plays it. As the proposal has it, nothing rejects.
 * @param {Session | null | undefined} session
 * @param {Effect} effect
 * @param {number} [intensity] 0 to 1
 * @returns {boolean}
 */
export function playHaptics(session, effect, intensity = 1) {
  if (!(effect in VIBRATIONS_MS)) {
    throw new TypeError(`effect: expected one of ${Object.keys(VIBRATIONS_MS)}, got ${effect}`);
  }
  if (!(intensity >= 0 && intensity <= 1)) {
    throw new RangeError(`intensity: expected 0 to 1, got ${intensity}`);
  }
  if (session?.output?.state !== "armed" || !session.lease.is_mine) {
    const pattern = VIBRATIONS_MS[effect].map((ms, at) => (at % 2 ? ms : Math.round(ms * intensity)));
    return globalThis.navigator?.vibrate?.(pattern) ?? false;
  }
  for (const [name, after_s, share] of SEVERAL[/** @type {"error"} */ (effect)] ?? [[effect, 0, 1]]) {
    const material = /** @type {const} */ ({ kind: "effect", name, intensity: share * intensity });
    const play = () => void session.play(/** @type {any} */ (material)).catch(() => {});
    if (after_s) setTimeout(play, after_s * 1e3);
    else play();
  }
  return true;
}

/**
 * Give `navigator` a `playHaptics`, where it has none of its own.
 * @param {() => Session | null | undefined} session the one that may play now
 */
export function polyfill(session) {
  const navigator = /** @type {any} */ (globalThis.navigator);
  navigator.playHaptics ??= (/** @type {Effect} */ effect, /** @type {number} */ intensity) =>
    playHaptics(session(), effect, intensity);
}
