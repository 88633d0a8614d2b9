"""Each term of the model: its limits, and what it must leave alone."""

import json
import math
from typing import Any

import mpmath
import pytest
import torch
from torch import Tensor

from haptix import ContactModel, Finger, InputError, Screen, Status
from haptix.model.contact.area import elastoplastic_area
from haptix.model.contact.finite_size import highest_asperity
from haptix.model.electro import drive_strength
from haptix.model.terms import TERMS

EPS0 = 8.8541878128e-12
SCREEN = Screen(max_voltage_v=5000.0)
FINGER = Finger.preset("semi-wet")


def tensor(*values: float) -> Tensor:
    return torch.tensor(values, dtype=torch.float64)


# --- finite size


@pytest.fixture(scope="module")
def finite() -> ContactModel:
    return ContactModel(FINGER, SCREEN, terms={"finite-size": True}, theory="open-gaps")


@pytest.fixture(scope="module")
def infinite() -> ContactModel:
    return ContactModel(FINGER, SCREEN, theory="open-gaps")


def test_the_mean_gap_never_exceeds_the_highest_asperity(finite: ContactModel) -> None:
    force, voltage = torch.logspace(-4, 2, 7, dtype=torch.float64)[:, None], tensor(0, 80, 300)
    gap = finite.solve(force, voltage, None, 2e-7).mean_gap_m
    number = FINGER.apparent_area_m2(force) * (3992.9 / (2 * math.pi)) ** 2
    height = 22e-6 * torch.sqrt(2 * torch.log(number))
    # p_N is found in a table of its own, states in another: each is interpolated to 1e-7.
    assert bool((gap <= height * (1 + 2e-7)).all())
    # Light contacts rest on it.
    assert gap[0, 0] == pytest.approx(float(height[0]), rel=2e-7)


def test_size_does_not_matter_to_a_heavy_load(finite: ContactModel, infinite: ContactModel) -> None:
    force = tensor(3.0, 20.0, 100.0)[:, None]
    height = highest_asperity(tensor(22e-6), 3992.9, FINGER.apparent_area_m2(tensor(3.0)))
    assert float(infinite.solve(3.0, 0.0).mean_gap_m) < 0.9 * float(height)
    ours, plain = (m.solve(force, tensor(0.0, 200.0), None, 2e-7) for m in (finite, infinite))
    # The tables reach to other pressures; their nodes are the same.
    for name in ("mu", "pressure_pa", "gap_attraction_pa", "mean_gap_m", "pull_in_voltage_v"):
        torch.testing.assert_close(getattr(ours, name), getattr(plain, name), rtol=1e-11, atol=0)


def test_below_touching_the_pull_per_strength_is_constant() -> None:
    # With one apparent area for all forces the height, and with it the pull, is one number.
    model = ContactModel(
        FINGER.replace(apparent_area_exponent=0.0),
        SCREEN,
        terms={"finite-size": True},
        theory="open-gaps",
    )
    voltage = tensor(1.0, 5.0, 20.0)
    state = model.solve(tensor(1e-4, 1e-3, 1e-2)[:, None], voltage, None, 2e-7)
    resting = state.mean_gap_m == state.mean_gap_m.max()
    assert int(resting.sum()) >= 6
    pull = (state.gap_attraction_pa / drive_strength(voltage))[resting]
    assert pull.tolist() == pytest.approx([float(pull[0])] * len(pull), rel=1e-9)  # rounding


# --- plasticity


def walls(mean: float, spread: float) -> tuple[float, float]:
    """Elastic and plastic share by images in 50 digits: diffusion between two absorbing walls."""
    with mpmath.workdps(50):
        m, s = mpmath.mpf(mean), mpmath.mpf(spread)
        area = load = mpmath.mpf(0)
        for k in range(-80, 81):
            for sign, centre in ((1, 2 * k + m), (-1, 2 * k - m)):
                low, high = (-centre / (mpmath.sqrt(2) * s), (1 - centre) / (mpmath.sqrt(2) * s))
                share = (mpmath.erf(high) - mpmath.erf(low)) / 2
                peaks = mpmath.exp(-(high**2)) - mpmath.exp(-(low**2))
                area += sign * share
                load += sign * (centre * share - s / mpmath.sqrt(2 * mpmath.pi) * peaks)
        return float(area), float(m - load)


