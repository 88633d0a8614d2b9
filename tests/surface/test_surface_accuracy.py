"""The surface against the model that it was built from."""

import math

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor

from haptix import ContactModel, FrictionSurface, Status

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
    # The stated error is the largest of 4096 random points. What is bounded is the sum of each
    # axis's largest error, by the tolerance; other random points may find half as much again.
    assert float(error.max()) <= min(1.5 * stated, max(tolerance, stated))
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
