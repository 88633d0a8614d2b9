"""The rig's check: how far its forces and volts are from known ones, and its sensor's bandwidth.

A gain of the tangential force looks like friction, and an amplifier that is weak behind its monitor
like a thicker insulator: no stroke tells them apart. A known weight on each axis and a second
reading of the volts do.
"""

from __future__ import annotations

from math import hypot, isfinite, log
from typing import Annotated, Self

import numpy as np
from pydantic import Field, PositiveFloat, model_validator

from calibration.parameters import Array
from haptix.documents import Document
from haptix.perception import WEBER_FRACTION

RIG = "rig.toml"
"""Name of the check in a session's folder."""


class RigCheck(Document):
    """What known forces and volts read; each gain is the reading over the known value.

    Parameters
    ----------
    normal_gain, tangential_gain : float
        Reading of each axis under a known weight over its force; 1 where sign, unit and scale are
        right.
    force_gain_spread : float
        Relative standard uncertainty of either gain: that of the weight and of the reading.
    voltage_gain : float
        Amplitude on the screen, by an instrument of its own, over that in the recordings.
    voltage_gain_spread : float
        Its relative standard uncertainty.
    pole_hz, resonance_hz, quality : float or None
        Bandwidth of the tangential axis by a tap: a pole of first order, a resonance and its
        quality; None where none is seen.
    instruments : tuple of str
        What was known: the weight, the voltmeter.
    """

    normal_gain: float
    tangential_gain: float
    force_gain_spread: PositiveFloat = 0.005
    voltage_gain: float
    voltage_gain_spread: PositiveFloat = 0.005
    pole_hz: PositiveFloat | None = None
    resonance_hz: PositiveFloat | None = None
    quality: Annotated[float | None, Field(gt=0)] = None
    instruments: tuple[str, ...] = ()

    @model_validator(mode="after")
    def _is_finite(self) -> Self:
        gains = self.normal_gain, self.tangential_gain, self.voltage_gain
        if not all(isfinite(one) and one != 0 for one in gains):
            raise ValueError("expected gains that are finite and not 0: is a channel dead?")
        return self

    def faults(self) -> list[str]:
        """Return what is wrong beyond the scale of a gain, and what to do."""
        found = []
        for name in ("normal", "tangential"):
            gain = getattr(self, f"{name}_gain")
            if gain < 0:
                found.append(f"the {name} force has the wrong sign: give its channel scale x -1")
            elif not 0.5 < gain < 2:
                found.append(
                    f"the {name} force reads {gain:.3g} times a known weight: check its unit"
                )
        if self.voltage_gain < 0:
            found.append("voltage_gain: expected a ratio of amplitudes, above 0")
        return found

    def friction_error(self, volts_power: Array) -> tuple[Array, Array]:
        """Error of friction [JND] that the gains cause, its size and its standard uncertainty.

        `volts_power` is d ln mu / d ln V, shape (strokes,).
        """
        ratio = abs(log(abs(self.tangential_gain / self.normal_gain)))
        size = ratio + np.abs(volts_power * log(abs(self.voltage_gain)))
        spread = np.hypot(
            hypot(self.force_gain_spread, self.force_gain_spread),
            volts_power * self.voltage_gain_spread,
        )
        return size / WEBER_FRACTION, spread / WEBER_FRACTION
