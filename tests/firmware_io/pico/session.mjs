// A program for the RP2040, from its second stage to its breakpoint: `node session.mjs program.elf`.
import { readFileSync } from "node:fs";
import { RP2040 } from "rp2040js";

const elf = readFileSync(process.argv[2]);
const chip = new RP2040();
chip.logger = { debug() {}, info() {}, warn() {}, error: (where, what) => console.log(`${where}: ${what}`) };
for (let at = elf.readUInt32LE(28), n = elf.readUInt16LE(44); n > 0; n--, at += 32) {
  const [kind, offset, , address, bytes] = [0, 4, 8, 12, 16].map((field) => elf.readUInt32LE(at + field));
  if (kind === 1 && bytes) chip.flash.set(elf.subarray(offset, offset + bytes), address - 0x10000000);
}
chip.core.PC = 0x10000000;
let isRunning = true;
chip.onBreak = () => {
  isRunning = false;
  let words = "";
  for (let at = chip.core.registers[0] - 0x20000000; chip.sram[at]; at++) words += String.fromCharCode(chip.sram[at]);
  console.log(words);
};
while (isRunning) chip.clock.tick(chip.core.executeInstruction() * 8);
