"""Verify a fit by strokes that were kept out of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import isfinite
from typing import Self

import numpy as np

from calibration.fit import Fit
from calibration.parameters import Parameters
from calibration.predict import StrokeConditions, StrokePredictor
from calibration.reduction import Point, Reduced
from haptix.perception import WEBER_FRACTION

TOLERANCE_THRESHOLDS = 0.5
"""Largest residual that passes [JND]."""

FEWEST_HELD_OUT = 2


@dataclass(frozen=True)
class HeldOutStroke:
    """A stroke kept out of the fit, and what the fit predicts for it.

    The ripple is the amplitude of the friction at 2f over its mean.
    """

    point: Point
    predicted_mu: float
    predicted_ripple: float

    @property
    def residual_thresholds(self) -> float:
        """Measured minus predicted friction, in just-noticeable differences (11 % of mu)."""
        return (self.point.mu / self.predicted_mu - 1) / WEBER_FRACTION

    @property
    def ripple_residual_thresholds(self) -> float:
        """The same of the ripple's amplitude in mu; NaN where no ripple is seen."""
        measured = self.point.ripple * self.point.mu
        return (measured / self.predicted_mu - self.predicted_ripple) / WEBER_FRACTION

    @classmethod
    def predicted(cls, points: Sequence[Point], predictor: StrokePredictor) -> tuple[Self, ...]:
        """Predict strokes with the finger and the screen of a predictor."""
        if not points:
            return ()
        own = Parameters.of(predictor.model.finger, predictor.model.screen)
        found = predictor(StrokeConditions.of(points), own.names, own.log_values, jacobian=False)
        each = zip(points, np.exp(found.log_mu).tolist(), found.ripple.tolist(), strict=True)
        return tuple(cls(*one) for one in each)

    def values(self) -> dict[str, float]:
        """Return a row of numbers."""
        return {
            "number": self.point.number,
            "mu": self.point.mu,
            "predicted_mu": self.predicted_mu,
            "residual_thresholds": self.residual_thresholds,
            "ripple_residual_thresholds": self.ripple_residual_thresholds,
        }

    def row(self) -> dict[str, str]:
        """Return a row of a table for people."""
        ripple = self.ripple_residual_thresholds
        return {
            "stroke": str(self.point.number),
            "F_N [N]": f"{self.point.normal_force_n:.3g}",
            "V0 [V]": f"{self.point.voltage_v:.3g}",
            "f [Hz]": f"{self.point.frequency_hz:.3g}",
            "mu": f"{self.point.mu:.3g}",
            "predicted": f"{self.predicted_mu:.3g}",
            "residual [JND]": f"{self.residual_thresholds:+.2f}",
            "ripple [JND]": f"{ripple:+.2f}" if isfinite(ripple) else "-",
        }


@dataclass(frozen=True)
class Verification:
    """Verdict on a calibration.

    Parameters
    ----------
    rows : tuple of HeldOutStroke
        Strokes kept out of the fit.
    tolerance_thresholds : float
        Largest residual that passes [JND].
    failures : tuple of str
        Why it fails; empty where it passes.
    """

    rows: tuple[HeldOutStroke, ...]
    tolerance_thresholds: float
    failures: tuple[str, ...]

    @property
    def passed(self) -> bool:
        """Whether the calibration may be used without a warning."""
        return not self.failures

    @property
    def verdict(self) -> str:
        """Return "passed" or "failed"."""
        return "passed" if self.passed else "failed"

    @property
    def worst_thresholds(self) -> float:
        """Largest residual of mu [JND]; NaN without strokes."""
        return max((abs(row.residual_thresholds) for row in self.rows), default=float("nan"))


def verify(
    fit: Fit,
    reduced: Reduced,
    predictor: StrokePredictor,
    tolerance_thresholds: float = TOLERANCE_THRESHOLDS,
) -> Verification:
    """Predict the held-out strokes and compare.

    It fails where a residual is above the tolerance, where fewer than two strokes were kept out,
    or where the strokes do not determine the screen's insulator.
    """
    rows = HeldOutStroke.predicted(reduced.held_out, predictor)
    failures = []
    if len(rows) < FEWEST_HELD_OUT:
        failures.append(
            f"expected {FEWEST_HELD_OUT} good strokes kept out of the fit or more, got {len(rows)}"
        )
    for row in rows:
        for what, value in (
            ("mu", row.residual_thresholds),
            ("the ripple", row.ripple_residual_thresholds),
        ):
            if abs(value) > tolerance_thresholds:
                failures.append(
                    f"stroke {row.point.number}: {what} is {value:+.2g} JND from the prediction, "
                    f"{tolerance_thresholds:g} are allowed"
                )
    if fit["h0_m"].value is None:
        failures.append(fit["h0_m"].refusal())
    return Verification(rows, tolerance_thresholds, tuple(failures))
