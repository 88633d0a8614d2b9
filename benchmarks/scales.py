"""Simulated sessions of pairs and magnitudes: coverage and width of the 95 % intervals.

    python benchmarks/scales.py [sessions] [beginning of a name ...]

Five levels. Comparisons follow Bradley and Terry with steps of 1 logit between levels, or of 2 or
3, where most pairs are never lost. Numbers have an exponent of 0.6 and logarithms that scatter by
0.3: "even", at all levels; "round", as the numbers that people say, or by 0.1, about the distance
of two such numbers; or "uneven", twice as much at the lowest level. Several participants differ by
0.5 logit in each value, or by 0.1 in the exponent, and have number scales of their own.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from functools import cache, partial
from types import SimpleNamespace
from typing import Any

import numpy as np

from haptix.base.checks import Array
from haptix.lab.analysis.results import _exponent_row, over_participants
from haptix.lab.analysis.runs import ALL, Row, RunOfMethod
from haptix.lab.analysis.scales import magnitude_rows, scale_over_all, scale_rows
from haptix.lab.experiment import Magnitudes, Pairs
from haptix.lab.experiment.comparisons import bradley_terry
from haptix.lab.experiment.methods import Method

LEVELS = [10.0, 17.0, 24.0, 31.0, 38.0]
STEPS = np.arange(5) - 2.0
ROUND = np.log([*range(1, 11), 12, 15, 20, 25, 30, 35, 40, 45, *range(50, 110, 10), 120, 150, 200])
EXPONENT = 0.6
Draw = np.random.Generator
Stated = tuple[Array, Array, Array]  # ends of the intervals, and the truth between them


def run_of(method: Method, who: int) -> RunOfMethod:
    session: Any = SimpleNamespace(participant=str(who), session="1", task="", source="simulated")
    return RunOfMethod(session, "", "", method, method.estimate(), (), {})


def ends(rows: Sequence[Row], low: str, high: str) -> tuple[Array, Array]:
    return np.array([row[low] for row in rows]), np.array([row[high] for row in rows])


def pairs(step: float, repeats: int, people: int, differ: float, draw: Draw) -> Stated:
    runs = []
    for who in range(people):
        value = step * STEPS + differ * draw.standard_normal(5)
        of_level = dict(zip(LEVELS, value.tolist(), strict=True))
        method = Pairs(LEVELS, repeats, int(draw.integers(2**31)))
        while not method.is_done:
            apart = of_level[method.level] - of_level[method.other_levels[0]]
            method.update(draw.random() < 1 / (1 + np.exp(-apart)))
        runs.append(run_of(method, who))
    rows = scale_rows(runs) if people == 1 else scale_over_all(runs)
    low, high = ends(rows, "low_logit", "high_logit")
    return low, pooled(step, differ), high


@cache
def pooled(step: float, differ: float) -> Array:
    """Values of the comparisons that a whole population makes."""
    value = step * STEPS + differ * np.random.default_rng(1).standard_normal((100_000, 5))
    share = (1 / (1 + np.exp(value[:, None, :] - value[:, :, None]))).mean(0)
    np.fill_diagonal(share, 0.0)
    return bradley_terry(1e6 * share)[0]


def magnitudes(
    scatter: Sequence[float], repeats: int, people: int, is_round: bool, of: str, draw: Draw
) -> Stated:
    runs, over = [], (np.array(LEVELS) - 24) / 20 * np.log(10)
    for who in range(people):
        exponent, own = EXPONENT + 0.1 * draw.standard_normal() * (people > 1), np.log(10.0)
        own += draw.standard_normal() * (people > 1)
        at = dict(zip(LEVELS, zip(own + exponent * over, scatter, strict=True), strict=True))
        method = Magnitudes(LEVELS, repeats, int(draw.integers(2**31)))
        while not method.is_done:
            middle, spread = at[method.level]
            log = middle + spread * draw.standard_normal()
            method.update(float(np.exp(ROUND[np.abs(ROUND - log).argmin()] if is_round else log)))
        runs.append(run_of(method, who))
    if of == "exponent":
        rows = [*map(_exponent_row, runs)]
        if people > 1:
            rows, _ = over_participants(rows, "exponent")
        low, high = ends(rows, "low", "high")
        return low, np.array([EXPONENT]), high
    rows = [row for row in magnitude_rows(runs) if people == 1 or row["participant"] == ALL]
    low, high = map(np.log, ends(rows, "low", "high"))
    middle = np.log([row["mean"] for row in rows]).mean() if people > 1 else np.log(10.0)
    return low, middle + EXPONENT * over, high


EVEN, SMALL, UNEVEN = [0.3] * 5, [0.1] * 5, [0.6, 0.3, 0.3, 0.3, 0.3]
CASES: dict[str, Callable[[Draw], Stated]] = {}
for step, repeats in ((1.0, 4), (1.0, 10), (2.0, 4), (2.0, 10), (3.0, 4)):
    CASES[f"pairs, steps of {step:g}, {repeats} times"] = partial(pairs, step, repeats, 1, 0.0)
for people in (4, 8, 20):
    for differ in (0.0, 0.5):
        name = f"pairs, {people} people who differ by {differ:g}"
        CASES[name] = partial(pairs, 1.0, 4, people, differ)
for of in ("means", "exponent"):
    for name, scatter, is_round in (
        ("even", EVEN, False), ("round, 0.3", EVEN, True), ("round, 0.1", SMALL, True),
        ("uneven", UNEVEN, False),
    ):  # fmt: skip
        CASES[f"{of}, {name}, 4 times"] = partial(magnitudes, scatter, 4, 1, is_round, of)
    for people in (4, 8, 20):
        CASES[f"{of}, {people} people"] = partial(magnitudes, EVEN, 4, people, False, of)


def main() -> None:
    sessions = int(sys.argv[1]) if len(sys.argv) > 1 else 400
    print(f"{'':34s} coverage   of each level                   width")
    for name, case in CASES.items():
        if not name.startswith((*sys.argv[2:],) or ""):
            continue
        held, widths = [], []
        for seed in range(sessions):
            low, truth, high = case(np.random.default_rng(seed))
            held.append((low <= truth) & (truth <= high))
            widths.append(high - low)
        of_each = " ".join(f"{share:.3f}" for share in np.mean(held, 0))
        print(
            f"{name:34s} {np.mean(held):8.3f}   {of_each:30s} {np.median(widths):6.2f}", flush=True
        )


if __name__ == "__main__":
    main()
