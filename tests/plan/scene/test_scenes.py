"""Scenes: files, what they refuse, and what they say to a build."""

from pathlib import Path

import pytest

import haptix
from haptix import Finger, InputError, Scene, Screen
from haptix.plan.scene import CarrierDrive, DirectDrive, Override

EXAMPLES = Path(haptix.__file__).parents[1] / "examples" / "scenes"
SMALL = """
finger = "semi-wet"
screen = "3m-sct3250"
normal_force_n = 0.5
[drive]
scheme = "direct"
frequency_hz = 125
"""


def scene_file(folder, text):
    path = folder / "scene.toml"
    path.write_text(text)
    return path


@pytest.mark.parametrize("name", ["carrier", "direct"])
def test_an_example_loads_saves_and_loads_equal(name, tmp_path):
    scene = Scene.load(EXAMPLES / f"{name}.toml")
    copy = tmp_path / "folder" / "copy.toml"
    copy.parent.mkdir()
    scene.save(copy)
    again = Scene.load(copy)
    # The folder differs, and with it the relative paths of the textures: to the same files.
    assert again.replace(folder=scene.folder, textures=scene.textures) == scene
    for texture, moved in zip(scene.textures, again.textures, strict=True):
        there = (scene.folder / texture.file).resolve()
        assert (again.folder / moved.file).resolve() == there


def test_the_carrier_example_says_what_its_file_says():
    scene = Scene.load(EXAMPLES / "carrier.toml")
    assert scene.finger == Finger.preset("semi-wet")
    assert scene.drive == CarrierDrive(
        scheme="carrier", carrier_hz=(20e3, 20e3), envelope_hz=400.0, max_voltage_v=150.0
    )
    assert scene.ranges() == {
        "normal_force_n": (0.2, 1.0),
        "voltage_v": (0.0, 150.0),
        "frequency_hz": (20e3, 20e3),
        "h0_m": (0.125e-6, 0.125e-6),  # 1 um of silica with eps1 = 8
    }


def test_a_scene_needs_only_what_has_no_default(tmp_path):
    scene = Scene.load(scene_file(tmp_path, SMALL))
    assert scene.budget_jnd == 0.5
    assert scene.max_voltage_v == scene.screen.max_voltage_v
    assert scene.ranges()["frequency_hz"] == (125.0, 125.0)


def test_profiles_come_from_presets_files_and_tables(tmp_path):
    Finger(name="mine", youngs_modulus_pa=3e7).save(tmp_path / "mine.toml")
    text = SMALL.replace('"semi-wet"', '"mine.toml"').replace(
        'screen = "3m-sct3250"', 'screen = { max_voltage_v = "90 V" }'
    )
    scene = Scene.load(scene_file(tmp_path, text))  # not from the current folder
    assert scene.finger == Finger(name="mine", youngs_modulus_pa=3e7)
    assert scene.screen == Screen(max_voltage_v=90.0)


def test_the_terms_are_all_that_the_profiles_and_the_fidelity_allow():
    scene = Scene(
        finger=Finger.preset("dry"),
        screen=Screen(gap_resistivity_ohm_m=1e6),
        normal_force_n=(0.1, 1.0),
        drive=DirectDrive(scheme="direct", frequency_hz=(100.0, 200.0)),
    )
    everything = {
        "layered-skin",
        "apparent-area",
        "finite-size",
        "plasticity",
        "skin-dielectric",
        "leaky-gap",
        "field-limit",
        "body-return",
        "breakdown",
        "occlusion",
        "sliding-speed",
        "shear-area",
    }
    assert scene.possible_terms() == everything
    not_closed = {"finite-size", "plasticity", "field-limit", "body-return"}
    assert scene.possible_terms("closed-form") == everything - not_closed
    left = {"field-limit", "body-return", "occlusion", "sliding-speed", "shear-area"}
    assert scene.model().terms == everything - left
    asking = scene.replace(override=Override(terms=dict.fromkeys(left, True)))
    assert asking.model().terms == everything
    bare = scene.replace(finger=Finger(), screen=Screen())
    assert bare.possible_terms() == everything - {"layered-skin", "plasticity", "leaky-gap"}


