import type { Engine } from "./engine.js";

/** Shows the friction of the first finger as a curve, and plays its changes as sound. NaN is no finger. */
export class VirtualDriver extends EventTarget {
  constructor(engine: Engine, canvas: HTMLCanvasElement);
  curve(): Promise<{ wantedMu: Float32Array; feltMu: Float32Array }>;
  get sounds(): boolean;
  set sounds(on: boolean);
  /** Friction by now, some times in a second. */
  addEventListener(
    type: "shown",
    listener: (event: CustomEvent<{ wantedMu: number; feltMu: number }>) => void,
    options?: boolean | AddEventListenerOptions,
  ): void;
}
