/** The client against the service of HAPTIX_SERVICE, whose engine echoes (tests/clients). */

import assert from "node:assert/strict";
import { after, test } from "node:test";
import { setTimeout as sleep } from "node:timers/promises";
import WebSocket from "ws";

import { connect, feel, now, Refused } from "../src/haptix.js";
import { http } from "../src/connection.js";
import { find } from "../src/node.js";
import { Pointers } from "../src/pointers.js";

const sockets = [];
class Kept extends WebSocket {
  constructor(url, protocol) {
    super(url, protocol);
    sockets.push(this);
  }
}
const sessions = [];
const open = async (name = "test") => {
  sessions.push(await connect({ name, find, WebSocket: Kept }));
  return sessions.at(-1);
};
after(() => Promise.all(sessions.map((session) => session.close()))); // also those of failed tests
const next = (session, kind) =>
  new Promise((resolve) => {
    const off = session.on(kind, (event) => (off(), resolve(event)));
  });

const BOX = { left: 100, top: 50, width: 200, height: 80 };
const ELEMENT = { getBoundingClientRect: () => BOX, offsetWidth: 200, offsetHeight: 80 };
function pointerEvent(type, { buttons = 1, coalesced = [], ...fields } = {}) {
  const at = { pointerId: 7, timeStamp: performance.now(), clientX: 140, clientY: 50, ...fields };
  const several = coalesced.map((each) => ({ ...at, ...each }));
  return { type, buttons, ...at, currentTarget: ELEMENT, getCoalescedEvents: () => several };
}

test("touches go out and contacts come back by this clock", async () => {
  const h = await open();
  await h.geometry({ px_per_mm: 4, origin_mm: [10, 5] });
  await h.acquire();
  assert.equal(h.lease.is_mine, true);
  assert.equal((await h.layoutChange([{ op: "remove", name: "ribs" }])).revision, 1);
  assert.equal((await h.arm()).state, "armed");
  const contact = next(h, "contact");
  const t_s = now();
  h.touch({ x_mm: 3, y_mm: 4, kind: "down", touch_id: 5, normal_force_n: 0.5, t_s });
  const event = await contact;
  assert.equal(event.touch_id, 5);
  assert.ok(Math.abs(event.t_s - t_s) < 10, "half a round trip, on a busy machine");
  assert.ok(Math.abs(h.clientTime(h.welcome.clock_s) - t_s) < 10);
  h.pointer(pointerEvent("pointerdown"));
  h.lift(5);
  // Nothing but its pings is heard of it, and it stays awake beyond the limit of silence; where
  // this machine stands still for that long, the next pong wakes it.
  await sleep(600);
  while (h.output.state === "asleep") await next(h, "output");
  assert.equal(h.output.state, "armed");
  await h.close();
});

test("STOP goes by its own path too, and also while the connection is gone", async () => {
  const pressed = [];
  const real = globalThis.fetch;
  globalThis.fetch = (url, request) => (pressed.push(String(url)), real(url, request));
  try {
    const h = await open();
    const { stop } = await find("test");
    assert.match(stop, /^http:\/\/127\.0\.0\.1:\d+\/stop$/);
    assert.equal((await h.stop()).type, "done");
    await h.close();
    await assert.rejects(h.stop(), { name: "Lost" });
    assert.deepEqual(pressed.filter((url) => url === stop), [stop, stop]);
  } finally {
    globalThis.fetch = real;
  }
});

test("what is refused rejects with code and path, and events of it are told", async () => {
  const h = await open();
  await assert.rejects(h.arm(), (error) => error instanceof Refused && error.code === "lease");
  await assert.rejects(h.intensity(2), { code: "message", path: "/value" });
  const error = next(h, "error");
  h.touch({ x_mm: 1, y_mm: 1 });
  assert.equal((await error).code, "lease");
  assert.throws(() => h.touches([{ t_s: 0 }, { t_s: 1e9 }]), RangeError);
  await h.close();
  await assert.rejects(h.arm(), { name: "Lost" });
  assert.equal(h.touch({ x_mm: 1, y_mm: 1 }), false);
});

test("a takeover is told to both, and who leaves frees the lease", async () => {
  const [first, second] = [await open("first"), await open("second")];
  await first.acquire();
  await assert.rejects(second.acquire(), { code: "lease", path: "/takeover" });
  const lost = next(first, "lease");
  await second.acquire(true);
  assert.equal((await lost).is_mine, false);
  await second.close();
  await first.acquire();
  await first.close();
});

test("telemetry comes with its columns", async () => {
  const h = await open();
  const frame = next(h, "frame");
  await h.subscribe({ stats: 10 });
  const { stream, touch_id, columns, names, rows } = await frame;
  assert.deepEqual([stream, touch_id, columns, names[3]], ["stats", 2, 4, "touches"]);
  assert.deepEqual([...rows.subarray(4)], [4, 5, 6, NaN]);
  await h.close();
});

