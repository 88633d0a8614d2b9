"""What the demo writes, against what the mock driver played."""

import json

import numpy as np
import pytest
import soundfile
import torch
from scipy.ndimage import map_coordinates
from skimage.io import imread

import haptix
from haptix.base.results import folder_of

RATE, CARRIER_HZ = 48_000, 4000


def test_the_wave_is_bit_for_bit_what_was_played(demo):
    wave, rate = soundfile.read(demo.folder / "drive.wav", dtype="int16")
    assert rate == RATE
    assert soundfile.info(demo.folder / "drive.wav").subtype == "PCM_16"
    np.testing.assert_array_equal(wave, demo.device.mock.played_codes)
    assert wave[-1] == 0
    assert np.abs(wave).max() > 5000  # some 40 V at least: a drive, not silence


def test_the_sidecar_turns_the_wave_into_volts(demo):
    sidecar = json.loads((demo.folder / "drive.json").read_text())
    wave, _ = soundfile.read(demo.folder / "drive.wav", dtype="int16")
    assert sidecar["volts"] == "sample / 32767 * full_scale_v"
    np.testing.assert_array_equal(wave / 32767 * sidecar["full_scale_v"], demo.device.mock.played_v)
    assert sidecar["full_scale_v"] == 250.0
    assert sidecar["sample_rate_hz"] == RATE
    assert sidecar["carrier_hz"] == CARRIER_HZ
    assert sidecar["voltage_limit_v"] == 200.0
    assert np.abs(demo.device.mock.played_v).max() <= 200.0
    model = haptix.ContactModel(
        haptix.Finger.preset("semi-wet"), haptix.Screen.preset("3m-sct3250")
    )
    assert sidecar["model"] == model.describe()
    assert sidecar["model"]["finger"]["roughness"]["is_placeholder"] is True


def test_the_summary_is_the_result(demo):
    summary = json.loads((demo.folder / "summary.json").read_text())
    assert summary == demo.summary
    assert summary["haptix"] == haptix.__version__
    assert summary["photograph"] == str(demo.inputs / "photo.png")
    assert len(summary["placeholders"]) == 2
    assert "roughness" in summary["placeholders"][0]
    assert "dielectric" in summary["placeholders"][1]


def test_the_counts_agree_with_each_other(demo):
    summary = demo.summary
    stream, surface = summary["stream"], summary["surface"]
    # 0.1 s of path, then the device's ramp to 0 V of 5 ms.
    assert stream["samples_played"] == 4800 + 240 == demo.device.mock.samples_played
    assert stream["bytes_sent"] == demo.device.mock.bytes_received
    # Samples have 2 bytes, and frames something around them.
    assert stream["bytes_sent"] > 2 * stream["samples_played"] + 8 * stream["frames_sent"]
    # One frame a block, and at least ARM, ramp and STOP.
    assert stream["frames_sent"] >= stream["blocks"] + 3
    assert stream["blocks"] * stream["block_length_ms"] == pytest.approx(100.0)
    assert stream["faults"] == 0
    assert set(summary["out_of_range"].values()) == {0.0}
    current = summary["current"]
    assert 0 < current["rms_a"] < current["limit_rms_a"] == 0.5e-3
    assert current["rms_a"] < current["peak_a"] < current["limit_peak_a"] == 0.7e-3
    assert summary["is_surface_cached"] is False
    assert 0 < surface["error_p99_mu"] <= surface["error_max_mu"]
    assert len(surface["grid"]) == 4
    sidecar = json.loads((demo.folder / "drive.json").read_text())
    assert sidecar["surface_key"] == surface["key"]
    assert (demo.cache / folder_of(surface["key"]) / "friction.surface").is_file()


