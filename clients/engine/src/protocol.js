// The bytes of PROTOCOL.md, version 4: frames, their parser, HID reports.

export const OLDEST_VERSION = 3;
export const VERSION = 4;
export const REPORT_BYTES = 64;
const OVERHEAD = 16; // header and CRC-32
const MOST_PAYLOAD = 1024; // of a device's frame
const REPORT_DATA = REPORT_BYTES - 2;

export const FAULTS = [
  "none", "DAMAGED", "VERSION", "KIND", "LENGTH", "SEQUENCE", "SAMPLE_INDEX", "NOT_ARMED", "ALREADY_ARMED",
  "NOT_SET_UP", "SETUP", "MODE", "CEILING", "SLEW", "QUEUE_FULL", "STARVED", "TRUNCATED", "ENERGY", "MEAN",
  "PEAK_CURRENT", "RMS_CURRENT", "NO_CURRENT", "OVERLOAD",
];

/** Bytes that are no frame of a driver, or a message that is none. */
export class ProtocolError extends Error {
  name = "ProtocolError";
}

// A field is a name and the bytes of an unsigned number, negative of a signed one, or "text".
const CLOCK = ["clock", 8];
const KINDS = {
  HELLO: [0x01, ["oldestVersion", 1], ["newestVersion", 1]],
  SETUP: [
    0x02, ["mode", 2], ["watchdogMs", 2], ["sampleRateHz", 4], ["fullScaleMv", 4], ["ceilingMv", 4],
    ["maxSlewVPerS", 4], ["carrierMhz", 4], ["leadUs", 4], ["statusMs", 2],
  ],
  ARM: [0x03],
  STREAM: [0x04, ["sampleIndex", 4]],
  STOP: [0x05],
  PING: [0x06, ["token", 4]],
  REVISE: [0x07, ["sampleIndex", 4], ["revision", 2]],
  MARK: [0x08, ["sampleIndex", 4], ["code", 2]],
  CAPABILITIES: [
    0x81, ["oldestVersion", 1], ["newestVersion", 1], ["reportBytes", 2], ["outputRateHz", 4], ["fullScaleMv", 4],
    ["ceilingMv", 4], ["maxSlewVPerS", 4], ["queueSamples", 4], ["maxFrameSamples", 2], ["maxWatchdogMs", 2],
    ["name", "text"], ["serial", "text"], ["calibrationId", "text"], ["flags", 2], ["rateCount", 2],
  ],
  STATUS: [
    0x82, ["state", 1], ["fault", 1], ["nextSequence", 2], ["token", 4], ["queuedSamples", 4], ["freeSamples", 4],
    ["samplesPlayed", 4], ["underruns", 4], ["faults", 4], CLOCK, ["revisions", 2], ["refused", 2],
    ["marginSamples", -4],
  ],
  FAULT: [0x83, ["code", 1], ["field", 1], ["ofSequence", 2], ["expected", 4], ["got", 4], CLOCK],
  TOUCH: [0x84, CLOCK, ["xUm", 4], ["yUm", 4], ["normalForceMn", 2], ["contact", 1], ["phase", 1]],
  MARKED: [0x85, CLOCK, ["sampleIndex", 4], ["code", 2]],
  SENSE: [0x86],
};
const NAMES = new Map(Object.entries(KINDS).map(([name, [kind]]) => [kind, name]));
const sizeOf = (fields) => fields.reduce((sum, [, size]) => sum + (size === "text" ? 16 : Math.abs(size)), 0);

export function crc16(bytes) {
  let crc = 0xffff;
  for (const byte of bytes) {
    crc ^= byte << 8;
    for (let i = 0; i < 8; i++) crc = ((crc << 1) ^ (crc & 0x8000 ? 0x1021 : 0)) & 0xffff;
  }
  return crc;
}

const TABLE = Uint32Array.from({ length: 256 }, (_, crc) => {
  for (let i = 0; i < 8; i++) crc = (crc >>> 1) ^ (crc & 1 ? 0xedb88320 : 0);
  return crc;
});

export function crc32(bytes) {
  let crc = ~0;
  for (const byte of bytes) crc = (crc >>> 8) ^ TABLE[(crc ^ byte) & 255];
  return ~crc >>> 0;
}

/** Bytes of a frame; `fields` of PROTOCOL.md, and the `codes` (Int16Array) of STREAM and REVISE. */
export function encode(name, sequence, fields = {}, version = VERSION) {
  const [kind, ...layout] = KINDS[name];
  const codes = fields.codes ?? [];
  const length = sizeOf(layout) + 2 * codes.length;
  const view = new DataView(new ArrayBuffer(length + OVERHEAD));
  const bytes = new Uint8Array(view.buffer);
  bytes.set([0x48, 0x58, version, kind]);
  view.setUint16(4, sequence, true);
  view.setUint16(6, length, true);
  view.setUint16(8, codes.length ? fields.mode : 0, true);
  view.setUint16(10, crc16(bytes.subarray(0, 10)), true);
  let at = 12;
  for (const [field, size] of layout) {
    const value = fields[field];
    if (!Number.isInteger(value) || value < 0 || value >= 256 ** size)
      throw new ProtocolError(`${name}: ${field} has ${size} bytes, but ${value} was given`);
    view[`setUint${8 * size}`](at, value, true);
    at += size;
  }
  for (const code of codes) {
    view.setInt16(at, code, true);
    at += 2;
  }
  view.setUint32(at, crc32(bytes.subarray(0, at)), true);
  return bytes;
}

