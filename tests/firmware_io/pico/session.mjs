// A program for an RP2040 or RP2350, from its boot.S to its breakpoint: `node session.mjs rp2350 program.elf`.
import { readFileSync } from "node:fs";
import * as chips from "./chips.mjs";

const [, , name, file] = process.argv;
const elf = readFileSync(file), flash = chips.emptyFlash();
for (let at = elf.readUInt32LE(28), n = elf.readUInt16LE(44); n > 0; n--, at += 32) {
  const [kind, offset, , address, bytes] = [0, 4, 8, 12, 16].map((field) => elf.readUInt32LE(at + field));
  if (kind === 1 && bytes) flash.set(elf.subarray(offset, offset + bytes), address - 0x10000000);
}
const chip = (await chips[name](flash)).start((what) => console.log(what.error));
const { processor } = chip;
let isRunning = true;
(name === "rp2040" ? chip : processor).onBreak = () => {
  isRunning = false;
  let words = "";
  for (let at = (processor.registers ?? processor.regs.r)[0] - 0x20000000; chip.sram[at]; at++) words += String.fromCharCode(chip.sram[at]);
  console.log(words);
};
while (isRunning) chip.clock.tick(processor.executeInstruction() * 8);
