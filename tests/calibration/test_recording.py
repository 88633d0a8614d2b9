"""Raw recordings on disk, and CSV files of other instruments."""

import json
from dataclasses import replace

import h5py
import numpy as np
import pytest

import haptix
from calibration import ColumnMap, CsvSource, Stroke, StrokeRecording
from calibration.measure.recording import SIGNALS, Conditions
from calibration.measure.recording_checks import check_recording

MAP = """
skip_rows = 1
[columns]
t_s = { column = "time", unit = "ms" }
normal_force_n = { column = "Fz", unit = "mN", scale = -1 }
tangential_force_n = { column = "Fx", unit = "N" }
x_mm = { column = "pos", unit = "cm" }
drive_v = { column = "monitor", unit = "V" }
"""


def test_round_trip(tmp_path, stroke, recorded):
    made = recorded(stroke)
    room = Conditions({"force sensor": "FT1"}, 22.5, 41.0, "me", "2026-01-02T03:04:05")
    signals = {name: getattr(made, name) for name in SIGNALS}
    made = StrokeRecording(stroke, **signals, conditions=room, findings=("force off: too much",))
    made.save(tmp_path / "a" / "stroke.h5")
    found = StrokeRecording.load(tmp_path / "a" / "stroke.h5")
    assert (found.stroke, found.conditions) == (stroke, room)
    assert found.findings == made.findings
    for name in SIGNALS:
        np.testing.assert_array_equal(getattr(found, name), getattr(made, name))
    assert [path.name for path in (tmp_path / "a").iterdir()] == ["stroke.h5"]
    # The format is what its documentation says: another program can read it.
    with h5py.File(tmp_path / "a" / "stroke.h5") as file:
        assert file["signals/normal_force_n"].attrs["unit"] == "N"
        assert json.loads(file.attrs["instruments"]) == {"force sensor": "FT1"}
        assert file.attrs["temperature_c"] == 22.5


def test_a_write_that_fails_leaves_what_was_there(tmp_path, stroke, recorded, monkeypatch):
    path = tmp_path / "stroke.h5"
    recorded(stroke).save(path)
    before = path.read_bytes()

    def broken(*args, **options):
        raise OSError("disk full")

    monkeypatch.setattr(h5py.Group, "create_dataset", broken)
    with pytest.raises(haptix.HaptixError, match="disk full"):
        recorded(stroke, seed=1).save(path)
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]


def test_a_file_that_may_not_grow_is_told_and_hdf5_stays_silent(tmp_path, stroke, recorded, capfd):
    resource = pytest.importorskip("resource", reason="needs POSIX's limit of a file's size")
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    try:
        resource.setrlimit(resource.RLIMIT_FSIZE, (10_000, before[1]))
        with pytest.raises(haptix.HaptixError, match=r"stroke\.h5: File too large"):
            recorded(stroke).save(tmp_path / "stroke.h5")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert list(tmp_path.iterdir()) == []
    assert capfd.readouterr().err == ""


def damaged(file, how):
    if how == "foreign":
        del file.attrs["format"]
    elif how == "later":
        file.attrs["schema_version"] = 2
    elif how == "missing":
        del file["signals/x_mm"]
    else:
        file.attrs["stroke"] = "{}"


@pytest.mark.parametrize(
    ("how", "said"),
    [
        ("foreign", "of another kind"),
        ("later", "schema_version 1, got 2"),
        ("missing", "expected signals x_mm"),
        ("stroke", r"stroke\.number"),
    ],
)
def test_files_that_are_none(tmp_path, stroke, recorded, how, said):
    path = tmp_path / "stroke.h5"
    recorded(stroke).save(path)
    with h5py.File(path, "r+") as file:
        damaged(file, how)
    with pytest.raises(haptix.HaptixError, match=rf"stroke\.h5.*{said}"):
        StrokeRecording.load(path)


def test_a_file_cut_short(tmp_path, stroke, recorded):
    path = tmp_path / "stroke.h5"
    recorded(stroke).save(path)
    path.write_bytes(path.read_bytes()[:3000])
    with pytest.raises(haptix.HaptixError, match=r"cannot read .*stroke\.h5"):
        StrokeRecording.load(path)


def test_signals_of_different_length(stroke):
    zero = np.zeros(10)
    with pytest.raises(haptix.InputError, match="one length"):
        StrokeRecording(stroke, zero, zero, zero, zero, np.zeros(9))


def csv_of(tmp_path, text, columns=MAP):
    (tmp_path / "map.toml").write_text(columns)
    (tmp_path / "x.csv").write_text(text)
    return ColumnMap.load(tmp_path / "map.toml"), tmp_path / "x.csv"


ROWS = "\n".join(f"{i}, {-100 - i}, 0.0{i}, {i / 10}, 0" for i in range(9))


def test_units_signs_and_constants(tmp_path, stroke):
    columns, path = csv_of(tmp_path, f"made by a rig\ntime, Fz , Fx, pos, monitor\n{ROWS}\n")
    found = columns.signals(path)
    np.testing.assert_allclose(found["t_s"], np.arange(9) / 1000)
    np.testing.assert_allclose(found["normal_force_n"], (100 + np.arange(9)) / 1000)
    np.testing.assert_allclose(found["tangential_force_n"], np.arange(9) / 100)
    np.testing.assert_allclose(found["x_mm"], np.arange(9))
    assert (found["drive_v"] == 0).all()


