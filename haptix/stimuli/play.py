"""Render one stimulus into one file, and check and count its samples."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from math import inf, sqrt
from pathlib import Path

import numpy as np

from firmware_io.limits import DriveLimits, DriveWindow
from haptix.errors import LimitError
from haptix.stimuli.audio import AudioWriter, Container, Encoding
from haptix.stimuli.rendering import Block, Rendering
from haptix.stimuli.trigger import Trigger
from haptix.surface import Column

Progress = Callable[[float], None]


@dataclass
class Tally:
    """Extremes and counts of a rendered stimulus, gathered block by block."""

    samples: int = 0
    peak_v: float = 0.0
    square_sum: float = 0.0
    lowest_amplitude_v: float = inf
    highest_amplitude_v: float = 0.0
    target_low: float = inf
    target_high: float = -inf
    below: int = 0
    above: int = 0
    past_the_surface: int = 0
    """Samples of a drive in volts beyond the end of the surface."""
    limits: list[str] = field(default_factory=list)

    def take(self, block: Block, response: Column) -> None:
        """Add a block."""
        drive, amplitude = block.drive_v, block.amplitude_v
        self.samples += len(drive)
        self.peak_v = max(self.peak_v, float(drive.max()), -float(drive.min()))
        # Not np.dot: its last bit depends on the threads of the algebra library.
        self.square_sum += float(np.sum(drive * drive))
        low, high = float(amplitude.min()), float(amplitude.max())
        self.lowest_amplitude_v = min(self.lowest_amplitude_v, low)
        self.highest_amplitude_v = max(self.highest_amplitude_v, high)
        if block.target_low == block.target_low:  # not NaN
            self.target_low = min(self.target_low, block.target_low)
            self.target_high = max(self.target_high, block.target_high)
        elif high > response.end_v:
            self.past_the_surface += int(np.count_nonzero(amplitude > response.end_v))
        self.below += block.below
        self.above += block.above

    @property
    def rms_v(self) -> float:
        """Root mean square of the drive [V]."""
        return sqrt(self.square_sum / max(self.samples, 1))

    @property
    def is_reached(self) -> bool:
        """Whether all friction asked for is reachable."""
        return self.below == 0 and self.above == 0


def write_drive(
    path: Path,
    rendering: Rendering,
    limits: DriveLimits,
    container: Container,
    encoding: Encoding,
    full_scale_v: float,
    trigger: Trigger | None,
    threads: int,
    on_progress: Progress = lambda share: None,
) -> Tally:
    """Render into a file, and check every sample against the limits.

    Returns
    -------
    Tally
        With the first limit that was broken, if any, in `limits`; the file then ends there.

    Raises
    ------
    OSError
        If the file cannot be written.
    """
    rate = rendering.sample_rate_hz
    tally, window = Tally(), DriveWindow(limits, rate)
    previous, total = 0.0, rendering.samples
    with AudioWriter(
        path, container, encoding, rate, full_scale_v, total, trigger is not None
    ) as file:
        for block in rendering.stream(threads):
            drive = block.drive_v
            last = block.first + len(drive) == total
            try:
                limits.check(drive, previous, rate)
                window.check(drive)
                if last:  # past the end the output is at 0 V
                    limits.check(np.zeros(1), float(drive[-1]), rate)
            except LimitError as error:
                second = block.first / rate
                tally.limits.append(
                    f"within {len(drive) / rate:.3g} s from {second:.3f} s: {error}"
                )
                break
            window.take(drive)
            tally.take(block, rendering.response)
            file.write(drive, None if trigger is None else trigger.values(block.first, len(drive)))
            previous = float(drive[-1])
            on_progress((block.first + len(drive)) / total)
    return tally
