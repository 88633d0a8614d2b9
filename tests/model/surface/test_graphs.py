"""Graphs of torch: what no graph can hold says so, and never returns unwritten memory."""

from collections.abc import Callable
from functools import partial
from typing import Any

import pytest
import torch
from torch import Tensor
from torch.autograd import forward_ad

from haptix import ContactModel, Finger, Screen
from haptix.base.errors import InputError
from haptix.model.contact import RoughnessSpectrum
from haptix.model.surface import FrictionSurface

FORCE = torch.tensor([0.3, 0.5, 0.7], dtype=torch.float64)
VOLTS = torch.tensor([10.0, 60.0, 90.0], dtype=torch.float64)
Call = Callable[[Tensor, Tensor], Tensor]


class Module(torch.nn.Module):
    def __init__(self, call: Call) -> None:
        super().__init__()
        self.call = call

    def forward(self, a: Tensor, b: Tensor) -> Tensor:
        return self.call(a, b)


@pytest.fixture(scope="module")
def calls() -> dict[str, Call]:
    model = ContactModel(Finger.preset("wet"), Screen(), fidelity="closed-form")
    surface = FrictionSurface.build(model, {"normal_force_n": (0.2, 1.0)}, "0.1 JND")
    field = model.contact
    return {
        "evaluate": lambda force, volts: surface.evaluate(force, volts).mu,
        "mu": lambda force, volts: surface.mu(force, volts),
        "voltage": lambda force, volts: surface.voltage(0.3 + 0 * volts, force).voltage_v,
        "reachable": lambda force, _: surface.reachable(force)[1],
        "solve": lambda force, volts: model.solve(force, volts).mu,
        "area_fraction": lambda force, _: field.area_fraction(1e4 * force),
    }


pytestmark = [
    pytest.mark.filterwarnings("ignore:.*torch.jit.trace.* is deprecated"),
    pytest.mark.filterwarnings("ignore::torch.jit.TracerWarning"),
]
NAMES = ["evaluate", "mu", "voltage", "reachable", "solve", "area_fraction"]


@pytest.mark.parametrize("name", NAMES)
def test_a_call_works_or_says_that_no_graph_holds_it(calls: dict[str, Call], name: str) -> None:
    call = calls[name]
    assert call(FORCE, VOLTS).isfinite().all()
    ways: list[Callable[[], Any]] = [
        lambda: torch.jit.trace(call, (FORCE, VOLTS), check_trace=False),
        lambda: torch.export.export(Module(call), (FORCE, VOLTS)),
        lambda: torch.vmap(call)(FORCE, VOLTS),
    ]
    for way in ways:
        with pytest.raises(InputError, match=r"cannot follow it.*whole tensors"):
            way()


@pytest.mark.parametrize("name", ["evaluate", "solve"])
def test_compiled_code_runs_around_it(calls: dict[str, Call], name: str) -> None:
    call = calls[name]

    def twice(force: Tensor, volts: Tensor) -> Tensor:
        return 2 * call(force * 1.0, volts)

    torch._dynamo.reset()
    compiled = torch.compile(twice, backend="eager")
    assert torch.equal(compiled(FORCE, VOLTS), twice(FORCE, VOLTS))
    torch._dynamo.reset()
    with pytest.raises(torch._dynamo.exc.Unsupported, match="cannot follow it"):
        torch.compile(twice, fullgraph=True, backend="eager")(FORCE, VOLTS)


def _first(form: Callable[[Tensor], Tensor], q: Tensor, _: Tensor) -> Tensor:
    return form(q)


def test_closed_forms_are_held_by_every_graph() -> None:
    rough = RoughnessSpectrum.self_affine(22e-6, 0.86, 1e3, 4e3, 1e9)
    dielectric = Finger().dielectric
    waves = torch.tensor([2e3, 1e5, 1e7], dtype=torch.float64)
    forms: list[Callable[[Tensor], Tensor]] = [
        lambda q: rough.moment(1, q),
        lambda q: dielectric.relative_permittivity(q).abs(),
    ]
    for form in forms:
        other = 1.1 * waves
        expected = form(other)
        assert torch.equal(torch.vmap(form)(other), expected)
        assert torch.equal(torch.jit.trace(form, (waves,))(other), expected)
        exported = torch.export.export(Module(partial(_first, form)), (waves, waves))
        torch.testing.assert_close(exported.module()(other, other), expected, rtol=1e-12, atol=0)


@pytest.mark.parametrize("name", ["mu", "voltage", "solve"])
def test_forward_mode_is_refused_and_not_answered_without_a_derivative(
    plain: FrictionSurface, model: ContactModel, name: str
) -> None:
    call = {
        "mu": lambda x: plain.mu(0.5, x),
        "voltage": lambda x: plain.voltage(x, 0.5).voltage_v,
        "solve": lambda x: model.solve(0.5, x).mu,
    }[name]
    at = torch.tensor([0.3] if name == "voltage" else [50.0], dtype=torch.float64)
    with pytest.raises(InputError, match="reverse mode"), forward_ad.dual_level():
        call(forward_ad.make_dual(at, torch.ones_like(at)))
    with pytest.raises(InputError, match="reverse mode"):
        torch.func.jacfwd(call)(at)
    assert torch.func.jacrev(call)(at).item() > 0
    with forward_ad.dual_level():  # of others; these inputs have no tangent
        assert torch.equal(call(at), call(at))
