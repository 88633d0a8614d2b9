/** Feel the layout: the board, and beside it curves and numbers of what a finger feels. */

import { measured, pxPerMm } from "/client/glass.js";
import { Board } from "../board.js";
import { bullets, el, keyed, save } from "../dom.js";
import { Films } from "../pictures.js";
import { FrictionPlot, KEYS, loadPlots, SpectrumPlot } from "../plots.js";
import { sentence } from "../service.js";
import { DELAY_S, Sound } from "../sound.js";
import { Comparison, replay, StrokeRecorder, toCsv } from "../strokes.js";
import { Readings, Sensed, Telemetry } from "../telemetry.js";
import { texts } from "../texts.js";
import { Touching } from "../touching.js";
import { nameOf, SCALE, Trail, UNREACHABLE } from "../trail.js";
import { choose, view } from "../view.js";

/** @import { App } from "../app.js" */

const RATE_HZ = 1000;
const PLOTS_MS = 50;
const READINGS_MS = 150;
const SAID_MS = 1000;
const t = texts.play;

/** @param {HTMLElement} root @param {App} app */
export function mount(root, app) {
  const { service, history } = app;
  const telemetry = new Telemetry();
  const readings = new Readings();
  const sensed = new Sensed((on) => void service.attempt(() => service.sense(on)));
  const sound = new Sound();
  const board = new Board({ tabIndex: 0, role: "application", "aria-label": t.board, "aria-describedby": "said" });
  const touching = new Touching(board, service);
  const trail = new Trail(board);
  const films = new Films(service, telemetry);
  board.moving = (region) => films.at(region);
  const recorder = new StrokeRecorder();
  const over = new Set();
  const said = el("p.unseen", { id: "said", role: "status" });
  const hint = el("p.hint", {}, t.hint);
  const where = el("span.where");
  const strokes = strokeTools(app, recorder, telemetry, touching);
  const comparison = new Comparison(app, telemetry, () => recorder.points, (point) => touching.took(0, point));
  const friction = el("div.plot");
  const spectrum = el("div.plot.low");
  root.append(
    el("section.plane", {}, board.element, hint,
      el("div.legend", {}, where, board.tools(), legend())),
    el("div.tools.sheet", {}, app.guide.element, forceTools(), scaleTools(board), soundTools(sound), strokes.element, comparison.element),
    el("section.live", {},
      el("div.sheet", {}, readings.element, el("details", {}, el("summary", {}, t.means), bullets(t.meanings)),
        sensed.element),
      el("div.sheet", {}, el("h2", {}, KEYS.wanted(t.wanted), KEYS.felt(t.felt), KEYS.band(t.band)), friction),
      el("div.sheet", {}, el("h2", {}, t.spectrum), spectrum),
      el("div.sheet", {}, el("h2", {}, t.error), readings.errors)),
    said,
  );

  /** @type {FrictionPlot | null} */
  let plot = null;
  /** @type {SpectrumPlot | null} */
  let spectra = null;
  let [ended, plotted_ms, read_ms, said_ms] = [false, 0, 0, 0];
  loadPlots().then(
    () => {
      if (ended) return;
      plot = new FrictionPlot(friction);
      spectra = new SpectrumPlot(spectrum);
    },
    (error) => service.notify("error", sentence(error)),
  );

  touching.onPoint.add((t_s, point) => {
    trail.add(point);
    hint.hidden = true;
    strokes.took(t_s, point);
  });
  telemetry.onFelt.add((track, _, from, to) => {
    trail.addFelt(track, from, to);
    sound.add(track, from, to);
  });
  const ends = [
    service.listen({ friction: RATE_HZ, felt: RATE_HZ, stats: 5 }, (frame) => telemetry.add(frame)),
    service.onContact(({ event, region, value }) => {
      if (event === "enter") over.add(region);
      if (event === "leave") over.delete(region);
      where.textContent = ["press", "release", "detent"].includes(event)
        ? t.contact(event, region, value)
        : [...over].join(", ");
    }),
    history.document.on((document) => board.show(document)),
    service.state.on(({ phase }) => void (phase === "open" && touching.begin())),
    // The colours of canvas and plots are read when they are drawn.
    view.on(() => requestAnimationFrame(() => board.draw())),
  ];

  /** @param {number} at_ms */
  function frame(at_ms) {
    if (ended) return;
    requestAnimationFrame(frame); // first, so that an error below ends only this frame
    if (films.isDue(at_ms)) board.draw();
    trail.draw(touching.cursors.values());
    const track = telemetry.newest;
    if (track && at_ms - plotted_ms > PLOTS_MS && plotted !== track.count + track.known) {
      // One plot a frame: both in one would take longer than a frame on a slow machine.
      const next = turn ? plot : spectra;
      turn = !turn;
      next?.draw(track);
      if (turn) [plotted, plotted_ms] = [track.count + track.known, at_ms];
    }
    if (at_ms - read_ms > READINGS_MS) {
      readings.draw(telemetry, t.source[view.get().force]);
      sensed.draw(telemetry, service.output.get()?.senses ?? false);
      read_ms = at_ms;
    }
    if (track && at_ms - said_ms > SAID_MS && touching.cursors.size) {
      const row = track.count - 1;
      said.textContent = t.said(track.at("wanted", row), track.at("felt", Math.max(track.known - 1, 0)), [...over]);
      said_ms = at_ms;
    }
  }
  let plotted = 0;
  let turn = true;
  requestAnimationFrame(frame);

  return () => {
    ended = true;
    for (const end of ends) end();
    comparison.close();
    strokes.close();
    touching.close();
    board.close();
    sound.close();
    plot?.close();
    spectra?.close();
  };
}