def test_a_known_speed_makes_a_position(tmp_path):
    text = '[columns]\nt_s = {column="time", unit="s"}\nx_mm = {speed_mm_per_s = 20}\n'
    columns, path = csv_of(tmp_path, "time\n" + "\n".join(map(str, range(5, 15))), text)
    np.testing.assert_allclose(columns.read(path)["x_mm"], 20.0 * np.arange(10))


def as_csv(path, recording, names):
    columns = [getattr(recording, name) for name in names]
    rows = [",".join(f"{v:.6g}" for v in row) for row in zip(*columns, strict=True)]
    path.write_text("\n".join([",".join(names), *rows]))


@pytest.mark.parametrize("both", [True, False], ids=["there and back", "one way"])
@pytest.mark.parametrize("drive", ["", "drive_v = { value = 0 }"])
def test_forces_alone_are_enough(tmp_path, stroke, recorded, both, drive):
    """What the column map advises where no position and no drive were kept is accepted."""
    one = stroke.model_copy(update={"there_and_back": both})
    made = recorded(one, 0.3, 0.1, crosstalk=0.02, tremor=0.03, offset_n=0.02)
    as_csv(tmp_path / "1.csv", made, ("t_s", "normal_force_n", "tangential_force_n"))
    units = {"t_s": "s", "normal_force_n": "N", "tangential_force_n": "N"}
    text = "[columns]\nx_mm = { speed_mm_per_s = 50 }\n" + drive
    text += "".join(f'\n{name} = {{column = "{name}", unit = "{u}"}}' for name, u in units.items())
    (tmp_path / "map.toml").write_text(text)
    source = CsvSource(tmp_path, ColumnMap.load(tmp_path / "map.toml"))
    assert source.assumed == ("x_mm", "drive_v")
    source.start(one, None)
    signals = source.finish()
    assert "drive_v" not in signals
    # Within 1 mm: 20 ms of smoothing at each end of the slide, at 50 mm/s.
    np.testing.assert_allclose(signals["x_mm"], made.x_mm, atol=1.0)
    found = replace(
        StrokeRecording.of(one, {**signals, "drive_v": made.drive_v}), assumed=source.assumed
    )
    assert check_recording(found, 0.3) == []
    found.save(tmp_path / "1.h5")
    assert StrokeRecording.load(tmp_path / "1.h5").assumed == ("x_mm", "drive_v")


def test_a_last_line_cut_short_is_left_out(tmp_path, stroke):
    columns, path = csv_of(tmp_path, f"rig\ntime,Fz,Fx,pos,monitor\n{ROWS}\n9, -1")
    assert len(columns.signals(path)["t_s"]) == 9


@pytest.mark.parametrize(
    ("head", "rows", "said"),
    [
        (
            "time,Fz,Fy,pos,monitor",
            ROWS,
            r"missing columns 'Fx'; the file has 'time', 'Fz', 'Fy', 'pos', 'monitor'",
        ),
        (
            "time,Fz,Fx,pos,monitor",
            ROWS.replace("-104,", "off,"),
            r"sample 5 \(about line 7\).*column 'Fz', got ' off'",
        ),
        ("time,Fz,Fx,pos,monitor", "1,2,3,4", "8 samples or more"),
    ],
)
def test_wrong_files_are_named(tmp_path, stroke, head, rows, said):
    columns, path = csv_of(tmp_path, f"rig\n{head}\n{rows}\n")
    with pytest.raises(haptix.HaptixError, match=rf"x\.csv.*{said}"):
        columns.signals(path)


@pytest.mark.parametrize(
    ("columns", "said"),
    [
        (
            '[columns]\nt_s = {column = "t", unit = "N"}',
            "t_s: expected unit s, ms, us, ns, min, h, samples",
        ),
        ('[columns]\nt_s = {column = "t", file = "-b.csv"}', "times of the first file"),
        ('[columns]\nx_mm = {column = "t", file = "../b.csv"}', "rest of a name"),
        ('[columns]\n[gauges]\ncolumns = ["a", "b"]\nmatrix = [[1, 2], [3]]', "matrix: expected"),
        ("[columns]\nt_s = {}", "one of column, speed_mm_per_s and value"),
        ('[columns]\nt_s = {column = "t", unit = "s"}\ndrive_v = {speed_mm_per_s = 3}', "x_mm"),
        ("[rows]", "ColumnMap.rows"),
    ],
)
def test_wrong_maps_are_named(tmp_path, columns, said):
    (tmp_path / "map.toml").write_text(columns)
    with pytest.raises(haptix.InputError, match=rf"map\.toml: .*{said}"):
        ColumnMap.load(tmp_path / "map.toml")


def test_a_map_that_leaves_a_signal_out(tmp_path, stroke):
    text = MAP.replace('x_mm = { column = "pos", unit = "cm" }', "")
    columns, path = csv_of(tmp_path, "rig\ntime,Fz,Fx,pos,monitor\n" + ROWS, text)
    with pytest.raises(haptix.InputError, match="x_mm"):
        columns.signals(path)


def test_strokes_describe_themselves():
    one = Stroke(number=3, normal_force_n=0.5, voltage_v=100, frequency_hz=125)
    assert one.label == "stroke 3: 0.5 N, 40 mm there and back at 50 mm/s, 100 V at 125 Hz"
