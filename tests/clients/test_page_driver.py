"""A page as a driver's host: its bytes against the golden ones, its session with the firmware."""

import json
from base64 import b64encode

import numpy as np
import pytest

import haptix
from firmware_io.links.mock import MockDriver
from firmware_io.protocol import FrameParser, StatusReport
from firmware_io.serve import DriverServer
from haptix.feel.materials import Grating
from haptix.play import compile_touch
from tests.clients.test_engine_package import under_node
from tests.made_clients import ROOT
from tests.waiting import wait_for

GOLDEN = ROOT / "firmware_io" / "golden"

READ_GOLDEN = """
import { readFileSync } from "node:fs";
import { crc16, crc32, encode, FrameParser, fromReport, toReports } from "PACKAGE/src/protocol.js";
const { sums, frames, sent } = JSON.parse(readFileSync(0));
const of = (hex) => new Uint8Array(Buffer.from(hex, "hex"));
const hex = (bytes) => Buffer.from(bytes).toString("hex");
const words = (_, value) => (typeof value === "bigint" ? Number(value) : value);
const found = (bytes, step) => {
  const parser = new FrameParser(), all = [];
  for (let at = 0; at < bytes.length; at += step)
    all.push(...parser.feed(bytes.subarray(at, at + step)));
  return all.map((m) => (m.codes ? { ...m, codes: [...m.codes] } : m));
};
process.stdout.write(JSON.stringify({
  sums: sums.map((one) => [crc16(of(one)), crc32(of(one))]),
  read: frames.map((one) => found(of(one), one.length)),
  written: frames.flatMap((one) => found(of(one), one.length).filter((m) => KINDS.includes(m.kind))
    .map((m) => hex(encode(m.kind, m.sequence, m, m.version)))),
  pieces: sent.map((one) =>
    [1, 7, 4096].map((step) => found(of(one), step).map((m) => m.sequence))),
  reports: frames.map((one) =>
    hex(toReports(of(one)).flatMap((report) => [...fromReport(report)]))),
}, words));
""".replace("KINDS", '["HELLO", "SETUP", "ARM", "STREAM", "STOP", "PING", "REVISE", "MARK"]')


def golden(name):
    return json.loads((GOLDEN / name).read_text())


def test_its_bytes_are_the_golden_ones():
    sums, frames = golden("crc.json"), golden("frames.json")
    steps = [s for path in sorted(GOLDEN.glob("session-*")) for s in golden(path.name)["steps"]]
    sent = [bytes.fromhex(step["transmit"]) for step in steps if "transmit" in step]
    given = {
        "sums": [one["bytes"].replace(" ", "") for one in sums],
        "frames": [one["bytes"].replace(" ", "") for one in frames],
        "sent": [one.hex() for one in sent],
    }
    got = under_node(READ_GOLDEN, json.dumps(given).encode())
    assert got["sums"] == [[int(one["crc16"], 16), int(one["crc32"], 16)] for one in sums]
    hosts = [one for one in frames if int(one["bytes"].split()[3], 16) < 0x80]
    assert got["written"] == [one["bytes"].replace(" ", "") for one in hosts]
    for one, read in zip(frames, got["read"], strict=True):
        assert [(m["kind"], m["sequence"]) for m in read] == [(one["kind"], one["sequence"])]
        for field, value in one["fields"].items():
            name = field.replace("_ticks", "").title().replace("_", "")
            name = name[0].lower() + name[1:]
            if (one["kind"], name) == ("FAULT", "sequence"):  # of the frame that was refused
                name = "ofSequence"
            if name in read[0] and isinstance(value, int):
                assert read[0][name] == value, field
    assert got["reports"] == given["frames"]
    for data, pieces in zip(sent, got["pieces"], strict=True):
        due = [frame.sequence for frame in FrameParser().feed(data)]
        assert pieces == [due] * 3


WINDOW = """
import { readFileSync } from "node:fs";
import { DriveWindow } from "PACKAGE/src/driver.js";
const { rateHz, writes } = JSON.parse(readFileSync(0));
const drive = new DriveWindow(rateHz);
process.stdout.write(JSON.stringify(writes.map((given) => {
  const volts = new Float64Array(given);
  try {
    drive.check(volts);
  } catch (error) {
    return error.message.match(/sample (\\d+) .*(ceiling|slew|rms|current|mean) /).slice(1);
  }
  drive.take(volts);
  return null;
})));
"""


