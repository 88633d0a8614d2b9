/** Choice of driver, screen and finger; origin of their numbers; state of the output; STOP. */

import { bullets, el, facts, fill } from "../dom.js";
import { Telemetry } from "../telemetry.js";
import { texts } from "../texts.js";

/** @import { Session } from "/client/haptix.js" */
/** @import { App } from "../app.js" */
/** @import * as m from "../../../../clients/typescript/types/messages.js" */
/**
 * @typedef {object} Profile as `GET /v1/profiles/{kind}` gives it
 * @property {string} name
 * @property {string} source
 * @property {string | null} calibrated
 * @property {number | null} age_days
 * @property {string} verdict
 * @property {string[]} rests_on
 * @property {Record<string, number>} spread
 * @property {string[]} warnings
 * @property {string} verified
 * @property {Record<string, unknown>} document
 */
/** @typedef {{highest_v: number, normal_force_n: number[], current_a: number[]}} Drive as `GET /v1/drive` gives it */

const RATE_HZ = 100;
const DRAWN_MS = 200;
const OVER_S = 10;
const t = texts.screens;

/** @param {HTMLElement} root @param {App} app */
export function mount(root, app) {
  const { service } = app;
  const telemetry = new Telemetry();
  const driver = el("dl.facts");
  const kind = el("p");
  const screen = el("div");
  const finger = el("div");
  const live = el("dl.readings");
  const switches = controls(app);
  const stop = el("button.stop", { type: "button", onclick: () => void service.attempt(() => service.stop()) }, t.stop);
  root.append(
    el("section.sheet.stopper", {}, stop, el("p", {}, t.stopHelp)),
    el("section.sheet", {}, el("h2", {}, t.driver), kind, driver, switches.element),
    el("section.sheet", {}, el("h2", {}, t.live), live, el("small", {}, t.liveHelp)),
    el("section.sheet", {}, el("h2", {}, t.screen), screen),
    el("section.sheet", {}, el("h2", {}, t.finger), finger),
  );

  const show = () => {
    const [device] = service.inventory.get()?.devices ?? [];
    const output = service.output.get();
    kind.textContent = device ? (device.is_real ? t.real : t.virtual) : "";
    fill(driver, facts([
      [t.driver, device?.name ?? t.unknown],
      [t.address, device?.address ?? t.unknown],
      [t.state, output ? `${texts.state[output.state]}: ${output.reason}` : t.unknown],
    ]));
  };
  const read = async (/** @type {string} */ name, /** @type {HTMLElement} */ where) => {
    const profile = await (await service.rest("GET", `/v1/profiles/${name}`)).json();
    fill(where, described(profile));
  };
  /** @type {Drive | null} known once the output was armed */
  let drive = null;
  const ends = [
    ...switches.ends,
    service.inventory.on(show),
    service.output.on((output) => {
      show();
      if (output?.state !== "armed" || drive) return;
      // Without it, only shares are shown.
      void service.rest("GET", "/v1/drive").then((answer) => answer.json()).then((known) => (drive = known), () => {});
    }),
    service.state.on(({ phase }) => {
      if (phase !== "open") return;
      void service.attempt(() => read("screen", screen));
      void service.attempt(() => read("finger", finger));
    }),
    service.listen({ friction: RATE_HZ, stats: 5 }, (frame) => telemetry.add(frame)),
  ];
  const draw = () => {
    const { stats } = telemetry;
    const { mean, rms, peak, force_n } = shares(telemetry);
    const ms = (/** @type {number} */ s) => (s > 0 ? `${(1e3 * s).toFixed(1)} ms` : "–");
    const share = (/** @type {number} */ value) =>
      Number.isNaN(value) ? "–" : drive ? t.volts(value * drive.highest_v, value) : t.share(value);
    const current = drive && !Number.isNaN(peak) ? t.microamperes(peak * between(drive, force_n)) : "–";
    const count = (/** @type {number | undefined} */ value) => (value === undefined ? "–" : String(value));
    fill(live, facts([
      [t.mean, share(mean)], [t.rms, share(rms)], [t.peak, share(peak)], [t.current, current],
      [t.underruns, count(stats.underruns)], [t.touches, count(stats.touches)],
      [t.reaction, ms(stats.reaction_s)], [t.reaction99, ms(stats.reaction_p99_s)],
    ]));
  };
  draw();
  const timer = setInterval(draw, DRAWN_MS);
  return () => {
    clearInterval(timer);
    for (const end of ends) end();
  };
}

