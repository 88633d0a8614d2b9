"""Real-time playback with a long queue and a short reaction: what waits is revised."""

from __future__ import annotations

from dataclasses import dataclass
from numbers import Real

import numpy as np

from firmware_io.background import BackgroundPlayback
from firmware_io.clock import Clock
from firmware_io.device import Device
from firmware_io.errors import DeviceError
from firmware_io.reviser import Reviser, Source

LONGEST_HORIZON_S = 0.11
"""With the spare beyond it, about what a driver takes within its longest watchdog time."""


@dataclass(frozen=True)
class RevisedStats:
    """Counters since `RevisedPlayback.start`; times in seconds.

    Parameters
    ----------
    reaction_s, horizon_s : float
        What was asked for.
    underruns : int
        Number of times that the driver had no samples.
    revisions, refused : int
        Revisions that the driver has obeyed, and those that came too late.
    late_samples : int
        Samples played from an older prediction because a revision for them came later than the
        reaction allows.
    samples_played : int
        Samples sent, whether revised or not.
    reaction_p50_s, reaction_p99_s, reaction_max_s : float
        From a touch to the first sample that knew of it, of revisions that were obeyed; nan
        without any.
    longest_stall_s : float
        Longest time for which the thread did not run when it should have.
    """

    reaction_s: float
    horizon_s: float
    underruns: int
    revisions: int
    refused: int
    late_samples: int
    samples_played: int
    reaction_p50_s: float
    reaction_p99_s: float
    reaction_max_s: float
    longest_stall_s: float

    @property
    def advice(self) -> str:
        """What to do if the horizon did not hold; empty if it did."""
        if not self.underruns:
            return ""
        return (
            f"cannot hold its horizon of {self.horizon_s * 1e3:.3g} ms: {self.underruns} "
            f"underruns, longest stall {self.longest_stall_s * 1e3:.0f} ms. Choose a longer "
            f"horizon_s, up to {LONGEST_HORIZON_S:g}, or give the computer less to do"
        )


class RevisedPlayback(BackgroundPlayback[Reviser]):
    """Plays what a source makes, and makes it anew until it is played.

    One thread pulls samples up to the horizon ahead, and on each touch, and every 15 ms at least,
    pulls those that are played next once more and revises them. A stall up to the horizon is no
    underrun. The driver must be able to revise (`Capabilities.guard_s`).

    Parameters
    ----------
    device : Device
        Open; only the playback may use it between `start` and `stop`.
    source : Source
        Makes the samples, on the thread of the playback.
    reaction_s : float
        Time from a touch to the first sample that knows of it: wake-up, rendering, transport and
        the driver's guard. Where these take longer, as soon as they allow.
    horizon_s : float
        Longest stall that is no underrun.
    clock : Clock, optional
        For tests: there is no thread, and `step` does the work that is due.

    Raises
    ------
    DeviceError
        If a time is out of range, or the driver cannot revise.
    """

    def __init__(
        self,
        device: Device,
        source: Source,
        reaction_s: float = 0.003,
        horizon_s: float = 0.1,
        *,
        clock: Clock | None = None,
    ) -> None:
        for name, value, least, most in (
            ("reaction_s", reaction_s, 0.001, 0.1),
            ("horizon_s", horizon_s, 0.02, LONGEST_HORIZON_S),
        ):
            if not (isinstance(value, Real) and least <= value <= most):
                raise DeviceError(f"{name} must lie in {least:g}..{most:g}, but is {value!r}.")
        if not device.capabilities.guard_s:
            raise DeviceError(
                f"{device.name} cannot revise samples that it was sent; update its firmware, or "
                "play through Playback."
            )
        super().__init__(device, clock)
        self.reaction_s = reaction_s
        self.horizon_s = horizon_s
        self._source = source

    def _feeder(self) -> Reviser:
        return Reviser(self.device, self._source, self.reaction_s, self.horizon_s, self._now)

    def touch(self, touched_s: float | None = None) -> None:
        """Wake the thread: the source has news, from a time of the clock or from now.

        Raises
        ------
        DeviceError, LimitError
            Once, the error that ended the playback.
        """
        self._running().feeder.touch(self._now() if touched_s is None else touched_s)

    def step(self) -> float:
        """Do the work that is due, without a thread; return the time to the next, in seconds."""
        return self._step(self._running())

    def raise_once(self) -> None:
        """Raise the error that ended the playback, unless it was raised before."""
        if self._writer is not None:
            self._writer.raise_once()

    @property
    def underruns(self) -> int:
        """As in `stats`, for callers that ask often."""
        return 0 if self._writer is None else self._writer.feeder.underruns

    def reactions_s(self, most: int) -> list[float]:
        """Return the reactions to the last touches, at most so many; see `RevisedStats`."""
        if self._writer is None:
            return []
        feeder = self._writer.feeder
        with feeder.ready:
            found = feeder.reactions_s
            return [found[-number] for number in range(1, min(most, len(found)) + 1)]

    @property
    def stats(self) -> RevisedStats:
        """Counters since `start`."""
        if self._writer is None:
            nothing = (0,) * 5
            return RevisedStats(
                self.reaction_s, self.horizon_s, *nothing, np.nan, np.nan, np.nan, 0.0
            )
        feeder = self._writer.feeder
        with feeder.ready:
            reactions = np.array(feeder.reactions_s) if feeder.reactions_s else np.array([np.nan])
            p50, p99, most = np.percentile(reactions, (50, 99, 100)).tolist()
            return RevisedStats(
                self.reaction_s,
                self.horizon_s,
                feeder.underruns,
                feeder.revisions,
                feeder.refused,
                feeder.late_samples,
                feeder.samples_sent,
                p50,
                p99,
                most,
                feeder.longest_stall_s,
            )
