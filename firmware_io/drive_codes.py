"""Codes of samples that keep ceiling and slew, in one pass of compiled C."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np
import numpy.typing as npt

from firmware_io.errors import DeviceError
from firmware_io.limits import DriveLimits
from firmware_io.protocol import top_code

CodesOf = Callable[
    [npt.NDArray[np.float64], float, DriveLimits, float, float], npt.NDArray[np.int16] | None
]
"""Takes samples, the one before them, limits, sample rate and full scale. Returns the codes of
`volts_to_codes`, or None where `DriveLimits.check` has something to say."""


@cache
def compiled_codes() -> CodesOf | None:
    """Return the function; None where there is no compiled firmware."""
    from firmware_io.firmware.native import compiled  # cffi, and perhaps a compiler: not at start

    try:
        ffi, lib = compiled()
    except (DeviceError, ImportError):
        return None

    def codes_of(
        volts: npt.NDArray[np.float64],
        before_v: float,
        limits: DriveLimits,
        sample_rate_hz: float,
        full_scale_v: float,
    ) -> npt.NDArray[np.int16] | None:
        most_v = min(limits.ceiling_v, full_scale_v)
        codes = np.empty(volts.size, dtype=np.int16)
        is_kept = lib.hx_host_codes(
            ffi.from_buffer("double[]", volts),
            volts.size,
            before_v,
            most_v,
            limits.max_slew_v_per_s / sample_rate_hz,
            full_scale_v,
            top_code(most_v, full_scale_v),
            ffi.from_buffer("int16_t[]", codes),
        )
        return codes if is_kept else None

    return codes_of