test("a broken connection is opened again, with the lease and disarmed", async () => {
  const h = await open();
  await h.geometry({ px_per_mm: 4 });
  await h.subscribe({ stats: 10 });
  await h.acquire();
  await h.arm();
  const [resumed, frame] = [next(h, "resumed"), next(h, "frame")];
  const entered = next(h, "contact");
  h.touch({ x_mm: 1, y_mm: 1, kind: "down", touch_id: 2 });
  await entered;
  const left = next(h, "contact");
  const waits = h.ask("play", { effect: { kind: "slow" } });
  sockets.at(-1).terminate();
  await assert.rejects(waits, { name: "Lost" });
  assert.equal(h.touch({ x_mm: 1, y_mm: 1 }), false);
  const { event, touch_id, region } = await left;
  assert.deepEqual([event, touch_id, region], ["leave", 2, "ribs"]);
  await resumed;
  await frame; // the streams are asked for again
  assert.equal(h.lease.is_mine, true);
  assert.equal(h.output.state, "off");
  await h.arm();
  const contact = next(h, "contact");
  h.pointer(pointerEvent("pointermove")); // the geometry was told again, and a move is a down
  assert.equal((await contact).event, "enter");
  await h.close();
});

test("a file is sent once, under its hash", async () => {
  const h = await open();
  const name = await h.asset(new Blob(["a photograph"]), ".png");
  assert.match(name, /^sha256:[0-9a-f]{64}$/); // the engine refuses any other name of a file
  assert.equal(await h.asset(new Blob(["a photograph"]), ".png"), name);
  await assert.rejects(h.asset(new Blob(["x"]), ".exe"), { code: "document" });
  const large = new Blob([new Uint8Array(h.welcome.limits.asset_bytes + 1)]);
  await assert.rejects(h.asset(large, ".jpg"), { code: "limit", message: /has 33554433 bytes/ });
  await h.close();
});

test("a layout by calls, each in its order", async () => {
  const h = await open();
  const ribs = await h.layout.add({ kind: "grating", period_mm: 2 }, { width_mm: 60, opacity: 0.5 });
  assert.equal(ribs.name, "region 1");
  await ribs.move({ x_mm: 5, over_s: 0.1 });
  await ribs.change({ opacity: 1 });
  await ribs.setValue(0.5);
  assert.equal((await ribs.remove()).type, "layout");
  assert.equal((await h.layout.add({ kind: "dial" }, { name: "volume" })).name, "volume");
  await assert.rejects(ribs.setValue(2), { code: "message", path: "/ops/0/value/value" });
  await h.close();
});

test("a job is watched", async () => {
  const h = await open();
  await assert.rejects(h.watch("none"), { code: "unknown", path: "/job" });
  await h.close();
});

test("what is asked by HTTP lies beside the session, also behind a path", async (t) => {
  const asked = [];
  t.mock.method(globalThis, "fetch", async (to) => (asked.push(String(to)), { ok: true }));
  for (const url of ["wss://far/hx/v1/session", "ws://127.0.0.1:7421/v1/session", "wss://far/"])
    await http(url, "/v1/assets/1?suffix=.png", {});
  const bases = ["https://far/hx", "http://127.0.0.1:7421", "https://far"];
  assert.deepEqual(asked, bases.map((base) => `${base}/v1/assets/1?suffix=.png`));
});

test("a wrong token is no reason to try again", async () => {
  const { url } = await find();
  const options = { name: "x", url, token: "guess", WebSocket: Kept };
  const count = sockets.length;
  await assert.rejects(connect(options), { code: "access", path: "/token" });
  await sleep(300);
  assert.equal(sockets.length, count + 1);
  await assert.rejects(connect({ ...options, url: "ws://127.0.0.1:1/" }), { name: "Lost" });
});

for (const wrong of [2, 100])
  test(`of ${wrong} old tokens on connecting again those of a while are borne`, async () => {
    const { url, token } = await find();
    let given = -1;
    const finds = async () => ({ url, token: given >= 0 && given++ < wrong ? "old" : token });
    const h = await connect({ name: "x", find: finds, WebSocket: Kept });
    given = 0;
    const ends = Promise.race([next(h, "resumed").then(() => "resumed"), next(h, "closed").then(() => "closed")]);
    sockets.at(-1).terminate();
    assert.equal(await ends, wrong === 2 ? "resumed" : "closed");
    assert.equal(given, wrong === 2 ? 3 : 4);
    await h.close();
  });

