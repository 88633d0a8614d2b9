/** The contract of all clients, clients/contract.jsonl, against the service of HAPTIX_SERVICE. */

import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { setTimeout as sleep } from "node:timers/promises";
import WebSocket from "ws";

import { connect } from "../src/haptix.js";
import { find } from "../src/node.js";

const text = readFileSync(new URL("../../contract.jsonl", import.meta.url), "utf8");
const lines = text.trim().split("\n").map((line) => JSON.parse(line));
const OBJECTS = ["geometry", "touch", "move", "change"]; // calls of several fields

const h = await connect({ name: "contract", find, WebSocket });
const heard = [];
for (const kind of ["contact", "error", "frame"]) h.on(kind, (event) => heard.push([kind, event]));
const regions = {};
const fits = (expected, got) => Object.entries(expected).every(([key, value]) => got[key] === value);

const call = async (line) => {
  const [name, layout] = line.do.split(".").reverse();
  const camel = name.replace(/_(\w)/g, (_, letter) => letter.toUpperCase());
  const target = line.of ? regions[line.of] : layout ? h.layout : h;
  const { material, ...fields } = line.with ?? {};
  if (name === "asset") return h.asset(new Blob([fields.text]), /\.\w+$/.exec(fields.name)[0]);
  if (name === "add") return target.add(material, fields);
  return target[camel](...(OBJECTS.includes(name) ? [line.with] : Object.values(line.with ?? {})));
};

for (const line of lines) {
  heard.length = 0;
  const about = JSON.stringify(line);
  if (line.refuses) {
    await assert.rejects(call(line), { name: "Refused", ...line.refuses }, about);
    continue;
  }
  if (line.fails) {
    await assert.rejects(call(line), { name: "Lost", message: line.fails }, about);
    continue;
  }
  const answer = await call(line);
  assert.ok(fits(line.answers ?? {}, answer), about);
  if (line.names) assert.equal(answer, line.names);
  if (line.as) {
    assert.equal(answer.name, line.as);
    regions[line.as] = answer;
  }
  for (const [kind, expected] of Object.entries(line.hears ?? {})) {
    while (!heard.some(([one, event]) => one === kind && fits(expected, event))) await sleep(5);
  }
}
