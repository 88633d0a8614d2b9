/** Feel the layout. */
/** @type {import("../pages.js").Page["mount"]} */
export function mount(root) { root.append("play"); return () => {}; }
