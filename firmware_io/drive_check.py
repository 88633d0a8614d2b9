"""The voltage that a driver makes of the samples of a stream, and checks of its limits.

The drive window is the last second of the output, to which samples are added when they are sent::

         |<------- window: rms, mean, current ------->|
    -----+--------------------------------------------+---------------------+
    past | taken                                      | to be sent          |
    -----+--------------------------------------------+---------------------+
                                                       check: with each of these in turn, and the
                                                       oldest left out, all bounds are kept, or a
                                                       `LimitError` names the first that breaks one
                                                       take: they are sent; the window moves on

A check does not change the window. A pause at 0 V counts as samples of 0 V.
"""

from __future__ import annotations

import math
from typing import Self

import numpy as np
import numpy.typing as npt

from firmware_io.capabilities import kept_limits
from firmware_io.device_errors import LimitError
from firmware_io.firmware.core import compiled
from firmware_io.limits import RAMP_S, DriveLimits
from firmware_io.protocol import Setup, StreamMode, top_code, volts_to_codes

_Volts = npt.NDArray[np.float64]

#: A smaller mean counts as 0 V: rounding to codes makes some, at 250 V full scale.
_DC_FLOOR_V = 0.05


class DriveWindow:
    """The last second or so of the output: rejects too much energy, current and mean voltage.

    It takes the output voltage: samples, or the amplitude times the carrier. The driver also checks
    energy and mean, by its own clock, which includes the time that a sample is held.

    Parameters
    ----------
    limits : DriveLimits
        Limits of the window.
    sample_rate_hz : float
        Samples per second.
    """

    def __init__(self, limits: DriveLimits, sample_rate_hz: float) -> None:
        self._sample_rate_hz = sample_rate_hz
        self._size = max(1, round(limits.window_s * sample_rate_hz))
        self._ffi, self._lib = compiled()
        self._memory = np.zeros(self._lib.hx_host_window_bytes(self._size), np.uint8)
        self._window = self._ffi.cast("hx_host_window *", self._ffi.from_buffer(self._memory))
        self._lib.hx_host_window_init(self._window, self._size)
        self.bind(limits)

    def bind(self, limits: DriveLimits) -> None:
        """Set other limits, with a window of the same length."""
        self.limits = limits
        self._bounds = self._ffi.new(
            "hx_host_limits *",
            {
                "most_squares": self._size * limits.max_rms_v**2,
                "most_steps": self._size
                * (limits.max_rms_slew_v_per_s / self._sample_rate_hz) ** 2,
                "most_stretch": self._size * limits.max_dc_share * limits.ceiling_v,
                "mean_share": limits.max_dc_share,
                "mean_floor": _DC_FLOOR_V,
            },
        )

    def check(self, volts: _Volts, each: int = 1, is_carried: bool = False) -> None:
        """Reject samples that would give the window too much energy or too high a mean.

        A sample of 0 V is never rejected, since only 0 V brings the window back.

        Parameters
        ----------
        volts : ndarray, shape (n,)
            Voltages at the window's rate.
        each : int
            How many of these come from one sample, for the sample's number in the message.
        is_carried : bool
            Whether a carrier changes their sign, so that a ramp to 0 V has no mean of its own.

        Raises
        ------
        LimitError
            The message names the first such sample.
        """
        bounds = self._bounds
        bounds.ramp_samples = 0.0 if is_carried else RAMP_S / 2 * self._sample_rate_hz
        index, value = self._ffi.new("uint32_t *"), self._ffi.new("double *")
        window = self if volts.size <= self._size else self._copy()
        for start in range(0, volts.size, self._size):
            piece = np.ascontiguousarray(volts[start : start + self._size])
            verdict = self._lib.hx_host_check(
                window._window, bounds, self._buffer(piece), piece.size, index, value
            )
            if verdict != self._lib.HX_HOST_KEPT:
                raise LimitError(self.reason(verdict, (start + index[0]) // each, value[0]))
            if window is not self:
                window.take(piece)

    def lend(self) -> tuple[object, object]:
        """Return window and bounds, for a player in C that checks samples of a waveform itself."""
        self._bounds.ramp_samples = RAMP_S / 2 * self._sample_rate_hz
        return self._window, self._bounds

    def take(self, volts: _Volts) -> None:
        """Add samples to the window after they were sent."""
        volts = np.ascontiguousarray(volts)
        self._lib.hx_host_take(self._window, self._buffer(volts), volts.size)

    def rest(self, samples: int) -> None:
        """Add a time at 0 V, in samples."""
        self.take(np.zeros(max(1, min(samples, self._size))))

    def _buffer(self, volts: _Volts) -> object:
        return self._ffi.from_buffer("double[]", volts)

    def _copy(self) -> Self:
        """Return a copy, with which more samples can be checked than the window is long."""
        copy = type(self)(self.limits, self._sample_rate_hz)
        copy._memory[:] = self._memory
        return copy

    def reason(self, verdict: int, sample: int, value: float) -> str:
        """Say which limit a sample breaks, by the verdict of the check in C and the sum it found.

        Parameters
        ----------
        verdict, sample, value
            See `hx_host_check` in `firmware_io/firmware/haptix_host.h`.
        """
        limits, lib = self.limits, self._lib
        reaches = f"over {limits.window_s:g} s reaches"
        remedy = "drive without a mean voltage: remove the offset, and pause before trying again."
        if verdict == lib.HX_HOST_SQUARES:
            return (
                f"With sample {sample} the rms {reaches} {math.sqrt(value / self._size):g} V, "
                f"above the limit of {limits.max_rms_v:g} V; lower the amplitude, or pause."
            )
        if verdict == lib.HX_HOST_MEAN:
            return (
                f"With sample {sample} the mean {reaches} {value / self._size:g} V, above "
                f"{limits.max_dc_share:.0%} of the largest magnitude there; {remedy}"
            )
        if verdict == lib.HX_HOST_STRETCH:
            return (
                f"With sample {sample} a mean of {value / self._size:g} V over "
                f"{limits.window_s:g} s builds up, above {limits.max_dc_share:.0%} of the ceiling; "
                f"{remedy}"
            )
        slew = math.sqrt(value / self._size) * self._sample_rate_hz
        current_ma = slew * limits.capacitance_f * 1e3
        return (
            f"With sample {sample} the current {reaches} {current_ma:.3g} mA "
            f"rms through {limits.capacitance_f * 1e12:.4g} pF, above the limit of "
            f"{limits.max_rms_a * 1e3:g} mA; lower the amplitude or the frequency, or pause."
        )


class DriveCheck:
    """Checks of one stream: of each sample, and of energy, mean and current of the output.

    Parameters
    ----------
    limits : DriveLimits
        Limits that the user and the driver state.
    setup : Setup
        Mode, sample rate, carrier, and the limits in whole numbers.
    output_rate_hz : int
        Rate of the driver's clock.

    Attributes
    ----------
    stated, setup : DriveLimits, Setup
        As above.
    limits : DriveLimits
        Limits of the samples, such that their codes keep those of the set-up.
    """

    def __init__(self, limits: DriveLimits, setup: Setup, output_rate_hz: int) -> None:
        self._output_rate_hz = output_rate_hz
        self.bind(limits, setup)
        # For a sample of an envelope the window takes every output sample, times the carrier.
        is_envelope = setup.mode is StreamMode.ENVELOPE
        self.each = round(output_rate_hz / setup.sample_rate_hz) if is_envelope else 1
        self._rate_hz = float(setup.sample_rate_hz * self.each)
        self._window = DriveWindow(limits, self._rate_hz)

    def bind(self, stated: DriveLimits, setup: Setup) -> None:
        """Set other limits and another set-up."""
        self.stated, self.setup = stated, setup
        self.limits = kept_limits(stated, setup, self._output_rate_hz)
        self._full_scale_v = setup.full_scale_mv / 1e3
        self._most_v = min(self.limits.ceiling_v, self._full_scale_v)
        self._top_code = top_code(self._most_v, self._full_scale_v)

    def begin(self, rested_s: float) -> None:
        """Apply the present limits, after a time at 0 V."""
        self._window.bind(self.limits)
        self._window.rest(math.floor(min(rested_s, self.limits.window_s) * self._rate_hz))

    def check(self, volts: _Volts, before_v: float) -> None:
        """Reject samples that break ceiling or slew, given the sample before them."""
        rate_hz = float(self.setup.sample_rate_hz)
        if self.setup.mode is StreamMode.WAVEFORM:
            self.limits.check(volts, before_v, rate_hz)
        else:
            self.limits.check_envelope(volts, before_v, rate_hz, self.setup.carrier_mhz / 1e3)

    def ramp_to_zero(self, last_v: float) -> _Volts:
        """Return a ramp after a sample; empty if only the driver's own ramp keeps the slew.

        At the highest amplitude the driver accepts no change of it: it adds the steepest slew of
        the carrier and that of the amplitude, as if both came at once.
        """
        rate_hz = float(self.setup.sample_rate_hz)
        ramp = self.limits.ramp_to_zero(last_v, rate_hz)
        try:
            self.check(ramp, last_v)
        except LimitError:
            return ramp[:0]
        return ramp

    def codes(self, volts: _Volts, before_v: float) -> npt.NDArray[np.int16]:
        """Check samples as `check` does, and return their codes."""
        if self.setup.mode is StreamMode.WAVEFORM:
            ffi, lib = compiled()
            codes = np.empty(volts.size, dtype=np.int16)
            is_kept = lib.hx_host_codes(
                ffi.from_buffer("double[]", volts),
                volts.size,
                before_v,
                self._most_v,
                self.limits.max_slew_v_per_s / self.setup.sample_rate_hz,
                self._full_scale_v,
                self._top_code,
                ffi.from_buffer("int16_t[]", codes),
            )
            if is_kept:
                return codes
        self.check(volts, before_v)
        return volts_to_codes(volts, self._full_scale_v, self.limits.ceiling_v)

    def check_window(self, driven: _Volts) -> None:
        """Reject output that would break energy, mean or current after all that was taken."""
        self._window.check(driven, self.each, self.setup.mode is StreamMode.ENVELOPE)

    def lent(self) -> dict[str, object]:
        """Return the limits of a waveform's samples for a player in C, which takes them itself."""
        window, bounds = self._window.lend()
        return {
            "window": window,
            "limits": bounds,
            "most_v": self._most_v,
            "most_step_v": self.limits.max_slew_v_per_s / self.setup.sample_rate_hz,
            "full_scale_v": self._full_scale_v,
            "top_code": self._top_code,
        }

    def refusal(self, verdict: int, sample: int, value: float) -> LimitError:
        """Return the error for the sample that the check in C has found, see `DriveWindow`."""
        return LimitError(self._window.reason(verdict, sample, value))

    def take(self, driven: _Volts) -> None:
        """Add output to the window."""
        self._window.take(driven)

    def driven(self, volts: _Volts, first: int, before_v: float) -> _Volts:
        """Return the output voltage for samples from index `first` on, without a pause."""
        if self.setup.mode is StreamMode.WAVEFORM:
            return volts
        each = self.each
        levels = volts
        if each > 1:
            points = np.concatenate([[before_v], volts])
            at = np.arange(1, each * volts.size + 1) / each
            levels = np.interp(at, np.arange(points.size), points)
        turns = self.setup.carrier_mhz / 1e3 / self._output_rate_hz
        # The carrier begins at phase 0, with the ramp to the first sample.
        tick = np.arange(first * each, first * each + levels.size)
        carrier = np.sin(2 * np.pi * turns * tick)
        return np.asarray(levels * carrier)