def test_the_figures_of_friction_by_another_way(demo):
    """From the wave file alone: amplitude, model, friction, and the summary's figures again."""
    wave, _ = soundfile.read(demo.folder / "drive.wav", dtype="int16")
    t = np.arange(4800) / RATE
    sine = np.sin(2 * np.pi * CARRIER_HZ * t)
    holds = np.abs(sine) > 0.4  # all samples but those where the sine is 0
    volts = wave[:4800] / 32767 * 250.0
    amplitude = np.interp(t, t[holds], volts[holds] / sine[holds])
    table = np.genfromtxt(demo.inputs / "path.csv", delimiter=",", names=True)

    def along(t, name):
        return np.interp(t, table["t_s"], table[name])

    grey = imread(demo.inputs / "photo.png").astype(float)
    dark, bright = np.percentile(grey, [1, 99])
    level = np.clip((grey - dark) / (bright - dark), 0, 1)
    model = haptix.ContactModel(
        haptix.Finger.preset("semi-wet"), haptix.Screen.preset("3m-sct3250")
    )
    load = torch.from_numpy(along(t, "normal_force_n"))
    reached = model.solve(load, torch.from_numpy(amplitude.clip(0, 200)), CARRIER_HZ).mu.numpy()
    # 0.7 mA through 150 pF in whole codes of a sample, at right angles to the amplitude's own slope
    # of 4e5 V/s.
    step_codes = 0.7e-3 / 150e-12 / RATE * 32767 / 250 // 1
    highest_v = np.sqrt((step_codes * 250 / 32767 * RATE) ** 2 - 4e5**2) / (2 * np.pi * CARRIER_HZ)
    ends = {"normal_force_n": (table["normal_force_n"].min(), table["normal_force_n"].max())}
    surface = haptix.FrictionSurface.build(model, {**ends, "frequency_hz": CARRIER_HZ}, 5e-4)

    def asked(t):
        place = [along(t, name) / 30 * 64 - 0.5 for name in ("y_mm", "x_mm")]
        share = map_coordinates(level, place, order=1, mode="nearest")
        force = torch.from_numpy(along(t, "normal_force_n"))
        low, high = (surface.mu(force, volts, CARRIER_HZ).numpy() for volts in (0.0, highest_v))
        return low + share * (high - low)

    # The drive fades in within 5 ms, and ends 1 ms after what is evaluated. Vibration is felt over
    # 1 ms.
    felt_at = np.arange(51, 990) / 10_000
    error, target = (
        np.convolve(np.interp(felt_at, t, column), np.full(10, 0.1), "valid")
        for column in (reached - asked(t), asked(t))
    )
    error = np.abs(error)

    found = demo.summary["evaluation"]
    # Both know the amplitude at every sample. The virtual finger drops what is faster than 5 kHz,
    # and holds the attraction on every gap within 1e-4 (docs/virtual-finger.md).
    slack = 0.005 * error.max() + 1e-4 * (reached.max() - reached.min())
    everywhere = asked(np.arange(1001) / 10_000)
    low_mu, high_mu = everywhere.min(), everywhere.max()
    assert demo.summary["target_mu"] == pytest.approx([low_mu, high_mu], abs=slack)
    assert found["error_rms_mu"] == pytest.approx(np.sqrt((error**2).mean()), abs=slack)
    assert found["error_p95_mu"] == pytest.approx(np.percentile(error, 95), abs=slack)
    # The largest: the drive ramps down from its last sample's -55 V, a slow voltage whose product
    # with the carrier ripples at 4 kHz. In the placeholder of a skin, which is not causal, the
    # ripple begins 5 ms before the ramp: there the summary is compared with the table alone.
    felt = np.genfromtxt(demo.folder / "felt.csv", delimiter=",", names=True)
    missed = (felt["felt_mu"] - felt["target_mu"])[51:990]
    missed = np.abs(np.convolve(missed, np.full(10, 0.1), "valid"))
    assert found["error_max_mu"] == pytest.approx(missed.max(), rel=1e-3)
    before_ramp = slice(0, 950 - 51 - 9)
    assert missed[before_ramp].max() == pytest.approx(error[before_ramp].max(), abs=slack)
    # The first 5 ms, the last one and the edges of the window are left out.
    assert found["evaluated"] / found["samples"] == pytest.approx(0.93, abs=0.01)
    jnd = error / (0.11 * target)
    assert found["error_p95_jnd"] == pytest.approx(
        np.percentile(jnd, 95), abs=slack / (0.11 * low_mu)
    )
    assert found["error_p95_jnd"] < 0.1  # far below what is felt
    assert high_mu - low_mu > 0.02  # and there was something to render


def test_the_figure_shows_something(demo):
    picture = imread(demo.folder / "demo.png")
    assert picture.shape[1] >= 800
    grey = picture[..., :3].mean(axis=-1)
    assert grey.std() > 10  # of 255
    # Photograph, friction, voltage and wave: no quarter of the page is empty.
    half = grey.shape[0] // 2, grey.shape[1] // 2
    for quarter in (grey[: half[0]], grey[half[0] :]):
        for part in (quarter[:, : half[1]], quarter[:, half[1] :]):
            assert (part < 128).mean() > 0.002
