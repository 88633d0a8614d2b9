/** Import of exported layouts: a zip with `layout.json` and the files that it names. */

import { texts } from "./texts.js";

/** @import * as m from "../../../clients/typescript/types/messages.js" */

const [END, ENTRY, FILE] = [0x06054b50, 0x02014b50, 0x04034b50]; // of PKWARE's APPNOTE, 4.3
const [END_BYTES, ENTRY_BYTES, FILE_BYTES] = [22, 46, 30];
const DEFLATED = 8;
const MOST_BYTES = 256 * 2 ** 20; // of all files together, unpacked

const REMAINDERS = Uint32Array.from({ length: 256 }, (_, byte) => {
  for (let bit = 0; bit < 8; bit += 1) byte = (byte >>> 1) ^ (byte & 1 ? 0xedb88320 : 0);
  return byte;
});

/** Return the CRC-32 of bytes, as zip files have it. @param {Uint8Array} bytes */
function crc32(bytes) {
  let crc = 0xffffffff;
  for (const byte of bytes) crc = (crc >>> 8) ^ REMAINDERS[(crc ^ byte) & 255];
  return (crc ^ 0xffffffff) >>> 0;
}

/**
 * Read a file of a zip, no further than the size that is stated for it, and check its sum.
 * @param {ReadableStream<Uint8Array>} stream
 * @param {string} path
 * @param {number} size
 * @param {number} sum
 */
async function whole(stream, path, size, sum) {
  const bytes = new Uint8Array(size);
  let at = 0;
  try {
    for (const reader = stream.getReader(); ; ) {
      const { done, value } = await reader.read();
      if (done) break;
      if (at + value.length > size) throw new TypeError("more than its stated size");
      bytes.set(value, at);
      at += value.length;
    }
  } catch {
    at = -1; // what is packed is no stream of deflate, or has more than is stated
  }
  if (at !== size || crc32(bytes) !== sum) throw new TypeError(texts.make.damaged(path));
  return new Blob([bytes]);
}

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
    let [at, all] = [view.getUint32(end + 16, true), 0];
    for (let left = view.getUint16(end + 10, true); left && view.getUint32(at, true) === ENTRY; left -= 1) {
      const method = view.getUint16(at + 10, true);
      const [sum, packedSize, size] = [16, 20, 24].map((part) => view.getUint32(at + part, true));
      if ((all += size) > MOST_BYTES) throw new TypeError(texts.make.tooLarge);
      const [name, extra, comment] = [28, 30, 32].map((part) => view.getUint16(at + part, true));
      const local = view.getUint32(at + 42, true);
      if (view.getUint32(local, true) !== FILE) break;
      const begin = local + FILE_BYTES + view.getUint16(local + 26, true) + view.getUint16(local + 28, true);
      const packed = new Blob([bytes.slice(begin, begin + packedSize)]);
      const path = new TextDecoder().decode(new Uint8Array(bytes, at + ENTRY_BYTES, name));
      files.set(path, () => {
        const stream = packed.stream();
        const raw = method === DEFLATED ? stream.pipeThrough(new DecompressionStream("deflate-raw")) : stream;
        return whole(raw, path, size, sum);
      });
      at += ENTRY_BYTES + name + extra + comment;
    }
  } catch (error) {
    if (!(error instanceof RangeError)) throw error; // no zip: there is no such place in it
  }
  return files;
}
