"""Simulated observers through each adaptive method: bias, scatter, the spread that is stated.

    python benchmarks/experiments.py [runs] [method ...]

Observers: the one that the methods assume (slope 3.5, lapse rate 0.02), others, and one who
guesses. What assumes several slopes and lapse rates has observers drawn from them first. Bounds of
the first of each: bias within 0.15 dB and twice its standard error, the mean spread within 25 % of
the scatter.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from math import exp, isnan, log, log10
from random import Random
from typing import Any

import numpy as np

from haptix.stimuli.adaptive import ConstantStimuli, Method, Quest, UpDown

GRID = np.arange(6.0, 45.0, 1.0)
CEILING = 46.0
DRAWN = ((1.0, 2.0, 3.5, 5.0, 8.0), (0.0, 0.02, 0.05, 0.1))
METHODS: dict[str, Callable[[int], Method]] = {
    "up-down": lambda seed: UpDown(36.0),
    "quest+": lambda seed: Quest(GRID, GRID, trials=40),
    "quest+ free": lambda seed: Quest(GRID, GRID, DRAWN[0], lapse=DRAWN[1], trials=100),
    "constant-stimuli": lambda seed: ConstantStimuli(range(12, 34, 3), 25, seed),
}
OBSERVERS: tuple[Any, ...] = ((3.5, 0.02), (2.5, 0.02), (5.0, 0.02), (1.5, 0.02), (1.5, 0.08), None)


def share(level: float, threshold: float, slope: float, lapse: float) -> float:
    return 1 - lapse - (0.5 - lapse) * exp(-(10 ** min(slope * (level - threshold) / 20, 3)))


def run(method: Method, right: Callable[[float], float], seed: int) -> int:
    draw, trials = Random(seed), 0
    while not method.is_done:
        level = min(method.level, CEILING)
        method.update(draw.random() < right(level), level)
        trials += 1
    return trials


def main() -> None:
    runs = int(sys.argv[1]) if len(sys.argv) > 1 else 1000
    print("method            slope lapse   bias  +-se scatter spread ratio  none warned trials")
    for name in sys.argv[2:] or METHODS:
        make = METHODS[name]
        for observer in ((DRAWN,) if "free" in name else ()) + OBSERVERS:
            off, spread, trials = [], [], []
            none = warned = 0
            for seed in range(runs):
                method, truth = make(seed), 22 + 0.1 * (seed % 10)
                if observer is None:
                    trials.append(run(method, lambda level: 0.5, seed))
                else:
                    slope, lapse = observer
                    if observer is DRAWN:
                        slope, lapse = (Random(f"{seed} {one}").choice(one) for one in DRAWN)
                    trials.append(run(method, lambda x: share(x, truth, slope, lapse), seed))  # noqa: B023
                    if isinstance(method, UpDown):  # settles where that share is right
                        at = (1 - lapse - method.target) / (0.5 - lapse)
                        truth += 20 / slope * log10(-log(at))
                found = method.estimate()
                warned += any("no threshold" not in line for line in found.warnings)
                none += isnan(found.threshold)
                if not isnan(found.threshold):
                    off.append(found.threshold - truth)
                    spread.append(found.spread)
            who = "  guesses  " if observer is None else "      drawn"
            if observer not in (None, DRAWN):
                who = "{:5.1f} {:5.2f}".format(*observer)
            line = f"{name:17s} {who}"
            if observer is not None:
                scatter = float(np.std(off, ddof=1))
                mean = float(np.nanmean(spread))
                line += (
                    f" {np.mean(off):+6.2f} {scatter / len(off) ** 0.5:5.2f} {scatter:7.2f} "
                    f"{mean:6.2f} {mean / scatter:5.2f}"
                )
            else:
                line += " " * 33
            print(
                f"{line} {none / runs:5.1%} {warned / runs:6.1%} {np.mean(trials):6.0f}", flush=True
            )


if __name__ == "__main__":
    main()
