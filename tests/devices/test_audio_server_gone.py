"""JACK's server goes away and comes back under a program that goes on: `make test-devices`."""

import os
import subprocess
import time
from contextlib import suppress
from functools import partial

import numpy as np
import pytest

from firmware_io import (
    DeviceDisconnectedError,
    DeviceError,
    DeviceNotFoundError,
    Playback,
    WaveSource,
    list_devices,
    open_device,
)
from tests.devices.jack_session import missing
from tests.waiting import wait_for

pytestmark = pytest.mark.devices

ADDRESS = "audio:device=system,host_api=jack,full_scale_v=200"
PERIOD, RATE_HZ = 256, 48_000


@pytest.fixture
def server(monkeypatch):
    """Start a server of this test's own; all are ended with it."""
    if missing():
        pytest.skip(f"missing: {missing()}")
    # Always the same name: JACK knows eight, and one of a server that was killed stays taken until
    # another server takes it.
    name, servers = "haptixgone", []
    monkeypatch.setenv("JACK_DEFAULT_SERVER", name)
    monkeypatch.setenv("JACK_NO_AUDIO_RESERVATION", "1")
    command = ["jackd", "--no-realtime", "-S", "-n", name, "-d", "dummy", "-r", str(RATE_HZ)]
    command += ["-p", str(PERIOD), "-C", "0", "-P", "2"]

    def start():
        quiet = subprocess.DEVNULL
        servers.append(subprocess.Popen(command, stdout=quiet, stderr=quiet))
        wait_for(is_there)
        return servers[-1]

    def is_there():
        assert servers[-1].poll() is None, f"jackd ended: is one named {name} running?"
        return "audio" in {device.kind for device in list_devices()}

    yield start
    for each in servers:
        each.kill()
        each.wait()


def tone(first, count):
    return 100.0 * np.sin(0.1 * np.arange(first, first + count))


def has_played(playback):
    return playback.stats.samples_played > RATE_HZ / 2 or not playback.is_running


def playing(device):
    """Play half a second; again where this machine stood still, which is a fault, too."""
    while True:
        playback = Playback(device, WaveSource(tone))
        with suppress(DeviceError):
            playback.start()
            wait_for(partial(has_played, playback))
            if playback.is_running:
                return device, playback
            playback.stop()
        with suppress(DeviceError):
            device.close()
        device = open_device(ADDRESS)


def test_the_server_goes_and_comes_back_twice(server):
    list_devices()  # libraries of other buses keep files open
    files = len(os.listdir("/proc/self/fd"))  # noqa: PTH208
    for way in ("terminate", "kill"):
        with pytest.raises(DeviceNotFoundError, match="connected: none"):
            open_device(ADDRESS)
        running = server()
        device = open_device(ADDRESS)
        # In synchronous mode what is handed over is played after one period.
        assert device.latency_s == pytest.approx(PERIOD / RATE_HZ, rel=1e-3)
        device, playback = playing(device)
        getattr(running, way)()
        running.wait()
        gone_s = time.monotonic()
        while playback.is_running:
            time.sleep(0.002)
        # A deadline of safety: 0.16 s, and what a busy machine adds.
        assert time.monotonic() - gone_s < 0.16 + 0.25
        with pytest.raises(DeviceDisconnectedError):
            playback.stop()
        began_s = time.monotonic()
        with pytest.raises(DeviceDisconnectedError):
            device.close()
        assert time.monotonic() - began_s < 60.0  # PortAudio itself waits ten minutes
        assert len(os.listdir("/proc/self/fd")) <= files  # noqa: PTH208


def test_the_refusal_names_the_servers_rate(server):
    server()
    with pytest.raises(DeviceError, match=f"rates are {RATE_HZ}:"):
        open_device(f"{ADDRESS},sample_rate_hz=44100")
