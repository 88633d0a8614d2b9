"""Thresholds of constant stimuli by haptix and by psignifit: coverage, width, bias and scatter.

    pip install "psignifit==4.3"        # not a dependency (GPL)
    python benchmarks/against_psignifit.py [sessions] [observer ...]

The sessions and observers are those of experiments.py, 7 levels by 20. psignifit has its defaults
for two alternatives, with a Weibull function and the threshold where 1 - 1/e of the way from guess
to all right is reached, as haptix has it.
"""

from __future__ import annotations

import sys
from math import exp

import numpy as np
from experiments import METHODS, OBSERVERS, run

from haptix.lab.experiment.methods import ThresholdMethod
from haptix.lab.experiment.psychometric import counted

try:
    import psignifit
except ImportError:
    sys.exit('psignifit is not there: pip install "psignifit==4.3"')


def of_psignifit(method: ThresholdMethod) -> tuple[float, float, float]:
    level, right, wrong = counted(method.answers)
    fitted = psignifit.psignifit(
        np.stack([level, right, right + wrong], 1), experiment_type="2AFC", sigmoid="weibull",
        thresh_PC=1 - exp(-1), verbose=False,
    )  # fmt: skip
    low, high = fitted.confidence_intervals["threshold"]["0.95"]
    return fitted.parameter_estimate["threshold"], low, high


def of_haptix(method: ThresholdMethod) -> tuple[float, float, float]:
    found = method.estimate()
    return found.threshold, found.low, found.high


def main() -> None:
    sessions = int(sys.argv[1]) if len(sys.argv) > 1 else 50
    tools = {"haptix": of_haptix, "psignifit": of_psignifit}
    print("observer      tool       coverage  width   bias scatter")
    for observer in sys.argv[2:] or [name for name in OBSERVERS if name != "guesses"]:
        methods = [METHODS["constant-stimuli"](seed) for seed in range(sessions)]
        truth = [run(one, observer, 22 + 0.1 * (k % 10), k) for k, one in enumerate(methods)]
        for name, tool in tools.items():
            found, low, high = np.array([tool(one) for one in methods]).T
            held, off = (low <= truth) & (truth <= high), found - truth
            print(
                f"{observer:13s} {name:10s} {held.mean():8.2f} {np.median(high - low):6.2f} "
                f"{off.mean():+6.2f} {off.std():7.2f}", flush=True,
            )  # fmt: skip


if __name__ == "__main__":
    main()
