"""The surface against the model that it was built from."""

import math

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor

from haptix import ContactModel, Finger, FrictionSurface, Screen, Status

POINTS = 1500


def spread(low: float, high: float, seed: int, points: int = POINTS) -> Tensor:
    """Random points, even in the logarithm, never beyond the ends by rounding."""
    generator = torch.Generator().manual_seed(seed)
    share = torch.rand(points, generator=generator, dtype=torch.float64)
    return torch.exp(math.log(low) + share * math.log(high / low)).clamp(low, high)


def even(high: float, seed: int, points: int = POINTS) -> Tensor:
    generator = torch.Generator().manual_seed(seed)
    return high * torch.rand(points, generator=generator, dtype=torch.float64)


def assert_within(surface: FrictionSurface, error: Tensor, tolerance: float) -> None:
    stated = surface.info["error_max"]
    # The stated error is the largest of 16384 random points; others may find a little more.
    assert float(error.max()) <= min(1.2 * stated, tolerance)
    assert stated <= tolerance


def test_force_and_voltage(model: ContactModel, plain: FrictionSurface) -> None:
    force, voltage = spread(0.2, 1.0, 1), even(200.0, 2)
    error = (plain.mu(force, voltage) - model.solve(force, voltage, h0_m=2e-7).mu).abs()
    assert_within(plain, error, 4e-3)
    # A surface that stated far more than its error would be of no use either.
    assert float(error.max()) > plain.info["error_max"] / 4


def test_all_four_axes(model: ContactModel, full: FrictionSurface) -> None:
    at = (spread(0.3, 0.9, 3), even(150.0, 4), spread(60.0, 500.0, 5), spread(1e-7, 3e-7, 6))
    error = (full.mu(*at) - model.solve(*at).mu).abs()
    assert_within(full, error, 8e-3)


def test_the_corners_of_the_surface(model: ContactModel, full: FrictionSurface) -> None:
    ends = ((0.3, 0.9), (0.0, 75.0, 150.0), (60.0, 500.0), (1e-7, 3e-7))
    at = torch.cartesian_prod(*(torch.tensor(e, dtype=torch.float64) for e in ends)).unbind(-1)
    error = (full.mu(*at) - model.solve(*at).mu).abs()
    assert float(error.max()) <= 8e-3  # the tolerance


def test_a_smaller_tolerance_gives_a_smaller_error(
    model: ContactModel, plain: FrictionSurface
) -> None:
    fine = FrictionSurface.build(
        model, {"normal_force_n": (0.2, 1.0), "h0_m": 2e-7}, tolerance=2e-4
    )
    assert fine.info["error_max"] <= 2e-4
    assert fine.mu_table.numel() > plain.mu_table.numel()
    force, voltage = spread(0.2, 1.0, 1), even(200.0, 2)
    error = (fine.mu(force, voltage) - model.solve(force, voltage, h0_m=2e-7).mu).abs()
    assert_within(fine, error, 2e-4)


def test_without_voltage_the_friction_of_the_model(
    model: ContactModel, plain: FrictionSurface
) -> None:
    nodes = plain.normal_force_n.nodes
    expected = model.solve(nodes, 0.0, h0_m=2e-7).mu
    torch.testing.assert_close(plain.mu(nodes, 0.0), expected, rtol=1e-12, atol=0)  # rounding


@settings(max_examples=60, deadline=None)
@given(
    force=st.floats(0.3, 0.9),
    frequency=st.floats(60, 500),
    h0=st.floats(1e-7, 3e-7),
    voltages=st.lists(st.floats(0, 150), min_size=2, max_size=20),
)
def test_friction_never_falls_with_voltage(
    full: FrictionSurface, force: float, frequency: float, h0: float, voltages: list[float]
) -> None:
    voltage = torch.tensor(sorted(voltages), dtype=torch.float64)
    mu = full.mu(force, voltage, frequency, h0)
    # Rounding of a blend of 16 values.
    assert bool((mu.diff() >= -1e-14).all())


