"""The normal force of a touch: measured, from the contact area, or assumed."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import exp, expm1, inf, log, sqrt
from typing import Literal, NamedTuple, Self

import numpy as np
import numpy.typing as npt

from haptix.checks import NotNegative, Positive, check_fields, instance, positive, row
from haptix.errors import InputError
from haptix.motion import HARDEST_N, LIFTED_BELOW_N
from haptix.touch.events import LARGEST_AREA_M2, LEAST_AREA_M2

ForceSource = Literal["axis", "area", "assumed"]


class ForceEstimate(NamedTuple):
    """A normal force [N], its standard deviation [N], and where it comes from.

    Parameters
    ----------
    normal_force_n : float
    sigma_n : float
        Its standard deviation [N].
    source : str
        Where it comes from.
    """

    normal_force_n: float
    sigma_n: float
    source: ForceSource


@dataclass(frozen=True)
class AreaProxy:
    """Force from contact area by a power law: ``F = 1 N * (area / area_at_1n)^(1 / exponent)``.

    This inverts the law of the apparent area in `haptix.Finger`. What a touchscreen calls area
    differs from screen to screen, so calibrate with the screen and the finger at hand (`fit`).

    Parameters
    ----------
    area_at_1n_m2 : float
        Reported area under 1 N [m^2].
    exponent : float
        How area grows with force; some 0.15 to 0.7 for fingertips.
    log_sigma : float
        Standard deviation of ln F about the law: 0.3 is a factor of 1.35 either way.
    force_range_n : (float, float)
        Range of plausible forces; an area that gives a force outside it is not used.
    """

    area_at_1n_m2: Positive
    exponent: Positive
    log_sigma: float
    force_range_n: tuple[float, float] = (0.02, 10.0)

    def __post_init__(self) -> None:
        check_fields(self)
        low, high = self.force_range_n
        if not 0 < low < high < inf:
            raise InputError(
                f"force_range_n: expected (low, high) with 0 < low < high, got {low:g}, {high:g}"
            )
        if not 0 <= self.log_sigma <= 3:
            raise InputError(
                f"log_sigma: expected 0 to 3 (a factor of 20), got {self.log_sigma:g}; with a "
                "wider spread state a force instead (ForceModel.assumed_n)"
            )

    @classmethod
    def fit(cls, contact_area_m2: npt.ArrayLike, normal_force_n: npt.ArrayLike) -> Self:
        """Fit the law to pairs of reported area [m^2] and measured force [N], each of shape (n,).

        Least squares of ln F against ln area, so that the predicted force has the least spread.
        `log_sigma` is that of the residuals; `force_range_n` is half the smallest to twice the
        largest force given.

        Parameters
        ----------
        contact_area_m2 : array-like, shape (n,)
            Reported areas [m^2].
        normal_force_n : array-like, shape (n,)
            Measured forces [N].

        Raises
        ------
        InputError
            If there are fewer than 3 pairs, a value is not above 0, or force does not grow with
            area.

        Examples
        --------
        >>> law = AreaProxy.fit([5e-5, 1e-4, 2e-4], [0.25, 0.5, 1.0])
        >>> round(law.force(1e-4).normal_force_n, 6)
        0.5
        """
        area, force = row("contact_area_m2", contact_area_m2), row("normal_force_n", normal_force_n)
        if len(area) != len(force) or len(area) < 3:
            raise InputError(
                "area proxy: expected areas and forces of one length, 3 pairs or more, got "
                f"{len(area)} and {len(force)}"
            )
        for name, values in (("contact_area_m2", area), ("normal_force_n", force)):
            for i, value in enumerate(values.tolist(), 1):
                positive(f"area proxy: {name} of pair {i}", value)
        ln_area, ln_force = np.log(area), np.log(force)
        varies = float(np.ptp(ln_area)) > 0
        slope, offset = np.polyfit(ln_area, ln_force, 1).tolist() if varies else (0.0, 0.0)
        if slope <= 0:
            raise InputError(
                "area proxy: expected areas that grow with force; press with several forces, from "
                "light to firm"
            )
        residual = ln_force - slope * ln_area - offset
        return cls(
            area_at_1n_m2=exp(-offset / slope),
            exponent=1 / slope,
            log_sigma=sqrt(float(residual @ residual) / (len(area) - 2)),
            force_range_n=(float(force.min()) / 2, 2 * float(force.max())),
        )

    def force(self, contact_area_m2: float) -> ForceEstimate | None:
        """Median force and standard deviation (log-normal) for an area above 0.

        None where the force is outside `force_range_n`.

        Examples
        --------
        >>> law = AreaProxy.fit([5e-5, 1e-4, 2e-4], [0.25, 0.5, 1.0])
        >>> law.force(2e-4).normal_force_n > law.force(1e-4).normal_force_n
        True
        """
        ln_force = log(contact_area_m2 / self.area_at_1n_m2) / self.exponent
        low, high = self.force_range_n
        if not log(low) <= ln_force <= log(high):
            return None
        force = exp(ln_force)
        variance = self.log_sigma**2
        return ForceEstimate(force, force * exp(variance / 2) * sqrt(expm1(variance)), "area")


@dataclass(frozen=True)
class ForceModel:
    """Where a touch gets its force: from the force axis, else the area, else the assumption.

    Parameters
    ----------
    assumed_n, assumed_sigma_n : float
        Used where nothing is measured: a usual exploring force, and its spread among people.
    axis_sigma : float
        Standard deviation of a measured force, as a share of it.
    area_proxy : AreaProxy, optional
        Calibrated law; without it areas are not used.
    """

    assumed_n: Positive = 0.5
    assumed_sigma_n: NotNegative = 0.25
    axis_sigma: NotNegative = 0.05
    area_proxy: AreaProxy | None = None
    assumed: ForceEstimate = field(init=False, repr=False)

    def __post_init__(self) -> None:
        check_fields(self)
        if not LIFTED_BELOW_N <= self.assumed_n <= HARDEST_N:
            raise InputError(
                f"assumed_n: expected a finger's force, {LIFTED_BELOW_N:g} to {HARDEST_N:g} "
                f"N, got {self.assumed_n:g}"
            )
        if self.area_proxy is not None:
            instance("area_proxy", self.area_proxy, AreaProxy)
        assumed = ForceEstimate(self.assumed_n, self.assumed_sigma_n, "assumed")
        object.__setattr__(self, "assumed", assumed)

    def estimate(
        self, normal_force_n: float | None, contact_area_m2: float | None
    ) -> ForceEstimate | None:
        """Force of a report, or None if the report has neither a usable force nor a usable area.

        Parameters
        ----------
        normal_force_n : float or None
            Force [N] in the report.
        contact_area_m2 : float or None
            Contact area [m^2] in the report.
        """
        if normal_force_n is not None and _usable(normal_force_n, LIFTED_BELOW_N, HARDEST_N):
            force = float(normal_force_n)
            return ForceEstimate(force, self.axis_sigma * force, "axis")
        if (
            self.area_proxy is not None
            and contact_area_m2 is not None
            and _usable(contact_area_m2, LEAST_AREA_M2, LARGEST_AREA_M2)
        ):
            return self.area_proxy.force(float(contact_area_m2))
        return None


def _usable(value: float, least: float, largest: float) -> bool:
    try:
        return bool(least <= value <= largest)
    except (TypeError, ValueError):
        return False
