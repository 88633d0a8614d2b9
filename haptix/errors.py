"""The errors of haptix. Their root stands in `firmware_io`, the lowest package."""

from __future__ import annotations

from typing import Any

from firmware_io.errors import (
    DeviceError,
    HaptixError,
    LimitError,
    MissingExtraError,
    from_extra,
)

__all__ = [
    "DeviceError",
    "FileFormatError",
    "HaptixError",
    "InputError",
    "LimitError",
    "MissingExtraError",
    "OverloadWarning",
    "RangeError",
    "ToleranceError",
    "from_extra",
]


class InputError(HaptixError, ValueError):
    """A value that cannot be used; the message says which, what was expected and what was given.

    Examples
    --------
    >>> import haptix
    >>> try:
    ...     haptix.Finger(poisson_ratio=3.0)
    ... except InputError as error:
    ...     print("poisson_ratio" in str(error))
    True
    """


class RangeError(InputError):
    """A query outside the ranges of a surface, or beyond pull-in."""


class ToleranceError(HaptixError):
    """A surface could not be made as accurate as asked within its size; `best` is what it reached.

    Parameters
    ----------
    message : str
        What was asked for and what was reached.
    best : FrictionSurface or None
        The most accurate surface of that size.
    """

    exit_code = 3
    """Of the command line; that of other errors is 2."""

    def __init__(self, message: str, best: Any = None) -> None:
        super().__init__(message)
        self.best = best


class FileFormatError(HaptixError):
    """A file that cannot be read or written, or is foreign, damaged or of a later version."""


class OverloadWarning(UserWarning):
    """A renderer that could not hold its lead; the message says which one would have held."""
