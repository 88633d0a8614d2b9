"""How long the output takes to 0 V after each fault, by the driver's own record.

    python benchmarks/time_to_zero.py

The firmware plays a sine of 150 Hz and 150 V at 48 kHz with a watchdog of 160 ms. A fault comes at
100 moments of the playback; from then on the record tells when the output is at 0 V for good.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from firmware_io import MockDriver
from firmware_io.firmware.core import Core
from firmware_io.protocol import (
    Arm,
    Frame,
    Hello,
    Setup,
    Stop,
    StreamMode,
    StreamSamples,
    encode,
)

RATE = 48_000
AHEAD = 960
SETUP = Setup(
    mode=StreamMode.WAVEFORM,
    watchdog_ms=160,
    sample_rate_hz=RATE,
    full_scale_mv=250_000,
    ceiling_mv=200_000,
    max_slew_v_per_s=4_666_666,
    carrier_mhz=0,
    lead_us=0,
    status_ms=0,
)


class Host:
    """A core that plays, and what was said to it."""

    def __init__(self) -> None:
        about = MockDriver(sample_rate_hz=RATE).about
        self.core = Core(replace(about, max_frame_samples=2048))
        self.sequence = self.index = 0
        for message in (Hello(), SETUP, Arm()):
            self.say(message)

    def say(self, message: object, spoil: Callable[[bytes], bytes] = bytes) -> None:
        """Send a frame, perhaps spoiled."""
        self.core.receive(spoil(encode(Frame(message, self.sequence))))
        self.sequence += 1

    def stream(self, volts: np.ndarray, spoil: Callable[[bytes], bytes] = bytes) -> None:
        """Send samples."""
        codes = np.round(volts / 250 * 32767).astype(np.int16)
        self.say(StreamSamples(self.index, codes, StreamMode.WAVEFORM), spoil)
        self.index += codes.size

    def sine(self, count: int = 48) -> np.ndarray:
        """Return the next volts of the sine."""
        return 150 * np.sin(2 * np.pi * 150 * (self.index + np.arange(count)) / RATE)

    def begin(self, played: int) -> None:
        """Play so many samples, with 20 ms queued."""
        self.stream(self.sine(AHEAD))
        for _ in range(played // 48):
            self.stream(self.sine())
            self.core.play(48)
        self.core.play(played % 48)


def lost_byte(host: Host) -> None:
    host.stream(host.sine(), lambda frame: frame[:40] + frame[41:])
    host.stream(host.sine())


def skipped(host: Host) -> None:
    host.sequence += 1
    host.stream(host.sine())


def overfills(host: Host) -> None:
    while not host.core.fault():
        host.stream(host.sine(2000))


def lost_memory(host: Host) -> None:
    host.core._memory[20] ^= 1 << 40


def drains(host: Host) -> None:
    """Leave the queue to run out; counted from its last sample."""
    host.core.play(AHEAD)


def leans(host: Host) -> int:
    """Stream a level until the mean ends it; counted from the sample that would have broken it."""
    return fills(host, np.linspace(host.sine(1)[0], 150, 48), np.full(48, 150.0))


def roars(host: Host) -> int:
    """As above, for the energy: a square wave between 200 V and -200 V."""
    wave = np.repeat([1, -1], 48) * 200.0
    wave[[0, 48]] = 0.0, 0.0
    wave[[47, 95]] = 103.0, -103.0
    wave[[1, 49]] = 97.0, -97.0
    return fills(host, np.linspace(host.sine(1)[0], 0, 48), wave)


def fills(host: Host, first: np.ndarray, wave: np.ndarray) -> int:
    codes = [host.core.play(AHEAD)[0]]
    host.stream(first)
    while not host.core.fault():
        host.stream(wave)
        codes.append(host.core.play(wave.size)[0])
    assert host.core.fault() is not None
    return int(host.core.fault().clock_ticks)


FAULTS: dict[str, Callable[[Host], int | None]] = {
    "the host falls silent, 20 ms queued": lambda host: None,
    "the host goes away": lambda host: host.core.release(),
    "STOP": lambda host: host.say(Stop()),
    "a byte is damaged": lambda host: host.stream(
        host.sine(), lambda frame: frame[:40] + bytes([frame[40] ^ 4]) + frame[41:]
    ),
    "a byte is lost, noticed by the next frame": lost_byte,
    "a frame is lost": skipped,
    "a sample above the ceiling": lambda host: host.stream(np.full(1, 201.0)),
    "a step above the slew": lambda host: host.stream(np.array([75.0, -75.0])),
    "more than the queue has room for": overfills,
    "the samples run out": drains,
    "the mean": leans,
    "the energy": roars,
    "a bit of the memory flips": lost_memory,
}


def times() -> dict[str, list[float]]:
    """Times to 0 V [ms], by fault."""
    found: dict[str, list[float]] = {}
    for name, fault in FAULTS.items():
        times_ms = []
        for moment in range(100):
            host = Host()
            host.begin(480 + 7 * moment)
            began = fault(host)
            now = int(host.core.status().clock_ticks)
            codes = host.core.play(RATE)[0]
            last = int(np.flatnonzero(codes)[-1]) + 2 if codes.any() else 0
            times_ms.append((last + (now - began if began else 0)) / RATE * 1e3)
        found[name] = times_ms
    return found


def main() -> None:
    print(f"{'fault':44}{'median ms':>10}{'longest ms':>12}")
    for name, times_ms in times().items():
        print(f"{name:44}{np.median(times_ms):10.2f}{max(times_ms):12.2f}")


if __name__ == "__main__":
    main()
