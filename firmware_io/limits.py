"""The one place that holds safety limits on what may be driven onto a screen."""

from __future__ import annotations

import math
import sys
from dataclasses import dataclass
from numbers import Real
from typing import Self

import numpy as np
import numpy.typing as npt

from firmware_io.device_errors import LimitError

#: No configuration raises the ceiling above this: it is the product's safety limit.
ABSOLUTE_CEILING_V = 200.0

#: Touch current that IEC 61010-1 (6.3.1, normal condition) allows from a part that is touched.
#: It is not weighted with frequency, though the weighting would allow more above 1 kHz.
MAX_PEAK_A = 0.7e-3
MAX_RMS_A = 0.5e-3

#: Capacitance from the electrode through finger and body to earth, if no larger one is known: the
#: body of IEC 61000-4-2. The contact in series makes it smaller. For a person who is earthed it can
#: be larger, since only the contact's capacitance is left.
BODY_CAPACITANCE_F = 150e-12

#: The peak current is ``C dV/dt``, so its limit is a limit of the slew: 4.67 MV/s. The driver
#: enforces it, too. A sine of 186 V at 4 kHz reaches it, and one of 74 V at 10 kHz.
DEFAULT_MAX_SLEW_V_PER_S = MAX_PEAK_A / BODY_CAPACITANCE_F

#: The longest time without a host until a driver is at 0 V and disarmed.
#: It is long enough that a pause of the host causes an underrun and does not end the session: 20 ms
#: in a slow block, some 100 ms on a busy desktop. It is short enough that the output of a dead host
#: ends before a person who feels it can react to it.
WATCHDOG_S = 0.16

#: Energy: the rms of a sine at the absolute ceiling, the strongest drive that screens are rated
#: and calibrated for, and 1 % for windows without a whole number of its periods. Heat in amplifier
#: and insulator, and the mean attraction, grow with the square of the voltage: a square wave at the
#: ceiling has twice those of a sine, so it may last for less than half of the window.
DEFAULT_MAX_RMS_V = 1.01 * ABSOLUTE_CEILING_V / math.sqrt(2.0)

#: A mean voltage is not felt, since charge leaks through the insulator and screens it, but it moves
#: ions in the insulator and keeps a current through the person. 5 % of a second allow the half
#: period with which any tone from 6.4 Hz on begins (2/pi * T/2 <= 0.05 s).
DEFAULT_MAX_DC_SHARE = 0.05

#: The slowest carrier. Half a period of it at the ceiling gives a mean of 0.06 V over a second, far
#: below the limit, and an envelope that is switched in step with it is noticed.
MIN_CARRIER_HZ = 1000.0

#: Time over which energy and mean are taken: shorter than parts take to warm or ions to move.
DEFAULT_WINDOW_S = 1.0

#: Duration of the ramp to 0 V that ends a stream, in seconds; that of a driver's own ramp.
RAMP_S = 0.005


@dataclass(frozen=True)
class Current:
    """A current through the person: largest and root mean square, in amperes."""

    peak_a: float
    rms_a: float

    @classmethod
    def of_slew(cls, peak_v_per_s: float, rms_v_per_s: float, capacitance_f: float) -> Self:
        """Return the current of a drive with this slew: ``C dV/dt``."""
        return cls(capacitance_f * peak_v_per_s, capacitance_f * rms_v_per_s)

    @classmethod
    def of_drive(
        cls, volts: npt.NDArray[np.float64], sample_rate_hz: float, capacitance_f: float
    ) -> Self:
        """Return the current of a drive that begins at 0 V, volts of shape (n,)."""
        slew = np.diff(volts, prepend=0.0) * sample_rate_hz
        peak, square = np.abs(slew).max(initial=0.0), (slew**2).sum() / max(slew.size, 1)
        return cls.of_slew(float(peak), math.sqrt(square), capacitance_f)


def series_capacitance_f(contact_f: float, body_f: float = BODY_CAPACITANCE_F) -> float:
    """Return the capacitance of a finger's contact with the body behind it, in farads."""
    return contact_f * body_f / (contact_f + body_f)


