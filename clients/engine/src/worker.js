// The clock of an engine in a worker: it plays what the time since the last turn asks for.

import { EngineCore, MOST_POINTS } from "./core.js";

const TURN_MS = 5;
const LATE_S = 0.1; // what a stalled worker missed is left out, not made up for
const IDLE_S = 0.5; // without a finger the clock rests

let core = null;
let timer = 0;
let began = 0; // time of the engine's sample 0 [ms since the epoch of the page's clock]
let idleSinceS = 0;

const nowMs = () => performance.timeOrigin + performance.now();
const atS = (ms) => (ms - began) / 1000;

function start() {
  if (timer !== 0) return;
  began = nowMs() - core.nowS * 1000;
  idleSinceS = core.nowS;
  timer = setInterval(turn, TURN_MS);
}

function turn() {
  const behindS = atS(nowMs()) - core.nowS;
  if (behindS > LATE_S) began += (behindS - LATE_S) * 1000;
  let points = Math.floor(Math.min(behindS, LATE_S) * core.pointsPerS);
  while (points > 0) {
    const block = core.block(Math.min(points, MOST_POINTS));
    points -= block.points;
    if (block.fingers > 0) idleSinceS = core.nowS;
    const arrays = Object.values(block).filter(ArrayBuffer.isView);
    postMessage({ block }, arrays.map((array) => array.buffer));
  }
  if (core.nowS - idleSinceS > IDLE_S) {
    clearInterval(timer);
    timer = 0;
  }
}

onmessage = ({ data }) => {
  try {
    if (data.open) {
      core = new EngineCore(data.open.module, data.open.program);
      const { sampleRateHz, step, highestV } = core;
      postMessage({ opened: { sampleRateHz, step, highestV } });
    } else if (data.touch) {
      start();
      core.touch({ ...data.touch, tS: atS(data.touch.ms) });
    }
  } catch (error) {
    postMessage({ refused: { message: error.message, code: error.code } });
  }
};
