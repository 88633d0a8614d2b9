"""Methods against published runs, the theory of where they settle, and an independent package."""

import math
import re
import tomllib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import norm

from haptix.base.errors import InputError
from haptix.lab.experiment import (
    ConstantStimuli,
    Quest,
    Question,
    SimulatedObserver,
    UpDown,
    fit,
    weighted_up_down,
)
from haptix.lab.experiment.psychometric import normal, symmetric_normal, weibull

PUBLISHED = tomllib.loads((Path(__file__).parent / "data" / "watson2017.toml").read_text())
GRIDS = {"threshold": {}, "threshold-slope": {"slope": [2, 3, 4, 5]}}


def watson(**given):
    levels = np.arange(-40, 1)
    return Quest(levels, levels, guess=0.5, lapse=0.02, **given)


@pytest.mark.parametrize("name", GRIDS)
def test_quest_plus_reproduces_watson_trial_by_trial(name):
    run = PUBLISHED[name]
    trials = re.findall(r"(-?\d+)([+-])", run["trials"])
    assert len(trials) in (32, 64)
    method = watson(**GRIDS[name])
    for number, (level, answer) in enumerate(trials):
        assert method.level == int(level), f"trial {number + 1}"
        method.update(answer == "+")
    best = np.unravel_index(method.posterior.argmax(), [*map(len, method.grids.values())])
    mode = {name: grid[at] for (name, grid), at in zip(method.grids.items(), best, strict=True)}
    assert mode["threshold"] == run["mode"]["threshold"]
    assert mode["slope"] == run["mode"].get("slope", 3.5)


@pytest.mark.parametrize("function", ["weibull", "norm_cdf", "norm_cdf_2"])
def test_quest_plus_is_that_of_another_package(function):
    """Trial by trial with answers at random, posterior and all."""
    theirs_module = pytest.importorskip("questplus", reason="questplus is not installed")
    levels, slope, lapse = np.arange(-20.0, 1.0, 2.0), np.array([1.0, 2.0, 4.0]), [0.0, 0.05]
    names = {"weibull": "weibull", "norm_cdf": "normal", "norm_cdf_2": "symmetric-normal"}
    if function == "weibull":
        domain = {"threshold": levels, "slope": slope, "lower_asymptote": 0.5, "lapse_rate": lapse}
    else:
        domain = {"mean": levels, "sd": slope, "lapse_rate": lapse}
        if function == "norm_cdf":
            domain["lower_asymptote"] = 0.5
    theirs = theirs_module.QuestPlus(
        stim_domain={"intensity": levels},
        param_domain=domain,
        outcome_domain={"response": ["yes", "no"]},
        func=function,
        stim_scale="dB" if function == "weibull" else "linear",
        stim_selection_method="min_entropy",
        param_estimation_method="mean",
    )
    ours = Quest(levels, levels, slope, 0.5, lapse, function=names[function])
    rng = np.random.default_rng(8)
    key = "threshold" if function == "weibull" else "mean"
    for _ in range(25):
        asked = theirs.next_stim["intensity"]
        entropy = ours.expected_entropy()
        # Two levels may be worth the same to the last bit: then either is right.
        at = int(np.argmin(np.abs(levels - asked)))
        assert entropy[at] - entropy.min() < 1e-9
        is_right = bool(rng.random() < 0.7)
        theirs.update(stim={"intensity": asked}, outcome={"response": "yes" if is_right else "no"})
        ours.update(is_right, asked)
        shape = [*map(len, ours.grids.values())]
        mean = ours.posterior.reshape(shape).sum((1, 2, 3)) @ ours.grids["threshold"]
        assert mean == pytest.approx(theirs.param_estimate[key], abs=1e-9)


def test_a_prior_is_multiplied_in():
    levels = [0.0, 10.0]
    biased = Quest(levels, levels, prior={"threshold": [3, 1]})
    assert biased.posterior == pytest.approx([0.75, 0.25])
    biased.update(True, 0.0)
    p = weibull(np.array(0.0), np.array(levels), 3.5, 0.5, 0.02)
    assert biased.posterior == pytest.approx(np.array([3, 1]) * p / (np.array([3, 1]) * p).sum())


def test_psychometric_functions():
    x = np.linspace(-20, 20, 9)
    assert weibull(np.array(3.0), 3.0, 2.0, 0.5, 0.02) == pytest.approx(0.98 - 0.48 / math.e)
    np.testing.assert_allclose(
        normal(x, 2.0, 3.0, 0.25, 0.05), 0.25 + 0.7 * norm.cdf(x, 2.0, 3.0), atol=1e-14
    )
    p = symmetric_normal(x, 0.0, 3.0, 0.7, 0.05)
    np.testing.assert_allclose(p + p[::-1], 1.0)  # guess has no part in it


@pytest.mark.parametrize("down_after", [1, 2, 3, 4])
def test_up_down_walks_as_levitt_says(down_after):
    """n right answers lead down, each wrong one up; a change of direction is a reversal."""
    method = UpDown(20.0, steps=(4.0, 2.0), down_after=down_after, reversals_per_step=1)
    for _ in range(2 * down_after):
        method.update(True)
    assert method.level == 12.0
    method.update(False)  # reversal at 12: steps of 2 from here
    assert method.reversals == [12.0] and method.level == 14.0
    for _ in range(down_after - 1):
        method.update(True)
    assert method.level == 14.0
    method.update(False)  # breaks the row, the same direction
    assert method.level == 16.0 and method.reversals == [12.0]
    for _ in range(down_after):
        method.update(True)
    assert method.level == 14.0 and method.reversals == [12.0, 16.0]


