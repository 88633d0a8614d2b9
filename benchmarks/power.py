"""The power that `haptix stimuli simulate` states, against studies that are simulated whole.

    python benchmarks/power.py DESIGN [studies] [skipped]    # the share of studies that find it
    python benchmarks/power.py DESIGN stated [seeds]         # as `paired_power` states it

A design is one of `DESIGNS`. In each study all participants are new: two thresholds, two runs of
the method, their likelihoods, and the model of `haptix stimuli analyse` at 0.05. Studies are
numbered, so that a long count may be made in parts. No run is used twice.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from haptix.lab.analysis.power import Observer, one_run, paired_power
from haptix.lab.experiment import ConstantStimuli, Quest, UpDown
from haptix.lab.experiment.methods import ThresholdMethod
from haptix.lab.experiment.psychometric import group_of_likelihoods

GRID = tuple(np.arange(6.0, 45.0, 1.0).tolist())


@dataclass(frozen=True)
class Design:
    """A study of two conditions."""

    make: Callable[[], ThresholdMethod]
    observer: Observer
    participants: int
    difference: float
    between: float


DESIGNS = {
    "quest": Design(lambda: Quest(GRID, GRID, trials=20), Observer(22.0, 1.5), 5, 5.0, 2.0),
    "near the end": Design(
        lambda: ConstantStimuli((12.0, 17.0, 22.0), 10), Observer(20.5, 3.5, 0.05), 4, 5.5, 1.0
    ),
    "up-down": Design(
        lambda: UpDown(30.0, (4.0, 2.0), stop_after=4), Observer(22.0, 3.5, 0.08), 4, 5.5, 1.5
    ),
    # Of these nothing was seen while `paired_power` was made.
    "few levels": Design(
        lambda: ConstantStimuli((10.0, 16.0, 22.0, 28.0), 8), Observer(18.0), 5, 5.0, 2.0
    ),
    "two down": Design(
        lambda: UpDown(28.0, (4.0, 2.0), stop_after=4, down_after=2),
        Observer(20.0, 2.5, 0.03), 4, 6.0, 2.0,
    ),
    "coarse quest": Design(
        lambda: Quest(GRID[::2], GRID[::2], trials=16), Observer(18.0, 3.5, 0.05), 4, 6.0, 1.0
    ),
}  # fmt: skip


def finds(design: Design, study: int) -> bool:
    """Whether a study, all of whose participants are new, finds its difference."""
    draw, likelihoods = np.random.default_rng([917, study]), []
    for _ in range(design.participants):
        mean = design.observer.threshold + design.between * draw.standard_normal()
        for more in (0.0, design.difference):
            threshold = mean + more + design.between / 3 * draw.standard_normal()
            observer, seed = (
                replace(design.observer, threshold=threshold),
                int(draw.integers(2**62)),
            )
            method, _ = one_run(design.make, observer, seed)
            found = method.estimate(reaction_s=())
            assert found.likelihood is not None
            likelihoods.append(found.likelihood)
    who = [str(k // 2) for k in range(2 * design.participants)]
    tested = group_of_likelihoods(likelihoods, who, [0, 1] * design.participants)
    return tested.p(np.array([-1.0, 1.0])) < 0.05


def main() -> None:
    design, what = DESIGNS[sys.argv[1]], [*sys.argv[2:], "2000", "0"]
    if what[0] == "stated":
        for seed in range(int(what[1]) or 1):
            (row,) = paired_power(
                design.make, design.observer, design.difference, design.between,
                (design.participants,), 200, 7919 * seed,
            )  # fmt: skip
            print(
                {name: row[name] for name in row if name.startswith(("power", "runs"))}, flush=True
            )
        return
    studies, skipped = int(what[0]), int(what[1])
    found = np.array([finds(design, study) for study in range(skipped, skipped + studies)])
    error = found.std() / np.sqrt(studies)
    print(f"{found.sum()} of {studies} found it: {found.mean():.3f} +- {error:.3f}", flush=True)


if __name__ == "__main__":
    main()
