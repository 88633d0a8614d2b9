"""Adapts the rendered friction to the finger that an observer has learned, without a step."""

from __future__ import annotations

import logging
import threading
from collections import OrderedDict
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from firmware_io import CurrentReading
from haptix.base.checks import Array, boolean
from haptix.base.errors import InputError
from haptix.model.perception.thresholds import WEBER_FRACTION
from haptix.model.surface import FrictionSurface, Slice
from haptix.play.render.drive import Drive
from haptix.play.sensing import ContactCurrent, FingerEstimate, FingerObserver
from haptix.play.touch import ForceModel, TouchTracker

_LOG = logging.getLogger("haptix.play.render")

MOST_LOG_GAIN = 1.2
"""Largest ln of a finger's attraction over the known finger's, either way: a factor of 3.3, or two
sigma."""

STEP_JND, STEP_S = 0.2, 0.010
"""Largest change of the felt friction by learning, and the time for it. It is below the
required 0.25 JND, so that a finger that differs from the estimate stays within them too."""

_CACHED_SLICES = 8  # for blocks that are rendered again
_ASSUMED_N = ForceModel().assumed_n


class _Course(NamedTuple):
    """A gain that goes to a target at a constant rate from a time on."""

    start_s: float
    start: float
    target: float
    per_s: float

    def at(self, t_s: Array | float) -> Array:
        most = self.per_s * np.maximum(np.asarray(t_s) - self.start_s, 0.0)
        return np.asarray(self.start + np.clip(self.target - self.start, -most, most))


class Adaptation:
    """Ln of the finger's attraction over that of the surface's finger, as it changes in time.

    One thread may pass readings and touches while another renders.

    Parameters
    ----------
    observer : FingerObserver
        Learns the finger.
    """

    def __init__(self, observer: FingerObserver) -> None:
        self.observer = observer
        self._lock = threading.Lock()
        self._course = _Course(0.0, 0.0, 0.0, 0.0)
        self._target = 0.0
        self._window = (0.0, 0.0)
        self._slices: OrderedDict[float, Slice] = OrderedDict()
        self.estimate: FingerEstimate | None = None

    @classmethod
    def of(cls, sense: bool | FingerObserver, surface: FrictionSurface, drive: Drive) -> Adaptation:
        """Adapt by an observer, or with True by a new one for this surface and carrier."""
        if drive.attraction is not None:
            raise InputError(
                "sense: expected a carrier, of which the current is measured, got a direct drive; "
                "leave sense out"
            )
        if isinstance(sense, FingerObserver):
            return cls(sense)
        boolean("sense", sense)
        return cls(FingerObserver(ContactCurrent.of_surface(surface, drive.frequency_hz)))

    @property
    def probe_v(self) -> float:
        """Amplitude by which the panel is measured while nobody touches [V]."""
        return self.observer.settings.probe_v

    def reset(self) -> None:
        """Begin again with the surface's finger."""
        with self._lock:
            self.observer.forget()
            self._course, self._target = _Course(0.0, 0.0, 0.0, 0.0), 0.0
            self.estimate = None

    def read(self, reading: CurrentReading, now_s: float) -> bool:
        """Take a reading; return whether the queued samples should be rendered again at once."""
        with self._lock:
            return self.observer.read(reading, now_s) and self._learn(now_s)

    def known(self, now_s: float) -> FingerEstimate:
        """Return the estimate at a time."""
        with self._lock:
            self.estimate = self.observer.estimate(now_s)
            return self.estimate

    def touched(
        self, t_s: float, fingers: int, speed_mm_per_s: float, force_n: float, is_measured: bool
    ) -> None:
        """Pass the state of the touches to the observer, see `FingerObserver.touched`."""
        with self._lock:
            measured = force_n if is_measured else None
            self.observer.touched(t_s, fingers, speed_mm_per_s, measured, force_n)

    def follow(self, t_s: float, fingers: Sequence[TouchTracker]) -> None:
        """Take the number of fingers, and speed and force of a single one."""
        if len(fingers) != 1:
            self.touched(t_s, len(fingers), 0.0, _ASSUMED_N, False)
            return
        state = fingers[0].at(t_s)
        is_measured = state.force_source == "axis"
        self.touched(t_s, 1, state.speed_mm_s, state.normal_force_n, is_measured)

    def _learn(self, now_s: float) -> bool:
        before, estimate = self.estimate, self.observer.estimate(now_s)
        self.estimate = estimate
        self._target = float(np.clip(estimate.log_gain, -MOST_LOG_GAIN, MOST_LOG_GAIN))
        if before is None or before.state is estimate.state:
            return False
        _LOG.info("finger: %s", estimate)
        return not self.observer.watch.is_trusted

    def window(self, at_s: float, step_s: float, is_revision: bool) -> None:
        """Begin a window whose first sample is played at `at_s`; a revision uses the new target."""
        with self._lock:
            self._window = (at_s, step_s)
            if is_revision:
                start = float(self._course.at(at_s))
                self._course = self._course._replace(start_s=at_s, start=start, target=self._target)

    def look(self, now_s: float) -> None:
        """Begin to take all readings that wait, see `SensorWatch.look`."""
        with self._lock:
            self.observer.watch.look(now_s)

    def check(self, now_s: float, problem: str | None) -> bool:
        """Learn that the sensor is silent for too long, or has a problem; return if so."""
        with self._lock:
            watch = self.observer.watch
            if not watch.is_trusted or watch.check(now_s, problem):
                return False
            self._learn(now_s)
            return True

    def now(self, plain: Slice) -> Slice:
        """Return the slice of the finger, by the latest estimate."""
        with self._lock:
            return self._slice(plain, self._target)

    def over(self, plain: Slice, points: int) -> tuple[tuple[Slice, Slice], Array]:
        """Return two slices, and the weight of the second at each point of the window."""
        with self._lock:
            at_s, step_s = self._window
            course = self._course
            strongest = self._slice(plain, max(course.start, course.target, 0.0))
            lowest, highest = strongest.reach(plain.force_n)
            # The slope of ln mu against the gain is mu(V)/mu(0) - 1 at most.
            steepest = max(float((highest / lowest).max()) - 1, 1e-3)
            per_s = STEP_JND * WEBER_FRACTION / steepest / STEP_S
            self._course = course = course._replace(per_s=per_s)
            gain = course.at(at_s + step_s * np.arange(1.0, points + 1))
            first, last = float(gain[0]), float(gain[-1])
            slices = self._slice(plain, first), self._slice(plain, last)
            span = last - first
            part = (gain - first) / span if span else np.zeros(points)
            return slices, np.ascontiguousarray(part)

    def _slice(self, plain: Slice, log_gain: float) -> Slice:
        if log_gain == 0:
            return plain
        if (adapted := self._slices.get(log_gain)) is None:
            adapted = self._slices[log_gain] = plain.attracted(log_gain)
            if len(self._slices) > _CACHED_SLICES:
                self._slices.popitem(last=False)
        return adapted
