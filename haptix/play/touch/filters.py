"""Filters of a touch's place, which smooth its reports and predict its path.

`haptix/base/native/haptix_touch.c` computes them.
"""

from __future__ import annotations

from dataclasses import astuple
from typing import Annotated, Any

from pydantic import Field

from haptix.base.checks import NotNegative, Positive, checked

_Share = Annotated[Positive, Field(lt=1)]


class PlaceFilter:
    """A filter of a touch's place: one of the four below."""

    @property
    def compiled(self) -> tuple[int, tuple[float, ...]]:
        """Its number in the library in C, and its parameters."""
        from haptix.base.native import library  # late: the service has words for its lack

        return getattr(library, _NAMES[type(self)]), astuple(self)  # type: ignore[call-overload]


@checked()
class ConstantVelocityKalman(PlaceFilter):
    """Velocity driven by white acceleration noise; both axes alike and independent.

    The discretised continuous-time model, so intervals may be irregular: over dt the covariance
    grows by ``q [[dt^3/3, dt^2/2], [dt^2/2, dt]]`` (Bar-Shalom, Li and Kirubarajan, *Estimation
    with Applications to Tracking and Navigation*, 2001, section 6.2.2). Because both axes are
    alike, one covariance serves them, and turning the screen turns the result.

    Parameters
    ----------
    acceleration_psd : float
        q, the power spectral density of the acceleration [mm^2/s^3]: the velocity wanders by
        sqrt(q dt) mm/s in dt.
    position_noise_mm : float
        Standard deviation of a report along each axis.
    first_speed_mm_s : float
        Standard deviation of the velocity, along each axis, of a finger that has just come down.
    """

    acceleration_psd: Positive = 2e4
    position_noise_mm: Positive = 0.1
    first_speed_mm_s: Positive = 60.0


@checked()
class OneEuroFilter(PlaceFilter):
    """A low pass whose cut-off rises with speed (Casiez, Roussel and Vogel, CHI 2012).

    As published, ``dx = (x - filtered x before) / dt`` is smoothed with a constant cut-off, and the
    place with ``min_cutoff + beta * speed``. Two choices are ours. The speed is that of both axes
    together, so that turning the screen turns the result. And since dx over-estimates the velocity
    by ``1 / alpha``, where alpha is the weight of the newest report, the velocity given here is
    alpha times the smoothed dx: that of the filtered place.

    Parameters
    ----------
    min_cutoff_hz : float
        Cut-off for a finger at rest.
    beta_per_mm : float
        Rise of the cut-off [Hz] per speed [mm/s].
    derivative_cutoff_hz : float
        Cut-off for dx.

    Examples
    --------
    >>> OneEuroFilter(min_cutoff_hz=2.0).beta_per_mm
    1.0
    """

    min_cutoff_hz: Positive = 5.0
    beta_per_mm: NotNegative = 1.0
    derivative_cutoff_hz: Positive = 36.0


@checked()
class SingerKalman(PlaceFilter):
    """Acceleration as a first-order Markov process (Singer, IEEE Trans. AES-6, 473, 1970).

    A finger turns and brakes over tenths of a second, so that its acceleration is worth estimating.
    The prediction lets it decay: after h the place is
    ``x + v h + a tau^2 (exp(-h/tau) - 1 + h/tau)``. The transition is Singer's. The noise of an
    interval is that of intervals much shorter than `correlation_s`. Both axes are alike and
    independent.

    Panels differ in their noise, and a filter that assumes too much noise lags. So the noise is
    estimated from the distance of each report to the cubic through the two reports before and the
    two after it. A finger's path differs from such a cubic by a few micrometres in 40 ms.

    Parameters
    ----------
    acceleration_mm_s2 : float
        Standard deviation of the acceleration along each axis of a finger at rest.
    acceleration_per_speed_hz : float
        Growth of that deviation [mm/s^2] per speed [mm/s], as fast fingers turn in the same time as
        slow ones. At 0 the filter is linear, as published.
    correlation_s : float
        tau: after it 1/e of an acceleration is left.
    position_noise_mm : float
        Standard deviation of a report along each axis, until it is estimated.
    first_speed_mm_s : float
        Standard deviation of the velocity, along each axis, of a finger that has just come down.
    noise_reports : float
        Reports over which the noise is estimated; at 0 it stays `position_noise_mm`.
    """

    acceleration_mm_s2: Positive = 200.0
    acceleration_per_speed_hz: NotNegative = 3.0
    correlation_s: Positive = 0.3
    position_noise_mm: Positive = 0.1
    first_speed_mm_s: Positive = 60.0
    noise_reports: NotNegative = 30.0


@checked()
class InteractingSinger(SingerKalman):
    """Two Singer filters, for a gentle and an agile hand, weighted by their likelihood.

    A hand that follows a texture moves evenly for most of the time and turns in between. A single
    filter that keeps up with the turns follows the panel's noise in between. Here one of two
    filters lets the acceleration vary less, and the place is their mean, weighted by the likelihood
    of each (interacting multiple models: Blom and Bar-Shalom, IEEE Trans. Autom. Control 33, 780,
    1988).

    Parameters
    ----------
    gentle : float
        Share of the acceleration's deviation that the gentle one has.
    stay : float
        Probability that the hand goes on as it did, from one report to the next.
    """

    gentle: _Share = 0.25
    stay: _Share = 0.97


_NAMES: dict[Any, str] = {
    InteractingSinger: "HX_TWO_SINGERS",
    SingerKalman: "HX_SINGER",
    ConstantVelocityKalman: "HX_WHITE_ACCELERATION",
    OneEuroFilter: "HX_ONE_EURO",
}
FILTERS = tuple(_NAMES)
"""The filters that there are."""
