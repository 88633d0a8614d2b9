"""Prediction of detection before there is hardware: virtual finger, thresholds, observer.

Each stimulus of a set is rendered, and its sensation level follows from the attraction of the skin.
The louder of its steady part and its edges is compared with people whose thresholds scatter around
the published ones. Scatter, slope and lapse rate are assumptions of the caller, repeated in each
row, because the sources that were read do not state them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from math import inf
from typing import Any

import numpy as np

from haptix.checks import Array, number, whole
from haptix.perception.sensation import Loudest, SensationInTime
from haptix.stimuli.adaptive.psychometric import function_named
from haptix.stimuli.rendering import Rendering, Tally
from haptix.stimuli.set_plan import SetPlan

_PEOPLE = 4000  # drawn for a share
_STUDIES = 2000  # drawn for a power
_CHANCE = 0.5  # of two alternatives


@dataclass(frozen=True)
class People:
    """Observers whose thresholds scatter around the published ones.

    Parameters
    ----------
    between_db : float
        Standard deviation of thresholds between people [dB].
    slope, lapse : sequence of float
        Slopes and lapse rates, all of them equally often.
    seed : int
        Of what is drawn.
    """

    between_db: float = 3.0
    slope: Sequence[float] = (1.5, 3.5)
    lapse: Sequence[float] = (0.02, 0.08)
    seed: int = 0

    def shares(self, level_db: float) -> Array:
        """Share of presentations that each of some people detects, shape (people,)."""
        number("between_db", self.between_db, 0.0)
        draw = np.random.default_rng(self.seed)
        threshold = self.between_db * draw.standard_normal(_PEOPLE)
        slope, lapse = draw.choice(self.slope, _PEOPLE), draw.choice(self.lapse, _PEOPLE)
        weibull = function_named("weibull")
        return np.asarray(weibull(np.full(_PEOPLE, level_db), threshold, slope, 0.0, lapse))

    def power(self, level_db: float, participants: int, repeats: int, alpha: float = 0.05) -> float:
        """Probability that a study shows that people do not guess between two alternatives.

        Each of the participants answers `repeats` times; a one-sided t-test compares their shares
        of right answers with one half.
        """
        from scipy.stats import t as student

        whole("participants", participants, 2)
        draw = np.random.default_rng([self.seed, participants])
        people = draw.choice(self.shares(level_db), (_STUDIES, participants))
        right = draw.binomial(repeats, _CHANCE + (1 - _CHANCE) * people) / repeats
        error = right.std(1, ddof=1) / np.sqrt(participants)
        t = (right.mean(1) - _CHANCE) / np.maximum(error, 1e-12)
        return float(np.mean(t > student.ppf(1 - alpha, participants - 1)))


def levels(
    plan: SetPlan, on_progress: Callable[[float], None] = lambda share: None
) -> Iterator[tuple[str, Loudest, bool]]:
    """Yield each file of a set: name, levels, and whether all its friction is reachable."""
    total, done = len(plan.stimuli) * len(plan.screens), 0
    for screen in plan.screens:
        apparatus = plan.apparatus(screen)
        for stimulus in plan.stimuli:
            response, _ = apparatus.responses(stimulus)
            skin, rate = apparatus.skin(stimulus), plan.sample_rate_hz
            rendering = Rendering(stimulus, response, rate, skin)
            tally = Tally(SensationInTime(plan.perception, rate, skin))
            for block in rendering.stream():
                tally.take(block, response)
            done += 1
            on_progress(done / total)
            name = stimulus.name + plan.suffix(screen)
            yield name, tally.sensation.finish(), tally.is_reached


def predictions(
    plan: SetPlan,
    people: People,
    participants: Sequence[int] = (),
    on_progress: Callable[[float], None] = lambda share: None,
) -> Iterator[dict[str, Any]]:
    """Yield a row for each stimulus of a set: its level, who detects it, and the power of a study.

    `detected` is the mean share of detections over people, `low` and `high` hold 95 % of people.
    They are None where no threshold is known of anything in the stimulus.
    """
    for name, loudest, is_reached in levels(plan, on_progress):
        known = [one for one in (loudest.sensation_db, loudest.edges_db) if one is not None]
        level_db = max(known, default=-inf)
        row: dict[str, Any] = {
            "stimulus": name,
            "steady_db": loudest.sensation_db,
            "edges_db": loudest.edges_db,
            "unknown_share": loudest.outside_share,
            "is_reached": is_reached,
            "detected": None,
            "low": None,
            "high": None,
        }
        if known:
            shares = people.shares(level_db)
            low, high = np.percentile(shares, (2.5, 97.5)).tolist()
            row |= {"detected": float(shares.mean()), "low": low, "high": high}
        for count in participants:
            power = people.power(level_db, count, plan.trials.repeats) if known else None
            row[f"power_{count}"] = power
        yield row
