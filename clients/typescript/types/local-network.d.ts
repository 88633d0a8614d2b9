/** Whether a browser lets a page of another machine reach the service of this one. */
/**
 * Let the browser ask the person for the permission, where it has one that was not asked for yet.
 * @param {string} url of the service
 */
export declare function askPermission(url: string): Promise<void>;
/**
 * Return what is in the way of a service that does not answer, and what to do.
 * @param {string} url of the service
 * @returns {Promise<string>}
 */
export declare function obstacle(url: string): Promise<string>;
