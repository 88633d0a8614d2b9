"""How steady friction is: repeatability, drift over the session and creep in contact, in JND."""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite, log, nan, sqrt

import numpy as np
from scipy.stats import t as student

from calibration.fit import Fit
from calibration.parameters import Array, Parameters
from calibration.predict import StrokeConditions, StrokePredictor
from calibration.reduction import Reduced
from haptix.perception import WEBER_FRACTION

_LEVEL = 0.95  # one side
_FEWEST = 4  # strokes for a trend


@dataclass(frozen=True)
class Steadiness:
    """Sizes, each with the uncertainty that it has at 90 %, either side; NaN where not seen.

    Parameters
    ----------
    repeatability_thresholds : float
        Standard deviation of repeated strokes, beyond their own errors [JND].
    session_drift_thresholds, session_drift_uncertainty_thresholds : float
        Change of friction from the first stroke to the last [JND], by a straight line through the
        differences to the prediction over the strokes' order.
    creep_thresholds, creep_uncertainty_thresholds : float
        Change of friction for ten times the time in contact [JND], within strokes.
    """

    repeatability_thresholds: float = nan
    session_drift_thresholds: float = nan
    session_drift_uncertainty_thresholds: float = nan
    creep_thresholds: float = nan
    creep_uncertainty_thresholds: float = nan

    @property
    def text(self) -> str:
        """One line for people."""
        said = [f"strokes repeat within {self.repeatability_thresholds:.2f} JND"]
        if isfinite(self.session_drift_thresholds):
            said.append(
                f"over the session friction drifts by {self.session_drift_thresholds:+.2f} ± "
                f"{self.session_drift_uncertainty_thresholds:.2f} JND"
            )
        if isfinite(self.creep_thresholds):
            said.append(
                f"it creeps by {self.creep_thresholds:+.2f} ± "
                f"{self.creep_uncertainty_thresholds:.2f} JND in ten times the contact time"
            )
        return "; ".join(said)


def steadiness(fit: Fit, reduced: Reduced, predictor: StrokePredictor) -> Steadiness:
    """Find the trends of all good strokes against their prediction, by the profiles' predictor."""
    points = [one for one in reduced.points if not one.outlier]
    repeats = fit.repeatability.log_mu / WEBER_FRACTION
    if len(points) < _FEWEST:
        return Steadiness(repeats)
    own = Parameters.of(predictor.model.finger, predictor.model.screen)
    found = predictor(StrokeConditions.of(points), own.names, own.log_values, jacobian=False)
    good = found.is_light
    misfit = (np.log([one.mu for one in points]) - found.log_mu)[good] / WEBER_FRACTION
    order = np.array([one.number for one in points], dtype=float)[good]
    creep = np.array([one.creep for one in points])
    creep = creep[np.isfinite(creep)] * log(10) / WEBER_FRACTION
    return Steadiness(repeats, *_slope(order, misfit), *_mean(creep))


def _slope(order: Array, misfit: Array) -> tuple[float, float]:
    """Change from the first to the last, and its uncertainty."""
    count, lasts = len(order), float(np.ptp(order)) if len(order) else 0.0
    if count < _FEWEST or not lasts:
        return nan, nan
    away = order - order.mean()
    slope = float(away @ misfit / (away @ away))
    rest = misfit - misfit.mean() - slope * away
    sd = sqrt(float(rest @ rest) / (count - 2) / float(away @ away))
    return slope * lasts, float(student.ppf(_LEVEL, count - 2)) * sd * lasts


def _mean(values: Array) -> tuple[float, float]:
    """Mean, and its uncertainty from the scatter."""
    if len(values) < _FEWEST:
        return nan, nan
    sd = float(values.std(ddof=1)) / sqrt(len(values))
    return float(values.mean()), float(student.ppf(_LEVEL, len(values) - 1)) * sd