/** Content of a frame that was found valid. */
function decode(bytes) {
  const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.length);
  const name = NAMES.get(bytes[3]);
  const message = { kind: name, version: bytes[2], sequence: view.getUint16(4, true) };
  if (name === undefined) return { ...message, kind: "UNKNOWN" };
  const end = bytes.length - 4;
  let layout = KINDS[name].slice(1);
  if (name === "STATUS" && end - 12 === 36) layout = layout.slice(0, -3); // version 3
  let at = 12;
  if (end - at < sizeOf(layout)) throw new ProtocolError(`${name} came with ${end - at} bytes, too few`);
  for (const [field, size] of layout) {
    if (size === "text") message[field] = String.fromCharCode(...bytes.subarray(at, at + 16)).split("\0")[0];
    else if (size === 8) message[field] = view.getBigUint64(at, true);
    else message[field] = view[`get${size < 0 ? "Int" : "Uint"}${8 * Math.abs(size)}`](at, true);
    at += size === "text" ? 16 : Math.abs(size);
  }
  if (name === "CAPABILITIES") {
    const count = message.rateCount;
    if (count < 1 || count > 8 || end - at !== 8 * count + (message.version >= 4 ? 4 : 0))
      throw new ProtocolError(`CAPABILITIES of ${count} rates came with ${end - 12} bytes`);
    message.rates = Array.from({ length: count }, (_, i) => ({
      sampleRateHz: view.getUint32(at + 8 * i, true),
      modes: view.getUint32(at + 8 * i + 4, true),
    }));
    if (message.version >= 4) message.guard = view.getUint32(at + 8 * count, true);
  } else if (name === "STREAM" || name === "REVISE") {
    message.mode = view.getUint16(8, true);
    message.codes = Int16Array.from({ length: (end - at) >> 1 }, (_, i) => view.getInt16(at + 2 * i, true));
  } else if (name !== "SENSE" && at !== end) {
    throw new ProtocolError(`${name} came with ${end - 12} bytes, too many`);
  }
  return message;
}

/** Finds a driver's frames in bytes that come in pieces; what is damaged is skipped. */
export class FrameParser {
  #held = new Uint8Array(0);
  skippedBytes = 0;

  feed(data) {
    let bytes = new Uint8Array(this.#held.length + data.length);
    bytes.set(this.#held);
    bytes.set(data, this.#held.length);
    const found = [];
    const skip = () => {
      bytes = bytes.subarray(1);
      this.skippedBytes += 1;
    };
    while (bytes.length > 0) {
      if (bytes[0] !== 0x48 || (bytes.length > 1 && bytes[1] !== 0x58)) {
        skip();
        continue;
      }
      if (bytes.length < 12) break;
      const header = new DataView(bytes.buffer, bytes.byteOffset, 12);
      const length = header.getUint16(6, true);
      if (header.getUint16(10, true) !== crc16(bytes.subarray(0, 10)) || length > MOST_PAYLOAD) {
        skip();
        continue;
      }
      const size = length + OVERHEAD;
      if (bytes.length < size) break;
      const frame = bytes.subarray(0, size);
      const carried = new DataView(frame.buffer, frame.byteOffset).getUint32(size - 4, true);
      if (carried !== crc32(frame.subarray(0, -4))) {
        skip();
        continue;
      }
      bytes = bytes.subarray(size);
      found.push(decode(frame));
    }
    this.#held = bytes.slice();
    return found;
  }
}

/** Reports of a frame, without their id (WebHID states it beside them): 63 bytes each. */
export function toReports(frame) {
  const reports = [];
  for (let at = 0; at < frame.length; at += REPORT_DATA) {
    const piece = frame.subarray(at, at + REPORT_DATA);
    const report = new Uint8Array(REPORT_BYTES - 1);
    report[0] = piece.length | (at === 0 ? 0x80 : 0);
    report.set(piece, 1);
    reports.push(report);
  }
  return reports;
}

/** Bytes that a report without its id carries. */
export function fromReport(report) {
  const size = report[0] & 0x7f;
  if (report.length !== REPORT_BYTES - 1 || size > REPORT_DATA)
    throw new ProtocolError(`a report of ${report.length} bytes announces ${size} bytes`);
  return report.subarray(1, 1 + size);
}
