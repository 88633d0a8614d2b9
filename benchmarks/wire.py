"""The wire: speed of the codec and of both device cores, and what HID costs.

    python benchmarks/wire.py

Prints a table. Frames are encoded and decoded one by one, as a host and a device do it.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np

from firmware_io import MockDriver
from firmware_io.firmware.core import Core
from firmware_io.protocol import (
    Arm,
    Frame,
    FrameParser,
    Hello,
    Setup,
    StreamMode,
    StreamSamples,
    decode,
    encode,
    samples_per_frame,
    to_reports,
)

#: Samples in a frame: HID (three reports), the mock's longest, the format's longest.
FRAME_SAMPLES = {"3 HID reports": 83, "1024 samples": 1024, "32765 samples": 32765}


def seconds(work: Callable[[], object], rounds: int = 5) -> float:
    """Return the time of the fastest of several rounds."""
    best = float("inf")
    for _ in range(rounds):
        begin = time.perf_counter()
        work()
        best = min(best, time.perf_counter() - begin)
    return best


def some_frames(samples: int, megabytes: float = 4.0) -> list[Frame]:
    rng = np.random.default_rng(0)
    count = max(1, int(megabytes * 1e6 / (2 * samples)))
    codes = [rng.integers(-26213, 26213, samples).astype(np.int16) for _ in range(8)]
    return [Frame(StreamSamples(k * samples, codes[k % 8]), k % 2**16) for k in range(count)]


def codec(samples: int) -> tuple[float, float, float]:
    """Return MB/s of frame bytes: encoded, encoded and decoded, parsed from 64 KiB reads."""
    frames = some_frames(samples)
    wire = [encode(frame) for frame in frames]
    stream = b"".join(wire)
    size = len(stream)

    def parse() -> None:
        parser = FrameParser()
        found = 0
        for start in range(0, size, 65536):
            found += len(parser.feed(stream[start : start + 65536]))
        assert found == len(frames)

    return (
        size / 1e6 / seconds(lambda: [encode(frame) for frame in frames]),
        size / 1e6 / seconds(lambda: [decode(encode(frame)) for frame in frames]),
        size / 1e6 / seconds(parse),
    )


def core_speed(mode: StreamMode) -> float:
    """Return output samples per second, receiving included, over the 48 kHz of real time."""
    about = MockDriver().about
    core = Core(about)
    is_envelope = mode is StreamMode.ENVELOPE
    rate = 16_000 if is_envelope else 48_000
    setup = Setup(
        mode,
        250,
        rate,
        about.full_scale_mv,
        about.ceiling_mv,
        about.max_slew_v_per_s,
        carrier_mhz=4_000_000 if is_envelope else 0,
        lead_us=0,
    )
    for k, message in enumerate((Hello(), setup, Arm())):
        core.receive(encode(Frame(message, k)))
    block = rate // 200  # 5 ms
    codes = np.full(block, 13107, np.int16)
    frames = [encode(Frame(StreamSamples(k * block, codes, mode), 3 + k)) for k in range(400)]

    begin = time.perf_counter()
    for frame in frames:
        core.receive(frame)
        core.play(240)
    passed = time.perf_counter() - begin
    assert core.status().samples_played == 400 * block
    return 2.0 / passed


def main() -> None:
    print(f"{'codec':24}{'encode':>12}{'+ decode':>12}{'parse':>12}   MB/s of frames")
    for name, samples in FRAME_SAMPLES.items():
        print(f"{name:24}" + "".join(f"{rate:12.0f}" for rate in codec(samples)))
    print()
    print(f"{'HID, 16 kHz':24}{'samples':>12}{'ms':>12}{'overhead':>12}{'reports/s':>12}")
    for reports in (2, 3, 4, 6):
        samples = samples_per_frame(reports)
        frame = encode(Frame(StreamSamples(0, np.zeros(samples, np.int16)), 0))
        sent = sum(map(len, to_reports(frame)))
        print(
            f"{reports} reports a frame{'':8}{samples:12}{samples / 16:12.1f}"
            f"{100 * (1 - 2 * samples / sent):11.1f}%{reports * 16_000 / samples:12.0f}"
        )
    print()
    print(f"{'device core':24}{'waveform':>12}{'envelope':>12}   times real time at 48 kHz")
    print(" " * 24 + "".join(f"{core_speed(mode):12.0f}" for mode in StreamMode))


if __name__ == "__main__":
    main()
