/** Touches and telemetry in bytes, little-endian: the layout stands in docs/clients.md. */

/** @typedef {import("../types/messages.js").Touch} Touch */
/**
 * Rows of one stream, for one finger. Row i is `rows.subarray(i * columns, (i + 1) * columns)`, at
 * `t0_s + i * step_s` of the service's clock; NaN where nothing is known.
 * @typedef {object} Frame
 * @property {"stats" | "friction" | "felt"} stream
 * @property {number} touch_id
 * @property {number} number rises by one for each stream and finger
 * @property {number} dropped frames dropped so far because they were not read
 * @property {number} t0_s
 * @property {number} step_s
 * @property {number} columns
 * @property {Float32Array} rows
 */

const HEADER_BYTES = 16;
const RECORD_BYTES = 24;
const FRAME_BYTES = 32;
const KINDS = /** @type {const} */ (["down", "move", "up"]);
const STREAMS = /** @type {const} */ (["stats", "friction", "felt"]);
const [PIXELS, FORCE, AREA, COALESCED] = [4, 8, 16, 32];
const MOST_US = 2 ** 31;

/**
 * Return a batch of touches.
 * @param {readonly (Touch & {coalesced?: boolean})[]} touches at most `welcome.limits.batch_touches`
 * @param {number} number number of the batch; it rises by one
 * @returns {ArrayBuffer}
 */
export function writeTouches(touches, number) {
  const bytes = new ArrayBuffer(HEADER_BYTES + RECORD_BYTES * touches.length);
  const view = new DataView(bytes);
  const base_s = touches.length ? touches[0].t_s : 0;
  view.setUint8(0, 1);
  view.setUint8(1, 1);
  view.setUint16(2, touches.length, true);
  view.setUint32(4, number, true);
  view.setFloat64(8, base_s, true);
  touches.forEach((touch, index) => {
    const at = HEADER_BYTES + RECORD_BYTES * index;
    const after_us = Math.round((touch.t_s - base_s) * 1e6);
    if (!(Math.abs(after_us) < MOST_US)) {
      throw new RangeError(`t_s: expected seconds near ${base_s}, got ${touch.t_s}`);
    }
    const kind = KINDS.indexOf(touch.kind ?? "move");
    if (kind < 0) throw new RangeError(`kind: expected down, move or up, got ${touch.kind}`);
    const in_px = touch.x_px != null;
    const [x, y] = in_px ? [touch.x_px, touch.y_px] : [touch.x_mm, touch.y_mm];
    let flags = kind | (in_px ? PIXELS : 0) | (touch.coalesced ? COALESCED : 0);
    if (touch.normal_force_n != null) flags |= FORCE;
    if (touch.contact_area_m2 != null) flags |= AREA;
    view.setInt32(at, after_us, true);
    view.setUint8(at + 4, touch.touch_id ?? 0);
    view.setUint8(at + 5, flags);
    view.setFloat32(at + 8, x ?? (kind === 2 ? 0 : NaN), true); // only who lifts needs no place
    view.setFloat32(at + 12, y ?? (kind === 2 ? 0 : NaN), true);
    view.setFloat32(at + 16, touch.normal_force_n ?? 0, true);
    view.setFloat32(at + 20, touch.contact_area_m2 ?? 0, true);
  });
  return bytes;
}

/**
 * Return the frame of telemetry that some bytes hold.
 * @param {ArrayBuffer} bytes
 * @returns {Frame}
 */
export function readFrame(bytes) {
  const view = new DataView(bytes);
  const stream = bytes.byteLength < FRAME_BYTES ? undefined : STREAMS[view.getUint8(1) - 1];
  if (stream === undefined || view.getUint8(0) !== 2) {
    throw new RangeError(`expected a frame of telemetry, got ${bytes.byteLength} bytes`);
  }
  const columns = view.getUint8(3);
  const count = columns * view.getUint16(4, true);
  if (bytes.byteLength !== FRAME_BYTES + 4 * count) {
    throw new RangeError(`${count} numbers do not take ${bytes.byteLength} bytes`);
  }
  return {
    stream,
    touch_id: view.getUint8(2),
    columns,
    number: view.getUint32(8, true),
    dropped: view.getUint32(12, true),
    t0_s: view.getFloat64(16, true),
    step_s: view.getFloat64(24, true),
    rows: new Float32Array(bytes, FRAME_BYTES, count), // every engine of today is little-endian
  };
}
