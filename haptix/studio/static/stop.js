/** The STOP button's frame, in a process of its own. Without this script the form does the same. */

const form = /** @type {HTMLFormElement} */ (document.querySelector("form"));
const state = /** @type {HTMLElement} */ (document.querySelector("small"));
const SHOWN_MS = 4000;
let presses = 0;

addEventListener("keydown", ({ key }) => void (key === "F8" && form.requestSubmit()));
form.addEventListener("submit", async (event) => {
  event.preventDefault();
  const number = ++presses;
  try {
    const answer = await fetch("/stop", { method: "POST", keepalive: true });
    state.textContent = answer.ok ? "stopped" : `refused: ${answer.status}`;
  } catch {
    state.textContent = "no answer: unplug it";
    return; // stays
  }
  setTimeout(() => {
    if (number === presses) state.textContent = "0 V, for all";
  }, SHOWN_MS);
});