function legend() {
  return el("ul", { "aria-label": t.legend },
    el("li.quiet", {}, t.legend),
    SCALE.map(({ color }, index) => el("li", {}, keyed(color, nameOf(index)))),
    el("li", {}, keyed(UNREACHABLE, t.outOfReach)));
}

function forceTools() {
  const sources = /** @type {const} */ (["slider", "pressure", "assumed"]);
  const select = el("select", {
    id: "force",
    onchange: () => choose({ force: /** @type {any} */ (select.value) }),
  }, sources.map((name) => el("option", { value: name }, t.force[name])));
  const slider = el("input", {
    type: "range", min: "0.1", max: "1.5", step: "0.05", "aria-label": t.forceSlider,
    oninput: () => choose({ force_n: Number(slider.value) }),
  });
  const value = el("output");
  const help = el("small");
  view.on(({ force, force_n }) => {
    select.value = force;
    slider.value = String(force_n);
    slider.disabled = force === "assumed";
    value.textContent = force === "assumed" ? t.byService : `${force_n.toFixed(2)} N`;
    help.textContent = t.forceHelp[force];
  });
  return el("div.tool", {}, el("label", { for: "force" }, t.forceTitle), select,
    el("div.slide", {}, slider, value), help);
}

/** Ask once how wide the board is on the glass, so that a millimetre of the board is one there.
 * @param {Board} board */
function scaleTools(board) {
  const width_px = () => board.element.getBoundingClientRect().width;
  const input = el("input", {
    id: "board-width", type: "number", min: "20", max: "3000", step: "any", placeholder: t.scaleAsk,
    onchange: () => {
      measured(width_px(), Number(input.value));
      board.fit();
    },
  });
  const help = el("small");
  const geometry = board.onFit;
  board.onFit = () => {
    geometry();
    const real = pxPerMm();
    input.value = real ? (width_px() / real).toFixed(1) : "";
    help.textContent = real ? t.scale(board.px_per_mm / real) : t.scaleUnknown;
  };
  board.real_px_per_mm = pxPerMm;
  return el("div.tool", {}, el("label", { for: "board-width" }, t.scaleTitle), input, help);
}

/** @param {Sound} sound */
function soundTools(sound) {
  const button = el("button", { type: "button" });
  const slider = el("input", {
    type: "range", min: "-60", max: "-12", step: "1", "aria-label": t.volume,
    oninput: () => {
      choose({ volume_db: Number(slider.value) });
      sound.volume(Number(slider.value));
    },
  });
  const value = el("output");
  let runs = false;
  const set = async (/** @type {boolean} */ on) => {
    choose({ is_audible: on });
    if (on) await sound.start(view.get().volume_db);
    else await sound.stop();
    runs = on;
  };
  button.onclick = () => void set(!view.get().is_audible);
  // A browser plays nothing before the person has done something here.
  const first = () => void (view.get().is_audible && !runs && set(true));
  addEventListener("pointerdown", first, { once: true });
  view.on(({ is_audible, volume_db }) => {
    button.setAttribute("aria-pressed", String(is_audible));
    button.textContent = is_audible ? t.soundOff : t.soundOn;
    slider.value = String(volume_db);
    value.textContent = `${volume_db} dB`;
  });
  return el("div.tool", {}, el("span.label", {}, t.sound), button,
    el("div.slide", {}, slider, value), el("small", {}, t.soundHelp(1e3 * DELAY_S)));
}

/**
 * Record, replay and keep a stroke.
 * @param {App} app
 * @param {StrokeRecorder} recorder
 * @param {Telemetry} telemetry
 * @param {Touching} touching
 */
function strokeTools(app, recorder, telemetry, touching) {
  let is_recording = false;
  /** @type {AbortController | null} */
  let playing = null;
  const record = el("button", { type: "button" }, t.record);
  const play = el("button", { type: "button", disabled: true }, t.replay);
  const keep = el("button", { type: "button", disabled: true }, t.keep);
  const status = el("small", { role: "status" }, t.strokeHelp);
  const show = () => {
    record.setAttribute("aria-pressed", String(is_recording));
    record.textContent = is_recording ? t.recordEnd : t.record;
    play.textContent = playing ? t.replayEnd : t.replay;
    play.disabled = keep.disabled = is_recording || !recorder.isWhole;
    const last = recorder.points.at(-1);
    if (is_recording) status.textContent = t.recording;
    else if (last) status.textContent = t.recorded(last.t_s, recorder.points.length);
  };
  record.onclick = () => {
    is_recording = !is_recording;
    if (is_recording) recorder.clear();
    show();
  };
  play.onclick = async () => {
    if (playing) return playing.abort();
    const { session } = app.service;
    if (!session) return;
    playing = new AbortController();
    show();
    await replay(session, recorder.points, (point) => touching.took(0, point), playing.signal);
    playing = null;
    show();
  };
  keep.onclick = () => {
    const csv = toCsv(recorder.points, view.get().force_n);
    save(new Blob([csv], { type: "text/csv" }), "stroke.csv");
  };
  show();
  return {
    element: el("div.tool", {}, el("span.label", {}, t.stroke), el("div.row", {}, record, play, keep), status),
    /** @param {number} t_s @param {Omit<import("../strokes.js").Point, "t_s">} point */
    took(t_s, point) {
      if (!is_recording || playing) return;
      recorder.add(t_s, point);
      if (point.kind === "up" && recorder.isWhole && !touching.cursors.size) {
        is_recording = false;
        show();
      }
    },
    close: () => playing?.abort(),
  };
}
