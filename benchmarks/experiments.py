"""Simulated observers through each method: coverage and width of the 95 % intervals.

    python benchmarks/experiments.py [runs] [method, or observer, ...]

Observers: the one that is assumed; cumulative normals of 2 and of 5 dB with lapses of 3 %; 3 dB of
drift in 100 trials; lapses of 15 % after trial 60; slopes 2 and 6; far from what is assumed: slopes
1 and 12, a normal of 8 dB, lapses of 10 %; and one who guesses. The threshold is where 1 - 1/e of
the way from guess to all right is reached, its mean where it drifts.
Fast guesses: 15 or 30 % of the answers come after some 0.25 s, the others after 0.7 s, and are
right by chance; "untimed" are the same without their times. One is away for ten trials, one learns,
and one's threshold lies at the highest constant level. Coverage is of all runs: one without a
threshold holds it above the end that it states.
"as the priors" are observers whose slopes and lapses are drawn from the priors of the estimate.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass
from math import erfc, exp, isnan, log, pi, sin, sqrt
from random import Random

import numpy as np

from haptix.lab.experiment import ConstantStimuli, Quest, UpDown
from haptix.lab.experiment.methods import ThresholdMethod

GRID = np.arange(6.0, 45.0, 1.0)
COARSE = np.arange(6.0, 45.0, 2.0)
CEILING = 46.0
METHODS: dict[str, Callable[[int], ThresholdMethod]] = {
    "up-down": lambda seed: UpDown(36.0),
    "up-down longer": lambda seed: UpDown(36.0, stop_after=18),
    "up-down 2 dB": lambda seed: UpDown(36.0, (4.0, 2.0), stop_after=12),
    "quest+ one slope": lambda seed: Quest(GRID, GRID, trials=40),
    "quest+": lambda seed: Quest(
        COARSE, COARSE, (1.5, 2.5, 3.5, 5.0), lapse=(0.01, 0.04, 0.1), trials=100
    ),
    "constant-stimuli": lambda seed: ConstantStimuli(range(13, 32, 3), 20, seed),
}


def weibull(slope: float) -> Callable[[float], float]:
    return lambda off: 1 - exp(-(10 ** min(slope * off / 20, 3)))


def normal(deviation: float) -> Callable[[float], float]:
    return lambda off: 0.5 * erfc(-(off / deviation + 0.3375) / sqrt(2))


@dataclass(frozen=True)
class Kind:
    """A kind of observer."""

    core: Callable[[float], float]
    lapse: float = 0.02
    later: float | None = None  # lapses from trial 60 on
    drift: float = 0.0  # dB in 100 trials
    learns: float = 0.0  # dB that are gone after some 25 trials
    guesses: float = 0.0  # share of fast guesses
    timed: bool = True
    away: tuple[int, int] = (0, 0)
    higher: float = 0.0  # dB
    waves: float = 0.0  # dB to either side, every 30 trials
    bursts: float = 0.0  # share of trials at which some six guesses begin
    rattled: float = 0.0  # share of guesses among the answers after a wrong one


OBSERVERS = {
    "assumed": Kind(weibull(3.5)),
    "normal, 2 dB": Kind(normal(2.0), 0.03),
    "normal, 5 dB": Kind(normal(5.0), 0.03),
    "drifts": Kind(weibull(3.5), drift=3.0),
    "drifts far": Kind(weibull(3.5), drift=6.0),
    "learns": Kind(weibull(3.5), learns=5.0),
    "tires": Kind(weibull(3.5), later=0.15),
    "fast guesses 15 %": Kind(normal(2.5), guesses=0.15),
    "fast guesses 30 %": Kind(normal(2.5), guesses=0.3),
    "untimed 30 %": Kind(normal(2.5), guesses=0.3, timed=False),
    "away": Kind(weibull(3.5), away=(30, 40)),
    "at the end": Kind(weibull(3.5), higher=8.0),
    "slope 2": Kind(weibull(2.0)),
    "slope 6": Kind(weibull(6.0)),
    "slope 1": Kind(weibull(1.0)),
    "slope 12": Kind(weibull(12.0)),
    "normal, 8 dB": Kind(normal(8.0), 0.03),
    "lapses 10 %": Kind(weibull(3.5), 0.1),
    "waves": Kind(weibull(3.5), waves=3.0),
    "bursts": Kind(normal(2.5), bursts=0.03),
    "rattled": Kind(weibull(2.5), rattled=0.4),
    "guesses": Kind(lambda off: 0.0, 0.0),
}
AS_PRIORS = "as the priors"


def kind_of(observer: str, draw: Random) -> Kind:
    if observer != AS_PRIORS:
        return OBSERVERS[observer]
    return Kind(weibull(3.5 * exp(draw.gauss(0, 0.85))), draw.betavariate(1, 22))


def run(
    method: ThresholdMethod, observer: str, start: float, seed: int
) -> tuple[float, list[float]]:
    """Run a method; return the observer's mean threshold, and the reaction times if known."""
    draw, thresholds, times = Random(seed), [], []
    kind = kind_of(observer, draw)
    others, is_away, was_wrong = Random(seed + 10**6), False, False
    while not method.is_done:
        trial, level = len(thresholds), min(method.level, CEILING)
        lapse = kind.lapse if kind.later is None or trial < 60 else kind.later
        at = start + kind.higher + kind.drift * trial / 100 + kind.learns * exp(-trial / 25)
        at += kind.waves * sin(2 * pi * trial / 30)
        is_away = others.random() < (5 / 6 if is_away else kind.bursts)
        is_rattled = was_wrong and others.random() < kind.rattled
        is_fast = draw.random() < kind.guesses
        share = 0.5 + (0.5 - lapse) * kind.core(level - at)
        if is_fast or is_away or is_rattled or kind.away[0] <= trial < kind.away[1]:
            share = 0.5
        was_wrong = draw.random() >= share
        method.update(not was_wrong, level)
        times.append(draw.lognormvariate(log(0.25 if is_fast else 0.7), 0.35))
        thresholds.append(at)
    return sum(thresholds) / len(thresholds), times if kind.timed else []


def main() -> None:
    runs = int(sys.argv[1]) if len(sys.argv) > 1 else 400
    print(
        "method            observer          coverage +-se  width   bias scatter  none warned "
        "trials"
    )
    asked = sys.argv[2:]
    for name in [one for one in asked if one in METHODS] or METHODS:
        for observer in [one for one in asked if one not in METHODS] or (*OBSERVERS, AS_PRIORS):
            off, width, trials = [], [], []
            held = none = warned = 0
            for seed in range(runs):
                method = METHODS[name](seed)
                truth, times = run(method, observer, 22 + 0.1 * (seed % 10), seed)
                found = method.estimate(reaction_s=times)
                trials.append(len(method.answers))
                held += found.low <= truth <= found.high
                if isnan(found.threshold):
                    none += 1
                    continue
                warned += bool(found.warnings)
                off.append(found.threshold - truth)
                width.append(found.width)
            line = f"{name:17s} {observer:17s}"
            if observer == "guesses":
                line += " " * 38
            else:
                share = held / runs
                error = sqrt(share * (1 - share) / runs)
                line += f" {share:8.3f} {error:4.3f} {np.median(width):6.2f} "
                line += f"{np.mean(off):+6.2f} {np.std(off):7.2f} "
            print(
                f"{line}{none / runs:6.1%} {warned / runs:6.1%} {np.mean(trials):6.0f}", flush=True
            )


if __name__ == "__main__":
    main()
