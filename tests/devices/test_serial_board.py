"""The STM32F405 board's firmware on an emulated board, through a real serial link.

The board's own output samples, which the emulator writes to a file, are the clock of every
deadline here: index k of the file is the output at the board's clock k. That clock is four times
slower than the one on the wall, so that a busy computer keeps up.
"""

import os
import re
import shutil
import signal
import subprocess
import sys
import textwrap
import time
from pathlib import Path

import numpy as np
import pytest

import firmware_io
from firmware_io.protocol import Ping
from tests.links import stream_of
from tests.waiting import PATIENCE_S

pytestmark = pytest.mark.devices

BOARD = Path(firmware_io.__file__).parents[1] / "examples" / "boards" / "stm32f405"
OUTPUT_HZ = 2000
WATCHDOG = OUTPUT_HZ * 160 // 1000  # 160 ms in output samples
RAMP = OUTPUT_HZ * 5 // 1000
HIGH = OUTPUT_HZ // 1000  # output samples in 1 ms
RATE_HZ = 250
FULL_SCALE_V = 200.0
PATIENT_S = 5.0


@pytest.fixture(autouse=True)
def patient_host(monkeypatch):
    """An emulator that gets no processor for a second has not lost its cable."""
    monkeypatch.setattr("firmware_io.protocol_client.ANSWER_S", PATIENT_S)


@pytest.fixture(scope="module")
def firmware(tmp_path_factory):
    for command in ("arm-none-eabi-gcc", "qemu-system-arm"):
        if shutil.which(command) is None:
            pytest.skip(f"{command} is missing (apt install gcc-arm-none-eabi qemu-system-arm)")
    folder = tmp_path_factory.mktemp("stm32f405")
    # The board's own firmware is built too, so that its DAC, DMA and clock code compiles.
    subprocess.run(
        ["make", "-s", "-C", BOARD, f"BUILD={folder}", "all", "emulated"],
        check=True,
        capture_output=True,
    )
    return folder / "emulated.elf"


