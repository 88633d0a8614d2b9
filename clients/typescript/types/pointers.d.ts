/** A page's PointerEvents as touches. Predicted points are never sent: no finger was there. */
export type Touch = import("../types/messages.js").Touch & {
    coalesced?: boolean;
};
/** Which pointers touch, and under which number. A pointer touches while a button is down. */
export declare class Pointers {
    #private;
    fingers: number;
    /** @type {Map<number, number>} */
    ids: Map<number, number>;
    /** @param {number} fingers */
    constructor(fingers: number);
    /**
     * Return the touches that an event tells, in CSS pixels from the corner of `element`.
     * @param {PointerEvent} event
     * @param {Element} element
     * @param {number} now_s
     * @param {number} [normal_force_n] force, where something measures it; `pressure` is no force
     * @returns {Touch[]}
     */
    touches(event: PointerEvent, element: Element, now_s: number, normal_force_n?: number): Touch[];
    /** Forget who touches: the next move of each is a down. */
    clear(): void;
}
