/** The felt friction as sound: off at first, quiet, and late by a stated time. */

/** @import { Track } from "./telemetry.js" */

export const DELAY_S = 0.06; // of the sound, if frames come in time: a frame of 50 ms and a margin

/** Plays the felt friction while it is on. */
export class Sound {
  /** @type {AudioContext | null} */
  #context = null;
  /** @type {AudioWorkletNode | null} */
  #node = null;
  /** @type {GainNode | null} */
  #gain = null;

  /** Begin; a browser allows that only when a person has pressed something. @param {number} volume_db */
  async start(volume_db) {
    const context = (this.#context ??= new AudioContext({ latencyHint: "interactive" }));
    if (!this.#node) {
      await context.audioWorklet.addModule("/studio/sound-worklet.js");
      this.#node = new AudioWorkletNode(context, "felt-friction");
      this.#gain = new GainNode(context);
      this.#node.connect(this.#gain).connect(context.destination);
    }
    this.volume(volume_db);
    this.#node.port.postMessage(null); // its clock stood
    await context.resume();
  }

  /** @param {number} volume_db dB of full scale */
  volume(volume_db) {
    if (this.#gain && this.#context) {
      this.#gain.gain.setTargetAtTime(10 ** (volume_db / 20), this.#context.currentTime, 0.02);
    }
  }

  async stop() {
    await this.#context?.suspend();
  }

  close() {
    void this.#context?.close();
    this.#context = this.#node = this.#gain = null;
  }

  /** Play rows whose felt friction has come.
   * @param {Track} track @param {number} from @param {number} to */
  add(track, from, to) {
    if (!this.#node || this.#context?.state !== "running" || to - from < 2) return;
    const felt_rows = heardOf(track, from, to);
    this.#node.port.postMessage(felt_rows, [felt_rows.rows.buffer]);
  }
}

/**
 * Return the input of the sound: felt force [N] and speed [mm/s] of each row, their rate and end.
 * @param {Track} track @param {number} from @param {number} to
 */
export function heardOf(track, from, to) {
  const rows = new Float32Array(2 * (to - from));
  for (let row = from; row < to; row += 1) {
    const step_s = track.at("t", row) - track.at("t", row - 1);
    const [dx, dy] = [track.at("x_mm", row) - track.at("x_mm", row - 1), track.at("y_mm", row) - track.at("y_mm", row - 1)];
    rows[2 * (row - from)] = track.at("force_n", row) || 0;
    rows[2 * (row - from) + 1] = Math.hypot(dx, dy) / step_s || 0;
  }
  const end_s = track.at("t", to - 1);
  return { rows, end_s, rate_hz: (to - from - 1) / (end_s - track.at("t", from)) };
}
