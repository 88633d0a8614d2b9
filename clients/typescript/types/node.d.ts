/** Where the service is, for programs of this user under Node: what `service.json` says. */
/**
 * Return address and token of the service, STOP's own address, and the word of an app; for
 * `connect({find})`.
 * @param {string} [name] of the app
 * @returns {Promise<{url: string, token: string, app: string, stop?: string}>}
 */
export declare function find(name?: string): Promise<{
    url: string;
    token: string;
    app: string;
    stop?: string;
}>;
