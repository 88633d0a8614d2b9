"""The force sensor's bandwidth from a tap: a pole of first order and a resonance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from scipy.optimize import least_squares

from calibration.parameters import PER_RIG, Array
from calibration.predict import sensor_gain
from haptix.errors import InputError

_BEFORE_S, _AFTER_S = 0.005, 0.2  # of the highest force: a resonance has died away by then
_LOWEST_HZ, _HIGHEST_SHARE = 40.0, 0.4  # of the sampling rate
_LEAST_PEAK = 12.0  # of the noise before it
_FLOOR_LEFT = 0.3  # of the noise's own spectrum, below which a difference to it means nothing
# Pole, resonance and quality to start from.
_STARTS = ((700.0, 6000.0, 8.0), (3000.0, 700.0, 8.0), (3000.0, 1500.0, 8.0), (3000.0, 6000.0, 8.0))
_LOG_BOUNDS = np.log([[100.0, 150.0, 0.6], [1e5, 1e5, 200.0]])


@dataclass(frozen=True)
class TapResponse:
    """Bandwidth by a tap; a pole or resonance far above the recording's band is not seen in it.

    Parameters
    ----------
    pole_hz, resonance_hz, quality : float
        See `calibration.predict.sensor_gain`.
    misfit : float
        Root mean square of the logarithm of the spectrum, less the fitted one.
    """

    pole_hz: float
    resonance_hz: float
    quality: float
    misfit: float


def tap_response(t_s: Array, force_n: Array) -> TapResponse:
    """Fit the spectrum of a tap, shape (samples,) each; a hard tip's blow is shorter than 0.2 ms.

    Raises
    ------
    InputError
        If no tap stands out of the noise.
    """
    step = float(np.median(np.diff(t_s)))
    force = force_n - np.median(force_n)
    peak = int(np.abs(force).argmax())
    noise = float(np.median(np.abs(force))) / 0.6745
    if abs(force[peak]) < _LEAST_PEAK * max(noise, 1e-12) or not step > 0:
        raise InputError(
            f"tap: expected a blow of {_LEAST_PEAK:g} times the noise or more, got "
            f"{abs(force[peak]) / max(noise, 1e-12):.2g} times; tap harder, with a metal tip"
        )
    first = max(peak - round(_BEFORE_S / step), 0)
    part = force[first : peak + round(_AFTER_S / step)]
    hertz = np.fft.rfftfreq(len(part), step)
    size = np.abs(np.fft.rfft(part)) * step
    floor = noise * step * np.sqrt(len(part))
    size = np.sqrt(np.maximum(size**2 - floor**2, (_FLOOR_LEFT * floor) ** 2))
    used = (hertz > _LOWEST_HZ) & (hertz < _HIGHEST_SHARE / step)
    column, wanted = torch.as_tensor(hertz[used]), np.log(np.maximum(size[used], 1e-30))
    # Of the logarithm, whose error is the noise's share; a floor for what is not the sensor's.
    error = np.hypot(floor / np.maximum(size[used], 1e-30), 0.05)

    def residual(values: Array) -> Array:
        sensor = dict(zip(PER_RIG, torch.as_tensor(np.exp(values[1:])), strict=True))
        gain = np.log(sensor_gain(sensor, column).numpy())
        return np.asarray((values[0] + gain - wanted) / error)

    level = float(wanted[: max(len(wanted) // 20, 3)].mean())
    bounds = np.vstack([[level - 3, level + 3], _LOG_BOUNDS.T]).T
    fits = [
        least_squares(residual, [level, *np.log(start)], bounds=bounds, loss="soft_l1")
        for start in _STARTS
    ]
    best = min(fits, key=lambda one: float(one.cost))
    pole, resonance, quality = np.exp(best.x[1:]).tolist()
    misfit = float(np.sqrt(np.mean((residual(best.x) * error) ** 2)))
    return TapResponse(pole, resonance, quality, misfit)
