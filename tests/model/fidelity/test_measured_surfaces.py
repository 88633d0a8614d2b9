"""Surfaces from few boundary elements, with the mean field between them."""

from pathlib import Path

import pytest
import torch

from haptix import ContactModel, Finger, FrictionSurface, InputError, Scene, Screen
from haptix.model.contact import RoughnessSpectrum
from haptix.model.fidelity import BoundaryElementBox
from haptix.model.finger import MeasuredRoughness
from haptix.model.surface import MeasuredPoints, MeasuringJob
from haptix.plan.planning import plan_scene

FINGER = Finger(
    name="gel",
    roughness=MeasuredRoughness.of(RoughnessSpectrum.self_affine(1e-6, 0.8, 4.5e4, 9e4, 3.6e5), ""),
)
SCREEN = Screen(insulator_thickness_m=8e-6, max_voltage_v=150.0)
BOX = BoundaryElementBox(points=64, surfaces=2, q_high_per_m=3.6e5)
SCENE = {"normal_force_n": (0.5, 1.0), "frequency_hz": 125.0}
POINTS = MeasuredPoints(forces=3, drives=2, axis_values=1, band="box")

pytestmark = pytest.mark.filterwarnings(
    "ignore::haptix.model.contact.boundary_elements.ResolutionWarning"
)


def model() -> ContactModel:
    return ContactModel(FINGER, SCREEN, fidelity="boundary-element", boundary_elements=BOX)


@pytest.fixture(scope="module")
def exact() -> ContactModel:
    return model()


@pytest.fixture(scope="module")
def surface(exact: ContactModel) -> FrictionSurface:
    return FrictionSurface.measured(MeasuringJob(exact, SCENE, POINTS), 5e-3)


def test_it_gives_what_was_measured(exact: ContactModel, surface: FrictionSurface) -> None:
    found = surface.info["boundary_elements"]
    for place, voltages, frictions in zip(
        found["places"], found["voltage_v"], found["mu"], strict=True
    ):
        force = place["normal_force_n"]
        mu = surface.mu(force, torch.tensor(voltages), 125.0)
        # The surface follows its prior to 5e-3, and that is corrected.
        torch.testing.assert_close(mu, torch.tensor(frictions, dtype=mu.dtype), rtol=0.02, atol=0)
        assert frictions == exact.solve(force, torch.tensor(voltages), 125.0).mu.tolist()
    assert len(found["ratio"]) == 3
    assert len(found["relative_scatter"][0]) == 2
    assert surface.info["model"]["fidelity"] == "boundary-element"


def test_friction_rises_along_every_column(surface: FrictionSurface) -> None:
    assert bool((surface.mu_table.diff(dim=-1) >= 0).all())
    back = surface.voltage(surface.mu(0.7, 60.0, 125.0), 0.7, 125.0)
    assert float(back.voltage_v) == pytest.approx(60.0, rel=1e-9)


def test_the_ratio_is_carried_over_to_the_whole_band(
    exact: ContactModel, surface: FrictionSurface
) -> None:
    job = MeasuringJob(exact, SCENE, MeasuredPoints(forces=1, drives=2, axis_values=1))
    whole = FrictionSurface.measured(job, 5e-3)
    ratio = whole.info["boundary_elements"]["ratio"]
    prior = FrictionSurface.build(job.mean_field("finger"), SCENE, 5e-3)
    assert float(whole.mu(0.6, 0.0, 125.0) / prior.mu(0.6, 0.0, 125.0)) == pytest.approx(
        ratio[0][0], rel=1e-9
    )


def test_an_interrupted_build_resumes(surface: FrictionSurface, tmp_path: Path) -> None:
    job = MeasuringJob(model(), SCENE, POINTS)
    kept = tmp_path / "kept.npz"

    def stop_half_way(share: float) -> None:
        if 0.6 < share < 0.9:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        FrictionSurface.measured(job, 5e-3, stop_half_way, checkpoint=kept)
    assert kept.exists()
    fresh = model()
    solved: list[float] = []
    fresh.solver.fidelity.on_progress = solved.append  # type: ignore[attr-defined]
    again = FrictionSurface.measured(MeasuringJob(fresh, SCENE, POINTS), 5e-3, checkpoint=kept)
    assert solved == [1.0]  # the last of three columns
    torch.testing.assert_close(again.table.columns, surface.table.columns, rtol=0, atol=0)
    assert again.info == surface.info


def test_it_is_saved_and_known_by_its_model(
    exact: ContactModel, surface: FrictionSurface, tmp_path: Path
) -> None:
    surface.save(tmp_path / "a.surface")
    found = FrictionSurface.load(tmp_path / "a.surface", exact)
    assert found.info["boundary_elements"] == surface.info["boundary_elements"]


def test_time_is_estimated_and_nonsense_refused(exact: ContactModel) -> None:
    job = MeasuringJob(exact, SCENE)
    assert job.states == 9
    assert 0 < job.estimated_seconds() < 600
    with pytest.raises(InputError, match=r'model: .*"boundary-element"'):
        MeasuringJob(ContactModel(FINGER, SCREEN), SCENE)
    with pytest.raises(InputError, match=r"drives: .*from 2"):
        MeasuredPoints(drives=1)
    with pytest.raises(InputError, match=r"band: expected"):
        MeasuredPoints(band="all")


@pytest.mark.slow
def test_a_scene_may_ask_for_it() -> None:
    scene = Scene(
        finger=FINGER,
        screen=SCREEN,
        normal_force_n=(0.5, 1.0),
        drive={"scheme": "direct", "frequency_hz": 125.0},
        override={"fidelity": "boundary-element"},
    )
    plan = plan_scene(scene, points=50)
    assert plan.model.fidelity == "boundary-element"
    assert "finite-size" not in plan.model.terms
    kept = {row.name: row.kept for row in plan.rows if row.kind == "fidelity"}
    assert kept == {"mean-field": True}
