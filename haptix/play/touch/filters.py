"""Filters of a touch's place, which smooth its reports and predict its path."""

from __future__ import annotations

from abc import ABC, abstractmethod
from math import exp, expm1, hypot, log, tau
from typing import Annotated, NamedTuple, Self

from pydantic import Field

from haptix.base.checks import NotNegative, Positive, checked

_Share = Annotated[Positive, Field(lt=1)]

FilterState = tuple[float, ...]
"""t [s], x, y [mm], vx, vy [mm/s]; then numbers that only the filter uses."""


class Course(NamedTuple):
    """A path from a report on, whose acceleration decays; names hold the units."""

    x_mm: float
    y_mm: float
    vx_mm_s: float
    vy_mm_s: float
    ax_mm_s2: float
    ay_mm_s2: float
    lasting_s: float
    """Time in which the acceleration falls to 1/e."""


class PlaceFilter(ABC):
    """A filter whose state is an immutable tuple, so that steps can be undone."""

    @abstractmethod
    def start(self, t_s: float, x_mm: float, y_mm: float) -> FilterState:
        """State after the first report.

        Parameters
        ----------
        t_s : float
        x_mm, y_mm : float
        """

    @abstractmethod
    def step(self, state: FilterState, t_s: float, x_mm: float, y_mm: float) -> FilterState:
        """State after a report at `t_s`, which is not before that of `state`.

        Parameters
        ----------
        state : FilterState
            State after the report before.
        t_s : float
            Time of this report [s], not before that of `state`.
        x_mm, y_mm : float
        """

    def course(self, state: FilterState) -> Course:
        """Return the predicted path; here at constant velocity."""
        return Course._make((*state[1:5], 0.0, 0.0, 1.0))

    def ahead(self, state: FilterState, ahead_s: float) -> tuple[float, float, float, float]:
        """Place and velocity `ahead_s` after the state's report, or before it if below 0.

        Parameters
        ----------
        state : FilterState
            State after a report.
        ahead_s : float
            Time from that report [s]; below 0 is before it.
        """
        x, y, vx, vy, ax, ay, lasting_s = self.course(state)
        to_speed = -lasting_s * expm1(-ahead_s / lasting_s)
        to_place = lasting_s * (ahead_s - to_speed)
        return (
            x + vx * ahead_s + ax * to_place, y + vy * ahead_s + ay * to_place,
            vx + ax * to_speed, vy + ay * to_speed,
        )  # fmt: skip


