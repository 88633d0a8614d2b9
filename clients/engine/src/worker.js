// The clock of an engine in a worker: it plays what the time since the last turn asks for.

import { EngineCore, MOST_POINTS } from "./core.js";
import { Curve } from "./curve.js";

const TURN_MS = 5;
const UNHEARD_MS = 10; // of blocks that only the curve takes
const FOLLOWED = 0.1; // of a difference from the driver's clock, each turn
const LATE_S = 0.1; // what a stalled worker missed is left out, not made up for
const IDLE_S = 0.5; // without a finger the clock rests

let core = null;
let curve = null;
let driver = null;
let opened = 0; // number of the driver
const blocks = new EventTarget(); // for the driver
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
  timer = setInterval(turn, isHeard || driver ? TURN_MS : UNHEARD_MS);
}

function turn() {
  clearTimeout(soon);
  soon = 0;
  const behindS = atS(nowMs()) - core.nowS;
  let points = Math.floor(Math.min(behindS, LATE_S) * core.pointsPerS);
  if (driver?.isArmed) {
    // Its clock is the master: a driver that is slower gets no more than it plays.
    points = Math.floor(driver.short / core.step);
    began += FOLLOWED * (1000 * behindS - (1000 * points) / core.pointsPerS);
  } else if (behindS > LATE_S) began += (behindS - LATE_S) * 1000;
  while (points > 0) {
    const block = core.block(Math.min(points, MOST_POINTS));
    points -= block.points;
    if (block.fingers > 0) idleSinceS = core.nowS;
    curve?.take(block);
    blocks.dispatchEvent(new CustomEvent("block", { detail: block }));
    if (isHeard) postMessage({ block }, [block.driveV.buffer]);
  }
  if (core.nowS - idleSinceS > IDLE_S) {
    clearInterval(timer);
    timer = 0;
  }
}

async function openDriver(number, { kind, options, limits }) {
  const [{ Driver }, { openLink }] = await Promise.all([import("./driver.js"), import("./links.js")]);
  postMessage({ driver: { number: opened, isArmed: false } });
  opened = 0;
  await driver?.close();
  const { sampleRateHz } = core;
  driver = await Driver.open(await openLink(kind, { sampleRateHz, ...options }), { sampleRateHz, ...limits });
  opened = number;
  driver.addEventListener("failed", ({ detail: { name, message } }) =>
    postMessage({ driver: { number, isArmed: false, failed: { name, message } } }),
  );
  driver.play(blocks);
  if (timer !== 0) tick();
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
  async drive({ number, id, name, how }) {
    const answer = (more) => postMessage({ driver: { number, id, isArmed: number === opened && driver.isArmed, ...more } });
    try {
      if (name === "open") await openDriver(number, how);
      else if (number === opened) await driver[name]();
      else if (name === "arm") throw new Error("another driver was opened since; open this one again");
      answer();
    } catch ({ name, message }) {
      answer({ error: { name, message } });
    }
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