CHANGES = {
    "unknown key": ("normal_force_n = 0.5", "force_n = 0.5", r"force_n"),
    "no force": ("normal_force_n = 0.5", "", r"normal_force_n: field required"),
    "reversed": ("= 0.5", "= [1, 0.5]", r"normal_force_n: expected finite 0 < low <= high"),
    "empty": ("= 0.5", "= []", r"normal_force_n: expected one number, or \[low, high\]"),
    "three": ("= 0.5", "= [1, 2, 3]", r"expected one number, or \[low, high\]"),
    "a truth": ("= 0.5", "= true", r"expected one number, or \[low, high\]"),
    "zero": ("= 0.5", "= 0", r"expected finite 0 < low <= high"),
    "not finite": ("= 0.5", "= [0.1, inf]", r"expected finite 0 < low <= high"),
    "wrong unit": ("= 0.5", '= "0.5 V"', r'expected a number, or one with its unit .*"0.5 N"'),
    "no such finger": ("semi-wet", "glove", r"unknown finger preset 'glove'"),
    "no such drive": ('"direct"', '"magic"', r"drive: .*'magic'.*'direct', 'carrier'"),
    "a drive's key": ("frequency_hz", "carrier_hz", r"drive\.direct"),
    "over the limit": ("= 125", "= 125\nmax_voltage_v = 300", r"at most the 200 V of screen"),
    "no budget": ("[drive]", "budget_jnd = 0\n[drive]", r"budget_jnd"),
    "unknown term": ("[drive]", "override.terms.magic = true\n[drive]", r"unknown 'magic'"),
    "unknown axis": ("[drive]", 'override.axes.mu = "keep"\n[drive]', r"override\.axes\.mu"),
    "an axis of another": (
        "[drive]",
        'override.axes.normal_force_n = "keep"\n[drive]',
        r"axes\.normal_force_n.*'frequency_hz' or 'h0_m'",
    ),
    "a tolerance": ("[drive]", "override.tolerance = true\n[drive]", r"tolerance.*got True"),
    "a folder": ("[drive]", 'folder = "/"\n[drive]', r"folder"),
    "later": ("finger", "schema_version = 2\nfinger", r"schema_version 1, got 2"),
    "a finger's field": ('"semi-wet"', "{ colour = 1 }", r"finger\.colour"),
}


@pytest.mark.parametrize("name", CHANGES)
def test_a_wrong_scene_is_told_in_one_line(name, tmp_path):
    old, new, sentence = CHANGES[name]
    assert old in SMALL
    path = scene_file(tmp_path, SMALL.replace(old, new, 1))
    with pytest.raises(haptix.HaptixError, match=sentence) as caught:
        Scene.load(path)
    assert "\n" not in str(caught.value)
    assert str(path) in str(caught.value)


def test_an_axis_is_kept_by_name(tmp_path):
    text = SMALL.replace("[drive]", 'override.axes.h0_m = "keep"\n[drive]', 1)
    assert Scene.load(scene_file(tmp_path, text)).override.axes == {"h0_m": "keep"}


def test_an_envelope_is_slower_than_its_carrier():
    with pytest.raises(InputError, match="half of carrier_hz"):
        Scene(
            finger="dry",
            screen="3m-sct3250",
            normal_force_n=0.5,
            drive={"scheme": "carrier", "carrier_hz": 1000, "envelope_hz": 600},
        )


def test_a_square_wave_has_no_surface():
    scene = Scene(
        finger="dry",
        screen="3m-sct3250",
        normal_force_n=0.5,
        drive={"scheme": "direct", "frequency_hz": 100, "waveform": "square"},
    )
    with pytest.raises(InputError, match='sine, got "square"'):
        scene.ranges()
