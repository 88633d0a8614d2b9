import type { Engine } from "./engine.js";

/** Shows the friction of the first finger as a curve, and plays its changes as sound. */
export class VirtualDriver {
  constructor(engine: Engine, canvas: HTMLCanvasElement);
  get curve(): { wantedMu: number[]; feltMu: number[] };
  get sounds(): boolean;
  set sounds(on: boolean);
}
