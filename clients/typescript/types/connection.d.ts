/** The connection of a session: hello, pings, answers by id, events, and connecting again. */
import { Calls } from "./calls.js";
import type * as m from "../types/messages.js";
import type { Frame } from "./batches.js";
export type Ended = {
    code: number;
    reason: string;
};
export type Events = {
    [M in m.ServerMessage as M["type"]]: M;
} & {
    frame: Frame & {
        names: string[];
    };
    lost: Ended;
    resumed: m.Welcome;
    closed: Ended;
};
export type Options = {
    /**
     * the client's name, shown in the list of sessions
     */
    name: string;
    /**
     * where the service is
     */
    url?: string;
    /**
     * the access token; a page has kept that of `pair`
     */
    token?: string;
    /**
     * asks a person for the code that the terminal shows, where
     * this page is not paired
     */
    code?: () => string | Promise<string>;
    /**
     * gives both at each attempt, the app's word, by which it has its lease back after a crash, and STOP's own
     * address: `find` of node.js
     */
    find?: (name: string) => Promise<{
        url?: string;
        token: string;
        app?: string;
        stop?: string;
    }>;
    /**
     * where the runtime has none
     */
    WebSocket?: new (url: string, protocol: string) => any;
};
export declare const URL_HERE = "ws://127.0.0.1:7421/v1/session";
/** The service refused a message; `code` and `path` say what and where. */
export declare class Refused extends Error {
    code: string;
    path: string;
    /** @param {{code: string, sentence: string, path?: string}} error */
    constructor({ code, sentence, path }: {
        code: string;
        sentence: string;
        path?: string;
    });
}
/** The connection is gone, or no answer came. */
export declare class Lost extends Error {
    name: string;
}
/**
 * Ask the service of a session by HTTP; both may lie behind a path of a proxy.
 * @param {string} url @param {string} path @param {RequestInit} request
 */
export declare function http(url: string, path: string, request: RequestInit): Promise<Response>;
/** Return the time of the clock that stamps touches and events of a page [s]. */
export declare function now(): number;
/** What `Session` sends its messages over. */
export declare class Connection extends Calls {
    #private;
    /** @type {m.Welcome} what the service said at first: limits, devices, profiles */
    welcome: m.Welcome;
    /** @type {m.Lease} who holds the output, by the last message */
    lease: m.Lease;
    /** @type {m.Output} what the output does, by the last message */
    output: m.Output;
    /** where the service is; @protected */
    protected service: {
        url: string;
        token: string;
    };
    /** @type {Record<string, string[]>} names of the columns of each stream; @protected */
    protected columns: Record<string, string[]>;
    /** @param {Options} options */
    constructor(options: Options);
    /** Connect and say hello; `connect` has done it. */
    open(): Promise<void>;
    /** Send again what the service does not keep for a client that resumes. @protected */
    protected restore(): Promise<void>;
    /**
     * Send or queue a batch of touches; return whether that was possible.
     * @param {() => ArrayBuffer} write
     * @param {number} count touches in it
     * @param {boolean} lifts whether a finger goes up: that is never left out
     * @protected
     */
    protected send(write: () => ArrayBuffer, count: number, lifts: boolean): boolean;
    /**
     * End at 0 V, whoever holds the output, by both paths; the holder keeps the lease.
     * @override
     */
    stop(): Promise<m.Done>;
    /** Leave: 0 V first, and the lease is free for others. */
    close(): Promise<void>;
    /**
     * Call `handler` with each event of a kind; return what ends that.
     * @template {keyof Events} K
     * @param {K} kind
     * @param {(event: Events[K]) => void} handler
     * @returns {() => void}
     */
    on<K extends keyof Events>(kind: K, handler: (event: Events[K]) => void): () => void;
    /**
     * Send a message and return its answer; rejects with `Refused` or `Lost`.
     * @override
     * @param {string} type
     * @param {object} [fields]
     * @returns {Promise<any>}
     */
    ask(type: string, fields?: object): Promise<any>;
    /** Return a time of the service's clock by this one's [s], late by a message's way at most.
     * @param {number} service_s */
    clientTime(service_s: number): number;
    /** @param {string} kind @param {any} event @protected */
    protected emit(kind: string, event: any): void;
}
