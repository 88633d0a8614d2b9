"""Streaming in real time against the mock driver, with stalls injected; see --help.

Plays a known signal for a minute, with stalls of 10 ms in the sample source and in the link,
and compares every sample that the driver took with what was sent. Playback and wire alone:
reaction.py has the renderer, and streams that are revised.
"""

from __future__ import annotations

import argparse
import gc
import json
import sys
import time
from typing import cast

import numpy as np

from firmware_io import HaptixError, MockLink, Playback, open_device, volts_to_codes
from firmware_io.firmware.core import Output

STALL_S = 0.010
STALL_EVERY_S = (0.5, 0.7)  # in the link, and in what makes the samples

# Address, samples in a block, and the second lead [s]: about three blocks.
CASES = {
    "48 kHz waveform, bytes": ("mock:pace=real", 48, 0.005),
    "16 kHz envelope, HID reports": ("mock:pace=real,reports=yes", 83, 0.016),
}


def play(
    address: str, block: int, lead_s: float, seconds: float, stalls: bool
) -> dict[str, object]:
    device = open_device(address)
    driver, link = device.mock, cast(MockLink, device._stream.link)
    rate_hz = device.capabilities.sample_rate_hz
    t = np.arange(round(seconds * rate_hz) // block * block) / rate_hz
    if device.mode == "envelope":
        volts = 75.0 * (1.0 - np.cos(2 * np.pi * 100.0 * t))
    else:
        volts = 150.0 * np.sin(2 * np.pi * 1000.0 * t)
    next_stalls = [STALL_EVERY_S[0], STALL_EVERY_S[1]]
    injected = 0
    interval = sys.getswitchinterval()
    sys.setswitchinterval(5e-4)
    gc.collect()
    gc.freeze()
    cpu_s = time.process_time()
    began_s = time.monotonic()
    try:
        with Playback(device, lead_s) as playback:
            for start in range(0, volts.size, block):
                played_s = start / rate_hz
                if stalls and played_s > next_stalls[0]:
                    link.inject("stall", 0, STALL_S)
                    next_stalls[0] += STALL_EVERY_S[0]
                    injected += 1
                if stalls and played_s > next_stalls[1]:
                    time.sleep(STALL_S)
                    next_stalls[1] += STALL_EVERY_S[1]
                    injected += 1
                if not playback.wait_for_room(block, 5.0):
                    raise TimeoutError
                playback.put(volts[start : start + block])
            stats = playback.stats
    finally:
        gc.unfreeze()
        sys.setswitchinterval(interval)
    cpu_s = time.process_time() - cpu_s
    wall_s = time.monotonic() - began_s
    return {
        "lead ms": lead_s * 1e3,
        "seconds": round(wall_s, 1),
        "stalls": injected,
        "samples": int(volts.size),
        # After an underrun what follows is played later and faded in: no longer one by one.
        "lost samples": None if stats.underruns else lost(driver, device, volts),
        "underruns": stats.underruns,
        "late blocks": stats.late_blocks,
        "driver underruns": driver.underruns,
        "driver faults": driver.faults,
        "drift ppm": None if stats.drift_ppm is None else round(stats.drift_ppm, 1),
        "bytes per s": round(device.bytes_sent / wall_s),
        "overhead": round(1 - 2 * device.samples_sent / driver.bytes_received, 3),
        "CPU share": round(cpu_s / wall_s, 3),
    }


def lost(driver, device, volts) -> int:
    """Samples that were not played as sent, compared one by one."""
    codes, what = driver.output
    streamed = codes[what == Output.STREAM]
    first = int(np.flatnonzero(streamed)[0])
    if device.mode == "waveform":
        expected = volts_to_codes(volts, device.capabilities.full_scale_v)
        return differing(streamed[first - int(np.flatnonzero(expected)[0]) :], expected)
    # The driver plays each amplitude as three samples of its carrier, twelve to a period: which of
    # them the envelope begins on depends on the silence before, so there are four references.
    ticks = round(driver.about.output_rate_hz / device.capabilities.sample_rate_hz)
    best = volts.size
    for begins in range(first // ticks - 3, first // ticks + 2):
        expected = played_at_once(np.r_[np.zeros(begins % 4), volts])[begins % 4 * ticks :]
        # One code is what the phase, a binary fraction of a turn, leaves open after a long silence.
        found = differing(streamed[begins * ticks :], expected[: volts.size * ticks], 1)
        best = min(best, -(-found // ticks))
    return best


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
    parser.add_argument("--lead-ms", type=float, help="this lead only, instead of two of each")
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    rows = []
    for name, (address, block, shortest_s) in CASES.items():
        for lead_s in (0.025, shortest_s) if options.lead_ms is None else (options.lead_ms / 1e3,):
            try:
                row = play(address, block, lead_s, options.seconds, stalls=True)
            except HaptixError as error:  # a machine that stands still for a quarter of a second
                row = {"lead ms": lead_s * 1e3, "failed": str(error)}
            rows.append({"case": name, **row})
            if not options.json:
                print(name, *(f"{key} {value}" for key, value in row.items()), sep=", ", flush=True)
    if options.json:
        print(json.dumps(rows, indent=2))


if __name__ == "__main__":
    main()
