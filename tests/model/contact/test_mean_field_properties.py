"""What must hold for every rough contact."""

import math
from itertools import pairwise
from typing import get_args

import mpmath
import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import special
from scipy.integrate import quad

from haptix.base.errors import InputError
from haptix.model.contact import (
    THEORIES,
    AreaLaw,
    GapDistribution,
    HalfSpace,
    Layered,
    MeanField,
    RoughnessSpectrum,
)
from haptix.model.contact.elasticity import ElasticSolid
from haptix.model.contact.persson import folded_shares
from haptix.model.contact.tables import SeparationIntegral


def tenth_powers(low: float, high: float) -> st.SearchStrategy[float]:
    return st.floats(low, high).map(lambda e: 10.0**e)


LOADS = tenth_powers(-5, 0.3)  # p over tau, from a few spots to nearly full contact
THICKNESSES = tenth_powers(-3, 1)  # h0 over h_rms


OTHER_GAPS = [pytest.param(name, marks=pytest.mark.slow) for name in ("plain", "combined")]


@pytest.fixture(scope="module", params=[*OTHER_GAPS, "mean-conserving"])
def skin(request: pytest.FixtureRequest) -> MeanField:
    return MeanField(
        RoughnessSpectrum.self_affine(22e-6, 0.86, 1e3, 3992.9, 1e9),
        Layered(40e6, 0.5, 200e-6, 10e3, 0.5),
        gap_distribution=request.param,
    )


@pytest.fixture(scope="module")
def solid() -> MeanField:
    return MeanField(RoughnessSpectrum.self_affine(2e-6, 0.8, 1e4, 5e4, 1e8), HalfSpace(40e6, 0.5))


@settings(max_examples=10, deadline=None)
@given(load=LOADS, more=st.floats(1.001, 10.0))
def test_more_pressure_more_area_less_gap(skin: MeanField, load: float, more: float) -> None:
    pressure = torch.tensor([load, load * more], dtype=torch.float64) * skin.stress_rms_pa
    area, gap = skin.area_fraction(pressure), skin.mean_gap(pressure)
    assert 0 < area[0] < area[1] <= 1 or area[0] == area[1] == 1
    assert gap[0] > gap[1] >= 0 or gap[0] == gap[1] == 0


@settings(max_examples=10, deadline=None)
@given(load=LOADS, h0=THICKNESSES, more=st.floats(1.001, 10.0), turn=st.floats(0.0, 1.57))
def test_a_thicker_insulator_pulls_less(
    skin: MeanField, load: float, h0: float, more: float, turn: float
) -> None:
    pressure = load * float(skin.stress_rms_pa)
    thickness = torch.tensor([h0, h0 * more], dtype=torch.complex128) * 22e-6
    thickness = thickness * complex(abs(math.cos(turn)), math.sin(turn))
    for spots in ("excluded", "included"):
        pull = skin.inverse_square_gap(pressure, thickness, spots)
        assert pull[0] > pull[1] > 0
        # No gap is less than zero: nothing pulls more than complete contact.
        assert bool((pull <= (1 + 1e-12) / thickness.abs() ** 2).all())


@settings(max_examples=4, deadline=None)
@given(
    length=tenth_powers(-3, 3),
    modulus=tenth_powers(-4, 4),
    load=tenth_powers(-4, 0),
    h0=tenth_powers(-2, 0),
    gaps=st.sampled_from(get_args(GapDistribution)),
)
def test_only_ratios_of_lengths_and_of_moduli_matter(
    length: float, modulus: float, load: float, h0: float, gaps: str
) -> None:
    def solve(x: float, e: float) -> list[float]:
        field = MeanField(
            RoughnessSpectrum.self_affine(5e-6 * x, 0.8, 1e4 / x, 4e4 / x, 1e7 / x),
            Layered(1e7 * e, 0.45, 1e-4 * x, 1e5 * e, 0.5),
            gap_distribution=gaps,
        )
        p = load * 1e6 * e
        return [
            float(field.area_fraction(p)),
            float(field.mean_gap(p)) / x,
            float(field.inverse_square_gap(p, complex(h0, h0) * 5e-6 * x, "excluded")) * x**2,
        ]

    # The same arithmetic on other numbers: rounding, grown by the differences between strips.
    assert solve(length, modulus) == pytest.approx(solve(1.0, 1.0), rel=1e-9)


