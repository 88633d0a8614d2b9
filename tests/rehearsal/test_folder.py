"""What a rehearsal leaves behind: the same numbers in every file, whole or not at all."""

import json

import numpy as np
import pytest
import soundfile
from skimage.io import imread

from haptix import InputError
from haptix.rehearsal import rehearse
from haptix.rehearsal.folder import summary_of, write

FILES = {"rehearsal.png", "summary.json", "felt.csv", "drive.wav"}


@pytest.fixture(scope="module")
def rehearsal(model, surface, hills, path):
    return rehearse(model, surface, hills, path)


def test_all_files_say_the_same(rehearsal, hills, tmp_path):
    written = write(tmp_path / "new" / "folder", rehearsal, hills, {"photograph": "hills"})
    assert {file.name for file in written} == FILES
    assert {file.name for file in (tmp_path / "new" / "folder").iterdir()} == FILES
    png, csv, wave, summary = (
        tmp_path / "new" / "folder" / name
        for name in ("rehearsal.png", "felt.csv", "drive.wav", "summary.json")
    )
    told = json.loads(summary.read_text(), parse_constant=pytest.fail)
    assert told["photograph"] == "hills"
    assert told["verdict"]["error_p95_mu"] == rehearsal.verdict.error_p95_mu
    assert set(told["parts"]) == set(rehearsal.parts)
    table = np.genfromtxt(csv, delimiter=",", names=True)
    np.testing.assert_allclose(table["felt_mu"], rehearsal.felt.mu, rtol=1e-8)
    np.testing.assert_allclose(table["wanted_mu"], rehearsal.wanted_mu, rtol=1e-8)
    # The error in the summary is that of the table, but for the averaging over a millisecond.
    error = np.abs(table["felt_mu"] - table["wanted_mu"])
    assert np.sqrt(np.mean(error**2)) == pytest.approx(told["verdict"]["error_rms_mu"], rel=0.1)
    samples, rate = soundfile.read(wave)
    assert rate == rehearsal.sample_rate_hz
    # Floats of 24 bits.
    np.testing.assert_allclose(
        samples * told["drive_full_scale_v"], rehearsal.played_v, atol=200 * 2.0**-24
    )
    assert len(np.unique(imread(png)[::9, ::9, :3].reshape(-1, 3), axis=0)) > 20


def test_a_path_that_cannot_be_judged_is_told_without_nan(model, surface, hills, path, tmp_path):
    still = type(path)(
        path.t_s, np.full_like(path.t_s, 9.0), np.full_like(path.t_s, 9.0), path.normal_force_n
    )
    found = rehearse(model, surface, hills, still)
    assert found.verdict.judged == 0
    write(tmp_path, found, hills, {})
    told = json.loads((tmp_path / "summary.json").read_text(), parse_constant=pytest.fail)
    assert told["verdict"]["error_rms_mu"] is None
    assert told["verdict"]["still"] == told["verdict"]["samples"]


@pytest.mark.parametrize("fails", ["draw", "np.savetxt", "soundfile.write", "json.dumps"])
def test_a_folder_is_whole_or_as_it_was(rehearsal, hills, tmp_path, monkeypatch, fails):
    drawn = iter([b"first", b"second"])
    monkeypatch.setattr(
        "haptix.rehearsal.folder.draw", lambda file, *_: file.write_bytes(next(drawn))
    )
    write(tmp_path, rehearsal, hills, {"run": 1})
    before = {file.name: file.read_bytes() for file in tmp_path.iterdir()}

    def full(*args, **options):
        raise OSError("No space left on device")

    monkeypatch.setattr(f"haptix.rehearsal.folder.{fails}", full)
    with pytest.raises(InputError, match=r"--out.*No space left"):
        write(tmp_path, rehearsal, hills, {"run": 2})
    # No drafts, and no picture of one run beside the numbers of another.
    assert {file.name: file.read_bytes() for file in tmp_path.iterdir()} == before


def test_a_folder_that_is_a_file(rehearsal, hills, tmp_path):
    (tmp_path / "file").write_text("x")
    for folder in (tmp_path / "file", tmp_path / "file" / "within"):
        with pytest.raises(InputError, match="--out"):
            write(folder, rehearsal, hills, {})
    assert (tmp_path / "file").read_text() == "x"


def test_the_summary_counts_what_was_rendered(rehearsal):
    told = summary_of(rehearsal)["renderer"]
    assert told["samples"] == rehearsal.stats.samples
    assert told["block_p50_s"] <= told["block_p99_s"] <= told["block_max_s"]
