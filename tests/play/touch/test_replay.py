"""Touches from CSV files, and their pace."""

import math
import re

import pytest

from haptix import HaptixError, InputError, Trajectory
from haptix.play.simulation import FINGER_PATH
from haptix.play.touch import Touches, TouchEvent, events_of, paced, read_events


def write(tmp_path, text):
    path = tmp_path / "touches.csv"
    path.write_text(text, encoding="utf-8")
    return path


def test_a_full_table(tmp_path):
    text = (
        "touch_id,t_s,kind,x_mm,y_mm,contact_area_m2,normal_force_n,note\n"
        "3,0.0,down,1,2,,0.5,a\n4,0.005,down,7,8,5e-5,,b\n3,0.01,up,1.5,2,,,\n"
    )
    assert read_events(write(tmp_path, text)) == [
        TouchEvent(0.0, 3, 1.0, 2.0, "down", 0.5, None),
        TouchEvent(0.005, 4, 7.0, 8.0, "down", None, 5e-5),
        TouchEvent(0.01, 3, 1.5, 2.0, "up", None, None),
    ]


def test_without_kinds_touches_begin_and_end(tmp_path):
    text = "t_s,x_mm,y_mm,touch_id\n0,0,0,1\n0.01,1,0,1\n0.01,9,9,2\n0.02,2,0,1\n"
    events = read_events(write(tmp_path, text))
    assert [(event.touch_id, event.kind) for event in events] == [
        (1, "down"), (1, "move"), (2, "down"), (2, "up"), (1, "move"), (1, "up"),
    ]  # fmt: skip
    assert events[-1][:4] == (0.02, 1, 2.0, 0.0)


def test_faults_of_a_recording_are_kept_for_the_tracker(tmp_path):
    text = "t_s,x_mm,y_mm\n0,0,0\n0.02,2,0\n0.01,1,0\n0.03,nan,0\n"
    touches = Touches()
    for event in read_events(write(tmp_path, text)):
        touches.push(event)
    assert touches.counts.reordered == 1
    assert touches.counts.invalid == 1


def test_a_trajectory_is_one_touch():
    trajectory = Trajectory.from_csv(FINGER_PATH)
    events = events_of(trajectory, 5)
    assert [event.kind for event in events] == ["down", *["move"] * (len(events) - 2), "up"]
    assert {event.touch_id for event in events} == {5}
    assert [event.t_s for event in events[:-1]] == trajectory.t_s.tolist()
    assert [event.normal_force_n for event in events[:-1]] == trajectory.normal_force_n.tolist()
    # The same file is a table of touches too.
    assert read_events(FINGER_PATH) == [event._replace(touch_id=0) for event in events]


def test_a_lifted_part_of_a_table_is_no_touch(tmp_path):
    """A force of 0 N is a finger off the screen, here as in a trajectory."""
    text = (
        "t_s,x_mm,y_mm,normal_force_n\n0.0,9,20,0\n0.1,10,20,0.5\n0.2,20,20,0.5\n"
        "0.3,30,20,0\n0.4,10,30,0\n0.5,12,30,0.5\n0.6,22,30,0.5\n"
    )
    path = write(tmp_path, text)
    events = read_events(path)
    assert [(event.t_s, event.kind) for event in events] == [
        (0.1, "down"), (0.2, "move"), (0.3, "up"), (0.5, "down"), (0.6, "move"), (0.6, "up"),
    ]  # fmt: skip
    assert events == events_of(Trajectory.from_csv(path))
    # Of two fingers, one lifts.
    rows = ["0,1,1,0.5,1", "0,9,1,0.5,2", "0.1,2,1,0,1", "0.1,8,1,0.5,2", "0.2,3,1,0,1"]
    path.write_text("\n".join(["t_s,x_mm,y_mm,normal_force_n,touch_id", *rows]), "utf-8")
    assert [(event.touch_id, event.kind) for event in read_events(path)] == [
        (1, "down"), (2, "down"), (1, "up"), (2, "move"), (2, "up"),
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "t_s, x_mm, y_mm"),
        ("t_s,x_mm\n0,0\n", "missing or repeated: y_mm"),
        ("t_s,x_mm,y_mm,kind,kind\n", "repeated: kind"),
        ("t_s,x_mm,y_mm\n", "at least one touch"),
        ("t_s,x_mm,y_mm\n0,0,zwei\n", "line 2: y_mm: expected a number, got 'zwei'"),
        ("t_s,x_mm,y_mm,touch_id\n0,0,0,1.5\n", "line 2: touch_id.*integer.*'1.5'"),
        ("t_s,x_mm,y_mm,kind\n0,0,0,hover\n", "line 2: kind.*hover"),
        ("t_s,x_mm,y_mm\n0,0\n", "line 2: expected 3 values, got 2; y_mm is missing"),
        ("t_s,x_mm,y_mm,normal_force_n\n0,0,0,firm\n", "line 2: normal_force_n.*firm"),
    ],
)
def test_a_file_that_is_none_names_the_place(tmp_path, text, words):
    path = write(tmp_path, text)
    with pytest.raises(HaptixError, match=words) as caught:
        read_events(path)
    assert re.search(r"touches\.csv", str(caught.value))
    assert "\n" not in str(caught.value)


def test_no_file(tmp_path):
    with pytest.raises(HaptixError, match=r"cannot read .*missing\.csv"):
        read_events(tmp_path / "missing.csv")


def test_a_recording_at_its_own_pace():
    now = 1000.0
    slept = []

    def sleep(seconds):
        nonlocal now
        slept.append(seconds)
        now += seconds + 0.0005  # wakes late

    times = [5.0, 5.01, 5.02, math.nan, 5.015, 5.03]
    events = [TouchEvent(t, 0, 0.0, 0.0) for t in times]
    stamps = [event.t_s for event in paced(events, 2.0, lambda: now, sleep)]
    # Twice as fast, on the clock's time, and being woken late does not add up.
    expected = [1000.0, 1000.005, 1000.01, math.nan, 1000.0075, 1000.015]
    assert stamps == pytest.approx(expected, nan_ok=True)
    assert len(slept) == 3
    assert now == pytest.approx(1000.0155)
    with pytest.raises(InputError, match="speed"):
        next(paced(events, 0.0))
