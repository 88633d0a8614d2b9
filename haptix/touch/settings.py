"""Settings of the touch trackers."""

from __future__ import annotations

from dataclasses import dataclass, field

from haptix.checks import NotNegative, Positive, check_fields, instance
from haptix.errors import InputError
from haptix.touch.filters import InteractingSinger, PlaceFilter
from haptix.touch.force import ForceModel


@dataclass(frozen=True)
class TouchSettings:
    """Settings of a tracker; times in seconds.

    Parameters
    ----------
    filter : PlaceFilter
        `InteractingSinger`, `SingerKalman`, `ConstantVelocityKalman` or `OneEuroFilter`.
    latency_s : float
        How far ahead places are predicted, beyond the age of the last report. It is the time from
        the finger being at a place to the report's time stamp, plus the time from a sample being
        rendered to the finger feeling it. Measure it end to end.
    lost_after_s : float
        A touch without a report for this long is lost. It is held where it was expected then, and
        does not slide. The next report starts it again, as if the finger had just come down.
    blend_s : float
        Time constant with which a path follows the correction of a new report.
    slide_above_mm_s, rest_below_mm_s : float
        A finger starts to slide above the first and comes to rest below the second.
    turn_above_mm_s, turn_s : float
        A finger whose velocity averages to less, since it turns, still slides for `turn_s` at most
        while its averaged speed is above the first.
    slide_smoothing_s : float
        Time constant over which velocity, as a vector, and speed are averaged for that decision.
    reorder_s : float
        An event that is late by at most this is put in its place. Later ones are dropped.
    clock_uncertainty_s : float
        Known uncertainty of the stamps' clock, see `AppClock`.
    least_interval_s : float
        Reports that follow each other faster than this replace each other.
    force : ForceModel
        Where the normal force comes from.
    """

    filter: PlaceFilter = field(default_factory=InteractingSinger)
    latency_s: NotNegative = 0.0
    lost_after_s: Positive = 0.08
    blend_s: Positive = 0.003
    slide_above_mm_s: NotNegative = 8.0
    rest_below_mm_s: NotNegative = 4.0
    turn_above_mm_s: Positive = 8.0
    turn_s: NotNegative = 0.1
    slide_smoothing_s: Positive = 0.05
    reorder_s: NotNegative = 0.02
    clock_uncertainty_s: NotNegative = 0.0
    least_interval_s: Positive = 0.001
    force: ForceModel = field(default_factory=ForceModel)

    def __post_init__(self) -> None:
        check_fields(self)
        instance("filter", self.filter, PlaceFilter, "such as haptix.touch.SingerKalman()")
        instance("force", self.force, ForceModel)
        if self.latency_s > 0.5:
            raise InputError(
                f"latency_s: expected 0.5 s at most, got {self.latency_s:g}; is it in ms? No "
                "finger can be predicted over more"
            )
        if self.rest_below_mm_s > self.slide_above_mm_s:
            raise InputError(
                "expected rest_below_mm_s <= slide_above_mm_s, got "
                f"{self.rest_below_mm_s:g} and {self.slide_above_mm_s:g}"
            )
