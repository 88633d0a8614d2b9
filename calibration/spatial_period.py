"""The spatial period of a signal along a stroke: its significance, and which harmonic it is."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from scipy.ndimage import median_filter
from scipy.stats import f as fisher

from calibration.parameters import Array
from calibration.segmentation import full_slip
from haptix.errors import InputError
from haptix.report import Heading

_MOST_HARMONIC = 8
_FEWEST_PERIODS = 4  # in a segment
_FINE = 20  # steps of a resolution: the parabola through the peak is exact to 1e-3 of it
_LINE = 2.0  # resolutions: half the width of a line under a Hann window
_BACKGROUND = 12.0  # resolutions either side over which the median of the power is taken
_MEDIAN_SHARE = 0.9  # median over mean of a sum over some channels


@dataclass(frozen=True)
class SpatialPeriod:
    """The strongest period of a range, and what it is a harmonic of.

    Parameters
    ----------
    period_mm : float
        The strongest line between the shortest and the longest period asked for.
    power_over_background : float
        Its power over that of the noise beside it.
    false_alarm_probability : float
        Of a line as strong anywhere in the range without any period: the noise in the range, over
        its running median, taken as an F distribution. Where the line is a harmonic, it is that of
        the fundamental.
    harmonic : int
        1 where no longer period is stronger; n where the line at n times the period is.
    fundamental_mm : float
        The period of that line.
    """

    period_mm: float
    power_over_background: float
    false_alarm_probability: float
    harmonic: int
    fundamental_mm: float

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


def spatial_period(
    t_s: Array,
    x_mm: Array,
    signals: Array,
    shortest_mm: float = 1.0,
    longest_mm: float = 6.0,
    normal_force_n: Array | None = None,
) -> SpatialPeriod:
    """Find the spatial period [mm] of signals along a stroke, over the parts of full slip.

    Parameters
    ----------
    t_s, x_mm, normal_force_n : array, shape (samples,)
        As for `full_slip`.
    signals : array, shape (samples,) or (samples, channels)
        Signals of any sensor that touches the surface; each channel is scaled to unit variance.
    shortest_mm, longest_mm : float
        Range of periods. Longer ones are looked at to tell the harmonic, as far as four of them
        fit into the stroke.

    Raises
    ------
    InputError
        If nothing slides for four of the longest periods.
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
        turn = np.exp(-2j * np.pi * waves[:, None] * x)
        power += (np.abs(turn @ (y * window[:, None])) ** 2).sum(-1)
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