@settings(max_examples=10, deadline=None)
@given(load=LOADS)
def test_gaps_and_spots_cover_the_nominal_area(solid: MeanField, load: float) -> None:
    pressure = load * float(solid.stress_rms_pa)
    covered = float(solid.gap_histogram(pressure).mass.sum() + solid.area_fraction(pressure))
    assert covered == pytest.approx(1.0, abs=1e-9)


def test_gaps_that_conserve_the_mean_have_the_mean_gap() -> None:
    rough = RoughnessSpectrum.self_affine(2e-6, 0.8, 1e4, 5e4, 5e6)
    gaps = torch.logspace(-12, -4, 4000, dtype=torch.float64)
    means = {}
    for form in ("combined", "mean-conserving"):
        field = MeanField(rough, HalfSpace(40e6, 0.5), gap_distribution=form)
        pressure = 0.03 * float(field.stress_rms_pa)
        moment = gaps**2 * field.gap_density(pressure, gaps)
        mean = torch.trapezoid(moment, gaps.log())
        means[form] = float(mean / field.mean_gap(pressure))
    # The first strips are nearly empty, and reach above this range: 2e-3 of the mean gap.
    assert means["mean-conserving"] == pytest.approx(1, abs=3e-3)
    assert means["combined"] > 1.01  # what folding adds


@settings(max_examples=10, deadline=None)
@given(load=LOADS)
def test_no_share_of_area_is_negative(skin: MeanField, load: float) -> None:
    pressure = load * float(skin.stress_rms_pa)
    mass = skin.gap_histogram(pressure).mass
    assert bool((mass >= -1e-15).all())  # differences of error functions, each right to rounding
    assert float(mass.sum() + skin.area_fraction(pressure)) <= 1 + 1e-9


@pytest.mark.parametrize("load", [pytest.param(1e-3, marks=pytest.mark.slow), 0.8])
def test_density_and_histogram_are_one_distribution(skin: MeanField, load: float) -> None:
    pressure = load * float(skin.stress_rms_pa)
    histogram = skin.gap_histogram(pressure)
    edges, mass = histogram.edges_m, histogram.mass
    for first, last in ((1, 120), (120, 220), (220, 300), (300, 399)):
        u = torch.exp(
            torch.linspace(math.log(edges[first]), math.log(edges[last]), 4001, dtype=torch.float64)
        )
        integral = float(torch.trapezoid(skin.gap_density(pressure, u) * u, torch.log(u)))
        expected = float(mass[first:last].sum())
        # The trapezoidal rule on steps of 2e-3 in ln u; the shares themselves are within rounding.
        assert integral == pytest.approx(expected, rel=1e-5, abs=1e-13)


@settings(max_examples=3, deadline=None)
@given(st.lists(LOADS, min_size=2, max_size=4), THICKNESSES)
def test_a_batch_equals_its_members_one_by_one(
    skin: MeanField, loads: list[float], h0: float
) -> None:
    pressure = torch.tensor(loads, dtype=torch.float64) * skin.stress_rms_pa
    thickness = h0 * 22e-6
    batch = [
        skin.area_fraction(pressure),
        skin.mean_gap(pressure),
        skin.inverse_square_gap(pressure, thickness),
        skin.gap_density(pressure, thickness),
    ]
    for i, p in enumerate(pressure.tolist()):
        alone = [
            skin.area_fraction(p),
            skin.mean_gap(p),
            skin.inverse_square_gap(p, thickness),
            skin.gap_density(p, thickness),
        ]
        # The same operations; the sums may be ordered otherwise.
        assert [float(value[i]) for value in batch] == pytest.approx(
            [float(value) for value in alone], rel=1e-12
        )


@settings(max_examples=5, deadline=None)
@given(load=LOADS, h0=THICKNESSES, spots=st.sampled_from(["excluded", "included"]))
def test_a_complex_h0_on_the_real_axis_is_a_real_one(
    skin: MeanField, load: float, h0: float, spots: str
) -> None:
    pressure, thickness = load * float(skin.stress_rms_pa), h0 * 22e-6
    real = float(skin.inverse_square_gap(pressure, thickness, spots))
    assert float(skin.inverse_square_gap(pressure, complex(thickness, 0.0), spots)) == (
        pytest.approx(real, rel=1e-13)  # rounding
    )
    # Leaving the axis by 1e-7 of h0 changes I by the square of that, whichever way.
    for side in (1, -1):
        near = complex(thickness, side * 1e-7 * thickness)
        value = float(skin.inverse_square_gap(pressure, near, spots))
        assert value == pytest.approx(real, rel=1e-12)


