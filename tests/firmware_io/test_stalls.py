"""Each thread, process and link stalled in turn: the driver plays what the host believes it does.

In real time, on whatever machine: no stall is longer than the horizon, but the machine may add to
it. So what is compared ends where the driver had no samples, no time is asserted, and a driver in
this process counts a longer stall as 0.12 s: its watchdog waits for 0.16 s.
"""

import os
import signal
import subprocess
import sys
import threading
import time

import numpy as np
import pytest

from firmware_io import Device, Playback, volts_to_codes
from firmware_io.firmware.core import Output
from firmware_io.links.tcp import TcpLink
from tests.faulty_link import FaultyLink
from tests.firmware_io.test_playback import Levels
from tests.links import stream_of
from tests.steady_clock import SteadyClock, steady_driver
from tests.waiting import PATIENCE_S

SECONDS = 0.8


class StallingLevels(Levels):
    """Alternates, changes with every window, and stands still when it is told."""

    stall_s = 0.0

    def __init__(self, grid=4):
        self.grid = grid
        super().__init__()

    def window(self, first, count, at_s, is_revision):
        stall_s, self.stall_s = self.stall_s, 0.0
        time.sleep(stall_s)
        self.level = 1.0 + len(self.asked) % 40
        return super().window(first, count, at_s, is_revision)


def believed(device):
    """Collect what the host takes as played, sample by sample, from when the device is armed."""
    stream, gone = stream_of(device), []
    arm = stream.arm

    def arm_and_look(revisable=False):
        arm(revisable)
        drop = stream.provisional.queue.drop_before

        def drop_and_keep(index):
            gone.append(drop(index))
            return gone[-1]

        stream.provisional.queue.drop_before = drop_and_keep

    stream.arm = arm_and_look
    return gone


def play(device, source, disturb):
    """Play with touches, and disturb some times; return what the host believes was played."""
    gone = believed(device)
    with Playback(device, source) as playback:
        end_s = time.monotonic() + SECONDS
        turn = 0
        while time.monotonic() < end_s or playback.stats.revisions < 5:
            playback.touch()
            if turn % 12 == 6:
                disturb()
            turn += 1
            threading.Event().wait(0.01)
        stats = playback.stats
        count = len(gone)  # what stopping counts as played was not
    assert stats.revisions >= 5
    return np.concatenate(gone[:count])


def assert_as_believed(played, volts):
    codes = volts_to_codes(volts, 250.0)
    length = min(len(played), len(codes))
    assert length > 1000
    assert np.array_equal(played[:length], codes[:length])


@pytest.mark.parametrize("what", ["renderer", "link", "caller"])
@pytest.mark.usefixtures("no_thread_is_left")
def test_in_this_process(what):
    driver = steady_driver(clock=SteadyClock(0.12))
    link, source = FaultyLink(driver), StallingLevels()

    def disturb():
        if what == "renderer":
            source.stall_s = 0.1
        elif what == "link":
            link.inject("stall", 0, 0.02)
        else:
            time.sleep(0.1)

    volts = play(Device(link), source, disturb)
    codes, kinds = driver.output
    began = int((kinds == Output.STREAM).argmax())
    ends = np.flatnonzero(kinds[began:] != Output.STREAM)
    assert_as_believed(codes[began : began + int(ends[0])], volts)
    assert driver.faults == 0


@pytest.mark.usefixtures("no_thread_is_left")
def test_in_reports():
    driver = steady_driver(sample_rate_hz=8000.0, clock=SteadyClock(0.12))
    link, source = FaultyLink(driver, 64), StallingLevels(grid=1)
    device = Device(link, mode="waveform", sample_rate_hz=8000)
    volts = play(device, source, lambda: link.inject("stall", 0, 0.02))
    codes, kinds = driver.output
    began = int((kinds == Output.STREAM).argmax())
    ends = np.flatnonzero(kinds[began:] != Output.STREAM)
    assert_as_believed(codes[began : began + int(ends[0])], volts)
    assert driver.faults == 0


@pytest.mark.skipif(not hasattr(signal, "SIGSTOP"), reason="no SIGSTOP")
@pytest.mark.parametrize("what", ["process", "socket"])
def test_over_tcp(tmp_path, what):
    record = tmp_path / "record.npy"
    command = [sys.executable, "-m", "firmware_io.serve", "--port", "0", "--record", str(record)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            _, host, port = process.stdout.readline().strip().split(":")
            link, source = TcpLink(host, int(port)), StallingLevels()
            receive = link.receive

            def stalled(timeout_s=0.0):
                time.sleep(0.02)
                setattr(link, "receive", receive)  # noqa: B010
                return receive(timeout_s)

            def disturb():
                if what == "process":
                    os.kill(process.pid, signal.SIGSTOP)
                    time.sleep(0.05)
                    os.kill(process.pid, signal.SIGCONT)
                else:
                    setattr(link, "receive", stalled)  # noqa: B010

            device = Device(link)
            volts = play(device, source, disturb)
            underruns = stream_of(device).client.status.underruns
            device.close()
            process.terminate()
            process.wait(PATIENCE_S)
        finally:
            process.kill()
    out = np.load(record)
    began = int((out != 0.0).argmax())
    played = np.rint(out[began:] / 250.0 * 32767).astype(int)
    # Every sample of the source differs from the one before: where two are alike none was played.
    held = np.flatnonzero(played[1:] == played[:-1])
    end = int(held[0]) if underruns and len(held) else len(played)
    assert_as_believed(played[:end], volts)