@checked()
class ConstantVelocityKalman(PlaceFilter):
    """Velocity driven by white acceleration noise; both axes alike and independent.

    The discretised continuous-time model, so intervals may be irregular: over dt the covariance
    grows by ``q [[dt^3/3, dt^2/2], [dt^2/2, dt]]`` (Bar-Shalom, Li and Kirubarajan, *Estimation
    with Applications to Tracking and Navigation*, 2001, section 6.2.2). Because both axes are
    alike, one covariance serves them, and turning the screen turns the result. The rest of the
    state is that covariance: place with place, place with velocity, velocity with velocity.

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

    def start(self, t_s: float, x_mm: float, y_mm: float) -> FilterState:
        """State after the first report."""
        return (
            t_s, x_mm, y_mm, 0.0, 0.0, self.position_noise_mm**2, 0.0, self.first_speed_mm_s**2,
        )  # fmt: skip

    def step(self, state: FilterState, t_s: float, x_mm: float, y_mm: float) -> FilterState:
        """State after a report at `t_s`, which is not before that of `state`."""
        t0, x, y, vx, vy, place, both, speed = state
        q = self.acceleration_psd
        noise = self.position_noise_mm * self.position_noise_mm
        dt = t_s - t0
        grown = q * dt
        cross = both + dt * (speed + 0.5 * grown)
        place += dt * (both + both + dt * (speed + grown / 3.0))
        speed += grown
        total = place + noise
        gain = place / total
        gain_speed = cross / total
        x += vx * dt
        y += vy * dt
        dx = x_mm - x
        dy = y_mm - y
        speed -= gain_speed * cross
        return (
            t_s, x + gain * dx, y + gain * dy, vx + gain_speed * dx, vy + gain_speed * dy,
            noise * gain, noise * gain_speed, speed if speed > 0.0 else 0.0,
        )  # fmt: skip


@checked()
class OneEuroFilter(PlaceFilter):
    """A low pass whose cut-off rises with speed (Casiez, Roussel and Vogel, CHI 2012).

    As published, ``dx = (x - filtered x before) / dt`` is smoothed with a constant cut-off, and the
    place with ``min_cutoff + beta * speed``. Two choices are ours. The speed is that of both axes
    together, so that turning the screen turns the result. And since dx over-estimates the velocity
    by ``1 / alpha``, where alpha is the weight of the newest report, the velocity given here is
    alpha times the smoothed dx: that of the filtered place. The rest is the smoothed dx, dy.

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
    >>> smooth = OneEuroFilter()
    >>> state = smooth.step(smooth.start(0.0, 0.0, 0.0), 0.01, 1.0, 0.0)
    >>> 0.0 < state[1] < 1.0  # x [mm] follows with delay
    True
    """

    min_cutoff_hz: Positive = 5.0
    beta_per_mm: NotNegative = 1.0
    derivative_cutoff_hz: Positive = 36.0

    def start(self, t_s: float, x_mm: float, y_mm: float) -> FilterState:
        """State after the first report."""
        return (t_s, x_mm, y_mm, 0.0, 0.0, 0.0, 0.0)

    def step(self, state: FilterState, t_s: float, x_mm: float, y_mm: float) -> FilterState:
        """State after a report at `t_s`, which is not before that of `state`."""
        t0, x, y, _, _, sx, sy = state
        dt = t_s - t0
        if dt <= 0.0:
            return state
        # alpha = 1 / (1 + tau / dt) with tau = 1 / (2 pi cutoff), and alpha / dt without 0 / 0.
        turns = tau * dt * self.derivative_cutoff_hz
        weight = turns / (1.0 + turns)
        dx = x_mm - x
        dy = y_mm - y
        sx += weight * (dx / dt - sx)
        sy += weight * (dy / dt - sy)
        turns = tau * dt * (self.min_cutoff_hz + self.beta_per_mm * hypot(sx, sy))
        weight = turns / (1.0 + turns)
        return (t_s, x + weight * dx, y + weight * dy, weight * sx, weight * sy, sx, sy)


_ASSUMED_REPORTS = 6.0  # number of reports that the assumed noise of a panel stands for
_LEAST_NOISE_MM = 0.01  # a tenth of the resolution of capacitive panels
_LONGEST_S = 0.1  # longest duration of five reports from which noise is estimated
_FIVE_REPORTS = 15  # numbers of five reports
_LEAST_WEIGHT = 0.001  # of a model, so that it can regain weight within a few reports


class _Interval(NamedTuple):
    """The transition over an interval, see `SingerKalman`."""

    dt: float
    left: float
    to_speed: float
    to_place: float

    @classmethod
    def of(cls, dt: float, tau: float) -> Self:
        left = exp(-dt / tau)
        to_speed = tau * (1.0 - left)
        return cls(dt, left, to_speed, tau * (dt - to_speed))


@checked()
class SingerKalman(PlaceFilter):
    """Acceleration as a first-order Markov process (Singer, IEEE Trans. AES-6, 473, 1970).

    A finger turns and brakes over tenths of a second, so that its acceleration is worth estimating.
    The prediction lets it decay: after h the place is
    ``x + v h + a tau^2 (exp(-h/tau) - 1 + h/tau)``. The transition is Singer's. The noise of an
    interval is that of intervals much shorter than `correlation_s`. Both axes are alike and
    independent. The rest of the state is ax, ay [mm/s^2], the covariance of each axis, and the
    estimate of the reports' noise.

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

    def start(self, t_s: float, x_mm: float, y_mm: float) -> FilterState:
        """State after the first report."""
        return (
            t_s, x_mm, y_mm, 0.0, 0.0, 0.0, 0.0, self.position_noise_mm**2, 0.0, 0.0,
            self.first_speed_mm_s**2, 0.0, self.acceleration_mm_s2**2,
            self.position_noise_mm**2, _ASSUMED_REPORTS, t_s, x_mm, y_mm,
        )  # fmt: skip

    def step(self, state: FilterState, t_s: float, x_mm: float, y_mm: float) -> FilterState:
        """State after a report at `t_s`, which is not before that of `state`."""
        interval = _Interval.of(t_s - state[0], self.correlation_s)
        variance, reports, recent = self._noise_with(
            state[13], state[14], state[15:], (t_s, x_mm, y_mm)
        )
        moved, _ = self._moved(state[1:13], interval, 1.0, variance, x_mm, y_mm)
        return (t_s, *moved, variance, reports, *recent)

    def _noise_with(
        self,
        variance: float,
        reports: float,
        before: tuple[float, ...],
        report: tuple[float, float, float],
    ) -> tuple[float, float, tuple[float, ...]]:
        """Return the variance of a report, the number of reports it rests on, and the last ones."""
        recent = (*before, *report)
        if len(recent) < _FIVE_REPORTS:
            return variance, reports, recent
        if self.noise_reports and (newest := _noise(recent)) is not None:
            reports = min(reports + 1.0, self.noise_reports)
            variance = max(variance + (newest - variance) / reports, _LEAST_NOISE_MM**2)
        return variance, reports, recent[3:]

    def _moved(
        self,
        model: tuple[float, ...],
        interval: _Interval,
        share: float,
        variance: float,
        x_mm: float,
        y_mm: float,
    ) -> tuple[tuple[float, ...], float]:
        """Return mean and covariance after a report, and the logarithm of its likelihood.

        The deviation of the acceleration is a `share` of the filter's.
        """
        x, y, vx, vy, ax, ay, pxx, pxv, pxa, pvv, pva, paa = model
        dt, left, to_speed, to_place = interval
        jerk = share * (self.acceleration_mm_s2 + self.acceleration_per_speed_hz * hypot(vx, vy))
        jerk *= 2.0 * jerk / self.correlation_s  # its power spectral density
        # P <- F P F^T + Q, with F = [[1, dt, to_place], [0, 1, to_speed], [0, 0, left]].
        xa = pxa + dt * pva + to_place * paa
        xv = pxv + dt * pvv + to_place * pva
        va = pva + to_speed * paa
        noise = jerk * dt * dt
        pxx += dt * pxv + to_place * pxa + dt * xv + to_place * xa + noise * dt * dt * dt * 0.05
        pxv = xv + to_speed * xa + noise * dt * dt * 0.125
        pvv += to_speed * (pva + va) + noise * dt / 3.0
        pxa = left * xa + noise * dt / 6.0
        pva = left * va + noise * 0.5
        paa = left * left * paa + jerk * dt
        total = pxx + variance
        gain_x = pxx / total
        gain_v = pxv / total
        gain_a = pxa / total
        x += vx * dt + ax * to_place
        y += vy * dt + ay * to_place
        dx = x_mm - x
        dy = y_mm - y
        pvv -= gain_v * pxv
        paa -= gain_a * pxa
        return (
            x + gain_x * dx, y + gain_x * dy,
            vx + ax * to_speed + gain_v * dx, vy + ay * to_speed + gain_v * dy,
            left * ax + gain_a * dx, left * ay + gain_a * dy,
            variance * gain_x, variance * gain_v, variance * gain_a,
            pvv if pvv > 0.0 else 0.0, pva - gain_v * pxa, paa if paa > 0.0 else 0.0,
        ), -0.5 * (dx * dx + dy * dy) / total - log(total)  # fmt: skip

    def course(self, state: FilterState) -> Course:
        """Return the predicted path, with an acceleration that decays."""
        return Course._make((*state[1:7], self.correlation_s))


