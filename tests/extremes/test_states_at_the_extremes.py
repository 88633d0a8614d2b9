"""What must hold for any contact, however far from a finger's."""

import math
from dataclasses import fields
from typing import get_args

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor

from haptix import ContactModel, ContactState, Finger, Screen, Status
from haptix.model.contact import GapDistribution, RoughnessSpectrum
from haptix.model.finger import Roughness

FLOATS = [field.name for field in fields(ContactState) if field.type == "Tensor"]
FLOATS += ["pull_past_breakdown", "capacitance_f", "conductance_s"]
PULL_IN = int(Status.PULL_IN)
SCREEN = Screen(max_voltage_v=5000.0)


def powers(low: float, high: float) -> st.SearchStrategy[float]:
    return st.floats(math.log10(low), math.log10(high)).map(lambda e: 10.0**e)


@st.composite
def models(draw: st.DrawFn) -> ContactModel:
    """E 1e3..1e12 Pa, h_rms 1e-9..1e-3 m, slope 1e-4..10, layer over bulk 1e-6..1e6 or none."""
    hurst, rolloff = draw(st.floats(0.5, 1.0)), draw(powers(1.0, 10.0))
    band = draw(powers(1e2, 1e6))
    # h_rms 1 m from 1 /m on: its slope says where the wanted slope needs q0.
    unit = RoughnessSpectrum.self_affine(1.0, hurst, 1.0, rolloff, band)
    h_rms = draw(powers(1e-9, 1e-3))
    q0 = draw(powers(1e-4, 10.0)) / h_rms / float(unit.slope_rms)
    modulus, contrast = draw(powers(1e3, 1e12)), draw(st.none() | powers(1e-6, 1e6))
    finger = Finger(
        youngs_modulus_pa=modulus,
        poisson_ratio=draw(st.floats(0.2, 0.5)),
        layer_thickness_m=draw(powers(1e-5, 1e-3)),
        bulk_modulus_pa=None if contrast is None else modulus / contrast,
        roughness=Roughness(
            h_rms_m=h_rms,
            hurst=hurst,
            q0_per_m=q0,
            q_rolloff_per_m=q0 * rolloff,
            q1_per_m=q0 * band,
        ),
    )
    return ContactModel(
        finger,
        SCREEN,
        fidelity=draw(st.sampled_from(["mean-field", "mean-field", "closed-form"])),
        contact_spots=draw(st.sampled_from(["excluded", "included"])),
        gap_distribution=draw(st.sampled_from(get_args(GapDistribution))),
        gamma=draw(st.floats(0.3, 0.6)),
        terms={"breakdown": True},
    )


forces = powers(1e-4, 1e2)
volts = st.lists(powers(1e-1, 5e3), min_size=4, max_size=4, unique=True).map(sorted)
frequencies = st.none() | powers(1e-2, 1e7)
thicknesses = st.lists(powers(1e-10, 1e-3), min_size=3, max_size=3, unique=True).map(sorted)


def tensor(values: list[float]) -> Tensor:
    return torch.tensor(values, dtype=torch.float64)


@pytest.mark.slow
@settings(max_examples=25, deadline=None)
@given(models(), forces, volts, frequencies, thicknesses)
def test_every_field_is_a_number_of_its_own_sign(
    model: ContactModel,
    force: float,
    voltages: list[float],
    frequency: float | None,
    h0: list[float],
) -> None:
    state = model.solve(force, tensor([0.0, *voltages])[:, None], frequency, tensor(h0))
    for name in FLOATS:
        value = getattr(state, name)
        assert bool(value.isfinite().all()), name
        assert bool((value >= 0).all()), name
    assert bool((state.area_fraction <= 1).all() and (state.area_fraction > 0).all())
    assert bool((state.mu > 0).all() and (state.pressure_pa > 0).all())
    # V0 = 0 is the load alone, exactly, whatever the insulator.
    applied = force / float(model.finger.apparent_area_m2(tensor([force])))
    off = model.solver.fidelity.contact.area_fraction(tensor([applied]))
    if model.fidelity == "mean-field":
        assert state.area_fraction[0].tolist() == pytest.approx([float(off)] * 3, rel=1e-14)
    assert state.mu[0].tolist() == [float(state.mu[0, 0])] * 3
    assert state.attraction_pa[0].tolist() == [0.0] * 3
    # Along the branch mu rises with the voltage and falls with h0; rounding only is forgiven.
    light = state.status != PULL_IN
    rise = state.mu.diff(dim=0) / state.mu[1:]
    assert bool((rise[light[1:] & light[:-1]] >= -1e-12).all())
    fall = state.mu.diff(dim=1) / state.mu[:, 1:]
    assert bool((fall[light[:, 1:] & light[:, :-1]] <= 1e-12).all())