def test_shares_of_gaps_are_sums_of_error_functions() -> None:
    """Of strips from narrow to wide, near and far, a closed one among them, in 40 digits."""
    edges = torch.logspace(-15, 2, 120, dtype=torch.float64)
    scale = torch.logspace(-1, 12, 40, dtype=torch.float64).expand(2, -1)
    centre = torch.stack([torch.linspace(20, 0, 40), torch.linspace(0, 1e20, 40)]).double()
    weight = torch.linspace(0, 1, 40, dtype=torch.float64).expand(2, -1)
    found = folded_shares(edges, weight, centre, scale)
    with mpmath.workdps(40):
        for row, column in ((0, 0), (0, 40), (0, 80), (1, 10), (1, 60), (1, 119)):
            e = mpmath.mpf(float(edges[column]))
            exact = sum(
                w * (mpmath.erf(e * s - c) + mpmath.erf(e * s + c))
                for w, c, s in zip(
                    weight[row].tolist(), centre[row].tolist(), scale[row].tolist(), strict=True
                )
            )
            # The sum of 40 values, each of a few roundings.
            assert float(found[row, column]) == pytest.approx(float(exact), rel=1e-13)


def test_complete_contact(skin: MeanField) -> None:
    pressure = 10 * float(skin.stress_rms_pa)
    assert float(skin.area_fraction(pressure)) == 1.0
    assert float(skin.mean_gap(pressure)) == 0.0
    h0 = 1e-7
    # erfc(10) = 2e-45 of the area is open, at most.
    assert float(skin.inverse_square_gap(pressure, h0, "excluded")) <= 1e-12 / h0**2
    assert float(skin.inverse_square_gap(pressure, h0)) == pytest.approx(1 / h0**2, rel=1e-12)


def test_light_contact_is_proportional_to_the_load(solid: MeanField) -> None:
    # A/A0 = sqrt(8/pi) p / (E* slope); the next term is p^3, of relative order 1e-8 here.
    slope = float(solid.spectrum.slope_rms)
    modulus = 40e6 / 0.75
    pressure = 1e-4 * modulus * slope
    expected = math.sqrt(8 / math.pi) * 1e-4
    # 1e-7: erf's next term (y^2/3 with y = 1.4e-4) and the integral of tau^2.
    assert float(solid.area_fraction(pressure)) == pytest.approx(expected, rel=1e-7)


def test_light_contact_gap_grows_with_the_logarithm_of_the_load(solid: MeanField) -> None:
    # J(y) -> gamma ln(1/y): at light load a factor in p moves ubar by a constant length.
    pressure = torch.tensor([1e-7, 1e-6, 1e-5], dtype=torch.float64) * solid.stress_rms_pa
    first, second, third = solid.mean_gap(pressure).tolist()
    assert first > second > third
    # The first waves add stress only from tau ~ p on; that share falls with p.
    assert first - second == pytest.approx(second - third, rel=0.01)


@pytest.mark.parametrize("gamma", [0.2, 0.45, 1.0])
def test_separation_integral_by_quadrature(gamma: float) -> None:
    integral = SeparationIntegral(gamma)
    y = np.concatenate([np.geomspace(1e-9, 5.5, 60), [1e-6, 1.0, 5.599]])

    def integrand(t: float) -> float:
        x = math.exp(t)
        return (gamma + 3 * (1 - gamma) * special.erf(x) ** 2) * math.exp(-x * x)

    def exact(low: float) -> float:
        ends = [math.log(low), *(e for e in (-5.0, -1.0, 0.5) if e > math.log(low)), math.log(14)]
        return sum(
            quad(integrand, a, b, epsabs=0, epsrel=1e-11, limit=200)[0] for a, b in pairwise(ends)
        )

    # A cubic through exact slopes on steps of 0.008 in ln y: h^4/384 times 16 y^2 at worst.
    assert integral(torch.tensor(y)).tolist() == pytest.approx([exact(v) for v in y], rel=1e-8)


def test_separation_integral_vanishes_in_complete_contact() -> None:
    far = SeparationIntegral(0.45)(torch.tensor([5.6, 6.0, 100.0, 1e300], dtype=torch.float64))
    assert far.tolist() == [0.0] * 4


