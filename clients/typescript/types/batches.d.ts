/** Touches and telemetry in bytes, little-endian: the layout stands in docs/clients.md. */
export type Touch = import("../types/messages.js").Touch;
export type Frame = {
    stream: "stats" | "friction" | "felt";
    touch_id: number;
    /**
     * rises by one for each stream and finger
     */
    number: number;
    /**
     * frames dropped so far because they were not read
     */
    dropped: number;
    t0_s: number;
    step_s: number;
    columns: number;
    rows: Float32Array;
};
/**
 * Return a batch of touches.
 * @param {readonly (Touch & {coalesced?: boolean})[]} touches at most `welcome.limits.batch_touches`
 * @param {number} number number of the batch; it rises by one
 * @returns {ArrayBuffer}
 */
export declare function writeTouches(touches: readonly (Touch & {
    coalesced?: boolean;
})[], number: number): ArrayBuffer;
/**
 * Return the frame of telemetry that some bytes hold.
 * @param {ArrayBuffer} bytes
 * @returns {Frame}
 */
export declare function readFrame(bytes: ArrayBuffer): Frame;