TARGETS = [
    (UpDown(0.0, (0.3,), down_after=1), 0.5),
    (UpDown(0.0, (0.3,), down_after=2), 0.7071),
    (UpDown(0.0, (0.3,), down_after=3), 0.7937),
    (weighted_up_down(0.75, 0.0, steps=(0.2,)), 0.75),
]


@pytest.mark.parametrize(("method", "target"), TARGETS)
def test_up_down_settles_at_its_target(method, target):
    """Levels of a long run, about the level where the observer is right that often."""
    assert method.target == pytest.approx(target, abs=1e-4)
    observer = SimulatedObserver(0.0, slope=6.0, guess=0.0, lapse=0.0, function="normal", seed=1)
    levels = []
    for trial in range(6000):
        levels.append(method.level)
        right = observer(Question(trial, ("a", "b"), method.level, "a")) == "a"
        method.update(right)
    # Steps of a twentieth of the observer's spread leave little skew; the mean of some thousand
    # levels that hang together over some tens of trials is known to 0.1 or so.
    assert np.mean(levels[200:]) == pytest.approx(6.0 * norm.ppf(target), abs=0.5)


@given(answers=st.lists(st.booleans(), max_size=60))
@settings(max_examples=50, deadline=None)
def test_up_down_never_leaves_its_range(answers):
    method = UpDown(3.0, (4.0, 1.0), lowest=0.0, highest=10.0, up_weight=2.0)
    for is_right in answers:
        assert 0 <= method.level <= 10
        method.update(is_right)
    assert 0 <= method.level <= 10


def test_up_down_is_done_after_its_reversals():
    method = UpDown(10.0, (2.0, 1.0), reversals_per_step=2, stop_after=4, down_after=1)
    trials = 0
    while not method.is_done:
        method.update(trials % 2 == 0)
        trials += 1
    assert len(method.reversals) == 6


@pytest.mark.parametrize("seed", range(3))
def test_methods_find_a_simulated_threshold(seed):
    observer = SimulatedObserver(22.0, slope=3.5, seed=seed)
    grid = np.arange(0.0, 45.0, 1.0)
    quest = Quest(grid, grid, [2.0, 3.5, 5.0], trials=80)
    constant = ConstantStimuli(range(14, 31, 2), repeats=60, seed=seed)
    for method in (quest, constant):
        trial = 0
        while not method.is_done:
            right = observer(Question(trial, ("1", "2"), method.level, "2")) == "2"
            method.update(right)
            trial += 1
        found = method.estimate()
        # Three standard errors; of the shares alone, theory gives 0.3 dB or more.
        assert found.width > 4 * 0.3 and abs(found.threshold - 22.0) < 0.75 * found.width


def test_a_fit_of_exact_shares_is_exact():
    levels = np.arange(10.0, 35.0, 2.0)
    shares = weibull(levels, 22.0, 3.0, 0.5, 0.02)
    answers = []
    for k in range(4000):  # in turn, so that nothing drifts
        answers += [
            (level, (k * 0.6180339887) % 1 < share)
            for level, share in zip(levels, shares, strict=True)
        ]
    found = fit(answers)
    # Shares are those of an even sequence, to 1/1000 or so; 4000 answers tell lapses to 0.002.
    assert found.threshold == pytest.approx(22.0, abs=0.1)
    assert found.others["slope"] == pytest.approx(3.0, abs=0.1)
    assert found.others["lapse"] == pytest.approx(0.02, abs=0.005)
    assert found.low < 22.0 < found.high and not found.warnings


def test_constant_stimuli_come_equally_often_in_an_order_of_the_seed():
    def order(seed):
        method, found = ConstantStimuli([1.0, 2.0, 3.0], repeats=4, seed=seed), []
        while not method.is_done:
            found.append(method.level)
            method.update(True)
        return found

    assert order(1) == order(1) != order(2)
    for k in range(0, 12, 3):
        assert sorted(order(1)[k : k + 3]) == [1.0, 2.0, 3.0]


@pytest.mark.parametrize(
    ("make", "pattern"),
    [
        (lambda: UpDown(0.0, ()), "steps"),
        (lambda: UpDown(0.0, (0.0,)), "steps"),
        (lambda: UpDown(9.0, highest=5.0), "start"),
        (lambda: UpDown(0.0, down_after=0), "down_after"),
        (lambda: weighted_up_down(1.0, 0.0), "target"),
        (lambda: Quest([2, 1], [1, 2]), "levels.*increasing"),
        (lambda: Quest([1, 2], [1, 2], guess=0.9, lapse=0.3), "guess and lapse"),
        (lambda: Quest([1, 2], [1, 2], function="logistic"), "logistic"),
        (lambda: Quest([1, 2], [1, 2], prior={"threshold": [1]}), "prior"),
        (lambda: Quest([1, 2], [1, 2], trials=0), "trials"),
        (lambda: Quest([1, 2], [1, 2], slope=0.0, function="normal"), "finite probabilities"),
        (lambda: ConstantStimuli([1.0]), "levels.*at least 2"),
        (lambda: fit([(1.0, True)] * 20, "logistic"), "logistic"),
    ],
)
def test_wrong_methods_are_refused(make, pattern):
    with pytest.raises(InputError, match=pattern):
        make()


def test_a_threshold_beyond_all_numbers_leaves_the_guess():
    far = Quest([6.0, 44.0], [1e308], slope=[2.0, 3.5, 5.0], guess=0.25)
    assert (far._likelihood[1] == 0.25).all()


def test_an_impossible_answer_is_said():
    certain = Quest([0.0, 100.0], [-400.0, -300.0], guess=0.5, lapse=0.0)
    with pytest.raises(InputError, match=r"guess.*lapse"):
        certain.update(False, 100.0)
