/**
 * What a page keeps across a reload or crash: in `localStorage` or, where a browser refuses that to an
 * iframe of another site, in a cookie that only this page within that site sees.
 */
/**
 * Return what is kept under a key; "" where there is nothing, or no page.
 * @param {string} key
 * @returns {string}
 */
export declare function kept(key: string): string;
/**
 * Keep a text under a key.
 * @param {string} key
 * @param {string} text
 */
export declare function keep(key: string, text: string): void;
/**
 * Return the word by which the service knows a page again that crashed or was reloaded.
 * @param {string} name the client's
 * @returns {string}
 */
export declare function wordOf(name: string): string;
