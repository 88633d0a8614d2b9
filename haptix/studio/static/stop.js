/**
 * The STOP button's frame, in a process of its own. Without this script the form does the same.
 * On this machine it goes the path of STOP that nothing else can crowd, before the service's own.
 */

const form = /** @type {HTMLFormElement} */ (document.querySelector("form"));
const state = /** @type {HTMLElement} */ (document.querySelector("small"));
const [SHOWN_MS, OWN_MS] = [4000, 100];
let presses = 0;

/** @param {string} path @param {RequestInit} [how] */
const ask = (path, how) => fetch(path, { method: "POST", keepalive: true, ...how });

async function stop() {
  const { own } = form.dataset;
  try {
    if (own) return await ask(own, { signal: AbortSignal.timeout(OWN_MS) });
  } catch {
    // the service's port takes it, too
  }
  return ask("/stop");
}

addEventListener("keydown", ({ key }) => void (key === "F8" && form.requestSubmit()));
form.addEventListener("submit", async (event) => {
  event.preventDefault();
  const number = ++presses;
  try {
    const answer = await stop();
    state.textContent = answer.ok ? "stopped" : `refused: ${answer.status}`;
  } catch {
    state.textContent = "no answer: unplug it";
    return; // stays
  }
  setTimeout(() => {
    if (number === presses) state.textContent = "0 V, for all";
  }, SHOWN_MS);
});
