// A Pico with the board's firmware, on rp2040js, or a Pico 2 on rp2350js: a host on its USB, a converter on its SPI,
// an amplifier whose monitor its ADC measures. `node emulator.mjs pico.uf2 output.codes`; lines of JSON come out,
// commands go in.
import { closeSync, existsSync, openSync, readFileSync, writeSync } from "node:fs";
import { createServer } from "node:net";
import { createInterface } from "node:readline";
import { chipOf } from "./chips.mjs";

const NANOSECONDS = 8; // of a cycle at 125 MHz
const HARD_FAULT = 3;
const PIN_ENABLE = 6, PIN_MARK = 7, PIN_LED = 25;
const [, , image, trace] = process.argv;
const say = (what) => process.stdout.write(`${JSON.stringify(what)}\n`);

if (!trace || !existsSync(image)) {
  console.error(image ? `There is no file ${image}.` : "usage: node emulator.mjs FIRMWARE.uf2 OUTPUT.codes");
  process.exit(2);
}
const kind = await chipOf(readFileSync(image));
const output = openSync(trace, "w");
let codes = [], chip, host, offsetCode = 0, isWiredWrong = false, socket = null, playedBefore = 0, flipDue = null;

function write() {
  if (codes.length) writeSync(output, new Uint8Array(new Int16Array(codes).buffer));
  codes = [];
}

/** Power-up, or a reset by the watchdog, which leaves its scratch registers and its cause. */
function start(old) {
  chip = kind.start(say);
  const { watchdog } = chip;
  if (old) {
    watchdog.scratchData.set(old.scratchData);
    watchdog.reason = old.reason;
  }
  // Thrown, as the emulator would call it again at once: the chip is left as it is.
  watchdog.onWatchdogTrigger = () => {
    if (chip.isReset()) throw watchdog;
    say({ error: "the watchdog resets nothing" });
  };
  let code = 0;
  chip.spi[0].onTransmit = (frame) => {
    code = frame - 32768;
    codes.push(code);
    chip.spi[0].completeTransmit(0);
  };
  const measured = () => (isWiredWrong ? 0 : Math.min(Math.max(code + offsetCode + 32768, 0), 65535) >> 4);
  const done = chip.clock.createAlarm(() => chip.adc.completeADCRead(measured(), false));
  chip.adc.onADCRead = () => done.schedule(2000);
  for (const [pin, name] of [[PIN_ENABLE, "enable"], [PIN_MARK, "mark"]])
    chip.gpio[pin].addListener((state) => say({ [name]: state, at: playedBefore + codes.length, us: chip.clock.micros }));
  host = new Host(chip.usbCtrl);
}

/** The host's side of USB: requests one after the other, then packets both ways. */
class Host {
  constructor(usb) {
    this.usb = usb;
    this.toSend = { 1: [], 2: [], 3: [] };
    this.isAsked = {};
    usb.onUSBEnabled = () => usb.resetDevice();
    usb.onResetReceived = () => this.enumerate();
    usb.onEndpointWrite = (endpoint, bytes) => this.came(endpoint, bytes);
    usb.onEndpointRead = (endpoint) => {
      this.isAsked[endpoint] = true;
      if (endpoint === 0) this.usb.endpointReadDone(0, this.data ?? new Uint8Array(0));
      else this.push(endpoint);
    };
  }
  push(endpoint) {
    const packet = this.isAsked[endpoint] && this.toSend[endpoint].shift();
    if (!packet) return;
    this.isAsked[endpoint] = false;
    this.usb.endpointReadDone(endpoint, packet);
  }
  send(endpoint, bytes) {
    for (let at = 0; at < bytes.length; at += 64) this.toSend[endpoint].push(bytes.subarray(at, at + 64));
    this.push(endpoint);
  }
  /** A control request; its answer is an array of bytes. */
  request(type, request, value, index, wanted, data) {
    return new Promise((resolve) => {
      this.pending = { wanted: type & 0x80 ? wanted : 0, got: [], resolve };
      this.data = data;
      this.usb.sendSetupPacket(
        new Uint8Array([type, request, value & 255, value >> 8, index & 255, index >> 8, wanted & 255, wanted >> 8]));
    });
  }
  came(endpoint, bytes) {
    if (endpoint === 0) {
      const { pending } = this;
      if (!pending) return;
      pending.got.push(...bytes);
      if (pending.got.length < pending.wanted && bytes.length === 64) return;
      this.pending = null;
      this.data = undefined;
      chip.clock.createAlarm(() => pending.resolve(pending.got)).schedule(100_000);
    } else if (endpoint === 2) socket?.write(bytes);
    else say({ endpoint, bytes: Buffer.from(bytes).toString("hex") });
  }
  async enumerate() {
    const device = await this.request(0x80, 6, 0x100, 0, 18);
    await this.request(0, 5, 7, 0, 0);
    const head = await this.request(0x80, 6, 0x200, 0, 9);
    const configuration = await this.request(0x80, 6, 0x200, 0, head[2] | (head[3] << 8));
    const strings = [];
    for (const index of device.slice(14, 17)) strings.push(await this.request(0x80, 6, 0x300 | index, 0x409, 255));
    await this.request(0, 9, configuration[5], 0, 0);
    const report = await this.request(0x81, 6, 0x2200, 0, 27);
    await this.request(0x21, 0x20, 0, 2, 7, new Uint8Array([0, 194, 1, 0, 0, 0, 8]));
    const coding = await this.request(0xa1, 0x21, 0, 2, 7);
    say({ device, configuration, strings, report, coding, address: this.usb.readUint32(0) });
    console.error(`The board is up: tcp:127.0.0.1:${server.address().port}`);
  }
}

