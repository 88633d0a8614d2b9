/** The pages: each module has `mount(root, app)`, which returns what ends it. */

/** @import { App } from "./app.js" */
/** @typedef {{mount: (root: HTMLElement, app: App) => (() => void)}} Page */
/** @typedef {{path: string, load: () => Promise<Page>}} Entry */

/** @type {Entry[]} the first one opens at a bare start; its title is `texts.pages[path]` */
export const PAGES = [
  { path: "play", load: () => import("./pages/play.js") },
  { path: "make", load: () => import("./pages/make.js") },
  { path: "screens", load: () => import("./pages/screens.js") },
  { path: "calibrate", load: () => import("./pages/calibrate.js") },
  { path: "sit", load: () => import("./pages/sit.js") },
];
