"""The errors of haptix. Their root stands in `firmware_io`, the lowest package."""

from __future__ import annotations

from typing import Any

from firmware_io.device_errors import (
    DeviceDisconnectedError,
    DeviceError,
    DeviceFaultError,
    HaptixError,
    LimitError,
    MissingExtraError,
    from_extra,
)

__all__ = [
    "DeviceDisconnectedError",
    "DeviceError",
    "DeviceFaultError",
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
    """A value that cannot be used; the message names it, the expected value and the received one.

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
    """No surface of the allowed size is as accurate as requested; `best` is the closest one.

    Parameters
    ----------
    message : str
        The accuracy that was requested, and the one that was reached.
    best : FrictionSurface or None
        The most accurate surface of that size.
    """

    exit_code = 3
    """Exit code of the command line; that of other errors is 2."""

    def __init__(self, message: str, best: Any = None) -> None:
        super().__init__(message)
        self.best = best


class FileFormatError(HaptixError):
    """A file that cannot be read or written, or is foreign, damaged or of a later version."""


class OverloadWarning(UserWarning):
    """A renderer could not keep its lead; the message names a lead that would be enough."""