def rejected(history, volts, rate_hz):
    """The first sample that breaks a limit and which, calculated anew from all that was sent."""
    all_v = np.concatenate([np.zeros(rate_hz + 1), history, volts])
    began = all_v.size - volts.size
    for i, v in enumerate(volts):
        if i > 0 and not volts[i - 1 :].any():
            break  # what stays at 0 V breaks none
        at = began + i
        second = all_v[at - rate_hz + 1 : at + 1]
        steps = np.diff(second)
        # A stretch may begin wherever in the second before the write.
        sums = np.cumsum(all_v[began - rate_hz : at + 1][::-1])
        stretch = max((np.sign(v) * sums).max(), 0.0) + abs(v) * 0.005 * rate_hz / 2
        for limit, is_broken in {
            "ceiling": abs(v) > 200.0,
            "slew": abs(v - all_v[at - 1]) * rate_hz > 0.7e-3 / 150e-12,
            "rms": v != 0 and np.sum(second**2) > rate_hz * (1.01 * 200.0) ** 2 / 2,
            "current": v != 0 and np.sum(steps**2) > (0.5e-3 / 150e-12) ** 2 / rate_hz,
            "mean": v != 0 and stretch > rate_hz * 0.05 * 200.0,
        }.items():
            if is_broken:
                return [str(i), limit]
    return None


@pytest.mark.parametrize(
    ("rate_hz", "count", "longest", "limits"),
    [
        (1000, 200, 300, {"ceiling", "rms", "mean"}),
        pytest.param(16_000, 40, 30, {"slew", "current"}, marks=pytest.mark.slow),
    ],
)
def test_its_limits_are_those_of_the_last_second(rate_hz, count, longest, limits):
    rng = np.random.default_rng(6)
    writes, history, expected = [], np.empty(0), []
    for number in range(count):
        n = int(rng.integers(1, longest))
        hz = rng.uniform(20, 490) if rate_hz == 1000 else rng.uniform(3000, 8000)
        wave = np.sin(2 * np.pi * hz / rate_hz * np.arange(n))
        volts = rng.uniform(60, 195) * wave + rng.choice([0, 0, 0, 30, -9])
        match number % 20:
            case 1:
                volts *= 1.3
            case 2 | 3 | 4 | 5 | 6 | 7:
                volts = 190 * np.sign(wave)
            case 8 | 9 | 10 if rate_hz == 16_000:  # 280 V from each sample to the next
                volts = 140.0 * (-1.0) ** np.arange(3000)
            case 19:
                volts = np.zeros(int(1.5 * rate_hz))
        writes.append(np.clip(volts, -202, 202).tolist())
        expected.append(rejected(history, np.array(writes[-1]), rate_hz))
        if expected[-1] is None:
            history = np.concatenate([history, writes[-1]])[-rate_hz - 1 :]
    got = under_node(WINDOW, json.dumps({"rateHz": rate_hz, "writes": writes}).encode())
    assert got == expected
    assert {why[1] for why in expected if why} >= limits


#: A driver of a page whose link is a golden session: what it sends, and what it is told by.
DIALOGUE = """
import { readFileSync } from "node:fs";
import { setTimeout as sleep } from "node:timers/promises";
import { Driver } from "PACKAGE/src/driver.js";
const { steps, tone } = JSON.parse(readFileSync(0));
const sent = [], told = [], heard = [];
const link = {
  name: "golden", hasReports: false,
  async send(frame) {
    sent.push(Buffer.from(frame).toString("hex"));
    steps.shift(); // what it is to send
    while (steps.length && !steps[0].receive) {
      const { transmit } = steps.shift();
      if (!transmit) continue;
      const bytes = new Uint8Array(Buffer.from(transmit.replaceAll(" ", ""), "hex"));
      setTimeout(() => bytes.forEach((_, i) => link.onbytes(bytes.subarray(i, i + 1))), 0);
    }
  },
  async close() {},
};
const driver = await Driver.open(link, { sampleRateHz: 8000 });
driver.addEventListener("failed", ({ detail }) => told.push(detail.message));
driver.addEventListener("status", ({ detail: { state, samplesPlayed, fault } }) =>
  heard.push([state, samplesPlayed, fault]));
const volts = tone.map((code) => (code * 250) / 32767);
await driver.arm();
await driver.write(volts);
await driver.stop();
await driver.arm();
await driver.write(volts.slice(0, 200));
await driver.write(volts.slice(200, 400)); // damaged on its way
while (heard.at(-1)[0] !== 0 || !told.length) await sleep(1);
process.stdout.write(JSON.stringify({ sent, told, heard, isArmed: driver.isArmed }));
"""


