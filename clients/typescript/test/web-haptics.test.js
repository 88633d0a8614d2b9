/** The effects of the WICG's proposal, over the service of HAPTIX_SERVICE and without it. */

import assert from "node:assert/strict";
import { test } from "node:test";
import WebSocket from "ws";

import { connect } from "../src/haptix.js";
import { find } from "../src/node.js";
import { playHaptics, polyfill } from "../src/web-haptics.js";

test("without a session that may play, the device vibrates", () => {
  const vibrated = [];
  Object.defineProperty(globalThis, "navigator", { configurable: true, writable: true,
    value: { vibrate: (pattern) => !!vibrated.push(pattern) } });
  polyfill(() => null);
  assert.equal(navigator.playHaptics("edge", 0.5), "vibration");
  assert.equal(navigator.playHaptics("error"), "vibration");
  assert.deepEqual(vibrated, [[20], [40, 40, 40]]);
  const own = (globalThis.navigator = { playHaptics: () => "its own" });
  polyfill(() => null);
  assert.equal(own.playHaptics("tick"), "its own");
  assert.equal(playHaptics(null, "tick"), null); // nothing vibrates here
  assert.throws(() => playHaptics(null, "buzz"), /hint,edge,tick,align,success,error, got buzz/);
  assert.throws(() => playHaptics(null, "tick", 2), RangeError);
});

test("the service plays each effect under a finger that slides, as strong as asked", async () => {
  const h = await connect({ name: "web haptics", find, WebSocket });
  const asked = [];
  const play = h.play.bind(h);
  h.play = async (effect) => (asked.push(effect), play(effect));
  await h.acquire(true);
  await h.arm();
  const effects = ["hint", "edge", "tick", "align", "success", "error"];
  h.touch({ x_mm: 1, y_mm: 1, kind: "down" });
  assert.equal(playHaptics(h, "tick"), null); // a click: nothing slides, and nothing vibrates here
  h.touch({ x_mm: 1, y_mm: 1 });
  assert.equal(playHaptics(h, "tick"), null);
  const slide = () => h.touch({ x_mm: 1 + Math.random(), y_mm: 1 });
  for (const effect of effects) assert.equal((slide(), playHaptics(h, effect, 0.5)), "friction");
  assert.deepEqual(asked, effects.map((name) => ({ kind: "effect", name, intensity: 0.5 })));
  slide();
  await h.mute(true);
  assert.equal((slide(), playHaptics(h, "tick")), null); // it would not be felt
  await h.close();
});
