// A link to a virtual driver: the firmware as WebAssembly, played at the page's clock.

import { compileEngine } from "./core.js";
import { DriverError } from "./driver.js";

const OUTPUT_HZ = 48_000;
const TURN_MS = 2;
const ENDS_MS = 200; // by then the watchdog and the ramp have ended the output
const MOST_S = 1; // of a page that slept
const CODE_V = 200 / 32767;

/** Its limits and its watchdog are those of a board; `onplayed` takes the output [V], `OUTPUT_HZ` samples a second. */
export async function openVirtual(link, { sampleRateHz = OUTPUT_HZ, onplayed }) {
  const module = await compileEngine(new URL("./firmware.wasm", import.meta.url));
  const { memory, begin, bytes, codes, receive, transmit, play } = new WebAssembly.Instance(module).exports;
  if (!begin(OUTPUT_HZ, sampleRateHz))
    throw new DriverError(`the virtual driver plays ${OUTPUT_HZ} Hz or a whole part of it, not ${sampleRateHz} Hz`);
  const buffer = new Uint8Array(memory.buffer, bytes(), 4096);
  const output = new Int16Array(memory.buffer, codes(), 1024);
  let playedMs = performance.now();
  const turn = () => {
    const nowMs = performance.now();
    playedMs = Math.max(playedMs, nowMs - MOST_S * 1000);
    for (let left; (left = Math.floor(((nowMs - playedMs) * OUTPUT_HZ) / 1000)) > 0; ) {
      const count = Math.min(left, output.length);
      play(count);
      playedMs += (count * 1000) / OUTPUT_HZ;
      onplayed?.(Float64Array.from(output.subarray(0, count), (code) => code * CODE_V));
    }
    for (let count; (count = transmit()) > 0; ) link.onbytes?.(buffer.slice(0, count));
  };
  const timer = setInterval(turn, TURN_MS);
  return {
    async send(frame) {
      turn(); // up to now, as a board has played when a frame arrives
      for (let at = 0; at < frame.length; at += buffer.length) {
        const piece = frame.subarray(at, at + buffer.length);
        buffer.set(piece);
        receive(piece.length);
      }
    },
    async close() {
      setTimeout(clearInterval, ENDS_MS, timer); // a board plays on, too
    },
  };
}
