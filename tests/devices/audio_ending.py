"""Plays a loud sine through ``audio:`` and ends in the way it is told, at a crest if it can."""

import os
import signal
import sys
import time

import numpy as np

from firmware_io import Device, Playback, WaveSource
from firmware_io.opening import read_address

address, way = sys.argv[1:]
scheme, values = read_address(address)
link = scheme.open(**values)
device = Device(link)
rate_hz = device.capabilities.sample_rate_hz
# 173 V at 60 Hz: a step where it ends is far above the steps of the sine.
wave = WaveSource(
    lambda first, count: (
        173.0 * np.sin(2 * np.pi * 60.0 * np.arange(first, first + count) / rate_hz)
    )
)


def keep_playing(end):
    playback = Playback(device, wave)
    playback.start()
    # Until so much was played: a busy machine lets the samples run out now and then.
    while playback.stats.samples_played < 0.4 * rate_hz:
        playback.run_until(device.clock() + 0.1)
    end(playback)


def finish(playback):
    if way == "stop":
        playback.stop()
    if way == "close":
        device.close()
    if way == "link":
        link.close()
        os._exit(0)
    if way == "error":
        raise RuntimeError("as asked")
    if way == "exit":
        sys.exit(0)
    if way == "SIGTERM":
        os.kill(os.getpid(), signal.SIGTERM)
        time.sleep(1.0)
    if way == "SIGKILL":
        os.kill(os.getpid(), signal.SIGKILL)
    sys.exit(0)


keep_playing(finish)
