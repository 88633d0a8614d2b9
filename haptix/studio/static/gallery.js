/** The gallery, and files that are dropped in: materials of new regions. */

import { el, fill } from "./dom.js";
import { sentence } from "./service.js";
import { texts } from "./texts.js";

/** @import { Service } from "./service.js" */
/**
 * Material and size of a new region.
 * @typedef {{title: string, width_mm: number | undefined, height_mm: number | undefined,
 *   document: Record<string, any>}} Start
 */
/**
 * @typedef {Start & {name: string, family: string, help: string, reachable: number, thumbnail: string}} Preset
 */

const t = texts.make;
const PICTURES = [".png", ".jpg", ".jpeg", ".tif", ".tiff", ".webp", ".avif"];
const SOUNDS = [".wav", ".flac"];
export const TAKEN = [...PICTURES, ...SOUNDS, ".csv", ".xml"];
const WIDE_MM = 60;

/** Presets by family, and a place for files. */
export class Gallery {
  /** @type {Preset[]} */
  presets = [];
  /** @type {Preset | null} what is drawn on the board */
  chosen = null;
  #list = el("div.presets");
  #find = el("input", { type: "search", placeholder: t.find, "aria-label": t.find, oninput: () => this.#show() });

  /**
   * @param {Service} service
   * @param {(start: Start) => void} add
   */
  constructor(service, add) {
    this.service = service;
    this.add = add;
    const input = el("input", {
      type: "file", multiple: true, accept: TAKEN.join(","), id: "file",
      onchange: async () => {
        await this.take(input.files ?? []);
        input.value = "";
      },
    });
    this.problem = el("p.told", { role: "alert" });
    this.busy = el("p.told.busy", { role: "status" });
    this.element = el("section.gallery.sheet", { "aria-label": t.gallery },
      el("label.drop", { for: "file" }, el("b", {}, t.drop), el("small", {}, t.dropHelp), input),
      this.busy, this.problem, this.#find, this.#list);
  }

  /** Read the presets of the service. */
  async load() {
    this.presets = await (await this.service.rest("GET", "/v1/gallery")).json();
    this.#show();
  }

  /** Make regions of files; report files that cannot become one. @param {Iterable<File>} files */
  async take(files) {
    let wrong = "";
    for (const file of files) {
      this.problem.textContent = "";
      this.busy.textContent = t.sending(file.name);
      try {
        this.add(await this.start(file));
      } catch (error) {
        wrong += `${t.refused(file.name, sentence(error))} `;
      }
    }
    this.busy.textContent = "";
    this.problem.textContent = wrong;
  }

  /**
   * Send a file; return material and size of its region.
   * @param {File} file
   * @returns {Promise<Start>}
   */
  async start(file) {
    const suffix = file.name.slice(file.name.lastIndexOf(".")).toLowerCase();
    if (!TAKEN.includes(suffix)) throw new TypeError(t.noFile(TAKEN.join(", ")));
    const { session } = this.service;
    if (!session) throw new TypeError(texts.state.lost);
    const asset = await session.asset(file, suffix);
    const title = file.name.slice(0, -suffix.length).slice(0, 40) || "file";
    const document = documentOf(asset, suffix);
    // The service reads the file; if it cannot, there is no region.
    await this.service.rest("POST", "/v1/pictures", { material: document, width_mm: 10, height_mm: 10, columns: 8 });
    if (!PICTURES.includes(suffix)) return { title, document, width_mm: WIDE_MM, height_mm: 40 };
    const { pixels, ...size } = await sizeOf(file);
    const kept = session.welcome.limits.image_pixels;
    if (pixels > kept) this.service.notify("note", t.reduced(file.name, pixels, kept));
    return { title, document, ...size };
  }

  #show() {
    const words = this.#find.value.trim().toLowerCase().split(/\s+/);
    const fits = (/** @type {Preset} */ preset) => {
      const text = `${preset.title} ${preset.family} ${preset.help} ${preset.document.kind}`.toLowerCase();
      return words.every((word) => text.includes(word));
    };
    const matching = this.presets.filter(fits);
    const families = [...new Set(matching.map(({ family }) => family))];
    fill(this.#list,
      families.map((family) => el("section", {},
        el("h2", {}, t.families[/** @type {keyof typeof t.families} */ (family)] ?? family),
        el("div.thumbs", {}, matching.filter((preset) => preset.family === family).map((preset) => this.#thumb(preset))))),
      matching.length ? null : el("p.quiet", {}, t.none));
  }

  /** @param {Preset} preset */
  #thumb(preset) {
    return el("button.thumb", {
      type: "button", draggable: true, title: preset.help, "aria-label": `${preset.title}. ${preset.help}`,
      onclick: () => {
        this.chosen = preset;
        this.add(preset);
      },
      ondragstart: (/** @type {DragEvent} */ event) => event.dataTransfer?.setData("text/haptix-preset", preset.name),
    }, el("img", { src: preset.thumbnail, alt: "" }), el("span", {}, preset.title));
  }
}

/** Return the document of a file. @param {string} asset @param {string} suffix @returns {Record<string, any>} */
function documentOf(asset, suffix) {
  if (suffix === ".csv") return { kind: "recording", file: asset };
  if (suffix === ".xml") return { kind: "penn", file: asset };
  if (SOUNDS.includes(suffix)) {
    return { kind: "transient", begins: "down", curve: { kind: "recorded", file: asset } };
  }
  return { kind: "photograph", file: asset, width_mm: WIDE_MM };
}

/** Return the size of a picture on the screen; of what a browser cannot read, the service knows it.
 * @param {File} file */
async function sizeOf(file) {
  try {
    const bitmap = await createImageBitmap(file);
    const { width, height } = bitmap;
    bitmap.close();
    return { pixels: width * height, width_mm: WIDE_MM, height_mm: Math.round((10 * WIDE_MM * height) / width) / 10 };
  } catch {
    return { pixels: 0, width_mm: undefined, height_mm: undefined };
  }
}
