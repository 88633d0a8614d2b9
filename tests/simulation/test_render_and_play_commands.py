"""``haptix render`` and ``haptix play``, and what a person may get wrong with them."""

import json
import re
import warnings

import numpy as np
import pytest
import soundfile

from firmware_io import PlaybackStats
from haptix.errors import OverloadWarning

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


BOTH = {
    "no reaction": ((*SMALL, "--reaction-ms", "-1"), "reaction-ms.*-1"),
    "both carriers": (
        ("--trajectory", "path.csv", "--carrier-hz", "4000", "--direct-hz", "100"),
        "--carrier-hz or --direct-hz, got both",
    ),
    "a photograph without its JSON": (
        (*SMALL, "--image", "photo.png"),
        r"photo\.png.*photo\.json.*--width-mm",
    ),
    "no photograph": ((*SMALL, "--image", "missing.png", "--width-mm", "60"), r"missing\.png"),
    "no width": ((*SMALL, "--image", "photo.png", "--width-mm", "0"), "--width-mm.*at least 0.1"),
    "no path": (("--trajectory", "missing.csv"), r"missing\.csv"),
    "a path backwards": (("--trajectory", "backwards.csv"), "t_s.*increasing"),
    "no surface": (("--trajectory", "path.csv", "--surface", "missing.surface"), r"missing\.surf"),
    "text as a surface": (("--trajectory", "path.csv", "--surface", "text.surface"), "text"),
    "three ends of a range": ((*SMALL, "--mu-range", "0.2,0.3,0.4"), "LOW,HIGH.*0.2,0.3,0.4"),
    "a range backwards": ((*SMALL, "--mu-range", "0.3,0.2"), r"mu-range.*0\.3, 0\.2"),
    "nobody's finger": ((*SMALL, "--finger", "nobody"), "'nobody'.*semi-wet"),
    "no screen": ((*SMALL, "--screen", "ipad"), "'ipad'.*3m-sct3250"),
    "a waveform": (
        ("--trajectory", "path.csv", "--direct-hz", "100", "--waveform", "saw"),
        "'saw'",
    ),
    "a carrier too fast": (("--trajectory", "path.csv", "--carrier-hz", "20000"), "quarter.*20000"),
    "no such device": ((*SMALL, "--device", "tape:"), "tape:"),
    "an option of the mock": ((*SMALL, "--device", "mock:colour=red"), "colour.*keys"),
}
RENDER = {
    "no rate of touches": ((*SMALL, "--touch-hz", "0"), "touch-hz.*at least 1"),
    "touches before they are": ((*SMALL, "--touch-latency-ms", "-1"), "latency-ms.*at least 0"),
    "a file as the folder": ((*SMALL, "--out", "file"), "--out.*file"),
}
PLAY = {
    "no time to react": (
        (*SMALL, "--device", "mock:pace=real", "--reaction-ms", "0.5"),
        r"reaction_s.*0\.0005",
    ),
    "a horizon of seconds": (
        (*SMALL, "--device", "mock:pace=real", "--horizon-ms", "2000"),
        "horizon_s.*2",
    ),
}


@pytest.mark.parametrize(
    ("command", "name"),
    [(command, name) for command in ("render", "play") for name in BOTH]
    + [("render", name) for name in RENDER]
    + [("play", name) for name in PLAY],
)
def test_one_sentence_and_exit_code_2(haptix_cli, own_folder, command, name):
    arguments, pattern = {**BOTH, **RENDER, **PLAY}[name]
    if command == "play" and "--device" not in arguments:
        arguments = (*arguments, "--device", "mock:pace=real")
    before = {file.name for file in own_folder.iterdir()}
    done = haptix_cli(command, *arguments)
    assert done.code == 2
    assert done.out == ""
    said = " ".join(done.err.split())
    assert re.search(pattern, said), said
    assert said.startswith("haptix: ")
    assert "Traceback" not in said
    assert {file.name for file in own_folder.iterdir()} == before


def test_only_a_mock_can_be_felt(haptix_cli, own_folder, monkeypatch):
    monkeypatch.setattr("haptix.tasks.strokes.OfPath.built", pytest.fail)  # told before
    done = haptix_cli("render", *SMALL, "--device", "usb:")
    assert done.code == 2
    assert re.search("expected a mock device.*usb:", " ".join(done.err.split()))
    assert not (own_folder / "haptix-render").exists()
