/** Import of exported layouts: a zip with `layout.json` and the files that it names. */

import { texts } from "./texts.js";

/** @import * as m from "../../../clients/typescript/types/messages.js" */

const [END, ENTRY, FILE] = [0x06054b50, 0x02014b50, 0x04034b50]; // of PKWARE's APPNOTE, 4.3
const [END_BYTES, ENTRY_BYTES, FILE_BYTES] = [22, 46, 30];
const DEFLATED = 8;

/**
 * Return the layout of a zip, once the service has its files.
 * @param {Blob} zip
 * @param {(file: Blob, suffix: string) => Promise<string>} send
 * @returns {Promise<m.LayoutDocument>}
 */
export async function layoutIn(zip, send) {
  const files = filesIn(await zip.arrayBuffer());
  const layout = files.get("layout.json");
  if (!layout) throw new TypeError(texts.make.noLayout);
  const { regions } = JSON.parse(await (await layout()).text());
  for (const [path, read] of files) {
    if (path.startsWith("assets/")) await send(await read(), path.slice(path.lastIndexOf(".")));
  }
  return { regions };
}

/** Return a reader of each file of a zip, by name. @param {ArrayBuffer} bytes */
function filesIn(bytes) {
  const view = new DataView(bytes);
  /** @type {Map<string, () => Promise<Blob>>} */
  const files = new Map();
  try {
    let end = bytes.byteLength - END_BYTES;
    while (view.getUint32(end, true) !== END) end -= 1;
    let at = view.getUint32(end + 16, true);
    for (let left = view.getUint16(end + 10, true); left && view.getUint32(at, true) === ENTRY; left -= 1) {
      const [method, size] = [view.getUint16(at + 10, true), view.getUint32(at + 20, true)];
      const [name, extra, comment] = [28, 30, 32].map((part) => view.getUint16(at + part, true));
      const local = view.getUint32(at + 42, true);
      if (view.getUint32(local, true) !== FILE) break;
      const begin = local + FILE_BYTES + view.getUint16(local + 26, true) + view.getUint16(local + 28, true);
      const packed = new Blob([bytes.slice(begin, begin + size)]);
      const unpacked = () => new Response(packed.stream().pipeThrough(new DecompressionStream("deflate-raw"))).blob();
      const path = new TextDecoder().decode(new Uint8Array(bytes, at + ENTRY_BYTES, name));
      files.set(path, method === DEFLATED ? unpacked : async () => packed);
      at += ENTRY_BYTES + name + extra + comment;
    }
  } catch (error) {
    if (!(error instanceof RangeError)) throw error; // no zip: there is no such place in it
  }
  return files;
}
