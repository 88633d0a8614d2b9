"""The demo job again from the cache, and inputs it refuses."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import soundfile
from skimage.io import imread, imsave

import haptix
from haptix import HaptixError, InputError
from haptix.demo import DemoJob
from haptix.surface import cached_surface


def contents(folder):
    return {p.relative_to(folder): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


def test_a_second_run_takes_the_surface_from_the_cache(run, tmp_path, monkeypatch):
    monkeypatch.setenv("HAPTIX_CACHE", str(run.cache))
    again = replace(run.job, folder=tmp_path / "again").run()
    assert again.summary["surface"]["from_cache"] is True
    assert again.summary["friction"] == run.result.summary["friction"]
    for name in ("drive.wav", "drive.json"):
        assert (again.folder / name).read_bytes() == (run.result.folder / name).read_bytes()


@pytest.mark.parametrize("damage", ["garbage", "truncated", "empty", "unwritable"])
def test_a_bad_cache_changes_no_sample(run, tmp_path, private_cache, damage):
    good = run.cache / f"{run.result.summary['surface']['key']}.surface"
    if damage == "unwritable":
        private_cache.write_text("a file where the folder should be")
    else:
        private_cache.mkdir()
        data = {"garbage": b"no surface", "truncated": good.read_bytes()[:-9], "empty": b""}
        (private_cache / good.name).write_bytes(data[damage])
    again = replace(run.job, folder=tmp_path / "again").run()
    assert again.summary["surface"]["from_cache"] is False
    wave = (again.folder / "drive.wav").read_bytes()
    assert wave == (run.result.folder / "drive.wav").read_bytes()
    if damage != "unwritable":
        assert (private_cache / good.name).read_bytes() == good.read_bytes()


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
    first, *others = sorted(private_cache.glob("*.surface"))
    for other in others:
        other.write_bytes(first.read_bytes())
    for modulus in (40e6, 41e6):
        own = cached_surface(model(youngs_modulus_pa=modulus), scene, 0.05)[0]
        assert own.info["model"]["finger"]["youngs_modulus_pa"] == modulus


def test_dark_high_of_the_negative_is_the_same_drive(run, inputs, tmp_path, monkeypatch):
    monkeypatch.setenv("HAPTIX_CACHE", str(run.cache))
    imsave(tmp_path / "negative.png", 255 - imread(inputs / "photo.png"), check_contrast=False)
    job = replace(
        run.job,
        folder=tmp_path / "out",
        image=tmp_path / "negative.png",
        polarity="dark-high",
    )
    folder = job.run().folder
    a, _ = soundfile.read(folder / "drive.wav", dtype="int16")
    b, _ = soundfile.read(run.result.folder / "drive.wav", dtype="int16")
    # Levels agree up to rounding, so codes up to one.
    assert np.abs(a.astype(int) - b.astype(int)).max() <= 1


def bad_inputs(folder):
    (folder / "text.png").write_text("no picture")
    (folder / "backwards.csv").write_text("t_s,x_mm,y_mm,normal_force_n\n1,1,1,1\n0,1,1,1\n")
    imsave(folder / "flat.png", np.full((9, 9), 7, np.uint8), check_contrast=False)


BAD = {
    "missing image": {"image": Path("missing.png")},
    "text as image": {"image": Path("text.png")},
    "flat image": {"image": Path("flat.png")},
    "missing trajectory": {"trajectory": Path("missing.csv")},
    "backwards": {"trajectory": Path("backwards.csv")},
    "no width": {"width_mm": 0.0},
    "NaN width": {"width_mm": float("nan")},
    "polarity": {"polarity": "up"},
    "finger": {"finger": "nobody"},
    "screen": {"screen": "none"},
    "no carrier": {"carrier_hz": 0.0},
    "NaN carrier": {"carrier_hz": float("nan")},
    "fast carrier": {"carrier_hz": 20e3},
}


@pytest.mark.parametrize("name", BAD)
def test_a_bad_input_writes_nothing(run, tmp_path, monkeypatch, name):
    monkeypatch.chdir(tmp_path)
    bad_inputs(tmp_path)
    for folder in (tmp_path / "new", run.result.folder):
        before = contents(run.result.folder)
        with pytest.raises(HaptixError) as caught:
            replace(run.job, folder=folder, **BAD[name]).run()
        assert "\n" not in str(caught.value)
        assert not (tmp_path / "new").exists()
        assert contents(run.result.folder) == before


def test_the_output_cannot_be_a_file(run, tmp_path):
    (tmp_path / "out").write_text("precious")
    for folder in (tmp_path / "out", tmp_path / "out" / "below"):
        with pytest.raises(InputError, match="out"):
            replace(run.job, folder=folder).run()
        assert (tmp_path / "out").read_text() == "precious"


def short_path(file, duration_s, x_mm):
    header = "t_s,x_mm,y_mm,normal_force_n\n"
    file.write_text(f"{header}0,{x_mm},5,0.5\n{duration_s},{x_mm},5,0.5\n")
    return file


@pytest.mark.filterwarnings("ignore:Mean of empty slice", "ignore:invalid value encountered")
@pytest.mark.parametrize(
    ("duration_s", "carrier_hz"),
    [
        (1e-6, 4000.0),  # no sample at all
        (2e-4, 4000.0),  # samples, but no whole period
        (5e-4, 4000.0),  # two periods: none without its ends
        (0.1, 10.0),  # one period of a slow carrier
    ],
)
def test_a_path_without_three_periods(run, tmp_path, duration_s, carrier_hz):
    job = replace(
        run.job,
        folder=tmp_path / "out",
        trajectory=short_path(tmp_path / "short.csv", duration_s, 5.0),
        carrier_hz=carrier_hz,
    )
    with pytest.raises(InputError, match=r"(?i)trajectory|path|carrier"):
        job.run()
    assert not (tmp_path / "out").exists()


def test_a_path_shorter_than_the_figures_zoom(run, tmp_path):
    # Twelve periods beside the photograph: nothing is felt, so no ramp follows either.
    path = short_path(tmp_path / "short.csv", 3e-3, -1.0)
    result = replace(run.job, folder=tmp_path / "out", trajectory=path).run()
    assert len(list(result.folder.iterdir())) == 4
    assert result.summary["stream"]["samples_played"] == 144


def test_one_job_without_any_input(tmp_path):
    """The defaults are complete: photograph, path, presets."""
    job = DemoJob(tmp_path / "out")
    result = job.run()
    assert result.summary["stream"]["faults"] == 0
    assert 0 <= max(result.summary["out_of_range"].values()) <= 1
    assert result.summary["friction"]["error_p95_difference_thresholds"] < 0.1


def test_friction_out_of_reach_is_neither_judged_nor_shown_as_reachable(run, tmp_path):
    """A light finger on a slow drive comes near pull-in, and the wish goes far beyond."""
    path = tmp_path / "light.csv"
    path.write_text("t_s,x_mm,y_mm,normal_force_n\n0,2,5,0.03\n0.4,28,9,0.03\n")
    job = replace(
        run.job,
        folder=tmp_path / "out",
        trajectory=path,
        finger="wet",
        carrier_hz=200.0,
        mu_range=(0.2, 12.0),
    )
    summary = job.run().summary
    assert summary["out_of_range"]["share_above"] > 0.1
    assert summary["out_of_range"]["share_below"] > 0
    assert 0 < summary["friction"]["share_judged"] < 0.9
    # What can be reached is reached to a tenth of what is felt, but for 200 Hz sampling of edges.
    assert summary["friction"]["error_p95_difference_thresholds"] < 1.0