@pytest.mark.parametrize("stress", [0.05, 0.3, 0.494, 0.496, 0.8, 2.0, 5.0])
@pytest.mark.parametrize("load", [1e-4, 0.01, 0.3, 0.9, 0.9999])
def test_shares_between_two_walls(load: float, stress: float) -> None:
    found = elastoplastic_area(tensor(load), tensor(stress), 1.0)
    elastic, plastic = walls(load, stress / math.sqrt(2))
    # Rounding of sums of terms of order 1.
    assert float(found.elastic) == pytest.approx(elastic, rel=1e-10, abs=1e-15)
    assert float(found.plastic) == pytest.approx(plastic, rel=1e-10, abs=2e-15)
    assert float(found.total) == pytest.approx(elastic + plastic, rel=1e-10)


@pytest.mark.parametrize(("load", "stress"), [(1e-12, 0.2), (1e-12, 0.45), (1e-9, 0.3)])
def test_shares_of_very_light_loads(load: float, stress: float) -> None:
    found = elastoplastic_area(tensor(load), tensor(stress), 1.0)
    assert float(found.total) == pytest.approx(sum(walls(load, stress / 2**0.5)), rel=1e-9, abs=0)


def test_limits_of_hardness() -> None:
    load, stress = tensor(1e3, 3e4, 1e6), tensor(1e6)
    unyielding = elastoplastic_area(load, stress, 1e14)
    # erf(p/tau) and nothing yields; the images' rounding is 1e-16 of 1 against p/tau of 1e-3.
    assert unyielding.elastic.tolist() == pytest.approx(torch.erf(load / 1e6).tolist(), rel=1e-9)
    assert unyielding.plastic.tolist() == [0.0] * 3
    soft = elastoplastic_area(load, stress, tensor(1e5))
    # Nothing elastic is left of exp(-pi^2 (tau/sigma_Y)^2/4) = 1e-107: all spots carry sigma_Y.
    assert soft.elastic[:2].tolist() == pytest.approx([0.0, 0.0], abs=1e-15)
    assert soft.total[:2].tolist() == pytest.approx([1e-2, 0.3], rel=1e-14)
    for hardness in (1e6, 0.5e6, 1e3):  # p at or beyond it
        beyond = elastoplastic_area(load[2:], stress, hardness)
        assert float(beyond.plastic) == pytest.approx(1.0, abs=1e-12)
        assert float(beyond.total) == pytest.approx(1.0, abs=1e-12)


def test_unyielding_skin_is_elastic_skin() -> None:
    force, voltage = tensor(0.1, 1.0)[:, None], tensor(0.0, 150.0)
    hard = ContactModel(FINGER.replace(hardness_pa=1e13), SCREEN).solve(force, voltage)
    elastic = ContactModel(FINGER, SCREEN).solve(force, voltage)
    # erf by images of order 1 against A/A0 of 1e-3.
    torch.testing.assert_close(hard.mu, elastic.mu, rtol=1e-9, atol=0)


def test_balance_with_spots_where_all_yields() -> None:
    finger = Finger(hardness_pa=1e5)
    model = ContactModel(finger, SCREEN, contact_spots="included")
    end = float(model.solve(0.5, 0.0, None, 2e-7).pull_in_voltage_v)
    state = model.solve(0.5, end * torch.linspace(0, 0.999, 300, dtype=torch.float64), None, 2e-7)
    assert float(state.pressure_pa.max()) > 1e5
    applied = 0.5 / float(finger.apparent_area_m2(tensor(0.5)))
    balance = applied + state.attraction_pa
    # Newton's steps end at 1e-14 of p; the last one is multiplied by up to 1/stiffness.
    torch.testing.assert_close(balance, state.pressure_pa, rtol=1e-10, atol=0)


# --- leaky gap


def leaky(resistivity: float | None) -> ContactModel:
    screen = Screen(max_voltage_v=5000.0, gap_resistivity_ohm_m=resistivity)
    return ContactModel(FINGER, screen)


def test_a_leaking_gap_multiplies_the_insulators() -> None:
    frequency, rho = tensor(10.0, 1e3, 1e5), 1e6
    found = leaky(rho).solver.terms.thickness(tensor(1.25e-7), frequency)
    dry = leaky(None).solver.terms.thickness(tensor(1.25e-7), frequency)
    for i in range(3):
        factor = 1 + 1j / (2 * math.pi * float(frequency[i]) * EPS0 * rho)
        assert complex(found[i]) == pytest.approx(complex(dry[i]) * factor, rel=1e-14, abs=0)


