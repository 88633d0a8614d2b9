"""The profile that a calibration writes."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from calibration.keep.profile import check_name
from haptix import HaptixError, InputError, Screen

SCREEN = Screen(
    name="panel 7", insulator_thickness_m=1.1e-6, insulator_permittivity=3.9, max_voltage_v=150.0
)

positive = st.floats(1e-12, 1e6)
# A file holds any text but lone surrogates and NUL.
names = st.text(
    st.characters(codec="utf-8", exclude_characters="\0"), min_size=1, max_size=20
).filter(lambda name: name.strip() and name != "custom")


@settings(deadline=None)
@given(names, positive, positive.map(lambda value: 1 + value), positive)
def test_round_trip(tmp_path_factory, name, thickness, permittivity, voltage):
    screen = Screen(
        name=name,
        insulator_thickness_m=thickness,
        insulator_permittivity=permittivity,
        max_voltage_v=voltage,
    )
    path = tmp_path_factory.mktemp("profile") / "screen.toml"
    screen.save(path)
    assert Screen.load(path) == screen


def test_a_name_that_could_not_be_read_back_is_not_written(tmp_path):
    with pytest.raises(InputError, match="NUL"):
        SCREEN.replace(name="panel\0").save(tmp_path / "screen.toml")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", ["custom", "", "  "])
def test_a_screen_needs_a_name(name):
    with pytest.raises(InputError, match=r'name.*screen\.replace\(name="\.\.\."\)'):
        check_name(SCREEN.replace(name=name))


def test_a_folder_that_cannot_be_made():
    with pytest.raises(HaptixError, match="nowhere"):
        SCREEN.save("/dev/null/nowhere/screen.toml")
