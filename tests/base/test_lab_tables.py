"""Tables of instruments: no number gets a unit, a time or a rate that its file does not state."""

import zipfile

import h5py
import numpy as np
import pytest
import scipy.io

import haptix
from haptix.base.tables import read_table


def lvm_of_several_x_columns(path, *channels):
    """Write channels of (name, unit, start, values) as LabVIEW does.

    Above the numbers a value stands in its channel's column; the column of its times is empty
    there, as in ``multi_time_column.lvm`` and ``no_decimal_separator.lvm`` of lvm_read 1.26.
    """
    names, units, starts, values = zip(*channels, strict=True)

    def row(key, cells):
        return f"{key}\t" + "\t\t".join(cells) + "\t"

    count = len(values[0])
    lines = [
        "LabVIEW Measurement\t", "Writer_Version\t2", "Reader_Version\t2", "Separator\tTab",
        "Decimal_Separator\t.", "Multi_Headings\tYes", "X_Columns\tMulti", "Time_Pref\tAbsolute",
        "Operator\tme", "Date\t2026/11/27", "Time\t10:11:12.5", "***End_of_Header***\t", "\t",
        f"Channels\t{len(names)}" + "\t" * (2 * len(names) - 1),
        row("Samples", [str(count)] * len(names)), row("Date", ["2026/11/27"] * len(names)),
        row("Time", starts), row("Y_Unit_Label", units), row("X_Dimension", ["Time"] * len(names)),
        row("X0", ["0.0000000000000000E+0"] * len(names)),
        row("Delta_X", ["0.001000"] * len(names)),
        "***End_of_Header***" + "\t" * (2 * len(names)),
        "\t".join(f"X_Value\t{name}" for name in names) + "\tComment",
    ]  # fmt: skip
    for k in range(count):
        lines.append("\t".join(f"{k / 1e3:.6f}\t{each[k]:.6f}" for each in values))
    path.write_text("\n".join(lines) + "\n")


def test_channels_with_times_of_their_own_keep_their_units_and_starts(tmp_path):
    path, k = tmp_path / "a.lvm", np.arange(20)
    lvm_of_several_x_columns(
        path,
        ("Fz", "N", "10:11:12.5", 0.5 + 0 * k),
        ("Fy", "mN", "10:11:13.0", 7.0 + 0 * k),
        ("Fx", "", "10:11:12.75", 0.1 * k),
        ("Position", "mm", "10:11:12.5", 1.0 * k),
    )
    table = read_table(path)
    assert table.units == {"Fz": "N", "Fy": "mN", "Position": "mm"}
    assert [times[0] for times in table.times_s.values()] == [0.0, 0.5, 0.25, 0.0]
    np.testing.assert_allclose(table.columns["Fx"], 0.1 * k)


def test_two_channels_of_one_name_are_two(tmp_path):
    path, k = tmp_path / "a.lvm", np.arange(20)
    lvm_of_several_x_columns(
        path, ("F", "N", "10:11:12.5", 1.0 * k), ("F", "mN", "10:11:12.5", 2.0 * k)
    )
    table = read_table(path)
    assert table.units == {"F": "N", "F 2": "mN"}
    np.testing.assert_allclose(table.columns["F 2"], 2.0 * k)


def test_a_channel_that_recorded_nothing_is_left_out(tmp_path):
    """As in ``with_empty_fields.lvm`` of lvm_read."""
    path, k = tmp_path / "a.lvm", np.arange(20)
    lvm_of_several_x_columns(
        path, ("Fy", "N", "10:11:12.5", np.nan + k), ("Fx", "mN", "10:11:12.5", 1.0 * k)
    )
    path.write_text(path.read_text().replace("nan", ""))
    table = read_table(path)
    assert [*table.columns] == ["Fx"]
    assert table.units["Fx"] == "mN"


def test_fewer_headings_than_channels_are_refused(tmp_path):
    """Without the blanks behind their number, lvm_read takes so many columns, not channels."""
    path, k = tmp_path / "a.lvm", np.arange(20)
    lvm_of_several_x_columns(
        path, ("Fz", "N", "10:11:12.5", 1.0 * k), ("Fx", "N", "10:11:12.5", 2.0 * k)
    )
    path.write_text(path.read_text().replace("Channels\t2\t\t\t\n", "Channels\t2\n"))
    with pytest.raises(haptix.HaptixError, match=r"a\.lvm: .*2 channels"):
        read_table(path)


