import type { Engine } from "./engine.js";
import type { LinkKind, LinkOptions } from "./links.js";

/** A driver that the engine's worker plays. Event "failed" has the error as its detail; the output is then at 0 V. */
export class PageDriver extends EventTarget {
  private constructor();
  static open(
    kind: LinkKind,
    engine: Engine,
    options?: LinkOptions & { ceilingV?: number; maxSlewVPerS?: number },
  ): Promise<PageDriver>;
  readonly isArmed: boolean;
  arm(): Promise<void>;
  stop(): Promise<void>;
  close(): Promise<void>;
}
