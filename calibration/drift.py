"""New strokes against a profile that exists: whether the screen still is what it was."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf, sqrt
from typing import Annotated, Literal

import numpy as np
from scipy.stats import t as student

from calibration.parameters import Array
from calibration.predict import StrokePredictor
from calibration.reduction import Reduced
from calibration.verification import FEWEST_OF_GROUP, TOLERANCE_THRESHOLDS, HeldOutStroke
from haptix.errors import InputError
from haptix.report import Heading

_LEVEL = 0.95  # one side: both sides of an equivalence at 5 %


@dataclass(frozen=True)
class Drift:
    """Mean change of friction since a profile was made.

    Parameters
    ----------
    mean_thresholds : float
        Mean of measured minus predicted friction [JND].
    uncertainty_thresholds : float
        The true mean is within it, either side, at 90 %: the scatter of the strokes, by Student's
        t.
    strokes : int
        Number of strokes.
    """

    mean_thresholds: Annotated[float, Heading("mean [JND]", "+.2f")]
    uncertainty_thresholds: Annotated[float, Heading("± [JND]", ".2f")]
    strokes: Annotated[int, Heading("strokes")]

    @classmethod
    def of(cls, residuals: Array) -> Drift:
        """Mean of residuals [JND] with its uncertainty, which two or more are needed for."""
        count = len(residuals)
        if count < 2:
            return cls(float(residuals.mean()) if count else 0.0, inf, count)
        error = float(residuals.std(ddof=1)) / sqrt(count)
        return cls(float(residuals.mean()), error * float(student.ppf(_LEVEL, count - 1)), count)

    @property
    def is_within(self) -> bool:
        """Whether the whole interval is within half a JND."""
        return abs(self.mean_thresholds) + self.uncertainty_thresholds <= TOLERANCE_THRESHOLDS


@dataclass(frozen=True)
class ProfileCheck:
    """Strokes against a profile.

    Parameters
    ----------
    strokes : tuple of HeldOutStroke
        Every good stroke and its prediction.
    drifts : mapping of str to Drift
        Of "all" strokes, and of those "without_voltage" and "with_voltage": another finger or
        cleaning shifts both, a changed insulator or drive the driven ones alone.
    """

    strokes: tuple[HeldOutStroke, ...]
    drifts: dict[str, Drift]

    @property
    def passed(self) -> bool:
        """Whether friction of all, and of the driven strokes, is within half a JND."""
        return all(self.drifts[name].is_within for name in ("all", "with_voltage"))

    @property
    def verdict(self) -> Literal["passed", "failed"]:
        """The same in a word."""
        return "passed" if self.passed else "failed"


def check_profile(reduced: Reduced, predictor: StrokePredictor) -> ProfileCheck:
    """Compare all good strokes with a predictor of the profiles, none of which it was fitted to.

    Raises
    ------
    InputError
        If there are fewer than two good strokes with a voltage.
    """
    points = [point for point in reduced.points if not point.outlier]
    driven = np.array([point.voltage_v > 0 for point in points], dtype=bool)
    if driven.sum() < FEWEST_OF_GROUP:
        raise InputError(
            f"expected {FEWEST_OF_GROUP} good strokes with a voltage or more, got {driven.sum()}"
        )
    rows = HeldOutStroke.predicted(points, predictor)
    residuals = np.array([one.residual_thresholds for one in rows])
    groups = {"all": residuals, "with_voltage": residuals[driven]}
    groups["without_voltage"] = residuals[~driven]
    return ProfileCheck(rows, {name: Drift.of(values) for name, values in groups.items()})
