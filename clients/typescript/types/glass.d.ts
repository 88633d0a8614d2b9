/** How large a page is on the glass. No browser knows: a person measures something on it once, with a ruler.
 *
 * `screen.width` does not help: Chromium gives the same number however a person has zoomed the page. */
export type Glass = {
    sides_px: number[];
    px_per_mm: number;
};
/** Return the pixels of this page in a millimetre of the glass; 0 until a person has measured it on this screen. */
export declare function pxPerMm(): number;
/**
 * Keep, in this browser, how wide something of the page is on the glass.
 * @param {number} width_px in CSS pixels
 * @param {number} width_mm 20 to 3000; with any other number the size is unknown again
 */
export declare function measured(width_px: number, width_mm: number): void;
