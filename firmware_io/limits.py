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

#: Energy: the rms of a sine at the absolute ceiling, the strongest drive that screens are rated
#: and calibrated with, and 1 % for windows that hold no whole number of its periods. Heat in
#: amplifier and insulator, and the mean attraction, go with the square of the voltage: a square
#: wave at the ceiling has twice a sine's, and passes for less than half of the window only.
DEFAULT_MAX_RMS_V = 1.01 * ABSOLUTE_CEILING_V / math.sqrt(2.0)

#: A mean voltage feels like nothing, since charge leaks through the insulator and screens it, but
#: moves ions in the insulator and keeps a current through the person. 5 % of a second admit the
#: half period with which any tone from 6.4 Hz on begins (2/pi * T/2 <= 0.05 s).
DEFAULT_MAX_DC_SHARE = 0.05

#: Energy and mean are taken over this long: shorter than it takes parts to warm or ions to move.
DEFAULT_WINDOW_S = 1.0

#: A mean below this counts as none: a few codes of rounding at 250 V full scale.
_DC_FLOOR_V = 0.05


@dataclass(frozen=True)
class DriveLimits:
    """What a drive signal must keep to.

    Parameters
    ----------
    ceiling_v : float
        Largest admissible magnitude of a sample, in volts; at most `ABSOLUTE_CEILING_V`.
    max_slew_v_per_s : float
        Largest admissible change between neighbouring samples, in volts per second.
    max_rms_v : float
        Largest admissible root mean square over the window, in volts.
    max_dc_share : float
        Largest admissible mean over the window, as a share of its largest magnitude.
    window_s : float
        Length of that window, in seconds; before the first sample it holds 0 V.

    Raises
    ------
    LimitError
        If a limit is not finite and positive, or the ceiling lies above `ABSOLUTE_CEILING_V`.
    """

    ceiling_v: float = ABSOLUTE_CEILING_V
    max_slew_v_per_s: float = DEFAULT_MAX_SLEW_V_PER_S
    max_rms_v: float = DEFAULT_MAX_RMS_V
    max_dc_share: float = DEFAULT_MAX_DC_SHARE
    window_s: float = DEFAULT_WINDOW_S

    def __post_init__(self) -> None:
        for name in ("ceiling_v", "max_slew_v_per_s", "max_rms_v", "max_dc_share", "window_s"):
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
        """Reject samples that break the ceiling or the slew limit.

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
        if volts.size == 0:
            return
        steps = np.empty_like(volts)  # np.diff takes three times as long for a short block
        steps[0] = volts[0] - previous_v
        np.subtract(volts[1:], volts[:-1], out=steps[1:])
        np.abs(steps, out=steps)
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

    def check_envelope(
        self,
        amplitude_v: npt.NDArray[np.float64],
        previous_v: float,
        sample_rate_hz: float,
        carrier_hz: float,
    ) -> None:
        """Reject amplitudes whose carrier would break the ceiling or the slew limit.

        Parameters
        ----------
        amplitude_v : ndarray, shape (n,)
            Amplitudes of the carrier that the driver makes, in volts, not negative.
        previous_v : float
            The amplitude before the first one, in volts.
        sample_rate_hz : float
            Amplitudes per second.
        carrier_hz : float
            Frequency of that carrier.

        Raises
        ------
        LimitError
            As from `check`, and if an amplitude is negative. The slope of ``a sin(w t)`` is taken
            as ``|a'| + w a``, the most that it can be, and what the driver reckons as well.
        """
        self.check(amplitude_v, previous_v, sample_rate_hz)
        if amplitude_v.size == 0:
            return
        if amplitude_v.min() < 0.0:
            index = int((amplitude_v < 0.0).argmax())
            raise LimitError(
                f"Sample {index} is {amplitude_v[index]:g} V, but amplitudes of a carrier are 0 V "
                "or more; send the envelope, not the wave, or set the driver to waveform mode."
            )
        before_v = np.concatenate([[previous_v], amplitude_v[:-1]])
        steepest = np.abs(amplitude_v - before_v) * sample_rate_hz
        steepest += 2.0 * math.pi * carrier_hz * np.maximum(before_v, amplitude_v)
        too_steep = steepest > self.max_slew_v_per_s
        if too_steep.any():
            index = int(too_steep.argmax())
            raise LimitError(
                f"Sample {index}, {amplitude_v[index]:g} V on a carrier of {carrier_hz:g} Hz, "
                f"slews at {steepest[index]:g} V/s, above the limit of "
                f"{self.max_slew_v_per_s:g} V/s; choose a slower carrier or a lower amplitude."
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


class DriveWindow:
    """The last second or so that was driven: rejects too much energy and a mean voltage.

    Parameters
    ----------
    limits : DriveLimits
        What the window must keep to.
    sample_rate_hz : float
        Samples per second.
    """

    def __init__(self, limits: DriveLimits, sample_rate_hz: float) -> None:
        self.limits = limits
        self._ring = np.zeros(max(1, round(limits.window_s * sample_rate_hz)))
        self._next = 0
        self._sum_v = 0.0
        self._sum_square = 0.0

    def check(self, volts: npt.NDArray[np.float64]) -> None:
        """Reject samples with which the window would hold too much energy or too high a mean.

        A sample of 0 V is never rejected: it is the remedy.

        Raises
        ------
        LimitError
            The message names the first such sample.
        """
        if volts.size == 0:
            return
        size = self._ring.size
        leaving = self._leaving(volts)
        square = (self._sum_square + np.cumsum(volts * volts - leaving * leaving)) / size
        over = (square > self.limits.max_rms_v**2) & (volts != 0.0)
        if over.any():
            index = int(over.argmax())
            raise LimitError(
                f"With sample {index} the rms over {self.limits.window_s:g} s reaches "
                f"{math.sqrt(square[index]):g} V, above the limit of {self.limits.max_rms_v:g} V; "
                "lower the amplitude, or pause."
            )
        mean = (self._sum_v + np.cumsum(volts - leaving)) / size
        highest = float(np.abs(mean).max())
        if highest <= _DC_FLOOR_V:
            return
        # The largest magnitude of the whole window costs more: only where the block's does not do.
        share = self.limits.max_dc_share
        if highest <= share * float(np.abs(volts).max()):
            return
        allowed = share * max(float(np.abs(volts).max()), float(np.abs(self._ring).max()))
        over = (np.abs(mean) > max(allowed, _DC_FLOOR_V)) & (volts * mean > 0.0)
        if over.any():
            index = int(over.argmax())
            raise LimitError(
                f"With sample {index} the mean over {self.limits.window_s:g} s reaches "
                f"{mean[index]:g} V, above {share:.0%} of the largest magnitude there; "
                "drive without a mean voltage: remove the offset, and pause before trying again."
            )

    def take(self, volts: npt.NDArray[np.float64]) -> None:
        """Take samples into the window, after they were sent."""
        size = self._ring.size
        leaving = self._leaving(volts)
        self._sum_v += float((volts - leaving).sum())
        self._sum_square += float((volts * volts - leaving * leaving).sum())
        latest = volts[-size:]
        start = (self._next + volts.size - latest.size) % size
        first = min(latest.size, size - start)
        self._ring[start : start + first] = latest[:first]
        self._ring[: latest.size - first] = latest[first:]
        if self._next + volts.size >= size:
            # Once a round, so that rounding does not add up over hours.
            self._sum_v = float(self._ring.sum())
            self._sum_square = float((self._ring * self._ring).sum())
        self._next = (self._next + volts.size) % size

    def rest(self, samples: int) -> None:
        """Take the time during which the output stood at 0 V, in samples."""
        if samples > 0:
            self.take(np.zeros(min(samples, self._ring.size)))

    def _leaving(self, volts: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """Return the samples that leave as `volts` come in, shape (n,)."""
        size = self._ring.size
        end = self._next + volts.size
        if end <= size:
            return self._ring[self._next : end]
        whole = np.concatenate([self._ring[self._next :], self._ring[: self._next], volts])
        return whole[: volts.size]
