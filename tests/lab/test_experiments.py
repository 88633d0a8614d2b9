"""Trials on the mock device: what is played, written down, repeated and never exceeded."""

import io
import math
import os
import pty
import tty

import numpy as np
import pytest

from firmware_io import open_device
from haptix.base.errors import HaptixError, InputError, LimitError
from haptix.feel import Constant, Sine
from haptix.lab.experiment import (
    ConstantStimuli,
    Experiment,
    Keys,
    Presentation,
    Quest,
    Question,
    SimulatedObserver,
    Touch,
    UpDown,
)
from haptix.lab.experiment.recipe import presentation_of
from haptix.lab.stimuli import Rendering, Stimulus
from tests.hand_clock import HandClock
from tests.lab.chained import stopped_after
from tests.lab.presented import at_level

RATE = 48_000
WAVE = np.sin(2 * np.pi * 120 * np.arange(RATE // 20) / RATE)


def experiment(device, path, method=None, answer=None, presentation=None, **more):
    clock = HandClock(0.0)
    return Experiment(
        method or UpDown(40.0, (8.0, 4.0), stop_after=4),
        presentation or at_level(WAVE),
        device,
        answer or SimulatedObserver(24.0, seed=2),
        path,
        clock=clock,
        wait=clock.sleep,
        **more,
    )


def played(device):
    """Volts of all that was played."""
    return np.asarray(device.mock.played_v)


def test_two_intervals_are_played_and_the_right_one_is_known(device, tmp_path):
    rows = list(experiment(device, tmp_path / "log.tsv", ConstantStimuli([30.0, 34.0], 3)))
    assert len(rows) == 6
    assert {row["right"] for row in rows} == {"1", "2"}
    assert all(row["answer"] in ("1", "2") for row in rows)
    assert all((row["right"] == row["answer"]) == (row["is_right"] == "true") for row in rows)
    volts = played(device)
    peaks = [10 ** (float(row["level"]) / 20) for row in rows]
    # The mock rounds to 16 bits of 250 V.
    assert np.abs(volts).max() == pytest.approx(max(peaks), abs=0.01)


def test_the_target_is_in_the_interval_that_is_right(device, tmp_path):
    """A device that keeps what each interval played."""
    intervals = []

    class Watching:
        def __init__(self, inner):
            self.inner = inner
            self.limits, self.mode = inner.limits, inner.mode

        def __enter__(self):
            self.inner.__enter__()
            return self

        def __exit__(self, *error):
            return self.inner.__exit__(*error)

        def write(self, volts):
            intervals.append(np.array(volts))
            self.inner.write(volts)

    rows = list(experiment(Watching(device), tmp_path / "a.tsv", ConstantStimuli([30.0, 34.0], 4)))
    for row, first, second in zip(rows, intervals[::2], intervals[1::2], strict=True):
        target, other = (first, second) if row["right"] == "1" else (second, first)
        assert np.abs(target).max() == pytest.approx(10 ** (float(row["level"]) / 20), rel=1e-3)
        assert not other.any()
    intervals.clear()
    rows = list(
        experiment(
            Watching(device), tmp_path / "b.tsv", ConstantStimuli([30.0, 34.0], 4), task="2afc"
        )
    )
    assert len(intervals) == len(rows) and {row["right"] for row in rows} == {"l", "r"}
    for row, both in zip(rows, intervals, strict=True):
        left, right = both[: len(WAVE)], both[len(WAVE) :]
        assert left.any() == (row["right"] == "l") and right.any() == (row["right"] == "r")


def test_a_device_that_makes_its_own_carrier_is_refused(tmp_path):
    made = open_device("mock:mode=envelope,carrier_hz=4000")
    with pytest.raises(InputError, match="waveform mode"):
        experiment(made, tmp_path / "log.tsv")
    made.close()


@pytest.mark.parametrize("ceiling", [None, 60.0])
def test_the_ceiling_holds_whatever_the_method_asks(device, tmp_path, ceiling):
    """An observer who is always wrong drives the method up and up."""

    def wrong(question):
        return next(choice for choice in question.choices if choice != question.right)

    method = UpDown(30.0, (20.0,), stop_after=99)
    run = iter(experiment(device, tmp_path / "log.tsv", method, wrong, ceiling_v=ceiling))
    rows = [next(run) for _ in range(6)]
    limit = 200.0 if ceiling is None else ceiling
    assert float(rows[-1]["level_asked"]) > 20 * np.log10(limit)
    assert float(rows[-1]["level"]) == pytest.approx(20 * np.log10(limit), abs=1e-6)
    assert rows[-1]["lowered_to_ceiling"] == "true" and rows[0]["lowered_to_ceiling"] == "false"
    assert np.abs(played(device)).max() <= limit + 250 / 32767
    # The method was told what was presented.
    assert method.level == pytest.approx(20 * np.log10(limit) + 20, abs=1e-6)


def test_a_presentation_that_lies_about_its_peak_is_stopped(device, tmp_path):
    lying = Presentation(lambda level: 300 * WAVE, 0 * WAVE, lambda level: 1.0)
    with pytest.raises(LimitError, match="ceiling"):
        experiment(device, tmp_path / "log.tsv", presentation=lying).run()
    assert not np.any(played(device)) and not device.is_armed
    with pytest.raises(LimitError, match="device's 200 V"):
        experiment(device, tmp_path / "log.tsv", ceiling_v=201.0)


def test_trials_with_a_wrong_touch_are_repeated(device, tmp_path):
    """Force or speed off by more than 15 %: written down, not counted, presented again."""
    touches = iter(
        [
            Touch(0.5, 100.0), Touch(0.576, 100.0), None, Touch(0.5, 84.9), Touch(0.575, 85.0),
            *[Touch(0.5, 100.0)] * 50,
        ]
    )  # fmt: skip
    levels = []
    method = Quest(np.arange(10.0, 40.0, 2), np.arange(10.0, 40.0, 2), trials=10)
    run = experiment(
        device, tmp_path / "log.tsv", method, touch=lambda: next(touches),
        normal_force_n=0.5, speed_mm_per_s=100.0,
    )  # fmt: skip
    rows = list(run)
    levels = [row["level"] for row in rows]
    assert [row["accepted"] for row in rows[:6]] == ["true", "false", "false", "false", "true",
                                                    "true"]  # fmt: skip
    assert [row["trial"] for row in rows[:6]] == ["0", "1", "1", "1", "1", "2"]
    assert [row["attempt"] for row in rows[:6]] == ["0", "0", "1", "2", "3", "0"]
    assert len(set(levels[1:5])) == 1
    assert "0.576" in rows[1]["why"] and "no touch" in rows[2]["why"]
    assert "speed_mm_per_s was 84.9" in rows[3]["why"]
    assert run.trials == method.asked == 10
    with pytest.raises(InputError, match="20 attempts"):
        experiment(device, tmp_path / "b.tsv", touch=lambda: None, normal_force_n=0.5).run()


def test_every_trial_is_on_the_disk_before_the_next(device, tmp_path, monkeypatch):
    path, synced = tmp_path / "log.tsv", []
    sync = os.fsync

    def noted_sync(fd):
        sync(fd)
        synced.append(path.read_text().count("\n") if path.exists() else 0)

    monkeypatch.setattr(os, "fsync", noted_sync)

    def answer(question):
        lines = path.read_text().splitlines()
        assert len(lines) == synced[-1] == 2 + question.trial  # all before this one
        return question.right

    experiment(device, path, ConstantStimuli([20.0, 30.0], 3), answer).run()
    assert set(synced) == {0, *range(2, 9)} and synced == sorted(synced)


@pytest.mark.parametrize("written", [0, 1, 25])
def test_a_run_that_was_stopped_goes_on_as_if_it_had_not(device, tmp_path, written):
    """Stopped while its seventh trial was written, of which some bytes are there."""

    def run(path, count=None):
        one = experiment(device, path, UpDown(40.0, (8.0, 4.0), stop_after=4))
        for number, _ in enumerate(one, 1):
            if number == count:
                return None
        return one

    def lines(path):
        head, *rows = (line.split("\t") for line in path.read_text().splitlines())
        return [head, *(row[:2] + row[3:13] for row in rows)]  # but for when it was

    whole = run(tmp_path / "whole.tsv")
    run(tmp_path / "cut.tsv", 7)
    last = (tmp_path / "cut.tsv").read_bytes().splitlines()[-1]
    stopped_after(tmp_path / "cut.tsv", 6)
    with (tmp_path / "cut.tsv").open("ab") as file:
        file.write(last[:written])
    again = run(tmp_path / "cut.tsv")
    assert lines(tmp_path / "cut.tsv") == lines(tmp_path / "whole.tsv")
    assert again.method.estimate() == whole.method.estimate()


def test_logs_that_are_not_this_experiments_are_refused(device, tmp_path):
    path = tmp_path / "log.tsv"
    experiment(device, path, ConstantStimuli([20.0, 30.0], 1)).run()
    with pytest.raises(HaptixError, match="another experiment"):
        experiment(device, path, ConstantStimuli([20.0, 31.0], 1))
    path.write_text("what\never\n")
    with pytest.raises(HaptixError, match="not a log"):
        experiment(device, path)
    path.write_bytes(b"\xff\xfe\n\xff\n")
    with pytest.raises(HaptixError, match="not a log"):
        experiment(device, path)
    with pytest.raises(HaptixError, match="Is a directory"):
        experiment(device, tmp_path)


def test_a_full_disk_stops_the_experiment(device, tmp_path, monkeypatch):
    run = experiment(device, tmp_path / "log.tsv")

    def full(fd):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(InputError, match="No space left"):
        run.run()
    assert not device.is_armed


def test_the_voltage_is_off_whenever_nothing_is_presented(device, tmp_path):
    seen = []

    def answer(question):
        seen.append((device.is_armed, device.last_v))
        return question.right

    experiment(device, tmp_path / "log.tsv", ConstantStimuli([20.0, 30.0], 2), answer).run()
    assert seen == [(False, 0.0)] * 4


def test_keys_answer(device, tmp_path, monkeypatch):
    question = Question(0, ("1", "2"), 0.0, "1")
    sink = io.StringIO()
    assert Keys(source=io.StringIO("x2"), sink=sink)(question) == "2"
    assert "1/2" in sink.getvalue()
    with pytest.raises(InputError, match="keys ended"):
        Keys(source=io.StringIO(""), sink=sink)(question)
    # On a terminal one key press does, without Enter.
    leader, follower = pty.openpty()
    set_up = tty.setcbreak

    def press_after(descriptor):  # setting up forgets what was pressed before
        set_up(descriptor)
        os.write(leader, b"1")

    monkeypatch.setattr(tty, "setcbreak", press_after)
    with os.fdopen(follower, "r") as terminal:
        assert Keys(source=terminal, sink=sink)(question) == "1"
    os.close(leader)
    with pytest.raises(InputError, match="'3'"):
        experiment(device, tmp_path / "log.tsv", answer=lambda question: "3").run()


def test_observers_answer_by_their_trial_alone():
    observer = SimulatedObserver(20.0, seed=4)
    ask = [Question(k, ("1", "2"), 20.0, "1") for k in range(4000)]
    answers = [observer(one) for one in ask]
    assert answers == [observer(one) for one in reversed(ask)][::-1]
    share = answers.count("1") / 4000
    assert share == pytest.approx(0.98 - 0.48 / math.e, abs=4 * 0.0063)  # 4 binomial deviations


def test_levels_of_friction_stay_within_what_there_is(response, device, tmp_path):
    stimulus = Stimulus("a", (Sine(0.5, 40.0) + 0.5).lasting(0.05))
    made = presentation_of(stimulus, response, float(RATE))
    highest = 20 * np.log10(response.highest_mu / response.lowest_mu - 1)
    run = experiment(device, tmp_path / "log.tsv", UpDown(0.0, (3.0,)), presentation=made)
    assert run.allowed(10.0) == pytest.approx(highest, abs=1e-6)
    assert run.allowed(highest - 3) == highest - 3
    exact = Rendering(Stimulus("b", (Sine(0.05, 40.0) + 0.05).lasting(0.05)), response).whole()
    np.testing.assert_allclose(made.target(-20.0), exact, atol=1e-9)
    low = presentation_of(Stimulus("c", Sine(0.1, 20.0).lasting(0.1)), response, float(RATE))
    with pytest.raises(InputError, match="offset"):
        low.peak_v(0.0)
    mu = Stimulus("d", Constant(0.3).lasting(0.01), "mu")
    with pytest.raises(InputError, match="contrast"):
        presentation_of(mu, response, float(RATE))


def test_a_pedestal_is_under_both(response):
    """For difference thresholds: the reference is the pedestal, the target what is more."""
    more = Stimulus("a", (Sine(0.5, 40.0) + 0.5).lasting(0.05))
    made = presentation_of(more, response, float(RATE), Constant(0.04))

    def drive(signal):
        return Rendering(Stimulus("b", signal.lasting(0.05)), response).whole()

    np.testing.assert_allclose(made.reference, drive(Constant(0.04)), atol=1e-9)
    np.testing.assert_allclose(made.target(-40.0), drive(Sine(0.005, 40.0) + 0.045), atol=1e-9)
    assert made.peak_v(-40.0) == pytest.approx(
        float(response.voltage(np.array([1.05 * response.lowest_mu]))[0][0]), rel=1e-6
    )
