"""Segments of full slip in a recording, and the spatial period of a signal along them."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Annotated

import numpy as np
from scipy.ndimage import median_filter, uniform_filter1d
from scipy.stats import f as fisher

from calibration.plan.parameters import Array
from haptix.base.errors import InputError
from haptix.base.report import Heading

SETTLING_MM = 4.0
"""Distance after each start that is left out: a fingertip first rolls and slips in part."""
STOPPING_MM = 1.5
"""Distance before each stop that is left out."""

_SMOOTHING_S = 0.02
_MOVING = 0.5  # of the usual speed; slower counts as starting and stopping
_TOUCHING = 0.4  # of the usual normal force
_PRESSED = 0.03  # of the largest force: strokes of 0.1 and of 0.9 N are in one file
_LIFT_S, _TOUCH_S = 0.15, 0.3


@dataclass(frozen=True)
class Segment:
    """Samples ``start`` to ``stop`` (not included), sliding towards `direction` (+1 or -1)."""

    start: int
    stop: int
    direction: int

    @property
    def samples(self) -> slice:
        """Return the samples."""
        return slice(self.start, self.stop)


def sliding_speed(t_s: Array, x_mm: Array) -> Array:
    """Velocity [mm/s], signed, shape (samples,): slope of a straight line through 20 ms.

    In slowly sampled recordings the line goes through three samples.
    """
    step = float(np.median(np.diff(t_s)))
    if not step > 0:
        raise InputError("t_s: expected times that increase")
    half = min(max(1, round(_SMOOTHING_S / step / 2)), len(t_s) - 1)
    # From the mean, so that large times do not cost digits.
    t, x = (
        np.pad(values - values.mean(), half, mode="reflect", reflect_type="odd")
        for values in (t_s, x_mm)
    )

    def mean(values: Array) -> Array:
        return np.asarray(uniform_filter1d(values, 2 * half + 1))[half:-half]

    covariance = mean(t * x) - mean(t) * mean(x)
    variance = mean(t * t) - mean(t) ** 2
    return np.asarray(covariance / np.maximum(variance, 1e-30))


def position_at_speed(
    t_s: Array, normal_force_n: Array, tangential_force_n: Array, speed_mm_per_s: float
) -> Array:
    """Position [mm], shape (samples,), of a finger that slides at a known speed.

    It slides where it presses and the tangential force, without its untouched level, is above half
    of its usual size; towards the side to which that force points.
    """
    zero = float(np.percentile(normal_force_n, 5))
    usual = float(np.percentile(normal_force_n - zero, 75))
    pressed = normal_force_n - zero > _TOUCHING * usual
    if not pressed.any() or pressed.all():
        return np.zeros_like(t_s)
    step = float(np.median(np.diff(t_s)))
    width = max(1, round(_SMOOTHING_S / step)) if step > 0 else 1
    drag = uniform_filter1d(tangential_force_n - np.median(tangential_force_n[~pressed]), width)
    slides = pressed & (np.abs(drag) > 0.5 * np.percentile(np.abs(drag[pressed]), 75))
    velocity = np.where(slides, np.sign(drag) * speed_mm_per_s, 0.0)
    return np.concatenate([[0.0], np.cumsum(velocity[:-1] * np.diff(t_s))])


def touches(t_s: Array, normal_force_n: Array) -> list[tuple[int, int]]:
    """Find the touches of a recording: first and last sample (not included) of each.

    They meet in the middle between two touches. A lift of less than 0.15 s is none, nor is a touch
    of less than 0.3 s.
    """
    lasts = float(t_s[-1] - t_s[0])
    per_s = len(t_s) / lasts if lasts > 0 else 1.0
    smooth = uniform_filter1d(normal_force_n, max(1, round(_SMOOTHING_S * per_s)))
    idle = smooth[smooth <= np.percentile(smooth, 20)]
    zero = float(np.median(idle))
    noise = 1.4826 * float(np.median(np.abs(idle - zero)))
    pressed = smooth - zero > max(10 * noise, _PRESSED * (np.percentile(smooth, 95) - zero))
    edges = np.flatnonzero(np.diff(np.concatenate([[False], pressed, [False]]).astype(int)))
    parts: list[list[int]] = []
    for begin, end in edges.reshape(-1, 2).tolist():
        if parts and begin - parts[-1][1] < _LIFT_S * per_s:
            parts[-1][1] = end
        else:
            parts.append([begin, end])
    parts = [part for part in parts if part[1] - part[0] >= _TOUCH_S * per_s]
    middles = [(a[1] + b[0]) // 2 for a, b in pairwise(parts)]
    return [*pairwise([0, *middles, len(t_s)])] if parts else []


def full_slip(
    t_s: Array,
    x_mm: Array,
    normal_force_n: Array | None = None,
    settling_mm: float = SETTLING_MM,
    stopping_mm: float = STOPPING_MM,
) -> list[Segment]:
    """Find the parts in which the finger touches and the whole contact slides, in order of time.

    All arrays have shape (samples,). Without a normal force the finger is taken to touch
    throughout. `settling_mm` are left out after each start, `stopping_mm` before each stop.
    """
    speed = sliding_speed(t_s, x_mm)
    fast = np.abs(speed)
    if not np.ptp(x_mm) > 0:
        return []
    # The usual speed is the one at which most of the distance is covered.
    usual = float(np.sqrt((fast**3).sum() / max(fast.sum(), 1e-30)))
    good = fast > _MOVING * usual
    if normal_force_n is not None:
        usual_force = float(np.median(normal_force_n[good])) if good.any() else 0.0
        good &= normal_force_n > _TOUCHING * usual_force
    sign = np.where(good, np.sign(speed), 0).astype(int)
    edges = np.flatnonzero(np.diff(sign)) + 1
    segments = []
    for start, stop in zip([0, *edges], [*edges, len(sign)], strict=True):
        if sign[start] == 0:
            continue
        slid = np.abs(x_mm[start:stop] - x_mm[start])
        inside = start + np.flatnonzero((slid >= settling_mm) & (slid <= slid[-1] - stopping_mm))
        if len(inside) >= 8:
            segments.append(Segment(int(inside[0]), int(inside[-1]) + 1, int(sign[start])))
    return segments


_MOST_HARMONIC = 8
_FEWEST_PERIODS = 4  # in a segment
_FINE = 20  # steps of a resolution: the parabola through the peak is exact to 1e-3 of it
_LINE = 2.0  # resolutions: half the width of a line under a Hann window
_BACKGROUND = 12.0  # resolutions either side over which the median of the power is taken
_MEDIAN_SHARE = 0.9  # median over mean of a sum over some channels


@dataclass(frozen=True)
class SpatialPeriod:
    """The strongest period of a range, and the period of which it is a harmonic."""

    period_mm: float
    """The strongest line between the shortest and the longest period asked for."""
    power_over_background: float
    """Its power over that of the noise beside it."""
    false_alarm_probability: float
    """Of a line as strong anywhere in the range without any period: the noise in the range, over
    its running median, taken as an F distribution. Where the line is a harmonic, it is that of the
    fundamental."""
    harmonic: int
    """1 where no longer period is stronger; n where the line at n times the period is."""
    fundamental_mm: float
    """The period of that line."""

    @property
    def is_significant(self) -> Annotated[bool, Heading("significant")]:
        """Whether noise alone would give such a line in fewer than one of a hundred strokes."""
        return self.false_alarm_probability < 0.01

    @property
    def summary(self) -> Annotated[str, Heading("period")]:
        """One sentence."""
        sentence = f"{self.period_mm:.3f} mm"
        if self.harmonic > 1:
            sentence += f", harmonic {self.harmonic} of the stronger {self.fundamental_mm:.2f} mm"
        if not self.is_significant:
            chance = f"{self.false_alarm_probability:.2g}"
            sentence = f"no significant period; the strongest, by chance at {chance}, is {sentence}"
        return sentence


def _power(x_mm: Array, signals: Array, lowest: float, step: float, count: int) -> Array:
    """Power of all signals at `count` waves [1/mm] that are `step` apart, from `lowest`.

    A wave is one of few coarse ones and a rest, and its turn at a place the product of both: all
    sums over the places are a product of two matrices, each of the root of `count` waves.
    """
    fine = np.arange(int(np.ceil(np.sqrt(count))))
    coarse = lowest + step * len(fine) * np.arange(-(-count // len(fine)))
    by_fine = np.exp(-2j * np.pi * x_mm[:, None] * (step * fine))
    by_coarse = np.exp(-2j * np.pi * coarse[:, None] * x_mm)
    found = np.zeros(count)
    for signal in signals.T:
        found += np.abs((by_coarse * signal) @ by_fine).ravel()[:count] ** 2
    return found


def spatial_period(
    t_s: Array,
    x_mm: Array,
    signals: Array,
    shortest_mm: float = 1.0,
    longest_mm: float = 6.0,
    normal_force_n: Array | None = None,
) -> SpatialPeriod:
    """Find the spatial period [mm] of signals along a stroke, over the parts of full slip.

    Raises `InputError` if nothing slides for four of the longest periods.

    Parameters
    ----------
    t_s, x_mm, normal_force_n : array, shape (samples,)
        As for `full_slip`.
    signals : array, shape (samples,) or (samples, channels)
        Signals of any sensor that touches the surface; each channel is scaled to unit variance.
    shortest_mm, longest_mm : float
        Range of periods. Longer ones are looked at to tell the harmonic, as far as four of them
        fit into the stroke.
    """
    if not 0 < shortest_mm < longest_mm:
        raise InputError("expected 0 < shortest_mm < longest_mm")
    columns = signals[:, None] if signals.ndim == 1 else signals
    segments = full_slip(t_s, x_mm, normal_force_n)
    longest = max((float(np.ptp(x_mm[s.samples])) for s in segments), default=0.0)
    needed = _FEWEST_PERIODS * longest_mm
    if longest < needed:
        raise InputError(
            f"expected a stroke that slides for {needed:g} mm or more, got {longest:.3g} mm"
        )
    long_enough = [s for s in segments if np.ptp(x_mm[s.samples]) >= needed]
    # Sampled more coarsely than half a period, a wave would look like another one.
    apart = max(float(np.median(np.abs(np.diff(x_mm[s.samples])))) for s in long_enough)
    shortest_mm = min(max(shortest_mm, 2.2 * apart), longest_mm / 2)
    step = 1 / longest / _FINE
    lowest = min(_FEWEST_PERIODS / longest, 1 / longest_mm)
    waves = np.arange(lowest, 1 / shortest_mm, step)
    power = np.zeros(len(waves))
    for segment in long_enough:
        x = x_mm[segment.samples]
        scaled = 2 * (x - x.min()) / np.ptp(x) - 1
        trend = np.polynomial.chebyshev.chebvander(scaled, 5)
        y = columns[segment.samples]
        y = y - trend @ np.linalg.lstsq(trend, y, rcond=None)[0]
        spread = y.std(0)
        y = y[:, spread > 0] / spread[spread > 0]
        window = 0.5 * (1 + np.cos(np.pi * scaled))
        power += _power(x, y * window[:, None], lowest, step, len(waves))
    # Bins of half a resolution are enough for the background.
    coarse = slice(None, None, _FINE // 2)
    width = 2 * round(2 * _BACKGROUND) + 1
    median = median_filter(power[coarse], width, mode="nearest") / _MEDIAN_SHARE
    over = power / np.maximum(np.interp(waves, waves[coarse], median), 1e-300)
    in_range = waves >= 1 / longest_mm
    peak = int(np.flatnonzero(in_range)[power[in_range].argmax()])
    strongest = (_refined(waves, power, peak), float(over[peak]))
    harmonic, fundamental = 1, strongest
    for number in range(2, _MOST_HARMONIC + 1):
        near = np.abs(waves - strongest[0] / number) < _LINE / longest / 2
        if strongest[0] / number < waves[0] or not near.any():
            break
        at = int(np.flatnonzero(near)[power[near].argmax()])
        if 0 < at < len(waves) - 1 and over[at] > fundamental[1]:
            harmonic, fundamental = number, (_refined(waves, power, at), float(over[at]))
    beside = in_range[coarse] & (np.abs(waves[coarse] - strongest[0]) > _LINE / longest)
    return SpatialPeriod(
        1 / strongest[0],
        strongest[1],
        _false_alarm(fundamental[1], over[coarse][beside]),
        harmonic,
        1 / fundamental[0],
    )


def _refined(waves: Array, power: Array, peak: int) -> float:
    """Wave number [1/mm] of a peak, by a parabola through three points."""
    peak = int(np.clip(peak, 1, len(waves) - 2))
    low, middle, high = power[peak - 1 : peak + 2]
    bend = low - 2 * middle + high
    shift = 0.5 * (low - high) / bend if bend < 0 else 0.0
    return float(waves[peak] + shift * (waves[1] - waves[0]))


def _false_alarm(ratio: float, noise: Array) -> float:
    """Probability that the largest of the noise's bins exceeds a ratio."""
    if len(noise) < 8 or not noise.std() > 0:
        return 1.0
    mean = float(noise.mean())
    freedom = 2 * (mean / float(noise.std())) ** 2
    # The background is a median of some bins: as good as the mean of two thirds of those that a
    # Hann window leaves independent.
    each = float(fisher.sf(ratio / mean, freedom, freedom * _BACKGROUND * 2 / 1.5 * 0.6))
    return float(-np.expm1(len(noise) * np.log1p(-min(each, 1 - 1e-12))))
