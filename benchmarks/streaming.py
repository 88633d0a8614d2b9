"""Streaming in real time against the mock driver, with stalls injected; see --help.

Plays a known signal for a minute, with stalls of 10 ms in the sample source and in the link,
and compares every sample that the driver took with what was sent. Playback and wire alone:
reaction.py has the renderer.
"""

from __future__ import annotations

import argparse
import gc
import json
import sys
import time

import numpy as np

from firmware_io import (
    Device,
    HaptixError,
    MockDriver,
    MockLink,
    Playback,
    WaveSource,
    open_device,
    volts_to_codes,
)
from firmware_io.firmware.core import Output
from firmware_io.protocol import REPORT_BYTES

STALL_S = 0.010
STALL_EVERY_S = (0.5, 0.7)  # in the link, and in what makes the samples

CASES = {
    "48 kHz waveform, bytes": False,
    "16 kHz envelope, HID reports": True,
}


class StallingLink(MockLink):
    """A link whose next write waits, once it was told to."""

    waits_s = 0.0

    def stall(self) -> None:
        self.waits_s = STALL_S

    def send(self, data: bytes) -> None:
        waits_s, self.waits_s = self.waits_s, 0.0
        time.sleep(waits_s)
        super().send(data)


def play(reports: bool, seconds: float) -> dict[str, object]:
    driver = MockDriver(pace="real")
    link = StallingLink(driver, REPORT_BYTES if reports else None)
    device = Device(link)
    rate_hz = device.capabilities.sample_rate_hz
    next_stalls = [*STALL_EVERY_S]
    injected = 0

    def wave(first: int, count: int) -> np.ndarray:
        t = np.arange(first, first + count) / rate_hz
        if device.mode == "envelope":
            return 75.0 * (1.0 - np.cos(2 * np.pi * 100.0 * t))
        return 150.0 * np.sin(2 * np.pi * 1000.0 * t)

    def stalling(first: int, count: int) -> np.ndarray:
        nonlocal injected
        for place, stall in enumerate((link.stall, maker_stalls)):
            if first / rate_hz > next_stalls[place]:
                next_stalls[place] += STALL_EVERY_S[place]
                injected += 1
                stall()
        return wave(first, count)

    def maker_stalls() -> None:
        time.sleep(STALL_S)

    interval = sys.getswitchinterval()
    sys.setswitchinterval(5e-4)
    gc.collect()
    gc.freeze()
    cpu_s = time.process_time()
    began_s = time.monotonic()
    try:
        with Playback(device, WaveSource(stalling)) as playback:
            playback.run_until(began_s + seconds)
            playback.touch()  # raises what ended it
        stats = playback.stats
    finally:
        gc.unfreeze()
        sys.setswitchinterval(interval)
    cpu_s = time.process_time() - cpu_s
    wall_s = time.monotonic() - began_s
    return {
        "seconds": round(wall_s, 1),
        "stalls": injected,
        "samples": driver.status.samples_played,
        # After an underrun what follows is played later: no longer one by one.
        "lost samples": None if stats.underruns else lost(driver, device, wave),
        "underruns": stats.underruns,
        "driver underruns": driver.underruns,
        "driver faults": driver.faults,
        "longest stall ms": round(1e3 * stats.longest_stall_s, 1),
        "bytes per s": round(device.bytes_sent / wall_s),
        "overhead": round(1 - 2 * device.samples_sent / driver.bytes_received, 3),
        "CPU share": round(cpu_s / wall_s, 3),
    }


def lost(driver, device, wave) -> int:
    """Samples that were not played as sent, compared one by one."""
    codes, what = driver.output
    streamed = codes[what == Output.STREAM]
    if device.mode == "waveform":
        expected = volts_to_codes(wave(0, streamed.size), device.capabilities.full_scale_v)
        return differing(streamed, expected)
    # The driver plays each amplitude as three samples of its carrier.
    ticks = round(driver.about.output_rate_hz / device.capabilities.sample_rate_hz)
    expected = played_at_once(wave(0, -(-streamed.size // ticks)))
    # One code is what the phase, a binary fraction of a turn, leaves open.
    return -(-differing(streamed, expected[: streamed.size], 1) // ticks)


def differing(played, expected, codes: int = 0) -> int:
    there = played[: expected.size].astype(int)
    return int((np.abs(there - expected[: there.size]) > codes).sum()) + expected.size - there.size


def played_at_once(volts):
    """What the driver makes of an envelope in virtual time."""
    device = open_device("mock:reports=yes")
    with device:
        device.write(volts)
    codes, what = device.mock.output
    return codes[what == Output.STREAM]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    rows = []
    for name, reports in CASES.items():
        try:
            row = play(reports, options.seconds)
        except HaptixError as error:  # a machine that stands still for a quarter of a second
            row = {"failed": str(error)}
        rows.append({"case": name, **row})
        if not options.json:
            print(name, *(f"{key} {value}" for key, value in row.items()), sep=", ", flush=True)
    if options.json:
        print(json.dumps(rows, indent=2))


if __name__ == "__main__":
    main()