const commands = {
  send: ({ endpoint, bytes }) => host.send(endpoint, Buffer.from(bytes, "hex")),
  unplug: () => (host.usb.sieStatus |= 1 << 4),
  plug: () => (host.usb.sieStatus &= ~(1 << 4)),
  hang: () => {
    chip.isHung = true;
    say({ hung: chip.clock.micros });
  },
  /** The loop, and no interrupt, stands still from where interrupts are let in. */
  hangLoop: () => {
    chip.isLoopHung = true;
    say({ hung: chip.clock.micros });
  },
  /** The processor meets a fault, whatever it does. */
  fault: () => {
    chip.processor.exceptionEntry(HARD_FAULT);
    chip.processor.waiting = false;
  },
  /** The processor, and no other part, stands still for a while. */
  stall: ({ us }) => (chip.stallsUntil = chip.clock.nanos + us * 1000),
  time: () => say({ time: chip.clock.micros, at: playedBefore + codes.length }),
  wire: ({ isWrong = false, offset = 0 }) => ([isWiredWrong, offsetCode] = [isWrong, offset]),
  /** Amid a call of the core nothing would notice it: docs/safety.md. */
  flip: (where) => (flipDue = where),
};
createInterface({ input: process.stdin }).on("line", (line) => {
  const command = JSON.parse(line);
  commands[command.do](command);
}).on("close", () => {
  console.error("The emulator ends with its standard input.");
  process.exit(0);
});

const server = createServer((client) => {
  socket = client;
  client.setNoDelay(true);
  client.write(`haptix driver 1 ${"0".repeat(32)}\n`); // the challenge of `tcp:`; any answer will do
  let answer = 65;
  client.on("data", (bytes) => {
    const left = Math.min(answer, bytes.length);
    answer -= left;
    if (left < bytes.length) host.send(2, bytes.subarray(left));
  });
  client.on("error", () => {});
  client.on("close", () => {
    if (socket === client) socket = null;
  });
}).listen(0, "127.0.0.1", () => say({ port: server.address().port }));

/** Run for 10 ms of the board's time, then hear the world. */
function run() {
  const until = chip.clock.nanos + 1e7;
  try {
    while (chip.clock.nanos < until) {
      const { processor } = chip;
      // A processor that sleeps with interrupts held back wakes for one that has come before, too.
      if (processor.waiting && kind.wakes(chip)) processor.waiting = false;
      if (processor.waiting && flipDue) {
        chip.sram[flipDue.address] ^= 1 << flipDue.bit;
        flipDue = null;
      }
      const isHeld = chip.isLoopHung && kind.isInLoop(chip);
      if (processor.waiting || chip.isHung || isHeld || chip.clock.nanos < chip.stallsUntil) chip.clock.tick(chip.clock.nanosToNextAlarm || 1000);
      else chip.clock.tick(processor.executeInstruction() * NANOSECONDS);
    }
  } catch (stopped) {
    if (!stopped.scratchData) throw stopped;
    say({ reset: stopped.reason, us: chip.clock.micros, at: playedBefore + codes.length });
    start(stopped);
  }
  playedBefore += codes.length;
  write();
  setImmediate(run);
}

start(null);
run();
process.on("exit", () => closeSync(output));