test("touches in a loop bury no question, and beyond 1000 batches they are refused", async () => {
  class Slow {
    readyState = 1;
    sent = [];
    constructor() {
      Slow.last = this;
      queueMicrotask(() => this.onopen());
    }
    send(data) {
      this.sent.push(data);
      if (typeof data !== "string") return;
      const { type, id } = JSON.parse(data);
      const limits = { fingers: 10, batch_touches: 1024, batches_per_s: 0.001, touches_per_s: 12000 };
      const lease = { is_mine: false };
      const answer = { type: type === "hello" ? "welcome" : "done", id, limits, lease };
      queueMicrotask(() => this.onmessage({ data: JSON.stringify({ ...answer, keep_alive: { idle_s: 9 } }) }));
    }
    close() {}
  }
  const h = await connect({ name: "x", url: "ws://x", WebSocket: Slow });
  const taken = Array.from({ length: 2000 }, () => h.touch({ x_mm: 1, y_mm: 1 }));
  assert.equal(taken.filter(Boolean).length, 1065); // 64 at once, one on credit, and 1000 that wait
  assert.equal(h.lift(), true); // never left out
  await h.stop();
  assert.equal(Slow.last.sent.length, 67);
  assert.equal(JSON.parse(Slow.last.sent.at(-1)).type, "stop");
  await h.close();
});

test("a silent service is left, and a handler that fails ends nothing", async () => {
  class Silent {
    static count = 0;
    readyState = 1;
    constructor() {
      Silent.count += 1;
      queueMicrotask(() => this.onopen());
    }
    send(text) {
      const { type, id } = JSON.parse(text);
      if (type !== "hello") return;
      const [keep_alive, limits] = [{ idle_s: 0.02 }, { fingers: 10, batch_touches: 1024 }];
      const lease = { is_mine: false };
      const welcome = { type: "welcome", id, keep_alive, limits, lease, output: {}, resume: "r" };
      queueMicrotask(() => this.onmessage({ data: JSON.stringify(welcome) }));
    }
    close() {}
  }
  const h = await connect({ name: "x", url: "ws://x", WebSocket: Silent });
  assert.equal((await next(h, "lost")).reason, "the service is silent");
  await next(h, "resumed");
  assert.equal(Silent.count, 2);
  const closed = next(h, "closed");
  await h.close();
  await closed;
});

test("pointers become touches of few numbers, and what is predicted or old is left out", () => {
  const pointers = new Pointers(2);
  const kinds = (event, at_s = now()) =>
    pointers.touches(event, ELEMENT, at_s).map(({ touch_id, kind }) => [touch_id, kind]);
  assert.deepEqual(kinds(pointerEvent("pointermove", { buttons: 0 })), []); // hovers
  // A pen above the glass whose barrel's button is pressed: Chromium 156 sends a pointerdown.
  assert.deepEqual(kinds(pointerEvent("pointerdown", { pointerId: 3, buttons: 2 })), []);
  assert.deepEqual(kinds(pointerEvent("pointermove", { pointerId: 3, buttons: 3 })), [[0, "down"]]);
  assert.deepEqual(kinds(pointerEvent("pointermove", { pointerId: 3, buttons: 2 })), [[0, "up"]]);
  assert.deepEqual(kinds(pointerEvent("pointerup", { pointerId: 3, buttons: 0 })), []);
  assert.deepEqual(kinds(pointerEvent("pointerdown")), [[0, "down"]]);
  assert.deepEqual(kinds(pointerEvent("pointerdown", { pointerId: 900 })), [[1, "down"]]);
  assert.deepEqual(kinds(pointerEvent("pointerdown", { pointerId: 901 })), []); // a third of two
  const t_ms = performance.now();
  const coalesced = [
    { timeStamp: t_ms - 900, clientX: 0 },
    { timeStamp: t_ms - 8, clientX: 120 },
    { timeStamp: t_ms, clientX: 140 },
  ];
  const event = pointerEvent("pointermove", { coalesced });
  event.getPredictedEvents = () => assert.fail("no finger was there");
  const [first, second, ...more] = pointers.touches(event, ELEMENT, now(), 0.4);
  assert.deepEqual([first.x_px, second.x_px, first.y_px, more.length], [20, 40, 0, 0]);
  assert.deepEqual([second.t_s, second.normal_force_n], [t_ms / 1e3, 0.4]);
  const late = pointers.touches(pointerEvent("pointerup", { timeStamp: 0 }), ELEMENT, 99);
  assert.deepEqual([late[0].kind, late[0].t_s], ["up", 98.6]);
  assert.deepEqual(kinds(pointerEvent("pointercancel")), []); // it was lifted already
  assert.deepEqual(pointers.dropped, { late: 1, fingers: 1 });
  pointers.clear();
  assert.deepEqual(kinds(pointerEvent("pointermove", { pointerId: 5 })), [[0, "down"]]);
  assert.deepEqual(kinds(pointerEvent("pointermove", { pointerId: 5, buttons: 0 })), [[0, "up"]]);
});