class Board:
    """An emulated board that runs."""

    def __init__(self, firmware, folder):
        self.trace, self.line = folder / "output.codes", folder / "line.changes"
        self._qemu = subprocess.Popen(
            [
                *("qemu-system-arm", "-M", "netduinoplus2", "-nographic", "-monitor", "none"),
                *("-serial", "pty", "-serial", f"file:{self.trace}"),
                *("-serial", f"file:{self.line}", "-kernel", firmware),
            ],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        self.port = re.search(r"/dev/pts/\d+", self._qemu.stdout.readline())[0]
        # qemu looks once a second whether the port is open; a cable is always plugged in.
        self._cable = os.open(self.port, os.O_RDWR | os.O_NOCTTY)
        time.sleep(1.2)
        # It hears nobody in the first second of its output, which stands at 0 V.
        assert not self.output_until(OUTPUT_HZ).any()
        self.address = f"serial:port={self.port},sample_rate_hz={RATE_HZ}"

    def output(self):
        """All output codes so far."""
        return np.fromfile(self.trace, "<i2").astype(int)

    def line_changes(self):
        """Output samples at which the digital line's ring rises and falls."""
        return np.fromfile(self.line, "<u4").tolist()

    def output_until(self, clock):
        """The output codes up to a clock of the board, waited for."""
        deadline = time.monotonic() + PATIENCE_S
        while (codes := self.output()).size < clock:
            assert time.monotonic() < deadline, "the emulated board has stopped"
            time.sleep(0.05)
        return codes

    def end(self):
        os.close(self._cable)
        self._qemu.kill()
        self._qemu.wait()


@pytest.fixture
def board(firmware, tmp_path):
    board = Board(firmware, tmp_path)
    yield board
    board.end()


def sine(samples, peak_v=100.0):
    return peak_v * np.sin(2 * np.pi * 10 * np.arange(samples) / RATE_HZ)


def lines(volts):
    """Output codes of a stream: PROTOCOL.md's line between samples, quotients toward 0."""
    codes = np.concatenate([[0], np.round(volts / FULL_SCALE_V * 32767)]).astype(int)
    n = OUTPUT_HZ // RATE_HZ
    moved = np.diff(codes)[:, None] * np.arange(1, n + 1)
    return (codes[:-1, None] + np.sign(moved) * (np.abs(moved) // n)).ravel()


def clock_of(device):
    """The board's clock, in output samples since its power-up."""
    return round(device.progress().clock_samples * OUTPUT_HZ / RATE_HZ)


def played(output):
    """The output from its first code that is not 0."""
    return output[np.flatnonzero(output)[0] :]


def test_the_board_plays_what_the_host_sends(board):
    volts = sine(60)
    with firmware_io.open_device(board.address) as device:
        device.write(volts)
        device.stop()
        clock = clock_of(device)
    expected = lines(volts)
    first = np.flatnonzero(expected)[0]
    found = played(board.output_until(clock))[: expected.size - first]
    np.testing.assert_array_equal(found, expected[first:])


def test_the_line_rises_with_the_sample_that_is_marked(board):
    volts = sine(60)
    with firmware_io.open_device(board.address) as device:
        device.mark(30, 7)
        device.write(volts)
        device.stop()
        (mark,) = device.marked()
        clock = clock_of(device)
    board.output_until(clock)
    # A pin takes its level at once, the DAC with the next clock: one later in the line's ring.
    assert board.line_changes() == [mark.clock_ticks + 1, mark.clock_ticks + 1 + HIGH]
    # The point of sample 30 is reached at the end of its line.
    n, output = OUTPUT_HZ // RATE_HZ, board.output()
    first = np.flatnonzero(output)[0] - np.flatnonzero(lines(volts))[0]
    assert mark.clock_ticks == first + 30 * n


def test_parsing_never_holds_the_output_up(board):
    """Between its samples the host floods the board: the timer goes before the parser."""
    volts = sine(60)
    with firmware_io.open_device(board.address) as device:
        for part in np.split(volts, 5):
            device.write(part)
            stream_of(device).client.send(*[Ping(9)] * 8)
        device.stop()
        clock = clock_of(device)
    expected = lines(volts)
    first = np.flatnonzero(expected)[0]
    found = played(board.output_until(clock))[: expected.size - first]
    np.testing.assert_array_equal(found, expected[first:])


def test_damaged_bytes_end_the_output_in_a_ramp(board):
    volts = 60 * np.clip(3 * np.sin(2 * np.pi * 25 * np.arange(60) / RATE_HZ), -1, 1)
    device = firmware_io.open_device(board.address)
    with pytest.raises(firmware_io.DeviceFaultError, match="damaged"), device:
        device.write(volts)
        stream_of(device).client.link.send(b"\x00" * 4)
        device.write(volts)
    output = board.output_until(board.output().size + 2 * WATCHDOG)
    top = np.flatnonzero(output)[-1]
    left = np.arange(RAMP - 1, 0, -1)
    ramp = output[top - left.size + 1 : top + 1]
    # PROTOCOL.md: a (R - k) / R, toward 0, of the code a that stood there; 2: both roundings.
    np.testing.assert_allclose(ramp, output[top - left.size] * left / RAMP, atol=2)


HOST = """
    import sys, time
    import numpy as np
    import firmware_io.protocol_client

    firmware_io.protocol_client.ANSWER_S = {patient_s}
    device = firmware_io.open_device(sys.argv[1])
    device.__enter__()
    volts = 100 * np.sin(2 * np.pi * 10 * np.arange(25) / {rate})
    for _ in range(3):
        device.write(volts)
    print(device._stream.client.synchronise().clock_ticks, flush=True)
    time.sleep(60)
"""


@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGSTOP])
def test_a_host_that_dies_leaves_0_v(board, how):
    program = textwrap.dedent(HOST).format(rate=RATE_HZ, patient_s=PATIENT_S)
    command = [sys.executable, "-c", program, board.address]
    host = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    try:
        clock = int(host.stdout.readline())
        host.send_signal(how)
        output = board.output_until(clock + 2 * WATCHDOG)
    finally:
        host.kill()
    assert np.abs(output[:clock]).max() > 0
    # The last STREAM came before `clock`: the output is at 0 V a watchdog's time after it.
    assert not output[clock + WATCHDOG :].any()


def test_a_second_host_is_told_that_the_port_is_taken(board):
    with (
        firmware_io.open_device(board.address),
        pytest.raises(firmware_io.DeviceBusyError, match="in use"),
    ):
        firmware_io.open_device(board.address)