def rate_above(path, line, comma=False, sign=";"):
    """Rate that is read from a line above columns without times."""
    rows = "".join(f"{k}.5{sign}{k}.25\n" for k in range(20))
    path.write_text(f"{line}\nFz (N){sign}Fx (N)\n" + (rows.replace(".", ",") if comma else rows))
    return read_table(path).rate_hz


@pytest.mark.parametrize(
    "line",
    [
        "Sample rate: 5000 Hz", "Sample rate: 5 kHz", "Sampling frequency: 0.005 MHz",
        "Sample Rate: 5 kS/s", "Sampling Rate [kHz]: 5", "Sample rate (Hz);5000", "fs = 5e3",
        "Scan rate: 5,000 Hz", "Acquisition rate: 5 kSa/s", "samples: 20\nsample_rate=5000",
        "Abtastrate: 5000 Hz", "Sample interval: 200 us", "Sample interval: 200 \N{MICRO SIGN}s",
        "Sampling interval (us): 200", "Sample time: 0.2 ms", "dt: 0.0002", "Interval=;0.2 ms",
        "Sample interval: 200000 ns", "delta t;0.0002;0.0002",
        "Sample rate: 5000 Hz\nDrive frequency: 125 Hz", "Sample rate: 5 kHz\ndt: 0.0002",
    ],
)  # fmt: skip
def test_a_rate_of_sampling_is_taken_with_its_unit(tmp_path, line):
    assert rate_above(tmp_path / "a.csv", line) == pytest.approx(5000.0)


@pytest.mark.parametrize(
    "line",
    [
        "Drive frequency: 125 Hz", "Carrier frequency (Hz);125", "Baud rate: 115200",
        "Low-pass cutoff frequency (Hz): 1000", "Frame rate: 60", "Heart rate: 60",
        "Calibration interval: 365", "Sample time: 10:15:30", "Sample rate: 5 rpm",
        "Sample rate: 5 mhz", "Sample interval: 3 days", "Sample rate: 5000 Hz\ndt: 0.001",
        "Sample rate (kHz): 5 Hz", "Sample rate: 5000 of 10000", "Sample interval: 0,200 ms",
        "Max sample rate: 10 kHz", "Sample rate: 5.000,0 Hz", "Sample rate: 0,500 Hz",
    ],
)  # fmt: skip
def test_another_rate_is_no_rate_of_sampling(tmp_path, line):
    assert rate_above(tmp_path / "a.csv", line) is None


def test_a_rate_above_decimal_commas(tmp_path):
    assert rate_above(tmp_path / "a.csv", "dt: 0,2 ms", comma=True) == pytest.approx(5000.0)
    assert rate_above(tmp_path / "a.csv", "dt: 0.2 ms", comma=True) == pytest.approx(5000.0)
    assert rate_above(tmp_path / "a.csv", "Sample rate: 5.000 Hz", comma=True) is None
    assert rate_above(tmp_path / "b.csv", "Sample rate: 5,000 Hz", sign=",") is None


def german(value, digits):
    return f"{value:,.{digits}f}".translate(str.maketrans(",.", ".,"))