def test_low_frequencies_leak_away() -> None:
    # |eps_g| is 1.8e9 at 0.01 Hz and 1e3 Ohm m: h0 becomes hundreds of metres.
    state = leaky(1e3).solve(0.5, 200.0, 1e-2)
    off = leaky(1e3).solve(0.5, 0.0, 1e-2)
    assert float(state.mu) == pytest.approx(float(off.mu), rel=1e-12)
    # At 1e7 Hz and 1e7 Ohm m it is 1 + 1.8e-4 i: the square of that.
    fast, dry = (leaky(rho).solve(0.5, 200.0, 1e7) for rho in (1e7, None))
    assert float(fast.mu) == pytest.approx(float(dry.mu), rel=1e-6)
    assert float(fast.mu) > 1.05 * float(off.mu)


def test_an_insulating_gap_changes_nothing() -> None:
    state, dry = (leaky(rho).solve(0.5, tensor(0, 200.0), 125.0) for rho in (1e30, None))
    assert state.mu.tolist() == pytest.approx(dry.mu.tolist(), rel=1e-14)


# --- breakdown


@pytest.mark.parametrize(
    ("voltage", "h0", "insulator", "broken"),
    [
        # Narrow gaps bear 350 V/um: 100 V over 0.2857 um.
        (100.0, 0.2858e-6, {}, False),
        (100.0, 0.2856e-6, {}, True),
        # Paschen: at 10 um of insulator 327 V fall over 7.5 um of gap for 327 * 17.5/7.5 = 763 V.
        (762.9, 10e-6, {}, False),
        (763.1, 10e-6, {}, True),
        # The insulator: 100 V/um in the gap is 50 V/um in eps1 = 2.
        (100.0, 1e-6, {"insulator_permittivity": 2.0, "insulator_strength_v_per_m": 51e6}, False),
        (100.0, 1e-6, {"insulator_permittivity": 2.0, "insulator_strength_v_per_m": 49e6}, True),
    ],
)
def test_breakdown_by_hand(
    voltage: float, h0: float, insulator: dict[str, float], broken: bool
) -> None:
    stiff = FINGER.replace(youngs_modulus_pa=1e9)  # so that it does not snap in first
    screen = Screen(max_voltage_v=5000.0, **insulator)
    told = ContactModel(stiff, screen, terms={"breakdown": True}).solve(2.0, voltage, None, h0)
    silent = ContactModel(stiff, screen).solve(2.0, voltage, None, h0)
    # So stiff a skin bears more in its spots than skin does, whatever the voltage.
    assert int(told.status) == int(Status.BREAKDOWN if broken else Status.PRESSURE)
    assert int(silent.status) == int(Status.PRESSURE)
    assert float(told.mu) == float(silent.mu)  # reported, nothing hidden or changed
    assert float(told.peak_field_v_per_m) == pytest.approx(voltage / h0, rel=1e-15)
    # A sine is a sine: with its frequency unlimited by the skin, the instant of its peak tells.
    period = ContactModel(stiff, screen, terms={"breakdown": True, "skin-dielectric": False})
    instants = period.over_period(2.0, voltage, 125.0, h0_m=h0, samples=16).status
    assert (int(instants[0]) == int(Status.BREAKDOWN)) == broken
    assert int(instants[4]) != int(Status.BREAKDOWN)  # no voltage at a quarter


def test_breakdown_voltage_is_where_the_status_turns() -> None:
    stiff = FINGER.replace(youngs_modulus_pa=1e9)
    model = ContactModel(stiff, SCREEN, terms={"breakdown": True})
    h0 = torch.logspace(-8, -5.5, 6, dtype=torch.float64)
    for frequency in (None, 125.0, 1e4):
        limit = model.solve(2.0, 0.0, frequency, h0).breakdown_voltage_v
        voltage = limit[:, None] * tensor(1 - 1e-9, 1 + 1e-9)
        status = model.solve(2.0, voltage, frequency, h0[:, None]).status
        assert (status == int(Status.BREAKDOWN)).tolist() == [[False, True]] * len(h0)


# --- switching


def test_layers_off_is_a_half_space() -> None:
    switched = ContactModel(FINGER, SCREEN, terms={"layered-skin": False})
    half_space = ContactModel(FINGER.replace(bulk_modulus_pa=None), SCREEN)
    a, b = (m.solve(tensor(0.1, 1.0), 150.0) for m in (switched, half_space))
    assert a.mu.tolist() == b.mu.tolist()
    assert float(ContactModel(FINGER, SCREEN).solve(0.1, 150.0).mu) != float(a.mu[0])


