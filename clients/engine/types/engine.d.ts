import type { Block, Source } from "./core.js";

export type { Block, Source };
export { ProgramError } from "./core.js";

/** An engine in a worker. */
export class Engine extends EventTarget {
  private constructor();
  static load(program: Source): Promise<Engine>;
  readonly sampleRateHz: number;
  readonly step: number;
  readonly highestV: number;
  readonly worker: Worker;
  touch(
    id: number,
    xMm: number,
    yMm: number,
    how?: { isDown?: boolean; forceN?: number; ms?: number },
  ): void;
  attach(
    element: HTMLElement,
    widthMm: number,
    corner?: { leftMm?: number; topMm?: number },
  ): () => void;
  close(): void;
  addEventListener(
    type: "block",
    listener: (event: CustomEvent<Block>) => void,
    options?: boolean | AddEventListenerOptions,
  ): void;
}
