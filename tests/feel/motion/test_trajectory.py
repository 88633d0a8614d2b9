"""Recorded paths: reading, interpolating, and files that are none."""

import csv
import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from haptix import HaptixError, InputError, Trajectory
from haptix.play.touch import events_of

COLUMNS = ("t_s", "x_mm", "y_mm", "normal_force_n")
HEADER = ",".join(COLUMNS) + "\n"

numbers = st.floats(-1e6, 1e6)
rows_of_numbers = st.lists(
    st.tuples(st.floats(1e-6, 10), numbers, numbers, st.floats(1e-6, 100)), min_size=2, max_size=20
)


def write(path, text):
    path.write_text(text, encoding="utf-8")
    return path


@settings(deadline=None)
@given(rows_of_numbers, st.permutations([*COLUMNS, "note"]))
def test_csv_round_trip_in_any_order_of_columns(tmp_path_factory, rows, order):
    table = np.array(rows)
    table[:, 0] = np.cumsum(table[:, 0])
    columns = dict(zip(COLUMNS, table.T.tolist(), strict=True)) | {
        "note": ["free text"] * len(rows)
    }
    path = tmp_path_factory.mktemp("path") / "path.csv"
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(order)
        # str of a float reads back to the same float.
        writer.writerows(zip(*(columns[name] for name in order), strict=True))
    path_read = Trajectory.from_csv(path)
    for name, column in zip(COLUMNS, table.T, strict=True):
        np.testing.assert_array_equal(getattr(path_read, name), column)


def test_between_samples_by_hand():
    path = Trajectory(*np.array([[1.0, 3.0, 4.0], [0, 10, 30], [5, 5, -5], [0.5, 0.7, 0.4]]))
    assert path.duration_s == 3.0
    x, y, force = path.at([1.0, 2.0, 3.0, 3.25])
    # Interpolation rounds: some 1e-16 of numbers up to 30.
    np.testing.assert_allclose(x, [0, 5, 10, 15], rtol=0, atol=1e-13)
    np.testing.assert_allclose(y, [5, 5, 5, 2.5], rtol=0, atol=1e-13)
    np.testing.assert_allclose(force, [0.5, 0.6, 0.7, 0.625], rtol=0, atol=1e-13)
    assert path.at(np.zeros((2, 3)))[0].shape == (2, 3)


def test_a_spreadsheets_csv(tmp_path):
    # Spreadsheets put a byte order mark first; people put blanks behind commas.
    text = "\ufeff" + "t_s, x_mm, y_mm, normal_force_n\r\n0, 1, 2, 0.5\r\n1, 3, 4, 0.6\r\n"
    path = Trajectory.from_csv(write(tmp_path / "sheet.csv", text))
    np.testing.assert_array_equal(path.x_mm, [1, 3])
    np.testing.assert_array_equal(path.normal_force_n, [0.5, 0.6])


GOOD = "0,1,2,0.5\n"
# Contents, and what the sentence names besides the file: columns, values, and the row, counted
# among the samples or among the lines of the file.
BAD_FILES = {
    "empty": ("", ["t_s"]),
    "header only": (HEADER, ["0"]),
    "one row": (HEADER + GOOD, ["1"]),
    "no header": (GOOD + "1,1,2,0.5\n", list(COLUMNS)),
    "missing column": ("t_s,x_mm,y_mm\n0,1,2\n1,1,2\n", ["normal_force_n"]),
    "semicolons": ("t_s;x_mm;y_mm;normal_force_n\n0;1;2;0.5\n1;1;2;0.5\n", ["y_mm"]),
    "text in a cell": (HEADER + GOOD + "1,1,zwei,0.5\n", ["y_mm", "zwei", "2"]),
    "empty cell": (HEADER + GOOD + "1,,2,0.5\n", ["x_mm", "2"]),
    "short row": (HEADER + GOOD + "1,1\n", ["y_mm", "2"]),
    "decimal commas": (HEADER + "0,0,1,5,2,0,0,5\n1,0,1,5,2,0,0,5\n", ["1"]),
    "NaN": (HEADER + GOOD + "1,nan,2,0.5\n", ["x_mm", "2", "nan"]),
    "infinite": (HEADER + GOOD + "1,1,-inf,0.5\n", ["y_mm", "2", "-inf"]),
    "no force": (HEADER + "0,1,2,0\n1,1,2,0\n", ["normal_force_n", "1", "above 0"]),
    "pulling": (HEADER + GOOD + "1,1,2,-0.1\n", ["normal_force_n", "2", "-0.1"]),
    "times equal": (HEADER + GOOD + "1,1,2,0.5\n1,1,2,0.5\n", ["t_s", "3"]),
    "times swapped": (HEADER + GOOD + "2,1,2,0.5\n1,1,2,0.5\n", ["t_s", "3", "2"]),
}