@checked()
class InteractingSinger(SingerKalman):
    """Two Singer filters, for a gentle and an agile hand, weighted by their likelihood.

    A hand that follows a texture moves evenly for most of the time and turns in between. A single
    filter that keeps up with the turns follows the panel's noise in between. Here one of two
    filters lets the acceleration vary less, and the place is their mean, weighted by the likelihood
    of each (interacting multiple models: Blom and Bar-Shalom, IEEE Trans. Autom. Control 33, 780,
    1988). After the reports' noise the state has the weight of the gentle filter, and mean and
    covariance of each filter.

    Parameters
    ----------
    gentle : float
        Share of the acceleration's deviation that the gentle one has.
    stay : float
        Probability that the hand goes on as it did, from one report to the next.
    """

    gentle: _Share = 0.25
    stay: _Share = 0.97

    def start(self, t_s: float, x_mm: float, y_mm: float) -> FilterState:
        """State after the first report."""
        singer = super().start(t_s, x_mm, y_mm)
        still = (*singer[1:12], (self.gentle * self.acceleration_mm_s2) ** 2)
        return (*singer[:15], 0.5, *still, *singer[1:13], *singer[15:])

    def step(self, state: FilterState, t_s: float, x_mm: float, y_mm: float) -> FilterState:
        """State after a report at `t_s`, which is not before that of `state`."""
        interval = _Interval.of(t_s - state[0], self.correlation_s)
        variance, reports, recent = self._noise_with(
            state[13], state[14], state[40:], (t_s, x_mm, y_mm)
        )
        weight, gentle, agile = state[15], state[16:28], state[28:40]
        before = self.stay * weight + (1.0 - self.stay) * (1.0 - weight)
        mixed = (
            _mixed(self.stay * weight / before, gentle, agile),
            _mixed((1.0 - self.stay) * weight / (1.0 - before), gentle, agile),
        )
        (gentle, likely), (agile, other) = (
            self._moved(model, interval, share, variance, x_mm, y_mm)
            for model, share in zip(mixed, (self.gentle, 1.0), strict=True)
        )
        odds = (1.0 - before) / before * exp(min(max(other - likely, -50.0), 50.0))
        weight = min(max(1.0 / (1.0 + odds), _LEAST_WEIGHT), 1.0 - _LEAST_WEIGHT)
        mean = _mixed(weight, gentle, agile)
        return (t_s, *mean, variance, reports, weight, *gentle, *agile, *recent)


