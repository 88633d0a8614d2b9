"""What a surface is built for, and what is refused before the work begins."""

import math
from typing import Any

import pytest
import torch

import haptix.surface.build
from haptix import ContactModel, Finger, FrictionSurface, InputError, LimitError, Screen
from haptix.surface import cached_surface, surface_key

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
    with pytest.raises(LimitError, match=r"200\.5 V is above the limit of 200 V of screen"):
        FrictionSurface.build(model, {"voltage_v": (0.0, 200.5)})


@pytest.mark.parametrize("bad", [0.0, -1e-3, math.nan, math.inf])
def test_impossible_tolerances(model: ContactModel, bad: float) -> None:
    with pytest.raises(InputError, match="tolerance"):
        FrictionSurface.build(model, SMALL, tolerance=bad)


def test_a_tolerance_that_cannot_be_met(
    model: ContactModel, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(haptix.surface.build, "_MOST_VALUES", 100)
    with pytest.raises(InputError, match=r"tolerance 1e-07 cannot be met with 100 grid values"):
        FrictionSurface.build(model, SMALL, tolerance=1e-7)


def test_progress_rises_to_the_end(model: ContactModel) -> None:
    seen: list[float] = []
    FrictionSurface.build(model, SMALL, tolerance=5e-6, on_progress=seen.append)
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
    assert not any(axis.varies for axis in surface.axes)
    expected = model.solve(0.5, 60.0, 125.0).mu
    for mu in (surface.mu(0.5, 60.0, 125.0), surface.mu(None, 60.0)):
        assert float(mu) == pytest.approx(float(expected), abs=1e-3)  # the tolerance


def test_the_same_inputs_give_the_same_surface(model: ContactModel) -> None:
    first = FrictionSurface.build(model, SMALL, tolerance=1e-3)
    # Another model, which has been asked for other things before.
    again = ContactModel(Finger.preset("semi-wet"), Screen.preset("3m-sct3250"))
    second = FrictionSurface.build(again, SMALL, tolerance=1e-3)
    assert first.info["key"] == second.info["key"]
    # 1e-12: the tables have their nodes on one lattice.
    torch.testing.assert_close(first.mu_table, second.mu_table, rtol=1e-12, atol=0)


def test_the_key_tells_apart_all_that_decides_the_numbers(model: ContactModel) -> None:
    finger, screen = model.finger, model.screen
    keys = [
        surface_key(model, SMALL, 1e-3),
        surface_key(model, SMALL, 2e-3),
        surface_key(model, {**SMALL, "h0_m": 1e-7}, 1e-3),
        surface_key(ContactModel(finger.replace(layer_thickness_m=1e-4), screen), SMALL, 1e-3),
        surface_key(ContactModel(finger, screen.replace(max_voltage_v=150.0)), SMALL, 1e-3),
        surface_key(ContactModel(finger, screen, contact_spots="included"), SMALL, 1e-3),
        surface_key(ContactModel(finger, screen, gap_distribution="combined"), SMALL, 1e-3),
    ]
    assert len(set(keys)) == len(keys)
    assert surface_key(ContactModel(finger, screen), dict(reversed(SMALL.items())), 1e-3) == keys[0]


def test_the_cache_finds_mends_and_survives(
    model: ContactModel, tmp_path: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HAPTIX_CACHE", str(tmp_path / "cache"))
    built, found = cached_surface(model, SMALL, 1e-3)
    assert not found
    again, found = cached_surface(model, SMALL, 1e-3)
    assert found
    assert torch.equal(again.mu_table, built.mu_table)
    (entry,) = (tmp_path / "cache").iterdir()
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
