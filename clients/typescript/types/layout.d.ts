/** The layout of a session by calls, for code that writes no documents. */
import type * as m from "../types/messages.js";
export type Change = (ops: m.LayoutChange["ops"]) => Promise<m.LayoutReply>;
export type Place = Omit<m.AddRegion, "op" | "name" | "material">;
/** @import * as m from "../types/messages.js" */
/** @typedef {(ops: m.LayoutChange["ops"]) => Promise<m.LayoutReply>} Change */
/** @typedef {Omit<m.AddRegion, "op" | "name" | "material">} Place */
/** A region of the layout, by its name; each call is one change. */
export declare class Region {
    #private;
    name: string;
    /** @param {Change} change @param {string} name for `contact.region` */
    constructor(change: Change, name: string);
    /** Move it there within `over_s`; what is left out stays.
     * @param {Omit<m.MoveRegion, "op" | "name">} place */
    move(place: Omit<m.MoveRegion, "op" | "name">): Promise<m.LayoutReply>;
    /** Change what is given, in a cross-fade.
     * @param {Place & {material?: Record<string, any>}} fields */
    change(fields: Place & {
        material?: Record<string, any>;
    }): Promise<m.LayoutReply>;
    /** Set the value of a control, such as a slider, 0 to 1.
     * @param {number} value */
    setValue(value: number): Promise<m.LayoutReply>;
    /** Remove it; it fades out. */
    remove(): Promise<m.LayoutReply>;
}
/** What is felt where; the service keeps it for who connects again. */
export declare class Layout {
    #private;
    /** @param {Change} change */
    constructor(change: Change);
    /**
     * Add a region and return it. Millimetres from the screen's corner; without a size it is as large
     * as its material. The name is made where none is given.
     * @param {Record<string, any>} material its document
     * @param {Place & {name?: string}} [place]
     * @returns {Promise<Region>}
     */
    add(material: Record<string, any>, { name, ...place }?: Place & {
        name?: string;
    }): Promise<Region>;
}
