import type { Engine } from "./engine.js";

/** Carries whole frames to a driver, and its bytes back. */
export interface Link {
  name: string;
  /** Whether frames go in HID reports. */
  hasReports: boolean;
  /** Time after which a board that was just plugged in answers. */
  awakeMs?: number;
  send(frame: Uint8Array): Promise<void>;
  close(): Promise<void>;
  onbytes: ((bytes: Uint8Array) => void) | null;
  onlost: ((error: Error) => void) | null;
}

/** Fields of STATUS, in the words of PROTOCOL.md. */
export interface Status {
  state: number;
  fault: number;
  queuedSamples: number;
  freeSamples: number;
  samplesPlayed: number;
  underruns: number;
  faults: number;
  /** Output samples since power-up. */
  clock: bigint;
}

export class ProtocolError extends Error {}
export class LimitError extends Error {}
export class DriverError extends Error {}

/** The last second of a drive, and the limits of the page. */
export class DriveWindow {
  constructor(sampleRateHz: number, ceilingV?: number, slewVPerS?: number);
  get lastV(): number;
  check(volts: Float64Array): void;
  take(volts: Float64Array): void;
  end(restS: number): void;
}

/** The host of one driver. Event "failed" has the error as its detail; the output is then at 0 V. */
export class Driver extends EventTarget {
  private constructor();
  static open(
    link: Link,
    how: { sampleRateHz: number; ceilingV?: number; maxSlewVPerS?: number },
  ): Promise<Driver>;
  readonly isArmed: boolean;
  readonly status: Status | null;
  readonly frameSamples: number;
  /** Samples in the driver that are not played. */
  get ahead(): number;
  arm(): Promise<void>;
  write(volts: ArrayLike<number>): Promise<void>;
  play(engine: Engine): () => Promise<void>;
  stop(): Promise<void>;
  close(): Promise<void>;
}
