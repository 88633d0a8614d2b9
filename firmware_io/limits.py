"""The one place that holds safety limits on what may be driven onto a screen."""

from __future__ import annotations

import math
from dataclasses import dataclass
from numbers import Real

import numpy as np
import numpy.typing as npt

from firmware_io.errors import LimitError

#: No configuration raises the ceiling above this: it is the product's safety limit.
ABSOLUTE_CEILING_V = 200.0

#: A 20 kHz carrier at the absolute ceiling slews at 2 pi f V. The 5 % above it admit an envelope
#: that moves at up to 0.32 times the carrier's own rate (sqrt(1 + 0.32**2) = 1.05).
DEFAULT_MAX_SLEW_V_PER_S = 1.05 * 2.0 * math.pi * 20e3 * ABSOLUTE_CEILING_V

#: The longest time without a host after which a driver is at 0 V and disarmed.
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

#: A carrier is at least this fast. Half of its turn at the ceiling leaves a mean of 0.06 V over a
#: second, far below the limit, and an envelope cannot be gated in step with it unnoticed.
MIN_CARRIER_HZ = 1000.0

#: Energy and mean are taken over this long: shorter than it takes parts to warm or ions to move.
DEFAULT_WINDOW_S = 1.0

#: Duration of the ramp to 0 V that ends a stream, in seconds: what a driver's own takes.
RAMP_S = 0.005

