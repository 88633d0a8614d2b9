"""The screen: its insulator, and the voltage it may carry."""

from __future__ import annotations

from typing import Annotated, Any, Self

from pydantic import Field

from haptix.profile import Profile, named_preset

Plain = Annotated[float, Field(gt=0, strict=True)]
Permittivity = Annotated[float, Field(ge=1)]


class Screen(Profile):
    """One touchscreen. Presets from the paper; a calibration writes a profile of its own.

    Parameters
    ----------
    name : str
        What to call it.
    insulator_thickness_m, insulator_permittivity
        d1 [m] and eps1 of the insulator over the conductor.
    insulator_strength_v_per_m
        Field [V/m] that the insulator bears; a film of SiO2 bears 500 to 1000 V/um.
    gap_resistivity_ohm_m
        Resistivity of what fills the gap [Ohm m], or None for dry air.
    max_voltage_v
        Highest amplitude [V] the screen may carry; anything above is rejected, never clamped.
    """

    name: str = "custom"
    insulator_thickness_m: Plain = 1e-6
    insulator_permittivity: Permittivity = 8.0
    insulator_strength_v_per_m: Plain = 500e6
    gap_resistivity_ohm_m: Plain | None = None
    max_voltage_v: Plain = 200.0

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
