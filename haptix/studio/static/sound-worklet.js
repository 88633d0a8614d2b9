/**
 * Friction force as sound. Its vibration above 40 Hz is played as it is. Vibration that is too fast
 * for a thousand rows a second becomes noise, whose level rises with force changes and speed.
 *
 * Rows come in frames, more or less late. A jitter buffer delays them by the lateness of the latest
 * frame of the last seconds, so that the rows last until the next frame.
 */

const HIGH_PASS_HZ = 40;
const NOISE_HZ = [1000, 6000];
const FULL_N = 0.25; // a vibration of so many newtons is full scale
const NOISE = 0.004; // of full scale, for 1 N/s at 1 mm/s
const CEILING = 10 ** (-12 / 20); // the output is never louder, before the volume
const KEPT = 8192;
const FRAMES = 200; // whose lateness is remembered: 10 s
const MARGIN_S = 0.01;
const LONGEST_S = 0.5; // longest delay: later sound would be useless, so there are gaps instead
const NEAR_S = 0.005; // allowed distance of the buffer from its aim
const FASTEST = 0.04; // largest change of speed to bring the buffer to its aim; 2/3 of a semitone

// @ts-ignore: of the AudioWorklet's own scope
class FeltFriction extends AudioWorkletProcessor {
  constructor() {
    super();
    this.force = new Float32Array(KEPT);
    this.speed = new Float32Array(KEPT);
    this.written = 0; // rows
    this.read = 0; // row, between rows too
    this.rate_hz = 1000;
    this.played_s = 0; // time of what is played
    /** @type {{late_s: number, span_s: number}[]} */
    this.frames = [];
    this.waits = 0; // samples, until it goes on to read
    this.speed_up = 0;
    this.before = { force: 0, high: 0, low: 0, band: 0 };
    this.level = 0; // 0 while nothing comes, so that it neither begins nor ends with a click
    // @ts-ignore
    this.port.onmessage = ({ data }) => this.take(data);
  }

  /** @param {{rows: Float32Array, rate_hz: number, end_s: number} | null} data null: time stood */
  take(data) {
    if (!data) {
      this.frames = [];
      return;
    }
    const { rows, rate_hz, end_s } = data;
    this.rate_hz = rate_hz;
    const before = this.written;
    for (let at = 0; at < rows.length; at += 2) {
      this.force[this.written % KEPT] = rows[at];
      this.speed[this.written % KEPT] = rows[at + 1];
      this.written += 1;
    }
    const late_s = this.played_s - end_s; // up to a constant, as the two clocks differ
    this.frames.push({ late_s, span_s: rows.length / 2 / rate_hz });
    if (this.frames.length > FRAMES) this.frames.shift();
    const latest_s = Math.max(...this.frames.map((frame) => frame.late_s + frame.span_s));
    const aim_s = Math.min(latest_s - late_s + MARGIN_S, LONGEST_S);
    const off_s = (this.written - this.read) / rate_hz - aim_s;
    this.speed_up = 0;
    if (this.read >= before - 1) {
      // The buffer ran empty: begin again when enough rows have come.
      this.read = before;
      // @ts-ignore: sampleRate is of the scope
      this.waits = Math.round(Math.max(0, aim_s - (this.written - before) / rate_hz) * sampleRate);
    } else if (off_s > LONGEST_S / 2) this.read += off_s * rate_hz; // has waited for too long: is dropped
    else if (Math.abs(off_s) > NEAR_S) this.speed_up = Math.max(-FASTEST, Math.min(FASTEST, off_s));
  }

  /** @param {Float32Array[][]} _ @param {Float32Array[][]} outputs */
  process(_, outputs) {
    // @ts-ignore: sampleRate is of the scope
    const rate = sampleRate;
    const high = Math.exp((-2 * Math.PI * HIGH_PASS_HZ) / rate);
    const [slow, fast] = NOISE_HZ.map((hz) => 1 - Math.exp((-2 * Math.PI * hz) / rate));
    const state = this.before;
    const [out] = outputs[0];
    for (let at = 0; at < out.length; at += 1) {
      const row = Math.floor(this.read);
      const here = !this.waits && this.read < this.written - 1;
      if (this.waits) this.waits -= 1;
      this.level += ((here ? 1 : 0) - this.level) * 0.002;
      let force = state.force;
      let change = 0;
      let speed = 0;
      if (here) {
        const [a, b] = [this.force[row % KEPT], this.force[(row + 1) % KEPT]];
        force = a + (b - a) * (this.read - row);
        change = Math.abs(b - a) * this.rate_hz;
        speed = this.speed[row % KEPT];
      }
      if (here) this.read += (this.rate_hz / rate) * (1 + this.speed_up);
      state.high = high * (state.high + force - state.force);
      state.force = force;
      const white = Math.random() * 2 - 1;
      state.low += slow * (white - state.low);
      state.band += fast * (white - state.low - state.band);
      const loud = state.high / FULL_N + state.band * NOISE * change * Math.sqrt(speed);
      out[at] = CEILING * Math.tanh((this.level * loud) / CEILING);
    }
    this.played_s += out.length / rate;
    return true;
  }
}

// @ts-ignore
registerProcessor("felt-friction", FeltFriction);
