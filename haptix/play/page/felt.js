// A figure that is felt: the engine, its curve and its sound. `data-felt` has its place in millimetres.

import { Engine } from "./engine.js";
import { VirtualDriver } from "./virtual-driver.js";

const figure = document.querySelector(".felt");
const [leftMm, topMm, widthMm] = figure.dataset.felt.split(" ").map(Number);
const [wanted, felt] = figure.querySelectorAll("output");
const button = figure.querySelector("button");

try {
  const engine = await Engine.load(new URL("./touch.hxp", import.meta.url));
  engine.attach(figure.querySelector(".felt-pad"), widthMm, { leftMm, topMm });
  const driver = new VirtualDriver(engine, figure.querySelector("canvas"));
  engine.addEventListener("block", ({ detail }) => {
    const text = (mu) => (detail.fingers ? mu.at(-1).toFixed(3) : "–");
    wanted.textContent = text(detail.wantedMu.subarray(0, detail.points));
    felt.textContent = text(detail.feltMu.subarray(0, detail.points));
  });
  button.addEventListener("click", () => {
    driver.sounds = !driver.sounds;
    button.setAttribute("aria-pressed", driver.sounds);
  });
  figure.dataset.state = "ready";
} catch (error) {
  // Opened as a file, for example: browsers load no module from one.
  figure.dataset.state = "failed";
  figure.querySelector("figcaption").textContent = `The texture cannot be played here: ${error.message}`;
  button.disabled = true;
}
