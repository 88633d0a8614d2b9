"""Boundary elements as a fidelity of the contact model: same call, its band, its limits."""

import math
from typing import Any

import pytest
import torch
from torch import Tensor

from haptix import ContactModel, Finger, InputError, LimitError, Screen, Status
from haptix.model.contact import RoughnessSpectrum
from haptix.model.contact.boundary_elements import BoundaryElements, ResolutionWarning, ensemble
from haptix.model.fidelity import BoundaryElementBalance, BoundaryElementBox, UnsettledWarning
from haptix.model.finger import MeasuredRoughness
from haptix.model.terms import chosen_terms

# Rough on a scale that a small box resolves: 2 roll-off wavelengths, 8 pixels per shortest one.
SPECTRUM = RoughnessSpectrum.self_affine(1e-6, 0.8, 4.5e4, 9e4, 3.6e5)
FINGER = Finger(
    name="gel",
    roughness=MeasuredRoughness.of(SPECTRUM, "made up"),
    apparent_area_at_1n_m2=50e-6,
    apparent_area_exponent=0.0,
)
SCREEN = Screen(max_voltage_v=1000.0)
H0 = 1e-6
BOX = BoundaryElementBox(points=64, surfaces=4, q_high_per_m=3.6e5)

pytestmark = pytest.mark.filterwarnings(
    "ignore::haptix.model.contact.boundary_elements.ResolutionWarning"
)


def exact(finger: Finger = FINGER, box: BoundaryElementBox = BOX, **options: Any) -> ContactModel:
    return ContactModel(
        finger, SCREEN, fidelity="boundary-element", boundary_elements=box, **options
    )


@pytest.fixture(scope="module")
def model() -> ContactModel:
    return exact()


def tensor(*values: float) -> Tensor:
    return torch.tensor(values, dtype=torch.float64)


def test_without_voltage_it_is_pure_contact(model: ContactModel) -> None:
    force = tensor(0.5, 2.0)
    state = model.solve(force, 0.0, h0_m=H0)
    alone = BoundaryElements(model.boxed.surfaces, FINGER.solid()).solve(force / 50e-6)
    torch.testing.assert_close(
        state.area_fraction, alone.area_fraction.mean(-1), rtol=1e-12, atol=0
    )
    torch.testing.assert_close(state.mean_gap_m, alone.mean_gap_m.mean(-1), rtol=1e-12, atol=0)
    torch.testing.assert_close(state.mu, 8e6 * state.area_fraction * 50e-6 / force)
    assert state.attraction_pa.tolist() == [0.0, 0.0]
    torch.testing.assert_close(state.pressure_pa, force / 50e-6)


def test_friction_rises_with_voltage_as_the_mean_field_says(model: ContactModel) -> None:
    voltage = tensor(0.0, 100.0, 200.0)
    state = model.solve(1.0, voltage, 125.0, H0)
    # With this band; the corrected mean field agrees with larger boxes to some per cent. These few
    # small surfaces scatter by some 10 %, and their pixels are coarse.
    # The same tau_f: `theory=` would carry it over.
    band = FINGER.replace(roughness=model.boxed.roughness, theory="corrected")
    mean = ContactModel(band, SCREEN, terms={"finite-size": False}).solve(1.0, voltage, 125.0, H0)
    assert bool((state.mu.diff() > 0).all())
    assert state.mu.shape == (3,)
    torch.testing.assert_close(state.mu, mean.mu, rtol=0.25, atol=0)
    torch.testing.assert_close(state.mean_gap_m, mean.mean_gap_m, rtol=0.25, atol=0)
    torch.testing.assert_close(
        state.gap_attraction_pa[1:], mean.gap_attraction_pa[1:], rtol=0.35, atol=0
    )
    assert state.status.tolist() == [Status.OK] * 3


def test_the_scatter_is_that_of_the_surfaces(model: ContactModel) -> None:
    state = model.solve(1.0, tensor(0.0, 100.0), 125.0, H0)
    scatter = model.scatter(1.0, tensor(0.0, 100.0), 125.0, H0)
    assert scatter.area_fraction.shape == (2, 4)
    assert bool((scatter.area_fraction.std(-1) > 0).all())
    torch.testing.assert_close(scatter.area_fraction.mean(-1), state.area_fraction)
    with pytest.raises(InputError, match=r'scatter: .*"boundary-element"'):
        ContactModel(FINGER, SCREEN).scatter(1.0, 0.0)


def test_past_snap_in_there_is_a_status_and_a_voltage(model: ContactModel) -> None:
    state = model.solve(0.2, tensor(50.0, 950.0), h0_m=2e-6)
    assert state.status[0] == Status.OK
    assert state.status[1] == Status.PULL_IN
    assert bool(state.mu.isfinite().all())
    # The mean field ends its light contact at the same share of the load.
    band = FINGER.replace(roughness=model.boxed.roughness)
    mean = ContactModel(band, SCREEN, theory="corrected").solve(0.2, 0.0, h0_m=2e-6)
    ends = state.pull_in_voltage_v
    assert ends[0] == ends[1]
    torch.testing.assert_close(ends[1], mean.pull_in_voltage_v, rtol=0.15, atol=0)
    assert 31 * 0.9 < float(state.pressure_pa[1] * 50e-6 / 0.2) <= 31
    # Not looked for where no voltage goes that far.
    assert float(model.solve(0.3, 10.0, h0_m=2e-6).pull_in_voltage_v) == math.inf


