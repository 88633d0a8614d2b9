"""The Pico boards' firmware on an emulated RP2040 and RP2350, over its USB, to its converter.

Every output sample is a frame on the emulated SPI; the emulator writes them to a file, and the
index in that file is the clock of every deadline. The board is slower than the clock on the wall.
"""

import json
import queue
import re
import shutil
import signal
import subprocess
import threading
import time
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

import firmware_io
from firmware_io.links.tcp import TcpLink
from firmware_io.pico_image import pico_uf2
from firmware_io.proof_test import proof_test
from firmware_io.protocol import (
    Arm,
    CapabilitiesReport,
    FaultCode,
    FaultReport,
    Frame,
    FrameParser,
    Hello,
    Setup,
    StreamMode,
    StreamSamples,
    encode,
)
from tests.devices.pico_mutants import MUTANTS
from tests.waiting import PATIENCE_S, wait_for

pytestmark = pytest.mark.devices

ROOT = Path(firmware_io.__file__).parents[1]
BOARD = ROOT / "examples" / "boards" / "pico"
HERE = ROOT / "tests" / "firmware_io" / "pico"
OUTPUT_HZ, HALF = 48_000, 64
RAMP = OUTPUT_HZ * 5 // 1000
WATCHDOG = OUTPUT_HZ * 160 // 1000
RATE_HZ = 6000
FULL_SCALE_V = 200.0
LOW, HIGH, FLOATS = 0, 1, 4  # of a pin; with the pull-down that a reset switches on


@pytest.fixture(autouse=True)
def patient_host(monkeypatch):
    """An emulator that gets no processor for a second has not lost its cable."""
    monkeypatch.setattr("firmware_io.protocol_client.ANSWER_S", 5.0)


def build(board, folder):
    make = ("make", "-s", "-C", BOARD, f"BOARD={board}", f"BUILD={folder}")
    subprocess.run(make, check=True, capture_output=True)


@pytest.fixture(scope="module")
def tools():
    for command in ("arm-none-eabi-gcc", "node"):
        if shutil.which(command) is None:
            pytest.skip(f"{command} is missing (bash scripts/setup-devices.sh)")
    if not (HERE / "node_modules").exists():
        pytest.skip("rp2040js is missing (bash scripts/setup-devices.sh)")


@pytest.fixture(scope="module", params=["pico", "pico2"])
def image(request, tools, tmp_path_factory):
    """As `haptix firmware` writes it; by the other compiler, and with symbols, beside it."""
    folder = tmp_path_factory.mktemp(request.param)
    path = folder / f"haptix-{request.param}.uf2"
    path.write_bytes(pico_uf2(request.param, "rig-3"))
    build(request.param, folder)
    return path


def by_gcc(image):
    """What the other compiler made: the program with its symbols, and its file for the drive."""
    board = image.stem.removeprefix("haptix-")
    return image.with_name(f"{board}.elf"), image.with_name(f"{board}.uf2")


class SlowClock:
    """The host's clock beside an emulator that may be many times slower than the board.

    A host takes for played what a board plays by its own clock in the time since its last report.
    """

    def __call__(self):
        return time.monotonic() / 30

    def sleep(self, seconds):
        time.sleep(seconds)


