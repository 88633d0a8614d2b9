"""What a simulation writes: the same numbers in every file, whole or not at all."""

import json
from dataclasses import replace

import numpy as np
import pytest
import soundfile
from skimage.io import imread

import haptix
from haptix import InputError
from haptix.play.simulation import simulate, summary_of, write
from haptix.play.simulation.folder import draw
from haptix.play.virtual_finger import TouchPanel

FILES = {"simulation.png", "summary.json", "felt.csv", "drive.wav", "drive.json"}


def test_all_files_say_the_same(simulation, tmp_path):
    folder = tmp_path / "new" / "folder"
    summary = write(folder, simulation, {"photograph": "hills"})
    assert {file.name for file in folder.iterdir()} == FILES
    told = json.loads((folder / "summary.json").read_text(), parse_constant=pytest.fail)
    assert told == summary
    assert told["photograph"] == "hills"
    assert told["evaluation"]["error_p95_mu"] == simulation.evaluation.error_p95_mu
    assert set(told["parts"]) == set(simulation.parts)
    table = np.genfromtxt(folder / "felt.csv", delimiter=",", names=True)
    np.testing.assert_allclose(table["felt_mu"], simulation.felt.mu, rtol=1e-8)
    np.testing.assert_allclose(table["target_mu"], simulation.target_mu, rtol=1e-8)
    # The error in the summary is that of the table, but for the averaging over a millisecond.
    error = np.abs(table["felt_mu"] - table["target_mu"])
    assert np.sqrt(np.mean(error**2)) == pytest.approx(told["evaluation"]["error_rms_mu"], rel=0.1)
    drive = json.loads((folder / "drive.json").read_text())
    samples, rate = soundfile.read(folder / "drive.wav", dtype="int16")
    assert rate == drive["sample_rate_hz"] == simulation.played.renderer.sample_rate_hz
    np.testing.assert_array_equal(
        samples / 32767 * drive["full_scale_v"], simulation.played.drive_v
    )
    pixels = imread(folder / "simulation.png")[::9, ::9, :3].reshape(-1, 3)
    assert len(np.unique(pixels, axis=0)) > 20


def test_a_path_that_cannot_be_evaluated_is_told_without_nan(setting, surface, tmp_path):
    path = setting.path
    still = haptix.Trajectory.of(path.t_s, 9.0, 9.0, path.normal_force_n)
    found = simulate(replace(setting, path=still), surface, TouchPanel())
    assert found.evaluation.evaluated == 0
    write(tmp_path, found, {})
    told = json.loads((tmp_path / "summary.json").read_text(), parse_constant=pytest.fail)
    assert told["evaluation"]["error_rms_mu"] is None
    assert told["evaluation"]["still"] == told["evaluation"]["samples"]


def test_a_picture_has_two_panels_or_a_laboratory_s_five(simulation, tmp_path):
    shapes = []
    for panels in (2, 5):
        draw(simulation, tmp_path / "picture.png", panels)
        shapes.append(imread(tmp_path / "picture.png").shape[:2])
    assert shapes == [(880, 880), (935, 1430)]  # 110 dots an inch


def test_a_folder_is_whole_or_as_it_was(simulation, tmp_path, monkeypatch):
    draw = "haptix.play.simulation.folder.draw"
    monkeypatch.setattr(draw, lambda _, file, panels: file.write_bytes(b"first"))
    write(tmp_path, simulation, {"run": 1})
    before = {file.name: file.read_bytes() for file in tmp_path.iterdir()}

    def full(_, file, panels):
        file.write_bytes(b"sec")
        raise OSError("No space left on device")

    monkeypatch.setattr(draw, full)
    with pytest.raises(InputError, match="No space left"):
        write(tmp_path, simulation, {"run": 2})
    # No drafts, and no picture of one run beside the numbers of another.
    assert {file.name: file.read_bytes() for file in tmp_path.iterdir()} == before


def test_a_folder_that_is_a_file(simulation, tmp_path):
    (tmp_path / "file").write_text("x")
    for folder in (tmp_path / "file", tmp_path / "file" / "within"):
        with pytest.raises(InputError, match="--out"):
            write(folder, simulation, {})
    assert (tmp_path / "file").read_text() == "x"


def test_a_folder_in_the_place_of_a_file(simulation, tmp_path):
    (tmp_path / "summary.json").mkdir()
    with pytest.raises(InputError, match=r"--out.*summary\.json is a folder"):
        write(tmp_path, simulation, {})
    assert [file.name for file in tmp_path.iterdir()] == ["summary.json"]


def test_the_summary_counts_what_was_rendered(simulation):
    told, stats = summary_of(simulation)["stream"], simulation.played.renderer.stats
    assert told["blocks"] * told["block_length_ms"] == pytest.approx(stats.samples / 48.0)
    assert told["block_p50_ms"] <= told["block_p99_ms"] <= told["block_max_ms"]
