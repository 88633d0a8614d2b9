"""Thresholds that methods state: intervals that hold the truth, and none by chance."""

from functools import cache
from math import erfc, exp, log, sqrt
from random import Random

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from haptix.lab.experiment import ConstantStimuli, Quest, UpDown, fit
from haptix.lab.experiment.psychometric import fast_guesses

GRID = np.arange(6.0, 45.0, 1.0)
COARSE = np.arange(6.0, 45.0, 2.0)
CEILING = 46.0
METHODS = {
    "up-down": lambda seed: UpDown(36.0, stop_after=18),
    "quest+": lambda seed: Quest(
        COARSE, COARSE, (1.5, 2.5, 3.5, 5.0), lapse=(0.01, 0.04, 0.1), trials=100
    ),
    "constant-stimuli": lambda seed: ConstantStimuli(range(13, 32, 3), 20, seed),
}
RUNS = 25  # benchmarks/experiments.py has hundreds


def weibull(slope):
    """Share of the way from guess to all right, of a level above the threshold [dB]."""
    return lambda off: 1 - exp(-(10 ** min(slope * off / 20, 3)))


def normal(deviation):
    """The same of a cumulative normal; its threshold is where 1 - 1/e of the way is reached."""
    return lambda off: 0.5 * erfc(-(off / deviation + 0.3375) / sqrt(2))


OBSERVERS = {
    # Share, lapse rate, that after trial 60, drift in 100 trials.
    "assumed": (weibull(3.5), 0.02, 0.02, 0.0),
    "normal of 2 dB": (normal(2.0), 0.03, 0.03, 0.0),
    "normal of 5 dB": (normal(5.0), 0.03, 0.03, 0.0),
    "drifts": (weibull(3.5), 0.02, 0.02, 3.0),
    "tires": (weibull(3.5), 0.02, 0.15, 0.0),
    "slope 2": (weibull(2.0), 0.02, 0.02, 0.0),
    "slope 6": (weibull(6.0), 0.02, 0.02, 0.0),
}


def run(method, share, seed):
    """Run a method with the share right of a level in a trial; return it."""
    draw, trial = Random(seed), 0
    while not method.is_done:
        level = min(method.level, CEILING)
        method.update(draw.random() < share(level, trial), level)
        trial += 1
    return method


@cache
def estimates(name, observer):
    """What each run states, and the mean threshold in it."""
    core, first, later, drift = OBSERVERS[observer]
    found = []
    for seed in range(RUNS):
        start = 22 + 0.1 * (seed % 10)

        def share(level, trial, start=start):
            lapse = later if trial >= 60 else first
            return 0.5 + (0.5 - lapse) * core(level - start - drift * trial / 100)

        method = run(METHODS[name](seed), share, seed)
        truth = start + drift * (len(method.answers) - 1) / 200
        found.append((method.estimate(reaction_s=()), truth))
    return found


@pytest.mark.parametrize("name", METHODS)
@pytest.mark.parametrize(
    "observer",
    [
        name if name == "assumed" else pytest.param(name, marks=pytest.mark.slow)
        for name in OBSERVERS
    ],
)
def test_intervals_hold_the_truth(name, observer):
    found = [(one, truth) for one, truth in estimates(name, observer) if one.low == one.low]
    held = np.mean([one.low <= truth <= one.high for one, truth in found])
    # 0.92 at least, the benchmark says; of so few runs three errors below.
    assert len(found) >= RUNS - 2 and held > 0.92 - 3 * np.sqrt(0.92 * 0.08 / RUNS)
    assert np.median([one.width for one, _ in found]) < 9  # and tell something


@pytest.mark.parametrize("name", METHODS)
def test_good_runs_are_not_warned_of(name):
    warned = sum(bool(found.warnings) for found, _ in estimates(name, "assumed"))
    assert warned < 0.1 * RUNS


