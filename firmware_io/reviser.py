"""The work of the thread that plays ahead and revises samples before they are played.

States of a stretch of samples::

                 write                     sent to the output
    to be made ---------> in the queue --------------------------> played
                            |     ^
               revise,      |     |  the driver obeys it: the new samples are in the queue
               on a touch   |     |  the driver refuses it, and those sent after it: the old
               or in time   v     |  samples stay, and are revised again for the same touch
                          under way

A driver refuses a revision that begins closer to the output than its guard. How much earlier a
revision must be sent is learned from the margins that the driver reports.
"""

from __future__ import annotations

import logging
import math
import threading
from collections import deque
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import Protocol, Self

import numpy as np
import numpy.typing as npt

from firmware_io.device import Device
from firmware_io.progress import OutputClock, Progress

_LOG = logging.getLogger("firmware_io.playback")

WINDOW_S = 0.02
"""Longest revision: two intervals of a touchscreen of 100 Hz."""

_SLOW_WINDOW_S = 0.014  # on a slow line, where the bytes of a revision delay each reaction
_BURST = 0.5  # share of an interval by which the revision of a touch may come early

SPARE_S = 0.085
"""Samples beyond the horizon: the next piece to append, and a reserve for two stalls in a row."""

READ_EVERY_S = 0.002
"""Time between two readings of the driver's reports, where somebody waits for them."""

_PIECE_S = 0.04  # most that is appended at once, between two touches
_PIECE_SHARE = 1 / 3  # its largest share of the driver's queue beyond the horizon
_APPENDED_WITHIN_S = 0.007  # after there is space for a piece: mostly at the next step
_PIECE_TAKES_S = 0.002  # longest time to send a piece on a slow link
STATUS_S = 0.02
"""Time between two reports of the driver."""

_ASK_S = 0.25  # a report may have waited in a socket; the answer to a question has not
_READ_S = 5e-4  # after a revision is due: by then it is known whether it was refused
_AFTER_REFUSAL_S = 1.0  # for this long after a refusal, each revision is read after `_READ_S`
_FIRST_NEED_S = 1e-3  # first guess of the need beyond the guard
# A refusal delays a reaction by the time until it is reported, and by the needs of the revision
# that is sent again and of those that it delays on the link.
_REFUSED_S, _REFUSED_NEEDS = 0.01, 3
_WEIGHTS = [0.1 * 0.9**age for age in range(31, -1, -1)]  # of the measured needs
_SPARE_S = 1e-4  # beyond the need: error of reading two clocks
_LONGEST_NEED_S = 0.05
_RENEWED_SHARE = 0.75  # largest share of a window that is played before the next one
_LEAST_WINDOW_S = 0.002  # a source needs this long to join the samples queued after it
_KEPT = 100_000


@dataclass
class PlaybackStats:
    """Counters and times of a playback."""

    reaction_s: float = math.nan
    """Requested time from a touch to the first sample that knows of it [s]."""
    horizon_s: float = math.nan
    """Requested longest stall that is no underrun [s]."""
    samples_played: int = 0
    """Samples sent, each once."""
    underruns: int = 0
    """Number of times that the driver had no samples."""
    revisions: int = 0
    """Number of windows that were revised before they were played."""
    refused: int = 0
    """Number of revisions that came too late."""
    late_samples: int = 0
    """Samples played from an older prediction, because their revision was later than requested."""
    longest_stall_s: float = 0.0
    """Longest time for which the thread that plays did not run when it should have [s]."""
    reactions_s: deque[float] = field(default_factory=lambda: deque(maxlen=_KEPT), repr=False)
    """For each of the last touches, time to the first sample that knew of it [s]."""

    @property
    def reaction_p50_s(self) -> float:
        """Median of `reactions_s` [s]; nan without any."""
        return percentile(self.reactions_s, 50)

    @property
    def reaction_p99_s(self) -> float:
        """99th percentile of `reactions_s` [s]."""
        return percentile(self.reactions_s, 99)

    @property
    def reaction_max_s(self) -> float:
        """Longest of `reactions_s` [s]."""
        return percentile(self.reactions_s, 100)

    @property
    def advice(self) -> str:
        """What to do if the horizon did not hold; empty if it did."""
        if not self.underruns:
            return ""
        return (
            f"cannot hold its horizon of {self.horizon_s * 1e3:.3g} ms: {self.underruns} "
            f"underruns, longest stall {self.longest_stall_s * 1e3:.0f} ms. Choose a longer "
            "horizon_s, or give the computer less to do"
        )