def test_its_session_is_the_golden_one_byte_for_byte():
    steps = golden("session-host.json")["steps"]
    received = [bytearray.fromhex(step["receive"]) for step in steps if "receive" in step]
    received[-1][16] ^= 1  # what the wire did
    tone = [round(26_000 * np.sin(2 * np.pi * n / 20)) for n in range(480)]
    got = under_node(DIALOGUE, json.dumps({"steps": steps, "tone": tone}).encode())
    assert got["sent"] == [one.hex() for one in received]
    (told,) = got["told"]
    assert "DAMAGED" in told
    assert not got["isArmed"]
    answers = b"".join(bytes.fromhex(step["transmit"]) for step in steps if "transmit" in step)
    reports = [frame.message for frame in FrameParser().feed(answers)]
    states = [[m.state, m.samples_played, m.fault] for m in reports if isinstance(m, StatusReport)]
    assert got["heard"] == states


#: A link over the socket of a served driver; only Node has one.
SESSION = """
import { createHmac } from "node:crypto";
import { readFileSync } from "node:fs";
import { connect } from "node:net";
import { setTimeout as sleep } from "node:timers/promises";
import { EngineCore } from "PACKAGE/src/core.js";
import { Driver, DriveWindow } from "PACKAGE/src/driver.js";
const { port, program } = JSON.parse(readFileSync(0));

function tcp() {
  return new Promise((resolve, reject) => {
    const socket = connect(port, "127.0.0.1");
    const link = { name: "tcp", hasReports: false, onbytes: null, onlost: null, isCut: false };
    link.send = (frame) => new Promise((done) => (link.isCut ? done() : socket.write(frame, done)));
    link.close = async () => socket.destroy();
    socket.on("error", reject);
    socket.on("close", () => link.onlost?.(new Error("closed")));
    socket.once("data", (line) => {
      socket.write(createHmac("sha256", "").update(line).digest("hex") + "\\n");
      socket.on("data", (bytes) => link.onbytes(bytes));
      resolve(link);
    });
  });
}
const out = (result) => process.stdout.write(JSON.stringify(result), () => process.exit(0));
"""

PLAY = """
const engine = await EngineCore.load(new Uint8Array(Buffer.from(program, "base64")));
const link = await tcp();
const driver = await Driver.open(link, { sampleRateHz: engine.sampleRateHz });
await driver.arm();
const sent = [];
for (let turn = 0; turn < 20; turn++) {
  engine.touch({ id: 1, tS: engine.nowS, xMm: 5 + turn, yMm: 9, forceN: 0.5 });
  sent.push(...engine.block(60).driveV);
}
await driver.write(sent);
while (driver.ahead > 0) await sleep(2);
await driver.stop();
const { underruns, faults } = driver.status;
await driver.close();
out({ sent, underruns, faults });
"""

LIMITS = """
const link = await tcp();
const driver = await Driver.open(link, { sampleRateHz: 48000, ceilingV: 100 });
await driver.arm();
const made = (n, of) => Float64Array.from({ length: n }, (_, i) => of(i));
const sine = (v, f, n) => made(n, (i) => v * Math.sin((2 * Math.PI * f * i) / 48000));
const square = made(48000, (i) => 199 * Math.max(-1, Math.min(1, 5 * Math.sin(i / 20))));
const step = made(9000, (i) => Math.min(90, i));
const words = [];
const say = (error) => words.push(`${error.name} ${error.message}`);
for (const volts of [sine(101, 1000, 48), sine(99, 20000, 48), new Float64Array([NaN]), step])
  await driver.write(volts).then(() => words.push("sent"), say);
await driver.write(sine(99, 1000, 480));
const refused = (how) => {
  try { how(); return "taken"; } catch (error) { return `${error.name} ${error.message}`; }
};
words.push(refused(() => new DriveWindow(48000, 201)));
words.push(refused(() => new DriveWindow(48000).check(square)));
await driver.close();
out({ words, faults: driver.status.faults });
"""

