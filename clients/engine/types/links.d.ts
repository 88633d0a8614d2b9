import type { Link } from "./driver.js";

export interface LinkOptions {
  /** Open the driver that a person chose before, without asking. */
  again?: boolean;
  vendorId?: number;
  productId?: number;
  /** Serial: let a person choose among all ports, not of these USB numbers only. */
  anyPort?: boolean;
  baudRate?: number;
  /** Virtual: of the samples that it takes; 48000 Hz or a whole part of it. */
  sampleRateHz?: number;
  /** Virtual: takes its output [V], 48000 samples a second. */
  onplayed?(volts: Float64Array): void;
}

export type LinkKind = "usb" | "hid" | "serial" | "virtual";

/** Shows the browser's list of drivers, within a person's click; a virtual one is the firmware as WebAssembly. */
export function openLink(kind: LinkKind, options?: LinkOptions): Promise<Link>;
