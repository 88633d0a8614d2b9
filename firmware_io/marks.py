"""Samples that a driver tells of: by a digital line, and by its clock."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

from firmware_io.output_clock import OutputClock
from firmware_io.protocol import NEVER, MarkedReport

MOST_MARKS = 8
"""That wait in a driver, or to be read."""


@dataclass(frozen=True)
class Marked:
    """A sample that was marked and has been played.

    Attributes
    ----------
    sample_index : int
        Samples sent before it since the device was armed, modulo 2**32.
    code : int
        That of the mark.
    clock_ticks : int or None
        Its first output sample by the driver's clock, at which the digital line rose; None if it
        had been played before the mark came.
    time_s : float or None
        The same by the host's clock: as the driver's reports of its clock came, of which the
        earliest counts, and not when this one was read.
    """

    sample_index: int
    code: int
    clock_ticks: int | None
    time_s: float | None

    @classmethod
    def of(cls, report: MarkedReport, clock: OutputClock) -> Self:
        """Take a driver's report, with its clock against the host's."""
        if report.clock_ticks == NEVER:
            return cls(report.sample_index, report.code, None, None)
        time_s = clock.time_of(report.clock_ticks)
        return cls(report.sample_index, report.code, report.clock_ticks, time_s)
