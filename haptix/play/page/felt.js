// A figure that is felt: the engine, its curve and its sound. `data-felt` has its place in millimetres.

import { Engine } from "./engine.js";
import { measured, pxPerMm } from "./glass.js";
import { VirtualDriver } from "./virtual-driver.js";

const figure = document.querySelector(".felt");
const [leftMm, topMm, widthMm] = figure.dataset.felt.split(" ").map(Number);
const [wanted, felt] = figure.querySelectorAll("output");
const button = figure.querySelector("button");
const pad = figure.querySelector(".felt-pad");

/** Ask how wide the picture is on the glass, so that its millimetres are those of the layout. */
function askSize() {
  const asked = document.createElement("p");
  asked.className = "felt-size";
  asked.innerHTML =
    '<label>Width of the picture on the glass, by a ruler: <input type="number" min="20" max="3000" step="any"> mm</label> <small></small>';
  figure.querySelector(".felt-side").append(asked);
  const [input, told] = asked.querySelectorAll("input, small");
  const widthPx = () => pad.getBoundingClientRect().width;
  const fit = () => {
    const real = pxPerMm();
    if (real) pad.style.setProperty("width", `min(${widthMm * real}px, 100%)`, "important");
    else pad.style.removeProperty("width");
    input.value = real ? (widthPx() / real).toFixed(1) : "";
    const times = widthPx() / real / widthMm;
    if (!real) told.textContent = "Until it is told, millimetres here are not those on the glass.";
    else if (times > 0.995) told.textContent = "To scale.";
    else told.textContent = `A millimetre is ${times.toFixed(2)} mm on the glass: the window is too small.`;
  };
  input.addEventListener("change", () => {
    measured(widthPx(), Number(input.value));
    fit();
  });
  addEventListener("resize", fit);
  fit();
}

try {
  const engine = await Engine.load(new URL("./touch.hxp", import.meta.url));
  engine.attach(pad, widthMm, { leftMm, topMm });
  const driver = new VirtualDriver(engine, figure.querySelector("canvas"));
  driver.addEventListener("shown", ({ detail: { wantedMu, feltMu } }) => {
    const text = (mu) => (Number.isNaN(mu) ? "–" : mu.toFixed(3));
    wanted.textContent = text(wantedMu);
    felt.textContent = text(feltMu);
  });
  button.addEventListener("click", () => {
    driver.sounds = !driver.sounds;
    button.setAttribute("aria-pressed", driver.sounds);
  });
  askSize();
  figure.dataset.state = "ready";
} catch (error) {
  // Opened as a file, for example: browsers load no module from one.
  figure.dataset.state = "failed";
  figure.querySelector("figcaption").textContent = `The texture cannot be played here: ${error.message}`;
  button.disabled = true;
}
