"""The thread of a playback, in real time: short, and nothing asserted of how fast it is."""

import gc
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from firmware_io import (
    DeviceDisconnectedError,
    DeviceError,
    LimitError,
    Playback,
    open_device,
    volts_to_codes,
)
from firmware_io.firmware.core import Output

BLOCK = 240
pytestmark = pytest.mark.usefixtures("no_thread_is_left", "steady_mock")
ROOT = Path(__file__).parents[2]


def sine(seconds):
    return 150.0 * np.sin(2 * np.pi * 1000.0 * np.arange(round(seconds * 48_000)) / 48_000)


def play(playback, volts):
    for start in range(0, volts.size, BLOCK):
        assert playback.wait_for_room(BLOCK, 10.0)
        playback.put(volts[start : start + BLOCK])


def test_samples_arrive_in_order():
    device = open_device("mock:pace=real")
    # It ends at rest, and is put at once: nothing that this thread has to do can come too late.
    volts = np.r_[sine(0.25), 0.0, 0.0]
    with Playback(device, 0.3) as playback:
        playback.put(volts)
    assert playback.stats.underruns == 0
    codes, what = device.mock.output
    codes = codes[what == Output.STREAM]
    wanted = volts_to_codes(volts, 250.0)[1:]
    first = np.flatnonzero(codes)[0]
    np.testing.assert_array_equal(codes[first : first + wanted.size], wanted)
    assert not device.is_armed


def test_the_error_of_the_thread_is_raised_in_put():
    device = open_device("mock:pace=real")
    playback = Playback(device)
    playback.start()
    with pytest.raises(LimitError):
        play(playback, np.full(48_000, 201.0))
    assert isinstance(playback.error, LimitError)
    playback.stop()
    time.sleep(0.01)
    assert device.mock.output[0][-1] == 0


def test_unplugging_is_raised_while_waiting():
    device = open_device("mock:pace=real")
    playback = Playback(device)
    playback.start()
    link: Any = device._stream.link
    link.inject("disconnect", after=10)
    with pytest.raises(DeviceDisconnectedError), playback:
        play(playback, sine(5.0))


def test_a_link_that_hangs_is_told(monkeypatch):
    device = open_device("mock:pace=real")
    monkeypatch.setattr("firmware_io.background._JOIN_S", 0.05)
    playback = Playback(device)
    playback.start()
    hang = threading.Event()
    monkeypatch.setattr(device._stream.link, "send", lambda data: hang.wait(5.0))
    time.sleep(0.02)
    with pytest.raises(DeviceError, match=r"did not return within 0\.05 s.*watchdog"):
        playback.stop()
    hang.set()
    playback._writer.thread.join()


def test_a_forgotten_playback_ends():
    device = open_device("mock:pace=real")
    playback = Playback(device)
    vars(playback)["itself"] = playback  # found by the garbage collector only
    playback.start()
    play(playback, sine(0.05))
    del playback
    gc.collect()
    # The collector may have come first in the playback's own thread, which then ends by itself.
    for _ in range(1000):
        if not device.is_armed:
            break
        time.sleep(0.01)
    assert not device.is_armed
    time.sleep(0.01)
    assert device.mock.output[0][-1] == 0


PROGRAM = """
import os, signal, sys, threading
import numpy as np
import firmware_io
from tests.steady_clock import steady_driver

class Loud(firmware_io.MockLink):
    def send(self, data):
        super().send(data)
        if data[3] == 5:
            print("STOP", flush=True)

device = firmware_io.Device(Loud(steady_driver()))
playback = firmware_io.Playback(device)
playback.start()
volts = 150 * np.sin(np.arange(48000) / 8)
for start in range(0, 48000, 240):
    playback.wait_for_room(240, 10.0)
    playback.put(volts[start : start + 240])
    if start == 4800:
        {end}
"""


@pytest.mark.parametrize(
    ("end", "code"),
    [
        ("break", 0),
        ("sys.exit(3)", 3),
        ("1 / 0", 1),
        ("os.kill(os.getpid(), signal.SIGTERM)", 143),
        ("os.kill(os.getpid(), signal.SIGINT)", -signal.SIGINT),
        ("del playback, device; break", 0),
        ("threading.Thread(target=playback.stop).start(); break", 0),
    ],
)
def test_however_a_program_ends(end, code):
    program = PROGRAM.format(end=end)
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, timeout=600
    )
    assert done.stdout == "STOP\n", done.stderr
    assert done.returncode == code, done.stderr


def test_somebody_elses_handler_is_left_alone():
    def handler(number, frame):
        pass

    before = signal.signal(signal.SIGTERM, handler)
    try:
        with Playback(open_device("mock:pace=real")):
            assert signal.getsignal(signal.SIGTERM) is handler
        assert signal.getsignal(signal.SIGTERM) is handler
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
        with Playback(open_device("mock:pace=real")):
            assert signal.getsignal(signal.SIGTERM) is not signal.SIG_DFL
        assert signal.getsignal(signal.SIGTERM) is signal.SIG_DFL
    finally:
        signal.signal(signal.SIGTERM, before)
