// navigator.usb, .hid and .serial, as their specifications describe them, with one device each: the
// mock behind a socket of the test. BRIDGE is its address.

{
  const gone = () => new DOMException("The device has been lost.", "NetworkError");

  /** A socket, and a queue of what came that is read as a promise. */
  class Cable {
    #came = [];
    #readers = [];
    #isCut = false;

    static async to(kind, bus) {
      const cable = new Cable();
      const socket = (cable.socket = new WebSocket(`BRIDGE/${kind}`));
      socket.binaryType = "arraybuffer";
      socket.onmessage = ({ data }) => {
        const bytes = new Uint8Array(data);
        if (bus.hangs) return;
        if (cable.onreport) cable.onreport(bytes);
        else if (cable.#readers.length) cable.#readers.shift().resolve(bytes);
        else cable.#came.push(bytes);
      };
      await new Promise((resolve) => (socket.onopen = resolve));
      return cable;
    }
    read() {
      if (this.#isCut) return Promise.reject(gone());
      if (this.#came.length) return Promise.resolve(this.#came.shift());
      return new Promise((resolve, reject) => this.#readers.push({ resolve, reject }));
    }
    write(bytes) {
      if (this.#isCut) throw gone();
      this.socket.send(bytes);
    }
    cut(error = gone()) {
      this.#isCut = true;
      this.socket.close();
      for (const { reject } of this.#readers.splice(0)) reject(error);
    }
  }

  class Bus extends EventTarget {
    isChosen = false;
    hangs = false; // transfers never end

    constructor(make) {
      super();
      this.make = () => (this.device = make(this));
      this.make();
    }
    async choose() {
      if (!navigator.userActivation.isActive) throw new DOMException("a click is needed", "SecurityError");
      if (this.isCancelled) throw new DOMException("No device selected.", "NotFoundError");
      this.isChosen = true;
      return this.device;
    }
    #granted = async () => (this.isChosen && this.device ? [this.device] : []);
    requestDevice = this.choose;
    requestPort = this.choose;
    getDevices = this.#granted;
    getPorts = this.#granted;
    pullOut() {
      const { device } = this;
      this.device = null;
      device.cable?.cut();
      this.#tell("disconnect", device);
    }
    plugIn() {
      this.make();
      this.#tell("connect", this.device);
    }
    #tell(type, device) {
      this.dispatchEvent(Object.assign(new Event(type), { device }));
    }
  }

  class UsbDevice {
    vendorId = 0x1209;
    productId = 0x0001;
    configuration = null;
    #claimed = null;

    constructor(bus) {
      this.bus = bus;
    }
    async open() {
      this.cable = await Cable.to("usb", this.bus);
    }
    async selectConfiguration() {
      const end = (direction) => ({ endpointNumber: 2, direction, type: "bulk", packetSize: 512 });
      const alternates = (interfaceClass, ends) => [{ interfaceClass, endpoints: ends }];
      const interrupt = { endpointNumber: 1, direction: "in", type: "interrupt", packetSize: 64 };
      const vendors = this.bus.hasVendors === false ? [] : [end("in"), end("out")];
      this.configuration = {
        interfaces: [
          { interfaceNumber: 0, alternate: null, alternates: alternates(3, [interrupt]) },
          { interfaceNumber: 1, alternate: null, alternates: alternates(0xff, vendors) },
        ],
      };
    }
    async claimInterface(number) {
      if (number !== 1) throw new DOMException("The class is protected.", "SecurityError");
      if (this.bus.isBusy) throw new DOMException("Unable to claim interface.", "NetworkError");
      this.#claimed = number;
    }
    async transferOut(number, data) {
      if (this.#claimed !== 1 || number !== 2) throw new DOMException("no such endpoint", "NotFoundError");
      if (this.bus.hangs) return new Promise(() => {});
      this.cable.write(data);
      return { status: "ok", bytesWritten: data.byteLength };
    }
    async transferIn(number, length) {
      if (this.#claimed !== 1 || number !== 2) throw new DOMException("no such endpoint", "NotFoundError");
      const bytes = await this.cable.read();
      if (bytes.length > length) throw new DOMException("babble", "NetworkError");
      return { status: "ok", data: new DataView(bytes.buffer) };
    }
    async close() {
      this.cable?.cut(new DOMException("The transfer was cancelled.", "AbortError"));
    }
  }

  class HidDevice {
    vendorId = 0x1209;
    productId = 0x0001;
    oninputreport = null;

    constructor(bus) {
      this.bus = bus;
    }
    async open() {
      this.cable = await Cable.to("hid", this.bus);
      this.cable.onreport = (bytes) =>
        this.oninputreport?.({ device: this, reportId: bytes[0], data: new DataView(bytes.buffer, 1) });
    }
    async sendReport(id, data) {
      if (data.byteLength !== 63) throw new DOMException("Failed to write the report.", "NotAllowedError");
      if (this.bus.hangs) return new Promise(() => {});
      this.cable.write(new Uint8Array([id, ...data]));
    }
    async close() {
      this.cable?.cut();
    }
  }

  class Port {
    constructor(bus) {
      this.bus = bus;
    }
    getInfo() {
      return { usbVendorId: 0x1209, usbProductId: 0x0001 };
    }
    async open({ baudRate }) {
      if (!(baudRate > 0)) throw new TypeError("baudRate must be greater than zero");
      this.cable = await Cable.to("serial", this.bus);
      this.readable = new ReadableStream({
        pull: async (stream) => stream.enqueue(await this.cable.read()),
      });
      this.writable = new WritableStream({
        write: (bytes) => (this.bus.hangs ? new Promise(() => {}) : this.cable.write(bytes)),
      });
    }
    async close() {
      if (this.readable.locked || this.writable.locked) throw new TypeError("Cannot cancel a locked stream");
      this.cable?.cut();
    }
  }

  class HidBus extends Bus {
    requestDevice = async () => {
      if (this.isCancelled) return []; // of this one a cancelled choice is no error
      return [await this.choose()];
    };
  }

  const fakes = { usb: UsbDevice, hid: HidDevice, serial: Port };
  for (const [kind, Fake] of Object.entries(fakes)) {
    const value = new (kind === "hid" ? HidBus : Bus)((bus) => new Fake(bus));
    Object.defineProperty(navigator, kind, { value, configurable: true });
  }
}
