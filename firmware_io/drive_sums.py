"""Sums of samples that come into a window and of those that leave it: for the limits on both."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from firmware_io.errors import DeviceError

_Volts = npt.NDArray[np.float64]

#: Samples that are added up at once, for a bound on the sums up to each: far faster than these.
_PIECE = 24
_ONES = np.ones(_PIECE)
#: Above some 9000 numbers BLAS shares a sum among threads. Those then spin for a tenth of a second,
#: and on a busy machine the caller waits as long for them to run at all.
_MOST_AT_ONCE = 340 * _PIECE


class DriveSums(NamedTuple):
    """Of some samples, and of as many that leave a window as they come in.

    Sums of the first samples are those of none too. They may lie further out than any sum does.
    """

    lowest: float
    """Lowest sum of the first samples."""
    highest: float
    """Highest one."""
    gone_lowest: float
    """Lowest sum of the first that leave."""
    gone_highest: float
    """Highest one."""
    peak: float
    """Largest magnitude."""
    squares: float
    """Sum of squares."""
    steps: float
    """Sum of squared steps, the one to the first sample included."""


SumsOf = Callable[[_Volts, _Volts, float, float], DriveSums]
"""Takes samples, those that leave, the one before the first, and the largest that can leave."""


def bounded_sums(volts: _Volts, leaving: _Volts, before_v: float, largest_v: float) -> DriveSums:
    """Return sums with bounds: those up to each sample would take three times as long."""
    peak = max(float(np.maximum.reduce(volts)), -float(np.minimum.reduce(volts)))
    squares = dot(volts, volts)
    # The squared steps, by ``(b - a)^2 = a^2 + b^2 - 2 a b``.
    first, last = float(volts[0]), float(volts[-1])
    steps = 2 * (squares - dot(volts[1:], volts[:-1])) - first**2 - last**2
    steps += (first - before_v) ** 2
    gone = _bounds(leaving, max(largest_v, peak))
    return DriveSums(*_bounds(volts, peak), *gone, peak, squares, steps)


@cache
def compiled_sums() -> SumsOf | None:
    """Return the same in C, exact and in one pass; None where there is no compiled firmware."""
    from firmware_io.firmware.native import compiled  # cffi, and perhaps a compiler: not at start

    try:
        ffi, lib = compiled()
    except (DeviceError, ImportError):
        return None
    found = ffi.new("double[7]")

    def sums(volts: _Volts, leaving: _Volts, before_v: float, largest_v: float) -> DriveSums:
        inward, outward = (
            ffi.from_buffer("double[]", np.ascontiguousarray(one)) for one in (volts, leaving)
        )
        lib.hx_host_sums(inward, outward, volts.size, before_v, found)
        return DriveSums(*ffi.unpack(found, 7))

    return sums


def dot(one: _Volts, other: _Volts) -> float:
    """Return the sum of the products, from parts that BLAS adds up in this thread."""
    if one.size <= _MOST_AT_ONCE:
        return float(np.dot(one, other))
    return sum(
        float(np.dot(one[at : at + _MOST_AT_ONCE], other[at : at + _MOST_AT_ONCE]))
        for at in range(0, one.size, _MOST_AT_ONCE)
    )


def _bounds(volts: _Volts, peak: float) -> tuple[float, float]:
    """Bound the sums of the first samples, of none too, where no magnitude is above `peak`."""
    pieces, within = volts.size // _PIECE, _PIECE * peak
    if not pieces:
        return -within, within
    each = [
        volts[at : min(at + _MOST_AT_ONCE, pieces * _PIECE)].reshape(-1, _PIECE) @ _ONES
        for at in range(0, pieces * _PIECE, _MOST_AT_ONCE)
    ]
    sums = np.add.accumulate(each[0] if len(each) == 1 else np.concatenate(each))
    lowest, highest = float(np.minimum.reduce(sums)), float(np.maximum.reduce(sums))
    return min(0.0, lowest) - within, max(0.0, highest) + within
