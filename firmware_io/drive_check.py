"""What leaves a driver for the samples of a stream, and whether it keeps the limits."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from firmware_io.drive_codes import compiled_codes
from firmware_io.drive_window import DriveWindow
from firmware_io.limits import DriveLimits
from firmware_io.protocol import Setup, StreamMode, volts_to_codes

_Volts = npt.NDArray[np.float64]


class DriveCheck:
    """Checks of one stream: each sample, and energy, mean and current of what is driven.

    Parameters
    ----------
    limits : DriveLimits
        Limits of every sample.
    setup : Setup
        Mode, sample rate and carrier.
    output_rate_hz : float
        Rate of the driver's clock.
    """

    def __init__(self, limits: DriveLimits, setup: Setup, output_rate_hz: float) -> None:
        self.limits = limits
        self.setup = setup
        self._output_rate_hz = output_rate_hz
        # Of one sample of an envelope the window counts every output sample, times the carrier.
        is_envelope = setup.mode is StreamMode.ENVELOPE
        self.each = round(output_rate_hz / setup.sample_rate_hz) if is_envelope else 1
        self._rate_hz = float(setup.sample_rate_hz * self.each)
        self._window = DriveWindow(limits, self._rate_hz)

    def begin(self, rested_s: float, is_revisable: bool) -> None:
        """Take the present limits, after a time at 0 V."""
        if is_revisable:
            self._window.prefer_compiled()
        self._window.limits = self.limits
        self._window.rest(math.floor(min(rested_s, self.limits.window_s) * self._rate_hz))

    def check(self, volts: _Volts, before_v: float) -> None:
        """Reject samples that break ceiling or slew behind the one before them."""
        rate_hz = float(self.setup.sample_rate_hz)
        if self.setup.mode is StreamMode.WAVEFORM:
            self.limits.check(volts, before_v, rate_hz)
        else:
            self.limits.check_envelope(volts, before_v, rate_hz, self.setup.carrier_mhz / 1e3)

    def codes(self, volts: _Volts, before_v: float, full_scale_v: float) -> npt.NDArray[np.int16]:
        """Check samples as `check` does, and return their codes."""
        fast = compiled_codes() if self.setup.mode is StreamMode.WAVEFORM else None
        if fast is not None:
            rate_hz = float(self.setup.sample_rate_hz)
            codes = fast(volts, before_v, self.limits, rate_hz, full_scale_v)
            if codes is not None:
                return codes
        self.check(volts, before_v)
        return volts_to_codes(volts, full_scale_v, self.limits.ceiling_v)

    def check_window(self, driven: _Volts) -> None:
        """Reject what would break energy, mean or current behind what was taken."""
        self._window.check(driven, self.each, self.setup.mode is StreamMode.ENVELOPE)

    def take(self, driven: _Volts) -> None:
        """Count what is driven."""
        self._window.take(driven)

    def driven(self, volts: _Volts, first: int, before_v: float) -> _Volts:
        """Return what leaves the driver for samples from index `first` on, without a pause."""
        if self.setup.mode is StreamMode.WAVEFORM:
            return volts
        each = self.each
        levels = volts
        if each > 1:
            points = np.concatenate([[before_v], volts])
            at = np.arange(1, each * volts.size + 1) / each
            levels = np.interp(at, np.arange(points.size), points)
        turns = self.setup.carrier_mhz / 1e3 / self._output_rate_hz
        # The carrier begins at phase 0 with the line to the first sample.
        tick = np.arange(first * each, first * each + levels.size)
        carrier = np.sin(2 * np.pi * turns * tick)
        return np.asarray(levels * carrier)
