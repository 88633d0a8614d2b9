"""The mock's converter: codes of the current that its output drives through panel and finger."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Literal

import numpy as np
import numpy.typing as npt

from firmware_io.capabilities import DEFAULT_CARRIER_HZ
from firmware_io.device_errors import DeviceError
from firmware_io.protocol import FULL_SCALE_CODE, CapabilitiesReport

Codes = npt.NDArray[np.int16]
Farads = complex | Callable[[float, float], complex]
Failure = Literal["dead", "stuck", "noise", "inverted", "saturated", "late", "silent"]

RATES_HZ = (250, 500, 1000, 2000, 4000)


class MockConverter:
    """Measures the current of a `MockDriver`.

    Parameters
    ----------
    farads : complex or callable
        Complex capacitance to earth [F], its imaginary part negative for losses; or a function of
        the amplitude driven [V] and the time since power-up [s], such as that of a virtual finger.
    rate_hz : int
        Readings a second: 250, 500, 1000, 2000 or 4000.
    carrier_hz : float
        The carrier at which that capacitance holds [Hz]: the driver's own.
    full_scale_a : float
        Current of the highest code [A].
    panel_f : float
        Capacitance of the untouched panel that the firmware is told [F].
    bits : int
        Bits of the converter.
    noise_a : float
        Standard deviation of each sample [A].
    late_samples : int
        Delay of its samples when it fails "late".
    source : callable, optional
        Returns raw codes, shape (n,) of int16, for as many output samples, in place of all above.
    seed : int
        Of the noise.

    Attributes
    ----------
    failure : str or None
        What is wrong: "dead" (0 always), "stuck" (the last code for ever), "noise" (alone: a broken
        electrode), "inverted", "saturated", "late", "silent" (no samples).

    Raises
    ------
    DeviceError
        If a value is impossible.

    Examples
    --------
    >>> from firmware_io import Device, MockDriver, MockLink
    >>> driver = MockDriver(converter=MockConverter(2e-9))
    >>> with Device(MockLink(driver), mode="envelope") as device:
    ...     device.write(np.linspace(0, 100, 1600))
    >>> abs(device.readings()[-1].quadrature_a) > 4e-3  # 2 pi 4 kHz 2 nF 95 V
    True
    """

    def __init__(
        self,
        farads: Farads = 2e-9,
        *,
        rate_hz: int = 250,
        carrier_hz: float = DEFAULT_CARRIER_HZ,
        full_scale_a: float = 0.02,
        panel_f: float = 2e-9,
        bits: int = 12,
        noise_a: float = 1e-5,
        late_samples: int = 3,
        source: Callable[[Codes], Codes] | None = None,
        seed: int = 0,
    ) -> None:
        if rate_hz not in RATES_HZ:
            raise DeviceError(f"rate_hz must be one of {RATES_HZ}, but is {rate_hz!r}; correct it.")
        if not 4 <= bits <= 16:
            raise DeviceError(f"bits must lie in 4 to 16, but is {bits!r}; correct it.")
        self.farads = farads
        self.rate_hz = int(rate_hz)
        self.carrier_hz = carrier_hz
        self.full_scale_a = full_scale_a
        self.panel_f = panel_f
        self.failure: Failure | None = None
        self._source = source
        self._step = 2 ** (16 - bits)
        self._noise_codes = noise_a / full_scale_a * FULL_SCALE_CODE
        self._random = np.random.default_rng(seed)
        self._late = np.zeros(late_samples, np.int16)
        self._before = self._last = 0
        self._played = 0

    def measure(self, sent: Codes, about: CapabilitiesReport) -> Codes | None:
        """Return raw codes of output samples, shape (n,), at the left of 16 bits; None if silent.

        Parameters
        ----------
        sent : ndarray of int16, shape (n,)
            Output samples.
        about : CapabilitiesReport
            Rate and full scale of the output.
        """
        if self._source is None:
            codes = self._convert(self._current(sent, about))
        else:
            codes = self._source(sent)
        delayed = np.concatenate([self._late, codes])
        self._late = delayed[codes.size :]
        match self.failure:
            case "silent":
                return None
            case "dead":
                return np.zeros_like(codes)
            case "stuck":
                return np.full_like(codes, self._last)
            case "noise":
                return self._convert(np.zeros(codes.size))
            case "inverted":
                inverted: Codes = -np.maximum(codes, -FULL_SCALE_CODE)
                return inverted
            case "saturated":
                return np.where(codes < 0, -32768, FULL_SCALE_CODE).astype(np.int16)
            case "late":
                return delayed[: codes.size]
        self._last = int(codes[-1])
        return codes

    def _current(self, sent: Codes, about: CapabilitiesReport) -> npt.NDArray[np.float64]:
        """Return the current of output samples, in codes of the converter, without noise."""
        volts = np.concatenate([[self._before], sent]) * about.full_scale_mv / 1e3 / FULL_SCALE_CODE
        self._before = int(sent[-1])
        # Of a sine, v(t) cos(x) - v(t - dt) is sin(x) times v a quarter later, x = 2 pi f dt.
        turn = 2 * math.pi * self.carrier_hz / about.output_rate_hz
        ahead = (volts[1:] * math.cos(turn) - volts[:-1]) / math.sin(turn)
        amplitude_v = float(np.sqrt((volts[1:] ** 2 + ahead**2).max()))
        self._played += sent.size
        time_s = self._played / about.output_rate_hz
        farads = self.farads(amplitude_v, time_s) if callable(self.farads) else self.farads
        siemens = 2j * math.pi * self.carrier_hz * complex(farads)
        current: npt.NDArray[np.float64] = siemens.real * volts[1:] + siemens.imag * ahead
        return current / self.full_scale_a * FULL_SCALE_CODE

    def _convert(self, current: npt.NDArray[np.float64]) -> Codes:
        noisy = current + self._random.normal(0.0, self._noise_codes, current.size)
        rounded = np.round(noisy / self._step) * self._step
        codes: Codes = np.clip(rounded, -32768, 32768 - self._step).astype(np.int16)
        return codes
