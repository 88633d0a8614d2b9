"""Evaluating and inverting: statuses, slices, and what a query must name."""

import math
import warnings
from typing import Any

import numpy as np
import pandas
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from haptix import ContactModel, ContactState, Finger, FrictionSurface, InputError, Screen, Status
from haptix.base.errors import RangeError
from haptix.model.surface.axes import Cells

OK, PULL_IN, BELOW, ABOVE, OUT = (
    int(Status[name]) for name in ("OK", "PULL_IN", "BELOW", "ABOVE", "OUT_OF_RANGE")
)


def tensor(*values: float) -> torch.Tensor:
    return torch.tensor(values, dtype=torch.float64)


@settings(max_examples=60, deadline=None)
@given(
    force=st.floats(0.3, 0.9),
    share=st.floats(0.0, 1.0),
    frequency=st.floats(60, 500),
    h0=st.floats(1e-7, 3e-7),
)
def test_friction_to_voltage_and_back(
    full: FrictionSurface, force: float, share: float, frequency: float, h0: float
) -> None:
    low, high = full.reachable(force, frequency, h0)
    wanted = low + share * (high - low)
    found = full.voltage(wanted, force, frequency, h0)
    assert int(found.status) == OK
    assert 0 <= float(found.voltage_v) <= 150.0 * (1 + 1e-12)  # rounding
    back = full.mu(force, found.voltage_v, frequency, h0)
    assert float(back) == pytest.approx(float(wanted), rel=1e-9)


@settings(max_examples=40, deadline=None)
@given(force=st.floats(0.2, 1.0), voltage=st.floats(5.0, 200.0))
def test_voltage_to_friction_and_back(plain: FrictionSurface, force: float, voltage: float) -> None:
    found = plain.voltage(plain.mu(force, voltage), force)
    assert int(found.status) == OK
    # mu - mu(0) ~ V^2: rounding of mu, 1e-16, over its rise, 1e-4 at 5 V.
    assert float(found.voltage_v) == pytest.approx(voltage, rel=1e-9)


def test_wanted_friction_out_of_reach(plain: FrictionSurface) -> None:
    low, high = plain.reachable(0.5)
    found = plain.voltage(tensor(0.0, float(low) - 1e-3, float(high) + 1e-3, 50.0), 0.5)
    assert found.status.tolist() == [BELOW, BELOW, ABOVE, ABOVE]
    assert found.voltage_v.tolist() == pytest.approx([0.0, 0.0, 200.0, 200.0], rel=1e-12)
    assert plain.voltage(torch.stack([low, high]), 0.5).status.tolist() == [OK, OK]


def test_forces_outside_the_surface(plain: FrictionSurface) -> None:
    force = tensor(0.1, 0.2, 1.0, 1.1)
    sample = plain.evaluate(force, 100.0)
    assert sample.status.tolist() == [OUT, OK, OK, OUT]
    # "Values are those at its edge."
    assert sample.mu[0] == sample.mu[1] and sample.mu[2] == sample.mu[3]
    found = plain.voltage(sample.mu, force)
    assert found.status.tolist() == [OUT, OK, OK, OUT]
    assert bool(found.voltage_v.isfinite().all())


def test_voltages_above_the_range_that_was_asked_for(full: FrictionSurface) -> None:
    sample = full.evaluate(0.5, tensor(150.0, 150.1, 1e6), 100.0, 2e-7)
    assert sample.status.tolist() == [OK, OUT, OUT]
    # Rounding: the same number in another lane of a vector.
    assert sample.mu.tolist() == pytest.approx([float(sample.mu[0])] * 3, rel=1e-14)


def test_past_pull_in_there_is_a_status_and_a_finite_value(
    hungry: ContactModel, past_pull_in: FrictionSurface
) -> None:
    force = torch.linspace(0.1, 0.5, 41, dtype=torch.float64)[:, None]
    voltage = torch.linspace(0.0, 400.0, 201, dtype=torch.float64)
    sample = past_pull_in.evaluate(force, voltage)
    truth: ContactState = hungry.solve(force, voltage, h0_m=5e-8)
    assert bool(sample.mu.isfinite().all())
    assert set(sample.status.reshape(-1).tolist()) == {OK, PULL_IN}
    solved = sample.status == OK
    # No number with the status OK where the model has no light contact,
    assert bool((truth.status[solved] == OK).all())
    # and each is the model's, within the tolerance of the build.
    assert float((sample.mu - truth.mu)[solved].abs().max()) <= 1e-2
    # Past the model's pull-in the surface says so.
    assert bool((sample.status[truth.status == PULL_IN] == PULL_IN).all())
    # The margin that it keeps is 10 %, and no more.
    kept = voltage < 0.89 * truth.pull_in_voltage_v
    assert bool((sample.status[kept] == OK).all())