def test_gradients_match_differences(full: FrictionSurface) -> None:
    at = [0.47, 101.3, 137.0, 1.7e-7]  # inside a cell: none of them is a node
    leaves = [torch.tensor(v, dtype=torch.float64).requires_grad_() for v in at]
    slopes = torch.autograd.grad(full.mu(*leaves), leaves)
    for i, slope in enumerate(slopes):
        up, down = (
            [v * (1 + side * 1e-6) if j == i else v for j, v in enumerate(at)] for side in (1, -1)
        )
        difference = float(full.mu(*up) - full.mu(*down)) / (2e-6 * at[i])
        # Rounding of 1e-16 over 1e-6; the curvature within a cell is smaller still.
        assert float(slope) == pytest.approx(difference, rel=1e-6)
        assert float(slope) != 0.0


def test_gradients_of_the_inverse(full: FrictionSurface) -> None:
    mu = torch.tensor(0.29, dtype=torch.float64).requires_grad_()
    force = torch.tensor(0.47, dtype=torch.float64).requires_grad_()
    found = full.voltage(mu, force, 137.0, 1.7e-7)
    assert int(found.status) == Status.OK
    by_mu, by_force = torch.autograd.grad(found.voltage_v, (mu, force))
    voltage = found.voltage_v.detach().requires_grad_()
    at = torch.tensor(0.47, dtype=torch.float64).requires_grad_()
    mu_by_voltage, mu_by_force = torch.autograd.grad(
        full.mu(at, voltage, 137.0, 1.7e-7), (voltage, at)
    )
    # The implicit function theorem; rounding.
    assert float(by_mu) == pytest.approx(1 / float(mu_by_voltage), rel=1e-9)
    assert float(by_force) == pytest.approx(-float(mu_by_force / mu_by_voltage), rel=1e-9)


def test_single_precision_copy(full: FrictionSurface) -> None:
    single = full.to(torch.float32)
    at = (spread(0.3, 0.9, 3), even(150.0, 4), spread(60.0, 500.0, 5), spread(1e-7, 3e-7, 6))
    mu = single.mu(*at)
    assert mu.dtype == torch.float32
    # Single precision is 6e-8; ln x of a position loses ln(1e-7) = 16 of its cell's ninth, and a
    # step along an axis moves mu by a tenth or so: some 1e-6, far below the stated error.
    assert float((mu.double() - full.mu(*at)).abs().max()) < 1e-5 < full.info["error_max"] / 10
    back = single.voltage(mu, at[0], at[2], at[3])
    assert back.voltage_v.dtype == torch.float32
    assert int((back.status != int(Status.OK)).sum()) == 0
    # mu ~ V^2: near 0 V a rounding of 1e-7 in mu is some volts; above 30 V it is 0.05 V at most.
    high = at[1] > 30
    assert float((back.voltage_v.double() - at[1])[high].abs().max()) < 0.05


def test_there_and_back(model: ContactModel, full: FrictionSurface) -> None:
    force, frequency, h0 = spread(0.3, 0.9, 13), spread(60.0, 500.0, 15), spread(1e-7, 3e-7, 16)
    low, high = full.reachable(force, frequency, h0)
    mu = low + even(1.0, 14) * (high - low)
    found = full.voltage(mu, force, frequency, h0)
    assert bool((found.status == int(Status.OK)).all())
    # Exact on the interpolant: rounding.
    again = full.mu(force, found.voltage_v, frequency, h0)
    torch.testing.assert_close(again, mu, rtol=1e-12, atol=0)
    single = full.to(torch.float32)
    there = single.voltage(mu, force, frequency, h0)
    back = single.mu(force, there.voltage_v, frequency, h0)
    assert float((back - mu).abs().max()) < 1e-6  # several roundings of 6e-8
    # Against the solver: no more than the error that the surface states.
    solved = model.solve(force, found.voltage_v, frequency, h0).mu
    assert float((solved - mu).abs().max()) <= full.info["tolerance"]["value"]


