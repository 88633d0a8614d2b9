/** Where the service is, for programs of this user under Node: what `service.json` says. */
/**
 * Return address and token of the service; for `connect({find})`.
 * @returns {Promise<{url: string, token: string}>}
 */
export declare function find(): Promise<{
    url: string;
    token: string;
}>;
