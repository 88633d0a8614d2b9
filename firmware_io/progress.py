"""How far a driver has come, by its last report."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

from firmware_io.protocol import INDEX_MODULUS, DeviceState, StatusReport

_SLOWEST = 0.98  # of its rate, at which a driver plays; even without a crystal none is slower


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

    @classmethod
    def of(
        cls,
        status: StatusReport,
        reported_s: float,
        now_s: float,
        sent: int,
        most_ahead: int,
        sample_rate_hz: float,
        clock_samples: float,
        revisions: tuple[int, int] = (0, 0),
    ) -> Self:
        """Return the progress by a report that came at `reported_s`.

        The driver takes `most_ahead` samples at most; of `revisions` it has obeyed and undone.
        """
        played = sent - (sent - status.samples_played) % INDEX_MODULUS
        ahead = sent - played
        is_playing = status.state is DeviceState.PLAYING
        if is_playing:
            # What it has played since then, at the least, is room that it will report.
            since_s = _SLOWEST * (now_s - reported_s)
            ahead -= min(max(0, int(since_s * sample_rate_hz)), status.queued_samples)
        room = status.queued_samples + status.free_samples - ahead
        return cls(
            reported_s,
            sent,
            played,
            max(0, min(room, most_ahead - ahead)),
            is_playing,
            clock_samples,
            status.underruns,
            *revisions,
            status.margin_samples,
        )