@pytest.mark.parametrize("theory", THEORIES)
@pytest.mark.parametrize("modulus", [HalfSpace(1e6), Layered(4e7, 0.5, 2e-4, 1e4, 0.5)])
def test_plain_numbers_have_the_gaps_that_carry_gradients(
    theory: str, modulus: ElasticSolid
) -> None:
    rough = RoughnessSpectrum.self_affine(1e-6, 0.8, 1e4, 3e4, 1e7)
    contact = THEORIES[theory].mean_field(rough, modulus)
    # From where J is the logarithm of 1/y to a contact that is nearly complete.
    pressure = torch.logspace(-9, 0.4, 40, dtype=torch.float64) * contact.stress_rms_pa
    recorded = pressure.clone().requires_grad_()
    gap, mass = contact.mean_gap(pressure), contact.gap_histogram(pressure).mass
    torch.testing.assert_close(gap, contact.mean_gap(recorded).detach(), rtol=1e-11, atol=0.0)
    # Differences of sums of order 1.
    of_torch = contact.gap_histogram(recorded).mass.detach()
    torch.testing.assert_close(mass, of_torch, rtol=0.0, atol=1e-12)


@pytest.mark.parametrize("bad", [0.0, -0.1, 1.01, math.nan, math.inf])
def test_impossible_gamma(bad: float) -> None:
    with pytest.raises(InputError, match="gamma"):
        MeanField(RoughnessSpectrum.self_affine(1e-6, 0.8, 1e4, 1e4, 1e7), HalfSpace(1e6), bad)


@pytest.mark.parametrize("bad", [0.0, -1.0, math.nan, math.inf, [1e4, 0.0], "high", None])
def test_impossible_pressures(solid: MeanField, bad: object) -> None:
    for ask in (
        solid.area_fraction,
        solid.mean_gap,
        solid.gap_histogram,
        lambda p: solid.inverse_square_gap(p, 1e-7),
        lambda p: solid.gap_density(p, 1e-7),
    ):
        with pytest.raises(InputError, match="pressure_pa"):
            ask(bad)


@pytest.mark.parametrize(
    "bad", [0.0, -1e-7, math.nan, math.inf, complex(-1e-7, 1e-7), complex(1e-7, math.nan), "thin"]
)
def test_impossible_insulators(solid: MeanField, bad: object) -> None:
    with pytest.raises(InputError, match="h0_m"):
        solid.inverse_square_gap(1e4, bad)


def test_unknown_choices() -> None:
    spectrum = RoughnessSpectrum.self_affine(1e-6, 0.8, 1e4, 1e4, 1e7)
    with pytest.raises(InputError, match=r'gap_distribution.*"plain", "combined".*\'new\''):
        MeanField(spectrum, HalfSpace(1e6), gap_distribution="new")
    with pytest.raises(InputError, match=r'contact_spots.*"widened".*\'all\''):
        MeanField(spectrum, HalfSpace(1e6)).inverse_square_gap(1e4, 1e-7, "all")


ROUGH = RoughnessSpectrum.self_affine(1e-6, 0.8, 1e4, 1e5, 1e7)


def _skin(theory: str = "local", modulus_pa: float | torch.Tensor = 4e7) -> MeanField:
    return THEORIES[theory].mean_field(ROUGH, HalfSpace(modulus_pa))


def test_equal_contacts_are_one_object_and_others_are_not() -> None:
    assert _skin() is _skin(modulus_pa=torch.tensor(4e7, dtype=torch.float64))
    assert _skin() is not _skin(modulus_pa=4.1e7)
    assert _skin() is not _skin("corrected")
    # A recorded modulus has a graph of its own, which no other solve may extend.
    recorded = torch.tensor(4e7, dtype=torch.float64, requires_grad=True)
    assert _skin(modulus_pa=recorded) is not _skin(modulus_pa=recorded)
    for _ in "ab":
        (slope,) = torch.autograd.grad(
            _skin(modulus_pa=recorded).lattice_mean_gap(-60, -60).sum(), recorded
        )
        assert float(slope) != 0


def test_the_lattice_has_the_same_bits_whatever_was_asked_before() -> None:
    one, other = (MeanField(ROUGH, HalfSpace(4e7), area=AreaLaw(0.48)) for _ in "ab")
    one.lattice_mass(-90, -2)
    ends = -50, -17  # they cut blocks of nodes in two
    assert torch.equal(one.lattice_mass(*ends), other.lattice_mass(*ends))
    assert torch.equal(one.lattice_mean_gap(*ends), other.lattice_mean_gap(*ends))
    pressure = torch.exp(one.log_lattice(*ends))
    # Solved as one batch, only rounding differs.
    torch.testing.assert_close(
        one.lattice_mass(*ends), one.gap_histogram(pressure).mass, rtol=1e-9, atol=1e-15
    )
    torch.testing.assert_close(
        one.lattice_mean_gap(*ends), one.mean_gap(pressure), rtol=1e-12, atol=0
    )