def _mixed(weight: float, first: tuple[float, ...], second: tuple[float, ...]) -> tuple[float, ...]:
    """Return mean and covariance of a mixture of two models; the first has the weight."""
    rest = 1.0 - weight
    x, y, vx, vy, ax, ay, xx, xv, xa, vv, va, aa = first
    x1, y1, vx1, vy1, ax1, ay1, xx1, xv1, xa1, vv1, va1, aa1 = second
    x1 -= x
    y1 -= y
    vx1 -= vx
    vy1 -= vy
    ax1 -= ax
    ay1 -= ay
    # Both axes share one covariance, so that their spread is the mean over the axes.
    half = 0.5 * weight * rest
    return (
        x + rest * x1, y + rest * y1, vx + rest * vx1, vy + rest * vy1,
        ax + rest * ax1, ay + rest * ay1,
        weight * xx + rest * xx1 + half * (x1 * x1 + y1 * y1),
        weight * xv + rest * xv1 + half * (x1 * vx1 + y1 * vy1),
        weight * xa + rest * xa1 + half * (x1 * ax1 + y1 * ay1),
        weight * vv + rest * vv1 + half * (vx1 * vx1 + vy1 * vy1),
        weight * va + rest * va1 + half * (vx1 * ax1 + vy1 * ay1),
        weight * aa + rest * aa1 + half * (ax1 * ax1 + ay1 * ay1),
    )  # fmt: skip


def _noise(recent: tuple[float, ...]) -> float | None:
    """Variance of a report along each axis [mm^2], from five reports; None if it is not known."""
    t0, x0, y0, t1, x1, y1, t2, x2, y2, t3, x3, y3, t4, x4, y4 = recent
    if t4 - t0 > _LONGEST_S or (x0 == x1 == x2 == x3 == x4 and y0 == y1 == y2 == y3 == y4):
        return None  # too long for a path to be a cubic, or at rest within the resolution
    # Lagrange's weights of the cubic at t2.
    a0, a1, a3, a4 = t2 - t0, t2 - t1, t2 - t3, t2 - t4
    w0 = a1 * a3 * a4 / ((t0 - t1) * (t0 - t3) * (t0 - t4))
    w1 = a0 * a3 * a4 / ((t1 - t0) * (t1 - t3) * (t1 - t4))
    w3 = a0 * a1 * a4 / ((t3 - t0) * (t3 - t1) * (t3 - t4))
    w4 = a0 * a1 * a3 / ((t4 - t0) * (t4 - t1) * (t4 - t3))
    dx = x2 - (w0 * x0 + w1 * x1 + w3 * x3 + w4 * x4)
    dy = y2 - (w0 * y0 + w1 * y1 + w3 * y3 + w4 * y4)
    return (dx * dx + dy * dy) / (2.0 * (1.0 + w0 * w0 + w1 * w1 + w3 * w3 + w4 * w4))
