/** A page's PointerEvents as touches. Predicted points are never sent: no finger was there. */
export type Touch = import("../types/messages.js").Touch & {
    coalesced?: boolean;
};
/** Which pointers touch, and under which number. A finger, a pen's tip and a mouse's first button have
 * the bit 1 of `buttons`; a pen that hovers with its barrel's button pressed has others alone. */
export declare class Pointers {
    #private;
    fingers: number;
    /** points that were left out: too old, or of more fingers than the service takes */
    dropped: {
        late: number;
        fingers: number;
    };
    /** @param {number} fingers */
    constructor(fingers: number);
    /**
     * Return the touches that an event tells, in CSS pixels of `element` from its corner, as if it were
     * not zoomed or scaled.
     * @param {PointerEvent} event
     * @param {Element} element
     * @param {number} now_s
     * @param {number} [normal_force_n] force, where something measures it; `pressure` is no force
     * @returns {Touch[]}
     */
    touches(event: PointerEvent, element: Element, now_s: number, normal_force_n?: number): Touch[];
    /**
     * Lift pointers, all unless told which; for a tab that is hidden, say, where their events end.
     * @param {number} now_s
     * @param {(pointerId: number, pointerType: string) => boolean} [which]
     * @returns {Touch[]}
     */
    lifts(now_s: number, which?: (pointerId: number, pointerType: string) => boolean): Touch[];
    /** Forget who touches: the next move of each is a down. */
    clear(): void;
}
