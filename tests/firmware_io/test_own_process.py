"""A link whose firmware and output are in a process of their own."""

import gc
import os
import signal
import subprocess
import sys
import textwrap
import weakref
from contextlib import suppress
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from firmware_io import (
    Device,
    DeviceBusyError,
    DeviceDisconnectedError,
    DeviceError,
    Playback,
    WaveSource,
)
from firmware_io.links.own_process import OwnProcessLink, ask_in_own_process
from tests.firmware_io.pretend_output import heard
from tests.waiting import wait_for

MODULE = "tests.firmware_io.pretend_output"
STEEPEST_V = 100.0 / 240 + 100.0 * 0.05 + 0.01  # of a ramp of 5 ms with the sine, and rounding
ROOT = Path(__file__).parents[2]


def sine(first, count):
    return 100.0 * np.sin(0.05 * np.arange(first, first + count))


@pytest.fixture
def opened(tmp_path, monkeypatch, no_thread_is_left):
    """A device, and the file of what it plays."""
    monkeypatch.setenv("PYTHONPATH", str(ROOT))

    def of(**values):
        link = OwnProcessLink(MODULE, {"file": str(tmp_path / "heard"), **values})
        return Device(link), link, tmp_path / "heard"

    return of


def test_what_is_played_there_is_what_was_sent(opened):
    device, link, file = opened(prints=True)
    assert device.name == f"pretend:{file}" and device.latency_s == 0.01
    with Playback(device, WaveSource(sine)) as playback:
        wait_for(lambda: playback.stats.samples_played > 24_000)
    device.close()
    link.close()
    volts = heard(file)
    first = np.flatnonzero(volts)[0]
    # The playback begins with the sample 0 V; half a code of 32767 at 200 V.
    np.testing.assert_allclose(volts[first : first + 9600], sine(1, 9600), atol=0.51 * 200 / 32767)
    assert volts[-1] == 0.0
    assert np.abs(np.diff(volts)).max() <= STEEPEST_V
    with pytest.raises(DeviceDisconnectedError, match="closed"):
        device.arm()


def test_an_error_there_is_the_same_here(opened):
    with pytest.raises(DeviceBusyError, match="another program plays"):
        opened(busy=True)
    with pytest.raises(DeviceError, match="no_such"):
        opened(no_such=1)


def test_an_output_that_stands_there_is_a_fault_here(opened):
    device, _, _ = opened(stands_after_s=0.5)
    playback = Playback(device, WaveSource(sine))
    playback.start()
    wait_for(lambda: not playback.is_running)
    with pytest.raises(DeviceDisconnectedError, match="asked for no samples"):
        playback.stop()
    with pytest.raises(DeviceDisconnectedError):
        device.close()


def test_a_process_that_is_killed_is_a_lost_link(opened):
    device, link, _ = opened()
    device.arm()
    os.kill(link._process.pid, signal.SIGKILL)
    link._process.wait()
    with pytest.raises(DeviceDisconnectedError, match="process has ended"):
        wait_for(lambda: device.write([0.0]))
    with pytest.raises(DeviceDisconnectedError):
        device.close()


def test_a_lost_device_is_freed(opened):
    device, link, _ = opened()
    os.kill(link._process.pid, signal.SIGKILL)
    link._process.wait()
    with pytest.raises(DeviceDisconnectedError):
        wait_for(partial(lambda one: one.progress(is_fresh=True) and None, device))
    with suppress(DeviceError):
        device.close()
    kept = weakref.ref(device)
    del device, link
    gc.collect()
    assert kept() is None


def test_a_process_that_aborts_at_its_begin_is_an_error(opened, monkeypatch):
    monkeypatch.setattr("firmware_io.links.own_process._START_S", 30.0)
    with pytest.raises(DeviceError):
        OwnProcessLink("tests.firmware_io.no_such_module", {})
    assert ask_in_own_process(MODULE, "tell") == [1, 2]
    with pytest.raises(DeviceError, match="ended with code 0"):
        ask_in_own_process(MODULE, "says_nothing")


@pytest.mark.slow
@pytest.mark.parametrize("way", [signal.SIGKILL, signal.SIGTERM, signal.SIGINT])
def test_a_program_that_dies_leaves_a_ramp(tmp_path, way):
    file = tmp_path / "heard"
    program = f"""
        import time
        from firmware_io import Device, Playback, WaveSource
        from firmware_io.links.own_process import OwnProcessLink
        from tests.firmware_io.test_own_process import sine
        device = Device(OwnProcessLink({MODULE!r}, {{"file": {str(file)!r}}}))
        with Playback(device, WaveSource(sine)):
            time.sleep(60)
    """
    process = subprocess.Popen(
        [sys.executable, "-c", textwrap.dedent(program)],
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )
    wait_for(lambda: file.exists() and np.abs(heard(file)).max(initial=0.0) > 90.0)
    if way == signal.SIGINT:  # as a terminal does, to the whole group
        os.killpg(process.pid, way)
    else:
        process.send_signal(way)
    process.wait()
    wait_for(lambda: not has_child(process.pid))
    volts = heard(file)
    assert volts[-1] == 0.0
    assert np.abs(np.diff(volts)).max() <= STEEPEST_V


def has_child(group):
    """Whether a process of the group is alive."""
    try:
        os.killpg(group, 0)
    except ProcessLookupError:
        return False
    return True
