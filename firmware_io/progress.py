"""A driver's reports of its output: its progress, its clock and the marked samples."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import NamedTuple, Self

from firmware_io.protocol import FULL_SCALE_CODE, NEVER, MarkedReport, SenseReading

_KEPT_S = 1.0  # clocks that differ by 100 ppm drift apart by 0.1 ms in this time


class OutputClock:
    """Follows the output of a driver by its reports.

    A report may be read late, but never early. So of the reports of the last second, the one that
    shows the driver furthest ahead is the most exact.

    Parameters
    ----------
    rate_hz : float
        Samples per second.
    """

    def __init__(self, rate_hz: float) -> None:
        self.rate_hz = rate_hz
        self._origins: deque[tuple[float, float]] = deque()
        self._origin = 0.0

    def restart(self, host_s: float, played: float) -> None:
        """Forget earlier reports; from here on the output has no gap."""
        self._origins.clear()
        self.observe(host_s, played)

    def observe(self, host_s: float, played: float) -> None:
        """Take a report, read at `host_s`, of how many samples were played."""
        origins, origin = self._origins, played - host_s * self.rate_hz
        while origins and (origins[-1][1] <= origin or origins[0][0] < host_s - _KEPT_S):
            # Older reports that are not further ahead can never be the most exact again.
            if origins[-1][1] <= origin:
                origins.pop()
            else:
                origins.popleft()
        origins.append((host_s, origin))
        self._origin = origins[0][1]

    def played(self, host_s: float) -> float:
        """Return how many samples the driver has played at a time, fractions included."""
        return self._origin + host_s * self.rate_hz

    def time_of(self, index: float) -> float:
        """Return when a sample is played, by the host's clock."""
        return (index - self._origin) / self.rate_hz


@dataclass(frozen=True)
class Progress:
    """The driver's progress, by its last report.

    Parameters
    ----------
    reported_s : float
        Arrival of that report, by the host's clock.
    samples_sent, samples_played : int
        Since it was armed; samples sent after the report are included.
    room_samples : int
        Samples that it can accept now.
    is_playing : bool
        Whether it plays; it begins one lead after the first sample.
    clock_samples : float
        Its clock, in samples since its power-up.
    underruns : int
        Since its power-up.
    revisions, revisions_undone : int
        Revisions that it has obeyed, and those that it has refused or will, since it was armed.
    margin_samples : int
        Samples from its output to the first of the last revision, when it came.
    """

    reported_s: float
    samples_sent: int
    samples_played: int
    room_samples: int
    is_playing: bool
    clock_samples: float
    underruns: int
    revisions: int = 0
    revisions_undone: int = 0
    margin_samples: int = 0


MOST_MARKS = 8
"""Marks that may wait in a driver or to be read."""


@dataclass(frozen=True)
class Marked:
    """A sample that was marked and has been played.

    Attributes
    ----------
    sample_index : int
        Samples sent before it since the device was armed, modulo 2**32.
    code : int
        Code of the mark.
    clock_ticks : int or None
        Its first output sample by the driver's clock, at which the digital line rose; None if it
        had been played before the mark came.
    time_s : float or None
        The same by the host's clock. It comes from the driver's reports of its clock, of which the
        earliest counts, and not from when this report was read.
    """

    sample_index: int
    code: int
    clock_ticks: int | None
    time_s: float | None

    @classmethod
    def of(cls, report: MarkedReport, clock: OutputClock) -> Self:
        """Convert a driver's report, by its clock against the host's.

        Parameters
        ----------
        report : MarkedReport
            The driver's report.
        clock : OutputClock
            The driver's clock against the host's.
        """
        if report.clock_ticks == NEVER:
            return cls(report.sample_index, report.code, None, None)
        time_s = clock.time_of(report.clock_ticks)
        return cls(report.sample_index, report.code, report.clock_ticks, time_s)


class CurrentReading(NamedTuple):
    """The current that a driver measured over a whole number of its carrier's periods."""

    t_s: float
    """Time of its end, by the host's clock (`Device.clock`) [s]."""
    in_phase_a: float
    """Amplitude of the current in phase with the drive [A]."""
    quadrature_a: float
    """Amplitude ahead of the drive by a quarter period [A]."""
    driven_v: float
    """Amplitude driven over the reading [V]."""
    is_saturated: bool
    """Whether the current was beyond the converter's range."""

    @classmethod
    def of(cls, reading: SenseReading, clock: OutputClock, full_scale_v: float) -> Self:
        """Return a reading of the wire, in the units of the host.

        Parameters
        ----------
        reading : SenseReading
            As it came.
        clock : OutputClock
            The driver's clock against the host's.
        full_scale_v : float
            The voltage of code 32767.
        """
        return cls(
            clock.time_of(reading.clock_ticks),
            reading.in_phase_na * 1e-9,
            reading.ahead_na * 1e-9,
            reading.driven * full_scale_v / FULL_SCALE_CODE,
            bool(reading.flags & 1),
        )