@pytest.mark.parametrize("name", METHODS)
def test_one_who_guesses_has_no_threshold(name):
    none = 0
    for seed in range(RUNS // 2):
        found = run(METHODS[name](seed), lambda level, trial: 0.5, seed).estimate()
        is_none = np.isnan(found.threshold)
        if is_none:  # it may lie anywhere above a level
            assert np.isfinite(found.low) and np.isinf(found.high)
            assert "no threshold" in found.warnings[0]
        none += is_none
    assert none >= RUNS // 2 - 1  # of 100 who guess, one is as good as one who feels


def test_a_walk_along_the_ceiling_gives_no_threshold():
    """However often the observer is right there."""
    found = run(UpDown(40.0), lambda level, trial: 0.7, 1).estimate()
    assert np.isnan(found.threshold) and "above the levels" in found.warnings[0]


def test_what_lies_outside_of_the_levels_is_no_threshold():
    far = weibull(3.5)
    quest = run(METHODS["quest+"](0), lambda level, _: 0.5 + 0.48 * far(level - 60.0), 0)
    assert np.isnan(quest.estimate().threshold)
    constant = run(METHODS["constant-stimuli"](0), lambda level, _: 0.98, 0)
    assert "below the levels" in " ".join(constant.estimate().warnings)


def test_no_good_observer_near_the_top_of_the_levels_is_lost():
    """Thresholds from the middle of the levels to above them; 2.5 dB, of seven levels by 14."""
    held, lost = 0, 0
    for seed in range(RUNS):
        truth = 26.0 + 13.0 * seed / RUNS
        method = ConstantStimuli(range(14, 39, 4), 14, seed)
        run(method, lambda level, _, at=truth: 0.5 + 0.49 * normal(2.5)(level - at), seed)
        found = method.estimate()
        held += found.low <= truth <= found.high
        lost += np.isnan(found.threshold) and truth < 35.0
        if np.isnan(found.threshold):  # above the levels, from an end that is known
            assert found.low < 38.0 and np.isinf(found.high) and found.likelihood is not None
    assert lost == 0 and held / RUNS > 0.92 - 3 * np.sqrt(0.92 * 0.08 / RUNS)


def with_fast_guesses(share, seed, guess_s=0.25, usual_s=0.7):
    """A run of the up-down method, some of whose answers are fast guesses; and the times."""
    draw, times, method = Random(seed), [], UpDown(36.0, stop_after=18)
    while not method.is_done:
        is_fast, level = draw.random() < share, min(method.level, CEILING)
        p = 0.5 if is_fast else 0.5 + 0.49 * normal(2.5)(level - 22.0)
        method.update(draw.random() < p, level)
        times.append(draw.lognormvariate(log(guess_s if is_fast else usual_s), 0.35))
    return method, times


@given(
    st.lists(
        st.tuples(st.sampled_from([1, 2, 3, 50, 700]), st.booleans()), min_size=30, max_size=60
    )
)
@example([(1, True)] * 30)
@example([(2, True)] * 30 + [(1, False)])
@example([(2, True)] + [(1, False)] * 30)
def test_times_of_a_coarse_clock_give_probabilities(trials):
    answers = [(20.0 + number % 3, is_right) for number, (_, is_right) in enumerate(trials)]
    found = fast_guesses(answers, [ms / 1e3 for ms, _ in trials])
    assert ((found >= 0) & (found <= 1)).all()


def test_fast_guesses_are_found_by_their_times():
    held, shares = 0, []
    for seed in range(RUNS):
        method, times = with_fast_guesses(0.3, seed)
        found = method.estimate(reaction_s=times)
        held += found.low <= 22.0 <= found.high
        shares.append(found.others.get("fast_guesses", 0.0))
        if shares[-1]:
            assert "fast guesses" in " ".join(found.warnings)
    assert held / RUNS > 0.92 - 3 * np.sqrt(0.92 * 0.08 / RUNS)
    # In most runs they are found, and then nearly as many as there are.
    assert np.median(shares) == pytest.approx(0.3, abs=0.06)


def test_an_up_down_run_without_times_says_what_it_cannot_allow_for():
    """Guesses lead its levels up, as a shallow function would: the answers alone do not tell."""
    method, times = with_fast_guesses(0.3, 1)
    untimed = method.estimate()
    assert np.isfinite(untimed.threshold) and "fast guesses" in untimed.warnings[-1]
    assert "not known" not in " ".join(method.estimate(reaction_s=times).warnings)
    constant = run(ConstantStimuli(range(13, 32, 3), 20, 1), of_normal_observer, 1)
    assert constant.estimate().warnings == ()
    grid = np.arange(10.0, 35.0, 1.0)
    for lapse, warned in ((0.02, True), ((0.01, 0.04, 0.1), False)):
        quest = Quest(grid, grid, (2.0, 3.5, 5.0), lapse=lapse, trials=40)
        found = run(quest, of_normal_observer, 2).estimate()
        assert ("fast guesses" in " ".join(found.warnings)) == warned


def of_normal_observer(level, trial):
    return 0.5 + 0.48 * normal(2.5)(level - 22.0)


def test_fast_right_answers_are_no_guesses():
    """A good observer answers easy trials fast: nothing is taken away."""
    for seed in range(6):
        method, times = with_fast_guesses(0.0, seed)
        easy = [0.4 if level > 28 else 1.0 for level, _ in method.answers]
        times = [time * one for time, one in zip(times, easy, strict=True)]
        assert fast_guesses(method.answers, times).max() == 0.0
        assert method.estimate(reaction_s=times) == method.estimate(reaction_s=())


def test_a_few_answers_give_no_threshold():
    found = fit([(20.0, True), (10.0, False)] * 4)
    assert np.isnan(found.threshold) and "8 answers; it takes 10" in found.warnings[0]


def test_what_an_observer_does_is_said():
    """A drift of 20 dB, lapses of a quarter, shares out of order: each in words."""
    core = weibull(3.5)

    def moved(level, trial):
        return 0.5 + 0.5 * core(level - 15.0 - 20.0 * trial / 280)

    levels = range(8, 37, 4)
    drifting = run(ConstantStimuli(levels, 35, 1), moved, 1).estimate()
    assert "drifts by +" in drifting.warnings[0] and drifting.others["drift"] > 4
    lapsing = run(
        ConstantStimuli(levels, 35, 1), lambda level, _: 0.5 + 0.3 * core(level - 15.0), 1
    ).estimate()
    assert "are lapses" in lapsing.warnings[0]
    wild = ConstantStimuli([10.0, 15.0, 20.0, 25.0, 30.0], 80, 3)
    shares = {10.0: 0.5, 15.0: 0.97, 20.0: 0.5, 25.0: 0.9, 30.0: 0.98}
    assert "out of order" in " ".join(run(wild, lambda x, _: shares[x], 4).estimate().warnings)


@pytest.mark.slow
@pytest.mark.parametrize(("guess", "empties"), [(0.05, 100), (0.3, 100)])
def test_trials_without_a_target_tell_who_says_yes(guess, empties):
    """Yes or no: the share of false alarms is a parameter, and is returned."""
    held, told, core = 0, [], weibull(3.5)
    for seed in range(RUNS):
        draw = Random(f"empty {seed}")
        false = sum(draw.random() < guess for _ in range(empties))
        method = ConstantStimuli(range(13, 32, 3), 20, seed)
        run(method, lambda level, _: guess + (0.98 - guess) * core(level - 22.0), seed)
        found = method.estimate((false, empties))
        told.append(found.others["guess"])
        held += found.low <= 22.0 <= found.high
    assert held / RUNS > 0.92 - 3 * np.sqrt(0.92 * 0.08 / RUNS)
    # The error of a mean share of so many trials; the answers at low levels tell it too.
    assert np.mean(told) == pytest.approx(guess, abs=0.02)


@pytest.mark.parametrize("function", ["normal", "symmetric-normal"])
def test_levels_in_another_unit_give_the_same(function):
    """A normal function of a linear level: millimetres and metres alike."""
    draw = Random(3)
    answers = []
    for _ in range(30):
        for level in np.linspace(-6.0, 6.0, 9).tolist():
            share = 0.5 * erfc(-(level - 1.0) / 2.0 / sqrt(2))
            answers.append((level, draw.random() < share))
    one = fit(answers, function, 0.0)
    small = fit([(level / 1000, right) for level, right in answers], function, 0.0)
    assert one.low < 1.0 < one.high and one.width < 1.5
    assert [small.threshold, small.low] == pytest.approx([one.threshold / 1000, one.low / 1000])


def test_a_run_ends_at_its_most_trials():
    method = run(UpDown(30.0, highest=40.0, most_trials=50), lambda level, _: 0.0, 0)
    assert len(method.answers) == 50 and np.isnan(method.estimate().threshold)
