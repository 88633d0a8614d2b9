"""What the demo job leaves behind, against what the mock driver played."""

import json

import numpy as np
import pytest
import soundfile
import torch
from scipy.ndimage import map_coordinates
from skimage.io import imread

import haptix

RATE, CARRIER_HZ = 48_000, 4000


def test_the_folder_holds_four_files(run):
    names = {path.name for path in run.result.folder.iterdir()}
    assert names == {"demo.png", "drive.wav", "drive.json", "summary.json"}


def test_the_wave_is_bit_for_bit_what_was_played(run):
    wave, rate = soundfile.read(run.result.folder / "drive.wav", dtype="int16")
    assert rate == RATE
    assert soundfile.info(run.result.folder / "drive.wav").subtype == "PCM_16"
    np.testing.assert_array_equal(wave, run.driver.played_codes)
    assert wave[-1] == 0
    assert np.abs(wave).max() > 5000  # some 40 V at least: a drive, not silence


def test_the_sidecar_turns_the_wave_into_volts(run):
    sidecar = json.loads((run.result.folder / "drive.json").read_text())
    wave, _ = soundfile.read(run.result.folder / "drive.wav", dtype="int16")
    assert sidecar["volts"] == "sample / 32767 * full_scale_v"
    np.testing.assert_array_equal(wave / 32767 * sidecar["full_scale_v"], run.driver.played_v)
    assert sidecar["full_scale_v"] == 250.0
    assert sidecar["sample_rate_hz"] == RATE
    assert sidecar["carrier_hz"] == CARRIER_HZ
    assert sidecar["voltage_limit_v"] == 200.0
    assert np.abs(run.driver.played_v).max() <= 200.0
    model = haptix.ContactModel(
        haptix.Finger.preset("semi-wet"), haptix.Screen.preset("3m-sct3250")
    )
    assert sidecar["model"] == model.describe()
    assert sidecar["model"]["finger"]["roughness"]["is_placeholder"] is True


def test_the_summary_is_the_result(run):
    summary = json.loads((run.result.folder / "summary.json").read_text())
    assert summary == run.result.summary
    assert summary["haptix"] == haptix.__version__
    assert summary["photograph"] == str(run.job.image)
    assert len(summary["stand_ins"]) == 2
    assert "roughness" in summary["stand_ins"][0]
    assert "dielectric" in summary["stand_ins"][1]


def test_the_counts_agree_with_each_other(run):
    summary = run.result.summary
    stream, surface = summary["stream"], summary["surface"]
    # 0.1 s of path, then the device's ramp to 0 V of 5 ms.
    assert stream["samples_played"] == 4800 + 240 == run.driver.samples_played
    assert stream["bytes_sent"] == run.driver.bytes_received
    # Samples have 2 bytes, and frames something around them.
    assert stream["bytes_sent"] > 2 * stream["samples_played"] + 8 * stream["frames_sent"]
    # One frame a block, and at least ARM, ramp and STOP.
    assert stream["frames_sent"] >= stream["blocks"] + 3
    assert stream["blocks"] * stream["block_length_ms"] == pytest.approx(100.0)
    assert stream["faults"] == 0
    assert set(summary["out_of_range"].values()) == {0.0}
    assert surface["from_cache"] is False
    assert 0 < surface["error_p99_mu"] <= surface["error_max_mu"]
    assert len(surface["grid"]) == 4
    sidecar = json.loads((run.result.folder / "drive.json").read_text())
    assert sidecar["surface_key"] == surface["key"]
    assert (run.cache / f"{surface['key']}.surface").is_file()


def test_the_figures_of_friction_by_another_way(run, inputs):
    """From the wave file alone: amplitude, model, friction, and the summary's figures again."""
    wave, _ = soundfile.read(run.result.folder / "drive.wav", dtype="int16")
    volts = wave[:4800].reshape(400, 12) / 32767 * 250.0
    sine = np.sin(2 * np.pi * np.arange(12) / 12)
    amplitude = np.linalg.lstsq(sine[:, None], volts.T, rcond=None)[0][0]
    t = (12 * np.arange(400) + 5.5) / RATE
    table = np.genfromtxt(inputs / "path.csv", delimiter=",", names=True)
    x, y, force = (np.interp(t, table["t_s"], table[n]) for n in ("x_mm", "y_mm", "normal_force_n"))

    grey = imread(inputs / "photo.png").astype(float)
    dark, bright = np.percentile(grey, [1, 99])
    level = np.clip((grey - dark) / (bright - dark), 0, 1)
    share = map_coordinates(level, [y / 30 * 64 - 0.5, x / 30 * 64 - 0.5], order=1, mode="nearest")
    model = haptix.ContactModel(
        haptix.Finger.preset("semi-wet"), haptix.Screen.preset("3m-sct3250")
    )
    load = torch.from_numpy(force)
    reached = model.solve(load, torch.from_numpy(amplitude.clip(0, 200)), CARRIER_HZ).mu.numpy()
    ends = {"normal_force_n": (table["normal_force_n"].min(), table["normal_force_n"].max())}
    surface = haptix.FrictionSurface.build(model, {**ends, "frequency_hz": CARRIER_HZ}, 5e-4)
    low, high = (mu.numpy() for mu in surface.reachable(load))
    target = low + share * (high - low)
    slides = t > 0.0052  # the drive fades in within 5 ms, and these periods are not judged
    wanted, target, error = target, target[slides], np.abs(reached - target)[slides]

    friction = run.result.summary["friction"]
    # The job takes a line between control points 4 samples apart, here it is the middle of a
    # period itself: along a bilinear map they differ by curvature and corners.
    slack = 0.02 * error.max()
    assert friction["target_mu_min"] == pytest.approx(wanted.min(), abs=slack)
    assert friction["target_mu_max"] == pytest.approx(wanted.max(), abs=slack)
    assert friction["error_rms_mu"] == pytest.approx(np.sqrt((error**2).mean()), abs=slack)
    assert friction["error_p95_mu"] == pytest.approx(np.percentile(error, 95), abs=slack)
    assert friction["error_max_mu"] == pytest.approx(error.max(), abs=slack)
    assert friction["share_judged"] == pytest.approx(slides.mean(), abs=1.5 / 400)  # a period
    thresholds = error / (0.11 * target)
    assert friction["error_p95_difference_thresholds"] == pytest.approx(
        np.percentile(thresholds, 95), abs=slack / 0.02
    )
    assert friction["error_p95_difference_thresholds"] < 0.1  # what nobody can feel
    assert target.max() - target.min() > 0.02  # and there was something to render


def test_the_figure_shows_something(run):
    picture = imread(run.result.folder / "demo.png")
    assert picture.shape[1] >= 800
    grey = picture[..., :3].mean(axis=-1)
    assert grey.std() > 10  # of 255
    # Photograph, friction, voltage and wave: no quarter of the page is empty.
    half = grey.shape[0] // 2, grey.shape[1] // 2
    for quarter in (grey[: half[0]], grey[half[0] :]):
        for part in (quarter[:, : half[1]], quarter[:, half[1] :]):
            assert (part < 128).mean() > 0.002


def test_progress_goes_through_every_stage(run):
    order = list(dict.fromkeys(stage for stage, _ in run.stages))
    assert order == ["surface", "render", "judge", "write"]
    for stage in order:
        shares = [share for name, share in run.stages if name == stage]
        assert shares == sorted(shares)
        assert shares[-1] == 1.0
        assert all(0 <= share <= 1 for share in shares)
