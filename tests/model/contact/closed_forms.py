"""Contacts with exact solutions, to test numerical ones against: Hertz and Westergaard.

An elastic half-space of ``E* = E/(1 - nu^2)`` touches a rigid surface without adhesion or
friction. Methods take numbers and arrays.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import pi

import numpy as np
from numpy.typing import ArrayLike, NDArray

from haptix.base import checks
from haptix.base.errors import InputError

Array = NDArray[np.float64]


@dataclass(frozen=True)
class HertzSphere:
    """A rigid sphere on a half-space.

    Source: Johnson, Contact Mechanics (1985), section 4.2.

    Parameters
    ----------
    radius_m : float
        R [m].
    modulus_pa : float
        E* [Pa].
    """

    radius_m: float
    modulus_pa: float

    def __post_init__(self) -> None:
        checks.positive("radius_m", self.radius_m)
        checks.positive("modulus_pa", self.modulus_pa)

    def contact_radius_m(self, force_n: ArrayLike) -> Array:
        """``a = (3 F R / 4 E*)^(1/3)`` [m] under a force [N]."""
        force = _not_negative("force_n", force_n)
        return np.cbrt(3 * force * self.radius_m / (4 * self.modulus_pa))

    def indentation_m(self, force_n: ArrayLike) -> Array:
        """Approach of distant points, ``a^2 / R`` [m]."""
        return self.contact_radius_m(force_n) ** 2 / self.radius_m

    def peak_pressure_pa(self, force_n: ArrayLike) -> Array:
        """Pressure at the middle, ``3 F / (2 pi a^2) = 2 E* a / (pi R)`` [Pa]."""
        return 2 * self.modulus_pa * self.contact_radius_m(force_n) / (pi * self.radius_m)

    def pressure_pa(self, force_n: float, distance_m: ArrayLike) -> Array:
        """Pressure [Pa] at a distance [m] from the axis: half an ellipse over the contact."""
        radius = self.contact_radius_m(force_n)
        inside = np.clip(1 - (np.asarray(distance_m, dtype=float) / radius) ** 2, 0, None)
        return self.peak_pressure_pa(force_n) * np.sqrt(inside)


@dataclass(frozen=True)
class WavySurface:
    """A wave ``h = amplitude cos(2 pi x / wavelength)`` in one direction on a half-space.

    Source: Westergaard, J. Appl. Mech. 6, A49 (1939); Johnson, Contact Mechanics, section 13.2.

    Parameters
    ----------
    amplitude_m, wavelength_m : float
        The wave [m]; from crest to trough it is twice the amplitude.
    modulus_pa : float
        E* [Pa].
    """

    amplitude_m: float
    wavelength_m: float
    modulus_pa: float

    def __post_init__(self) -> None:
        for name in ("amplitude_m", "wavelength_m", "modulus_pa"):
            checks.positive(name, getattr(self, name))

    @property
    def full_contact_pressure_pa(self) -> float:
        """Mean pressure ``p* = pi E* amplitude / wavelength`` [Pa] that closes every gap."""
        return pi * self.modulus_pa * self.amplitude_m / self.wavelength_m

    def contact_fraction(self, mean_pressure_pa: ArrayLike) -> Array:
        """Contact width over the wavelength, ``(2/pi) asin(sqrt(p/p*))``; 1 from p* on."""
        mean = _not_negative("mean_pressure_pa", mean_pressure_pa)
        share = np.clip(mean / self.full_contact_pressure_pa, 0, 1)
        return 2 / pi * np.arcsin(np.sqrt(share))

    def mean_pressure_pa(self, contact_fraction: ArrayLike) -> Array:
        """Mean pressure ``p* sin^2(pi f / 2)`` [Pa] for a contact width f over the wavelength."""
        share = np.asarray(contact_fraction, dtype=float)
        if not bool(((share >= 0) & (share <= 1)).all()):
            raise InputError(f"contact_fraction: expected 0 to 1, got {contact_fraction!r}")
        return self.full_contact_pressure_pa * np.sin(pi / 2 * share) ** 2

    def pressure_pa(self, mean_pressure_pa: float, x_m: ArrayLike) -> Array:
        """Pressure [Pa] at places x [m] from a crest, below full contact.

        ``p(x) = (2 p cos psi / sin^2 psi_a) sqrt(sin^2 psi_a - sin^2 psi)``, ``psi = pi x/lambda``.
        """
        sine_a = np.sin(pi / 2 * self.contact_fraction(mean_pressure_pa))
        psi = pi * np.asarray(x_m, dtype=float) / self.wavelength_m
        inside = np.clip(sine_a**2 - np.sin(psi) ** 2, 0, None)
        pressure: Array = 2 * mean_pressure_pa * np.abs(np.cos(psi)) / sine_a**2 * np.sqrt(inside)
        return pressure


def crossed_waves_full_contact_pressure(
    amplitude_m: float, wavelength_m: float, modulus_pa: float
) -> float:
    """Mean pressure [Pa] that flattens ``amplitude cos(2 pi x/lambda) cos(2 pi y/lambda)``.

    ``p* = sqrt(2) pi E* amplitude / lambda``: the wave's wavenumber is ``sqrt(2) 2 pi / lambda``,
    and its pressure ``q E*/2`` times the height reaches from -p* to p* (Johnson, Greenwood,
    Higginson, Int. J. Mech. Sci. 27, 383 (1985)).
    The parameters are those of `WavySurface`.
    """
    wave = WavySurface(amplitude_m, wavelength_m, modulus_pa)
    return 2**0.5 * wave.full_contact_pressure_pa


def _not_negative(name: str, value: ArrayLike) -> Array:
    array = np.asarray(value, dtype=float)
    if not bool(((array >= 0) & np.isfinite(array)).all()):
        raise InputError(f"{name}: expected finite numbers of 0 or more, got {value!r}")
    return array
