"""The one place that holds safety limits on what may be driven onto a screen."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from firmware_io.errors import LimitError

#: No configuration raises the ceiling above this: it is the product's safety limit.
ABSOLUTE_CEILING_V = 200.0

#: A 20 kHz carrier at the absolute ceiling slews at 2 pi f V. The 5 % above it admit an envelope
#: that moves at up to 0.32 times the carrier's own rate (sqrt(1 + 0.32**2) = 1.05).
DEFAULT_MAX_SLEW_V_PER_S = 1.05 * 2.0 * math.pi * 20e3 * ABSOLUTE_CEILING_V

#: How long a driver holds its last voltage without a host before it ramps to 0 V and disarms.
#: Long enough that a host's pauses cost an underrun and not the session: 20 ms in a slow block,
#: some 100 ms on a busy desktop. Short enough that what a dead host leaves behind is gone in about
#: the time a person takes to react.
WATCHDOG_S = 0.25


@dataclass(frozen=True)
class DriveLimits:
    """What a drive signal must keep to.

    Parameters
    ----------
    ceiling_v : float
        Largest admissible magnitude of a sample, in volts; at most `ABSOLUTE_CEILING_V`.
    max_slew_v_per_s : float
        Largest admissible change between neighbouring samples, in volts per second.

    Raises
    ------
    LimitError
        If a limit is not finite and positive, or the ceiling lies above `ABSOLUTE_CEILING_V`.
    """

    ceiling_v: float = ABSOLUTE_CEILING_V
    max_slew_v_per_s: float = DEFAULT_MAX_SLEW_V_PER_S

    def __post_init__(self) -> None:
        for name in ("ceiling_v", "max_slew_v_per_s"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0):
                raise LimitError(
                    f"{name} must be a finite number above 0, but is {value!r}; correct it."
                )
        if self.ceiling_v > ABSOLUTE_CEILING_V:
            raise LimitError(
                f"ceiling_v must be at most {ABSOLUTE_CEILING_V:g} V, but is {self.ceiling_v!r} V; "
                "choose a lower ceiling, the absolute one cannot be raised."
            )

    def check(
        self, volts: npt.NDArray[np.float64], previous_v: float, sample_rate_hz: float
    ) -> None:
        """Reject samples that break a limit.

        Parameters
        ----------
        volts : ndarray, shape (n,)
            Samples to be driven, in volts.
        previous_v : float
            The sample that goes before the first one, in volts.
        sample_rate_hz : float
            Samples per second.

        Raises
        ------
        LimitError
            If a sample is not finite, exceeds the ceiling, or differs from the one before it by
            more than the slew limit allows. The message names the first such sample.
        """
        # Written so that NaN, which compares false with everything, counts as over the ceiling.
        over = ~(np.abs(volts) <= self.ceiling_v)
        if over.any():
            index = int(over.argmax())
            value = float(volts[index])
            if not math.isfinite(value):
                raise LimitError(
                    f"Sample {index} is {value}, but every sample must be a finite voltage; "
                    "look for a division by zero or an unset value in what makes the signal."
                )
            raise LimitError(
                f"Sample {index} is {value!r} V, above the ceiling of {self.ceiling_v!r} V; "
                "lower the signal's amplitude."
            )
        steps = np.abs(np.diff(volts, prepend=previous_v))
        allowed = self.max_slew_v_per_s / sample_rate_hz
        too_steep = steps > allowed
        if too_steep.any():
            index = int(too_steep.argmax())
            before = float(volts[index - 1]) if index else previous_v
            raise LimitError(
                f"Sample {index} steps from {before:g} V to {volts[index]:g} V, but the slew limit "
                f"of {self.max_slew_v_per_s:g} V/s allows {allowed:g} V per sample at "
                f"{sample_rate_hz:g} Hz; start, change and end the signal more gradually."
            )

    def ramp_to_zero(
        self, last_v: float, sample_rate_hz: float, ramp_s: float = 0.005
    ) -> npt.NDArray[np.float64]:
        """Return a straight ramp from the sample after `last_v` to exactly 0 V.

        Parameters
        ----------
        last_v : float
            The voltage that stands on the output.
        sample_rate_hz : float
            Samples per second.
        ramp_s : float
            Duration in seconds; longer where the slew limit asks for it.

        Returns
        -------
        ndarray, shape (n,)
            At least one sample, in volts; the last is 0.0. It passes `check` after `last_v`.
        """
        # One sample to round up, one so that the rounding of a step cannot reach the limit.
        shortest = int(abs(last_v) * sample_rate_hz / self.max_slew_v_per_s) + 2
        count = max(math.ceil(ramp_s * sample_rate_hz), shortest)
        return np.linspace(last_v, 0.0, count + 1)[1:]
