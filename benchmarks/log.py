"""What the log costs a stream: off, at `info`, and with all frames in a file.

    python benchmarks/log.py [ROUNDS]

A stream of 2 s, touched each 10 ms and revised, plays on a mock in its own time; so all that is
measured is work. The four ways take turns. "without" has loggers that do nothing in place of
those that are off.
"""

import statistics
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from firmware_io import (
    Playback,
    device,
    host_stream,
    open_device,
    playback,
    protocol_client,
    reviser,
)
from firmware_io.playback import WaveSource
from haptix.base import log

ROOMS: tuple[Any, ...] = (device, host_stream, playback, protocol_client, reviser)
STREAM_S, TOUCH_S = 2.0, 0.01


class Nobody:
    """A logger of no work: what is called are functions of C."""

    isEnabledFor = staticmethod({}.get)
    info = debug = staticmethod(lambda *_: None)


class Tone(WaveSource):
    """A tone that says it may differ each time, so that it is revised."""

    is_live = True


def play() -> float:
    """Play the stream; return the processor's time that it takes [s]."""
    driver = open_device("mock:pace=stepped")
    tone = Tone(lambda first, count: 50.0 * np.sin(0.01 * np.arange(first, first + count)))
    began_s = time.thread_time()
    with Playback(driver, tone) as playing:
        for _ in range(round(STREAM_S / TOUCH_S)):
            playing.touch()
            playing.run_until(driver.clock() + TOUCH_S)
    took_s = time.thread_time() - began_s
    driver.close()
    return took_s


def without() -> float:
    """Play with loggers of no work."""
    loggers = [room._LOG for room in ROOMS]
    for room in ROOMS:
        room._LOG = Nobody()
    try:
        return play()
    finally:
        for room, logger in zip(ROOMS, loggers, strict=True):
            room._LOG = logger


def main(rounds: int = 15) -> None:
    with tempfile.TemporaryDirectory() as folder:

        def logged(level: str) -> float:
            log.start(level, Path(folder) / "a.log")
            try:
                return play()
            finally:
                log.stop()

        ways: dict[str, Callable[[], float]] = {
            "without": without,
            "off": play,
            "info": lambda: logged("info"),
            "debug": lambda: logged("debug"),
        }
        took_s: dict[str, list[float]] = {name: [] for name in ways}
        for number in range(rounds + 1):
            for name, way in ways.items():
                found_s = way()
                if number:  # the first round loads
                    took_s[name].append(found_s)
    print(f"{rounds} rounds in turns; processor's time of the stream's thread, per second of it")
    for name, times in took_s.items():
        ratios = [own / base for own, base in zip(times, took_s["without"], strict=True)]
        print(
            f"{name:8}{statistics.median(times) / STREAM_S * 1e3:7.2f} ms"
            f"  times without: median {statistics.median(ratios):.3f},"
            f" quartiles {np.percentile(ratios, 25):.3f} to {np.percentile(ratios, 75):.3f}"
        )


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
