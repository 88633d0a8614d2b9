/** A block of friction and drive; arrays of fingers go finger after finger. */
export interface Block {
  fingers: number;
  points: number;
  /** Number of the first sample, and its time on the clock of samples. */
  firstSample: number;
  tS: number;
  /** Of each finger at each control point. */
  xMm: Float64Array;
  yMm: Float64Array;
  forceN: Float64Array;
  wantedMu: Float64Array;
  feltMu: Float64Array;
  /** Numbers of haptix.model.Status: 0 where the wanted friction can be given. */
  status: Int8Array;
  /** Amplitude of the carrier at each control point. */
  amplitudeV: Float64Array;
  driveV: Float64Array;
}

export interface Touch {
  id: number;
  /** Time on the clock of samples. */
  tS: number;
  xMm: number;
  yMm: number;
  forceN?: number;
  isDown?: boolean;
}

export const MOST_POINTS: number;

export class ProgramError extends Error {
  constructor(code: number);
  readonly code: number;
}

/** Address of a file, or its bytes. */
export type Source = string | URL | ArrayBuffer | Uint8Array;

export function compileEngine(from?: Source | WebAssembly.Module): Promise<WebAssembly.Module>;
export function bytesOf(from: Source): Promise<Uint8Array>;

/** The engine without a clock: synchronous, in Node, a worker or a page. */
export class EngineCore {
  constructor(module: WebAssembly.Module, program: Uint8Array);
  static load(program: Source, wasm?: Source | WebAssembly.Module): Promise<EngineCore>;
  readonly step: number;
  readonly highestV: number;
  get sampleRateHz(): number;
  get pointsPerS(): number;
  get nowS(): number;
  touch(touch: Touch): boolean;
  block(points: number): Block;
}