def a_batch_equals_its_states_one_by_one(
    model: ContactModel, force: float, voltages: list[float], h0: list[float]
) -> None:
    batch = model.solve(force, tensor(voltages)[:, None], None, tensor(h0))
    for i, j in ((0, 2), (3, 0), (2, 1)):
        alone = model.solve(force, voltages[i], None, h0[j])
        for name in FLOATS:
            # The same table; sums may be ordered otherwise, and near the end of the branch
            # rounding is multiplied by up to thirty.
            assert float(getattr(alone, name)) == pytest.approx(
                float(getattr(batch, name)[i, j]), rel=1e-12, abs=1e-300
            ), name


def an_insulator_without_end_leaves_no_attraction(
    model: ContactModel, force: float, voltages: list[float]
) -> None:
    off = float(model.solve(force, 0.0).mu)
    on = model.solve(force, tensor(voltages), None, 1e9)
    # eps0 V^2/(4 h0^2) is at most 6e-23 Pa, of a load of 0.1 Pa or more.
    assert on.mu.tolist() == pytest.approx([off] * 4, rel=1e-13)
    assert on.status.tolist() == [int(model.solve(force, 0.0).status)] * 4


def a_heavy_load_closes_the_contact(model: ContactModel, h0: float) -> None:
    # A/A0 = erf(p/tau), and erf(6) is 1 in double precision. F/A0 = 7 tau with A0 = a F^m.
    finger = model.finger
    heavy = 7.0 * float(model.contact.stress_rms_pa) * finger.apparent_area_at_1n_m2
    force = max(1e-9, heavy ** (1 / (1 - finger.apparent_area_exponent)))
    if force > 1e6:
        return  # more than is solved
    state = model.solve(force, 0.0, None, h0)
    assert float(state.area_fraction) == 1.0
    if model.fidelity == "mean-field":
        assert float(state.mean_gap_m) < 1e-15 * float(model.contact.spectrum.h_rms_m)


def the_status_changes_at_the_pull_in_voltage(
    model: ContactModel, force: float, h0: float, share: float
) -> None:
    end = float(model.solve(force, 0.0, None, h0).pull_in_voltage_v)
    if not 0.1 < end < 4000.0:
        return
    state = model.solve(force, end * tensor([share, 1 - 1e-9, 1 + 1e-9, 1.2]), None, h0)
    assert [s == PULL_IN for s in state.status.tolist()] == [False, False, True, True]
    for name in FLOATS:
        assert bool(getattr(state, name).isfinite().all()), name
    assert float(state.mu[0]) <= float(state.mu[1]) <= float(state.mu[2]) * (1 + 1e-9)


@settings(max_examples=5, deadline=None)
@given(models(), forces, volts, thicknesses, powers(1e-10, 1e-3), st.floats(0.5, 1 - 1e-9))
def test_the_ends_of_any_contact(
    model: ContactModel,
    force: float,
    voltages: list[float],
    thicknesses: list[float],
    h0: float,
    share: float,
) -> None:
    # One test, since the tables of a model take most of its time.
    a_batch_equals_its_states_one_by_one(model, force, voltages, thicknesses)
    an_insulator_without_end_leaves_no_attraction(model, force, voltages)
    a_heavy_load_closes_the_contact(model, h0)
    the_status_changes_at_the_pull_in_voltage(model, force, h0, share)


@pytest.mark.slow
@settings(max_examples=8, deadline=None)
@given(models(), forces, volts, thicknesses)
def test_single_precision_is_one_rounding_away(
    model: ContactModel, force: float, voltages: list[float], h0: list[float]
) -> None:
    inputs = (force, tensor(voltages)[:, None], None, tensor(h0))
    double = model.solve(*inputs)
    model.dtype = torch.float32  # of the results alone; the tables are those of before
    single = model.solve(*inputs)
    for name in FLOATS:
        narrow, wide = getattr(single, name), getattr(double, name)
        assert narrow.dtype == torch.float32
        # One rounding: 2^-24. Below 1e-37 a float32 has fewer digits or none.
        torch.testing.assert_close(narrow.double(), wide, rtol=6e-8, atol=1e-37)
    assert bool((single.status == double.status).all())


def test_complete_contact_in_closed_form_has_a_finite_pull_in_voltage() -> None:
    # A smooth soft skin: at the closed form's own reference load every gap is closed.
    rough = Roughness(h_rms_m=1e-8, q0_per_m=1e4, q_rolloff_per_m=1e4, q1_per_m=1e6)
    finger = Finger(youngs_modulus_pa=1e3, roughness=rough)
    for fidelity in ("mean-field", "closed-form"):
        state = ContactModel(finger, SCREEN, fidelity=fidelity).solve(0.5, 100.0)
        assert math.isfinite(float(state.pull_in_voltage_v)), fidelity
