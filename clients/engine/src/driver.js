// The host of one driver: HELLO, limits, arm, windows of samples, and 0 V at every end (PROTOCOL.md).

import { encode, FAULTS, FrameParser, OLDEST_VERSION, ProtocolError, VERSION } from "./protocol.js";

export { ProtocolError };

// The highest that firmware_io/limits.py allows: a page lowers them only.
const CEILING_V = 200;
const SLEW_V_PER_S = 0.7e-3 / 150e-12;
const RMS_V = (1.01 * CEILING_V) / Math.SQRT2;
const RMS_SLEW_V_PER_S = 0.5e-3 / 150e-12;
const DC_SHARE = 0.05;
const RAMP_S = 0.005;

const ANSWER_MS = 500;
const SEND_MS = 1000;
const WATCHDOG_MS = 100;
const STATUS_MS = 5;
const LEAD_S = 0.015;
const MOST_UNSENT_S = 0.1;
const STALE_MS = 50; // a drive that is short of samples, and that nothing renders any more, is stopped after this
const [IDLE, RAMPING] = [0, 3]; // of the states in STATUS
const REPORTS_PER_S = 1000;
const REPORTS_PER_FRAME = 3;

/** Samples that the page's limits reject; nothing of them was sent. */
export class LimitError extends Error {
  name = "LimitError";
}

/** A driver that is gone, in fault, or asked for what it cannot do. */
export class DriverError extends Error {
  name = "DriverError";
}

/** The least of the last values. */
class Least {
  #values;
  #ages;
  #first = 0;
  #count = 0;

  constructor(size) {
    this.#values = new Float64Array(size);
    this.#ages = new Float64Array(size);
  }

  get value() {
    return this.#values[this.#first];
  }

