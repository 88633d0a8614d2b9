/**
 * Friction force as sound: its vibration above 40 Hz as it is, and what vibrates too fast for a
 * thousand rows a second as noise, as loud as the force changes and the finger is fast.
 */

const HIGH_PASS_HZ = 40;
const NOISE_HZ = [1000, 6000];
const FULL_N = 0.25; // a vibration of so many newtons is full scale
const NOISE = 0.004; // of full scale, for 1 N/s at 1 mm/s
const CEILING = 10 ** (-12 / 20); // what comes out is never louder, before the volume
const KEPT = 8192;

// @ts-ignore: of the AudioWorklet's own scope
class FeltFriction extends AudioWorkletProcessor {
  /** @param {any} options */
  constructor(options) {
    super();
    const { delay_s } = options.processorOptions;
    this.force = new Float32Array(KEPT);
    this.speed = new Float32Array(KEPT);
    this.written = 0; // rows
    this.read = 0; // row, between rows too
    this.rate_hz = 1000;
    this.delay_s = delay_s;
    this.before = { force: 0, high: 0, low: 0, band: 0 };
    this.level = 0; // 0 while nothing comes, so that it neither begins nor ends with a click
    // @ts-ignore
    this.port.onmessage = ({ data: { rows, rate_hz } }) => {
      if (this.read >= this.written) this.read = this.written - this.delay_s * rate_hz; // begins anew
      this.rate_hz = rate_hz;
      for (let at = 0; at < rows.length; at += 2) {
        this.force[this.written % KEPT] = rows[at];
        this.speed[this.written % KEPT] = rows[at + 1];
        this.written += 1;
      }
      // What has waited for too long is dropped: late sound is worse than a gap.
      const most = 4 * this.delay_s * rate_hz;
      if (this.written - this.read > most) this.read = this.written - this.delay_s * rate_hz;
    };
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
      const here = this.read < this.written - 1 && row >= 0;
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
      this.read += here || this.read < 0 ? this.rate_hz / rate : 0;
      state.high = high * (state.high + force - state.force);
      state.force = force;
      const white = Math.random() * 2 - 1;
      state.low += slow * (white - state.low);
      state.band += fast * (white - state.low - state.band);
      const loud = state.high / FULL_N + state.band * NOISE * change * Math.sqrt(speed);
      out[at] = CEILING * Math.tanh((this.level * loud) / CEILING);
    }
    return true;
  }
}

// @ts-ignore
registerProcessor("felt-friction", FeltFriction);
