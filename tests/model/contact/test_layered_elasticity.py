"""The layered half-space: published values, limits, and no lost digits."""

import math

import mpmath
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from haptix.base.errors import InputError
from haptix.model.contact import HalfSpace, Layered


def response(x: float, e0: float, nu0: float, e1: float, nu1: float) -> float:
    solid = Layered(e0, nu0, 1.0, e1, nu1)
    return float(solid.surface_response(torch.tensor(x, dtype=torch.float64)))


def exact_response(x: float, e0: float, nu0: float, e1: float, nu1: float) -> float:
    """The page's formula as it stands, with digits enough for its own cancellation."""
    with mpmath.workdps(140):  # x^4 at x = 1e-12 costs 48 of them, each contrast of 1e6 six more
        x, e0, nu0, e1, nu1 = (mpmath.mpf(v) for v in (x, e0, nu0, e1, nu1))
        k = e0 / (1 + nu0) / (e1 / (1 + nu1))
        m = (k - 1) / (k + 3 - 4 * nu0)
        n = 1 - 4 * (1 - nu0) / (1 + k * (3 - 4 * nu1))
        e = mpmath.exp(-2 * x)
        above = 1 + 4 * m * x * e - m * n * e**2
        return float(above / (1 - (m + n + 4 * m * x**2) * e + m * n * e**2))


# Physics page, section 3; checked there against a direct two-layer elasticity solution.
PRINTED = [
    (0.1, 4000.0, 0.5, 1.0, 0.5, 2398.35, 5e-3),
    # Its last printed digit is off: the page's own formula and the solution below give 49.82943.
    (0.5, 4000.0, 0.5, 1.0, 0.5, 49.8297, 3e-4),
    (1.0, 4000.0, 0.5, 1.0, 0.5, 7.36737, 5e-6),
    (2.0, 4000.0, 0.5, 1.0, 0.5, 1.70853, 5e-6),
    (0.1, 10 * 1.3, 0.3, 1.45, 0.45, 7.762842, 5e-7),
    (1.0, 10 * 1.3, 0.3, 1.45, 0.45, 3.607026, 5e-7),
    (2.0, 10 * 1.3, 0.3, 1.45, 0.45, 1.485347, 5e-7),
]


@pytest.mark.parametrize(("x", "e0", "nu0", "e1", "nu1", "expected", "digit"), PRINTED)
def test_printed_values(
    x: float, e0: float, nu0: float, e1: float, nu1: float, expected: float, digit: float
) -> None:
    assert response(x, e0, nu0, e1, nu1) == pytest.approx(expected, abs=digit, rel=0)


def solved_response(x: float, e0: float, nu0: float, e1: float, nu1: float) -> float:
    """S from two-layer plane-strain elasticity: Airy functions matched at the bond, x = q d.

    With phi(z) cos(x), q = 1: s_zz = -phi, s_xz = phi' sin, U_x = [(1-nu) phi'' + nu phi]/2mu and
    U_z = U_x' - phi'/mu. The bulk keeps only what decays downwards.
    """
    with mpmath.workdps(80):
        x, e0, nu0, e1, nu1 = (mpmath.mpf(v) for v in (x, e0, nu0, e1, nu1))

        def fields(sign: int, power: int, z: mpmath.mpf, e: mpmath.mpf, nu: mpmath.mpf) -> list:
            """s_zz, s_xz, U_x and U_z of phi = z^power exp(sign z)."""
            mu = e / (2 * (1 + nu))

            def phi(order: int) -> mpmath.mpf:  # (z f)^(n) = z f^(n) + n f^(n-1)
                rest = order * sign ** (order - 1) if power and order else 0
                return mpmath.exp(sign * z) * ((z if power else 1) * sign**order + rest)

            across = ((1 - nu) * phi(2) + nu * phi(0)) / (2 * mu)
            slope = ((1 - nu) * phi(3) + nu * phi(1)) / (2 * mu)
            return [-phi(0), phi(1), across, slope - phi(1) / mu]

        modes = [(1, 0), (1, 1), (-1, 0), (-1, 1)]  # z runs from the surface down
        top = [fields(*mode, mpmath.mpf(0), e0, nu0) for mode in modes]
        bond = [fields(*mode, x, e0, nu0) for mode in modes]
        below = [fields(*mode, x, e1, nu1) for mode in modes[2:]]
        system = mpmath.zeros(6, 6)
        for j in range(4):
            system[0, j], system[1, j] = top[j][0], top[j][1]
            for i in range(4):
                system[2 + i, j] = bond[j][i]
                if j < 2:
                    system[2 + i, 4 + j] = -below[j][i]
        amplitudes = mpmath.lu_solve(system, mpmath.matrix([1, 0, 0, 0, 0, 0]))
        sink = sum(amplitudes[j] * top[j][3] for j in range(4))
        return float(abs(sink) * e0 / (1 - nu0**2) / 2)  # of 2 p / (E* q) for a half-space


