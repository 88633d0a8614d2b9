// The engine itself: WebAssembly, without a clock. Everything is synchronous.

/** Most control points of one block. */
export const MOST_POINTS = 240;

const REFUSED = {
  [-1]: "it is no program of a touch, or is not whole",
  [-2]: "it is of another version; compile the layout again",
  [-3]: "it is damaged: its checksum is another",
  [-4]: "it has a place, a size or a number that cannot be",
  [-5]: "it needs too much memory",
};

/** A program of a touch that the engine refuses. */
export class ProgramError extends Error {
  constructor(code) {
    super(`expected a program of a touch (.hxp), but ${REFUSED[code] ?? `the code is ${code}`}`);
    this.name = "ProgramError";
    this.code = code;
  }
}

/** Compiled code of the engine, from the file beside this one. */
export async function compileEngine(from = new URL("./engine.wasm", import.meta.url)) {
  if (from instanceof WebAssembly.Module) return from;
  return WebAssembly.compile(await bytesOf(from));
}

/** Bytes of an address, or themselves. A file is read by Node. */
export async function bytesOf(from) {
  if (from instanceof ArrayBuffer) return new Uint8Array(from);
  if (ArrayBuffer.isView(from)) return new Uint8Array(from.buffer, from.byteOffset, from.byteLength);
  const url = new URL(from, globalThis.document?.baseURI ?? import.meta.url);
  if (url.protocol === "file:") {
    const { readFile } = await import("node:fs/promises");
    return new Uint8Array(await readFile(url));
  }
  const response = await fetch(url);
  if (!response.ok) throw new Error(`cannot load ${url}: ${response.status} ${response.statusText}`);
  return new Uint8Array(await response.arrayBuffer());
}

export class EngineCore {
  #exports;
  #now = 0;
  #rate;

  /**
   * @param {WebAssembly.Module} module of `compileEngine`
   * @param {Uint8Array} program
   */
  constructor(module, program) {
    this.#exports = new WebAssembly.Instance(module).exports;
    const { memory, space, open } = this.#exports;
    const at = space(program.length) >>> 0;
    if (at === 0) throw new ProgramError(-5);
    new Uint8Array(memory.buffer, at, program.length).set(program);
    const refused = open(program.length);
    if (refused !== 0) throw new ProgramError(refused);
    const header = new DataView(program.buffer, program.byteOffset);
    this.step = header.getUint32(20, true);
    this.#rate = header.getFloat64(80, true);
    this.highestV = header.getFloat64(96, true);
  }

  /** From bytes or an address. */
  static async load(program, wasm) {
    const [module, bytes] = await Promise.all([compileEngine(wasm), bytesOf(program)]);
    return new EngineCore(module, bytes);
  }

  /** Samples in a second. */
  get sampleRateHz() {
    return this.#rate;
  }

  /** Control points in a second. */
  get pointsPerS() {
    return this.#rate / this.step;
  }

  /** Time of the next sample. */
  get nowS() {
    return this.#now / this.#rate;
  }

  /** Take a report of a finger; false if it is dropped. Without a force that of the program counts. */
  touch({ id, tS, xMm, yMm, forceN = 0, isDown = true }) {
    return this.#exports.touch(id, tS, xMm, yMm, forceN, isDown ? 1 : 0) === 1;
  }

  /** Play the next control points. */
  block(points) {
    const at = this.#exports.block(points) >>> 0;
    if (at === 0) throw new RangeError(`points: expected 1 to ${MOST_POINTS}, got ${points}`);
    const { buffer } = this.#exports.memory;
    const felt = new DataView(buffer, at, 68);
    const word = (place) => felt.getUint32(24 + 4 * place, true);
    const fingers = word(0);
    const size = fingers * points;
    const samples = points * this.step;
    const copy = new Float64Array(5 * size + points + samples); // one, to be transferred
    let copied = 0;
    const row = (place, count) => {
      const to = copy.subarray(copied, (copied += count));
      to.set(new Float64Array(buffer, word(place), count));
      return to;
    };
    const firstSample = felt.getFloat64(16, true);
    this.#now = firstSample + samples;
    return {
      fingers,
      points,
      firstSample,
      tS: firstSample / this.#rate,
      xMm: row(3, size),
      yMm: row(4, size),
      forceN: row(5, size),
      wantedMu: row(6, size),
      feltMu: row(7, size),
      status: new Int8Array(buffer, word(8), size).slice(),
      amplitudeV: row(9, points),
      driveV: row(10, samples),
    };
  }
}
