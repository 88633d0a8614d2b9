"""Attraction beside one round spot: its limits, and boundary elements between them."""

from __future__ import annotations

from functools import partial
from math import acos, pi, sqrt

import numpy as np
import pytest
import torch
from scipy.optimize import brentq

from benchmarks.attracted_contacts import falling
from benchmarks.attraction_theory import MODULUS_PA, SIDE_M, shape_heights
from haptix.model.contact import HalfSpace
from haptix.model.contact.boundary_elements.bounded import BoundedProblem
from haptix.model.contact.boundary_elements.coupled import AttractedContacts
from haptix.model.contact.boundary_elements.elements import corrected_area
from tests.model.contact.adhesive_sphere import AdhesiveSphere, Array

RADIUS_M, CONTACT_M = 0.05, 1e-4
HERTZ_N = 4 * MODULUS_PA * CONTACT_M**3 / (3 * RADIUS_M)


def dugdale(gap_m: Array, traction_pa: float, reach_m: float) -> Array:
    """All of the traction up to the reach; over a fortieth of it, so that the iteration settles."""
    return traction_pa / (1 + np.exp(np.minimum(40 * (gap_m / reach_m - 1), 50.0)))


@pytest.mark.parametrize(("reach_m", "traction_pa"), [(3e-7, 4e2), (3e-8, 2e4), (1e-8, 1e5)])
def test_a_constant_traction_gives_maugis_and_dugdale(reach_m: float, traction_pa: float) -> None:
    """J. Colloid Interface Sci. 150, 243 (1992), for a zone out to m a."""

    def root(m: float) -> float:
        return sqrt(m**2 - 1)

    def opened(m: float) -> float:
        by_shape = CONTACT_M**2 / (pi * RADIUS_M) * (root(m) + (m**2 - 2) * acos(1 / m))
        pulled = 4 * traction_pa * CONTACT_M / (pi * MODULUS_PA)
        return by_shape + pulled * (root(m) * acos(1 / m) - m + 1) - reach_m

    m = float(brentq(opened, 1 + 1e-12, 1e3))
    known = HERTZ_N - 2 * traction_pa * CONTACT_M**2 * (root(m) + m**2 * acos(1 / m))
    law = partial(dugdale, traction_pa=traction_pa, reach_m=reach_m)
    sphere = AdhesiveSphere(RADIUS_M, MODULUS_PA, 3 * m * CONTACT_M, law)
    # The softened end of the zone.
    tolerance_n = 2e-3 * (HERTZ_N - known)
    assert sphere.force_n(CONTACT_M) == pytest.approx(known, abs=tolerance_n)


def test_the_limits_of_derjaguin_and_of_johnson() -> None:
    """A long weak attraction adds ``2 pi w R`` to Hertz; a short one is adhesion at the edge."""
    work_j_m2 = 1e-4 * HERTZ_N / (2 * pi * RADIUS_M)
    long = partial(dugdale, traction_pa=work_j_m2 / 4e-5, reach_m=4e-5)
    force = AdhesiveSphere(RADIUS_M, MODULUS_PA, 3e-3, long).force_n(CONTACT_M)
    # The gap beside the contact is not quite a paraboloid's: a^2/R over the reach is 0.005.
    assert HERTZ_N - force == pytest.approx(2 * pi * work_j_m2 * RADIUS_M, rel=0.01)
    short = partial(dugdale, traction_pa=4e5, reach_m=5e-9)
    johnson = sqrt(8 * pi * 4e5 * 5e-9 * MODULUS_PA * CONTACT_M**3)
    force = AdhesiveSphere(RADIUS_M, MODULUS_PA, 3e-4, short).force_n(CONTACT_M)
    # The zone takes 0.5 % of the radius.
    assert HERTZ_N - force == pytest.approx(johnson, rel=0.015)


@pytest.mark.parametrize(("relative_h0", "attraction"), [(0.3, 1.0), (0.1, 4.0), (0.03, 10.0)])
def test_boundary_elements_of_a_lattice_of_spheres(relative_h0: float, attraction: float) -> None:
    """Far apart they are single spheres, whose attraction ends where the cell ends.

    Tabor's parameters are 0.07, 0.35 and 1.2: from Derjaguin's limit half-way to Johnson's.
    """
    points, h_rms_m = 256, 1e-6
    height = shape_heights("spheres", points)[None]
    radius_m = SIDE_M**2 / (2 * sqrt(90) * h_rms_m)  # <x^4> - <x^2>^2 is side^4/180 on each axis
    p0 = torch.tensor([0.0045 * MODULUS_PA * h_rms_m / SIDE_M], dtype=torch.float64)
    h0_m = relative_h0 * h_rms_m
    problem = BoundedProblem.on_grid(HalfSpace(0.75 * MODULUS_PA, 0.5), points, SIDE_M)
    contact = AttractedContacts(problem, height, p0, partial(falling, h0_m=h0_m), 1e-5)
    spot_pa = float(contact.strength(attraction * p0))
    assert bool(contact.converged)
    work = spot_pa * h0_m

    def law(gap_m: Array) -> Array:
        return spot_pa * (h0_m / (h0_m + gap_m)) ** 2

    force = float(p0) * SIDE_M**2
    derjaguin, edge = force + 2 * pi * work * radius_m, 3 * pi * work * radius_m
    johnson = force + edge + sqrt(2 * edge * force + edge**2)
    low, high = (np.cbrt(3 * load * radius_m / 4 / MODULUS_PA) for load in (derjaguin, johnson))
    single = AdhesiveSphere(radius_m, MODULUS_PA, SIDE_M / sqrt(pi), law)
    radius = single.contact_radius_m(force, 0.95 * low, high)
    area = float(corrected_area(contact.contact.pressure_pa > 0))
    # A ring of pixels is some 10 % of the area; the correction leaves a tenth of that.
    assert area == pytest.approx(pi * radius**2 / SIDE_M**2, rel=0.01)
    assert low < 0.99 * radius  # the limits are told apart
    assert high > 1.1 * radius
