// The clock of an engine in a worker: it plays what the time since the last turn asks for.

import { EngineCore, MOST_POINTS } from "./core.js";
import { Curve } from "./curve.js";

const TURN_MS = 5;
const UNHEARD_MS = 10; // of blocks that only the curve takes
const LATE_S = 0.1; // what a stalled worker missed is left out, not made up for
const IDLE_S = 0.5; // without a finger the clock rests

let core = null;
let curve = null;
let isHeard = false; // whether the page takes the blocks
let timer = 0;
let soon = 0;
let began = 0; // time of the engine's sample 0 [ms since the epoch of the page's clock]
let idleSinceS = 0;

const nowMs = () => performance.timeOrigin + performance.now();
const atS = (ms) => (ms - began) / 1000;

function start() {
  if (timer !== 0) return;
  began = nowMs() - core.nowS * 1000;
  idleSinceS = core.nowS;
  tick();
}

function tick() {
  clearInterval(timer);
  timer = setInterval(turn, isHeard ? TURN_MS : UNHEARD_MS);
}

function turn() {
  clearTimeout(soon);
  soon = 0;
  const behindS = atS(nowMs()) - core.nowS;
  if (behindS > LATE_S) began += (behindS - LATE_S) * 1000;
  let points = Math.floor(Math.min(behindS, LATE_S) * core.pointsPerS);
  while (points > 0) {
    const block = core.block(Math.min(points, MOST_POINTS));
    points -= block.points;
    if (block.fingers > 0) idleSinceS = core.nowS;
    curve?.take(block);
    if (isHeard) postMessage({ block }, [block.driveV.buffer]);
  }
  if (core.nowS - idleSinceS > IDLE_S) {
    clearInterval(timer);
    timer = 0;
  }
}

const HEARD = {
  open({ module, program }) {
    core = new EngineCore(module, program);
    const { sampleRateHz, step, highestV } = core;
    postMessage({ opened: { sampleRateHz, step, highestV } });
  },
  touches(touches) {
    start();
    for (const touch of touches) core.touch({ ...touch, tS: atS(touch.ms) });
    soon ||= setTimeout(turn); // not when the clock is due, but once for reports of several fingers
  },
  hear(on) {
    isHeard = on;
    if (timer !== 0) tick();
  },
  curve: (canvas) => (curve = new Curve(canvas, core.pointsPerS)),
  look: (look) => curve.look(look),
  rows: () => postMessage({ rows: curve.rows }),
  sounds: (on) => (curve.sounds = on),
};

onmessage = ({ data }) => {
  try {
    for (const [name, value] of Object.entries(data)) HEARD[name](value);
  } catch (error) {
    postMessage({ refused: { message: error.message, code: error.code } });
  }
};
