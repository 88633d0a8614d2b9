"""Arguments that no command can use are refused in one sentence before torch loads."""

import sys

import pytest


@pytest.mark.parametrize(
    "arguments",
    [
        ("invert", "missing.surface", "--mu", "0.3", "--normal-force-n", "0.5"),
        ("plan", "."),
        ("build", "a.surface", "--tolerance", "0.002 N"),
        ("build", "a.surface", "--tolerance", "1e-12"),
        ("build", "a.surface", "--tolerance", "1e-12 %"),
        ("demo", "--width-mm", "1e-9"),
        ("render", "--reaction-ms", "1e6"),
        ("play", "--horizon-ms", "1e6"),
        ("build", "a.surface", "--normal-force-n", ""),
        ("export", "a" * 5000, "b.nc"),
        ("material", "show", "ribs.toml"),
        ("render", "--trajectory", "."),
        ("calibrate", "plan", "p.toml", "--finger", "mine.toml"),
        ("calibrate", "plan", "p.toml", "--screen", "ipad"),
        ("calibrate", "plan", "p.toml", "--protocol", "long"),
        ("calibrate", "run", "file", "--practice"),
        ("stimuli", "run", "missing.toml", "--log", "l.csv"),
        ("play", "--device", "tape:"),
        ("query", "--normal-force-n", "1", "--voltage-v", "1", "--theory", "mine"),
        ("demo", "--out", "file/deep"),
    ],
)
def test_words_and_files_that_are_none_are_refused_before_anything_is_read(
    haptix_cli, own_folder, monkeypatch, arguments
):
    (own_folder / "file").write_text("x")
    for name in (
        "torch",
        "haptix.model.surface.friction_surface",
        "haptix.model.friction",
        "haptix.model.finger",
        "haptix.plan.scene",
    ):
        monkeypatch.setitem(sys.modules, name, None)  # importing it would be an error
    shown = haptix_cli(*arguments)
    assert (shown.code, shown.out) == (2, "")
    assert shown.err.startswith("haptix: ")
    assert len(shown.err.splitlines()) == 1


@pytest.mark.parametrize(
    ("arguments", "kept"),
    [
        (("export", "a.surface", "a.surface", "--overwrite"), "a.surface"),
        (("build", "scene.toml", "--out", "scene.toml", "--overwrite"), "scene.toml"),
        (("build", "./mine.toml.surface", "--finger", "mine.toml", "--overwrite"), "mine.toml"),
        (("material", "show", "m.toml", "--out", "./m.toml"), "m.toml"),
        (("stimuli", "show", "s.wav", "--out", "s.wav"), "s.wav"),
        (("stimuli", "show", "s.wav", "--out", "s.json"), "s.json"),
    ],
)
def test_no_output_destroys_an_input(haptix_cli, own_folder, arguments, kept):
    for name in ("a.surface", "scene.toml", "m.toml", "s.wav", "s.json", "mine.toml"):
        (own_folder / name).write_text("what took hours")
    if "--finger" in arguments:  # by another name
        (own_folder / "mine.toml.surface").hardlink_to(own_folder / "mine.toml")
    shown = haptix_cli(*arguments)
    assert (shown.code, shown.out) == (2, "")
    assert "name another" in shown.err or "a name that ends in .png" in shown.err
    assert (own_folder / kept).read_text() == "what took hours"


def test_an_unknown_key_is_told_before_one_that_is_missing(haptix_cli, own_folder):
    (own_folder / "scene.toml").write_text("nmae = 'mistyped'")
    shown = haptix_cli("plan", "scene.toml")
    assert shown.code == 2
    assert "nmae" in shown.err
