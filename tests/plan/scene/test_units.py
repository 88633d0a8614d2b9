"""Numbers with units in files."""

from math import inf

import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptix import Finger, InputError, Screen
from haptix.base.units import with_numbers
from haptix.feel.signals.signal import signal_from

# Written out by hand: text, key, and the SI float (millimetres for places) that it stands for.
GOOD = [
    ("150 V", "max_voltage_v", 150.0),
    ("0.15 kV", "max_voltage_v", 150.0),
    ("150V", "max_voltage_v", 150.0),
    ("40 mm", "width_mm", 40.0),
    ("0.12 m/s", "speed_mm_s", 120.0),
    ("-45 °", "rotation_deg", -45.0),
    ("90 °/s", "spin_deg_s", 90.0),
    ("20 g", "mass_kg", 0.02),
    ("4 cm", "width_mm", 40.0),
    ("0.04 m", "width_mm", 40.0),
    ("125 Hz", "frequency_hz", 125.0),
    ("20 kHz", "carrier_hz", 20e3),
    ("0.2 um", "h0_m", 0.2e-6),
    ("0.2 \N{MICRO SIGN}m", "h0_m", 0.2e-6),
    ("0.2 \N{GREEK SMALL LETTER MU}m", "h0_m", 0.2e-6),
    ("200 nm", "h0_m", 0.2e-6),
    ("1e-1 mN", "normal_force_n", 1e-4),
    ("40 MPa", "youngs_modulus_pa", 40e6),
    ("1 GPa", "youngs_modulus_pa", 1e9),
    ("45.65 mm2", "apparent_area_at_1n_m2", 45.65e-6),
    ("45.65 mm^2", "apparent_area_at_1n_m2", 45.65e-6),
    ("45.65 mm\N{SUPERSCRIPT TWO}", "apparent_area_at_1n_m2", 45.65e-6),
    ("500 V/um", "insulator_strength_v_per_m", 500e6),
    ("0.5 kV/um", "insulator_strength_v_per_m", 500e6),
    ("0.1 m/s", "speed_mm_per_s", 100.0),
    ("100 mm/s", "speed_mm_per_s", 100.0),
    ("1 MOhm m", "gap_resistivity_ohm_m", 1e6),
    ("1 M\N{GREEK CAPITAL LETTER OMEGA} m", "gap_resistivity_ohm_m", 1e6),
    ("1 GOhm mm", "gap_resistivity_ohm_m", 1e6),
    ("4000 /m", "q_rolloff_per_m", 4000.0),
    ("4 /mm", "q_rolloff_per_m", 4000.0),
]


@pytest.mark.parametrize(("text", "key", "number"), GOOD)
def test_a_quantity_becomes_the_float_that_its_si_value_is(text, key, number):
    assert with_numbers("Scene", {key: text}) == {key: number}


BAD = [
    ("150", "max_voltage_v"),
    ("high", "max_voltage_v"),
    ("", "max_voltage_v"),
    ("150 N", "max_voltage_v"),
    ("150 v", "max_voltage_v"),
    ("1 V V", "max_voltage_v"),
    ("1,5 V", "max_voltage_v"),
    ("nan V", "max_voltage_v"),
    ("40 mm2", "width_mm"),
    ("1 mHz/s/s", "frequency_hz"),
    ("3 /", "q0_per_m"),
    ("1 V/m", "max_voltage_v"),
]


@pytest.mark.parametrize(("text", "key"), BAD)
def test_what_is_no_such_quantity_is_named_with_an_example(text, key):
    with pytest.raises(InputError, match=rf"{key}.*unit"):
        with_numbers("Scene", {key: text})


def test_a_decimal_comma_in_a_document_is_told_apart():
    with pytest.raises(InputError, match=r"the decimal sign is a point: 0\.4"):
        with_numbers("Scene", {"normal_force_n": "0,4 N"})


def test_lists_and_tables_are_read_and_other_strings_left():
    fields = {
        "name": "150 V",
        "normal_force_n": ["200 mN", 1],
        "finger": {"roughness": {"h_rms_m": "22 um"}},
        "textures": [{"file": "a.png", "width_mm": "6 cm"}],
    }
    assert with_numbers("Scene", fields) == {
        "name": "150 V",
        "normal_force_n": [0.2, 1],
        "finger": {"roughness": {"h_rms_m": 22e-6}},
        "textures": [{"file": "a.png", "width_mm": 60.0}],
    }
    with pytest.raises(InputError, match=r"Scene\.textures\.0\.width_mm"):
        with_numbers("Scene", {"textures": [{"width_mm": "6 V"}]})


@given(st.floats(1e-6, 1e6), st.sampled_from([("mN", 1e3), ("N", 1.0), ("kN", 1e-3)]))
def test_a_number_survives_its_unit(newton, unit):
    name, per_newton = unit
    read = with_numbers("Scene", {"normal_force_n": f"{newton * per_newton!r} {name}"})
    # One rounding of the product that is written, one of the number that is read.
    assert read["normal_force_n"] == pytest.approx(newton, rel=3e-16)


def test_finger_and_screen_files_accept_units(tmp_path):
    path = tmp_path / "x.toml"
    path.write_text('max_voltage_v = "0.15 kV"\ninsulator_thickness_m = "1.5 um"\n')
    assert Screen.load(path) == Screen(max_voltage_v=150.0, insulator_thickness_m=1.5e-6)
    path.write_text('youngs_modulus_pa = "30 MPa"\n[roughness]\nh_rms_m = "20 um"\n')
    assert Finger.load(path) == Finger(youngs_modulus_pa=30e6, roughness={"h_rms_m": 20e-6})
    path.write_text('[roughness]\nh_rms_m = "20 V"\n')
    with pytest.raises(InputError, match=r"x\.toml: Finger\.roughness\.h_rms_m: .*got '20 V'"):
        Finger.load(path)


def test_an_endless_length_is_read_as_it_is_written():
    endless = {"kind": "sine", "amplitude": 0.1, "frequency_hz": "0.1 kHz", "length_s": "forever"}
    read = with_numbers("signal", endless)
    assert signal_from(read).length_s == inf and read["frequency_hz"] == 100.0


def test_texts_are_no_quantities_whatever_their_names_end_in():
    assert with_numbers("map", {"at_s": "rt", "x_mm": "1 cm"}, {"at_s"}) == {
        "at_s": "rt",
        "x_mm": 10.0,
    }