def test_the_band_is_said_and_what_is_missing_warned_of() -> None:
    box = BoundaryElementBox(points=64, surfaces=1)
    with pytest.warns(ResolutionWarning, match="slope"):
        model = ContactModel(
            Finger.preset("semi-wet"), SCREEN, fidelity="boundary-element", boundary_elements=box
        )
    said = model.describe()["boundary_elements"]
    assert said["pixels_per_shortest_wave"] == pytest.approx(4.0)
    assert said["q_high_per_m"] == pytest.approx(2 * math.pi / (4 * said["side_m"] / 64))
    assert said["side_m"] == pytest.approx(2 * 2 * math.pi / 3992.9)
    assert 0.9 < said["h_rms_share"] < 1.1
    assert 0.1 < said["slope_share"] < 0.3
    # The mean field in the box has the roughness that the surfaces have.
    assert float(model.contact.spectrum.h_rms_m) == pytest.approx(22e-6 * said["h_rms_share"], 0.05)
    # An insulator thinner than what the gap does from pixel to pixel.
    with pytest.warns(ResolutionWarning, match=r"attraction.*not resolved"):
        model.solve(0.1, 20.0)


def test_a_preset_finger_is_solved_in_a_small_box(recwarn: pytest.WarningsRecorder) -> None:
    # 22 um of roughness on 0.2 um of insulator and skin: rough, but solved.
    box = BoundaryElementBox(points=64, surfaces=1)
    finger, screen = Finger.preset("semi-wet"), Screen.preset("3m-sct3250")
    model = ContactModel(finger, screen, fidelity="boundary-element", boundary_elements=box)
    scatter = model.scatter(0.5, tensor(0.0, 50.0, 150.0), 125.0)
    assert bool(scatter.converged.all())
    assert bool((scatter.area_fraction.mean(-1).diff() >= 0).all())
    assert not [w for w in recwarn if issubclass(w.category, UnsettledWarning)]


def test_few_pixels_in_contact_are_said() -> None:
    with pytest.warns(ResolutionWarning, match=r"pixels.*200 Pa"):
        exact().solve(0.01, 0.0, h0_m=H0)


def test_hardness_and_layers_come_through_the_terms() -> None:
    soft_below = FINGER.replace(
        bulk_modulus_pa=1e6, layer_thickness_m=20e-6, hardness_pa=2e6, poisson_ratio=0.5
    )
    assert "plasticity" in exact(soft_below).terms
    box = BoundaryElementBox(points=64, surfaces=1, q_high_per_m=3.6e5)
    with_all = exact(soft_below, box).solve(2.0, 0.0)
    elastic = exact(soft_below, box, terms={"plasticity": False}).solve(2.0, 0.0)
    half_space = exact(soft_below, box, terms=set()).solve(2.0, 0.0)
    assert with_all.area_fraction > elastic.area_fraction
    assert elastic.mean_gap_m < 0.95 * half_space.mean_gap_m


def test_progress_is_told() -> None:
    told: list[float] = []
    model = exact(box=BoundaryElementBox(64, 1, q_high_per_m=3.6e5), on_progress=told.append)
    model.solve(tensor(1.0, 2.0), 0.0)
    assert told == [0.5, 1.0]
    model.solve(tensor(1.0, 2.0), 0.0)  # known by now
    assert told == [0.5, 1.0]


def test_what_cannot_be_is_refused(model: ContactModel, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(InputError, match=r'"finite-size".*"boundary-element"'):
        chosen_terms({"finite-size": True}, FINGER, SCREEN, BoundaryElementBalance)
    with pytest.raises(InputError, match=r"contact_spots: expected \"excluded\""):
        exact(contact_spots="included")
    with pytest.raises(InputError, match=r"boundary_elements: expected none"):
        ContactModel(FINGER, SCREEN, boundary_elements=BOX)
    with pytest.raises(InputError, match="requires grad"):
        exact(FINGER.replace(youngs_modulus_pa=torch.tensor(4e7, requires_grad=True)))
    with pytest.raises(InputError, match="requires grad"):
        model.solve(torch.tensor(1.0, requires_grad=True), 0.0)
    with pytest.raises(InputError, match=r"64 .*got 65, about .* min"):
        model.solve(torch.linspace(1, 2, 65), 0.0)
    with pytest.raises(InputError, match=r"over_period: .*mean-field"):
        model.over_period(1.0, 10.0, 100.0)
    with pytest.raises(InputError, match="at_drive"):
        model.at_drive(1.0, 0.5)
    with pytest.raises(LimitError, match=r"above the limit"):
        model.scatter(1.0, 2000.0)
    with pytest.raises(InputError, match=r"points: .*2"):
        exact(box=BoundaryElementBox(points=16, q_high_per_m=3.6e6, waves=4.0))
    with pytest.raises(InputError, match=r"points: .*whole"):
        BoundaryElementBox(points=64.0)
    with pytest.raises(InputError, match=r"waves: .*above 0"):
        BoundaryElementBox(waves=math.nan)
    monkeypatch.setattr(ensemble, "free_bytes", lambda device: 10**6)
    with pytest.raises(InputError, match="GiB free"):
        exact()
