"""Finger and screen profiles: presets, files, and what they refuse."""

import math
from pathlib import Path
from typing import Any

import pytest
import torch

from haptix import Finger, InputError, Screen
from haptix.base.errors import FileFormatError
from haptix.model.electro import SkinDielectric
from haptix.model.finger import Roughness
from haptix.model.friction import in_theory

# Physics page, section 3: E [Pa], nu, sigma_Y [Pa], tau_f [Pa].
SKINS = [
    ("dry", 1e9, 0.3, 50e6, 13e6),
    ("semi-wet", 40e6, 0.5, None, 8e6),
    ("wet", 10e6, 0.5, None, 5e6),
]


@pytest.mark.parametrize(("name", "modulus", "nu", "hardness", "shear"), SKINS)
def test_skin_presets(
    name: str, modulus: float, nu: float, hardness: float | None, shear: float
) -> None:
    finger = Finger.preset(name)
    assert finger.name == name
    assert (finger.youngs_modulus_pa, finger.poisson_ratio) == (modulus, nu)
    assert finger.hardness_pa == hardness
    # The paper's tau_f is of the paper's area; seven digits of the preset's are kept.
    published = in_theory(finger, "open-gaps").frictional_shear_stress_pa
    assert published == pytest.approx(shear, rel=1e-6)
    assert (finger.layer_thickness_m, finger.bulk_modulus_pa) == (200e-6, 10e3)
    assert finger.roughness.is_placeholder


def test_apparent_area_of_the_paper() -> None:
    force = torch.tensor([0.1, 0.9], dtype=torch.float64)
    pressure = force / Finger.preset("semi-wet").apparent_area_m2(force)
    # The paper: 3 kPa at 0.1 N and 20 kPa at 0.9 N; the fit keeps them within a percent.
    assert pressure.tolist() == pytest.approx([3e3, 20e3], rel=0.01)


def test_screen_of_the_paper() -> None:
    screen = Screen.preset("3m-sct3250")
    assert screen.h0_m == pytest.approx(1e-6 / 8, rel=1e-15)
    assert screen.max_voltage_v == 200.0


@pytest.mark.parametrize("profile", [Finger, Screen])
def test_unknown_presets_list_the_known(profile: type[Finger | Screen]) -> None:
    known = "semi-wet, dry, wet" if profile is Finger else "3m-sct3250"
    with pytest.raises(InputError, match=f"'glove'.*{known}"):
        profile.preset("glove")


PROFILES = {
    "paper": Finger.preset("semi-wet"),
    "dry": Finger.preset("dry"),
    "one half-space": Finger(name="gel", bulk_modulus_pa=None),
    "measured": Finger(
        name='Jo\'s "left" thumb, \u00e9t\u00e9\n',
        youngs_modulus_pa=1.2345678901234567e7,
        roughness=Roughness(h_rms_m=1.7e-5, hurst=1.0, is_placeholder=False),
        dielectric=SkinDielectric(
            frequency_hz=(100.0, 1e5),
            permittivity=(2000.0, 1000.0),
            resistivity_ohm_m=(1e5, 1e4),
            is_placeholder=False,
            source="bench",
        ),
    ),
    "screen": Screen(name="bench", insulator_thickness_m=1.1e-6, max_voltage_v=150.0),
}


@pytest.mark.parametrize("name", PROFILES)
def test_a_saved_profile_loads_equal(name: str, tmp_path: Path) -> None:
    profile = PROFILES[name]
    path = tmp_path / "profile.toml"
    profile.save(path)
    assert type(profile).load(path) == profile


@pytest.mark.parametrize("profile", [Finger, Screen])
def test_a_hand_written_file_needs_only_what_differs(
    profile: type[Finger | Screen], tmp_path: Path
) -> None:
    path = tmp_path / "short.toml"
    path.write_text('name = "mine"\n')
    assert profile.load(path) == profile(name="mine")


