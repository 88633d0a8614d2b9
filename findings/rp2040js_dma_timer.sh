#!/usr/bin/env bash
# rp2040js 1.4.1 paces DMA by X/Y cycles where the RP2040 takes Y/X.
#
# By the RP2040 datasheet (2.5.7, register TIMER0) a pacing timer makes X/Y requests in a cycle of the system's clock, with X
# in the upper and Y in the lower half of the register. With X = 1 and Y = 1000 at 125 MHz
# that is one transfer in 8 us. The emulator makes one in 0.008 ns: the eight transfers of this program, which a chip
# ends after 64 us, have ended at once. A program that plays samples at a DMA timer's pace runs through its buffers.
# Last run on 2026-11-28: "8 transfers in 0.001 us, 64 by the datasheet".
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
npm install --silent --no-audit --no-fund rp2040js@1.4.1 >/dev/null
cat > program.mjs <<'JS'
import { RP2040 } from "rp2040js";
const chip = new RP2040();
const DMA = 0x50000000, RAM = 0x20000000;
chip.writeUint32(DMA + 0x420, (1 << 16) | 1000);           // TIMER0: X = 1, Y = 1000
chip.writeUint32(DMA + 0x00, RAM);                         // from
chip.writeUint32(DMA + 0x04, RAM + 0x100);                 // to
chip.writeUint32(DMA + 0x08, 8);                           // eight words
chip.writeUint32(DMA + 0x0c, (0x3b << 15) | (2 << 2) | 1); // paced by TIMER0, words, enabled: begin
let us = 0;
while (chip.readUint32(DMA + 0x0c) & (1 << 24) && us < 1000) { // BUSY
  chip.clock.tick(1);
  us = chip.clock.nanos / 1000;
}
console.log(`8 transfers in ${us.toFixed(3)} us, 64 by the datasheet`);
process.exit(us < 1 ? 0 : 1);
JS
node program.mjs