def percentile(times_s: Iterable[float], percent: float) -> float:
    """Return a percentile; nan without times."""
    kept = list(times_s)
    return float(np.percentile(kept, percent)) if kept else math.nan


class Source(Protocol):
    """Makes the samples of any stretch of a stream, as often as requested."""

    @property
    def grid(self) -> int:
        """Stretches begin and end at multiples of this many samples."""

    @property
    def is_live(self) -> bool:
        """Whether a revision could differ from the samples made before."""

    def window(
        self, first: int, count: int, at_s: float, is_revision: bool
    ) -> npt.NDArray[np.float64]:
        """Return samples from index `first` on; the first is played at `at_s`.

        They continue the sample before them; those of a revision also lead to the sample after.

        Parameters
        ----------
        first : int
            Index of the first sample.
        count : int
        at_s : float
            Time when the first is played [s].
        is_revision : bool
            Whether they replace samples that are queued.
        """

    def settle(self, obeyed: int, undone: bool) -> None:
        """Count the oldest revisions as played; with `undone`, discard all others.

        Parameters
        ----------
        obeyed : int
            Number of the oldest revisions that were played.
        undone : bool
            Whether the driver has refused all others.
        """

    def played(self, index: int) -> None:
        """Forget the samples before an index."""


@dataclass(frozen=True)
class Sizes:
    """Samples sent at once."""

    window: int
    """Longest revision."""
    least: int
    """Shortest revision."""
    piece: int
    """Samples appended at once."""
    horizon: int
    """Samples kept ahead."""
    least_interval_s: float
    """Time from one revision to the next [s]."""

    @classmethod
    def of(cls, device: Device, grid: int, horizon_s: float) -> Self:
        """Return the sizes for a device, as multiples of a source's grid.

        Parameters
        ----------
        device : Device
            Its link and its queue bound them.
        grid : int
            See `Source.grid`.
        horizon_s : float
            Longest stall that is no underrun.
        """
        pace, rate_hz = device.pace, device.capabilities.sample_rate_hz
        is_slow = pace.bytes_per_s is not None
        most, least_interval_s = pace.revision_budget(_SLOW_WINDOW_S if is_slow else WINDOW_S)
        least = int(_LEAST_WINDOW_S * rate_hz)
        piece = pace.least_write_samples
        if piece == 1:
            beyond = device.capabilities.queue_samples - horizon_s * rate_hz
            piece = min(int(_PIECE_S * rate_hz), max(least, int(_PIECE_SHARE * beyond)))
            if pace.bytes_per_s is not None:
                piece = min(piece, int(_PIECE_TAKES_S * pace.bytes_per_s / 2))
        return cls(
            window=max(grid, most // grid * grid),
            least=least,
            piece=max(grid, piece // grid * grid),
            horizon=int((horizon_s + SPARE_S) * rate_hz),
            least_interval_s=least_interval_s,
        )


class Reviser:
    """Keeps the driver's queue filled to the horizon and revises it; others call `step`.

    Parameters
    ----------
    device : Device
        Armed by `begin`, written to and revised by `step`.
    source : Source
        Makes the samples.
    stats : PlaybackStats
        Counters; it also has the requested reaction and horizon.
    on_read : callable, optional
        Called after the driver's reports were read, which is then done every `READ_EVERY_S`.

    Attributes
    ----------
    ready : threading.Condition
        Guards the attributes that a touch changes; notified to wake the thread.
    has_touch : bool
        Whether a touch has come since the last step began.
    """

    def __init__(
        self,
        device: Device,
        source: Source,
        stats: PlaybackStats,
        on_read: Callable[[], None] | None = None,
    ) -> None:
        rate_hz = device.capabilities.sample_rate_hz
        self.device = device
        self.ready = threading.Condition()
        self.output = OutputClock(rate_hz)
        self.samples_sent = 0
        self.stats = stats
        self._source = source
        self._on_read = on_read
        self._clock = device.clock
        self._rate_hz = rate_hz
        sizes = Sizes.of(device, source.grid, stats.horizon_s)
        self._window, self._least_interval_s = sizes.window, sizes.least_interval_s
        self._least, self._horizon, self._piece = sizes.least, sizes.horizon, sizes.piece
        self._patience_s = min(_APPENDED_WITHIN_S, self._piece / rate_hz / 2)
        self._guard_s = device.capabilities.guard_s
        # Time from reading the clock to the first sample, on a free line.
        self.need_s = self._guard_s + _FIRST_NEED_S
        if device.pace.bytes_per_s is not None:
            self.need_s += 2 * self._window / device.pace.bytes_per_s
        self._line_sent, self._line_free_s = device.bytes_sent, -math.inf
        self._needs: deque[float] = deque([self.need_s], maxlen=len(_WEIGHTS))
        self.has_touch = False
        self._touched_s: float | None = None
        # For each revision: time of the touch, time of its first sample, and lead on a free line.
        self._under_way: deque[tuple[float, float, float]] = deque()
        self._read_s = self._append_due_s = -math.inf
        self._revised_s = self._carried_s = -math.inf
        self._refused_s = self._clock()  # so that the first revisions measure their need
        self._asked_s = -math.inf
        self._known_underruns = 0
        self._has_reported = False  # whether a report has come since it was armed
        self._obeyed = self._undone = 0
        self._forgotten = 0  # the source cannot begin before this index
        self._due_s = math.inf  # time for which the present step was due

    def begin(self) -> None:
        """Arm the device, to play without a lead of its own."""
        self.device.set_up(lead_s=0.0, status_s=STATUS_S)
        self.device.arm(revisable=True)
        self._known_underruns = self.device.progress().underruns

    def touch(self, touched_s: float) -> None:
        """Wake the thread: something has changed at a time of the host's clock."""
        with self.ready:
            if self._touched_s is None:
                self._touched_s = touched_s
            self.has_touch = True
            self.ready.notify_all()

    def step(self) -> float:
        """Send all that is due; return the time to the next step, in seconds."""
        self.has_touch = False
        now_s = self._clock()
        self.stats.longest_stall_s = max(self.stats.longest_stall_s, now_s - self._due_s)
        # A touch comes first: its revision is sent before reports are read and samples appended.
        is_touched = self._touched_s is not None and now_s >= self._next_revision_s()
        is_low = self.samples_sent - self.output.played(now_s) < self._horizon / 4
        if is_touched and not is_low:
            self._revise()
        if not is_touched or is_low or now_s >= min(self._read_s, self._append_due_s):
            self._read_and_append(now_s)
        now_s = self._clock()
        self._due_s = max(now_s, min(self._read_s, self._append_due_s, self._next_revision_s()))
        return self._due_s - now_s

    def _read_and_append(self, now_s: float) -> None:
        """Read reports, revise without a touch if that is due, and append."""
        self._read_s = math.inf if self._on_read is None else now_s + READ_EVERY_S
        is_fresh = now_s - self._asked_s > _ASK_S and self.samples_sent > 0
        progress = self.device.progress(is_fresh, is_due=True)
        now_s = self._clock()
        if is_fresh:
            self._asked_s = now_s
        self._observe(progress)
        if self._on_read is not None:
            self._on_read()
        if now_s >= self._next_revision_s():
            self._revise()
        missing = self._append(progress)
        self._append_due_s = -math.inf
        if missing < self._piece:
            later_s = (self._piece - missing) / self._rate_hz
            self._append_due_s = self._clock() + later_s + self._patience_s

    def _next_revision_s(self) -> float:
        """Return when to revise, by the clock."""
        if self._touched_s is not None:
            return self._carried_s - _BURST * self._least_interval_s
        if self._source.is_live:
            most_s = _RENEWED_SHARE * self._window / self._rate_hz
            return self._revised_s + max(most_s, self._least_interval_s)
        return math.inf

    def _observe(self, progress: Progress) -> None:
        if progress.is_playing:
            missed = progress.underruns - self._known_underruns
            if missed or not self._has_reported:
                # Earlier knowledge was assumed, or is of an output that has stopped since.
                self.output.restart(progress.reported_s, progress.samples_played)
                self._has_reported = True
            else:
                self.output.observe(progress.reported_s, progress.samples_played)
            if missed:
                self.stats.underruns += missed
                _LOG.info("underrun, %d in all", self.stats.underruns)
                self._known_underruns = progress.underruns
        obeyed = progress.revisions - self._obeyed
        undone = progress.revisions_undone - self._undone
        self._obeyed, self._undone = progress.revisions, progress.revisions_undone
        if not (obeyed or undone):
            return
        stats = self.stats
        stats.revisions += obeyed
        stats.refused += undone
        with self.ready:
            for _ in range(obeyed):
                touched_s, first_s, lead_s = self._under_way.popleft()
                if not math.isnan(touched_s):
                    stats.reactions_s.append(first_s - touched_s)
            if undone:
                _LOG.info("%d revisions came too late and are repeated", undone)
                self._refused_s = self._clock()
                touched = [t for t, *_ in self._under_way if not math.isnan(t)]
                lead_s = self._under_way[-1][-1]
                self._under_way.clear()
                # Revise again, for the touch that has waited longest.
                self._touched_s = min(
                    [*touched, self._clock() if self._touched_s is None else self._touched_s]
                )
        self._source.settle(obeyed, bool(undone))
        margin_s = progress.margin_samples / self._rate_hz
        # A margin above the lead means that the output stopped meanwhile, and not that the driver
        # takes revisions of samples it has played.
        needed_s = max(lead_s - margin_s, 0.0) + self._guard_s
        self._learn(min(needed_s, _LONGEST_NEED_S))

    def _learn(self, needed_s: float) -> None:
        """Choose the time that revisions need, so that a reaction is short on average.

        It is one of the measured times. A longer one delays every reaction; a shorter one delays
        the reactions whose revision is refused and sent again. So a single stall changes nothing.
        """
        self._needs.append(needed_s)
        weights = _WEIGHTS[-len(self._needs) :]
        least_s, refused_s = math.inf, 0.0
        # From the longest down, add up the delays by refusals of the revisions that need longer.
        for need_s, weight in sorted(zip(self._needs, weights, strict=True), reverse=True):
            if need_s + refused_s < least_s:
                least_s, self.need_s = need_s + refused_s, need_s + _SPARE_S
            refused_s += weight * (_REFUSED_S + _REFUSED_NEEDS * need_s)

    def _revise(self) -> None:
        """Make the next samples again, from the first that a revision can still reach."""
        with self.ready:
            touched_s, self._touched_s = self._touched_s, None
        now_s, grid = self._clock(), self._source.grid
        waits_s = self._line_busy_s(now_s)
        need_s = self.need_s + waits_s
        self._revised_s = now_s
        # Time when the link has carried this revision, at the revisions' share of its bytes.
        self._carried_s = max(self._carried_s, now_s) + self._least_interval_s
        first = math.ceil((self.output.played(now_s) + need_s * self._rate_hz) / grid)
        if touched_s is not None:
            wanted = self.output.played(touched_s + self.stats.reaction_s)
            self.stats.late_samples += max(0, first * grid - math.ceil(wanted))
            first = max(first, math.floor(wanted / grid))
        first = max(first * grid, self._forgotten + grid)
        # The last queued point stays, since appended samples follow it.
        count = min(self._window, (self.samples_sent - grid - first) // grid * grid)
        if count < self._least:
            return
        at_s = self.output.time_of(first)
        volts = self._source.window(first, count, at_s, True)
        if _LOG.isEnabledFor(logging.DEBUG):
            ahead_ms = 1e3 * (at_s - now_s)
            _LOG.debug("revises %d samples from %d, %.2f ms ahead", count, first, ahead_ms)
        self.device.revise(first, volts)
        self._note_sent(now_s)
        was_refused = now_s - self._refused_s < _AFTER_REFUSAL_S
        self._read_s = min(self._read_s, at_s + (_READ_S if was_refused else STATUS_S))
        lead_s = at_s - now_s - waits_s
        with self.ready:
            self._under_way.append((math.nan if touched_s is None else touched_s, at_s, lead_s))

    def _line_busy_s(self, now_s: float) -> float:
        """Return how long the link is still busy with sent bytes; 0 if that is unknown."""
        return max(0.0, self._line_free_s - now_s)

    def _note_sent(self, began_s: float) -> None:
        """Add the bytes sent since a time to the load of a line of so many bytes a second."""
        rate = self.device.pace.bytes_per_s
        if rate is not None:
            sent = self.device.bytes_sent
            takes_s = (sent - self._line_sent) / rate
            self._line_free_s = max(self._line_free_s, began_s) + takes_s
            self._line_sent = sent

    def _append(self, progress: Progress) -> int:
        """Send one piece if the horizon lacks it; return the samples that it still lacks."""
        now_s, sent, grid = self._clock(), self.samples_sent, self._source.grid
        if sent == 0:
            self.output.restart(now_s, 0)
        played = min(self.output.played(now_s), float(sent))
        self._forgotten = max(self._forgotten, (int(played) - self._window) // grid * grid)
        self._source.played(self._forgotten)
        # Samples played since the report have left space, too, though it is not reported yet.
        room = progress.room_samples
        missing = int(min(self._horizon - (sent - played), room))
        count = min(missing, self._piece) // grid * grid
        if count < self._piece:
            return missing
        volts = self._source.window(sent, count, self.output.time_of(sent), False)
        self.device.write(volts)
        self._note_sent(now_s)
        self.samples_sent += count
        self.stats.samples_played += count
        # Writing has read reports: evaluate them before the next revision is sent.
        self._observe(self.device.progress())
        return missing - count