@pytest.mark.parametrize(
    ("sign", "row", "cell"),
    [
        (";", lambda k: (german(k / 1e3, 3), german(k * 100, 0)), "1.000"),
        (";", lambda k: (german(k / 1e3, 3), german(k * 100, 2)), "1.000,00"),
        ("\t", lambda k: (f"{k / 1e3:.4f}", f"{k * 100:,}"), "1,000"),
        ("\t", lambda k: (f"{k / 1e3:.4f}", f"{k * 100:,.1f}"), "1,000.0"),
        ("\t", lambda k: (str(k), f"{k * 100:,}"), "1,000"),
        (";", lambda k: (str(k), german(k * 100, 0)), "1.000"),
        (";", lambda k: (str(k), german(k * 100 - 5e3, 0)), "5.000"),
        (";", lambda k: (f"{k / 1e3}", f"{k * 100 + 1000:,}"), "1,000"),
        (";", lambda k: (f"{k / 1e3}", f"{k * 100:,.1f}".replace(",", "'")), "1'000.0"),
        (";", lambda k: (german(k / 1e3, 3), german(k * 100, 1).replace(".", " ")), "1 000,0"),
        (",", lambda k: (f"{k / 1e3}", f'"{k * 100:,.2f}"'), "1,000.00"),
    ],
)
@pytest.mark.parametrize("names", [None, ["x (um)"]])
def test_thousands_with_a_sign_are_refused(tmp_path, sign, row, cell, names):
    rows = [sign.join(row(k)) for k in range(300)]
    (tmp_path / "a.csv").write_text("\n".join([f"t (s){sign}x (um)", *rows]) + "\n")
    with pytest.raises(haptix.HaptixError, match=r"a\.csv.*without a sign between") as caught:
        read_table(tmp_path / "a.csv", names)
    assert repr(cell) in str(caught.value)


def test_blanks_in_a_heading_are_no_columns(tmp_path):
    """Tabs and blanks both split the numbers; the heading has blanks of its own."""
    rows = "".join(f"{k}\t{k}\n" for k in range(20))
    (tmp_path / "a.asc").write_text("Time  1 - default rate\tFz\ns\tN\n" + rows)
    assert read_table(tmp_path / "a.asc").units == {"Time  1 - default rate": "s", "Fz": "N"}


@pytest.mark.parametrize("comma", [False, True])
@pytest.mark.parametrize(
    "write", [lambda v: f"{v:.3f}", lambda v: f"{v:.7g}", lambda v: f"{v:.3e}", repr]
)
def test_decimals_are_no_thousands(tmp_path, comma, write):
    """Among them steps of 1/8, which have three decimals or none from 1 on."""
    columns = np.arange(40) / 8, 1.0 + np.arange(40) / 1000, 999.0 + np.arange(40) / 4
    rows = [";".join(write(float(v)) for v in row) for row in zip(*columns, strict=True)]
    text = "\n".join(rows).replace(".", "," if comma else ".")
    (tmp_path / "a.csv").write_text(f"a;b;c\n{text}\n")
    table = read_table(tmp_path / "a.csv")
    for found, wanted in zip(table.columns.values(), columns, strict=True):
        np.testing.assert_allclose(found, wanted, rtol=6e-4)


BEGAN = np.datetime64("2026-11-27T10:00:00.000000")


def tdms(path, channels):
    """Write channels of (group, name, unit, values, further properties) at 1000 a second."""
    nptdms = pytest.importorskip("nptdms")
    with nptdms.TdmsWriter(path) as file:
        file.write_segment([
            nptdms.ChannelObject(group, name, values, {
                "wf_increment": 1e-3, "wf_start_offset": 0.0, "unit_string": unit, **more})
            for group, name, unit, values, more in channels
        ])  # fmt: skip
    return read_table(path)


@pytest.mark.parametrize(
    ("units", "starts"), [(("N", "mm"), None), (("N", ""), None), (("", ""), (BEGAN, BEGAN))]
)
def test_two_instruments_with_channels_of_one_name_are_two(tmp_path, units, starts):
    k = np.arange(20.0)
    more = [{"wf_start_time": start} for start in starts] if starts else [{}, {}]
    table = tdms(tmp_path / "a.tdms", [
        ("Force", "X", units[0], k, more[0]), ("Position", "X", units[1], 3 * k, more[1]),
    ])  # fmt: skip
    assert [*table.columns] == ["Force/X", "Position/X"]
    stated = {"Force/X": units[0], "Position/X": units[1]}
    assert table.units == {name: unit for name, unit in stated.items() if unit}
    np.testing.assert_array_equal(table.columns["Position/X"], 3 * k)


def test_a_unit_of_daqmx_is_one(tmp_path):
    """As DAQmx logs: in words, alone or beside the unit that LabVIEW's waveforms have."""
    in_words = {"NI_UnitDescription": "Newtons", "NI_ChannelName": "Fz"}
    table = tdms(tmp_path / "a.tdms", [
        ("Log", "Fz", "", np.ones(10), in_words),
        ("Log", "Fx", "mN", np.ones(10), {"NI_UnitDescription": "Millinewtons"}),
        ("Log", "drive", "", np.ones(10), {"NI_UnitDescription": "Volts"}),
    ])  # fmt: skip
    assert table.units == {"Fz": "N", "Fx": "mN", "drive": "V"}


