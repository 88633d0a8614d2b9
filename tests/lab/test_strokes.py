"""Strokes whose force or speed is off: told, written down, and repeated."""

import io
from collections import Counter

import numpy as np
import pytest
from pydantic import ValidationError

from firmware_io import Device, MockDriver, MockLink
from haptix.base.errors import InputError
from haptix.lab.analysis.results import analyse
from haptix.lab.experiment import ConstantStimuli, Experiment, Keys, StrokeRanges, Touch, UpDown
from haptix.play.render.intervals import TouchSample
from tests.hand_clock import HandClock
from tests.lab.chained import rows_of, stopped_after
from tests.lab.presented import at_level

WAVE = np.sin(2 * np.pi * 120 * np.arange(4800) / 48_000)
STEPS = 8  # reports of a stroke


class Panel:
    """A device whose panel reports a stroke of some force and speed in each interval.

    Time passes only where this says so.
    """

    def __init__(self, strokes):
        self.clock = HandClock()
        driver = MockDriver(pace="real", clock=self.clock)
        self.device = Device(MockLink(driver, sleep=self.clock.sleep), clock=self.clock)
        self.strokes = iter(strokes)

    def __getattr__(self, name):
        return getattr(self.device, name)

    def __enter__(self):
        self.device.__enter__()
        return self

    def __exit__(self, *error):
        return self.device.__exit__(*error)

    def write(self, volts):
        self.device.write(volts)
        stroke = next(self.strokes)
        step_s = len(volts) / 48_000 / (2 * STEPS)
        for k in range(STEPS if stroke else 0):
            self.clock.sleep(step_s)
            force_n, speed_mm_per_s = stroke
            assert self.device.mock.touch(10.0 + speed_mm_per_s * k * step_s, 20.0, force_n)
            self.device.progress(is_fresh=True)


GOOD, HARD, FAST, NONE = (0.5, 100.0), (0.7, 100.0), (0.5, 160.0), None
RANGES = {"normal_force_n": (0.4, 0.6), "speed_mm_per_s": (80.0, 120.0)}


def run(path, strokes, method=None, **more):
    """Run until the strokes end; each is that of both intervals of a trial."""
    panel = Panel(one for stroke in strokes for one in (stroke, stroke))
    experiment = Experiment(
        method or ConstantStimuli([20.0, 24.0, 28.0], 2), at_level(WAVE), panel,
        lambda question: question.right, path, clock=panel.clock, wait=lambda seconds: None,
        **{**RANGES, **more},
    )  # fmt: skip
    for number, _ in enumerate(experiment, 1):
        if number == len(strokes):
            break
    experiment.log.close()
    panel.device.close()
    return experiment


def test_the_panel_s_force_and_speed_are_those_of_the_stroke(tmp_path):
    run(tmp_path / "a.tsv", [GOOD])
    (row,) = rows_of(tmp_path / "a.tsv")
    assert float(row["normal_force_n"]) == pytest.approx(0.5)
    # Places are rounded to 1 um and times to the driver's 10 us: both of 6 ms and 0.6 mm.
    assert float(row["speed_mm_per_s"]) == pytest.approx(100.0, rel=0.01)
    assert row["accepted"] == "true"


def test_fingers_are_told_apart_and_what_is_not_measured_is_none():
    def at(t_s, x_mm, contact=0, force_n=None, phase="move"):
        return TouchSample(t_s, x_mm, 0.0, force_n, contact, phase)

    two = [at(0.00, 0.0), at(0.00, 50.0, 1), at(0.01, 1.0), at(0.01, 51.0, 1)]
    felt = Touch.of(two)
    assert felt.speed_mm_per_s == pytest.approx(100.0) and felt.normal_force_n is None
    # Neither a jump after a pause nor the lift counts.
    rests = [at(0.00, 0.0, 0, 0.5), at(0.01, 1.0, 0, 0.7), at(5.0, 90.0, 0, 0.6),
             at(5.01, 90.0, 0, 0.0, "up")]  # fmt: skip
    felt = Touch.of(rests)
    assert felt.speed_mm_per_s == pytest.approx(100.0)
    assert felt.normal_force_n == pytest.approx(0.6)
    assert Touch.of([]) is None and Touch.of([at(0.0, 0.0)]).speed_mm_per_s is None


