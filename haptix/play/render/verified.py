"""Whether the surface is used where it was verified."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from math import hypot, inf
from typing import Any

from haptix.model.screen import VerifiedRange
from haptix.play.touch import TouchEvent

_LOG = logging.getLogger("haptix.play.render")
_APART_S = 0.1  # between the two places of a speed: the way is far longer than a panel's noise


class VerifiedUse:
    """The highest force, speed, time in contact and amplitude in use, against the verified range.

    Each touch begins and ends at rest and without a force, so only the upper limits count.

    Parameters
    ----------
    info : mapping
        Of the surface: its model has the screen's profile.
    frequency_hz : float
        Of the drive.
    """

    def __init__(self, info: Mapping[str, Any], frequency_hz: float) -> None:
        calibration = info.get("model", {}).get("screen", {}).get("calibration") or {}
        verified = calibration.get("verified")
        self.range = None if verified is None else VerifiedRange.model_validate(verified)
        self._frequency_hz = frequency_hz
        self._limits = (inf,) * 4 if self.range is None else self.range.largest(frequency_hz)
        self.on_warning: Callable[[str], None] | None = None
        """Called once for each quantity that leaves the range."""
        self.reset()

    def reset(self) -> None:
        """Begin anew."""
        self._highest: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0)
        self._warned: set[str] = set()
        self._places: dict[int, tuple[float, float, float, float]] = {}

    @property
    def sentences(self) -> tuple[str, ...]:
        """One sentence for each quantity that has left the range, with the highest value so far."""
        force_n, speed, contact_s, volts = self._highest
        if self.range is None or not any(self._highest):
            return ()
        return tuple(
            self.range.beyond(
                max(force_n, self.range.normal_force_n[0]),
                volts,
                self._frequency_hz,
                max(speed, self.range.speed_mm_per_s[0]),
                contact_s,
            )
        )

    def touched(self, event: TouchEvent, normal_force_n: float | None) -> None:
        """Take a touch and its measured force, None if it was not measured."""
        if self.range is None:
            return
        if event.kind == "up":
            self._places.pop(event.touch_id, None)
            return
        now = event.t_s, float(event.x_mm), float(event.y_mm)
        begun_s, *last = self._places.setdefault(event.touch_id, (event.t_s, *now))
        contact_s = event.t_s - begun_s
        speed = 0.0
        if (elapsed_s := now[0] - last[0]) >= _APART_S:
            speed = hypot(now[1] - last[1], now[2] - last[2]) / elapsed_s
            self._places[event.touch_id] = begun_s, *now
        self._update_highest(normal_force_n or 0.0, speed, contact_s, 0.0)

    def played(self, amplitude_v: float) -> None:
        """Take the highest amplitude of a block."""
        if self.range is not None:
            self._update_highest(0.0, 0.0, 0.0, amplitude_v)

    def _update_highest(self, *values: float) -> None:
        """Take force, speed, contact time and amplitude; cheap, since each touch calls it."""
        before = self._highest
        self._highest = tuple(map(max, before, values))
        crossed = zip(before, self._limits, self._highest, strict=True)
        # The first touch also checks the frequency of the drive.
        if not any(before) or any(old <= limit < new for old, limit, new in crossed):
            self._warn()

    def _warn(self) -> None:
        for sentence in self.sentences:
            quantity = sentence.partition(" ")[0]
            if quantity not in self._warned:
                self._warned.add(quantity)
                text = f"beyond the range that the screen's calibration has verified: {sentence}"
                _LOG.warning(text)
                if self.on_warning is not None:
                    self.on_warning(text)
