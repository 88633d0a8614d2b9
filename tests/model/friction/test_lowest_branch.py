"""The equilibrium on tables whose roots and folds are known in closed form."""

import math
from collections.abc import Callable

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from haptix.model.contact.tables import UniformCubic
from haptix.model.electro import Attraction
from haptix.model.fidelity.balance import LIGHT_CONTACT_LIMIT
from haptix.model.fidelity.mean_field import lowest_branch

STEP = 0.1
SCALE = 1e-3  # I at p = 1 Pa


def table(log_value: Callable[[torch.Tensor], torch.Tensor]) -> UniformCubic:
    nodes = math.log(1e-2) + STEP * torch.arange(140, dtype=torch.float64)  # to 1e4
    return UniformCubic.through(float(nodes[0]), STEP, log_value(nodes)[:, None])


def power_law(n: float) -> UniformCubic:
    """``I = SCALE p^n``: a straight line, which the cubic holds exactly."""
    return table(lambda log_p: math.log(SCALE) + n * log_p)


def tensor(*values: float) -> torch.Tensor:
    return torch.tensor(values, dtype=torch.float64)


@settings(max_examples=60, deadline=None)
@given(applied=st.floats(0.02, 20.0), n=st.floats(1.1, 5.0))
def test_the_fold_of_a_power_law(applied: float, n: float) -> None:
    # c = (p - p0)/(a p^n) has its maximum at p = n p0/(n - 1).
    fold = n * applied / (n - 1)
    strongest = (fold - applied) / (SCALE * fold**n)
    column = torch.zeros(4, dtype=torch.long)
    strength = tensor(0.0, 0.999, 1.001, 10.0) * strongest
    found = lowest_branch(
        torch.full((4,), applied, dtype=torch.float64), strength, Attraction(power_law(n), column)
    )
    # At its maximum c is flat: an error e in the fold's place costs e^2.
    assert found.strength_at_end.tolist() == pytest.approx([strongest] * 4, rel=1e-10)
    assert found.is_stable.tolist() == [True, True, False, False]
    # The place of a maximum is good to the square root of rounding only.
    assert found.pressure_pa[2:].tolist() == pytest.approx([fold] * 2, rel=1e-7)
    assert float(found.pressure_pa[0]) == applied


@settings(max_examples=60, deadline=None)
@given(applied=st.floats(0.02, 20.0), share=st.floats(0.0, 0.9999))
def test_roots_of_the_parallel_plate_like_table(applied: float, share: float) -> None:
    # I = a p^2: p = (1 - sqrt(1 - 4 a c p0))/(2 a c), with its fold at 4 a c p0 = 1.
    strength = share / (4 * SCALE * applied)
    found = lowest_branch(
        tensor(applied),
        tensor(strength),
        Attraction(power_law(2.0), torch.zeros(1, dtype=torch.long)),
    )
    expected = 2 * applied / (1 + math.sqrt(1 - share))
    assert bool(found.is_stable)
    # 1e-9: rounding over sqrt(1 - share), the stiffness left near the fold.
    assert float(found.pressure_pa) == pytest.approx(expected, rel=1e-9)


@settings(max_examples=30, deadline=None)
@given(applied=st.floats(0.02, 20.0), n=st.floats(0.0, 1.0))
def test_without_a_fold_the_light_contact_ends_at_its_limit(applied: float, n: float) -> None:
    end = LIGHT_CONTACT_LIMIT * applied
    strongest = (end - applied) / (SCALE * end**n)
    found = lowest_branch(
        tensor(applied, applied),
        tensor(0.9999, 1.0001) * strongest,
        Attraction(power_law(n), torch.zeros(2, dtype=torch.long)),
    )
    assert found.strength_at_end.tolist() == pytest.approx([strongest] * 2, rel=1e-12)  # rounding
    assert found.is_stable.tolist() == [True, False]
    assert float(found.pressure_pa[1]) == pytest.approx(end, rel=1e-12)