@pytest.mark.parametrize("starts", [None, (BEGAN, BEGAN + np.timedelta64(10, "s"))])
def test_groups_of_one_instrument_are_strokes(tmp_path, starts):
    more = [{"wf_start_time": start} for start in starts] if starts else [{}, {}]
    table = tdms(tmp_path / "a.tdms", [
        ("1", "Fz", "N", np.ones(10), more[0]), ("2", "Fz", "N", np.full(10, 2.0), more[1]),
    ])  # fmt: skip
    assert (
        table.columns["Fz"].tolist() == table.columns["group"].tolist() == [1.0] * 10 + [2.0] * 10
    )


@pytest.mark.parametrize(
    ("axis", "unit", "step_s"),
    [
        ("Time", "s", 1e-3), ("Time", "ms", 1e-6), ("", "", 1e-3), ("Time", "", 1e-3),
        ("Zeit", "min", 0.06), ("Position", "mm", None), ("Frequency", "", None),
    ],
)  # fmt: skip
def test_an_axis_of_tdms_has_a_unit(tmp_path, axis, unit, step_s):
    more = {"wf_xname": axis, "wf_xunit_string": unit, "wf_start_offset": 5.0}
    table = tdms(tmp_path / "a.tdms", [("D", "Fz", "N", np.ones(10), more)])
    if step_s is None:
        assert table.times_s == {}
        assert axis in table.understood[1]
    else:
        np.testing.assert_allclose(table.times_s["Fz"], (5000 + np.arange(10)) * step_s)


def test_an_axis_of_lvm_that_is_no_time_gives_none(tmp_path):
    path = tmp_path / "a.lvm"
    lvm_of_several_x_columns(path, ("Fz", "N", "10:11:12.5", np.arange(20)))
    path.write_text(path.read_text().replace("X_Dimension\tTime", "X_Dimension\tLength"))
    table = read_table(path)
    assert table.times_s == {} and "Length" in table.understood[1]


def test_segments_of_lvm_in_two_units_are_refused(tmp_path):
    path, other, k = tmp_path / "a.lvm", tmp_path / "b.lvm", np.arange(20)
    lvm_of_several_x_columns(path, ("Fz", "mN", "10:11:12.5", 1e3 * k))
    lvm_of_several_x_columns(other, ("Fz", "N", "10:11:14.5", k))
    _, segment = other.read_text().split("\n\t\n")
    path.write_text(f"{path.read_text()}\n{segment}")
    with pytest.raises(haptix.HaptixError, match=r"a\.lvm: .*Fz in 'mN' and later in 'N'"):
        read_table(path)


def mat_7_3(path):
    with h5py.File(path, "w", userblock_size=512) as file:
        file["Fz"] = np.ones(20)
    with path.open("r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM")


def hdf5(path):
    with h5py.File(path, "w") as file:
        file["log/Fz"] = np.ones(20)


def workbook(path):
    with zipfile.ZipFile(path, "w") as file:
        file.writestr("xl/worksheets/sheet1.xml", "<worksheet/>")


@pytest.mark.parametrize(
    ("write", "name", "said"),
    [
        (lambda path: scipy.io.savemat(path, {"Fz": np.ones(20)}), "a.mat", "a MATLAB.*writetable"),
        (mat_7_3, "a.mat", "a MATLAB.*writetable"),
        (hdf5, "a.h5", "an HDF5 file.*savetxt"),
        (lambda path: np.save(path, np.ones((20, 3))), "a.npy", "numpy.*savetxt"),
        (workbook, "a.xlsx", "a workbook.*as CSV"),
    ],
)
def test_other_formats_are_named_with_a_way_out(tmp_path, write, name, said):
    write(tmp_path / name)
    with pytest.raises(haptix.HaptixError, match=rf"{name}: expected text.*{said}"):
        read_table(tmp_path / name)