_RECOUNTS = 64  # in a window; a stretch is that much longer at most

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
        Largest admissible mean over the window, as a share of its largest magnitude. No stretch
        within a window may sum to more than this share of the ceiling over a whole window.
    window_s : float
        Length of that window, in seconds; before the first sample it holds 0 V.

    Raises
    ------
    LimitError
        If a limit is not finite and positive, or is above its default: limits can be lowered only.
    """

    ceiling_v: float = ABSOLUTE_CEILING_V
    max_slew_v_per_s: float = DEFAULT_MAX_SLEW_V_PER_S
    max_rms_v: float = DEFAULT_MAX_RMS_V
    max_dc_share: float = DEFAULT_MAX_DC_SHARE
    window_s: float = DEFAULT_WINDOW_S

    def __post_init__(self) -> None:
        for name, highest, unit in (
            ("ceiling_v", ABSOLUTE_CEILING_V, " V"),
            ("max_slew_v_per_s", DEFAULT_MAX_SLEW_V_PER_S, " V/s"),
            ("max_rms_v", DEFAULT_MAX_RMS_V, " V"),
            ("max_dc_share", DEFAULT_MAX_DC_SHARE, ""),
            ("window_s", DEFAULT_WINDOW_S, " s"),
        ):
            value = getattr(self, name)
            is_number = isinstance(value, Real) and not isinstance(value, bool)
            if not (is_number and math.isfinite(value) and value > 0):
                raise LimitError(
                    f"{name} must be a finite number above 0, but is {value!r}; correct it."
                )
            if value > highest:
                raise LimitError(
                    f"{name} must be at most {highest:g}{unit}, but is {value!r}{unit}; choose a "
                    "lower value, the product's limit cannot be raised."
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
        self, last_v: float, sample_rate_hz: float, ramp_s: float = RAMP_S
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

    It takes what leaves the driver: samples, or the amplitude times the carrier. The driver checks
    the same against its own clock, which also counts the time that a sample is held.

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
        self._sample_rate_hz = sample_rate_hz
        self._next = 0
        self._sum_v = 0.0
        self._sum_square = 0.0
        # The highest and the lowest sum of a stretch that ends with the latest sample.
        self._highest_sum = self._lowest_sum = 0.0
        self._since_recount = 0

    def check(
        self, volts: npt.NDArray[np.float64], each: int = 1, is_carried: bool = False
    ) -> None:
        """Reject samples with which the window would hold too much energy or too high a mean.

        A sample of 0 V is never rejected: it is the remedy.

        Parameters
        ----------
        volts : ndarray, shape (n,)
            Voltages at the window's rate.
        each : int
            Of these are made of one sample, for the number in the message.
        is_carried : bool
            Whether a carrier alternates them, so that a ramp to 0 V has no mean of its own.

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
                f"With sample {index // each} the rms over {self.limits.window_s:g} s reaches "
                f"{math.sqrt(square[index]):g} V, above the limit of {self.limits.max_rms_v:g} V; "
                "lower the amplitude, or pause."
            )
        self._check_mean(volts, each, leaving)
        self._check_stretches(volts, each, 0.0 if is_carried else RAMP_S / 2)

    def _check_mean(
        self,
        volts: npt.NDArray[np.float64],
        each: int,
        leaving: npt.NDArray[np.float64],
    ) -> None:
        """Reject a mean of the window above its share of the largest magnitude there."""
        size = self._ring.size
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
                f"With sample {index // each} the mean over {self.limits.window_s:g} s reaches "
                f"{mean[index]:g} V, above {share:.0%} of the largest magnitude there; "
                "drive without a mean voltage: remove the offset, and pause before trying again."
            )

    def take(self, volts: npt.NDArray[np.float64]) -> None:
        """Take samples into the window, after they were sent."""
        size = self._ring.size
        leaving = self._leaving(volts)
        if volts.size:
            sums = np.cumsum(volts)
            self._highest_sum = float(sums[-1] - min(-self._highest_sum, float(sums.min())))
            self._lowest_sum = float(sums[-1] - max(-self._lowest_sum, float(sums.max())))
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
        self._since_recount += volts.size
        if self._since_recount > size / _RECOUNTS:
            # Without the samples that have left meanwhile.
            self._since_recount = 0
            in_order = np.concatenate([self._ring[self._next :], self._ring[: self._next]])
            behind = np.cumsum(in_order[::-1])
            self._highest_sum = max(0.0, float(behind.max()))
            self._lowest_sum = min(0.0, float(behind.min()))

    def rest(self, samples: int) -> None:
        """Take the time during which the output stood at 0 V, in samples."""
        if samples > 0:
            self.take(np.zeros(min(samples, self._ring.size)))

    def _check_stretches(self, volts: npt.NDArray[np.float64], each: int, ramp_s: float) -> None:
        """Reject a stretch whose sum stays in a window when what came before has left it."""
        largest = float(np.abs(volts).max()) * (volts.size + ramp_s * self._sample_rate_hz)
        most = self.limits.max_dc_share * self.limits.ceiling_v * self._ring.size
        if max(self._highest_sum, -self._lowest_sum) + largest <= most:
            return
        ramp = ramp_s * self._sample_rate_hz * volts
        highest = self._stretches(volts, -self._highest_sum, np.minimum) + ramp
        lowest = self._stretches(volts, -self._lowest_sum, np.maximum) + ramp
        over = ((highest > most) & (volts > 0.0)) | ((lowest < -most) & (volts < 0.0))
        if over.any():
            index = int(over.argmax())
            worst = highest[index] if volts[index] > 0.0 else lowest[index]
            raise LimitError(
                f"With sample {index // each} a mean of {worst / self._ring.size:g} V over "
                f"{self.limits.window_s:g} s builds up, above {self.limits.max_dc_share:.0%} of "
                "the ceiling; drive without a mean voltage: remove the offset, and pause before "
                "trying again."
            )

    @staticmethod
    def _stretches(
        volts: npt.NDArray[np.float64], before: float, extreme: np.ufunc
    ) -> npt.NDArray[np.float64]:
        """Return the extreme sum of the stretches that end with each sample, shape (n,)."""
        sums = np.cumsum(volts)
        begins = extreme.accumulate(np.concatenate([[extreme(before, 0.0)], sums]))
        return np.asarray(sums - begins[1:])

    def _leaving(self, volts: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """Return the samples that leave as `volts` come in, shape (n,)."""
        size = self._ring.size
        end = self._next + volts.size
        if end <= size:
            return self._ring[self._next : end]
        whole = np.concatenate([self._ring[self._next :], self._ring[: self._next], volts])
        return whole[: volts.size]
