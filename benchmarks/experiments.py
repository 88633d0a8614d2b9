"""Simulated observers through each method: coverage and width of the 95 % intervals.

    python benchmarks/experiments.py [runs] [method ...]

Observers: the one that is assumed; cumulative normals of 2 and of 5 dB with lapses of 3 %; 3 dB of
drift in 100 trials; lapses of 15 % after trial 60; slopes 2 and 6; far from what is assumed: slopes
1 and 12, a normal of 8 dB, lapses of 10 %; and one who guesses. The threshold is where 1 - 1/e of
the way from guess to all right is reached, its mean where it drifts.
"as the priors" are observers whose slopes and lapses are drawn from the priors of the estimate.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from math import erfc, exp, isnan, sqrt
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


OBSERVERS = {
    # Share, lapse rate, that after trial 60, drift in 100 trials.
    "assumed": (weibull(3.5), 0.02, 0.02, 0.0),
    "normal, 2 dB": (normal(2.0), 0.03, 0.03, 0.0),
    "normal, 5 dB": (normal(5.0), 0.03, 0.03, 0.0),
    "drifts": (weibull(3.5), 0.02, 0.02, 3.0),
    "tires": (weibull(3.5), 0.02, 0.15, 0.0),
    "slope 2": (weibull(2.0), 0.02, 0.02, 0.0),
    "slope 6": (weibull(6.0), 0.02, 0.02, 0.0),
    "slope 1": (weibull(1.0), 0.02, 0.02, 0.0),
    "slope 12": (weibull(12.0), 0.02, 0.02, 0.0),
    "normal, 8 dB": (normal(8.0), 0.03, 0.03, 0.0),
    "lapses 10 %": (weibull(3.5), 0.1, 0.1, 0.0),
    "guesses": (lambda off: 0.0, 0.0, 0.0, 0.0),
}
AS_PRIORS = "as the priors"


def kind_of(observer: str, draw: Random) -> tuple[Callable[[float], float], float, float, float]:
    if observer != AS_PRIORS:
        return OBSERVERS[observer]
    lapse = draw.betavariate(1, 22)
    return weibull(3.5 * exp(draw.gauss(0, 0.85))), lapse, lapse, 0.0


def run(method: ThresholdMethod, observer: str, start: float, seed: int) -> float:
    """Run a method; return the observer's mean threshold."""
    draw, trial = Random(seed), 0
    core, first, later, drift = kind_of(observer, draw)
    while not method.is_done:
        level = min(method.level, CEILING)
        lapse = later if trial >= 60 else first
        share = 0.5 + (0.5 - lapse) * core(level - start - drift * trial / 100)
        method.update(draw.random() < share, level)
        trial += 1
    return start + drift * (trial - 1) / 200


def main() -> None:
    runs = int(sys.argv[1]) if len(sys.argv) > 1 else 400
    print("method            observer      coverage +-se  width   bias scatter  none warned trials")
    for name in sys.argv[2:] or METHODS:
        for observer in (*OBSERVERS, AS_PRIORS):
            off, width, trials = [], [], []
            held = none = warned = 0
            for seed in range(runs):
                method = METHODS[name](seed)
                truth = run(method, observer, 22 + 0.1 * (seed % 10), seed)
                found = method.estimate()
                trials.append(len(method.answers))
                if isnan(found.threshold):
                    none += 1
                    continue
                warned += bool(found.warnings)
                held += found.low <= truth <= found.high
                off.append(found.threshold - truth)
                width.append(found.width)
            line = f"{name:17s} {observer:13s}"
            if observer == "guesses":
                line += " " * 38
            else:
                share = held / len(off)
                error = sqrt(share * (1 - share) / len(off))
                line += f" {share:8.3f} {error:4.3f} {np.median(width):6.2f} "
                line += f"{np.mean(off):+6.2f} {np.std(off):7.2f} "
            print(
                f"{line}{none / runs:6.1%} {warned / runs:6.1%} {np.mean(trials):6.0f}", flush=True
            )


if __name__ == "__main__":
    main()
