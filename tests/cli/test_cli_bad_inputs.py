"""What a person may get wrong: one sentence, exit code 2, and nothing written."""

import re

import pytest
import torch
from safetensors.torch import save_file

QUERY = ("query", "--normal-force-n", "0.5", "--voltage-v", "10")
DEMO = ("demo", "--out", "out", "--image", "photo.png", "--trajectory", "short.csv")


def query(force="0.5", voltage="10", *more):
    return ("query", "--normal-force-n", force, "--voltage-v", voltage, *more)


def build(*more):
    return ("build", "new.surface", *more)


# Arguments, and a pattern that the sentence must match. SURFACE stands for a good surface.
WRONG = {
    "negative force": (query("-0.2"), "normal-force-n.*-0.2"),
    "no force": (query("0"), "normal-force-n.*above 0"),
    "NaN force": (query("nan"), "normal-force-n.*nan"),
    "infinite force": (query("inf"), "normal-force-n.*inf"),
    "negative voltage": (query("0.5", "-1"), "voltage-v.*-1"),
    "NaN voltage": (query("0.5", "nan"), "voltage-v.*nan"),
    "text as force": (query("light"), "--normal-force-n.*'light'"),
    "another unit": (query("500 mV"), "--normal-force-n.*unit N.*'500 mV'"),
    "a decimal comma": (build("--voltage-v", "0,4"), "--voltage-v.*point: 0.4"),
    "empty list": (query(""), "--normal-force-n"),
    "only a comma": (query(","), "--normal-force-n"),
    "trailing comma": (query("0.5,"), "--normal-force-n.*'0.5,'"),
    "blanks between": (query("0.5 0.6"), "--normal-force-n"),
    "text as voltage": (query("0.5", "10,high"), "--voltage-v.*'10,high'"),
    "voltage over the screen's limit": (query("0.5", "0,201"), "201 V.*limit of 200 V"),
    "over another screen's limit": (
        query("0.5", "121", "--screen", "fragile.toml"),
        "121 V.*limit of 120 V.*fragile",
    ),
    "no frequency": (query("0.5", "10", "--frequency-hz", "0"), "frequency-hz"),
    "text as frequency": (query("0.5", "10", "--frequency-hz", "4k"), "--frequency-hz.*'4k'"),
    "no thickness": (query("0.5", "10", "--h0-m", "0"), "h0-m"),
    "unknown finger": ((*QUERY, "--finger", "nobody"), "'nobody'.*semi-wet.*wet"),
    "unknown screen": ((*QUERY, "--screen", "ipad"), "'ipad'.*3m-sct3250"),
    "missing TOML": ((*QUERY, "--finger", "missing.toml"), r"missing\.toml"),
    "no TOML": ((*QUERY, "--finger", "not.toml"), r"not\.toml.*TOML"),
    "unknown key": ((*QUERY, "--finger", "unknown.toml"), "colour"),
    "value out of range": ((*QUERY, "--screen", "negative.toml"), "max_voltage_v.*-3"),
    "later TOML": ((*QUERY, "--screen", "later.toml"), r"later\.toml.*schema_version"),
    "missing surface": ((*QUERY, "--surface", "missing.surface"), r"missing\.surface"),
    "text as surface": ((*QUERY, "--surface", "text.surface"), r"text\.surface"),
    "empty surface": ((*QUERY, "--surface", "empty.surface"), r"empty\.surface"),
    "foreign surface": ((*QUERY, "--surface", "foreign.surface"), r"foreign\.surface"),
    "damaged surface": ((*QUERY, "--surface", "damaged.surface"), r"damaged\.surface.*damaged"),
    "truncated surface": ((*QUERY, "--surface", "truncated.surface"), r"truncated\.surface"),
    "folder as surface": ((*QUERY, "--surface", "."), "surface"),
    "voltage over the surface's limit": (
        query("0.5", "201", "--surface", "SURFACE"),
        "201 V.*limit of 200 V",
    ),
    "NaN on a surface": (query("nan", "10", "--surface", "SURFACE"), "normal-force-n"),
    "frequency on a surface without": (
        query("0.5", "10", "--surface", "SURFACE", "--frequency-hz", "4000"),
        "frequency_hz.*without",
    ),
    "invert nothing": (("invert", "SURFACE", "--mu", "", "--normal-force-n", "0.5"), "--mu"),
    "invert NaN": (("invert", "SURFACE", "--mu", "nan", "--normal-force-n", "0.5"), "mu.*finite"),
    "invert text": (("invert", "SURFACE", "--mu", "x", "--normal-force-n", "0.5"), "--mu.*'x'"),
    "invert at no force": (("invert", "SURFACE", "--mu", "0.3", "--normal-force-n", "0"), "force"),
    "invert with a frequency": (
        *[("invert", "SURFACE", "--mu", "0.3", "--normal-force-n", "1", "--frequency-hz", "9")],
        "frequency_hz.*without",
    ),
    "invert a missing surface": (
        ("invert", "missing.surface", "--mu", "0.3", "--normal-force-n", "0.5"),
        r"missing\.surface",
    ),
    "reversed range": (build("--normal-force-n", "1,0.1"), r"normal.force.n.*\(1\.0, 0\.1\)"),
    "three values for a range": (build("--normal-force-n", "0.1,0.5,1"), "LOW,HIGH.*0.1,0.5,1"),
    "text for a range": (build("--normal-force-n", "some"), "--normal-force-n.*'some'"),
    "NaN in a range": (build("--frequency-hz", "nan,4000"), "frequency.hz.*nan"),
    "zero in a range": (build("--h0-m", "0,1e-7"), "h0.m"),
    "no tolerance": (build("--tolerance", "0"), "tolerance.*above 0"),
    "negative tolerance": (build("--tolerance", "-0.1"), "tolerance"),
    "NaN tolerance": (build("--tolerance", "nan"), "tolerance"),
    "text for a tolerance": (build("--tolerance", "small"), "tolerance.*number in mu.*'small'"),
    "no size": (build("--largest-mb", "0"), "largest-mb.*above 0"),
    "--out without a scene": (build("--out", "b.surface"), "--out goes with a scene"),
    "missing scene": (("build", "missing.toml"), r"missing\.toml"),
    "a scene and a range": (("build", "not.toml", "--h0-m", "1e-7"), "--h0-m: a scene says"),
    "build over the limit": (build("--voltage-v", "201"), "201 V.*limit of 200 V"),
    "build over a file's limit": (
        build("--voltage-v", "130", "--screen", "fragile.toml"),
        "130 V.*limit of 120 V",
    ),
    "build for no voltage": (build("--voltage-v", "0"), "voltage.v"),
    "build for a word": (build("--voltage-v", "high"), "--voltage-v: expected a number.*150 V"),
    "build for NaN": (build("--voltage-v", "nan"), "voltage.v"),
    "build onto a file": (("build", "file"), "file exists.*--overwrite"),
    "build onto a folder": (("build", "."), "is a folder"),
    "build below a file": (
        ("build", "file/a.surface", "--normal-force-n", "0.5"),
        r"file/a\.surface",
    ),
    "demo of text": ((*DEMO, "--image", "text.png"), r"text\.png"),
    "demo of nothing": ((*DEMO, "--image", "missing.png"), r"missing\.png"),
    "demo without a path": ((*DEMO, "--trajectory", "empty.csv"), r"empty\.csv"),
    "demo of a missing path": ((*DEMO, "--trajectory", "missing.csv"), r"missing\.csv"),
    "demo backwards": ((*DEMO, "--trajectory", "backwards.csv"), "t_s.*increasing"),
    "demo into a file": ((*DEMO, "--out", "file"), "file"),
    "demo of no width": ((*DEMO, "--width-mm", "0"), "width.mm"),
    "demo of half a unit": ((*DEMO, "--carrier-hz", "4k"), "--carrier-hz.*20 kHz.*'4k'"),
    "demo of no carrier": ((*DEMO, "--carrier-hz", "0"), "at least 1000"),
    "demo of a fast carrier": ((*DEMO, "--carrier-hz", "20000"), "quarter.*20000"),
    "demo of a polarity": ((*DEMO, "--polarity", "up"), "polarity.*bright-high"),
    "demo of a finger": ((*DEMO, "--finger", "nobody"), "'nobody'"),
}


