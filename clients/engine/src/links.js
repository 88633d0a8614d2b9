// Links of a page to a driver, over WebUSB, WebHID and WebSerial, or to a virtual one: whole frames out, bytes in.

import { DriverError } from "./driver.js";
import { fromReport, toReports } from "./protocol.js";
import { openVirtual } from "./virtual-link.js";

const READ_BYTES = 4096;
const AWAKE_MS = { usb: 1000, hid: 1000, serial: 3000 }; // a board just plugged in answers by then

// How a person chooses a device, those chosen before, and what opens one: a link's send, close, and what else it has.
const WAYS = {
  usb: {
    ask: (usb, { vendorId, productId }) => usb.requestDevice({ filters: [{ vendorId, productId }] }),
    known: (usb) => usb.getDevices(),
    open: openUsb,
  },
  hid: {
    ask: async (hid, { vendorId, productId }) =>
      (await hid.requestDevice({ filters: [{ vendorId, productId, usagePage: 0xff00 }] }))[0],
    known: (hid) => hid.getDevices(),
    open: openHid,
  },
  serial: {
    ask: (serial, { vendorId, productId, anyPort }) =>
      serial.requestPort({ filters: anyPort ? [] : [{ usbVendorId: vendorId, usbProductId: productId }] }),
    known: async (serial) => serial.getPorts(),
    open: openSerial,
  },
  virtual: { device: { close: async () => {} }, open: (_, link, options) => openVirtual(link, options) },
};

/** The device of a link, and how many like it a person chose; `again` takes the first of these without asking. */
export async function chooseDevice(kind, options) {
  const way = WAYS[kind];
  if (way?.device) return { device: way.device, alike: 1 }; // nobody chooses it
  const chosen = { vendorId: 0x1209, productId: 0x0001, anyPort: false, ...options };
  const api = globalThis.navigator?.[kind];
  if (!api)
    throw new DriverError(`there is no navigator.${kind}: open the page by https in Chrome, Edge or Opera on a computer`);
  const isIt = (device) => {
    const { usbVendorId, usbProductId } = device.getInfo?.() ?? { usbVendorId: device.vendorId, usbProductId: device.productId };
    return chosen.anyPort || (usbVendorId === chosen.vendorId && usbProductId === chosen.productId);
  };
  const asked = options.again ? null : await way.ask(api, chosen);
  const known = (await way.known(api)).filter(isIt);
  const device = options.again ? known[0] : asked;
  if (!device) throw new DOMException("no driver was chosen", "NotFoundError");
  return { device, alike: known.length };
}

/**
 * Open a driver that a person chooses from the browser's list, in the listener of a click; `again` opens the one chosen before.
 *
 * @param {"usb" | "hid" | "serial" | "virtual"} kind
 * @returns {Promise<import("./driver.js").Link>}
 */
export async function openLink(kind, options = {}) {
  const { device } = await chooseDevice(kind, options);
  const link = { name: kind, hasReports: kind === "hid", awakeMs: AWAKE_MS[kind], onbytes: null, onlost: null };
  try {
    return Object.assign(link, await WAYS[kind].open(device, link, options));
  } catch (error) {
    await device.close().catch(() => {});
    if (error instanceof DriverError) throw error;
    throw new DriverError(
      `the driver cannot be opened over ${kind}: ${error.message}; close what else uses it, and see \`haptix doctor\``,
      { cause: error },
    );
  }
}

/** The first bulk endpoints both ways of an interface of class 0xff. */
async function openUsb(device, link) {
  await device.open();
  if (!device.configuration) await device.selectConfiguration(1);
  const faces = device.configuration.interfaces.map(({ interfaceNumber, alternates: [its] }) => {
    const bulk = (way) => its.endpoints.find(({ type, direction }) => type === "bulk" && direction === way)?.endpointNumber;
    return { interfaceNumber, isOurs: its.interfaceClass === 0xff, to: bulk("out"), from: bulk("in") };
  });
  const face = faces.find(({ isOurs, to, from }) => isOurs && to && from);
  if (!face) throw new DriverError("the driver has no interface of class 0xff with bulk endpoints; try hid");
  await device.claimInterface(face.interfaceNumber);
  const checked = ({ status, data }) => {
    if (status !== "ok") throw new DriverError(`a transfer over USB ended in ${status}`);
    return data;
  };
  follow(link, async () => {
    const data = checked(await device.transferIn(face.from, READ_BYTES));
    return new Uint8Array(data.buffer, data.byteOffset, data.byteLength);
  });
  return {
    send: async (frame) => void checked(await device.transferOut(face.to, frame)),
    close: () => device.close(),
  };
}

/** Reports of id 1. */
async function openHid(device, link) {
  await device.open();
  const { hid } = navigator;
  const lost = ({ device: its }) => its === device && link.onlost?.(new DriverError("the driver was unplugged"));
  hid.addEventListener("disconnect", lost);
  device.oninputreport = ({ reportId, data }) => {
    if (reportId !== 1) return;
    try {
      link.onbytes?.(fromReport(new Uint8Array(data.buffer, data.byteOffset, data.byteLength)));
    } catch (error) {
      link.onlost?.(error);
    }
  };
  return {
    async send(frame) {
      for (const report of toReports(frame)) await device.sendReport(1, report);
    },
    close() {
      device.oninputreport = null;
      hid.removeEventListener("disconnect", lost);
      return device.close();
    },
  };
}

async function openSerial(port, link, { baudRate = 2_000_000 }) {
  await port.open({ baudRate, bufferSize: READ_BYTES });
  const [writer, reader] = [port.writable.getWriter(), port.readable.getReader()];
  follow(link, async () => (await reader.read()).value);
  return {
    send: (frame) => writer.write(frame),
    async close() {
      await reader.cancel().catch(() => {});
      await writer.abort().catch(() => {}); // of a port that takes no bytes, else it never closes
      reader.releaseLock();
      writer.releaseLock();
      await port.close();
    },
  };
}

/** Hand on what is read, until nothing more can be. */
async function follow(link, read) {
  let why = "its connection has ended";
  try {
    for (let bytes; (bytes = await read()) !== undefined; ) link.onbytes?.(bytes);
  } catch (error) {
    why = error.message;
  }
  link.onlost?.(new DriverError(`the driver is gone: ${why}`));
}