FILES: dict[str, tuple[bytes, type[Exception], str]] = {
    "unknown key": (b"max_volts = 3\n", InputError, "max_volts.*3"),
    "text for a number": (b'max_voltage_v = "high"\n', InputError, "max_voltage_v.*'high'"),
    "NaN": (b"max_voltage_v = nan\n", InputError, "max_voltage_v"),
    "infinite": (b"max_voltage_v = inf\n", InputError, "max_voltage_v"),
    "zero": (b"max_voltage_v = 0\n", InputError, "max_voltage_v.*got 0"),
    "negative": (b"insulator_thickness_m = -1e-6\n", InputError, "insulator_thickness_m"),
    "not TOML": (b"max_voltage_v: 200\n", FileFormatError, "expected a TOML file"),
    "binary": (b"\xff\xfe\x00", FileFormatError, "expected a text file"),
    "future": (b"schema_version = 2\n", FileFormatError, "schema_version 1, got 2; update"),
    "version as text": (b'schema_version = "1"\n', FileFormatError, "schema_version"),
}


@pytest.mark.parametrize("name", FILES)
def test_bad_files(name: str, tmp_path: Path) -> None:
    data, error, sentence = FILES[name]
    path = tmp_path / "screen.toml"
    path.write_bytes(data)
    with pytest.raises(error, match=sentence):
        Screen.load(path)


def test_a_missing_file_and_a_folder(tmp_path: Path) -> None:
    with pytest.raises(FileFormatError, match=r"cannot read .*none\.toml"):
        Finger.load(tmp_path / "none.toml")
    with pytest.raises(FileFormatError, match="cannot read"):
        Finger.load(tmp_path)


def test_unknown_keys_within(tmp_path: Path) -> None:
    path = tmp_path / "finger.toml"
    path.write_text("[roughness]\nh_rms = 2e-5\n")
    with pytest.raises(InputError, match=r"roughness\.h_rms"):
        Finger.load(path)


BAD_FIELDS: list[tuple[type[Finger | Screen], dict[str, Any], str]] = [
    (Finger, {"colour": "red"}, "colour"),
    (Finger, {"youngs_modulus_pa": 0.0}, "youngs_modulus_pa"),
    (Finger, {"youngs_modulus_pa": math.nan}, "youngs_modulus_pa"),
    (Finger, {"poisson_ratio": 0.51}, "poisson_ratio"),
    (Finger, {"poisson_ratio": -1.0}, "poisson_ratio"),
    (Finger, {"apparent_area_exponent": 1.0}, "apparent_area_exponent"),
    (Finger, {"apparent_area_exponent": -0.1}, "apparent_area_exponent"),
    (Finger, {"roughness": {"hurst": 1.1}}, "hurst"),
    (Finger, {"dielectric": {"frequency_hz": (1.0,)}}, "dielectric"),
    (Finger, {"schema_version": 2}, "schema_version"),
    (Screen, {"max_voltage_v": math.inf}, "max_voltage_v"),
    (Screen, {"insulator_permittivity": -8.0}, "insulator_permittivity"),
    (Screen, {"schema_version": 2}, "schema_version"),
]


@pytest.mark.parametrize(("profile", "fields", "sentence"), BAD_FIELDS)
def test_bad_fields(profile: type[Finger | Screen], fields: dict[str, Any], sentence: str) -> None:
    with pytest.raises(InputError, match=sentence):
        profile(**fields)


def test_replacing_validates_and_leaves_the_original() -> None:
    finger = Finger.preset("semi-wet")
    stiffer = finger.replace(youngs_modulus_pa=1e8)
    assert (stiffer.youngs_modulus_pa, finger.youngs_modulus_pa) == (1e8, 40e6)
    assert stiffer.replace(youngs_modulus_pa=40e6) == finger
    with pytest.raises(InputError, match="youngs_modulus_pa"):
        finger.replace(youngs_modulus_pa=-1.0)
    with pytest.raises(InputError, match="colour"):
        finger.replace(colour="red")


def test_profiles_are_frozen() -> None:
    with pytest.raises(ValueError, match="frozen"):
        Screen().max_voltage_v = 300.0  # type: ignore[misc]
