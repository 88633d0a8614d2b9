"""One adhesive sphere on a half-space, solved on its radius: an oracle for boundary elements.

It shares nothing with them: no grid of pixels, no Fourier transform, no inequalities.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import pi

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

Array = NDArray[np.float64]


@dataclass(frozen=True)
class AdhesiveSphere:
    """A rigid paraboloid under an attraction that depends on the gap.

    With ``h(s) = int_s^inf r p / sqrt(r^2 - s^2) dr`` of the net pressure p, the displacement is
    ``(4 / pi E*) int_0^r h(s) / sqrt(r^2 - s^2) ds``, and h is ``(E*/2)(d - s^2/R)`` in the contact
    at an approach d. Without a singular stress at its edge h is continuous there, which gives d.
    The force is ``4 int_0^inf h ds`` (Barthel, J. Phys. D 41, 163001 (2008)).

    Parameters
    ----------
    radius_m, modulus_pa : float
        R [m] and E* [Pa].
    reach_m : float
        Distance from the axis beyond which nothing attracts [m].
    traction : callable
        Attraction [Pa] at gaps [m].
    """

    radius_m: float
    modulus_pa: float
    reach_m: float
    traction: Callable[[Array], Array]

    def force_n(self, contact_m: float) -> float:
        """Force [N] that holds the contact at a radius [m]."""
        nodes = 400
        r = contact_m + (self.reach_m - contact_m) * np.linspace(0, 1, nodes) ** 3
        root = np.sqrt(np.maximum(r[None] ** 2 - r[:, None] ** 2, 0))  # of r_j at s_i, 0 below
        angle = np.arcsin(np.minimum(r[None] / r[:, None], 1))  # of s_j at r_i, pi/2 beyond
        inside, half = angle[:, 0], self.modulus_pa / 2
        outer = np.sqrt(r**2 - contact_m**2)
        gap = (r**2 - contact_m**2) / (2 * self.radius_m)
        for _ in range(400):
            pull = self.traction(gap)
            h = -(np.diff(root, axis=1) @ ((pull[1:] + pull[:-1]) / 2))
            approach = contact_m**2 / self.radius_m + h[0] / half
            by_contact = approach * inside - (r**2 * inside - contact_m * outer) / 2 / self.radius_m
            by_gaps = np.diff(angle, axis=1) @ ((h[1:] + h[:-1]) / 2) / half
            new = r**2 / (2 * self.radius_m) - approach + 2 / pi * (by_contact + by_gaps)
            change = np.abs(new - gap).max()
            gap = np.maximum((gap + new) / 2, 0)
            if change < 1e-7 * gap.max():
                break
        else:
            raise RuntimeError(f"expected gaps that settle, and got a change of {change:g} m")
        beyond = np.sum(np.diff(r) * (h[1:] + h[:-1]) / 2)
        of_contact = approach * contact_m - contact_m**3 / (3 * self.radius_m)
        return float(4 * (half * of_contact + beyond))

    def contact_radius_m(self, force_n: float, low_m: float, high_m: float) -> float:
        """Contact radius [m] between two under a force [N]."""
        return float(brentq(lambda a: self.force_n(a) - force_n, low_m, high_m, rtol=1e-6))