def test_friction_that_only_pull_in_would_give(past_pull_in: FrictionSurface) -> None:
    _, high = past_pull_in.reachable(0.3)
    found = past_pull_in.voltage(tensor(float(high), float(high) * 1.01, 30.0), 0.3)
    assert found.status.tolist() == [OK, PULL_IN, PULL_IN]
    assert bool((found.voltage_v < 400.0).all())
    assert past_pull_in.evaluate(0.3, found.voltage_v[2]).status == OK


def test_mu_raises_where_evaluate_has_a_status(
    plain: FrictionSurface, past_pull_in: FrictionSurface
) -> None:
    with pytest.raises(RangeError, match=r"1 of 2 points.*normal_force_n 0\.2 to 1"):
        plain.mu(tensor(0.5, 1.5), 100.0)
    with pytest.raises(RangeError, match=r"1 of 1 points.*1 PULL_IN"):
        past_pull_in.mu(0.3, 399.0)
    with pytest.raises(RangeError, match="1 OUT_OF_RANGE"):
        plain.mu(0.5, 201.0)


@pytest.fixture(scope="module")
def breaking() -> FrictionSurface:
    """A surface that ends at its limit, at breakdown and at pull-in, depending on the force."""
    screen = Screen(max_voltage_v=600.0, insulator_strength_v_per_m=2e9)
    model = ContactModel(Finger.preset("semi-wet"), screen, terms={"breakdown": True})
    scene = {"normal_force_n": (0.01, 1.0), "voltage_v": (0.0, 500.0), "h0_m": (1e-7, 3e-7)}
    return FrictionSurface.build(model, scene, tolerance=2e-2)


@pytest.mark.parametrize("name", ["plain", "full", "past_pull_in", "breaking"])
def test_torch_and_the_library_give_the_same(name: str, request: pytest.FixtureRequest) -> None:
    """Where a gradient is asked for torch evaluates, else the library in C."""
    surface: FrictionSurface = request.getfixturevalue(name)
    random, count = np.random.default_rng(3), 20_000
    limit = 1.1 * surface.voltage_limit_v
    voltage = random.uniform(0, limit, count)
    voltage[:3] = 0.0, surface.voltage_limit_v, limit
    places: list[Any] = [None] * 3
    for number, axis in enumerate(surface.table.axes):
        if axis.varies:
            low, high = math.log(axis.low), math.log(axis.high)
            place = np.exp(random.uniform(low - 0.05, high + 0.05, count))
            place[3:5] = axis.low, axis.high
            places[number] = place
        elif not axis.is_absent:
            places[number] = np.where(random.uniform(size=count) < 0.9, axis.low, 1.1 * axis.low)
    compiled = surface.evaluate(places[0], voltage, *places[1:])
    followed = tensor(*voltage).requires_grad_()
    by_torch = surface.evaluate(places[0], followed, *places[1:])
    assert compiled.status.dtype == by_torch.status.dtype
    torch.testing.assert_close(compiled.status, by_torch.status, rtol=0, atol=0)
    torch.testing.assert_close(compiled.mu, by_torch.mu.detach(), rtol=1e-12, atol=0)
    by_torch.mu.sum().backward()
    assert followed.grad is not None
    assert bool(followed.grad.isfinite().all())
    assert len(set(compiled.status.tolist())) >= 2
    nowhere = [None if place is None else place[:0] for place in places]
    none = surface.evaluate(nowhere[0], voltage[:0], *nowhere[1:])
    assert none.mu.shape == none.status.shape == (0,)


def test_a_slice_is_the_same_surface(full: FrictionSurface) -> None:
    force, voltage = tensor(0.3, 0.4, 0.77, 0.9)[:, None], tensor(0.0, 31.0, 150.0)
    whole = full.evaluate(force, voltage, 137.0, 1.7e-7)
    target = (whole.mu * 1.02).clamp(max=whole.mu[:, -1:])
    inverse = full.voltage(target, force, 137.0, 1.7e-7)
    for sliced in (
        full.at(137.0, 1.7e-7),
        full.at(frequency_hz=137.0).at(h0_m=1.7e-7),
        full.at(h0_m=1.7e-7).at(frequency_hz=137.0),
    ):
        assert tuple(sliced.mu_table.shape[1:3]) == (1, 1)
        for query in ((force, voltage), (force, voltage, 137.0, 1.7e-7)):
            sample = sliced.evaluate(*query)
            # Rounding: the same weights in another order.
            torch.testing.assert_close(sample.mu, whole.mu, rtol=1e-12, atol=0)
            assert torch.equal(sample.status, whole.status)
        found = sliced.voltage(target, force)
        torch.testing.assert_close(found.voltage_v, inverse.voltage_v, rtol=1e-9, atol=1e-6)
        assert torch.equal(found.status, inverse.status)


