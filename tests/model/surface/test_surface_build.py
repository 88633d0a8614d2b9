"""What a surface is built for, and what is refused before the work begins."""

import math
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from haptix import ContactModel, Finger, FrictionSurface, InputError, LimitError, Screen, Status
from haptix.base import version
from haptix.base.errors import ToleranceError
from haptix.model.finger import Roughness
from haptix.model.surface import Tolerance, build, cached_surface, surface_key
from haptix.model.surface.axes import read_ranges

SMALL = {"normal_force_n": (0.4, 0.5), "voltage_v": (0.0, 100.0)}

BAD: dict[str, tuple[dict[str, Any], str]] = {
    "reversed": ({"normal_force_n": (1.0, 0.1)}, "normal_force_n.*low <= high"),
    "reversed voltage": ({"voltage_v": (100.0, 50.0)}, "voltage_v.*low <= high"),
    "NaN": ({"h0_m": (math.nan, 1e-7)}, "h0_m.*finite"),
    "infinite": ({"frequency_hz": (10.0, math.inf)}, "frequency_hz.*finite"),
    "zero force": ({"normal_force_n": (0.0, 1.0)}, "normal_force_n.*above 0"),
    "negative voltage": ({"voltage_v": (-1.0, 100.0)}, "voltage_v.*0 or more"),
    "no voltage": ({"voltage_v": (0.0, 0.0)}, "voltage_v.*above 0 V"),
    "unknown": ({"force": (0.1, 1.0)}, "unknown range force.*normal_force_n"),
    "three values": ({"normal_force_n": (0.1, 0.5, 1.0)}, "normal_force_n.*one value"),
    "text": ({"h0_m": "thin"}, "h0_m.*'thin'"),
    "force None": ({"normal_force_n": None}, "expected a range"),
    "voltage None": ({"voltage_v": None}, "expected a range"),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_ranges(model: ContactModel, name: str) -> None:
    scene, sentence = BAD[name]
    with pytest.raises(InputError, match=sentence):
        FrictionSurface.build(model, scene)


def test_a_voltage_range_above_the_screens_limit(model: ContactModel) -> None:
    with pytest.raises(LimitError, match=r"200\.5 V .*200 V"):
        FrictionSurface.build(model, {"voltage_v": (0.0, 200.5)})


@pytest.mark.parametrize("bad", [0.0, -1e-3, math.nan, math.inf])
def test_impossible_tolerances(model: ContactModel, bad: float) -> None:
    with pytest.raises(InputError, match="tolerance"):
        FrictionSurface.build(model, SMALL, tolerance=bad)


def test_an_error_just_within_the_tolerance_is_met(
    model: ContactModel, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With no bytes left for a smaller one; it was refused as "reached" less than was asked for."""
    monkeypatch.setattr(build, "_FIRST_CHECK", 1e-9)  # every error is near the tolerance
    built = FrictionSurface.build(model, SMALL, tolerance=1e-3, largest_bytes=2000)
    assert built.info["tolerance_met"] is True
    assert built.info["error_max"] <= 1e-3


def test_a_tolerance_that_cannot_be_met(model: ContactModel) -> None:
    with pytest.raises(ToleranceError, match=r"2e-06 mu.*600 bytes") as caught:
        FrictionSurface.build(model, SMALL, tolerance=2e-6, largest_bytes=600)
    best = caught.value.best
    assert best.nbytes <= 600
    assert best.info["tolerance_met"] is False
    # What it says of itself is so.
    force, voltage = torch.rand(2, 500, dtype=torch.float64)
    force, voltage = 0.4 + 0.1 * force, 100 * voltage
    error = (best.mu(force, voltage) - model.solve(force, voltage).mu).abs()
    assert 2e-6 < float(error.max()) <= 1.1 * best.info["error_max"]  # a sample of others


def test_a_corner_near_pull_in_has_nodes_of_its_own() -> None:
    """Steep cells of a corner are split; those of nearly all of an axis are not."""
    nodes = {name: torch.linspace(0, 1, 11, dtype=torch.float64) for name in ("f", "h0", "drive")}
    none: Any = None
    attempt = build._Attempt(none, none, 0, torch.zeros(0), 1.0, False)
    assert attempt.split(nodes) is None
    steep = {"f": torch.arange(8), "h0": torch.tensor([0, 3])}
    split = replace(attempt, steep=steep).split(nodes)
    assert split is not None
    assert split["h0"].tolist() == pytest.approx([0, 0.05, 0.1, 0.2, 0.3, 0.35, *np.r_[4:11] / 10])
    assert len(split["f"]) == len(split["drive"]) == 11


@pytest.mark.parametrize("frequency_hz", [None, (60.0, 1000.0)])
def test_a_split_table_is_as_one_that_was_solved_at_once(
    model: ContactModel, frequency_hz: tuple[float, float] | None
) -> None:
    """Only new columns are solved after a split; an axis may be absent."""
    ranges: dict[str, Any] = {**SMALL, "h0_m": (1e-7, 2e-7)}
    if frequency_hz:
        ranges["frequency_hz"] = frequency_hz
    solver = build._Build(
        build.Sampler(model, read_ranges(model, ranges)), Tolerance.read(1e-3), 10**9
    )
    nodes = {name: solver.sampler.positions(name, 3).log() for name in solver.sampler.varying()}
    nodes["drive"] = torch.linspace(0, 0.5, 3, dtype=torch.float64)
    table, columns, _ = solver._tabulate(nodes, None)
    attempt = build._Attempt(table, columns, 0, torch.zeros(0), 1.0, False)
    split = {**nodes, "h0_m": solver.sampler.positions("h0_m", 5).log()}
    split["normal_force_n"] = solver.sampler.positions("normal_force_n", 5).log()
    once, later = (solver._tabulate(split, before)[0] for before in (None, attempt))
    assert later.columns.shape == once.columns.shape
    # Tables of attraction belong to a batch; a wrong place would be off by 1e-3 and more.
    assert torch.allclose(later.columns, once.columns, rtol=1e-5, atol=0)


@pytest.mark.slow
def test_a_surface_up_to_pull_in_is_not_made_finer_everywhere() -> None:
    """Its errors are above the tolerance near one corner only: 490,000 values without splits."""
    model = ContactModel(Finger.preset("semi-wet"), Screen.preset("3m-sct3250"))
    ranges = {"normal_force_n": (0.1, 1.0), "frequency_hz": (60.0, 1e4), "h0_m": (5e-8, 5e-7)}
    surface = FrictionSurface.build(model, ranges, "0.2 %")
    assert surface.info["tolerance_met"]
    assert surface.table.mu.numel() < 400_000


def test_no_surface_fits_into_a_few_bytes(model: ContactModel) -> None:
    with pytest.raises(ToleranceError, match="coarse") as caught:
        FrictionSurface.build(model, SMALL, tolerance=1e-3, largest_bytes=10)
    assert caught.value.best is None


@pytest.mark.parametrize(
    "tolerance", ["1e-4", "0.01 thresholds", "0.01 JND", "0.5 %", Tolerance(2e-4)]
)
def test_the_tolerance_is_kept_in_its_own_unit(model: ContactModel, tolerance: Any) -> None:
    surface = FrictionSurface.build(model, SMALL, tolerance=tolerance)
    generator = torch.Generator().manual_seed(7)
    force, voltage = torch.rand(2, 4000, dtype=torch.float64, generator=generator)
    force, voltage = 0.4 + 0.1 * force, 100 * voltage
    mu = model.solve(force, voltage).mu
    error = (surface.mu(force, voltage) - mu).abs()
    asked = Tolerance.read(tolerance)
    unit = {"mu": 1.0, "JND": 0.11 * mu, "percent of range": (mu.max() - mu.min()) / 100}
    worst = float((error / unit[asked.unit]).max())
    # The range is that of the points that were drawn, and theirs was another draw.
    assert worst <= asked.value * 1.01
    # As coarse as allowed: an order of magnitude finer would be a waste.
    assert worst > asked.value / 10


@pytest.mark.parametrize("bad", ["", "fine", "0.1 volts", "-1 %", "nan", "0 thresholds"])
def test_tolerances_that_are_none(bad: str) -> None:
    with pytest.raises(InputError, match="tolerance"):
        Tolerance.read(bad)


def test_a_voltage_range_past_pull_in_everywhere(hungry: ContactModel) -> None:
    with pytest.raises(InputError, match=r"300 V .*light contact"):
        FrictionSurface.build(
            hungry, {"normal_force_n": 0.2, "voltage_v": (300.0, 400.0), "h0_m": 5e-8}
        )


def test_breakdown_ends_a_surface() -> None:
    finger, screen = Finger.preset("semi-wet"), Screen(max_voltage_v=150.0)
    model = ContactModel(finger, screen, terms={"breakdown": True})
    scene = {"normal_force_n": (0.4, 0.8), "h0_m": (1.5e-7, 6e-7)}
    surface = FrictionSurface.build(model, scene, tolerance=1e-3)
    h0 = torch.linspace(1.5e-7, 6e-7, 50, dtype=torch.float64)[:, None]
    voltage = torch.linspace(0.0, 150.0, 151, dtype=torch.float64)
    ours, truth = surface.evaluate(0.6, voltage, None, h0), model.solve(0.6, voltage, None, h0)
    # 350 V/um times h0: 52 V at the thinnest, beyond the limit at the thickest.
    assert set(truth.status.unique().tolist()) == {int(Status.OK), int(Status.BREAKDOWN)}
    certain = (voltage / (350e6 * h0) - 1).abs() > 1e-3  # ln h0 between nodes is exact to rounding
    assert torch.equal(ours.status[certain], truth.status[certain])
    inside = truth.status == int(Status.OK)
    assert float((ours.mu - truth.mu)[inside].abs().max()) <= 1e-3
    _, high = surface.reachable(0.6, None, 2e-7)
    found = surface.voltage(torch.stack([high, 1.1 * high]), 0.6, None, 2e-7)
    assert found.status.tolist() == [int(Status.OK), int(Status.BREAKDOWN)]
    assert found.voltage_v.tolist() == pytest.approx([70.0, 70.0], rel=1e-3)  # as above


def test_no_point_inside_is_broken_down_in_a_gap_that_leaks() -> None:
    # There the breakdown voltage bends with frequency, as no other quantity of this finger does.
    screen = Screen(gap_resistivity_ohm_m=1.84e7)
    model = ContactModel(Finger.preset("dry"), screen, terms={"breakdown": True})
    scene = {"normal_force_n": 0.5, "frequency_hz": (10.0, 1e5)}
    surface = FrictionSurface.build(model, scene, tolerance="0.05 JND")
    frequency = torch.logspace(1, 5, 401, dtype=torch.float64)[:, None].clamp(10.0, 1e5)
    voltage = torch.linspace(1.0, 200.0, 200, dtype=torch.float64)
    truth = model.solve(0.5, voltage, frequency)
    ours = surface.evaluate(0.5, voltage, frequency)
    assert int(Status.BREAKDOWN) in truth.status
    ends = truth.breakdown_voltage_v.expand_as(voltage * frequency)
    certain = (voltage / ends - 1).abs() > 0.012  # 1 % is what a build holds at its own points
    assert torch.equal(ours.status[certain], truth.status[certain])


def test_a_narrow_axis_is_one_point(model: ContactModel) -> None:
    force = 0.5
    scene = {"normal_force_n": (force, math.nextafter(force, 1.0)), "h0_m": (2e-7, 2.000001e-7)}
    surface = FrictionSurface.build(model, scene, tolerance=1e-3)
    assert not any(axis.varies for axis in surface.table.axes)
    expected = float(model.solve(force, 100.0, h0_m=2e-7).mu)
    single = surface.to(torch.float32)
    for one in (surface, single):
        assert float(one.mu(force, 100.0)) == pytest.approx(expected, abs=1e-3)  # the tolerance


@pytest.mark.slow
def test_a_size_that_only_a_coarser_grid_fits(model: ContactModel) -> None:
    scene = {"normal_force_n": (0.1, 1.0), "frequency_hz": (60.0, 1e4), "voltage_v": (0.0, 150.0)}
    with pytest.raises(ToleranceError, match="reached") as caught:
        FrictionSurface.build(model, scene, tolerance=1e-6, largest_bytes=1500)
    best = caught.value.best
    assert best is not None
    assert best.nbytes <= 1500


@pytest.mark.parametrize(
    ("scene", "options", "sentence"),
    [
        ({"normal_force_n": (True, 1.0)}, {}, "normal_force_n"),
        ({"normal_force_n": ("0.1", "1.0")}, {}, "normal_force_n"),
        (0.5, {}, "scene: expected a scene or ranges by name"),
        (SMALL, {"tolerance": True}, "tolerance: expected a number"),
        (SMALL, {"notes": {"made by": object()}}, "notes: expected plain values"),
        (SMALL, {"notes": {"limit": math.inf}}, "notes: expected plain values"),
    ],
)
def test_what_is_no_range_tolerance_or_note(
    model: ContactModel, scene: Any, options: Any, sentence: str
) -> None:
    with pytest.raises(InputError, match=sentence):
        FrictionSurface.build(model, scene, **options)


def test_ranges_may_be_arrays(model: ContactModel) -> None:
    scene = {"normal_force_n": np.array([0.4, 0.5]), "voltage_v": torch.tensor([0.0, 100.0])}
    surface = FrictionSurface.build(model, scene, tolerance=1e-3)
    assert surface.info["ranges"]["normal_force_n"] == (0.4, 0.5)


def test_a_build_that_is_stopped_leaves_nothing(
    model: ContactModel, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HAPTIX_CACHE", str(tmp_path))

    def stop(share: float) -> None:
        if share > 0.5:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        cached_surface(model, SMALL, 1e-3, stop)
    assert list(tmp_path.iterdir()) == []


def test_progress_rises_to_the_end(model: ContactModel) -> None:
    seen: list[float] = []
    FrictionSurface.build(model, SMALL, tolerance=1e-4, on_progress=seen.append)
    assert seen[-1] == 1.0
    assert len(seen) > 2  # it was refined
    assert seen == sorted(seen)
    assert all(0 <= share <= 1 for share in seen)


def test_defaults_of_a_scene(model: ContactModel) -> None:
    ranges = FrictionSurface.build(model, tolerance=2e-2).info["ranges"]
    assert ranges == {
        "normal_force_n": (0.1, 1.0),
        "voltage_v": (0.0, 200.0),
        "frequency_hz": None,
        "h0_m": (1e-6 / 8, 1e-6 / 8),
    }


def test_single_values_are_axes_that_do_not_vary(model: ContactModel) -> None:
    scene = {"normal_force_n": 0.5, "voltage_v": (0.0, 100.0), "frequency_hz": 125.0}
    surface = FrictionSurface.build(model, scene, tolerance=1e-3)
    assert not any(axis.varies for axis in surface.table.axes)
    expected = model.solve(0.5, 60.0, 125.0).mu
    for mu in (surface.mu(0.5, 60.0, 125.0), surface.mu(None, 60.0)):
        assert float(mu) == pytest.approx(float(expected), abs=1e-3)  # the tolerance


def test_the_same_inputs_give_the_same_surface(model: ContactModel, tmp_path: Path) -> None:
    first = FrictionSurface.build(model, SMALL, tolerance=1e-3)
    # Another model, which has been asked for other things before.
    again = ContactModel(Finger.preset("semi-wet"), Screen.preset("3m-sct3250"))
    second = FrictionSurface.build(again, SMALL, tolerance=1e-3)
    assert first.info["key"] == second.info["key"]
    # The tables have their nodes on one lattice, whatever was asked before.
    torch.testing.assert_close(first.mu_table, second.mu_table, rtol=1e-12, atol=0)
    fresh = [ContactModel(Finger.preset("semi-wet"), Screen.preset("3m-sct3250")) for _ in "ab"]
    for number, one in enumerate(fresh):
        FrictionSurface.build(one, SMALL, tolerance=1e-3).save(tmp_path / str(number))
    assert (tmp_path / "0").read_bytes() == (tmp_path / "1").read_bytes()


def test_the_key_tells_apart_all_that_decides_the_numbers(model: ContactModel) -> None:
    finger, screen = model.finger, model.screen
    keys = [
        surface_key(model, SMALL, 1e-3),
        surface_key(model, SMALL, 2e-3),
        surface_key(model, {**SMALL, "h0_m": 1e-7}, 1e-3),
        surface_key(ContactModel(finger.replace(layer_thickness_m=1e-4), screen), SMALL, 1e-3),
        surface_key(ContactModel(finger, screen.replace(max_voltage_v=150.0)), SMALL, 1e-3),
        surface_key(ContactModel(finger, screen, contact_spots="included"), SMALL, 1e-3),
        surface_key(ContactModel(finger, screen, gap_distribution="plain"), SMALL, 1e-3),
    ]
    assert len(set(keys)) == len(keys)
    assert surface_key(ContactModel(finger, screen), dict(reversed(SMALL.items())), 1e-3) == keys[0]


def test_the_key_tells_apart_the_code_of_the_model(
    model: ContactModel, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    unread = shutil.ignore_patterns("__pycache__", "gallery")
    shutil.copytree(version._ROOT / "haptix", tmp_path / "haptix", ignore=unread)
    monkeypatch.setattr(version, "_ROOT", tmp_path)

    def key_after(changed: str) -> str:
        with (tmp_path / "haptix" / changed).open("a") as file:
            file.write("\n")
        version.code_digest.cache_clear()
        return surface_key(model, SMALL, 1e-3)

    decides = (
        "model/contact/persson.py", "model/electro/attraction.py", "model/friction/solver.py",
        "model/terms.py", "model/perception/thresholds.toml", "base/native/haptix_contact.c",
    )  # fmt: skip
    keys = [key_after(file) for file in decides]
    assert len(set(keys)) == len(keys)
    assert key_after("studio/static/app.js") == key_after("service/front/rest.py") == keys[-1]
    version.code_digest.cache_clear()


def test_the_cache_finds_mends_and_survives(
    model: ContactModel, tmp_path: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HAPTIX_CACHE", str(tmp_path / "cache"))
    built, found = cached_surface(model, SMALL, 1e-3)
    assert not found
    again, found = cached_surface(model, SMALL, 1e-3)
    assert found
    assert torch.equal(again.mu_table, built.mu_table)
    (entry,) = (tmp_path / "cache").rglob("*.surface")
    entry.write_bytes(entry.read_bytes()[:-10])
    mended, found = cached_surface(model, SMALL, 1e-3)
    assert not found
    assert torch.equal(mended.mu_table, built.mu_table)
    assert cached_surface(model, SMALL, 1e-3)[1]
    # A cache that cannot be written: its folder is a file.
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("HAPTIX_CACHE", str(tmp_path / "file"))
    without, found = cached_surface(model, SMALL, 1e-3)
    assert not found
    assert torch.equal(without.mu_table, built.mu_table)


SMOOTH = Roughness(h_rms_m=1e-6, q0_per_m=1e3, q_rolloff_per_m=1e4, q1_per_m=1e7)


def smooth_skin() -> ContactModel:
    """Insulators a tenth as thick as the skin is rough: there boundary elements were solved."""
    finger = Finger.preset("semi-wet")
    return ContactModel(finger.replace(roughness=SMOOTH, frictional_shear_stress_pa=2e5), Screen())


def test_a_surface_has_the_intervals_of_its_cells(tmp_path: Path) -> None:
    model = smooth_skin()
    # Loads below x = 1e-4 were not shown: a part of the cells.
    scene = {"normal_force_n": (0.003, 0.1), "voltage_v": (0.0, 3.0), "h0_m": (8e-9, 4e-8)}
    built = FrictionSurface.build(model, scene, tolerance=1e-2, past_limits=True)
    built.save(tmp_path / "a.surface")
    surface = FrictionSurface.load(tmp_path / "a.surface")
    draw = torch.Generator().manual_seed(3)
    share = torch.rand(2, 200, generator=draw, dtype=torch.float64)
    force, h0 = 0.003 * 33 ** share[0], 8e-9 * 5 ** share[1]
    cells = surface.intervals(force, h0_m=h0)
    voltage = surface.highest_voltage(force, h0_m=h0)
    own = model.solve(force, voltage, h0_m=h0).accuracy
    for cell, width in ((cells.mu_jnd, own.mu), (cells.contrast_jnd, own.ratio)):
        # A cell has the wider of its ends' intervals. In between they bend by less than a fiftieth.
        assert bool((cell >= 0.98 * torch.expm1(width) / 0.11)[cell.isfinite()].all())
        assert bool((width.isinf() <= cell.isinf()).all())
        assert 0 < int(cell.isfinite().sum()) < len(cell)
    assert bool((cells.mu_jnd >= cells.contrast_jnd).all())
    finite = cells.contrast_jnd[cells.contrast_jnd.isfinite()]
    assert len(finite.unique()) > 3  # one number for each cell, not for the surface
    assert 0 < cells.interpolation_jnd < 1
    with pytest.raises(InputError, match="h0_m"):
        surface.intervals(0.01)


def test_a_surface_says_how_exact_its_theory_is() -> None:
    model = smooth_skin()
    scene = {"normal_force_n": (0.3, 0.6), "voltage_v": (0.0, 45.0), "h0_m": 1e-7}
    accuracy = FrictionSurface.build(model, scene, tolerance=1e-2).info["accuracy"]
    assert accuracy["not_shown"] == []
    # At its highest drive and no less: the interval grows with mu(V)/mu(0).
    at_end = model.solve([0.3, 0.6], 45.0, h0_m=1e-7).accuracy.record()
    assert accuracy["ratio_percent"] == pytest.approx(at_end["ratio_percent"], rel=1e-3)
    assert accuracy["mu_percent"] > accuracy["ratio_percent"] > 1


def test_a_surface_of_a_dry_finger_has_the_interval_of_spots_that_yield() -> None:
    model = ContactModel(Finger.preset("dry"), Screen.preset("3m-sct3250"))
    scene = {"normal_force_n": (0.1, 1.0), "voltage_v": (0.0, 200.0), "frequency_hz": 4000.0}
    surface = FrictionSurface.build(model, scene, tolerance=1e-2)
    cells = surface.intervals(torch.linspace(0.1, 1.0, 20))
    assert surface.info["accuracy"]["not_shown"] == []
    # The voltage adds 1 to 4 % to friction, and less than that is unknown.
    assert bool(((cells.contrast_jnd > 0) & (cells.contrast_jnd < 0.04 / 0.11)).all())
    assert bool((cells.mu_jnd < 1.5).all())