@pytest.mark.parametrize(
    ("head", "sign", "units"),
    [
        ("# t (s),Fz (N)", ",", {"t (s)": "s", "Fz (N)": "N"}),
        ("#t (s);Fz (N)", ";", {"t (s)": "s", "Fz (N)": "N"}),
        ("# t Fz\n# s N", " ", {"t": "s", "Fz": "N"}),
        ("% t Fz\n% s N", " ", {"t": "s", "Fz": "N"}),
        ("%time,field.wrench.force.z", ",", {"%time": "ns"}),
    ],
)
def test_headings_behind_a_sign_of_comments(tmp_path, head, sign, units):
    (tmp_path / "a.txt").write_text(head + "\n" + "".join(f"{k}{sign}{2 * k}\n" for k in range(20)))
    table = read_table(tmp_path / "a.txt")
    assert table.units == units
    assert [values[1] for values in table.columns.values()] == [1.0, 2.0]


def test_a_long_minus_is_a_minus(tmp_path):
    rows = "".join(f"{k},\N{MINUS SIGN}{k}.5\n" for k in range(20))
    (tmp_path / "a.csv").write_text("t (s),Fz (N)\n" + rows, encoding="utf-8")
    assert read_table(tmp_path / "a.csv").columns["Fz (N)"][3] == -3.5


def test_rows_with_labels_are_no_samples(tmp_path):
    """A text of LabChart; rows of its scale are numbers."""
    head = (
        "Interval=\t0.2 ms\nTimeFormat=\tStartOfBlock\nChannelTitle=\tFz\tFx\n"
        "Range=\t2.000 N\t2.000 N\nUnitName=\tN\tmN\n"
        "TopValue=\t2.0\t2.0\nBottomValue=\t-2.0\t-2.0\n"
    )
    rows = "".join(f"{k / 5e3:.4f}\t{k}\t{2 * k}\n" for k in range(20))
    (tmp_path / "a.txt").write_text(head + rows)
    table = read_table(tmp_path / "a.txt")
    assert table.units == {"Fz": "N", "Fx": "mN"}
    assert table.rate_hz == pytest.approx(5000)
    assert table.columns["Fx"].tolist() == [2.0 * k for k in range(20)]


def test_a_text_that_names_matlab_is_a_text(tmp_path):
    rows = "".join(f"{k},{k}\n" for k in range(20))
    (tmp_path / "a.csv").write_text("MATLAB export of 27 November\nt (s),Fz (N)\n" + rows)
    assert read_table(tmp_path / "a.csv").units == {"t (s)": "s", "Fz (N)": "N"}


SETTINGS = [
    "Model,MSO4034", "Horizontal Units,s,,", "Sample Interval,2e-4,,", "Probe Attenuation,10,10,1",
    "Vertical Units,V,V,V", "Vertical Offset,0,0,0", "Vertical Scale,2,2,1",
    "Vertical Position,0,0,0", ",,,", "Label,,,", "TIME,CH1,CH2,CH3",
]  # fmt: skip


def test_settings_of_a_scope_are_no_samples(tmp_path):
    """Tektronix' MSO4000 states four settings of each channel in lines as wide as its samples."""
    k = np.arange(40.0)
    rows = [f"{2e-4 * i:.6e},{i:.4f},{2 * i:.4f},{3 * i:.4f}" for i in range(40)]
    path = tmp_path / "a.csv"
    path.write_text("\n".join([*SETTINGS, *rows]) + "\n")
    table = read_table(path)
    assert [*table.columns] == ["TIME", "CH1", "CH2", "CH3"]
    np.testing.assert_array_equal(table.columns["CH3"], 3 * k)


def test_settings_beside_the_samples_leave_them_all(tmp_path):
    """Tektronix' TDS2000 has its settings in the first columns of the first lines of samples."""
    beside = [
        "Record Length,40,",
        "Sample Interval,2e-4,",
        "Trigger Point,20,",
        ",,",
        "Source,CH1,",
    ]
    rows = [f"{(beside + [',,'] * 35)[i]},{2e-4 * i:.6f},{i:.4f}," for i in range(40)]
    path = tmp_path / "a.csv"
    path.write_text("\n".join(rows) + "\n")
    samples = [*read_table(path).columns.values()][-1]
    np.testing.assert_array_equal(samples, np.arange(40.0))