def test_of_two_folds_the_first_ends_the_branch() -> None:
    # The exponent falls from 3 to 0.2 about p = 3: from p0 = 1 there is a fold at 1.5, then a
    # second, stable branch which bears more.
    def log_value(log_p: torch.Tensor) -> torch.Tensor:
        bend = torch.nn.functional.softplus(12 * (log_p - math.log(3.0))) / 12
        return math.log(SCALE) + 3 * log_p - 2.8 * bend

    cubic = table(log_value)
    first = 0.5 / (SCALE * 1.5**3)
    found = lowest_branch(
        tensor(1.0, 1.0),
        tensor(0.99, 1.01) * first,
        Attraction(cubic, torch.zeros(2, dtype=torch.long)),
    )
    assert found.is_stable.tolist() == [True, False]
    # The bend still takes 7e-4 of the exponent at p = 1.5.
    assert found.strength_at_end.tolist() == pytest.approx([first] * 2, rel=1e-3)
    assert found.pressure_pa.max() == pytest.approx(1.5, rel=2e-3)
    far = tensor(29.0)
    bears_more = (far - 1) * torch.exp(-cubic(far.log(), torch.zeros(1, dtype=torch.long)))
    assert float(bears_more) > 1.5 * first  # so that the choice matters


def test_columns_are_solved_apart() -> None:
    both = UniformCubic(
        power_law(2.0).start,
        STEP,
        torch.cat([power_law(2.0).values, power_law(0.5).values], 1),
        torch.cat([power_law(2.0).slopes, power_law(0.5).slopes], 1),
    )
    applied, strength = tensor(1.0, 1.0), tensor(50.0, 50.0)
    found = lowest_branch(applied, strength, Attraction(both, torch.tensor([0, 1])))
    for i, n in enumerate((2.0, 0.5)):
        alone = lowest_branch(
            applied[:1], strength[:1], Attraction(power_law(n), torch.zeros(1, dtype=torch.long))
        )
        assert float(found.pressure_pa[i]) == float(alone.pressure_pa)
        assert float(found.strength_at_end[i]) == float(alone.strength_at_end)


def test_the_implicit_derivative() -> None:
    # p = 2 p0/(1 + sqrt(1 - x)), x = 4 a c p0: dp/dc = p^2 a / sqrt(1 - x).
    applied = tensor(1.0)
    strength = tensor(0.7 / (4 * SCALE)).requires_grad_()
    found = lowest_branch(
        applied, strength, Attraction(power_law(2.0), torch.zeros(1, dtype=torch.long))
    )
    (slope,) = torch.autograd.grad(found.pressure_pa.sum(), strength)
    pressure = 2 / (1 + math.sqrt(0.3))
    assert float(slope) == pytest.approx(pressure**2 * SCALE / math.sqrt(0.3), rel=1e-9)


def test_the_derivative_of_the_fold() -> None:
    # p = n p0/(n - 1) and c = (p - p0)/(a p^n) there, by p0, n and ln a.
    names = {"applied": 1.3, "n": 2.5, "scale": math.log(SCALE)}
    inputs = {name: tensor(value).requires_grad_() for name, value in names.items()}
    applied, n, scale = inputs.values()
    cubic = table(lambda log_p: scale + n * log_p)
    found = lowest_branch(applied, tensor(1e9), Attraction(cubic, torch.zeros(1, dtype=torch.long)))
    assert not bool(found.is_stable)
    fold = n * applied / (n - 1)
    expected = {"pressure_pa": fold, "strength_at_end": (fold - applied) / (scale.exp() * fold**n)}
    for name, value in expected.items():
        ours = torch.autograd.grad(
            getattr(found, name).sum(), list(inputs.values()), retain_graph=True
        )
        right: tuple[torch.Tensor | None, ...] = torch.autograd.grad(
            value.sum(), list(inputs.values()), retain_graph=True, allow_unused=True
        )
        for one, other in zip(ours, right, strict=True):
            # The fold's curvature is a difference over 1e-4 in ln p; c is flat at it.
            wanted = 0.0 if other is None else float(other)
            assert float(one) == pytest.approx(wanted, rel=1e-6, abs=1e-9), name


def test_the_derivative_of_the_limit() -> None:
    applied = tensor(1.3).requires_grad_()
    found = lowest_branch(
        applied, tensor(1e9), Attraction(power_law(0.5), torch.zeros(1, dtype=torch.long))
    )
    # c = 30 p0 / (a sqrt(31 p0)): rises as sqrt(p0).
    (by_load,) = torch.autograd.grad(found.strength_at_end.sum(), applied)
    assert float(by_load) == pytest.approx(
        float(found.strength_at_end.detach()) / 2 / 1.3, rel=1e-10
    )