class Board:
    """An emulated board that runs."""

    def __init__(self, image, folder, begins="configuration"):
        self.image, self.trace = image, folder / "output.codes"
        self._emulator = subprocess.Popen(
            ["node", HERE / "emulator.mjs", image, self.trace],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        self._lines: queue.Queue[dict] = queue.Queue()
        threading.Thread(target=self._read, daemon=True).start()
        self.events: list[dict] = []
        self.descriptors = self.wait(begins)
        events = (
            [*self.events] if any("port" in one for one in self.events) else [self.wait("port")]
        )
        self.port = next(event["port"] for event in events if "port" in event)
        self.address = f"tcp:127.0.0.1:{self.port},sample_rate_hz={RATE_HZ}"

    def _read(self):
        for line in self._emulator.stdout:
            self._lines.put(json.loads(line))

    def wait(self, name):
        """The next event that has a name; those before it are kept."""
        while True:
            event = self._lines.get(timeout=PATIENCE_S)
            self.events.append(event)
            if name in event:
                return event

    def do(self, what, **fields):
        self._emulator.stdin.write(json.dumps({"do": what, **fields}) + "\n")
        self._emulator.stdin.flush()

    def output(self):
        """All output codes so far."""
        return np.fromfile(self.trace, "<i2").astype(int)

    def output_until(self, clock):
        wait_for(lambda: self.trace.stat().st_size >= 2 * clock)
        return self.output()

    def more(self, samples):
        """The output when so many samples more have been played."""
        return self.output_until(self.trace.stat().st_size // 2 + samples)

    def time(self):
        """The board's own clock, and how much it has played."""
        self.do("time")
        return self.wait("time")

    def stand(self):
        """Stand still; an idle board takes a processor."""
        self._emulator.send_signal(signal.SIGSTOP)

    def go_on(self):
        self._emulator.send_signal(signal.SIGCONT)

    def end(self):
        self._emulator.kill()
        self._emulator.wait()


@pytest.fixture(scope="module")
def standing_board(image, tmp_path_factory):
    board = Board(image, tmp_path_factory.mktemp("board"))
    board.stand()
    yield board
    board.end()


@pytest.fixture
def board(standing_board):
    """A board for what leaves it as it was."""
    standing_board.go_on()
    yield standing_board
    standing_board.stand()


@pytest.fixture
def own_board(image, tmp_path):
    """A board to be broken."""
    board = Board(image, tmp_path)
    yield board
    board.end()


def sine(samples, peak_v=100.0):
    return peak_v * np.sin(2 * np.pi * 50 * np.arange(samples) / RATE_HZ)


def lines(volts):
    """Output codes of a stream: PROTOCOL.md's line between samples, quotients toward 0."""
    codes = np.concatenate([[0], np.round(volts / FULL_SCALE_V * 32767)]).astype(int)
    n = OUTPUT_HZ // RATE_HZ
    moved = np.diff(codes)[:, None] * np.arange(1, n + 1)
    return (codes[:-1, None] + np.sign(moved) * (np.abs(moved) // n)).ravel()


def played(output):
    """The output from its first code that is not 0."""
    return output[np.flatnonzero(output)[0] :]


def proofs(board):
    """What a proof test of the board shows, through its real link."""
    with closing(TcpLink("127.0.0.1", board.port)) as link:
        return proof_test(link, clock=SlowClock())


def descriptors_of(configuration):
    """Kind and body of each descriptor in a configuration."""
    while configuration:
        yield configuration[1], configuration[2 : configuration[0]]
        configuration = configuration[configuration[0] :]


def test_the_list_of_mutants_follows_the_port():
    for file, text, _ in MUTANTS:
        assert (BOARD / file).read_text().count(text) == 1, text


def test_a_host_finds_three_ways_to_it_by_its_descriptors(board):
    device, configuration = board.descriptors["device"], board.descriptors["configuration"]
    assert device[:2] == [18, 1] and board.descriptors["address"] == 7
    assert len(configuration) == configuration[2] + 256 * configuration[3]
    kinds = list(descriptors_of(configuration))
    interfaces = [body for kind, body in kinds if kind == 4]
    assert [body[3] for body in interfaces] == [3, 0xFF, 2, 10]  # HID, vendor, CDC and its data
    endpoints = [(body[0], body[1] & 3, body[2]) for kind, body in kinds if kind == 5]
    assert endpoints == [
        *((0x81, 3, 64), (0x01, 3, 64), (0x82, 2, 64), (0x02, 2, 64)),
        *((0x84, 3, 8), (0x83, 2, 64), (0x03, 2, 64)),
    ]
    names = [bytes(text[2:]).decode("utf-16-le") for text in board.descriptors["strings"]]
    assert names == ["haptix", "haptix driver", "rig-3"]
    assert len(board.descriptors["report"]) == 27
    assert board.descriptors["coding"][6] == 8


def test_the_watchdog_is_shown_and_the_amplifier_waits_for_the_middle_of_the_converter(board):
    """A reset comes first, which the firmware asks for; the first frame on SPI is 0 V."""
    resets = [event for event in board.events if "reset" in event]
    assert [event["reset"] for event in resets] == [1] and resets[0]["us"] < 10_000
    (on,) = [event for event in board.events if event.get("enable") == HIGH]
    output = board.output()
    assert on["at"] >= 1 and not output[: on["at"] + OUTPUT_HZ].any()


def test_the_board_plays_what_the_host_sends(board, image):
    volts, start = sine(600), board.output().size
    with firmware_io.open_device(board.address) as device:
        assert device.capabilities.name == image.stem.removeprefix("haptix-")
        device.write(volts)
        device.stop()
    expected = lines(volts)
    first = np.flatnonzero(expected)[0]
    found = played(board.more(WATCHDOG)[start:])[: expected.size - first]
    np.testing.assert_array_equal(found, expected[first:])


def test_20_s_at_48_khz_leave_without_an_underrun_or_a_drift(board):
    """Every sample, and not one too many by the chip's own clock."""
    samples, start = 20 * OUTPUT_HZ, board.output().size
    volts = 80 * np.sin(2 * np.pi * 100.3 * np.arange(samples) / OUTPUT_HZ)
    link = TcpLink("127.0.0.1", board.port)
    before = board.time()
    with firmware_io.Device(link, sample_rate_hz=OUTPUT_HZ, clock=SlowClock()) as device:
        device.write(volts)
        device.stop()
    expected = np.round(volts / FULL_SCALE_V * 32767)[1:]  # from the first that is not 0
    np.testing.assert_array_equal(played(board.more(HALF)[start:])[: expected.size], expected)
    after = board.time()
    passed_s = 1e-6 * (after["time"] - before["time"])
    assert passed_s > 20 and abs(after["at"] - before["at"] - passed_s * OUTPUT_HZ) < 2


def test_its_proof_test_holds(board):
    """Its own tests at power-up, each limit, and that its watchdog has been seen to reset it."""
    rows = proofs(board)
    assert all(row.holds for row in rows), [row for row in rows if not row.holds]
    assert "watchdog" in next(row.seen for row in rows if row.what == "what reset it last")


def test_the_line_rises_with_the_sample_that_is_marked(board):
    volts, start = sine(200), board.output().size
    with firmware_io.open_device(board.address) as device:
        device.mark(100, 7)
        device.write(volts)
        device.stop()
        (mark,) = device.marked()
    output = board.more(WATCHDOG)[start:]
    first = start + np.flatnonzero(output)[0] - np.flatnonzero(lines(volts))[0]
    changes = [event for event in board.events if event.get("mark") == HIGH]
    while not changes:
        changes = [board.wait("mark")]
    (rise,) = changes
    # Both leave by the same clock; which of the two is first is the DMA's affair.
    assert rise["mark"] == HIGH
    assert abs(rise["at"] - (first + 100 * OUTPUT_HZ // RATE_HZ)) <= 1
    fall = board.wait("mark")
    assert (fall["mark"], fall["at"] - rise["at"]) == (LOW, OUTPUT_HZ // 1000)
    assert mark.clock_ticks > 0


def test_an_unplugged_cable_ends_at_0_v_in_a_ramp(own_board):
    device = firmware_io.open_device(own_board.address)
    device.arm()
    device.write(sine(1200))
    wait_for(lambda: own_board.output().any())
    own_board.do("unplug")
    output = own_board.more(4 * WATCHDOG)
    end = int(np.flatnonzero(output)[-1])
    assert end - int(np.flatnonzero(output)[0]) < 1200 * OUTPUT_HZ // RATE_HZ  # amid the stream
    assert np.abs(np.diff(output[end - RAMP : end + 2])).max() <= 4.67e6 / OUTPUT_HZ / 200 * 32767
    with pytest.raises(firmware_io.DeviceError):
        device.write(sine(6000))


def test_a_program_that_hangs_is_reset_within_8_ms(own_board):
    device = firmware_io.open_device(own_board.address)
    device.arm()
    device.write(sine(600))
    wait_for(lambda: own_board.output().any())
    own_board.do("hang")
    hung, reset = own_board.wait("hung"), own_board.wait("reset")
    # The converter repeats its ring until the chip is reset and its pins float.
    assert 0 < reset["us"] - hung["hung"] <= 8100
    own_board.wait("configuration")  # it comes back, by itself
    assert not own_board.output()[reset["at"] :].any()
    rows = {row.what: row for row in proofs(own_board)}
    assert not rows.pop("what reset it last").holds
    assert all(row.holds for row in rows.values()), [r for r in rows.values() if not r.holds]


def test_a_loop_that_hangs_is_reset_within_109_ms_while_its_interrupts_play(own_board):
    device = firmware_io.open_device(own_board.address)
    device.arm()
    device.write(sine(600))
    wait_for(lambda: own_board.output().any())
    own_board.do("hangLoop")
    hung, reset = own_board.wait("hung"), own_board.wait("reset")
    assert 90_000 < reset["us"] - hung["hung"] <= 109_400  # 75 halves, one on its way, 8 ms
    own_board.wait("configuration")
    assert not own_board.output()[reset["at"] :].any()


@pytest.mark.parametrize("offset", [None, 4500], ids=["no monitor", "27 V too much"])
def test_an_output_that_is_not_what_was_sent_ends_with_the_amplifier_off(own_board, offset):
    device = firmware_io.open_device(own_board.address)
    device.arm()
    device.write(sine(600))
    wait_for(lambda: own_board.output().any())
    own_board.do("wire", **({"isWrong": True} if offset is None else {"offset": offset}))
    while own_board.wait("enable")["enable"] == HIGH:
        pass
    own_board.wait("reset")


@pytest.mark.parametrize(("what", "fields"), [("stall", {"us": 4000}), ("fault", {})])
def test_a_late_interrupt_and_a_fault_end_in_one_frame_of_0_v(own_board, what, fields):
    """The DMA repeats a half for 2.7 ms before a stall of 4 ms ends: the watchdog has 8 ms."""
    device = firmware_io.open_device(own_board.address)
    device.arm()
    device.write(sine(600))
    wait_for(lambda: own_board.output().any())
    own_board.do(what, **fields)
    while (off := own_board.wait("enable"))["enable"] == HIGH:
        pass
    reset = own_board.wait("reset")
    assert own_board.output_until(reset["at"])[off["at"] : reset["at"]].tolist() == [0]


@pytest.mark.parametrize("offset", [2000, -2000])
def test_what_an_amplifier_lags_and_its_monitor_errs_is_no_fault(board, offset):
    """12 V of 200 V; the wire is right again afterwards."""
    before = len(board.events)
    board.do("wire", offset=offset)
    board.more(4 * HALF)
    with firmware_io.open_device(board.address) as device:
        device.write(sine(120))
        device.stop()
    board.do("wire")
    board.time()  # after all that came before it
    assert not [one for one in board.events[before:] if "reset" in one or "enable" in one]


def test_a_program_of_which_a_bit_is_wrong_never_enables_the_amplifier(image, tmp_path):
    bad = tmp_path / "bad.uf2"
    assert image.read_bytes().count(b"rig-3") == 1
    bad.write_bytes(image.read_bytes().replace(b"rig-3", b"rig-2"))
    broken = Board(bad, tmp_path, begins="reset")  # its proof that the watchdog resets it
    try:
        seen_us = 0
        while seen_us < 100_000:  # a good one enables it within some milliseconds
            seen_us = broken.time()["time"]
        assert not [event for event in broken.events if event.get("enable") == HIGH]
    finally:
        broken.end()


@pytest.mark.usefixtures("tools")
def test_the_boot_rom_of_the_rp2350_starts_no_program_without_its_image_definition(tmp_path):
    whole = pico_uf2("pico2")
    definition = bytes.fromhex("d3deffff42012110")
    assert whole.count(definition) == 1
    file = tmp_path / "bad.uf2"
    file.write_bytes(whole.replace(definition, bytes.fromhex("d3deffff42012111")))  # for RISC-V
    board = Board(file, tmp_path, begins="port")
    try:
        seen_us = 0
        while seen_us < 100_000:
            seen_us = board.time()["time"]
        # The program proves its watchdog within 10 ms.
        assert not [event for event in board.events if "reset" in event or event.get("enable") == 1]
    finally:
        board.end()


class Frames:
    """Frames over the emulated HID or serial endpoints."""

    def __init__(self, board, endpoint):
        self._board, self._endpoint, self._parser = board, endpoint, FrameParser()
        self._sequence = 0

    def send(self, message):
        frame = encode(Frame(message, self._sequence))
        self._sequence += 1
        if self._endpoint == 1:
            for at in range(0, len(frame), 62):
                piece = frame[at : at + 62]
                begins = 0x80 if at == 0 else 0
                report = bytes([1, len(piece) | begins]) + piece.ljust(62, b"\0")
                self._board.do("send", endpoint=1, bytes=report.hex())
        else:
            self._board.do("send", endpoint=self._endpoint, bytes=frame.hex())

    def until(self, kind):
        """The next answer of a kind."""
        while True:
            event = self._board.wait("endpoint")
            data = bytes.fromhex(event["bytes"])
            if self._endpoint == 1:
                data = data[2 : 2 + (data[1] & 0x7F)]
            for frame in self._parser.feed(data):
                assert isinstance(frame, Frame), frame
                if isinstance(frame.message, kind):
                    return frame.message


@pytest.mark.parametrize("endpoint", [1, 3], ids=["hid", "cdc"])
def test_a_limit_is_held_on_the_other_endpoints_too(board, endpoint):
    frames = Frames(board, endpoint)
    frames.send(Hello(4, 4))
    about = frames.until(CapabilitiesReport)
    assert (about.report_bytes, about.has_tested_itself) == (64, True)
    frames.send(
        Setup(
            mode=StreamMode.WAVEFORM,
            watchdog_ms=160,
            sample_rate_hz=RATE_HZ,
            full_scale_mv=200_000,
            ceiling_mv=100_000,
            max_slew_v_per_s=about.max_slew_v_per_s,
        )
    )
    frames.send(Arm())
    before = board.output().size
    frames.send(StreamSamples(0, np.full(4, 20_000, np.int16)))
    fault = frames.until(FaultReport)
    assert fault.code is FaultCode.CEILING
    assert not board.more(RAMP)[before:].any()


def test_memory_that_goes_bad_ends_with_the_amplifier_off(image, standing_board, tmp_path):
    """As Debian's compiler makes it, which keeps the symbols: the same board and proofs."""
    program, file = by_gcc(image)
    other = Board(file, tmp_path)
    try:
        assert bytes(other.descriptors["strings"][2][2:]).decode("utf-16-le") == "serial-not-set"
        assert other.descriptors["configuration"] == standing_board.descriptors["configuration"]
        rows = proofs(other)
        assert all(row.holds for row in rows), [row for row in rows if not row.holds]
        symbols = subprocess.run(
            ["arm-none-eabi-nm", program], capture_output=True, text=True, check=True
        ).stdout
        at = int(re.search(r"(\w+) \w board_device", symbols)[1], 16) - 0x20000000
        other.do("flip", address=at, bit=3)
        while other.wait("enable")["enable"] == HIGH:
            pass
        other.wait("reset")
    finally:
        other.end()