@dataclass(frozen=True)
class DriveLimits:
    """Limits of a drive signal.

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
    max_peak_a, max_rms_a : float
        Largest admissible current through the person, in amperes; the rms is that of the window.
    capacitance_f : float
        Capacitance through which that current flows, in farads; at least `BODY_CAPACITANCE_F`. It
        lowers `max_slew_v_per_s` to the slew of the largest peak current.

    Raises
    ------
    LimitError
        If a limit is not finite and positive, or is above its default: limits can only be lowered.
        Also if `capacitance_f` is below its default, which would raise the voltage.

    Examples
    --------
    >>> limits = DriveLimits(ceiling_v=100.0)
    >>> limits.ceiling_v, limits.window_s
    (100.0, 1.0)
    """

    ceiling_v: float = ABSOLUTE_CEILING_V
    max_slew_v_per_s: float = DEFAULT_MAX_SLEW_V_PER_S
    max_rms_v: float = DEFAULT_MAX_RMS_V
    max_dc_share: float = DEFAULT_MAX_DC_SHARE
    window_s: float = DEFAULT_WINDOW_S
    max_peak_a: float = MAX_PEAK_A
    max_rms_a: float = MAX_RMS_A
    capacitance_f: float = BODY_CAPACITANCE_F

    def __post_init__(self) -> None:
        for name, highest, unit in (
            ("ceiling_v", ABSOLUTE_CEILING_V, " V"),
            ("max_slew_v_per_s", DEFAULT_MAX_SLEW_V_PER_S, " V/s"),
            ("max_rms_v", DEFAULT_MAX_RMS_V, " V"),
            ("max_dc_share", DEFAULT_MAX_DC_SHARE, ""),
            ("window_s", DEFAULT_WINDOW_S, " s"),
            ("max_peak_a", MAX_PEAK_A, " A"),
            ("max_rms_a", MAX_RMS_A, " A"),
            ("capacitance_f", math.inf, " F"),
        ):
            value = getattr(self, name)
            is_number = isinstance(value, Real) and not isinstance(value, bool)
            if not (is_number and 0 < value <= sys.float_info.max):
                raise LimitError(
                    f"{name} must be a finite number above 0, but is {value!r}; correct it."
                )
            if value > highest:
                raise LimitError(
                    f"{name} must be at most {highest:g}{unit}, but is {value!r}{unit}; choose a "
                    "lower value, the product's limit cannot be raised."
                )
        if self.capacitance_f < BODY_CAPACITANCE_F:
            raise LimitError(
                f"capacitance_f must be at least {BODY_CAPACITANCE_F:g} F, a body's, but is "
                f"{self.capacitance_f!r} F; less would raise the limit of the current, which "
                "cannot be raised."
            )
        slew = min(self.max_slew_v_per_s, self.max_peak_a / self.capacitance_f)
        object.__setattr__(self, "max_slew_v_per_s", slew)

    @property
    def max_rms_slew_v_per_s(self) -> float:
        """Largest admissible rms of the slew over the window: that of the largest rms current."""
        return self.max_rms_a / self.capacitance_f

    def highest_sine_v(self, frequency_hz: float) -> float:
        """Amplitude of the strongest sine that ceiling and slew admit, in volts.

        Examples
        --------
        >>> limits = DriveLimits()
        >>> limits.highest_sine_v(100.0) <= limits.ceiling_v
        True
        """
        slews = 2.0 * math.pi * frequency_hz * self.ceiling_v
        return self.ceiling_v * min(1.0, self.max_slew_v_per_s / max(slews, 1.0))

    def check(
        self, volts: npt.NDArray[np.float64], previous_v: float, sample_rate_hz: float
    ) -> None:
        """Reject samples that break the ceiling or the slew limit.

        Parameters
        ----------
        volts : ndarray, shape (n,)
            Samples to be driven, in volts.
        previous_v : float
            The sample before the first one, in volts.
        sample_rate_hz : float
            Samples per second.

        Raises
        ------
        LimitError
            If a sample is not finite, exceeds the ceiling, or differs from the one before it by
            more than the slew limit allows. The message names the first such sample.
        """
        if volts.size == 0:
            return
        # Written so that NaN, which compares false with everything, counts as over the ceiling.
        lowest, highest = np.minimum.reduce(volts), np.maximum.reduce(volts)
        if not (-self.ceiling_v <= lowest and highest <= self.ceiling_v):
            index = int((~(np.abs(volts) <= self.ceiling_v)).argmax())
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
        steps = np.empty_like(volts)  # np.diff takes three times as long for a short block
        steps[0] = volts[0] - previous_v
        np.subtract(volts[1:], volts[:-1], out=steps[1:])
        allowed = self.max_slew_v_per_s / sample_rate_hz
        if np.maximum.reduce(steps) > allowed or np.minimum.reduce(steps) < -allowed:
            index = int((np.abs(steps) > allowed).argmax())
            before = float(volts[index - 1]) if index else previous_v
            raise LimitError(
                f"Sample {index} steps from {before:g} V to {volts[index]:g} V, but the slew limit "
                f"of {self.max_slew_v_per_s:g} V/s{self._as_current()} allows {allowed:g} V per "
                f"sample at {sample_rate_hz:g} Hz; start, change and end the signal more gradually."
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
            As in `check`, and if an amplitude is negative. The slope of ``a sin(w t)`` is taken
            as ``|a'| + w a``, the largest possible, as in the driver.
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
                f"{self.max_slew_v_per_s:g} V/s{self._as_current()}; choose a slower carrier or a "
                "lower amplitude."
            )

    def _as_current(self) -> str:
        """Return the current that the slew limit stands for, for messages."""
        peak_ma = self.max_slew_v_per_s * self.capacitance_f * 1e3
        return f" ({peak_ma:.3g} mA through {self.capacitance_f * 1e12:.4g} pF)"

    def ramp_to_zero(
        self, last_v: float, sample_rate_hz: float, ramp_s: float = RAMP_S
    ) -> npt.NDArray[np.float64]:
        """Return a straight ramp from the sample after `last_v` to exactly 0 V.

        Parameters
        ----------
        last_v : float
            The present voltage of the output.
        sample_rate_hz : float
            Samples per second.
        ramp_s : float
            Duration in seconds; longer if the slew limit requires it.

        Returns
        -------
        ndarray, shape (n,)
            At least one sample, in volts; the last is 0.0. It passes `check` after `last_v`.

        Examples
        --------
        >>> DriveLimits().ramp_to_zero(100.0, sample_rate_hz=1000.0, ramp_s=0.004).tolist()
        [75.0, 50.0, 25.0, 0.0]
        """
        # One sample for rounding up, and one so that a rounded step stays below the limit.
        shortest = int(abs(last_v) * sample_rate_hz / self.max_slew_v_per_s) + 2
        count = max(math.ceil(ramp_s * sample_rate_hz), shortest)
        return np.linspace(last_v, 0.0, count + 1)[1:]