def contents(folder):
    return {p.relative_to(folder): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


def bad_surfaces(folder, good):
    data = bytearray(good.read_bytes())
    (folder / "truncated.surface").write_bytes(data[:-20])
    data[-3] ^= 0xFF  # within the numbers
    (folder / "damaged.surface").write_bytes(data)
    save_file({"mu": torch.ones(3)}, folder / "foreign.surface")


@pytest.mark.parametrize("name", WRONG)
def test_one_sentence_and_nothing_written(haptix_cli, things, surface_file, name):
    arguments, pattern = WRONG[name]
    bad_surfaces(things, surface_file)
    before = contents(things)
    shown = haptix_cli(*(surface_file if a == "SURFACE" else a for a in arguments))
    assert shown.code == 2
    assert shown.out == ""
    # A progress bar that had begun ends in its elapsed time, and is no message.
    lines = [s for s in shown.err.splitlines() if s.strip() and not re.search(r"\d:\d\d:\d\d$", s)]
    (sentence,) = lines
    assert sentence.startswith("haptix: ")
    assert re.search(pattern, sentence)
    assert contents(things) == before
    assert not (things / "out").exists()


@pytest.mark.parametrize(
    "arguments",
    [
        ("frobnicate",),
        ("query",),
        ("query", "--normal-force-n", "0.5"),
        ("build",),
        (*QUERY, "--colour", "red"),
        (*DEMO, "extra"),
    ],
)
def test_a_wrong_command_line(haptix_cli, things, arguments):
    before = contents(things)
    shown = haptix_cli(*arguments)
    assert shown.code == 2
    assert shown.out == ""
    assert "--help" in shown.err
    assert "Traceback" not in shown.err
    assert contents(things) == before


@pytest.mark.parametrize("name", ["unknown.toml", "negative.toml"])
def test_a_wrong_value_in_a_file_names_the_file(haptix_cli, things, name):
    option = "--screen" if name == "negative.toml" else "--finger"
    assert name in haptix_cli(*QUERY, option, name).err


def test_an_absent_axis_is_explained_in_words_of_the_command_line(haptix_cli, surface_file):
    shown = haptix_cli(*query("0.5", "10", "--surface", surface_file, "--frequency-hz", "4000"))
    assert "None" not in shown.err


@pytest.mark.parametrize("force", ["1e-300", "1e300"])
def test_forces_beyond_all_fingers_are_no_crash(haptix_cli, force):
    shown = haptix_cli(*query(force))
    assert shown.code == 2
    assert shown.err.startswith("haptix: ")
    assert "force" in shown.err


def test_overwriting_a_folder_is_refused(haptix_cli, things):
    before = contents(things)
    shown = haptix_cli("build", ".", "--overwrite", "--normal-force-n", "0.5")
    assert shown.code == 2
    assert "haptix: " in shown.err
    assert contents(things) == before


def test_a_place_that_cannot_be_written_is_noticed_before_the_work(haptix_cli, things, monkeypatch):
    from haptix.surface import FrictionSurface

    def working(*arguments, **options):
        pytest.fail("a surface was built that cannot be written")

    monkeypatch.setattr(FrictionSurface, "build", working)
    assert haptix_cli("build", "file/a.surface").code == 2


@pytest.mark.parametrize("arguments", [build("--tolerance", "0"), (*DEMO, "--image", "text.png")])
def test_a_pipe_gets_the_sentence_alone(haptix_cli, things, arguments):
    shown = haptix_cli(*arguments)
    assert len(shown.err.splitlines()) == 1
