/** Devices. */
/** @type {import("../pages.js").Page["mount"]} */
export function mount(root) { root.append("screens"); return () => {}; }
