"""The demo again from the cache, and inputs it refuses."""

import json
import shutil

import numpy as np
import pytest
import soundfile
from skimage.io import imread, imsave

import haptix
from haptix.base.results import folder_of
from haptix.model.surface import cached_surface


@pytest.fixture(autouse=True)
def in_private_cache(private_cache):
    """Every run has a cache of its own."""


def contents(folder):
    return {p.relative_to(folder): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


def summary_of(done, said=""):
    assert (done.code, done.err) == (0, said)
    (summary,) = json.loads(done.out)
    return summary


@pytest.mark.usefixtures("undrawn")
def test_a_second_run_takes_the_surface_from_the_cache(demo, tmp_path, monkeypatch):
    monkeypatch.setenv("HAPTIX_CACHE", str(demo.cache))
    again = summary_of(demo.again(tmp_path / "again"))
    assert again["is_surface_cached"] is True
    assert again["evaluation"] == demo.summary["evaluation"]
    for name in ("drive.wav", "drive.json", "felt.csv"):
        assert (tmp_path / "again" / name).read_bytes() == (demo.folder / name).read_bytes()


# All are refused by the same check, which reads the hash of every byte.
@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize(
    "damage",
    [
        "one bit",
        "unwritable",
        pytest.param("truncated", marks=pytest.mark.slow),
        pytest.param("garbage", marks=pytest.mark.slow),
        pytest.param("empty", marks=pytest.mark.slow),
    ],
)
def test_a_bad_cache_changes_no_sample(demo, tmp_path, private_cache, damage):
    name = f"{folder_of(demo.summary['surface']['key'])}/friction.surface"
    good = demo.cache / name
    if damage == "unwritable":
        private_cache.write_text("a file where the folder should be")
    else:
        shutil.copytree(demo.cache, private_cache)
        bit = bytearray(good.read_bytes())
        bit[-9] ^= 1
        data = {
            "one bit": bit,
            "garbage": b"no surface",
            "truncated": good.read_bytes()[:-9],
            "empty": b"",
        }
        (private_cache / name).write_bytes(data[damage])
    again = summary_of(demo.again(tmp_path / "again"))
    assert again["is_surface_cached"] is False
    wave = (tmp_path / "again" / "drive.wav").read_bytes()
    assert wave == (demo.folder / "drive.wav").read_bytes()
    if damage != "unwritable":
        assert (private_cache / name).read_bytes() == good.read_bytes()


@pytest.mark.usefixtures("undrawn")
def test_the_cache_tells_inputs_apart(private_cache):
    def model(**changes):
        finger = haptix.Finger.preset("semi-wet").replace(**changes)
        return haptix.ContactModel(finger, haptix.Screen.preset("3m-sct3250"))

    scene = {"normal_force_n": 0.5}
    _, found = cached_surface(model(), scene, 0.05)
    assert not found
    assert cached_surface(model(), scene, 0.05)[1]
    assert not cached_surface(model(), {"normal_force_n": 0.6}, 0.05)[1]
    assert not cached_surface(model(), scene, 0.04)[1]
    assert not cached_surface(model(youngs_modulus_pa=41e6), scene, 0.05)[1]
    assert cached_surface(model(), scene, 0.05)[1]
    # A surface that lies under another's key is not taken for it.
    first, *others = sorted(private_cache.glob("results/*/*/*.surface"))
    for other in others:
        other.write_bytes(first.read_bytes())
    for modulus in (40e6, 41e6):
        own = cached_surface(model(youngs_modulus_pa=modulus), scene, 0.05)[0]
        assert own.info["model"]["finger"]["youngs_modulus_pa"] == modulus


@pytest.mark.usefixtures("undrawn")
def test_dark_high_of_the_negative_is_the_same_drive(demo, tmp_path, monkeypatch):
    monkeypatch.setenv("HAPTIX_CACHE", str(demo.cache))
    negative = tmp_path / "negative.png"
    imsave(negative, 255 - imread(demo.inputs / "photo.png"), check_contrast=False)
    done = demo.again(tmp_path / "out", "--image", negative, "--polarity", "dark-high")
    assert done.code == 0
    a, _ = soundfile.read(tmp_path / "out" / "drive.wav", dtype="int16")
    b, _ = soundfile.read(demo.folder / "drive.wav", dtype="int16")
    # Levels agree up to rounding, so codes up to one.
    assert np.abs(a.astype(int) - b.astype(int)).max() <= 1


@pytest.mark.parametrize("wrong", [("--image", "flat.png"), ("--carrier-hz", "20000")])
def test_a_bad_input_leaves_an_older_result_as_it_is(demo, tmp_path, monkeypatch, wrong):
    monkeypatch.chdir(tmp_path)
    imsave(tmp_path / "flat.png", np.full((9, 9), 7, np.uint8), check_contrast=False)
    before = contents(demo.folder)
    done = demo.again(demo.folder, *wrong)
    assert (done.code, done.out) == (2, "")
    assert contents(demo.folder) == before


def test_the_output_cannot_be_a_file(demo, tmp_path):
    (tmp_path / "out").write_text("precious")
    for folder in (tmp_path / "out", tmp_path / "out" / "below"):
        done = demo.again(folder)
        assert done.code == 2
        assert "--out" in done.err
        assert (tmp_path / "out").read_text() == "precious"


def short_path(file, duration_s, x_mm):
    header = "t_s,x_mm,y_mm,normal_force_n\n"
    file.write_text(f"{header}0,{x_mm},5,0.5\n{duration_s},{x_mm},5,0.5\n")
    return file


@pytest.mark.parametrize(
    ("duration_s", "carrier_hz"),
    [
        (1e-6, 4000.0),  # no sample at all
        (2e-4, 4000.0),  # samples, but no whole period
        (5e-4, 4000.0),  # two periods
        (0.005, 1000.0),  # five periods of a slow carrier
    ],
)
def test_a_path_without_ten_periods(demo, tmp_path, duration_s, carrier_hz):
    path = short_path(tmp_path / "short.csv", duration_s, 5.0)
    done = demo.again(tmp_path / "out", "--trajectory", path, "--carrier-hz", carrier_hz)
    assert done.code == 2
    assert "trajectory: expected 10 periods or more" in done.err
    assert not (tmp_path / "out").exists()


def test_a_path_shorter_than_the_figures_zoom(demo, tmp_path):
    # Twelve periods beside the photograph: nothing is felt, so no ramp follows either.
    path = short_path(tmp_path / "short.csv", 3e-3, -1.0)
    summary = summary_of(demo.again(tmp_path / "out", "--trajectory", path))
    assert len(list((tmp_path / "out").iterdir())) == 5
    assert summary["stream"]["samples_played"] == 144
    assert summary["evaluation"]["evaluated"] == 0


@pytest.mark.slow  # the demo of all other tests runs the same code with less to simulate
def test_the_demo_without_any_input(haptix_cli, tmp_path):
    """The defaults are complete: photograph, path, presets."""
    summary = summary_of(haptix_cli("demo", "--out", tmp_path / "out", "--json"))
    assert summary["stream"]["faults"] == 0
    assert 0 <= max(summary["out_of_range"].values()) <= 1
    assert summary["evaluation"]["error_p95_jnd"] < 0.1


@pytest.mark.usefixtures("undrawn")
def test_friction_out_of_reach_is_not_evaluated(demo, tmp_path):
    """A light finger comes near pull-in, and the target goes far beyond."""
    path = tmp_path / "light.csv"
    path.write_text("t_s,x_mm,y_mm,normal_force_n\n0,2,5,0.03\n0.4,28,9,0.03\n")
    options = ("--finger", "wet", "--carrier-hz", 2500, "--mu-range", "0.2,12")
    done = demo.again(tmp_path / "out", "--trajectory", path, *options)
    summary = summary_of(done, "haptix: --mu-range: 0.2 and 12\n")
    assert summary["out_of_range"]["share_above"] > 0.1
    assert summary["out_of_range"]["share_below"] > 0
    found = summary["evaluation"]
    assert 0 < found["evaluated"] < 0.9 * found["samples"]
    assert found["unreachable"] > 0.1 * found["samples"]
    assert found["error_p95_jnd"] < 1.0
