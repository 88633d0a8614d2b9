"""Conversion between volts and the int16 codes on the wire."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from firmware_io.errors import LimitError

#: The code of full scale. The range is symmetric: 0 V is a code, and so is -v with every +v.
FULL_SCALE_CODE = 32767


def volts_to_codes(
    volts: npt.ArrayLike, full_scale_v: float, ceiling_v: float | None = None
) -> npt.NDArray[np.int16]:
    """Quantise voltages to the nearest code that does not exceed the ceiling.

    Parameters
    ----------
    volts : array_like, any shape
        Voltages.
    full_scale_v : float
        The voltage of code 32767.
    ceiling_v : float, optional
        No code means more than this. A voltage less than half a step below the ceiling becomes
        the last code under it, even if the code above is nearer.

    Returns
    -------
    ndarray of int16, same shape
        Codes in -32767..32767.

    Raises
    ------
    LimitError
        If a voltage is not finite, or lies beyond full scale or the ceiling.
    """
    values = np.asarray(volts, dtype=np.float64)
    limit = full_scale_v if ceiling_v is None else min(ceiling_v, full_scale_v)
    if values.size == 0:
        return np.zeros(values.shape, np.int16)
    lowest = float(np.minimum.reduce(values, axis=None))
    highest = float(np.maximum.reduce(values, axis=None))
    # Written so that NaN, which compares false with everything, counts as over the limit.
    if not (-limit <= lowest and highest <= limit):
        index = int((~(np.abs(values) <= limit)).argmax())
        raise LimitError(
            f"Sample {index} is {float(values.flat[index])!r} V, but codes reach {limit!r} V; "
            "lower the signal's amplitude."
        )
    top = top_code(limit, full_scale_v)
    codes = np.empty_like(values)
    np.divide(values, full_scale_v, out=codes)
    codes *= FULL_SCALE_CODE
    np.rint(codes, out=codes)
    if max(-lowest, highest) / full_scale_v * FULL_SCALE_CODE > top:
        np.clip(codes, -top, top, out=codes)
    return codes.astype(np.int16)


def top_code(limit_v: float, full_scale_v: float) -> int:
    """Return the highest code that means no more than a limit."""
    top = int(limit_v / full_scale_v * FULL_SCALE_CODE)
    return top - 1 if top / FULL_SCALE_CODE * full_scale_v > limit_v else top


def codes_to_volts(codes: npt.NDArray[np.int16], full_scale_v: float) -> npt.NDArray[np.float64]:
    """Return the voltages of codes, in volts, in the same shape."""
    # Division first: code 32767 then gives exactly full scale.
    return codes / FULL_SCALE_CODE * full_scale_v