def test_round_trip_of_a_default_surface(model: ContactModel) -> None:
    surface = FrictionSurface.build(model, {"normal_force_n": (0.1, 1.0)}, tolerance="0.2 %")
    force, share = spread(0.1, 1.0, 17), even(1.0, 18)
    low, high = surface.reachable(force)
    mu = low + share * (high - low)
    voltage = surface.voltage(mu, force).voltage_v
    span = float(surface.mu_table.max() - surface.mu_table.min())
    # 0.2 % of the range, as asked.
    assert float((model.solve(force, voltage).mu - mu).abs().max()) <= 2e-3 * span


def test_large_batches_are_those_of_single_points(full: FrictionSurface) -> None:
    count = 200_003  # several blocks and threads, and an odd end
    at = (
        spread(0.25, 1.0, 3, count),
        even(160.0, 4, count),
        spread(60.0, 500.0, 5, count),
        spread(1e-7, 3e-7, 6, count),
    )
    before = torch.get_num_threads()
    torch.set_num_threads(2)
    try:
        whole, inverse = full.evaluate(*at), full.voltage(0.27 + at[1] / 800, at[0], *at[2:])
        assert torch.get_num_threads() == 2
    finally:
        torch.set_num_threads(before)
    for i in (0, 8191, 8192, 104_097, 104_098, count - 1):
        one = full.evaluate(*(values[i] for values in at))
        assert float(whole.mu[i]) == pytest.approx(float(one.mu), rel=1e-14)
        assert int(whole.status[i]) == int(one.status)
        back = full.voltage(0.27 + at[1][i] / 800, at[0][i], at[2][i], at[3][i])
        assert float(inverse.voltage_v[i]) == pytest.approx(float(back.voltage_v), rel=1e-12)
        assert int(inverse.status[i]) == int(back.status)
    outside = (at[0] < 0.3) | (at[0] > 0.9) | (at[1] > 150.0)
    assert torch.equal(whole.status == int(Status.OUT_OF_RANGE), outside)


@settings(max_examples=40, deadline=None)
@given(
    points=st.lists(st.tuples(st.floats(0.3, 0.9), st.floats(0.0, 30.0)), min_size=1, max_size=30)
)
def test_every_wish_has_a_status_and_a_voltage(
    past_pull_in: FrictionSurface, points: list[tuple[float, float]]
) -> None:
    force, mu = (torch.tensor(column, dtype=torch.float64) for column in zip(*points, strict=True))
    found = past_pull_in.voltage(mu, force.clamp(max=0.5))
    assert bool((found.voltage_v.isfinite() & (found.voltage_v >= 0)).all())
    low, high = past_pull_in.reachable(force.clamp(max=0.5))
    expected = torch.where(mu < low, int(Status.BELOW), int(Status.OK))
    expected = torch.where(mu > high, int(Status.PULL_IN), expected)
    sure = ((mu / low - 1).abs() > 1e-8) & ((mu / high - 1).abs() > 1e-8)  # the ends' own slack
    assert torch.equal(found.status[sure], expected[sure])


@pytest.mark.slow  # a surface of four axes of the default theory
def test_the_tolerance_holds_where_contacts_come_near_pull_in() -> None:
    """The last cells before pull-in: thin insulators, slow drives, high voltages."""
    points = 4000
    model = ContactModel(Finger.preset("semi-wet"), Screen())
    ranges = {"normal_force_n": (0.1, 1.0), "frequency_hz": (60.0, 1e4), "h0_m": (5e-8, 5e-7)}
    surface = FrictionSurface.build(model, ranges, "0.2%")
    force, frequency = spread(0.1, 1.0, 21, points), spread(60.0, 100.0, 22, points)
    h0, share = spread(5e-8, 6e-8, 23, points), spread(0.9, 1.0, 24, points)
    solved = model.solve(force, 200.0, frequency, h0)
    voltage = share * solved.pull_in_voltage_v.clamp(max=200.0)
    state = model.solve(force, voltage, frequency, h0)
    found = surface.evaluate(force, voltage, frequency, h0)
    is_ok = (state.status == int(Status.OK)) & (found.status == int(Status.OK))
    assert int(is_ok.sum()) > points // 2
    span = surface.info["mu_high"] - surface.info["mu_low"]
    assert float((found.mu - state.mu).abs()[is_ok].max()) <= 2e-3 * span
