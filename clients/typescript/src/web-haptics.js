/**
 * `navigator.playHaptics(effect, intensity)` of the WICG's proposal, over the service:
 *
 *     polyfill(() => session);
 *     navigator.playHaptics("tick", 0.5);
 *
 * Friction is felt by a finger that slides. For others, such as one that clicks, and without a session
 * that may play, `navigator.vibrate` does what it can; a browser's own `playHaptics` comes first.
 */

/** @import { Session } from "./haptix.js" */
/** @typedef {"friction" | "vibration" | null} Felt */
/** @typedef {"hint" | "edge" | "tick" | "align" | "success" | "error"} Effect */

const VIBRATIONS_MS = { hint: [10], edge: [40], tick: [8], align: [10, 30, 10], success: [10, 60, 20], error: [40, 40, 40] };

/**
 * Play an effect; return how it is felt, null where nothing is. As the proposal has it, nothing rejects.
 * @param {Session | null | undefined} session
 * @param {Effect} effect
 * @param {number} [intensity] 0 to 1
 * @returns {Felt}
 */
export function playHaptics(session, effect, intensity = 1) {
  if (!(effect in VIBRATIONS_MS)) {
    throw new TypeError(`effect: expected one of ${Object.keys(VIBRATIONS_MS)}, got ${effect}`);
  }
  if (!(intensity >= 0 && intensity <= 1)) {
    throw new RangeError(`intensity: expected 0 to 1, got ${intensity}`);
  }
  if (session?.slides && isFelt(session)) {
    void session.play({ kind: "effect", name: effect, intensity }).catch(() => {});
    return "friction";
  }
  const pattern = VIBRATIONS_MS[effect].map((ms, at) => (at % 2 ? ms : Math.round(ms * intensity)));
  return globalThis.navigator?.vibrate?.(pattern) ? "vibration" : null;
}

/** @param {Session} session */
function isFelt({ lease, output }) {
  const share = output.muted || output.paused || output.person_muted ? 0 : output.intensity * output.person_intensity;
  return lease.is_mine && output.state === "armed" && share > 0;
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