@pytest.mark.parametrize("name", BAD_FILES)
def test_a_bad_file_is_one_sentence_naming_the_place(tmp_path, name):
    text, words = BAD_FILES[name]
    # A name without digits, so that a row's number cannot be found in it.
    path = write(tmp_path / "finger.csv", text)
    with pytest.raises(HaptixError) as caught:
        Trajectory.from_csv(path)
    message = str(caught.value)
    assert "\n" not in message
    assert str(path) in message
    rest = message.replace(str(path), "")
    for word in words:
        row_or_line = (word, str(int(word) + 1)) if word.isdigit() else (word,)
        assert any(re.search(rf"(?<![\w.]){re.escape(w)}(?![\w.])", rest) for w in row_or_line)


def test_a_lifted_part_is_read(tmp_path):
    rows = "0,10,20,0.5\n0.1,20,20,0.5\n0.2,30,20,0\n0.3,10,30,0\n0.4,12,30,0.5\n0.5,22,30,0.5\n"
    path = Trajectory.from_csv(write(tmp_path / "lifted.csv", HEADER + rows))
    assert path.normal_force_n.tolist() == [0.5, 0.5, 0, 0, 0.5, 0.5]
    kinds = [event.kind for event in events_of(path)]
    assert kinds == ["down", "move", "up", "down", "move", "up"]


def test_a_bad_value_is_named_whatever_the_source():
    columns = np.array([[0.0, 1.0, 2.0], [0, 1, 2], [0, 1, 2], [1, 1, 1]])
    for column, row, bad, words in (
        (0, 2, 1.0, "t_s: expected increasing numbers, but number 3 is 1 after 1; sort"),
        (1, 1, np.nan, "x_mm.*number 2 is nan"),
        (2, 0, np.inf, "y_mm.*number 1 is inf"),
        (3, 1, -1.0, "normal_force_n.*-1 in sample 2"),
    ):
        wrong = columns.copy()
        wrong[column, row] = bad
        with pytest.raises(InputError, match=words):
            Trajectory(*wrong)
    with pytest.raises(InputError, match=r"t_s: .*at least 2"):
        Trajectory(*columns[:, :1])


@pytest.mark.parametrize(
    "content", [bytes(range(256)), b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR", b"\0" * 99]
)
def test_a_binary_file(tmp_path, content):
    path = tmp_path / "binary.csv"
    path.write_bytes(content)
    with pytest.raises(HaptixError, match=r"binary\.csv"):
        Trajectory.from_csv(path)


def test_no_file(tmp_path):
    for path in (tmp_path / "missing.csv", tmp_path):
        with pytest.raises(HaptixError, match=path.name):
            Trajectory.from_csv(path)


def test_arrays_of_different_lengths():
    with pytest.raises(InputError, match=r"y_mm: .*3 times, got 2"):
        Trajectory(np.arange(3.0), np.zeros(3), np.zeros(2), np.ones(3))