def test_a_slice_holds_at_its_own_value_alone(full: FrictionSurface) -> None:
    sliced = full.at(frequency_hz=137.0)
    assert int(sliced.evaluate(0.5, 50.0, 138.0, 2e-7).status) == OUT
    with pytest.raises(RangeError, match=r"frequency_hz: 1000 .*60 to 500"):
        full.at(frequency_hz=1000.0)
    with pytest.raises(RangeError, match="h0_m"):
        full.at(h0_m=4e-7)


def test_an_axis_that_varies_must_be_named(full: FrictionSurface) -> None:
    with pytest.raises(InputError, match="frequency_hz"):
        full.mu(0.5, 100.0, None, 2e-7)
    with pytest.raises(InputError, match="h0_m"):
        full.voltage(0.3, 0.5, 100.0)
    with pytest.raises(InputError, match="normal_force_n"):
        full.mu(None, 100.0, 100.0, 2e-7)


def test_an_axis_that_does_not_vary_may_be_left_out(plain: FrictionSurface) -> None:
    assert float(plain.mu(0.5, 100.0)) == float(plain.mu(0.5, 100.0, None, 2e-7))
    assert int(plain.evaluate(0.5, 100.0, None, 2.1e-7).status) == OUT
    with pytest.raises(InputError, match=r"frequency_hz: .*without"):
        plain.mu(0.5, 100.0, 125.0)


BAD: dict[str, Any] = {
    "zero": 0.0,
    "negative": -0.5,
    "NaN": math.nan,
    "infinite": math.inf,
    "one of two": [0.5, math.nan],
    "text": "0.5",
}


@pytest.mark.parametrize("kind", BAD)
def test_bad_queries_are_named(full: FrictionSurface, kind: str) -> None:
    bad = BAD[kind]
    with pytest.raises(InputError, match="normal_force_n"):
        full.mu(bad, 100.0, 100.0, 2e-7)
    with pytest.raises(InputError, match="frequency_hz"):
        full.evaluate(0.5, 100.0, bad, 2e-7)
    with pytest.raises(InputError, match="h0_m"):
        full.voltage(0.3, 0.5, 100.0, bad)
    if kind != "zero":
        with pytest.raises(InputError, match="voltage_v"):
            full.mu(0.5, bad, 100.0, 2e-7)
    if kind not in ("zero", "negative"):
        with pytest.raises(InputError, match="mu"):
            full.voltage(bad, 0.5, 100.0, 2e-7)


def test_queries_that_do_not_broadcast(full: FrictionSurface) -> None:
    two, three = tensor(0.4, 0.5), tensor(50.0, 60.0, 70.0)
    with pytest.raises(InputError, match="broadcast"):
        full.evaluate(two, three, 100.0, 2e-7)
    with pytest.raises(InputError, match="broadcast"):
        full.evaluate(two, 50.0, three + 20, 2e-7)
    with pytest.raises(InputError, match="broadcast"):
        full.voltage(tensor(0.3, 0.31, 0.32), two, 100.0, 2e-7)


def test_shapes_of_answers(full: FrictionSurface) -> None:
    force = tensor(0.3, 0.5, 0.9)[:, None, None, None]
    frequency, h0 = tensor(60.0, 100.0)[:, None], tensor(1e-7, 2e-7, 2.5e-7, 3e-7)
    sample = full.evaluate(force, tensor(0.0, 50.0)[:, None, None], frequency, h0)
    assert sample.mu.shape == sample.status.shape == (3, 2, 2, 4)
    found = full.voltage(sample.mu, force, frequency, h0)
    assert found.voltage_v.shape == found.status.shape == (3, 2, 2, 4)
    assert float(full.mu(0.5, 50.0, 100.0, 2e-7)) == float(sample.mu[1, 1, 1, 1])
    # A range of one value: the force's status has the shape of the whole all the same.
    out = full.evaluate(tensor(0.1, 0.5)[:, None], tensor(0.0, 1.0, 2.0), 100.0, 2e-7)
    assert out.status.tolist() == [[OUT] * 3, [OK] * 3]


def test_the_gradient_at_the_lowest_friction_is_finite(plain: FrictionSurface) -> None:
    low, high = plain.reachable(0.5)
    wanted = torch.stack([low, (low + high) / 2]).detach().requires_grad_()
    (gradient,) = torch.autograd.grad(plain.voltage(wanted, 0.5).voltage_v.sum(), wanted)
    # V ~ sqrt(mu - mu0): its slope is infinite there, and said to be 0 as beyond the end.
    assert gradient[0] == 0.0
    assert 0 < float(gradient[1]) < math.inf