test("a pointer whose end was lost is lifted as the first of its type comes down, or all at once", () => {
  const pointers = new Pointers(10);
  const pen = { pointerType: "pen" };
  const touches = (event) => pointers.touches(event, ELEMENT, now()).map(({ touch_id, kind }) => [touch_id, kind]);
  touches(pointerEvent("pointerdown", { pointerId: 1, isPrimary: true, pointerType: "touch" }));
  touches(pointerEvent("pointerdown", { pointerId: 2, pointerType: "touch" }));
  touches(pointerEvent("pointerdown", { pointerId: 3, isPrimary: true, ...pen }));
  const first = pointerEvent("pointerdown", { pointerId: 4, isPrimary: true, pointerType: "touch" });
  assert.deepEqual(touches(first), [[0, "up"], [1, "up"], [0, "down"]]);
  // The same pointer comes down again: the service lifts it before.
  assert.deepEqual(touches(pointerEvent("pointerdown", { pointerId: 3, isPrimary: true, ...pen })), [[2, "down"]]);
  assert.deepEqual(pointers.lifts(5), [{ t_s: 5, touch_id: 2, kind: "up" }, { t_s: 5, touch_id: 0, kind: "up" }]);
  assert.deepEqual(pointers.lifts(5), []);
});

test("times of another document's clock are ours, and places are those of an element that is not zoomed", () => {
  const pointers = new Pointers(10);
  const view = { performance: { now: () => performance.now() - 7000 } }; // an iframe that was made 7 s later
  const event = pointerEvent("pointerdown", { timeStamp: view.performance.now() - 3, clientX: 140, clientY: 90 });
  const zoomed = { getBoundingClientRect: () => ({ ...BOX, width: 400, height: 160 }), offsetWidth: 200, offsetHeight: 80 };
  const [{ t_s, x_px, y_px }] = pointers.touches(Object.assign(event, { view }), zoomed, now());
  assert.ok(Math.abs(now() - 0.003 - t_s) < 0.3, "as long ago as it was there");
  assert.deepEqual([x_px, y_px], [20, 20]);
  assert.equal(pointers.dropped.late, 0);
});

test("what is left out is counted and told once", async () => {
  const h = await open();
  const told = [];
  h.on("warning", ({ sentence }) => told.push(sentence));
  for (const timeStamp of [0, 1]) h.pointer(pointerEvent("pointerdown", { timeStamp: timeStamp - 1000 }));
  assert.equal(h.dropped, 2);
  assert.equal(told.length, 1);
  assert.match(told[0], /left out.*busy.*dropped/);
  await h.close();
});

test("a material is felt in one call, and again after a lost connection", async () => {
  const region = await feel({ kind: "grating", period_mm: 2 }, { name: "test", find, WebSocket: Kept });
  const h = region.session;
  sessions.push(h);
  assert.equal(h.output.state, "off"); // the driver of this service is real, and no person has asked
  const element = Object.assign(new EventTarget(), ELEMENT, { style: { touchAction: "auto" } });
  const again = await h.feel({ kind: "noise" }, { element, px_per_mm: 4, scroll: "vertical", person_asked: true });
  assert.equal(h.output.state, "armed");
  assert.equal(again.name, "felt");
  assert.equal(element.style.touchAction, "pan-y pinch-zoom");
  assert.equal((await again.change({ opacity: 0.5 })).type, "layout");
  const asked = [];
  const { ask, restore } = h;
  h.ask = (type, fields) => (asked.push(type), ask.call(h, type, fields));
  const cut = async () => {
    asked.length = 0;
    const resumed = next(h, "resumed");
    sockets.at(-1).terminate();
    await resumed;
    await sleep(50); // what follows an event is asked at once
    return asked.filter((type) => !["hello", "geometry"].includes(type));
  };
  assert.deepEqual(await cut(), []); // real: never by itself, and the service has kept the layout
  assert.equal(h.output.state, "off");
  await h.arm();
  h.restore = async () => {
    await restore.call(h);
    h.welcome.inventory.devices = []; // a virtual driver
  };
  assert.deepEqual(await cut(), ["arm"]);
  assert.equal(h.output.state, "armed");
  await h.stop();
  assert.deepEqual(await cut(), []);
  await h.arm();
  await h.layoutSet({ regions: [] });
  assert.deepEqual(await cut(), []); // an app's own layout
  await h.feel({ kind: "noise" });
  await h.mute();
  await h.release();
  assert.deepEqual(await cut(), []);
  await h.close();
});
