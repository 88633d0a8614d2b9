// The chips of the Pico boards, each with its emulator, and what the emulators have wrong put right.

export const emptyFlash = () => new Uint8Array(2 ** 21).fill(0xff);

/** The chip of a UF2 file, with the file in its flash. */
export async function chipOf(uf2) {
  const flash = emptyFlash();
  const [, , , , , , , number] = new Uint32Array(uf2.buffer, uf2.byteOffset, 8);
  const chip = { 0xe48bff56: rp2040, 0xe48bff59: rp2350 }[number];
  for (let at = 0; at < uf2.length; at += 512) {
    const [first, second, , address, bytes, , , family] = new Uint32Array(uf2.buffer, uf2.byteOffset + at, 8);
    if (first !== 0x0a324655 || second !== 0x9e5d5157 || family !== number || !chip) throw Error("no UF2 of a Pico");
    flash.set(uf2.subarray(at + 32, at + 32 + bytes), address - 0x10000000);
  }
  if (chip === rp2040 && bootCrc(flash.subarray(0, 252)) !== new DataView(flash.buffer).getUint32(252, true))
    throw Error("no boot stage");
  return chip(flash);
}

// Both have the fraction of the DMA's pacing timers upside down (findings/rp2040js_dma_timer.sh).
const rightTimer = (chip) =>
  (chip.dma.getTimer = () => (((chip.dma.timer0 & 0xffff) / (chip.dma.timer0 >>> 16)) * 1e6) / chip.clkSys);

/** Registers that hold what is written, where an emulator has none. */
function keep(peripheral, ...offsets) {
  const { readUint32, writeUint32 } = peripheral;
  const kept = {};
  peripheral.writeUint32 = (offset, value) => {
    if (offsets.includes(offset)) kept[offset] = value;
    writeUint32.call(peripheral, offset, value);
  };
  peripheral.readUint32 = (offset) => (offsets.includes(offset) ? kept[offset] ?? 0 : readUint32.call(peripheral, offset));
  return kept;
}

const logger = (say) => ({ debug() {}, info() {}, warn() {}, error: (where, what) => say({ error: `${where}: ${what}` }) });

/** What the boot ROM does, which is not ours to copy: it looks at the check sum of the second stage. */
function bootCrc(stage) {
  let crc = 0xffffffff;
  for (const byte of stage)
    for (let bit = 7, next = byte; bit >= 0; bit--) {
      const top = (crc >>> 31) ^ ((next >> bit) & 1);
      crc = ((crc << 1) ^ (top ? 0x04c11db7 : 0)) >>> 0;
    }
  return crc;
}

export async function rp2040(flash) {
  const { RP2040 } = await import("rp2040js");
  return {
    start(say) {
      const chip = new RP2040();
      chip.logger = logger(say);
      chip.flash.set(flash);
      chip.core.PC = 0x10000000;
      chip.processor = chip.core;
      chip.watchdog = chip.peripherals[0x40058];
      // All but the oscillators are to be reset by the watchdog; the emulator resets all, always.
      chip.isReset = () => (chip.peripherals[0x40010].wdsel & 0x1fffc) === 0x1fffc;
      rightTimer(chip);
      return chip;
    },
    /** Whether an interrupt is there, also for a processor that holds it back. */
    wakes: ({ processor }) => processor.interruptsUpdated && processor.checkForInterrupts(),
    /** Whether the loop runs, with interrupts let in of which none is there. */
    isInLoop: ({ processor }) =>
      processor.IPSR === 0 && !processor.PM && !processor.waiting && !processor.checkForInterrupts(),
  };
}

export async function rp2350(flash) {
  const { RP2350 } = await import("./rp2350js.mjs");
  return {
    /** From the boot ROM on, with its first Cortex-M33 alone: the other one only waits. */
    start(say) {
      const chip = new RP2350({ coreArch: "arm" });
      chip.logger = logger(say);
      chip.flash.set(flash);
      chip.processor = chip.core[0];
      rightTimer(chip);
      for (const pin of chip.gpio) {
        pin.padValue = 0x116; // as a reset leaves it: isolated, pulled down
        // rp2350js 2.0.1 reads the overrides where the RP2040 has them, and does not know isolated pads.
        Object.defineProperties(pin, {
          outputOverride: { get: () => (pin.ctrl >> 12) & 3 },
          outputEnableOverride: { get: () => (pin.ctrl >> 14) & 3 },
          outputEnable: { get: () => !(pin.padValue & 0x100) && chip.gpioRawOutputEnable(pin.index) },
        });
      }
      // It would count as the RP2040's does, twice in a microsecond, and without ticks.
      const ticks = keep(chip.peripherals[0x40108], 0x30, 0x34);
      Object.defineProperty(chip.watchdog.timer, "baseFreq", { get: () => (ticks[0x30] & 1 ? 12e6 / ticks[0x34] : 0) });
      const chosen = keep(chip.peripherals[0x40018], 8);
      chip.isReset = () => chosen[8] === 0x1fffff3;
      keep(chip.usbCtrl, 0); // its address
      return chip;
    },
    wakes({ processor }) {
      const { nvicPending, nvicEnabled } = processor.ppb();
      const wakes = (nvicPending[0] & nvicEnabled[0]) | (nvicPending[1] & nvicEnabled[1]);
      if (wakes) processor.interruptsUpdated = true;
      return wakes;
    },
    isInLoop: ({ processor }) =>
      processor.regs.ipsr === 0 && !processor.regs.primask && !processor.waiting && !processor.checkForInterrupts(),
  };
}