def test_apparent_area_off_is_that_of_one_newton() -> None:
    switched = ContactModel(FINGER, SCREEN, terms={"apparent-area": False})
    constant = ContactModel(FINGER.replace(apparent_area_exponent=0.0), SCREEN)
    a, b = (m.solve(tensor(0.05, 0.5, 1.0), 100.0) for m in (switched, constant))
    assert a.mu.tolist() == pytest.approx(b.mu.tolist(), rel=1e-14)
    assert float(a.mu[2]) == pytest.approx(
        float(ContactModel(FINGER, SCREEN).solve(1.0, 100.0).mu), rel=1e-12
    )


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({"terms": {"adhesion"}}, "unknown 'adhesion'.*layered-skin.*breakdown"),
        ({"terms": {"adhesion": False}}, "unknown 'adhesion'"),
        ({"terms": "finite-size"}, "set of names"),
        ({"terms": {"plasticity": True}}, '"plasticity" needs finger.hardness_pa'),
        ({"terms": {"leaky-gap"}}, '"leaky-gap" needs screen.gap_resistivity_ohm_m'),
        (
            {"terms": {"finite-size"}, "fidelity": "closed-form"},
            '"finite-size" contradicts fidelity "closed-form"',
        ),
    ],
)
def test_what_contradicts_is_named(options: dict[str, Any], sentence: str) -> None:
    with pytest.raises(InputError, match=sentence):
        ContactModel(FINGER, SCREEN, **options)


def test_more_contradictions() -> None:
    with pytest.raises(InputError, match=r'"layered-skin" needs finger.bulk_modulus_pa'):
        ContactModel(FINGER.replace(bulk_modulus_pa=None), SCREEN, terms={"layered-skin"})
    hard = FINGER.replace(hardness_pa=5e7)
    with pytest.raises(InputError, match='"plasticity" contradicts'):
        ContactModel(hard, SCREEN, terms={"plasticity": True}, fidelity="closed-form")
    with pytest.raises(InputError, match=r'frequency_hz.*"leaky-gap"'):
        leaky(1e6).solve(0.5, 100.0)


@pytest.mark.parametrize("name", TERMS)
def test_describe_lists_every_term(name: str) -> None:
    finger = FINGER.replace(hardness_pa=5e7)
    screen = Screen(gap_resistivity_ohm_m=1e6)
    for is_on in (True, False):
        model = ContactModel(finger, screen, terms={name: is_on})
        told = json.loads(json.dumps(model.describe(), allow_nan=False))
        assert set(told["terms"]) == set(TERMS)
        assert told["terms"][name]["on"] is is_on
        assert told["terms"][name]["what"] and told["terms"][name]["source"]
        assert {n for n, t in told["terms"].items() if t["on"]} == set(model.terms)


# --- closed form


def test_the_closed_form_at_light_load(infinite: ContactModel) -> None:
    closed = ContactModel(FINGER, SCREEN, fidelity="closed-form", theory="open-gaps")
    force = tensor(0.1, 0.5, 1.0)
    off, full = closed.solve(force, 0.0), infinite.solve(force, 0.0)
    # erf(y) = 2y/sqrt(pi) (1 - y^2/3): its cubic term, y = p/tau, and nothing else.
    y = full.pressure_pa / infinite.contact.stress_rms_pa
    cubic = y**2 / 3
    assert (off.mu / full.mu - 1 - cubic).abs().max() < 1e-3 * float(y.max() ** 2)
    # The light branch ends at 31 p0, where (V/Vc)^2 = 30/31.
    critical = float(closed.solve(0.5, 0.0, None, 2e-7).pull_in_voltage_v) * (31 / 30) ** 0.5
    voltage = critical * tensor(0.1, 0.3, 0.5)
    simple, full = (m.solve(0.5, voltage, None, 2e-7) for m in (closed, infinite))
    expected = float(off.mu[1]) / (1 - (voltage / critical) ** 2)
    assert simple.mu.tolist() == pytest.approx(expected.tolist(), rel=1e-12)
    # Lambda falls by a tenth or so per doubling of p; it rises by a third at Vc/2.
    assert simple.mu.tolist() == pytest.approx(full.mu.tolist(), rel=0.02)