/** @param {App} app */
function controls({ service }) {
  const set = (/** @type {(session: Session) => Promise<m.Output>} */ change) => void service.attempt(async () => {
    if (service.session) service.output.set(await change(service.session));
  });
  // The person's own intensity holds for all apps, and after this page is closed.
  const own = () => void service.attempt(() =>
    service.rest("PUT", "/v1/person", { person_intensity: Number(slider.value), person_muted: mute.checked }));
  const slider = el("input", { id: "intensity", type: "range", min: "0", max: "1", step: "0.05", onchange: own });
  const value = el("output");
  const mute = el("input", { type: "checkbox", onchange: own });
  const pause = el("input", { type: "checkbox", onchange: () => set((session) => session.pause(pause.checked)) });
  const show = () => {
    const output = service.output.get();
    pause.disabled = !service.lease.get()?.is_mine;
    if (!output) return;
    slider.value = String(output.person_intensity);
    value.textContent = `${Math.round(100 * output.person_intensity)} %`;
    mute.checked = output.person_muted;
    pause.checked = output.paused;
  };
  const ends = [service.output.on(show), service.lease.on(show)];
  const element = el("div.tool", {},
    el("label", { for: "intensity" }, t.intensity), el("div.slide", {}, slider, value), el("small", {}, t.intensityHelp),
    el("label.row", {}, mute, t.mute), el("label.row", {}, pause, t.pause));
  return { element, ends };
}

/** @param {Profile} profile */
function described({ name, source, calibrated, age_days, verdict, rests_on, spread, warnings, verified, document }) {
  /** @type {[string, string | Node][]} */
  const rows = [
    [t.source, source === "preset" ? `${name} (preset)` : `${name}, ${source}`],
    [t.calibrated, calibrated ? t.age(calibrated, age_days ?? 0) : t.never],
    [t.warnings, warnings.length ? bullets(warnings) : calibrated ? t.trusted : t.preset],
  ];
  if (verdict) rows.push([t.verdict, verdict]);
  if (verified) rows.push([t.verified, verified]);
  if (rests_on.length) rows.push([t.rests, bullets(rests_on)]);
  const deviations = Object.entries(spread);
  if (deviations.length) rows.push([t.spread, bullets(deviations.map(([key, sd]) => `${key}: ${(100 * sd).toFixed(1)} %`))]);
  return [
    el("dl.facts", {}, facts(rows)),
    el("details", {}, el("summary", {}, t.numbers), el("pre", { tabIndex: 0 }, JSON.stringify(document, null, 2))),
  ];
}

/** Amplitude of the current of full drive at a force, linear between those that are known.
 * @param {Drive} drive @param {number} force_n */
function between({ normal_force_n: forces, current_a: currents }, force_n) {
  const after = Math.max(1, forces.findIndex((force) => force >= force_n));
  const at = force_n > forces[forces.length - 1] ? forces.length - 1 : after;
  const part = (force_n - forces[at - 1]) / (forces[at] - forces[at - 1]);
  return currents[at - 1] + part * (currents[at] - currents[at - 1]);
}

/** Mean, root mean square and highest share of the voltage, of all that was touched lately, and the
 * force at the highest.
 * @param {Telemetry} telemetry */
function shares(telemetry) {
  let [sum, squares, peak, force_n, count] = [0, 0, 0, 0, 0];
  const until_s = telemetry.newest?.end_s ?? 0;
  for (const track of telemetry.tracks.values()) {
    for (let row = track.first; row < track.count; row += 1) {
      const share = track.at("voltage_share", row);
      if (until_s - track.at("t", row) > OVER_S || Number.isNaN(share)) continue;
      if (share >= peak) [peak, force_n] = [share, track.at("normal_force_n", row)];
      [sum, squares, count] = [sum + share, squares + share ** 2, count + 1];
    }
  }
  if (!count) return { mean: NaN, rms: NaN, peak: NaN, force_n };
  return { mean: sum / count, rms: Math.sqrt(squares / count), peak, force_n };
}
