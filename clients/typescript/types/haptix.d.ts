/**
 * A client of `haptix serve`, for pages and Node; it runs as it is and needs no package.
 *
 *     const h = await connect({name: "demo", token});
 *     await h.acquire(); await h.arm();
 *     canvas.onpointerdown = canvas.onpointermove = canvas.onpointerup = (e) => h.pointer(e);
 */
import { Connection } from "./connection.js";
import { Layout } from "./layout.js";
import type * as m from "../types/messages.js";
import type { Options } from "./connection.js";
export type Touch = m.Touch & {
    coalesced?: boolean;
};
/** @import * as m from "../types/messages.js" */
/** @import { Options } from "./connection.js" */
/** @typedef {m.Touch & {coalesced?: boolean}} Touch */
/**
 * Open a session.
 * @param {Options} options
 * @returns {Promise<Session>}
 */
export declare function connect(options: Options): Promise<Session>;
/**
 * Return a token for this page, for the code that the terminal shows. Keep it in localStorage.
 * @param {{code: string, name: string, url?: string}} asked
 * @returns {Promise<string>}
 */
export declare function pair({ code, name, url }: {
    code: string;
    name: string;
    url?: string;
}): Promise<string>;
export { Lost, now, Refused } from "./connection.js";
/** A session with the service, made by `connect`. */
export declare class Session extends Connection {
    #private;
    /** What is felt where, by calls. */
    layout: Layout;
    /** The service keeps lease and layout for who resumes; these are of the session.
     * @protected @override */
    protected restore(): Promise<void>;
    /** Ask for the lease on the output; with `takeover` also from who holds it.
     * @returns {Promise<m.Lease>} */
    acquire(takeover?: boolean): Promise<m.Lease>;
    /** Give the lease back; 0 V first.
     * @returns {Promise<m.Done>} */
    release(): Promise<m.Done>;
    /** Let touches be felt.
     * @returns {Promise<m.Output>} */
    arm(): Promise<m.Output>;
    /** End at 0 V and keep the lease.
     * @returns {Promise<m.Output>} */
    disarm(): Promise<m.Output>;
    /** End at 0 V, whoever holds the output.
     * @returns {Promise<m.Done>} */
    stop(): Promise<m.Done>;
    /** Replace the layout.
     * @param {m.LayoutDocument} document
     * @returns {Promise<m.LayoutReply>} */
    layoutSet(document: m.LayoutDocument): Promise<m.LayoutReply>;
    /** Change the layout: all of `ops`, or nothing.
     * @param {m.LayoutChange["ops"]} ops
     * @returns {Promise<m.LayoutReply>} */
    layoutChange(ops: m.LayoutChange["ops"]): Promise<m.LayoutReply>;
    /** Send a file that materials read, once; return `sha256:...`, by which a document calls it.
     * @param {Blob} file
     * @param {string} suffix what it is: ".png", ".jpg", ".wav" ...
     * @returns {Promise<string>} */
    asset(file: Blob, suffix: string): Promise<string>;
    /** Say how pixels become millimetres: ``origin_mm + turn(rotation_deg) (px / px_per_mm)``.
     * @param {{px_per_mm: number, origin_mm?: [number, number], rotation_deg?: number}} geometry
     * @returns {Promise<m.Done>} */
    geometry(geometry: {
        px_per_mm: number;
        origin_mm?: [number, number];
        rotation_deg?: number;
    }): Promise<m.Done>;
    /** Play a transient effect; `effect_ended` tells its end by the same `effect_id`.
     * @param {object} effect
     * @returns {Promise<m.Playing>} */
    play(effect: object): Promise<m.Playing>;
    /** End an effect.
     * @param {number} effect_id
     * @returns {Promise<m.Done>} */
    cancel(effect_id: number): Promise<m.Done>;
    /** Set the share of friction that is asked for, 0 to 1.
     * @param {number} value
     * @returns {Promise<m.Output>} */
    intensity(value: number): Promise<m.Output>;
    /** Hold 0 V while time runs.
     * @param {boolean} on
     * @returns {Promise<m.Output>} */
    mute(on: boolean): Promise<m.Output>;
    /** Hold 0 V while time stands.
     * @param {boolean} on
     * @returns {Promise<m.Output>} */
    pause(on: boolean): Promise<m.Output>;
    /** Ask for streams, each with its rate [Hz]; 0 ends one. They come as `frame`.
     * @param {m.Subscribe["streams"]} streams
     * @returns {Promise<m.Subscribed>} */
    subscribe(streams: m.Subscribe["streams"]): Promise<m.Subscribed>;
    /** Return how far a job is; `job` tells its changes until it ends.
     * @param {string} job
     * @returns {Promise<m.Job>} */
    watch(job: string): Promise<m.Job>;
    /** Return devices and profiles.
     * @returns {Promise<m.Inventory>} */
    inventory(): Promise<m.Inventory>;
    /**
     * Report touches in one batch of bytes; `t_s` is `now()`'s clock.
     * @param {readonly Touch[]} touches
     * @returns {boolean} whether there was a connection to send them over
     */
    touches(touches: readonly Touch[]): boolean;
    /**
     * Report one touch, now unless it says when.
     * @param {Omit<Touch, "t_s"> & {t_s?: number}} touch
     * @returns {boolean}
     */
    touch(touch: Omit<Touch, "t_s"> & {
        t_s?: number;
    }): boolean;
    /** Take a finger off. */
    lift(touch_id?: number): boolean;
    /**
     * Report what a PointerEvent tells, coalesced points included, in CSS pixels from the corner of
     * `element`; say `geometry` first. A pointer touches while a button is down.
     * @param {PointerEvent} event
     * @param {{element?: Element, normal_force_n?: number}} [options]
     * @returns {boolean}
     */
    pointer(event: PointerEvent, { element, normal_force_n }?: {
        element?: Element;
        normal_force_n?: number;
    }): boolean;
}