def test_rejected_trials_come_again_at_the_end(tmp_path):
    method = ConstantStimuli([20.0, 24.0, 28.0], 2, seed=4)
    planned = [level for (level,) in method._order]
    strokes = [GOOD, HARD, GOOD, FAST, NONE, *[GOOD] * 6]
    run(tmp_path / "a.tsv", strokes, method)
    rows = rows_of(tmp_path / "a.tsv")
    assert len(rows) == 6 + 3
    why = [row["why"] for row in rows]
    assert why[1].startswith("normal_force_n was 0.7, not 0.4 to 0.6")
    assert why[3].startswith("speed_mm_per_s was 16") and why[4] == "no touch"
    assert all((row["why"] == "n/a") == (row["accepted"] == "true") for row in rows)
    # What was off is presented after all others, in its order.
    shown = [float(row["level"]) for row in rows]
    assert shown == [*planned, *(planned[k] for k in (1, 3, 4))]
    accepted = Counter(row["level"] for row in rows if row["accepted"] == "true")
    assert set(accepted.values()) == {2}
    assert [row["trial"] for row in rows if row["accepted"] == "true"] == [*"012345"]


@pytest.mark.parametrize("count", [2, 5, 7])
def test_a_session_with_rejected_trials_goes_on_as_if_it_had_not_stopped(tmp_path, count):
    strokes = [GOOD, HARD, GOOD, FAST, NONE, *[GOOD] * 6]
    names = ("trial", "attempt", "level", "right", "accepted")
    run(tmp_path / "whole.tsv", strokes)
    run(tmp_path / "parts.tsv", strokes)
    stopped_after(tmp_path / "parts.tsv", count)
    run(tmp_path / "parts.tsv", strokes[count:])
    whole, parts = (
        [[row[name] for name in names] for row in rows_of(tmp_path / one)]
        for one in ("whole.tsv", "parts.tsv")
    )
    assert parts == whole
    assert not analyse(tmp_path / "parts.tsv").runs[0].remarks


def test_an_adaptive_method_asks_again_at_once(tmp_path):
    run(tmp_path / "a.tsv", [GOOD, HARD, GOOD], UpDown(30.0, (4.0,)))
    rows = rows_of(tmp_path / "a.tsv")
    assert [row["attempt"] for row in rows] == ["0", "0", "1"]
    assert rows[1]["level"] == rows[2]["level"]


def test_one_who_cannot_press_less_is_not_sent_home(tmp_path):
    """The fifth attempt counts, marked; without a touch nothing does."""
    run(tmp_path / "a.tsv", [HARD] * 10, UpDown(30.0, (4.0,), most_trials=2))
    rows = rows_of(tmp_path / "a.tsv")
    assert [row["accepted"] for row in rows] == ["false", *["false"] * 3, "true"] * 2
    assert all(row["why"].startswith("normal_force_n was 0.7") for row in rows)
    (row,) = analyse(tmp_path / "a.tsv").tables["thresholds"]
    assert (row["trials"], row["out_of_range"]) == (2, 2)


def test_one_bad_interval_of_two_is_enough(tmp_path):
    panel = Panel([GOOD, HARD])
    experiment = Experiment(
        UpDown(30.0), at_level(WAVE), panel, lambda question: question.right, tmp_path / "a.tsv",
        clock=panel.clock, wait=lambda seconds: None, **RANGES,
    )  # fmt: skip
    row = next(iter(experiment))
    panel.device.close()
    assert row["accepted"] == "false" and "normal_force_n was 0.7" in row["why"]
    assert float(row["normal_force_n"]) == pytest.approx(0.6)  # the mean, which is in the range


def test_the_participant_sees_bars(tmp_path):
    sink = io.StringIO()
    run(tmp_path / "a.tsv", [GOOD, HARD, NONE], show=Keys(sink=sink).show)
    lines = sink.getvalue().splitlines()
    bars = [line.split("]")[0].split("[")[1] for line in lines if line.startswith("force")]
    # A bar for each interval; between the marks where it is in the range, at their middle here.
    places = [(bar.find("|"), bar.find("#"), bar.rfind("|")) for bar in bars]
    assert len(bars) == 6 and all(low < at < high for low, at, high in places[:2])
    assert all(at > high for _, at, high in places[2:4])
    assert all(at == -1 for _, at, _ in places[4:])
    assert "force" in lines[0] and "0.5 N, of 0.4 to 0.6 N" in lines[0]
    assert sum(line.startswith("not counted: ") for line in lines) == 2


def test_ranges_that_cannot_be_are_refused(tmp_path, device):
    for wrong in ({"normal_force_n": (0.6, 0.4)}, {"speed_mm_per_s": (-1.0, 3.0)}):
        with pytest.raises(ValidationError):
            StrokeRanges(**wrong)
        with pytest.raises(InputError, match=next(iter(wrong))):
            Experiment(UpDown(30.0), at_level(WAVE), device, Keys(), tmp_path / "a.tsv", **wrong)
