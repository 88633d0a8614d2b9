"""Profiles from files: position and friction, extruded across."""

import numpy as np
import pytest

from haptix import HaptixError, InputError
from haptix.base.errors import FileFormatError
from haptix.feel.materials import RecordedProfile

POSITION = np.array([2.0, 2.5, 4.0, 4.5, 7.0])
MU = np.array([0.3, 0.6, 0.2, 0.5, 0.4])


def write(path, text):
    path.write_text(text)
    return path


@pytest.mark.parametrize("angle", [0.0, 90.0, 37.0])
def test_linear_between_positions_and_the_same_across(angle):
    field = RecordedProfile(POSITION, MU, orientation_deg=angle)
    rng = np.random.default_rng(0)
    # Away from the ends, whose ramps follow, in the rotated frame.
    along, across = rng.uniform(2.01, 6.99, 400), rng.uniform(-30, 30, 400)
    turn = np.radians(angle)
    x = along * np.cos(turn) - across * np.sin(turn)
    y = along * np.sin(turn) + across * np.cos(turn)
    # Rounding in the turn and in finding the step.
    expected = np.interp(along, POSITION, MU)
    np.testing.assert_allclose(field.friction(x, y), expected, rtol=0, atol=1e-12)


def test_beyond_the_ends():
    lowest = RecordedProfile(POSITION, MU)
    held = RecordedProfile(POSITION, MU, beyond="hold")
    # The ramp at an end is as long as a step of the grid, half a millimetre here.
    far = np.array([-50.0, 1.49, 7.51, 60.0])
    np.testing.assert_allclose(lowest.friction(far, 0.0), 0.2, rtol=0, atol=1e-12)
    np.testing.assert_allclose(held.friction(far, 0.0), [0.3, 0.3, 0.4, 0.4], atol=1e-12)


def test_a_finer_step_than_the_positions():
    field = RecordedProfile(POSITION, MU, step_mm=0.01)
    x = np.linspace(2.1, 6.9, 99)
    np.testing.assert_allclose(field.friction(x, 5.0), np.interp(x, POSITION, MU), atol=0.005)


def test_from_csv(tmp_path):
    path = write(tmp_path / "mu.csv", "mu,t_s,position_mm\n0.3,0,1\n0.5,1,2\n\n0.4,2,3.5\n")
    assert RecordedProfile.from_csv(path).friction(1.5, 0) == pytest.approx(0.4)
    force = write(tmp_path / "force.csv", "position_mm,tangential_force_n\n1,0.2\n2,0.4\n")
    assert RecordedProfile.from_csv(force, normal_force_n=0.8).friction(2.0, 9) == pytest.approx(
        0.5
    )
    both = write(
        tmp_path / "both.csv",
        "\ufeffposition_mm, tangential_force_n, normal_force_n\n1,0.2,1\n2,0.4,0.5\n",
    )
    field = RecordedProfile.from_csv(both, orientation_deg=90, beyond="hold")
    assert field.friction(9.0, [1.0, 2.0]) == pytest.approx([0.2, 0.8])
    assert field.target == "mu"


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("", "first line naming position_mm"),
        ("x,mu\n1,0.3\n2,0.4\n", "missing or repeated: position_mm"),
        ("position_mm,force\n1,0.3\n2,0.4\n", "tangential_force_n, got position_mm, force"),
        ("position_mm,mu\n1,0.3\n2,high\n", "line 3"),
        ("position_mm,mu\n1,0.3\n2\n", "line 3"),
        ("position_mm,mu\n1,0.3\n", "at least 2"),
        ("position_mm,mu\n1,0.3\n1,0.4\n", "increasing"),
        ("position_mm,mu\n1,0.3\n3,0.4\n2,0.4\n", "number 3 is 2 after 3"),
        ("position_mm,mu\n1,nan\n2,0.4\n", "finite"),
        ("position_mm,tangential_force_n\n1,0.3\n2,0.4\n", "normal_force_n"),
        ("position_mm,tangential_force_n,normal_force_n\n1,0.3,1\n2,0.4,0\n", "above 0 N"),
        ("position_mm,mu\n1,0.3\n1.0000001,0.4\n90,0.3\n", "larger step_mm"),
    ],
)
def test_bad_files(tmp_path, text, complaint):
    path = write(tmp_path / "profile.csv", text)
    with pytest.raises(HaptixError, match=complaint) as caught:
        RecordedProfile.from_csv(path)
    assert "\n" not in str(caught.value)


def test_files_that_are_none(tmp_path):
    with pytest.raises(FileFormatError, match="cannot read"):
        RecordedProfile.from_csv(tmp_path / "none.csv")
    (tmp_path / "picture.csv").write_bytes(bytes(range(256)))
    with pytest.raises(FileFormatError, match="text file"):
        RecordedProfile.from_csv(tmp_path / "picture.csv")


@pytest.mark.parametrize(
    "options",
    [
        {"position_mm": POSITION[:3]},
        {"position_mm": POSITION[None]},
        {"value": np.full(5, np.inf)},
        {"beyond": "repeat"},
        {"step_mm": 0.0},
        {"step_mm": -1.0},
        {"orientation_deg": np.nan},
        {"target": "force"},
    ],
)
def test_bad_recordings(options):
    with pytest.raises(InputError):
        RecordedProfile(**{"position_mm": POSITION, "value": MU, **options})
