/** The golden sessions, sent and read by this client's codec, against the service of HAPTIX_SERVICE. */

import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { test } from "node:test";
import { setTimeout as sleep } from "node:timers/promises";
import WebSocket from "ws";

import { readFrame, writeTouches } from "../src/batches.js";
import { find } from "../src/node.js";

const golden = (name) =>
  readFileSync(new URL(`../../golden/${name}.jsonl`, import.meta.url), "utf8")
    .trim()
    .split("\n")
    .map((line) => JSON.parse(line));
const hex = (bytes) => Buffer.from(bytes).toString("hex");

for (const line of golden("bytes")) {
  test(`bytes ${line.hex.slice(0, 32)}`, () => {
    if (!line.frame) {
      assert.equal(hex(writeTouches(line.touches, line.number)), line.hex);
      return;
    }
    const { rows, ...head } = readFrame(Uint8Array.from(Buffer.from(line.hex, "hex")).buffer);
    const numbers = line.frame.rows.flat().map((value) => (value === null ? NaN : value));
    assert.deepEqual({ ...head, rows }, { ...line.frame, rows: Float32Array.from(numbers) });
  });
}

for (const name of ["hello", "touches", "refused"]) {
  test(`session ${name}`, async () => {
    const { url, token } = await find();
    const socket = new WebSocket(url, "haptix.v1");
    const inbox = [];
    let wake = () => {};
    const put = (message) => {
      inbox.push(message);
      wake();
    };
    socket.on("message", (data, is_binary) => is_binary || put(JSON.parse(String(data))));
    socket.on("close", (close) => put({ close }));
    await new Promise((resolve) => socket.on("open", resolve));
    const began_ms = performance.now();
    const now = () => (performance.now() - began_ms) / 1e3;
    const same = new Map();

    const fits = (expected, got) => {
      if (expected === "$any") return true;
      if (typeof expected === "string" && expected.startsWith("$same:")) {
        if (!same.has(expected)) same.set(expected, got);
        return same.get(expected) === got;
      }
      if (expected === null || typeof expected !== "object") return expected === got;
      const keys = Object.keys(expected);
      return (
        got !== null &&
        keys.length === Object.keys(got).length &&
        keys.every((key) => key in got && fits(expected[key], got[key]))
      );
    };
    const send = (line) => {
      if ("text" in line) {
        const text = typeof line.text === "string" ? line.text : JSON.stringify(line.text);
        socket.send(text.replaceAll('"$now"', String(now())).replace("$token", token));
        return;
      }
      const bytes = Buffer.from(line.hex, "hex");
      if (line.touches) {
        assert.equal(hex(writeTouches(line.touches, line.number)), line.hex);
        bytes.writeDoubleLE(now(), 8);
      }
      socket.send(bytes);
    };

    for (const line of golden(name)) {
      if (line.from === "client") {
        await sleep(Math.max(line.at_s - now(), 0) * 1e3);
        send(line);
        continue;
      }
      for (;;) {
        if (!inbox.length) await new Promise((resolve) => (wake = resolve));
        const got = inbox.shift();
        if (fits(line.text ?? { close: line.close }, got)) break;
        if (got.type === "ping") {
          socket.send(JSON.stringify({ type: "pong", n: got.n, clock_s: now() }));
        } else {
          assert.ok(got.id === 0 && got.type !== "error", JSON.stringify([line, got]));
        }
      }
    }
  });
}
