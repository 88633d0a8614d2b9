"""Thresholds that methods state: near the truth, with the spread they have, and none by chance."""

from math import exp, log, log10
from random import Random

import numpy as np
import pytest

from haptix.stimuli.adaptive import ConstantStimuli, Quest, UpDown

GRID = np.arange(6.0, 45.0, 1.0)
CEILING = 46.0
METHODS = {
    "up-down": lambda seed: UpDown(36.0),
    "quest+": lambda seed: Quest(GRID, GRID, trials=40),
    "constant-stimuli": lambda seed: ConstantStimuli(range(12, 34, 3), 25, seed),
}
RUNS = 24  # benchmarks/experiments.py has a thousand


def share(level, threshold, slope, lapse):
    """Weibull function in two intervals, written out."""
    return 1 - lapse - (0.5 - lapse) * exp(-(10 ** min(slope * (level - threshold) / 20, 3)))


def run(method, right, seed):
    draw = Random(seed)
    while not method.is_done:
        level = min(method.level, CEILING)
        method.update(draw.random() < right(level), level)
    return method


def estimates(name, slope=3.5, lapse=0.02):
    """What each run states, and how far its threshold is from the truth."""
    for seed in range(RUNS):
        truth = 22 + 0.1 * (seed % 10)
        method = run(METHODS[name](seed), lambda x: share(x, truth, slope, lapse), seed)  # noqa: B023
        if name == "up-down":  # settles where 79.4 % are right
            truth += 20 / slope * log10(-log((1 - lapse - method.target) / (0.5 - lapse)))
        found = method.estimate()
        yield found, found.threshold - truth


@pytest.mark.parametrize("name", METHODS)
def test_thresholds_have_the_bias_and_the_spread_that_they_state(name):
    found, off = zip(*estimates(name), strict=True)
    scatter = np.std(off, ddof=1)
    # The bounds, with what so few runs leave open: 2 errors of a mean, and of a spread.
    assert abs(np.mean(off)) < 0.15 + 2 * scatter / np.sqrt(RUNS)
    ratio = np.mean([one.spread for one in found]) / scatter
    assert abs(ratio - 1) < 0.25 + 2 / np.sqrt(2 * RUNS)


@pytest.mark.parametrize("name", METHODS)
def test_one_who_guesses_has_no_threshold(name):
    none = 0
    for seed in range(RUNS):
        found = run(METHODS[name](seed), lambda level: 0.5, seed).estimate()
        is_none = np.isnan(found.threshold) and np.isnan(found.spread)
        assert not is_none or "no threshold" in found.warnings[0]
        none += is_none
    assert none >= RUNS - 1  # of 100 who guess, one is as good as one who feels


def test_a_walk_along_the_ceiling_gives_no_threshold():
    """However often the observer is right there."""
    found = run(UpDown(40.0), lambda level: 0.7, 1).estimate()
    assert np.isnan(found.threshold) and "end of what can be presented" in found.warnings[0]


def test_what_lies_outside_of_the_levels_is_no_threshold():
    quest = run(METHODS["quest+"](0), lambda level: share(level, 60.0, 3.5, 0.02), 0)
    assert np.isnan(quest.estimate().threshold)
    constant = run(METHODS["constant-stimuli"](0), lambda level: 0.98, 0)
    assert "none lies within the levels" in " ".join(constant.estimate().warnings)


def test_a_wrong_model_is_warned_of():
    """Slope 1.5 and lapse rate 0.08 bias the threshold by 2 to 3 dB."""
    warned = {
        observer: sum(any("hangs on" in line for line in found.warnings) for found, _ in several)
        for observer, several in (
            ((3.5, 0.02), estimates("constant-stimuli")),
            ((1.5, 0.08), estimates("constant-stimuli", 1.5, 0.08)),
        )
    }
    assert warned[1.5, 0.08] > 0.6 * RUNS
    assert warned[3.5, 0.02] < 0.2 * RUNS
    # Forty trials about one level do not tell the slope: a method that assumes one says so.
    assumed, _ = next(iter(estimates("quest+", 1.5, 0.08)))
    assert "hangs on" in assumed.warnings[0]
    free = Quest(GRID, GRID, [1, 2, 4, 8], lapse=[0, 0.04, 0.08, 0.12], trials=40)
    assert not run(free, lambda level: share(level, 22.0, 1.5, 0.08), 0).estimate().warnings


def test_a_walk_that_has_not_settled_is_warned_of():
    """A shallow function and lapses: what warns is seldom heard of a good observer."""

    def is_warned(found):
        return any("settled" in line or "begin higher" in line for line in found.warnings)

    warned = 0
    for seed in range(RUNS):
        method = run(UpDown(36.0), lambda level: share(level, 22.0, 1.5, 0.08), seed)
        found = method.estimate()
        warned += is_warned(found)
        # Lapses at the first levels use its reversals up before it has come down.
        assert found.threshold < 32.0 or is_warned(found) or np.isnan(found.threshold)
    good = sum(is_warned(found) for found, _ in estimates("up-down"))
    assert good < 0.25 * RUNS < warned  # 8 % and 40 % of some hundreds


def test_one_who_guesses_has_no_threshold_when_the_session_was_stopped():
    method = Quest(GRID, GRID, trials=40)
    draw = Random(4)
    for _ in range(30):
        method.update(draw.random() < 0.5, method.level)
    assert not method.is_done and np.isnan(method.estimate().threshold)


def test_shares_that_no_function_has_are_warned_of():
    levels = np.repeat([10.0, 15.0, 20.0, 25.0, 30.0], 40)
    method = ConstantStimuli([10.0, 15.0, 20.0, 25.0, 30.0], 40)
    for level, k in zip(levels, [*range(40)] * 5, strict=True):
        method.update(k < {10: 20, 15: 38, 20: 22, 25: 36, 30: 39}[int(level)], level)
    assert "no function of this form" in " ".join(method.estimate().warnings)


def test_a_run_ends_at_its_most_trials():
    method = run(UpDown(30.0, highest=40.0, most_trials=50), lambda level: 0.0, 0)
    assert len(method.answers) == 50
    assert "no reversals" in method.estimate().warnings[0]
