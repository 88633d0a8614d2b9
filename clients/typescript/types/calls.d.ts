/** The requests of a session. Made by scripts/client_calls.py from the description of the session; do not edit. */
import type * as m from "../types/messages.js";
/** @import * as m from "../types/messages.js" */
/** The messages of a session that are answered; each rejects with `Refused` or `Lost`. */
export declare class Calls {
    /** The materials by place. */
    layout: Layout;
    /**
     * Send a message and return its answer; undefined fields are left out.
     * @param {string} type
     * @param {object} [fields]
     * @returns {Promise<any>}
     */
    ask(type: string, fields?: object): Promise<any>;
    /** Ask for the lease on the output; with `takeover` also from who holds it.
     * @param {m.Acquire["takeover"]} [takeover]
     * @returns {Promise<m.Lease>} */
    acquire(takeover?: m.Acquire["takeover"]): Promise<m.Lease>;
    /** Let touches be felt.
     * @returns {Promise<m.Output>} */
    arm(): Promise<m.Output>;
    /** End an effect by the number that `playing` gave.
     * @param {m.Cancel["effect_id"]} effectId
     * @returns {Promise<m.Done>} */
    cancel(effectId: m.Cancel["effect_id"]): Promise<m.Done>;
    /** Map pixels to mm: ``origin_mm + turn(rotation_deg) (px / px_per_mm)``.
     * @param {Omit<m.Geometry, "type" | "id">} fields
     * @returns {Promise<m.Done>} */
    geometry(fields: Omit<m.Geometry, "type" | "id">): Promise<m.Done>;
    /** Set the share of friction that is asked for, 0 to 1.
     * @param {m.Intensity["value"]} value
     * @returns {Promise<m.Output>} */
    intensity(value: m.Intensity["value"]): Promise<m.Output>;
    /** Ask which devices and profiles there are.
     * @returns {Promise<m.Inventory>} */
    inventory(): Promise<m.Inventory>;
    /** Change the layout of this session: all of `ops`, or nothing.
     * @param {m.LayoutChange["ops"]} ops
     * @returns {Promise<m.LayoutReply>} */
    layoutChange(ops: m.LayoutChange["ops"]): Promise<m.LayoutReply>;
    /** Replace the layout of this session by a document.
     * @param {m.LayoutSet["document"]} document
     * @returns {Promise<m.LayoutReply>} */
    layoutSet(document: m.LayoutSet["document"]): Promise<m.LayoutReply>;
    /** Hold 0 V while time runs, until the lease ends.
     * @param {m.Switch["on"]} [on]
     * @returns {Promise<m.Output>} */
    mute(on?: m.Switch["on"]): Promise<m.Output>;
    /** Hold 0 V while time stands, until the lease ends.
     * @param {m.Switch["on"]} [on]
     * @returns {Promise<m.Output>} */
    pause(on?: m.Switch["on"]): Promise<m.Output>;
    /** Play an effect that ends, such as a transient; `effect_ended` reports its end.
     * @param {m.Play["effect"]} effect
     * @returns {Promise<m.Playing>} */
    play(effect: m.Play["effect"]): Promise<m.Playing>;
    /** Give the lease back; 0 V first.
     * @returns {Promise<m.Done>} */
    release(): Promise<m.Done>;
    /** Learn the finger by the current that it draws, from the next `arm` on.
     * @param {m.Switch["on"]} [on]
     * @returns {Promise<m.Output>} */
    sense(on?: m.Switch["on"]): Promise<m.Output>;
    /** End at 0 V, whoever holds the output; the holder keeps the lease.
     * @returns {Promise<m.Done>} */
    stop(): Promise<m.Done>;
    /** Ask for streams, each with its highest rate in hertz; 0 ends one.
     * @param {m.Subscribe["streams"]} streams
     * @returns {Promise<m.Subscribed>} */
    subscribe(streams: m.Subscribe["streams"]): Promise<m.Subscribed>;
    /** Request the progress of a job, and its changes until it ends.
     * @param {m.Watch["job"]} job
     * @returns {Promise<m.Job>} */
    watch(job: m.Watch["job"]): Promise<m.Job>;
}
/** The materials by place; the service keeps it for who connects again. */
export declare class Layout {
    #private;
    /** @param {Calls} calls */
    constructor(calls: Calls);
    /**
     * Add a region. Millimetres from the screen's corner; without a size it is as large as its material. The
     * name, for `contact.region`, is made where none is given.
     * @param {m.AddRegion["material"]} material
     * @param {Omit<m.AddRegion, "op" | "name" | "material"> & {name?: string}} [fields]
     * @returns {Promise<Region>}
     */
    add(material: m.AddRegion["material"], { name, ...fields }?: Omit<m.AddRegion, "op" | "name" | "material"> & {
        name?: string;
    }): Promise<Region>;
    /** Remove all regions. */
    clear(): Promise<m.LayoutReply>;
}
/**
 * A region of the layout, by its name; each call is one change.
 * @template {Calls} [S=Calls]
 */
export declare class Region<S extends Calls = Calls> {
    session: S;
    name: string;
    /** @param {S} session @param {string} name */
    constructor(session: S, name: string);
    /** Change the given fields of a region, in a cross-fade.
     * @param {Omit<m.ChangeRegion, "op" | "name">} [fields]
     * @returns {Promise<m.LayoutReply>} */
    change(fields?: Omit<m.ChangeRegion, "op" | "name">): Promise<m.LayoutReply>;
    /** Move a region within `over_s`; fields that are left out stay.
     * @param {Omit<m.MoveRegion, "op" | "name">} [fields]
     * @returns {Promise<m.LayoutReply>} */
    move(fields?: Omit<m.MoveRegion, "op" | "name">): Promise<m.LayoutReply>;
    /** Remove a region; it fades out.
     * @returns {Promise<m.LayoutReply>} */
    remove(): Promise<m.LayoutReply>;
    /** Set the value of a control, such as a slider; it comes after all other changes.
     * @param {m.SetValue["value"]} value
     * @returns {Promise<m.LayoutReply>} */
    setValue(value: m.SetValue["value"]): Promise<m.LayoutReply>;
}
