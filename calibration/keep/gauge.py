"""A rig over days and panels: its control chart, and its share of the measured variance.

The chart scores each value by those before it (a Q chart; Quesenberry, J. Qual. Technol. 23, 213
(1991)) and averages the scores (EWMA; Lucas & Saccucci, Technometrics 32, 1 (1990)), so that its
rates do not depend on how many values set its limits. The gauge study is an analysis of variance of
crossed random factors (AIAG, Measurement Systems Analysis, 4th edition).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from math import isnan, nan, sqrt
from typing import Annotated, Literal

import numpy as np
from scipy.special import ndtr, ndtri, stdtr, stdtrit
from scipy.stats import f as fisher
from scipy.stats import linregress

from calibration.plan.parameters import Array
from haptix.base.errors import InputError
from haptix.base.report import Heading

BASELINE = 20
"""Values at the beginning of a chart that set its limits."""

FEWEST = 5
"""Values from which a chart has limits."""

RULES = (
    "beyond: a value further from those before it than in 1 of 370 (3 standard deviations of many)",
    "shift: the weighted mean of the scores, the last with 0.2, beyond 3.2 of its deviations",
)
"""When a chart says to stop and look."""

RATES = (
    "of quiet charts one in eight alarms within 40 values; a step of 5 standard deviations is seen "
    "at once in 9 of 10 after 20 values and in 7 of 10 after 10; one of 2 deviations after some 4 "
    "values, one of 1 after some 13"
)
"""How often the rules alarm, by simulation (tests/calibration/test_over_days.py)."""

_BEYOND, _SHIFTED, _LATEST = 3.0, 3.2, 0.2
_POOLED = 0.25  # probability above which an interaction counts as scatter (AIAG)
_LEVEL = 0.975
_LEAST_SD = 1e-12  # of values that are all alike


@dataclass(frozen=True)
class ControlChart:
    """Values of a check standard, in order of time, and their alarms."""

    values: tuple[float, ...]
    """In order of time."""
    middle: float
    low: float
    high: float
    """Mean of the first `BASELINE` before the last, and limits of the last; NaN for fewer than
    `FEWEST`."""
    drift: float
    """Change from the first value to the last, by a straight line."""
    drift_uncertainty: float
    """The true one is within it, either side, at 95 %."""
    findings: tuple[str, ...]
    """Why to stop and look at the last value; empty where there is no reason."""
    alarms: tuple[int, ...] = ()
    """Places of all values at which a rule spoke."""

    @classmethod
    def of(cls, values: Sequence[float]) -> ControlChart:
        """Chart values in order of time."""
        if len(values) < FEWEST:
            return cls(tuple(values), nan, nan, nan, nan, nan, ())
        column = np.array(values, dtype=float)
        alarms, alerts = [], list[str]()
        mean = variance = 0.0
        middle = low = high = nan
        for place in range(FEWEST - 1, len(column)):
            before = column[: min(place, BASELINE)]
            middle, free = float(before.mean()), len(before) - 1
            sd = max(float(before.std(ddof=1)) * sqrt(1 + 1 / len(before)), _LEAST_SD)
            off = (column[place] - middle) / sd
            score = -float(np.sign(off)) * float(ndtri(stdtr(free, -abs(off))))
            mean = (1 - _LATEST) * mean + _LATEST * score
            variance = (1 - _LATEST) ** 2 * variance + _LATEST**2
            half = -float(stdtrit(free, ndtr(-_BEYOND))) * sd
            low, high, alerts = middle - half, middle + half, []
            if not low <= column[place] <= high:
                alerts.append(
                    f"beyond: the last value, {column[place]:.3g}, is outside {low:.3g} to "
                    f"{high:.3g}"
                )
            if abs(mean) > _SHIFTED * sqrt(variance):
                way = "above" if mean > 0 else "below"
                alerts.append(f"shift: the last values lie {way} {middle:.3g}")
            if alerts:
                alarms.append(place)
        line = linregress(np.arange(len(column)), column)
        lasts = len(column) - 1
        drift = float(line.slope) * lasts
        unsure = float(stdtrit(len(column) - 2, _LEVEL) * line.stderr) * lasts
        return cls(tuple(values), middle, low, high, drift, unsure, tuple(alerts), tuple(alarms))

    @property
    def text(self) -> str:
        """One line for people."""
        if isnan(self.middle):
            return f"{len(self.values)} of {FEWEST} values that set the limits"
        if self.findings:
            return f"stop and look: {'; '.join(self.findings)}"
        return f"in control: {self.middle:.3g}, within {self.low:.3g} to {self.high:.3g}"


@dataclass(frozen=True)
class VarianceComponent:
    """Contribution of one factor, or of two together, to the variance of a value."""

    source: Annotated[str, Heading("source")]
    """Name of the factor, or "repeatability"."""
    squares: Annotated[float, Heading("sum of squares", ".4g")]
    """Sum of squares."""
    freedom: Annotated[int, Heading("degrees of freedom")]
    """Degrees of freedom."""
    sd: Annotated[float, Heading("standard deviation", ".4g")]
    """Standard deviation that it makes, in the unit of the values; 0 where none shows."""
    probability: Annotated[float, Heading("by chance", ".2g")]
    """That scatter alone makes as much; NaN of the repeatability."""
    share: Annotated[float, Heading("share of the variance", ".1%")]
    """Of the variance of all."""


@dataclass(frozen=True)
class GaugeStudy:
    """Components of the variance of measured values, the first factor being the measured parts.

    An interaction that scatter alone makes in a quarter of studies counts as scatter.
    """

    components: tuple[VarianceComponent, ...]
    part: str

    @classmethod
    def of(cls, values: Array, factors: Sequence[str]) -> GaugeStudy:
        """Analyse values of crossed factors.

        Raises `InputError` if a factor has one level, or there is nothing to tell scatter by.

        Parameters
        ----------
        values : array, shape (levels of each factor..., trials)
            Every level of each factor with each of the others, as often.
        factors : sequence of str
            Names of the factors: first the part, then operators, days.
        """
        sizes, count = values.shape[:-1], values.size
        if min(sizes, default=0) < 2 or values.shape[-1] < 1 or len(factors) != len(sizes):
            raise InputError(
                f"expected two levels or more of each of {', '.join(factors)}, got "
                f"{' x '.join(map(str, values.shape))} values"
            )
        axes = range(len(sizes))
        grand = values.mean()

        def mean_of(*kept: int) -> Array:
            others = tuple(axis for axis in range(values.ndim) if axis not in kept)
            return np.asarray(values.mean(axis=others, keepdims=True) - grand)

        rows: dict[tuple[int, ...], tuple[float, int]] = {}
        for axis in axes:
            share = count / sizes[axis]
            rows[(axis,)] = share * float((mean_of(axis) ** 2).sum()), sizes[axis] - 1
        for first, second in combinations(axes, 2):
            both = mean_of(first, second) - mean_of(first) - mean_of(second)
            share = count / (sizes[first] * sizes[second])
            freedom = (sizes[first] - 1) * (sizes[second] - 1)
            rows[(first, second)] = share * float((both**2).sum()), freedom
        total = float(((values - grand) ** 2).sum())
        left, freedom = total - sum(s for s, _ in rows.values()), count - 1
        freedom -= sum(n for _, n in rows.values())
        if freedom < 1:  # a single trial of two factors: their interaction is the scatter
            raise InputError("expected two trials or more of each, or a third factor")
        kept = {}
        for key, (squares, n) in rows.items():
            chance = float(fisher.sf(squares / n / (left / freedom), n, freedom))
            if len(key) == 2 and chance > _POOLED:
                continue
            kept[key] = squares, n
        scatter = total - sum(s for s, _ in kept.values())
        freedom = count - 1 - sum(n for _, n in kept.values())
        noise = scatter / freedom
        variances, chances = {}, {}
        for key, (squares, n) in kept.items():
            others = [k for k in kept if len(k) == 2 and len(key) == 1 and key[0] in k]
            expected = noise + sum(kept[k][0] / kept[k][1] - noise for k in others)
            each = count / float(np.prod([sizes[axis] for axis in key]))
            variances[key] = max((squares / n - expected) / each, 0.0)
            against = max(others, key=lambda k: kept[k][0] / kept[k][1], default=None)
            under = (noise, freedom) if against is None else (
                kept[against][0] / kept[against][1], kept[against][1]
            )  # fmt: skip
            chances[key] = float(fisher.sf(squares / n / under[0], n, under[1]))
        of_all = noise + sum(variances.values())
        components = [
            VarianceComponent(
                " with ".join(factors[axis] for axis in key), *kept[key], sqrt(variances[key]),
                chances[key], variances[key] / of_all,
            )
            for key in kept
        ]  # fmt: skip
        last = VarianceComponent(
            "repeatability", scatter, freedom, sqrt(noise), nan, noise / of_all
        )
        return cls((*components, last), factors[0])

    def sd(self, source: str) -> float:
        """Standard deviation of a source; 0 of an interaction that counts as scatter."""
        return next(
            (component.sd for component in self.components if component.source == source), 0.0
        )

    @property
    def reproducibility(self) -> float:
        """Standard deviation by operators, days and interactions."""
        others = [
            component.sd
            for component in self.components
            if component.source not in (self.part, _REPEATS)
        ]
        return float(np.linalg.norm(others))

    @property
    def gauge(self) -> float:
        """Standard deviation of repeatability and reproducibility together."""
        return float(np.hypot(self.sd(_REPEATS), self.reproducibility))

    @property
    def distinct_categories(self) -> int:
        """How many kinds of parts the gauge tells apart (ndc, AIAG); 5 or more are wanted."""
        return int(sqrt(2) * self.sd(self.part) / self.gauge) if self.gauge else 0

    def share_of_tolerance(self, tolerance: float) -> float:
        """Six standard deviations of the gauge over the width of a tolerance on both sides."""
        return 6 * self.gauge / (2 * tolerance)

    def verdict(self, tolerance: float) -> GaugeVerdict:
        """Return the verdict by AIAG: up to 10 % of the tolerance good, up to 30 % conditional."""
        share = self.share_of_tolerance(tolerance)
        return "good" if share <= 0.1 else "conditional" if share <= 0.3 else "not fit"

    @property
    def text(self) -> str:
        """One line for people."""
        whole = float(np.hypot(self.gauge, self.sd(self.part)))
        return (
            f"repeatability {self.sd(_REPEATS):.3g}, reproducibility {self.reproducibility:.3g}, "
            f"both {self.gauge:.3g}: {self.gauge / whole:.1%} of all; {self.part}: "
            f"{self.sd(self.part):.3g}"
        )


_REPEATS = "repeatability"
GaugeVerdict = Literal["good", "conditional", "not fit"]
