"""Every public call of model and surface with tensors of a GPU, pretended where there is none."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from haptix import ContactModel, Finger, FrictionSurface, Screen
from haptix.feel import Constant
from haptix.feel.materials import Grating, headroom
from haptix.lab.stimuli import Rendering, Stimulus
from haptix.model.fidelity import BoundaryElementBox
from haptix.play.simulation.run import exact_amplitude
from haptix.play.virtual_finger import VirtualFinger
from tests.pretend_gpu import OnGpu, PretendGpu

RANGES = {"normal_force_n": (0.3, 0.6), "frequency_hz": (1e3, 2e3), "voltage_v": (0.0, 50.0)}


@pytest.fixture(scope="module")
def gpu() -> Iterator[PretendGpu]:
    with PretendGpu() as mode, pytest.MonkeyPatch.context() as patch:
        patch.setattr(torch.cuda, "mem_get_info", lambda _: (1 << 36, 1 << 36))
        yield mode


@pytest.fixture(scope="module")
def on_gpu(gpu: PretendGpu) -> ContactModel:
    return ContactModel(Finger.preset("semi-wet"), Screen.preset("3m-sct3250"), device="cuda")


@pytest.fixture(scope="module")
def surface(on_gpu: ContactModel) -> FrictionSurface:
    return FrictionSurface.build(on_gpu, RANGES, "5 %").to(torch.float64, "cuda")


def test_what_a_gpu_refuses_is_refused(gpu: PretendGpu) -> None:
    there = torch.ones(2, device="cuda")
    for refused in (lambda: np.asarray(there), there.numpy, lambda: there + torch.ones(2)):
        with pytest.raises((TypeError, RuntimeError)):
            refused()
    assert there.cpu().numpy().sum() == 2
    assert (there + 1).device.type == "cuda"


FORCE = [0.3, 0.5]
SOLVES: dict[str, Callable[[ContactModel], Any]] = {
    "solve": lambda m: m.solve(FORCE, 100.0, [125.0, 1e4]).mu,
    "at_drive": lambda m: m.at_drive(FORCE, 0.3, 125.0).mu,
    "over_period": lambda m: m.over_period(0.5, 100.0, 125.0, samples=16).mu,
    "mean_gap": lambda m: m.contact.mean_gap([1e3, 1e4]),
    "gap_density": lambda m: m.contact.gap_density(1e4, 1e-6),
    "inverse_square_gap": lambda m: m.contact.inverse_square_gap([1e3, 1e4], 2e-7 + 1e-8j),
}
MODELS: dict[str, dict[str, Any]] = {
    "default": {},
    "published": {"theory": "as-published", "terms": {"breakdown": True}},
    "closed form": {"fidelity": "closed-form"},
}


@pytest.mark.parametrize(
    "how", ["default", pytest.param("published", marks=pytest.mark.slow), "closed form"]
)
def test_states(gpu: PretendGpu, how: str) -> None:
    finger, screen = Finger.preset("semi-wet"), Screen(gap_resistivity_ohm_m=1e6)
    there, here = (
        ContactModel(finger, screen, device=device, **MODELS[how]) for device in ("cuda", "cpu")
    )
    for call in list(SOLVES.values())[: 3 if how != "default" else None]:
        found = call(there)
        assert isinstance(found, OnGpu)
        # The steps are counted otherwise on a GPU: to the rounding of a settled root.
        torch.testing.assert_close(found.cpu(), call(here), rtol=1e-11, atol=0.0)


def test_a_plastic_finger(gpu: PretendGpu) -> None:
    model = ContactModel(Finger.preset("dry"), Screen.preset("3m-sct3250"), device="cuda")
    assert isinstance(model.solve(FORCE, 100.0, 125.0).mu, OnGpu)


def test_newton_steps_wait_for_the_gpu_now_and_then(
    gpu: PretendGpu, on_gpu: ContactModel, monkeypatch: pytest.MonkeyPatch
) -> None:
    on_gpu.solve(FORCE, 100.0, 125.0)
    counts = []
    for voltage in (0.0, 100.0):  # settled at once, and after some steps
        gpu.synchronised.clear()
        on_gpu.solve(FORCE, voltage, 125.0)
        counts.append(gpu.synchronised.total())
    assert counts[1] <= counts[0] + 1


def test_gradients(gpu: PretendGpu, on_gpu: ContactModel) -> None:
    force = torch.tensor(FORCE, dtype=torch.float64, device="cuda").requires_grad_()
    on_gpu.solve(force, 100.0, 125.0).mu.sum().backward()
    assert isinstance(force.grad, OnGpu)


def test_boundary_elements(gpu: PretendGpu) -> None:
    box = BoundaryElementBox(points=32, surfaces=2)
    model = ContactModel(
        Finger.preset("semi-wet"), Screen.preset("3m-sct3250"), fidelity="boundary-element",
        boundary_elements=box, device="cuda",
    )  # fmt: skip
    with pytest.warns(UserWarning):
        assert isinstance(model.solve(0.5, [0.0, 20.0], 125.0).mu, OnGpu)
        assert isinstance(model.scatter(0.5, 0.0, 125.0).area_fraction, OnGpu)


@pytest.mark.slow
def test_surface(gpu: PretendGpu, surface: FrictionSurface, tmp_path: Path) -> None:
    there = torch.tensor(FORCE, dtype=torch.float64, device="cuda")
    for dtype in (torch.float64, torch.float32):
        one = surface.to(dtype, "cuda")
        sample = one.evaluate(there, 30.0, 1500.0)
        found = one.voltage(sample.mu, there, 1500.0)
        for tensor in (sample.mu, sample.status, found.voltage_v, found.status):
            assert isinstance(tensor, OnGpu)
    surface.reachable(there, 1500.0)
    surface.highest_voltage(there, 1500.0)
    surface.at(1500.0).mu(there, 30.0)
    force = there.clone().requires_grad_()
    surface.mu(force, 30.0, 1500.0).sum().backward()
    assert isinstance(force.grad, OnGpu)
    surface.save(tmp_path / "one.surface")
    again = FrictionSurface.load(tmp_path / "one.surface")
    assert torch.equal(again.table.columns, surface.table.columns.cpu())


def test_what_reads_a_surface(gpu: PretendGpu, surface: FrictionSurface) -> None:
    headroom(Grating(period_mm=6.0), surface.at(1500.0), 0.5, 10.0, 10.0, columns=8).numbers()
    stimulus = Stimulus("one", Constant(0.01, 0.1), "contrast", carrier_hz=1500.0)
    response = surface.column(0.5, 1500.0)
    assert np.isfinite(Rendering(stimulus, response).whole()).all()


def test_what_a_simulation_asks_of_a_model(gpu: PretendGpu, on_gpu: ContactModel) -> None:
    mu = on_gpu.solve(FORCE, 50.0, 1500.0).mu.cpu().numpy()
    found = exact_amplitude(
        on_gpu, mu, np.array(FORCE), 1500.0, on_gpu.screen.h0_m, np.array([45.0, 55.0])
    )
    np.testing.assert_allclose(found, 50.0, rtol=1e-9)
    finger = VirtualFinger(on_gpu)
    t = np.array([0.0, 0.02])
    volts = 50 * np.sin(np.arange(960) / 5)
    felt = finger.feel(volts, 48_000.0, t, 5 + 50 * t, 5 + 0 * t, 0.5 + 0 * t)
    assert np.isfinite(felt.mu[1:-1]).any()
