"""The errors of haptix: one hierarchy, rooted in `firmware_io` since that is the lowest room."""

from __future__ import annotations

import math
from typing import Any

from firmware_io.errors import DeviceError, HaptixError, LimitError

__all__ = [
    "DeviceError",
    "FileFormatError",
    "HaptixError",
    "InputError",
    "LimitError",
    "RangeError",
    "ToleranceError",
    "check_positive",
]


class InputError(HaptixError, ValueError):
    """A value that cannot be used: the message says which, what was expected and what came."""


class RangeError(InputError):
    """A query outside the range for which a surface was built, or past the contact's pull-in."""


class ToleranceError(HaptixError):
    """A surface could not be made as accurate as asked within its size; `best` is what it reached.

    Parameters
    ----------
    message : str
        What was asked for and what was reached.
    best : FrictionSurface or None
        The most accurate surface of that size.
    """

    def __init__(self, message: str, best: Any = None) -> None:
        super().__init__(message)
        self.best = best


class FileFormatError(HaptixError):
    """A file that is not what it should be: foreign, damaged, or of a later version."""


def check_positive(name: str, value: Any) -> None:
    """Raise `InputError` unless the scalar `value` is finite and above zero."""
    number = float(value.detach() if hasattr(value, "detach") else value)
    if not (math.isfinite(number) and number > 0):
        raise InputError(f"{name}: expected a finite number above 0, got {number:g}")
