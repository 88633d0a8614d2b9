"""Recordings of other people by a column map, as of the Cluster Haptic Texture Database."""

import numpy as np
import pytest

from haptix.base.errors import FileFormatError, InputError
from haptix.feel.materials.recording_columns import RecordingColumns
from haptix.feel.materials.spectral import stretches

MAP = """
mass_kg = 0.05
[columns]
t_s = { column = "time" }
normal_force_n = { column = "force" }
speed_mm_per_s = { value = 40 }
mu = { value = 0.5 }
acceleration_m_per_s2 = { column = "X", scale = 9.80665, file = "../accel/{stem}.csv" }
"""


@pytest.fixture
def slide(tmp_path):
    """A grating of 2 mm at 40 mm/s: 20 Hz, by 0.1 g at 0.5 N, with irregular times."""
    draw = np.random.default_rng(0)
    for name in ("force", "accel"):
        (tmp_path / name).mkdir()
        t = np.cumsum(draw.uniform(1.2e-4, 2.1e-4, 15_000))
        columns = [np.full_like(t, 0.5)] if name == "force" else [
            0.1 * np.sin(2 * np.pi * 20 * t), 0 * t, -1 + 0 * t]  # fmt: skip
        head = "time,force" if name == "force" else "time,X,Y,Z"
        np.savetxt(tmp_path / name / "0_135_40_500_0.csv", np.c_[t, *columns], "%.9g", ",",
                   header=head, comments="")  # fmt: skip
    (tmp_path / "map.toml").write_text(MAP)
    return tmp_path


def test_a_slide_of_the_database_has_the_depth_of_its_acceleration(slide):
    columns = RecordingColumns.load(slide / "map.toml")
    (one,) = stretches(slide / "force" / "0_135_40_500_0.csv", columns)
    # mu = 0.5 + 0.05 kg 0.981 m/s2 / 0.5 N sin: a relative depth of 0.196.
    assert np.std(one.change) * np.sqrt(2) == pytest.approx(0.05 * 0.980665 / 0.5 / 0.5, rel=0.02)
    assert one.speed_mm_per_s == pytest.approx(40.0, rel=1e-6)
    power = np.abs(np.fft.rfft(one.change * np.hanning(len(one.change))))
    per_mm = np.fft.rfftfreq(len(one.change), one.step_mm)
    assert per_mm[power.argmax()] == pytest.approx(0.5, rel=0.02)


def test_maps_that_lack_something_say_what(slide):
    for text, said in (
        (MAP.replace("mass_kg = 0.05", ""), "needs mass_kg"),
        (MAP.replace('t_s = { column = "time" }', ""), "expected t_s"),
        (MAP.replace("{ value = 0.5 }", "{}"), "one of column and value"),
    ):
        (slide / "map.toml").write_text(text)
        with pytest.raises(InputError, match=said):
            RecordingColumns.load(slide / "map.toml")
    (slide / "map.toml").write_text(MAP.replace('"X"', '"Q"'))
    columns = RecordingColumns.load(slide / "map.toml")
    with pytest.raises(FileFormatError, match=r"accel.*missing columns 'Q'"):
        stretches(slide / "force" / "0_135_40_500_0.csv", columns)


def test_units_that_a_file_states_count_unless_the_map_has_a_factor(tmp_path):
    path = tmp_path / "slide.csv"
    t_ms = np.arange(100.0)
    rows = np.c_[t_ms, 250.0 + t_ms, 0.01 * t_ms]
    np.savetxt(path, rows, "%.9g", ",", header="time (ms),Fz (mN),x (cm)", comments="")
    columns = {
        "t_s": {"column": "time"},
        "normal_force_n": {"column": "Fz"},
        "position_mm": {"column": "x"},
        "mu": {"value": 0.5},
    }
    read = RecordingColumns.model_validate({"columns": columns}).read(path)
    np.testing.assert_allclose(read["t_s"], t_ms / 1e3)
    np.testing.assert_allclose(read["normal_force_n"], (250.0 + t_ms) / 1e3)
    np.testing.assert_allclose(read["position_mm"], 0.1 * t_ms)
    columns["normal_force_n"]["scale"] = 1.0
    read = RecordingColumns.model_validate({"columns": columns}).read(path)
    np.testing.assert_allclose(read["normal_force_n"], 250.0 + t_ms)
    columns["normal_force_n"] = {"column": "x"}
    with pytest.raises(FileFormatError, match="in cm; state its factor"):
        RecordingColumns.model_validate({"columns": columns}).read(path)