SILENT = """
const link = await tcp();
const driver = await Driver.open(link, { sampleRateHz: 48000 });
await driver.arm();
const engine = new EventTarget();
let failed = "";
driver.addEventListener("failed", ({ detail }) => (failed ||= detail.message));
driver.play(engine);
for (let k = 0; k < 6; k++) {
  const driveV = Float64Array.from({ length: 480 }, (_, i) => 100 * Math.sin((480 * k + i) / 7));
  engine.dispatchEvent(new CustomEvent("block", { detail: { driveV } }));
  await sleep(8);
}
link.isCut = IS_CUT;
for (let i = 0; i < 2000 && driver.status.state !== 0 && !driver.status.fault; i++) await sleep(5);
for (let i = 0; i < 200 && !failed; i++) await sleep(5);
const { state, fault } = driver.status;
out({ failed, state, fault, isArmed: driver.isArmed });
"""


@pytest.fixture
def served():
    driver = MockDriver(sample_rate_hz=48000.0, pace="real")
    with DriverServer(driver) as server:
        yield driver, server.port


def test_a_program_arrives_at_the_driver_sample_for_sample(model):
    surface = haptix.FrictionSurface.build(model, {"normal_force_n": 0.5, "frequency_hz": 4000.0})
    with haptix.open_device("mock:") as device:
        program = compile_touch(surface, Grating(period_mm=2.0), device)
    text = b64encode(program).decode()
    for _ in range(5):  # a busy machine may leave the driver dry, which is heard in its record
        driver = MockDriver(sample_rate_hz=48000.0, pace="real")
        with DriverServer(driver) as server:
            given = json.dumps({"port": server.port, "program": text})
            got = under_node(SESSION + PLAY, given.encode())
        if got["underruns"] <= 1:  # that behind the last sample
            break
    sent, played = np.array(got["sent"]), np.asarray(driver.output_v)
    assert got["faults"] == 0
    assert np.abs(sent).max() > 50.0
    code_v = 250.0 / 32767
    # Where the stream begins in the record: what was played before is at 0 V.
    first = np.flatnonzero(np.abs(sent) > code_v)[0]
    begins = np.flatnonzero(played)[0] - first
    arrived = played[begins : begins + sent.size]
    np.testing.assert_allclose(arrived, sent, rtol=0, atol=0.501 * code_v)
    assert played[-1] == 0.0


def test_what_is_above_a_limit_is_not_sent(served):
    for _ in range(5):  # a busy machine may be silent for longer than the driver's watchdog waits
        got = under_node(SESSION + LIMITS, json.dumps({"port": served[1]}).encode())
        if got["faults"] == 0:
            break
    assert got["faults"] == 0
    for words, part in zip(
        got["words"], ["ceiling", "slew", "ceiling", "mean", "LimitError", "rms"], strict=True
    ):
        assert part in words
    assert np.abs(served[0].output_v).max() <= 99.1


@pytest.mark.parametrize("is_cut", [False, True])
def test_a_page_that_falls_silent_ends_at_0_v(served, is_cut):
    """By its own STOP while it can send, else by the driver's watchdog."""
    driver, port = served
    script = SESSION + SILENT.replace("IS_CUT", str(is_cut).lower())
    got = under_node(script, json.dumps({"port": port}).encode())
    assert not got["isArmed"]
    if is_cut:  # no report of the end of the ramp need follow a fault
        assert got["state"] in (0, 3)
        assert got["fault"] == 15  # STARVED
    else:
        assert got["state"] == 0
        assert (got["fault"], got["failed"]) == (0, "the engine has stopped")
    wait_for(lambda: np.asarray(driver.output_v)[-1] == 0.0)
    assert np.abs(driver.output_v).max() > 50.0


