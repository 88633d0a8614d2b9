"""The screen: its insulator, and the voltage it may carry."""

from __future__ import annotations

from typing import Any, Self

from pydantic import PositiveFloat

from haptix.profile import Profile, named_preset


class Screen(Profile):
    """One touchscreen. Presets from the paper; a calibration writes a profile of its own.

    Parameters
    ----------
    name : str
        What to call it.
    insulator_thickness_m, insulator_permittivity
        d1 [m] and eps1 of the insulator over the conductor.
    max_voltage_v
        Highest amplitude [V] the screen may carry; anything above is rejected, never clamped.
    """

    name: str = "custom"
    insulator_thickness_m: PositiveFloat = 1e-6
    insulator_permittivity: PositiveFloat = 8.0
    max_voltage_v: PositiveFloat = 200.0

    @classmethod
    def preset(cls, name: str) -> Self:
        """Return "3m-sct3250", the screen of the paper (1 um of SiO2, eps1 = 8).

        Raises
        ------
        InputError
            If there is no preset of that name.
        """
        return cls(name=name, **named_preset("screen", name, _PRESETS))

    @property
    def h0_m(self) -> float:
        """Effective thickness d1/eps1 of the screen's insulator [m]."""
        return self.insulator_thickness_m / self.insulator_permittivity


_PRESETS: dict[str, dict[str, Any]] = {"3m-sct3250": {}}
