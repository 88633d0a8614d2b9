// Slides a finger over ribs: node touching.mjs COUNT INTERVAL_S. Prints when each batch was sent.
import { createRequire } from "node:module";
import { setTimeout as sleep } from "node:timers/promises";
import { connect } from "../../clients/typescript/src/haptix.js";
import { find } from "../../clients/typescript/src/node.js";

const WebSocket = createRequire(new URL("../../clients/typescript/", import.meta.url))("ws");
const [count, interval_s] = process.argv.slice(2).map(Number);
const material = { kind: "grating", period_mm: 2, low: 0.6, high: 0.9 };
const region = { name: "ribs", x_mm: 0, y_mm: 0, width_mm: 100, height_mm: 60, material };
const monotonic_s = () => Number(process.hrtime.bigint()) / 1e9; // CLOCK_MONOTONIC

const h = await connect({ name: "TypeScript", find, WebSocket });
await h.layoutSet({ regions: [region] });
await h.acquire();
await h.arm();
await sleep(1000);
const sent_s = [];
for (let i = 0; i < count; i++) {
  sent_s.push(monotonic_s());
  h.touch({ x_mm: 50 + 30 * Math.sin(i / 50), y_mm: 30, normal_force_n: 0.5 });
  await sleep(1e3 * interval_s * (0.5 + Math.random())); // in no step with the service's own times
}
await sleep(300);
await h.close();
console.log(JSON.stringify(sent_s));
