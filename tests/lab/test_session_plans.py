"""Practice, catch trials, breaks, interleaved walks, stop rules, tasks, orders and power."""

import io
from collections import Counter
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import nct, t

from haptix.base.errors import InputError
from haptix.lab.analysis.power import Observer, accuracy, paired_power
from haptix.lab.analysis.results import analyse
from haptix.lab.experiment import (
    TASKS,
    Catch,
    ConstantStimuli,
    Estimate,
    Exclude,
    Experiment,
    Keys,
    Magnitudes,
    MethodsByCondition,
    Pairs,
    Practice,
    Quest,
    Question,
    SessionPlan,
    SimulatedObserver,
    StopRules,
    UpDown,
)
from haptix.lab.experiment.orders import latin_square, order_for, williams_square
from haptix.lab.experiment.recipe import ExperimentRecipe
from haptix.lab.experiment.session_plan import TrialSequence, detection, method_of
from tests.lab.presented import at_level

WAVE = np.sin(2 * np.pi * 120 * np.arange(240) / 48_000)
ABSENT = SessionPlan(catch=Catch(share=0.4))


def experiment(device, path, method, task="2ifc", plan=None, answer=None, made=None, **more):
    answer = answer or (lambda question: question.right)
    return Experiment(
        method, made or at_level(WAVE), device, answer, path, task, plan=plan or SessionPlan(),
        wait=lambda seconds: None, **more,
    )  # fmt: skip


def test_practice_catch_trials_breaks_and_feedback(device, tmp_path):
    plan = SessionPlan(
        practice=Practice(trials=3, level=40.0), catch=Catch(share=0.3, level=38.0), break_every=5
    )
    told, rests = [], []
    method = ConstantStimuli([20.0, 25.0], 10)
    run = experiment(
        device, tmp_path / "a.tsv", method, plan=plan, rest=rests.append, tell=told.append
    )
    rows = list(run)
    kinds = [row["kind"] for row in rows]
    assert kinds[:3] == ["practice"] * 3 and "practice" not in kinds[3:]
    level_of = {"practice": {"40.0"}, "catch": {"38.0"}, "trial": {"20.0", "25.0"}}
    assert all(row["level"] in level_of[row["kind"]] for row in rows)
    # The method has heard of its own trials alone, and of all of them.
    assert Counter(level for level, _ in method.answers) == {20.0: 10, 25.0: 10}
    assert kinds.count("catch") >= 1 and run.counted == 20 == kinds.count("trial")
    assert told == [True] * 3
    assert rests == list(range(8, len(rows), 5))
    assert run.summary() == {"catch_trials": kinds.count("catch"), "catch_right": 1.0}


def test_conditions_that_are_interleaved_are_all_practised(device, tmp_path):
    plan = SessionPlan(practice=Practice(trials=6, level=40.0))
    methods = {name: ConstantStimuli([20.0, 25.0], 2) for name in "abc"}
    made = {name: at_level(WAVE, 1 - 0.1 * k) for k, name in enumerate(methods)}
    rows = list(
        experiment(device, tmp_path / "a.tsv", MethodsByCondition(methods), plan=plan, made=made)
    )
    assert Counter(row["condition"] for row in rows[:6]) == {"a": 2, "b": 2, "c": 2}
    assert Counter(row["condition"] for row in rows[6:]) == {"a": 4, "b": 4, "c": 4}


