import type { Link } from "./driver.js";

export interface LinkOptions {
  /** Open the driver that a person chose before, without asking. */
  again?: boolean;
  vendorId?: number;
  productId?: number;
  /** Serial: let a person choose among all ports, not of these USB numbers only. */
  anyPort?: boolean;
  baudRate?: number;
}

/** Shows the browser's list of drivers, within a person's click. */
export function openLink(kind: "usb" | "hid" | "serial", options?: LinkOptions): Promise<Link>;