VIRTUAL = """
import { setTimeout as sleep } from "node:timers/promises";
import { Driver } from "PACKAGE/src/driver.js";
import { openLink } from "PACKAGE/src/links.js";
import { encode, FAULTS, FrameParser } from "PACKAGE/src/protocol.js";
const out = (result) => process.stdout.write(JSON.stringify(result), () => process.exit(0));
const sine = (n, rateHz) =>
  Float64Array.from({ length: n }, (_, i) => 100 * Math.sin((2 * Math.PI * 1000 * i) / rateHz));
async function opened(sampleRateHz) {
  const played = [];
  const onplayed = (volts) => played.push(...volts);
  const link = await openLink("virtual", { sampleRateHz, onplayed });
  return { played, link, driver: await Driver.open(link, { sampleRateHz }) };
}
"""

PLAYED = """
const { played, driver } = await opened(16000);
await driver.arm();
const sent = sine(8000, 16000);
await driver.write(sent);
while (driver.ahead > 0) await sleep(2);
await driver.stop();
const { underruns, fault } = driver.status;
await driver.close();
await sleep(50);
out({ sent: [...sent], played, underruns, fault });
"""

STARVED = """
const { played, link, driver } = await opened(48000);
let failed = "";
driver.addEventListener("failed", ({ detail }) => (failed = detail.message));
await driver.arm();
await driver.write(sine(96, 48000));
while (!failed) await sleep(2);
out({ played, failed, isArmed: driver.isArmed });
"""

#: By frames of its own, without the page's limits: only the firmware's are left.
OVER = """
const played = [], faults = [], parser = new FrameParser();
const link = await openLink("virtual", { onplayed: (volts) => played.push(...volts) });
link.onbytes = (bytes) => {
  for (const message of parser.feed(bytes)) if (message.kind === "FAULT") faults.push(message.code);
};
const setup = {
  mode: 0, watchdogMs: 100, sampleRateHz: 48000, fullScaleMv: 200000, ceilingMv: 100000,
  maxSlewVPerS: 4666666, carrierMhz: 0, leadUs: 15000, statusMs: 5,
};
const codes = Int16Array.from({ length: 960 }, (_, i) => CODE);
const frames = [
  ["HELLO", { oldestVersion: 4, newestVersion: 4 }], ["SETUP", setup], ["ARM"],
  ["STREAM", { sampleIndex: 0, mode: 0, codes }],
];
for (const [sequence, [name, fields]] of frames.entries())
  await link.send(encode(name, sequence, fields, 4));
while (!faults.length) await sleep(2);
await sleep(50);
out({ played, faults: faults.map((code) => FAULTS[code]) });
"""


def test_a_virtual_driver_plays_what_is_written():
    for _ in range(5):  # a busy machine may leave the driver dry, which is heard in its record
        got = under_node(VIRTUAL + PLAYED, b"")
        if got["underruns"] <= 1:
            break
    played, sent = np.array(got["played"]), np.array(got["sent"])
    # The output has 48 kHz: lines from sample to sample, which end at the last one.
    sent = np.interp(np.arange(3 * sent.size - 2) / 3, np.arange(sent.size), sent)
    first = np.flatnonzero(played)[0] - np.flatnonzero(np.abs(sent) > 200 / 32767)[0]
    arrived = played[first : first + sent.size]
    # Half a code of a sample, and one of whole numbers between two.
    np.testing.assert_allclose(arrived, sent, rtol=0, atol=1.501 * 200 / 32767)
    assert played[-1] == 0.0
    assert got["fault"] == 0


def test_a_virtual_driver_ends_at_0_v_by_itself():
    got = under_node(VIRTUAL + STARVED, b"")
    driven = np.flatnonzero(got["played"])
    # Two milliseconds of samples, then the watchdog of 100 ms and the ramp of 5.
    assert (driven[-1] - driven[0]) / 48_000 < 0.107
    assert "STARVED" in got["failed"]
    assert not got["isArmed"]


@pytest.mark.parametrize(
    ("code", "fault"),
    # Steps of 195 V are too steep, where 97 V are allowed; 122 V are above a ceiling of 100 V.
    [("i % 2 ? 16000 : -16000", "SLEW"), ("Math.min(i * 500, 20000)", "CEILING")],
)
def test_a_virtual_driver_has_the_limits_of_a_board(code, fault):
    got = under_node(VIRTUAL + OVER.replace("CODE", code), b"")
    assert got["faults"][0] == fault
    assert got["played"][-1] == 0.0