def test_a_resumed_session_has_the_same_trials(device, tmp_path):
    plan = SessionPlan(practice=Practice(trials=2, level=40.0), catch=Catch(share=0.3, level=38.0))

    def one(path):
        methods = {name: UpDown(30.0, (8.0, 4.0), stop_after=2) for name in "ab"}
        made = {name: at_level(WAVE, scale) for name, scale in (("a", 1.0), ("b", 0.9))}
        answer = SimulatedObserver(20.0, seed=3)
        return experiment(
            device, path, MethodsByCondition(methods), plan=plan, answer=answer, made=made
        )

    whole = one(tmp_path / "whole.tsv")
    whole.run()
    done = False
    while not done:
        part = one(tmp_path / "parts.tsv")
        for number, _ in enumerate(part):
            if number == 15:
                break
        part.log.close()
        done = part.is_over
    names = ("trial", "kind", "condition", "level", "right", "answer")
    rows, again = ([[row[name] for name in names] for row in one.log.rows] for one in (whole, part))
    assert rows == again
    assert {row[2] for row in rows} == {"a", "b"}
    # Interleaved: neither condition waits for the other.
    halves = [row[2] for row in rows[: len(rows) // 2]]
    assert set(halves) == {"a", "b"}
    assert set(whole.estimates()) == {"a", "b"}


def test_stop_rules(device, tmp_path):
    always = ConstantStimuli([20.0, 25.0], 50)
    plan = SessionPlan(stop=StopRules(most_trials=7), catch=Catch(share=0.5, level=40.0))
    run = experiment(device, tmp_path / "a.tsv", always, plan=plan)
    run.run()
    assert run.counted == 7 < run.trials
    now = iter(range(10_000))
    slow = experiment(
        device, tmp_path / "b.tsv", ConstantStimuli([20.0, 25.0], 50),
        plan=SessionPlan(stop=StopRules(most_minutes=2.0)), clock=lambda: float(next(now)),
    )  # fmt: skip
    slow.run()
    assert 2 < slow.trials < 12


def test_a_session_ends_by_the_interval_that_it_states(device, tmp_path):
    """Not by that of its trials without the false alarms, which raise what a guess finds."""
    method = ConstantStimuli([14.0, 18.0, 22.0, 26.0, 30.0], 60, guess=0.05)
    plan = SessionPlan(catch=Catch(share=0.3), stop=StopRules(spread=1.8))
    run = experiment(
        device, tmp_path / "a.tsv", method, "yes-no", plan,
        SimulatedObserver(22.0, guess=0.3, seed=3), source="simulated",
    )  # fmt: skip
    widths = [run.estimates()[""].width / 4 for _ in run if run.counted >= 20]
    assert not method.is_done
    assert widths[-1] <= 1.8
    assert all(width > 1.8 for width in widths[:-1])


def test_exclusion_says_why_and_keeps_the_data(device, tmp_path):
    plan = SessionPlan(catch=Catch(share=0.5, level=40.0), exclude=Exclude(catch_right=0.9))

    def asleep(question):
        return next(one for one in question.choices if one != question.right)

    run = experiment(
        device, tmp_path / "a.tsv", ConstantStimuli([20.0, 25.0], 5), plan=plan, answer=asleep
    )
    run.run()
    assert "catch trials were right" in run.summary()["excluded"] and run.counted == 10


class Listening:
    """A device that keeps the peaks of what each interval played."""

    def __init__(self, inner):
        self.inner, self.limits, self.mode, self.peaks = inner, inner.limits, inner.mode, []

    def __enter__(self):
        self.inner.__enter__()
        return self

    def __exit__(self, *error):
        return self.inner.__exit__(*error)

    def write(self, volts):
        self.peaks.append(float(np.abs(volts).max()))
        self.inner.write(volts)


@pytest.mark.parametrize("task", ["3afc", "yes-no", "same-different"])
def test_the_right_answer_is_what_was_played(device, tmp_path, task):
    listening, plan = Listening(device), ABSENT if TASKS[task].detects else None
    run = experiment(listening, tmp_path / "a.tsv", ConstantStimuli([20.0, 26.0], 9), task, plan)
    rows = list(run)
    each = np.reshape(np.array(listening.peaks) > 1, (len(rows), TASKS[task].intervals))
    for row, felt in zip(rows, each, strict=True):
        if task == "3afc":
            assert felt.sum() == 1 and row["right"] == str(felt.argmax() + 1)
        elif task == "yes-no":
            assert row["right"] == ("y" if felt[0] else "n")
            assert row["kind"] == ("trial" if felt[0] else "catch")
        else:
            assert row["right"] == ("d" if felt[0] != felt[1] else "s")
    assert len({row["right"] for row in rows}) == len(TASKS[task].choices)
    assert run.counted == 18


def test_each_condition_has_its_own_hits_and_false_alarms(device, tmp_path):
    """In one everything is found, also where there is nothing; in the other only what is there."""
    levels = [14.0, 20.0, 26.0, 32.0]
    methods = {name: ConstantStimuli(levels, 10, guess=0.05) for name in ("lax", "strict")}
    made = {name: at_level(WAVE, scale) for name, scale in (("lax", 1.0), ("strict", 0.9))}
    sequence = MethodsByCondition(methods)

    def answer(question):
        is_felt = question.level > 23 and not question.is_empty
        return "y" if sequence.condition == "lax" or is_felt else "n"

    run = experiment(
        device, tmp_path / "a.tsv", sequence, "yes-no", ABSENT, answer, made, source="program"
    )
    empty = Counter(row["condition"] for row in run if row["kind"] == "catch")
    of_run = run.records()
    of_table = {row["condition"]: row for row in analyse(tmp_path / "a.tsv").tables["thresholds"]}
    for name, hits, false_alarms in (("lax", 40, empty["lax"]), ("strict", 20, 0)):
        for found in (of_run[name], of_table[name]):
            assert found["catch_trials"] == empty[name] > 0
            assert found["catch_right"] == 1 - false_alarms / empty[name]
            assert found["hits"] == pytest.approx((hits + 0.5) / 41)
            assert found["false_alarms"] == pytest.approx((false_alarms + 0.5) / (empty[name] + 1))
            # The fitted function has the false alarms of its own condition.
            assert (found["threshold_db"] is None) == (name == "lax")
        assert of_run[name]["trials"] == empty[name] + 40 and of_table[name]["trials"] == 40
    assert run.summary()["catch_trials"] == empty.total()


def test_one_who_always_says_yes_has_no_threshold(device, tmp_path):
    run = experiment(
        device, tmp_path / "a.tsv", ConstantStimuli([20.0, 26.0], 20, guess=0.05), "yes-no",
        ABSENT, lambda question: "y",
    )  # fmt: skip
    run.run()
    assert "no threshold" in run.estimates()[""].warnings[0]
    assert abs(run.summary()["d_prime"]) < 0.8
    with pytest.raises(InputError, match="without a target"):
        experiment(device, tmp_path / "b.tsv", ConstantStimuli([20.0, 26.0]), "yes-no")


@pytest.mark.parametrize("d", [0.5, 1.5, 2.5])
def test_d_prime_is_that_of_the_observer(d):
    """Counts so large that half an answer is nothing; both models simulated by their decisions."""
    n, draw = 400_000, np.random.default_rng(1)
    said = [int((draw.standard_normal(n) + d * shift > 0.7).sum()) for shift in (1, 0)]
    found = detection(said[0], n, said[1], n)
    # Four errors of the shares over the normal density at them.
    assert found["d_prime"] == pytest.approx(d, abs=0.02)
    assert found["criterion"] == pytest.approx(0.7 - d / 2, abs=0.02)
    pairs = draw.standard_normal((2, n, 2))
    pairs[0, :, 1] += d
    said = (np.abs(np.diff(pairs)[..., 0]) > 1.3).sum(1)
    found = detection(int(said[0]), n, int(said[1]), n, "same-different")
    assert found["d_prime"] == pytest.approx(d, abs=0.05)


def test_magnitudes_find_the_power(device, tmp_path):
    method = Magnitudes([10.0, 20.0, 30.0, 40.0], 6)
    answer = SimulatedObserver(20.0, seed=4)
    experiment(device, tmp_path / "a.tsv", method, "magnitude", answer=answer).run()
    found = method.estimate().others
    assert found["exponent"] == pytest.approx(0.6, abs=4 * found["exponent_spread"])
    assert experiment(device, tmp_path / "a.tsv", Magnitudes([10.0, 20.0, 30.0, 40.0], 6),
                      "magnitude", answer=answer).is_over  # fmt: skip
    keys = Keys(source=io.StringIO("soft\n-1\n7.5\n"), sink=io.StringIO())
    assert keys(Question(0, (), 1.0, "")) == "7.5"
    with pytest.raises(InputError, match="number above 0"):
        experiment(device, tmp_path / "b.tsv", Magnitudes([1.0, 2.0]), "magnitude",
                   answer=lambda question: "much").run()  # fmt: skip


def test_pairs_are_all_compared_and_scaled(device, tmp_path):
    listening, levels = Listening(device), [10.0, 20.0, 30.0]
    method = Pairs(levels, 40)
    draw = np.random.default_rng(2)

    def answer(question):  # by Bradley & Terry, 1 logit apart
        p = 1 / (1 + np.exp(-(question.level - question.other_levels[0]) / 10))
        other = next(one for one in question.choices if one != question.right)
        return question.right if draw.random() < p else other

    rows = list(experiment(listening, tmp_path / "a.tsv", method, "pairs", answer=answer))
    assert set(Counter(frozenset((a, b)) for a, b, _ in method.answers).values()) == {40}
    for row, peaks in zip(rows, np.reshape(listening.peaks, (-1, 2)), strict=True):
        of_level = peaks[int(row["right"]) - 1]
        assert 20 * np.log10(of_level) == pytest.approx(float(row["level"]), abs=0.1)
    scale = [method.estimate().others[f"scale_at_{x:g}"] for x in levels]
    # 40 comparisons of a pair know a logit to about 0.35, and a scale value to less.
    assert scale == pytest.approx([-1, 0, 1], abs=0.8) and sum(scale) == pytest.approx(0)


@given(count=st.integers(1, 9))
@settings(max_examples=9, deadline=None)
def test_squares_are_balanced(count):
    for square in (latin_square(count), williams_square(count)):
        assert all(sorted(row) == list(range(count)) for row in square)
        for column in zip(*square, strict=True):
            assert len(set(Counter(column).values())) == 1 and len(set(column)) == count
    follows = Counter(pair for row in williams_square(count) for pair in pairwise(row))
    assert len(follows) == count * (count - 1) and len(set(follows.values())) <= 1
    rows = len(williams_square(count))
    orders = [order_for(list(range(count)), 1 + k) for k in range(rows)]
    assert orders == williams_square(count)
    assert order_for(list(range(count)), 1 + rows) == orders[0]


RECIPE = {
    "name": "two",
    "stimulus": {"quantity": "volts", "drive_hz": 120, "length_s": 0.01,
                 "signal": {"kind": "sine", "amplitude": 1.0, "frequency_hz": 120}},
    "method": {"kind": "up-down", "start": 30.0},
    "conditions": [{"name": "slow", "set": {"stimulus.drive_hz": 60}},
                   {"name": "long", "set": {"method.start": 20.0}}, {"name": "plain"}],
}  # fmt: skip


def test_a_recipe_has_conditions_in_an_order_by_participant():
    def make(participant=1, **more) -> Any:
        return ExperimentRecipe(**{**RECIPE, **more}).make_method(participant)

    method = make()
    assert method.interleaved and set(method.methods) == {"slow", "long", "plain"}
    assert method.methods["long"].start == 20.0 and method.methods["slow"].start == 30.0
    blocks = [tuple(make(k, order="williams").methods) for k in range(1, 7)]
    assert len(set(blocks)) == 6
    tables = ExperimentRecipe(**RECIPE)._tables(ExperimentRecipe(**RECIPE).conditions[0])
    assert tables["stimulus"]["drive_hz"] == 60
    wrong = [{"name": "a", "set": {"stimulus.signal.of.frequency_hz": 1}}]
    with pytest.raises(InputError, match=r"conditions\.a\.set\.stimulus"):
        ExperimentRecipe(**{**RECIPE, "conditions": wrong}).make_method()
    for place in ("drive_hz", "finger", "seed"):  # which nothing would read
        beside = [{"name": "a"}, {"name": "b", "set": {place: 3}}]
        with pytest.raises(InputError, match=rf"conditions\.b\.set\.{place}: .*stimulus"):
            make(conditions=beside)
    with pytest.raises(InputError, match="differ"):
        ExperimentRecipe(**{**RECIPE, "conditions": [{"name": "a"}, {"name": "a"}]})
    assert make(conditions=[], task="3afc").guess == pytest.approx(1 / 3)
    with pytest.raises(InputError, match=r"method\.kind.*'pairs'"):
        ExperimentRecipe(**{**RECIPE, "task": "pairs"}).make_method()


def test_each_condition_has_an_order_of_its_own():
    method = {"kind": "constant-stimuli", "levels": [14, 18, 22, 26], "repeats": 3}
    for more in ({}, {"seed": 5}):
        recipe = ExperimentRecipe(**{**RECIPE, "method": method | more, "conditions": [
            {"name": "slow", "set": {"stimulus.drive_hz": 60}}, {"name": "plain"}]})  # fmt: skip
        slow, plain = recipe.make_method(1, 7).methods.values()  # type: ignore[attr-defined]
        again = recipe.make_method(1, 7).methods["slow"]  # type: ignore[attr-defined]
        assert slow._order != plain._order
        assert again._order == slow._order
        assert method_of(slow.describe())._order == slow._order  # type: ignore[attr-defined]


def sides(methods: MethodsByCondition) -> list[tuple[str, str]]:
    """Condition and right answer of each trial, with the default seed."""
    sequence, found = TrialSequence(methods, TASKS["2ifc"], SessionPlan(), 0), []
    while not methods.is_done:
        trial = sequence.next()
        found.append((trial.condition, trial.right))
        row = {"accepted": "true", "kind": "trial", "is_right": "true", "level": str(trial.level)}
        sequence.hear(row | {"condition": trial.condition})
    return found


def test_the_interval_of_the_target_does_not_follow_the_condition():
    levels, repeats = [20.0, 25.0], 100

    def methods(**more):
        return MethodsByCondition({at: ConstantStimuli(levels, repeats) for at in "ab"}, **more)

    counts = Counter(sides(methods()))
    for condition in "ab":
        # Four standard deviations of a fair coin.
        assert abs(counts[condition, "1"] - repeats) < 4 * (2 * repeats) ** 0.5 / 2
    # A log that was written before has these trials, and they are still regenerated.
    old = method_of({k: v for k, v in methods().describe().items() if k != "stream"})
    assert isinstance(old, MethodsByCondition)
    assert {*sides(old)[: 2 * repeats]} == {("a", "1"), ("b", "2")}


def test_the_power_of_a_plan_is_that_of_theory(monkeypatch):
    """Of a method that reads the threshold with a known scatter of 1: a z-test in the limit."""
    draw, grid = np.random.default_rng(5), np.linspace(-10, 60, 500)

    class Reads:
        def __init__(self, threshold):
            self.threshold = threshold + draw.standard_normal()

        def estimate(self, reaction_s):
            logs = -0.5 * (grid - self.threshold) ** 2
            return Estimate(self.threshold, likelihood=(grid, logs))

    monkeypatch.setattr(
        "haptix.lab.analysis.power.one_run",
        lambda make, observer, seed, ceiling: (Reads(observer.threshold), 1),
    )
    power = "haptix.lab.analysis.power"
    monkeypatch.setattr(f"{power}._quick_likelihood", lambda run, _: run.estimate(()).likelihood)
    monkeypatch.setattr(f"{power}._TESTED", 36)
    monkeypatch.setattr(f"{power}._KNOWN_WITHIN", 0.15)
    for difference in (0.0, 2.0):
        (row,) = paired_power(None, Observer(22.0), difference, 1.5, (12,), runs=10)
        # Each of two readings scatters by 1, and by a third of that between participants.
        shift, limit = difference / np.sqrt(2 * (1 + 0.5**2) / 12), t.ppf(0.975, 11)
        power_of_t = 1 - nct.cdf(limit, 11, shift) + nct.cdf(-limit, 11, shift)
        # The model knows the scatter of a reading, which a t-test estimates with all else.
        assert row["power_low"] - 0.03 <= power_of_t <= row["power_high"] + 0.03
        assert row["power_high"] - row["power_low"] <= 0.3


def test_the_accuracy_of_a_plan():
    quest = Quest(np.arange(10.0, 35.0, 1.0), np.arange(10.0, 35.0, 1.0), trials=30)

    def make():
        return replace(quest)

    row = accuracy(make, Observer(22.0), 20)
    assert row["trials"] == 30 and row["no_threshold"] == 0 and row["warned"] < 0.1
    assert abs(row["bias"]) < 2 * row["scatter"] and row["coverage"] > 0.7
