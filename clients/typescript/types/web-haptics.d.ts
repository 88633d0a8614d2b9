/**
 * `navigator.playHaptics(effect, intensity)` of the WICG's proposal, over the service:
 *
 *     polyfill(() => session);
 *     navigator.playHaptics("tick", 0.5);
 *
 * Friction is felt by a finger that slides. For others, such as one that clicks, and without a session
 * that may play, `navigator.vibrate` does what it can; a browser's own `playHaptics` comes first.
 */
import type { Session } from "./haptix.js";
export type Felt = "friction" | "vibration" | null;
export type Effect = "hint" | "edge" | "tick" | "align" | "success" | "error";
/**
 * Play an effect; return how it is felt, null where nothing is. As the proposal has it, nothing rejects.
 * @param {Session | null | undefined} session
 * @param {Effect} effect
 * @param {number} [intensity] 0 to 1
 * @returns {Felt}
 */
export declare function playHaptics(session: Session | null | undefined, effect: Effect, intensity?: number): Felt;
/**
 * Give `navigator` a `playHaptics`, where it has none of its own.
 * @param {() => Session | null | undefined} session the one that may play now
 */
export declare function polyfill(session: () => Session | null | undefined): void;
