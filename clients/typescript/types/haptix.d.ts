/**
 * A client of `haptix serve`, for pages and Node; it runs as it is and needs no package.
 *
 *     const h = await connect({name: "demo", token});
 *     await h.acquire(); await h.arm();
 *     canvas.onpointerdown = canvas.onpointermove = canvas.onpointerup = (e) => h.pointer(e);
 */
import { Region } from "./calls.js";
import { Connection } from "./connection.js";
import type * as m from "../types/messages.js";
import type { Options } from "./connection.js";
export type Touch = m.Touch & {
    coalesced?: boolean;
};
export type FeelOptions = {
    /**
     * of a page: what is felt fills it, and its pointers are followed
     */
    element?: HTMLElement;
    /**
     * CSS pixels for a millimetre of this screen, 96 / 25.4 unless you measure it
     */
    px_per_mm?: number;
    /**
     * as in `follow`
     */
    scroll?: "none" | "vertical" | "horizontal";
    /**
     * whether a person has asked for the voltage of a real driver, which is not
     * armed otherwise; a virtual one always is
     */
    person_asked?: boolean;
};
/** @import * as m from "../types/messages.js" */
/** @import { Options } from "./connection.js" */
/** @typedef {m.Touch & {coalesced?: boolean}} Touch */
/**
 * @typedef {object} FeelOptions
 * @property {HTMLElement} [element] of a page: what is felt fills it, and its pointers are followed
 * @property {number} [px_per_mm] CSS pixels for a millimetre of this screen, 96 / 25.4 unless you measure it
 * @property {"none" | "vertical" | "horizontal"} [scroll] as in `follow`
 * @property {boolean} [person_asked] whether a person has asked for the voltage of a real driver, which is not
 *   armed otherwise; a virtual one always is
 */
/**
 * Open a session.
 * @param {Options} options
 * @returns {Promise<Session>}
 */
export declare function connect(options: Options): Promise<Session>;
/**
 * Return a token for this page, for the code that the terminal shows. It is kept for `connect`.
 * @param {{code: string, name: string, url?: string}} asked
 * @returns {Promise<string>}
 */
export declare function pair({ code, name, url }: {
    code: string;
    name: string;
    url?: string;
}): Promise<string>;
/**
 * Open a session and fill an element, or the screen, with a material: a felt texture in one call. What is
 * returned has the `session`.
 * @param {object} material
 * @param {Options & FeelOptions} options
 * @returns {Promise<Region<Session>>}
 */
export declare function feel(material: object, options: Options & FeelOptions): Promise<Region<Session>>;
export { Lost, now, Refused } from "./connection.js";
/** A session with the service, made by `connect`. */
export declare class Session extends Connection {
    #private;
    /** Send again what the service does not keep for who resumes. @protected @override */
    protected restore(): Promise<void>;
    /** @override @param {string} type @param {object} [fields] */
    ask(type: string, fields?: object): Promise<any>;
    /** Whether a finger slides: where none does, friction is not felt. */
    get slides(): boolean;
    /** Points of pointers that were left out so far; the first is told as `warning`, too. */
    get dropped(): number;
    /** Send a file that materials read, once; return `sha256:...`, by which a document calls it.
     * @param {Blob} file
     * @param {string} suffix what it is: ".png", ".jpg", ".wav" ...
     * @returns {Promise<string>} */
    asset(file: Blob, suffix: string): Promise<string>;
    /**
     * Report touches in one batch of bytes; `t_s` is `now()`'s clock. Faster than the service takes
     * them they wait, and what is asked meanwhile passes them.
     * @param {readonly Touch[]} touches
     * @returns {boolean} whether they are sent, or wait: false without a connection, or while 1000 wait
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
    /** Take a finger off.
     * @returns {boolean} */
    lift(touch_id?: number): boolean;
    /**
     * Report what a PointerEvent tells, coalesced points included, in CSS pixels from the corner of
     * `element`; say `geometry` first. A pointer touches while its first button is down.
     * @param {PointerEvent} event
     * @param {{element?: Element, normal_force_n?: number}} [options]
     * @returns {boolean}
     */
    pointer(event: PointerEvent, { element, normal_force_n }?: {
        element?: Element;
        normal_force_n?: number;
    }): boolean;
    /**
     * Report the pointers of an element, until the function that is returned is called. Without `scroll` a
     * finger on it scrolls nothing; with it, a stroke in that direction scrolls the page, and one across is felt.
     * @param {HTMLElement | SVGElement} element
     * @param {{scroll?: "none" | "vertical" | "horizontal", normal_force_n?: number}} [options]
     * @returns {() => void}
     */
    follow(element: HTMLElement | SVGElement, { scroll, normal_force_n }?: {
        scroll?: "none" | "vertical" | "horizontal";
        normal_force_n?: number;
    }): () => void;
    /**
     * Fill an element, or the screen, with a material and arm: all that it takes to feel one. What was felt
     * before is replaced. After a lost connection it is felt again, where it was felt until then: the layout as it
     * was changed since, or on a service that was begun anew this material, with intensity, mute and pause as they
     * were. A virtual driver is armed by itself; after `stop`, `release` or a layout of the app's own nothing is.
     * @param {object} material
     * @param {FeelOptions} [options]
     * @returns {Promise<Region<Session>>}
     */
    feel(material: object, options?: FeelOptions): Promise<Region<Session>>;
}
