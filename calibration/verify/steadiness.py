"""How friction changes: within strokes, over a session, and since a profile was made."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf, isfinite, log, nan
from typing import Annotated

import numpy as np
from scipy.stats import linregress, sem
from scipy.stats import t as student

from calibration.fit.result import Fit
from calibration.measure.reduction import Reduced
from calibration.plan.parameters import Array
from calibration.plan.predict import StrokeConditions, StrokePredictor
from haptix.base.report import Heading
from haptix.model.perception.thresholds import WEBER_FRACTION

TOLERANCE_JND = 0.5
"""Largest error of friction that passes, its uncertainty included [JND]."""

LEVEL = 0.95
"""Of one side: both sides of an equivalence at 5 %."""

_FEWEST_OF_TREND = 4


@dataclass(frozen=True)
class Steadiness:
    """Sizes, each with the uncertainty that it has at 90 %, either side; NaN where not seen."""

    repeatability_jnd: float = nan
    """Standard deviation of repeated strokes, beyond their own errors [JND]."""
    session_drift_jnd: float = nan
    session_drift_uncertainty_jnd: float = nan
    """Change of friction from the first stroke to the last [JND], by a straight line through the
    differences to the prediction over the strokes' order."""
    creep_jnd: float = nan
    creep_uncertainty_jnd: float = nan
    """Change of friction for ten times the time in contact [JND], within strokes."""

    @property
    def text(self) -> str:
        """One line for people."""
        parts = [f"strokes repeat within {self.repeatability_jnd:.2f} JND"]
        if isfinite(self.session_drift_jnd):
            parts.append(
                f"over the session friction drifts by {self.session_drift_jnd:+.2f} ± "
                f"{self.session_drift_uncertainty_jnd:.2f} JND"
            )
        if isfinite(self.creep_jnd):
            parts.append(
                f"it creeps by {self.creep_jnd:+.2f} ± "
                f"{self.creep_uncertainty_jnd:.2f} JND in ten times the contact time"
            )
        return "; ".join(parts)


def steadiness(fit: Fit, reduced: Reduced, predictor: StrokePredictor) -> Steadiness:
    """Find the trends of all good strokes against their prediction, by the profiles' predictor."""
    points = [point for point in reduced.points if not point.outlier]
    repeats = fit.repeatability.log_mu / WEBER_FRACTION
    if len(points) < _FEWEST_OF_TREND:
        return Steadiness(repeats)
    predicted = predictor.by_profiles(StrokeConditions.of(points))
    good = predicted.is_light
    misfit = (np.log([point.mu for point in points]) - predicted.log_mu)[good] / WEBER_FRACTION
    order = np.array([point.number for point in points], dtype=float)[good]
    creep = np.array([point.creep for point in points])
    creep = creep[np.isfinite(creep)] * log(10) / WEBER_FRACTION
    return Steadiness(repeats, *_slope(order, misfit), *_mean(creep))


def _slope(order: Array, misfit: Array) -> tuple[float, float]:
    """Change from the first to the last, and its uncertainty."""
    if len(order) < _FEWEST_OF_TREND or not np.ptp(order):
        return nan, nan
    line, lasts = linregress(order, misfit), float(np.ptp(order))
    quantile = float(student.ppf(LEVEL, len(order) - 2))
    return line.slope * lasts, quantile * line.stderr * lasts


def _mean(values: Array, fewest: int = _FEWEST_OF_TREND) -> tuple[float, float]:
    """Mean, and its uncertainty from the scatter."""
    if len(values) < fewest:
        return nan, nan
    quantile = float(student.ppf(LEVEL, len(values) - 1))
    return float(values.mean()), quantile * float(sem(values))


@dataclass(frozen=True)
class Drift:
    """Mean change of friction since a profile was made."""

    mean_jnd: Annotated[float, Heading("mean [JND]", "+.2f")]
    """Mean of measured minus predicted friction [JND]."""
    uncertainty_jnd: Annotated[float, Heading("± [JND]", ".2f")]
    """The true mean is within it, either side, at 90 %: the scatter of the strokes, by Student's
    t."""
    strokes: Annotated[int, Heading("strokes")]
    """Number of strokes."""

    @classmethod
    def of(cls, residuals: Array) -> Drift:
        """Mean of residuals [JND] with its uncertainty, which two or more are needed for."""
        if len(residuals) < 2:
            return cls(float(residuals.sum()), inf, len(residuals))
        return cls(*_mean(residuals, 2), len(residuals))

    @property
    def is_within(self) -> bool:
        """Whether the whole interval is within half a JND."""
        return abs(self.mean_jnd) + self.uncertainty_jnd <= TOLERANCE_JND