  add(value, age) {
    const size = this.#values.length;
    if (this.#count && this.#ages[this.#first] <= age - size) {
      this.#first = (this.#first + 1) % size;
      this.#count--;
    }
    // Whatever is above a later value is never the least again.
    while (this.#count && this.#values[(this.#first + this.#count - 1) % size] >= value) this.#count--;
    const at = (this.#first + this.#count++) % size;
    this.#values[at] = value;
    this.#ages[at] = age;
  }
}

/** The last second of the drive, with its sums. It goes on from one arming to the next. */
export class DriveWindow {
  #volts;
  #at = 0;
  #count = 0;
  #last = 0;
  #squares = 0;
  #steps = 0;
  #total = 0; // since the beginning, and its least and (negative) greatest in the window
  #low;
  #high;
  #rate;
  #ceilingV;
  #slew;

  constructor(sampleRateHz, ceilingV = CEILING_V, slewVPerS = SLEW_V_PER_S) {
    if (!(ceilingV > 0 && ceilingV <= CEILING_V && slewVPerS > 0 && slewVPerS <= SLEW_V_PER_S))
      throw new LimitError(`limits are lowered only: at most ${CEILING_V} V and ${SLEW_V_PER_S} V/s`);
    const n = Math.round(sampleRateHz);
    this.#rate = sampleRateHz;
    this.#ceilingV = ceilingV;
    this.#slew = slewVPerS;
    this.#volts = new Float64Array(n);
    for (const ends of [(this.#low = new Least(n + 1)), (this.#high = new Least(n + 1))]) ends.add(0, 0);
  }

  /** The last sample. */
  get lastV() {
    return this.#last;
  }

  /** Reject samples, by the first that breaks a limit; 0 V breaks none but the slew. */
  check(volts) {
    const ring = this.#volts;
    const n = ring.length;
    let [squares, steps, total, before] = [this.#squares, this.#steps, this.#total, this.#last];
    let [low, high] = [this.#low.value, -this.#high.value];
    const most = {
      squares: n * RMS_V ** 2,
      steps: n * (RMS_SLEW_V_PER_S / this.#rate) ** 2,
      stretch: n * DC_SHARE * this.#ceilingV,
    };
    const at = (i) => (i < n ? ring[(this.#at + i) % n] : volts[i - n]); // oldest first
    volts.forEach((v, i) => {
      squares += v * v - at(i) ** 2;
      steps += (v - before) ** 2 - (at(i + 1) - at(i)) ** 2;
      total += v;
      const reject = (why) => {
        throw new LimitError(`sample ${i} of ${v} V is rejected: ${why}`);
      };
      if (!(Math.abs(v) <= this.#ceilingV)) reject(`the ceiling is ${this.#ceilingV} V`);
      if (!(Math.abs(v - before) * this.#rate <= this.#slew)) reject(`the slew is ${this.#slew} V/s`);
      if (v !== 0) {
        if (squares > most.squares) reject(`the rms over a second is ${RMS_V} V`);
        if (steps > most.steps) reject("the current over a second is 0.5 mA rms");
        const stretch = (v > 0 ? total - low : high - total) + (Math.abs(v) * RAMP_S * this.#rate) / 2;
        if (stretch > most.stretch) reject(`the mean over a second is ${DC_SHARE} of the ceiling`);
      }
      low = Math.min(low, total);
      high = Math.max(high, total);
      before = v;
    });
  }

  /** Add samples that were sent. */
  take(volts) {
    const ring = this.#volts;
    for (const v of volts) {
      const next = (this.#at + 1) % ring.length;
      this.#squares += v * v - ring[this.#at] ** 2;
      this.#steps += (v - this.#last) ** 2 - (ring[next] - ring[this.#at]) ** 2;
      this.#total += v;
      this.#count++;
      this.#low.add(this.#total, this.#count);
      this.#high.add(-this.#total, this.#count);
      ring[this.#at] = this.#last = v;
      this.#at = next;
    }
  }

  /** The output went to 0 V by a ramp of its own, and rested for some time. */
  end(restS) {
    const ramp = Math.ceil(RAMP_S * this.#rate);
    const from = this.#last;
    this.take(Float64Array.from({ length: ramp }, (_, i) => (from * (ramp - 1 - i)) / ramp));
    this.take(new Float64Array(Math.min(this.#volts.length, Math.floor(Math.max(restS, 0) * this.#rate))));
  }
}

export class Driver extends EventTarget {
  #link;
  #parser = new FrameParser();
  #waiting = new Set();
  #sequence = 0;
  #version = OLDEST_VERSION;
  #owed = false; // a STOP, from just before ARM
  #sent = 0;
  #unsent = 0;
  #window;
  #setup;
  #playedOut = 0; // when the output last went to 0 V [ms]
  #sends = Promise.resolve();
  #rest = Promise.resolve();
  #freshMs = 0;
  #ends = [];
  #isLost = false;

  /**
   * @param {{name: string, hasReports: boolean, send(frame: Uint8Array): Promise<void>, close(): Promise<void>,
   *   onbytes: ((bytes: Uint8Array) => void) | null, onlost: ((error: Error) => void) | null}} link
   */
  constructor(link) {
    super();
    this.#link = link;
    /** Whether samples can be written. */
    this.isArmed = false;
    /** The driver's latest STATUS, and its CAPABILITIES. */
    this.status = null;
    this.capabilities = null;
    link.onbytes = (bytes) => this.#take(bytes);
    link.onlost = (error) => this.#lose(error);
  }

  /** Begin a session; limits of the page are lowered to the driver's. */
  static async open(link, { sampleRateHz, ceilingV = CEILING_V, maxSlewVPerS = SLEW_V_PER_S }) {
    const driver = new Driver(link);
    try {
      await driver.#hello();
      driver.#prepare(sampleRateHz, ceilingV, maxSlewVPerS);
    } catch (error) {
      await driver.close();
      throw error;
    }
    return driver;
  }

  async #hello() {
    const isOurs = (m) => m.kind === "CAPABILITIES" || (m.kind === "FAULT" && m.code === 2);
    let got;
    for (let left = Math.ceil((this.#link.awakeMs ?? 0) / ANSWER_MS); !got; left--) {
      const answer = this.#answer(isOurs);
      answer.catch(() => {});
      await this.#send("HELLO", { oldestVersion: OLDEST_VERSION, newestVersion: VERSION });
      got = await answer.catch((error) => {
        if (left === 0 || this.#isLost) throw error;
      });
    }
    if (got.kind === "FAULT" || got.oldestVersion > VERSION || got.newestVersion < VERSION)
      throw new ProtocolError(`${this.#link.name} does not speak version ${VERSION}; bring it up to date`);
    const bounds = [
      ["outputRateHz", 1000, 1e6], ["fullScaleMv", 1, 1e6], ["ceilingMv", 1, 200_000],
      ["maxSlewVPerS", 1, 4_666_666], ["queueSamples", 1, 2 ** 24], ["maxFrameSamples", 1, 32_765],
      ["maxWatchdogMs", 10, 160],
    ];
    for (const [field, least, most] of bounds)
      if (got[field] < least || got[field] > most)
        throw new ProtocolError(`${this.#link.name} states ${field} ${got[field]}, not ${least} to ${most}`);
    this.#version = VERSION;
    this.capabilities = got;
  }

  #prepare(sampleRateHz, ceilingV, slewVPerS) {
    const { rates, fullScaleMv, ceilingMv, outputRateHz, ...its } = this.capabilities;
    if (!rates.some((rate) => rate.sampleRateHz === sampleRateHz && rate.modes & 1))
      throw new DriverError(
        `the program has ${sampleRateHz} Hz, the driver ${rates.map((rate) => rate.sampleRateHz)} Hz; compile for it`,
      );
    const watchdogMs = Math.min(WATCHDOG_MS, its.maxWatchdogMs);
    const most = Math.min(its.maxFrameSamples, Math.floor((watchdogMs * sampleRateHz) / 4000));
    const inReports = (REPORTS_PER_FRAME * 62 - 20) >> 1;
    this.frameSamples = this.#link.hasReports ? Math.min(most, inReports) : most;
    if (this.#link.hasReports && (sampleRateHz / this.frameSamples) * REPORTS_PER_FRAME > REPORTS_PER_S)
      throw new DriverError(`${sampleRateHz} Hz are more than HID reports carry; compile for 16000 Hz, or use USB`);
    // Volts are kept within whole codes of an output sample, so that no rounding reaches a limit.
    const code = fullScaleMv / 1000 / 32767;
    const ceiling = Math.min(ceilingV, ceilingMv / 1000, fullScaleMv / 1000);
    const slew = Math.min(slewVPerS, its.maxSlewVPerS);
    const perS = Math.floor(slew / code / outputRateHz) * outputRateHz * code - code * sampleRateHz;
    this.#window = new DriveWindow(sampleRateHz, ceiling, perS);
    this.#setup = {
      mode: 0, watchdogMs, sampleRateHz, fullScaleMv, ceilingMv: Math.floor(ceiling * 1000),
      maxSlewVPerS: Math.floor(slew), carrierMhz: 0,
      leadUs: Math.min(LEAD_S * 1e6, watchdogMs * 1000), statusMs: STATUS_MS,
    };
  }

  /** Set up and arm. In a page only within a person's click or key. */
  async arm() {
    if (this.isArmed) return;
    const { userActivation } = globalThis.navigator ?? {};
    if (userActivation && !userActivation.isActive)
      throw new DriverError("a driver is armed by a person: call arm() in the listener of a click");
    if (this.#owed) await this.stop();
    await this.#ask("SETUP", this.#setup);
    this.#window.end((performance.now() - this.#playedOut) / 1000);
    this.#sent = 0;
    this.#owed = true;
    await this.#ask("ARM");
    this.isArmed = true;
  }

  /** Samples in the driver that are not played, by now. */
  get ahead() {
    if (!this.status) return 0;
    const queued = (this.#sent - this.status.samplesPlayed) >>> 0;
    const since = this.status.state === 2 ? (performance.now() - this.#freshMs) / 1000 : 0;
    return Math.max(0, queued - since * this.#setup.sampleRateHz);
  }

  /** Samples that it is short of, to have its lead. */
  get short() {
    return Math.max(0, LEAD_S * this.#setup.sampleRateHz - this.ahead - this.#unsent);
  }

  /** Check all samples, then send them as the driver has room. */
  write(volts) {
    const kept = Float64Array.from(volts);
    this.#unsent += kept.length;
    const turn = this.#sends.then(() => this.#write(kept));
    this.#sends = turn.catch(() => {});
    return turn;
  }

  async #write(volts) {
    let at = 0;
    try {
      if (!this.isArmed) throw new DriverError("the driver is not armed");
      this.#window.check(volts);
      while (at < volts.length) at += await this.#writePiece(volts.subarray(at, at + this.frameSamples));
    } finally {
      this.#unsent -= volts.length - at;
    }
  }

  async #writePiece(piece) {
    const { fullScaleMv, ceilingMv, sampleRateHz, watchdogMs } = this.#setup;
    const top = Math.floor((ceilingMv * 32767) / fullScaleMv);
    const most = Math.min(this.capabilities.queueSamples, sampleRateHz * 0.5e-3 * watchdogMs);
    while (this.ahead + piece.length > most && this.isArmed)
      await this.#answer((message) => message.kind === "STATUS");
    if (!this.isArmed) throw new DriverError("the driver was stopped");
    const codes = Int16Array.from(piece, (v) => {
      const nearest = Math.round((v * 1000 * 32767) / fullScaleMv);
      return Math.max(-top, Math.min(top, nearest));
    });
    await this.#send("STREAM", { sampleIndex: this.#sent % 2 ** 32, mode: 0, codes });
    this.#sent += piece.length;
    this.#unsent -= piece.length;
    this.#window.take(piece);
    return piece.length;
  }

  /**
   * Play an engine's blocks. A page that is hidden or closed, and an engine that dies, end at 0 V.
   *
   * @param {import("./engine.js").Engine} engine
   * @returns {() => Promise<void>} ends it
   */
  play(engine) {
    let blockMs = performance.now();
    const fail = async (error) => {
      await this.stop().catch(() => {});
      this.dispatchEvent(new CustomEvent("failed", { detail: error }));
    };
    const block = ({ detail }) => {
      blockMs = performance.now();
      if (!this.isArmed) return;
      const isQuiet = this.#window.lastV === 0 && detail.driveV.every((v) => v === 0);
      if (this.#unsent > MOST_UNSENT_S * this.#setup.sampleRateHz)
        return fail(new DriverError("the driver plays slower than the blocks come"));
      if (isQuiet && this.ahead > LEAD_S * this.#setup.sampleRateHz) return; // clocks differ
      this.write(detail.driveV).catch((error) => this.isArmed && fail(error));
    };
    const status = () => {
      if (!this.isArmed || performance.now() - blockMs < STALE_MS || this.short === 0) return;
      if (this.#window.lastV !== 0) fail(new DriverError("the engine has stopped"));
      else if (this.#sent > 0)
        this.write(new Float64Array(this.#setup.sampleRateHz / 100)).catch(() => {}); // keeps it awake
    };
    const leave = () => document.visibilityState === "hidden" && this.stop().catch(() => {});
    const close = () => this.stop().catch(() => {});
    const all = [[engine, "block", block], [this, "status", status]];
    if (globalThis.document) all.push([document, "visibilitychange", leave], [globalThis, "pagehide", close]);
    for (const [on, type, listener] of all) on.addEventListener(type, listener);
    const end = () => {
      for (const [on, type, listener] of all) on.removeEventListener(type, listener);
      return this.stop();
    };
    this.#ends.push(end);
    return end;
  }

  /** Ramp to 0 V and disarm. Repeated until it is delivered, by the next stop, arm or close. */
  async stop() {
    this.isArmed = false;
    if (!this.#owed) return;
    const answer = this.#answer((m) => m.kind === "FAULT" || (m.kind === "STATUS" && (m.state === IDLE || m.state === RAMPING)));
    answer.catch(() => {});
    await this.#send("STOP");
    await answer;
    this.#rested();
  }

  /** Stop, and close the link. */
  async close() {
    for (const end of this.#ends.splice(0)) await end().catch(() => {});
    await this.stop().catch(() => {});
    await this.#link.close();
  }

  #rested() {
    this.#owed = false;
    this.isArmed = false;
    this.#playedOut = performance.now() + 1000 * RAMP_S;
  }

  /** Frames leave one after the other; the sequence counts those that were delivered. */
  #send(name, fields) {
    const sent = this.#rest.then(async () => {
      if (this.#isLost) throw new DriverError(`${this.#link.name} is gone; open the driver again`);
      await this.#inTime(this.#link.send(encode(name, this.#sequence, fields, this.#version)));
      this.#sequence = (this.#sequence + 1) & 0xffff;
    });
    this.#rest = sent.catch(() => {});
    return sent;
  }

  /** A transfer that is taken, or loses the driver. */
  async #inTime(transfer) {
    let timer;
    const late = new Promise((_, reject) => {
      const error = new DriverError(`${this.#link.name} took no bytes for ${SEND_MS} ms; check its cable`);
      timer = setTimeout(reject, SEND_MS, error);
    });
    try {
      await Promise.race([transfer, late]);
    } catch (error) {
      this.#lose(error);
      throw error;
    } finally {
      clearTimeout(timer);
    }
  }

  async #ask(name, fields) {
    const answer = this.#answer((m) => m.kind === "FAULT" || (m.kind === "STATUS" && m.nextSequence === due));
    answer.catch(() => {});
    const due = (this.#sequence + 1) & 0xffff;
    await this.#send(name, fields);
    const got = await answer;
    if (got.kind === "FAULT") throw new DriverError(`the driver refuses ${name}: ${words(got)}`);
  }

  #answer(isAnswer) {
    return new Promise((resolve, reject) => {
      const waiting = { isAnswer, resolve, reject };
      waiting.timer = setTimeout(() => {
        this.#waiting.delete(waiting);
        const error = new DriverError(`${this.#link.name} did not answer within ${ANSWER_MS} ms; check its cable`);
        reject(error);
        if (this.capabilities) this.#lose(error); // before, a board may not be awake
      }, ANSWER_MS);
      this.#waiting.add(waiting);
    });
  }

  #take(bytes) {
    let messages;
    try {
      messages = this.#parser.feed(bytes);
    } catch (error) {
      return this.#lose(error);
    }
    for (const message of messages) {
      if (message.kind === "STATUS") {
        this.status = message;
        this.#freshMs = performance.now();
        this.dispatchEvent(new CustomEvent("status", { detail: message }));
      } else if (message.kind === "FAULT") {
        const wasArmed = this.isArmed;
        this.#rested(); // the driver ends the output itself; a report may never follow
        this.status = { ...this.status, state: RAMPING, fault: message.code };
        if (wasArmed) this.dispatchEvent(new CustomEvent("failed", { detail: new DriverError(`fault: ${words(message)}`) }));
      }
      for (const waiting of this.#waiting)
        if (waiting.isAnswer(message)) {
          this.#waiting.delete(waiting);
          clearTimeout(waiting.timer);
          waiting.resolve(message);
        }
    }
  }

  /** Of a link that has failed: the driver ends at 0 V by itself, at once or by its watchdog. */
  #lose(error) {
    if (this.#isLost) return;
    this.#isLost = true;
    const wasArmed = this.isArmed;
    this.isArmed = this.#owed = false;
    this.#link.close().catch(() => {});
    for (const waiting of this.#waiting) {
      clearTimeout(waiting.timer);
      waiting.reject(error);
    }
    this.#waiting.clear();
    if (wasArmed) this.dispatchEvent(new CustomEvent("failed", { detail: error }));
  }
}

const words = ({ code, expected, got }) => `${FAULTS[code] ?? code}: ${expected} is possible, ${got} came`;
