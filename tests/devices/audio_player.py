"""Plays a known wave through ``audio:`` in real time; tells what happened as JSON."""

import json
import os
import sys
import time
from contextlib import suppress
from typing import Any

import numpy as np

from firmware_io import Device, Playback, WaveSource
from firmware_io.links.audio import AudioLink, open_here
from firmware_io.opening import read_address

# Ahead of every ordinary program on a busy machine; JACK's own thread waits for this one's lock.
with suppress(PermissionError):
    os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(10))

address, seconds, path = sys.argv[1], float(sys.argv[2]), sys.argv[3]

times, frames = [], []
fill: Any = AudioLink._fill


def timed(self, out, count, *rest):
    times.append(time.monotonic())
    frames.append(count)
    fill(self, out, count, *rest)


AudioLink._fill = timed  # type: ignore[method-assign]
sys.setswitchinterval(5e-4)
link: Any = open_here(**read_address(address)[1])  # where its blocks can be timed
device = Device(link)
rate_hz = device.capabilities.sample_rate_hz
rng = np.random.default_rng(7)
# Every code is heard, and no two stretches are alike: noise, kept from slewing too fast, on a tone.
t = np.arange(round(seconds * rate_hz)) / rate_hz
volts = 120.0 * np.sin(2 * np.pi * 1000.0 * t) + rng.uniform(-20.0, 20.0, t.size)
volts[0], volts[-1] = 5.0, 5.0
behind = np.zeros(round(rate_hz))  # until it is stopped


def sent(first, count):
    return np.concatenate([volts[first : first + count], behind])[:count]


with Playback(device, WaveSource(sent)) as playback:
    playback.run_until(device.clock() + seconds + 0.5)
stats = playback.stats
latency_s, underflows = device.latency_s, link.underflows
device.close()
np.save(path, volts)
ideal_s = np.r_[0, np.cumsum(frames[:-1])] / rate_hz
late_s = np.array(times) - ideal_s
late_s -= np.median(late_s)
sys.stdout.write(
    json.dumps(
        {
            "underruns": stats.underruns,
            "underflows": underflows,
            "latency_s": latency_s,
            "callbacks": len(times),
            "late_p99_s": float(np.percentile(late_s, 99)),
            "late_max_s": float(late_s.max()),
            "slip_s": float(np.ptp(late_s)),
        }
    )
)