@pytest.mark.parametrize("x", [0.05, 0.5, 1.0, 3.0])
@pytest.mark.parametrize(
    ("e0", "nu0", "e1", "nu1"),
    [(4000.0, 0.5, 1.0, 0.5), (13.0, 0.3, 1.45, 0.45), (1.0, 0.2, 50.0, 0.4), (1.0, 0.3, 1.0, 0.3)],
)
def test_elasticity_solved_for_two_layers(
    x: float, e0: float, nu0: float, e1: float, nu1: float
) -> None:
    # 80 digits there, some tens of roundings here.
    assert response(x, e0, nu0, e1, nu1) == pytest.approx(
        solved_response(x, e0, nu0, e1, nu1), rel=1e-12
    )


@settings(max_examples=300, deadline=None)
@given(
    x=st.floats(-12, math.log10(50)).map(lambda e: 10**e),
    ratio=st.floats(-6, 6).map(lambda e: 10**e),
    nu0=st.floats(0.0, 0.5),
    nu1=st.floats(0.0, 0.5),
)
def test_no_digits_are_lost(x: float, ratio: float, nu0: float, nu1: float) -> None:
    expected = exact_response(x, ratio, nu0, 1.0, nu1)
    # Some tens of roundings; the naive form is off by 1e-16/x^4.
    assert response(x, ratio, nu0, 1.0, nu1) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("x", [1e-12, 1e-6, 0.1, 0.49999999, 0.5, 0.50000001, 3.0, 50.0])
@pytest.mark.parametrize("ratio", [1.0, 1 + 1e-9])
def test_one_material_is_a_half_space(x: float, ratio: float) -> None:
    # S differs from 1 by no more than the materials do.
    assert response(x, ratio, 0.4, 1.0, 0.4) == pytest.approx(1.0, rel=4 * (ratio - 1) + 1e-14)


@pytest.mark.parametrize("ratio", [1e-6, 1e-3, 1.0, 1e3, 1e6])
@pytest.mark.parametrize(("nu0", "nu1"), [(0.5, 0.5), (0.3, 0.45), (0.0, 0.2)])
def test_long_waves_feel_the_bulk_alone(ratio: float, nu0: float, nu1: float) -> None:
    bulk_over_layer = ratio / (1 - nu0**2) * (1 - nu1**2)
    x = 1e-12
    # The layer's own share of the compliance is of the order of x times the contrast.
    tolerance = 10 * x * max(ratio, 1 / ratio) + 1e-12
    assert response(x, ratio, nu0, 1.0, nu1) == pytest.approx(bulk_over_layer, rel=tolerance)


@pytest.mark.parametrize("ratio", [1e-6, 1.0, 1e6])
@pytest.mark.parametrize("x", [20.0, 50.0, 1e3, 1e6])
def test_short_waves_feel_the_layer_alone(ratio: float, x: float) -> None:
    # What reaches the bulk falls as x^2 exp(-2 x).
    assert response(x, ratio, 0.5, 1.0, 0.5) == pytest.approx(
        1.0, rel=10 * x**2 * math.exp(-2 * x) + 1e-14
    )


@settings(max_examples=50, deadline=None)
@given(st.floats(0.01, 100), st.floats(1.0001, 1e6))
def test_a_stiff_layer_stiffens_and_a_soft_one_softens(x: float, ratio: float) -> None:
    rounding = 1 + 1e-12
    assert 1 / rounding <= response(x, ratio, 0.5, 1.0, 0.5) <= ratio * rounding
    assert 1 / rounding <= response(x, 1.0, 0.5, ratio, 0.5) * ratio <= ratio * rounding


def test_effective_modulus_of_the_skin() -> None:
    skin = Layered(40e6, 0.5, 200e-6, 10e3, 0.5)
    q = torch.tensor([0.5 / 200e-6, 2 / 200e-6], dtype=torch.float64)
    expected = [40e6 / 0.75 / 49.8294, 40e6 / 0.75 / 1.70853]
    # Six digits.
    assert skin.effective_modulus(q).tolist() == pytest.approx(expected, rel=4e-6)


def test_effective_modulus_of_a_half_space() -> None:
    q = torch.tensor([1.0, 1e9], dtype=torch.float64)
    modulus = HalfSpace(9.1e8, 0.3).effective_modulus(q)
    assert modulus.tolist() == pytest.approx([1e9, 1e9], rel=1e-15)  # 0.91 / (1 - 0.09) = 1


@pytest.mark.parametrize("bad", [0.0, -1.0, math.nan, math.inf])
def test_impossible_moduli_and_thicknesses(bad: float) -> None:
    with pytest.raises(InputError, match="youngs_modulus_pa"):
        HalfSpace(bad)
    with pytest.raises(InputError, match="layer_modulus_pa"):
        Layered(bad, 0.5, 1e-4, 1e4, 0.5)
    with pytest.raises(InputError, match="thickness_m"):
        Layered(1e6, 0.5, bad, 1e4, 0.5)
    with pytest.raises(InputError, match="bulk_modulus_pa"):
        Layered(1e6, 0.5, 1e-4, bad, 0.5)


@pytest.mark.parametrize("bad", [-1.0, 0.5000001, math.nan, math.inf])
def test_impossible_poisson_ratios(bad: float) -> None:
    with pytest.raises(InputError, match="poisson_ratio"):
        HalfSpace(1e6, bad)
    with pytest.raises(InputError, match="layer_poisson_ratio"):
        Layered(1e6, bad, 1e-4, 1e4, 0.5)
    with pytest.raises(InputError, match="bulk_poisson_ratio"):
        Layered(1e6, 0.5, 1e-4, 1e4, bad)
