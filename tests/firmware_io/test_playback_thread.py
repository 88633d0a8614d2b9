"""The thread of a playback, in real time: short, and nothing asserted of how fast it is."""

import gc
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest

from firmware_io import (
    Device,
    DeviceDisconnectedError,
    DeviceError,
    LimitError,
    Playback,
    WaveSource,
    open_device,
    volts_to_codes,
)
from firmware_io.firmware.core import Output
from tests.faulty_link import FaultyLink
from tests.links import stream_of
from tests.steady_clock import steady_driver
from tests.waiting import PATIENCE_S, wait_for

pytestmark = pytest.mark.usefixtures("no_thread_is_left", "steady_mock")
ROOT = Path(__file__).parents[2]


def tone(amplitude_v=150.0):
    """A sine of 1 kHz, as a source."""
    return WaveSource(
        lambda first, count: (
            amplitude_v * np.sin(2 * np.pi * 1000.0 * np.arange(first, first + count) / 48_000)
        )
    )


def started(source):
    device = open_device("mock:pace=real")
    playback = Playback(device, source)
    playback.start()
    return device, playback


def test_samples_arrive_in_order():
    device, playback = started(tone())
    with playback:
        wait_for(lambda: playback.stats.samples_played > 24_000)
    codes, what = device.mock.output
    codes = codes[what == Output.STREAM]
    wanted = volts_to_codes(tone().window(0, codes.size, 0.0, False), 250.0)
    if not playback.stats.underruns:  # of a busy machine: what follows is played later
        np.testing.assert_array_equal(codes, wanted)
    assert codes.size
    assert not device.is_armed


def test_the_error_of_the_thread_is_raised_once():
    device, playback = started(tone(201.0))
    wait_for(lambda: not playback.is_running)
    assert isinstance(playback.error, LimitError)
    with pytest.raises(LimitError):
        playback.touch()
    playback.stop()
    time.sleep(0.01)
    assert device.mock.output[0][-1] == 0


def test_unplugging_is_raised_at_the_end():
    link = FaultyLink(steady_driver())
    link.inject("disconnect", after=10)
    playback = Playback(Device(link), tone())
    playback.start()
    with pytest.raises(DeviceDisconnectedError), playback:
        wait_for(lambda: not playback.is_running)


def test_a_link_that_hangs_is_told(monkeypatch):
    device, playback = started(tone())
    monkeypatch.setattr("firmware_io.playback.JOIN_S", 0.05)
    hangs, hang = threading.Event(), threading.Event()

    def send(data):
        hangs.set()
        hang.wait(PATIENCE_S)

    monkeypatch.setattr(stream_of(device).link, "send", send)
    wait_for(hangs.is_set)
    with pytest.raises(DeviceError, match=r"0\.05 s.*watchdog"):
        playback.stop()
    hang.set()
    playback.writer.thread.join()


def test_a_forgotten_playback_ends():
    device, playback = started(tone())
    vars(playback)["itself"] = playback  # found by the garbage collector only
    stats = playback.stats
    wait_for(lambda: stats.samples_played > 2400)
    del playback
    gc.collect()
    # The collector may have come first in the playback's own thread, which then ends by itself.
    wait_for(lambda: not device.is_armed)
    time.sleep(0.01)
    assert device.mock.output[0][-1] == 0


PROGRAM = """
import os, signal, sys, threading, time
import numpy as np
import firmware_io
from tests.steady_clock import steady_driver

class Loud(firmware_io.MockLink):
    def send(self, data):
        super().send(data)
        if data[3] == 5:
            print("STOP", flush=True)

device = firmware_io.Device(Loud(steady_driver()))
tone = firmware_io.WaveSource(lambda first, n: 150 * np.sin(np.arange(first, first + n) / 8))
playback = firmware_io.Playback(device, tone)
playback.start()
while playback.stats.samples_played < 12000:
    time.sleep(0.01)
{end}
"""


@pytest.mark.parametrize(
    ("end", "code"),
    [
        ("pass", 0),
        ("sys.exit(3)", 3),
        ("1 / 0", 1),
        ("os.kill(os.getpid(), signal.SIGTERM)", 143),
        ("os.kill(os.getpid(), signal.SIGINT)", -signal.SIGINT),
        ("del playback, device", 0),
        ("threading.Thread(target=playback.stop).start()", 0),
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
        with Playback(open_device("mock:pace=real"), tone()):
            assert signal.getsignal(signal.SIGTERM) is handler
        assert signal.getsignal(signal.SIGTERM) is handler
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
        with Playback(open_device("mock:pace=real"), tone()):
            assert signal.getsignal(signal.SIGTERM) is not signal.SIG_DFL
        assert signal.getsignal(signal.SIGTERM) is signal.SIG_DFL
    finally:
        signal.signal(signal.SIGTERM, before)
