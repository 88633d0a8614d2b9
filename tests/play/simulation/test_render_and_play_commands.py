"""``haptix render`` and ``haptix play``."""

import json
import re
import warnings

import numpy as np
import pytest
import soundfile

from firmware_io import PlaybackStats
from haptix.base.errors import OverloadWarning

SMALL = ("--trajectory", "path.csv", "--surface", "my.surface")
PHOTO = ("--image", "photo.png", "--width-mm", "60")


@pytest.mark.usefixtures("undrawn")
def test_render_leaves_its_folder_and_says_the_same(haptix_cli, own_folder):
    done = haptix_cli("render", *SMALL, *PHOTO, "--out", "out", "--json")
    assert (done.code, done.err) == (0, "")
    (row,) = json.loads(done.out)
    told = json.loads((own_folder / "out" / "summary.json").read_text())
    assert told["photograph"] == "photo.png"
    assert row["evaluation"] == told["evaluation"]
    assert row["parts"] == told["parts"]
    assert 0 < told["evaluation"]["error_p95_jnd"] < 2
    samples, rate = soundfile.read(own_folder / "out" / "drive.wav")
    assert len(samples) / rate > 0.4
    drive = json.loads((own_folder / "out" / "drive.json").read_text())
    assert np.abs(samples).max() * drive["full_scale_v"] <= 200.0


def test_render_in_words(haptix_cli, own_folder):
    done = haptix_cli("render", *SMALL, "--out", "out")
    assert (done.code, done.err) == (0, "")
    for word in (
        "finger",
        "surface",
        "modulation",
        "quantisation",
        "prediction",
        "all",
        "placeholders",
    ):
        assert word in done.out
    assert max(map(len, done.out.splitlines())) <= 80


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn")
def test_touches_that_are_later_err_more(haptix_cli, own_folder):
    def error(*options):
        assert haptix_cli("render", *SMALL, *PHOTO, "--out", "out", *options).code == 0
        told = json.loads((own_folder / "out" / "summary.json").read_text())
        return told["evaluation"]["error_rms_mu"]

    assert error("--touch-latency-ms", "60", "--touch-hz", "60") > error("--touch-latency-ms", "1")


@pytest.mark.parametrize("as_json", [True, False])
def test_play_in_real_time(haptix_cli, own_folder, steady_mock, as_json):
    options = ("--json",) if as_json else ()
    done = haptix_cli("play", *SMALL, *PHOTO, "--device", "mock:pace=real", *options)
    assert (done.code, done.err) == (0, "")
    if as_json:
        (row,) = json.loads(done.out)
        assert row["seconds"] > 0.2  # less than the 0.4 s of the path only where the machine stalls
        assert row["reaction_ms"] == 3
        assert row["revisions"] > 0
        assert row["underruns"] >= 0
    else:
        assert "underruns" in done.out
    assert not [file for file in own_folder.iterdir() if file.is_dir()]  # it leaves no folder


@pytest.mark.parametrize("as_json", [True, False])
def test_play_prints_that_the_horizon_did_not_hold(
    haptix_cli, own_folder, steady_mock, as_json, monkeypatch
):
    told = "cannot hold its horizon of 100 ms: 3 underruns"
    monkeypatch.setattr(PlaybackStats, "advice", told)
    options = ("--json",) if as_json else ()
    with warnings.catch_warnings():
        warnings.simplefilter("error", OverloadWarning)  # said in the output, not a second time
        done = haptix_cli("play", *SMALL, *PHOTO, "--device", "mock:pace=real", *options)
    assert (done.code, done.err) == (0, "")
    assert told in " ".join(done.out.split())


def test_only_a_mock_can_be_felt(haptix_cli, own_folder, monkeypatch):
    monkeypatch.setattr("haptix.tasks.strokes.OfPath.built", pytest.fail)  # told before
    done = haptix_cli("render", *SMALL, "--device", "usb:")
    assert done.code == 2
    assert re.search("expected a mock device.*usb:", " ".join(done.err.split()))
    assert not (own_folder / "haptix-render").exists()