def test_what_is_no_place_to_slice_at(full: FrictionSurface) -> None:
    with pytest.raises(InputError, match=r"frequency_hz: .*one number"):
        full.at((60.0, 500.0), None)
    with pytest.raises(InputError, match=r"dtype: .*float64"):
        full.to(torch.float16)
    with pytest.raises(InputError, match=r"normal_force_n: .*real"):
        full.mu(torch.tensor(0.5 + 0.1j), 100.0, 137.0, 1.7e-7)


def test_arrays_of_any_stride(full: FrictionSurface) -> None:
    force = np.linspace(0.4, 0.8, 7)
    backwards = full.mu(force[::-1], 100.0, 137.0, 1.7e-7)
    assert torch.equal(backwards.flip(0), full.mu(force, 100.0, 137.0, 1.7e-7))


@pytest.mark.parametrize("dtype", [torch.float64, torch.float32])
@pytest.mark.parametrize("low", [-17.0, 0.0, 4.0])
@pytest.mark.parametrize("shift", [0.0, 0.3])  # of a place: off the grid of the build
def test_cells_are_those_of_bisection(low: float, shift: float, dtype: torch.dtype) -> None:
    at = torch.tensor([0, 3, 4, 20, 21.0 + shift, 90, 192], dtype=torch.float64)
    nodes = (low + 2.3 * at / 192).to(dtype)
    cells = Cells.between(nodes)
    assert (cells.steps == 0) == (shift == 0)
    x = torch.linspace(low - 1, low + 3.4, 20_001, dtype=dtype)
    far = torch.tensor([-1e12, 1e12], dtype=dtype)
    x = torch.cat([x, nodes, far])
    cell, part = cells.find(x)
    exact = np.interp(x.numpy().astype(float), nodes.numpy().astype(float), np.arange(7.0))
    # Single precision rounds x and a node near 17 by 1e-6: of the narrowest cell, 0.012, 2e-4.
    close = 1e-9 if dtype == torch.float64 else 5e-4
    np.testing.assert_allclose(cell + part, exact, rtol=0, atol=close)


@pytest.mark.parametrize("force_n", [0.05, 5.0, [0.5, 5.0]])
def test_what_returns_no_status_refuses_places_outside(
    plain: FrictionSurface, force_n: float | list[float]
) -> None:
    for ask in (plain.reachable, plain.highest_voltage):
        with pytest.raises(RangeError, match=r"1 of [12] places.*normal_force_n"):
            ask(force_n)
    assert float(plain.intervals(force_n).mu_jnd.max()) == math.inf


@pytest.mark.parametrize("voltage_v", [math.nan, -5.0, 0.0, "50"])
def test_a_limit_that_is_no_amplitude_is_refused(plain: FrictionSurface, voltage_v: Any) -> None:
    with pytest.raises(InputError, match="voltage_v"):
        plain.limited(voltage_v)


@pytest.mark.parametrize("force_n", [0.0, -1.0, "0.5", [0.5, 0.6]])
def test_a_column_is_at_one_force(plain: FrictionSurface, force_n: Any) -> None:
    with pytest.raises(InputError, match="normal_force_n"):
        plain.column(force_n, None)


def test_arrays_of_any_layout_are_numbers(plain: FrictionSurface, model: ContactModel) -> None:
    volts = np.array([0.0, 50.0, 100.0])
    table = pandas.DataFrame({"v": [0.0, 50.0, 100.0, -1.0]})
    layouts = {
        "negative strides": volts[::-1].copy()[::-1],
        "another order of bytes": volts.astype(">f8"),
        "not writable": np.broadcast_to(volts, (2, 3))[0],
        "labels of pandas": table["v"][::-1][table["v"] >= 0][::-1],
    }
    truth = plain.mu(0.5, volts), model.solve(0.5, volts).mu
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for layout, values in layouts.items():
            for ours, expected in zip(
                (plain.mu(0.5, values), model.solve(0.5, values).mu), truth, strict=True
            ):
                assert torch.equal(ours, expected), layout


def test_no_point_at_all_has_no_voltage(full: FrictionSurface) -> None:
    place = {axis.name: float(axis.nodes[0]) for axis in full.table.axes if not axis.is_absent}
    found = full.voltage(torch.empty(0, dtype=torch.float64), **place)
    assert found.voltage_v.shape == found.status.shape == (0,)


def test_a_number_beyond_any_float_is_refused(plain: FrictionSurface, model: ContactModel) -> None:
    for ask in (plain.mu, model.solve):
        with pytest.raises(InputError, match="voltage_v"):
            ask(0.5, 10**400)


@pytest.mark.parametrize("device", ["no device", "fpga"])
def test_a_device_that_torch_lacks_is_refused(plain: FrictionSurface, device: str) -> None:
    with pytest.raises(InputError, match=f"device: .*{device}"):
        ContactModel(Finger(), Screen(), device=device)
    with pytest.raises(InputError, match=f"device: .*{device}"):
        plain.to(torch.float64, device)
