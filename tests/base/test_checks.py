"""Checks of arguments: what passes, and what the refusal says."""

from __future__ import annotations

from dataclasses import FrozenInstanceError, replace
from fractions import Fraction
from math import inf, nan

import numpy as np
import pytest
import torch

from haptix.base import checks
from haptix.base.checks import Length, NotNegative, Number, Positive
from haptix.base.errors import InputError

NUMBERS = [2, 2.0, np.float32(2), np.array([2]), Fraction(2), torch.tensor(2.0)]


@pytest.mark.parametrize("value", [*NUMBERS, torch.tensor([2.0], requires_grad=True)])
def test_numbers_of_any_kind_pass(value):
    assert checks.number("a", value) == checks.positive("a", value) == 2.0
    assert type(checks.number("a", value)) is float


@pytest.mark.parametrize(
    "value", ["2", None, True, np.bool_(True), [2.0], np.ones(2), torch.ones(2), 2j, float("nan")]
)
def test_what_is_no_number_is_refused(value):
    with pytest.raises(InputError, match=r"^a: .*finite"):
        checks.number("a", value)
    with pytest.raises(InputError, match=r"^a: .*above 0"):
        checks.positive("a", value, open_end=True)


def test_the_ends_of_a_range():
    assert checks.number("a", 0, 0.0) == 0.0
    assert checks.number("a", float("inf"), open_end=True) == float("inf")
    with pytest.raises(InputError, match=r"^a: .*at least 0, got -1e-09$"):
        checks.number("a", -1e-9, 0.0)
    with pytest.raises(InputError, match=r"^a: .*above 0, got 0$"):
        checks.positive("a", 0.0)
    with pytest.raises(InputError, match=r"^a: .*got inf$"):
        checks.positive("a", float("inf"))


def test_whole_numbers():
    assert checks.whole("n", np.int64(3), 1) == 3
    for value in (0, 1.0, True, "1", None):
        with pytest.raises(InputError, match=r"^n: .*from 1, got"):
            checks.whole("n", value, 1)


def test_choices():
    assert checks.choice("kind", "b", ("a", "b")) == "b"
    with pytest.raises(InputError, match=r"^kind: .*a, b, got 'c'$"):
        checks.choice("kind", "c", ("a", "b"))


def test_rows():
    assert checks.row("r", (1, 2)).tolist() == [1.0, 2.0]
    for values, message in [
        ("ab", "expected numbers"), ([[1]], "shape"), ([], "at least 1"), ([1, np.inf], "number 2")
    ]:  # fmt: skip
        with pytest.raises(InputError, match=f"^r: .*{message}"):
            checks.row("r", values)


def test_increasing_rows():
    assert checks.increasing("t", [0, 1, 3]).tolist() == [0.0, 1.0, 3.0]
    with pytest.raises(InputError, match=r"^t: .*number 3 is 1 after 1$"):
        checks.increasing("t", [0, 1, 1])


@checks.checked()
class Sample:
    place: Number = 0.0
    size: Positive = 1.0
    time: NotNegative = 0.0
    end: Length = inf
    mass: Positive | None = None


@pytest.mark.parametrize(
    ("name", "value"),
    [("place", inf), ("place", None), ("place", True), ("place", "1"), ("size", 0), ("size", nan),
     ("time", -1e-9), ("end", 0), ("mass", 0), ("other", 1)],
)  # fmt: skip
def test_fields_by_their_annotation(name, value):
    with pytest.raises(InputError, match=rf"^Sample\.{name}: "):
        Sample(**{name: value})


def test_values_by_place_and_of_arrays_are_taken():
    sample = Sample(-1.0, 2, np.float32(3), np.array(4.0))
    assert (sample.place, sample.size, sample.time, sample.end) == (-1.0, 2, 3.0, 4.0)
    assert replace(sample, mass=5.0) == Sample(-1.0, 2, 3.0, 4.0, 5.0)
    with pytest.raises(InputError, match=r"^Sample\.size: "):
        Sample(0.0, -2)
    with pytest.raises(FrozenInstanceError):
        sample.size = 3.0  # type: ignore[misc]
