"""Files as the programs of instruments write them, against the signals that they were made of."""

from dataclasses import replace

import numpy as np
import pytest

import haptix
from calibration import ColumnMap, CsvSource, Stroke, StrokeRecording
from calibration.measure.columns import proposed
from calibration.measure.recording import SIGNALS
from calibration.measure.reduction import reduce_stroke
from calibration.measure.segmentation import touches
from haptix.base.tables import read_table, split_unit
from tests.command_line import run_haptix

RATE_HZ = 2000.0
STROKE = Stroke(number=1, normal_force_n=0.5, voltage_v=100.0, frequency_hz=125.0)
NAMES = ("t_s", "normal_force_n", "tangential_force_n", "x_mm", "drive_v")


@pytest.fixture(scope="module")
def made(recorded):
    return recorded(STROKE, rate_hz=RATE_HZ)


def columns_of(made, **scales):
    return [getattr(made, name) * scales.get(name, 1.0) for name in NAMES]


def text_of(columns, sign=",", comma=False):
    def cell(value):
        return f"{value:.7g}".replace(".", ",") if comma else f"{value:.7g}"

    return "\n".join(sign.join(map(cell, row)) for row in zip(*columns, strict=True)) + "\n"


def semicolons(made, path):
    head = "Zeit [s];Fz [mN];Fx [mN];Weg [\N{MICRO SIGN}m];Spannung [V]\n"
    scales = {"normal_force_n": 1e3, "tangential_force_n": 1e3, "x_mm": 1e3}
    path.write_text(head + text_of(columns_of(made, **scales), ";", True), encoding="cp1252")


def units_row(made, path):
    head = "Tribometer 3\nOperator: me\n\nTime\tFz\tFx\tPosition\tMonitor\nms\t(N)\tN\tmm\tV\n"
    path.write_text(head + text_of(columns_of(made, t_s=1e3), "\t"))


def of_excel(made, path):
    head = "Time (s)\tNormal force (N)\tFriction force (N)\tPosition (mm)\tDrive (V)\n"
    path.write_text(head + text_of(columns_of(made), "\t", True), encoding="utf-16")


def quoted(made, path):
    rows = text_of(columns_of(made), ";", True).replace(";", '","').replace("\n", '"\n"')[:-1]
    path.write_text(f'"Time (s)","Fz (N)","Fx (N)","x (mm)","Drive (V)"\n"{rows}')


def blanks(made, path):
    head = "     Time/s      Fz/N      Fx/N      x/mm     Monitor/V\n"
    path.write_text(head + text_of(columns_of(made), "     "))


def clock(made, path, pattern="{h:02d}:{m:02d}:{s:09.6f}", noon=86_398.5):
    """Times of day, over midnight."""
    t, *others = columns_of(made)
    rows = text_of(others).splitlines()
    with path.open("w") as file:
        file.write("Timestamp,Fz (N),Fx (N),x (mm),Drive (V)\n")
        for at, row in zip(t + noon, rows, strict=True):
            day, second = divmod(round(at, 6), 86_400)
            minute, s = divmod(second, 60)
            h, m = divmod(int(minute), 60)
            date = f"2026-11-{27 + int(day)}"
            file.write(pattern.format(date=date, h=h, m=m, s=s, h12=(h - 1) % 12 + 1,
                                      half="AM" if h < 12 else "PM") + f",{row}\n")  # fmt: skip


def dates(made, path):
    clock(made, path, "{date}T{h:02d}:{m:02d}:{s:09.6f}Z")


def half_days(made, path):
    clock(made, path, "{h12}:{m:02d}:{s:09.6f} {half}", noon=12 * 3600 + 3599.5)


def counts_of_ati(made, path):
    """The demonstration program of a network sensor (manual 9610-05-Ethernet Axia, 7.4)."""
    t, fz, fx, x, v = columns_of(made)
    head = (
        '"Start Time: ","11/27/2026 10:11:12 AM"\n"RDT Sample Rate: ","2000"\n'
        '"Force Units: ","N"\n"Counts per Unit Force: ","1000000"\n"Torque Units: ","N-m"\n'
        '"Counts per Unit Torque: ","1000000"\n'
        '"Status (hex)","RDT Sequence","F/T Sequence","Fx","Fy","Fz","Tx","Ty","Tz",'
        '"Position (mm)","Drive (V)","Time"\n'
    )
    with path.open("w") as file:
        file.write(head)
        for k in range(len(t)):
            cells = ["0x00000000", k + 1, k + 7, round(fx[k] * 1e6), 0, round(fz[k] * 1e6), 0, 0, 0]
            cells += [f"{x[k]:.7g}", f"{v[k]:.7g}", f"10:11:{12 + t[k] // 0.02 * 0.02:06.3f} AM"]
            file.write(",".join(f'"{cell}"' for cell in cells) + "\n")


def waveforms(made, path):
    """LabVIEW's export of waveforms: "delta t" above, and no times of single samples."""
    head = "waveform\t[0]\t[1]\t[2]\t[3]\nt0\t27.11.2026 10:00:00\ndelta t\t0,000500\t0,000500\n\n"
    head += "Fz (N)\tFx (N)\tPosition (mm)\tMonitor (V)\n"
    path.write_text(head + text_of(columns_of(made)[1:], "\t", True))


def waveforms_of_two_tasks(made, path):
    """The place was measured from 0.1 s on, at a tenth of the rate: its column ends earlier."""
    late = round(0.1 * RATE_HZ)
    fz, fx, x, v = (text_of([column], "\t", True).split() for column in columns_of(made)[1:])
    x = x[late::10] + [""] * len(fz)
    rows = "".join("\t".join(row) + "\n" for row in zip(fz, fx, x, v, strict=False))
    head = "waveform\t[0]\t[1]\t[2]\t[3]\n"
    head += "t0" + "".join(f"\t27.11.2026 23:59:59,{at}" for at in ("95", "95")) + "\t28.11.2026 "
    head += "00:00:00,05\t27.11.2026 23:59:59,95\n"
    head += "delta t\t0,000500\t0,000500\t0,005000\t0,000500\n\n"
    path.write_text(head + "Fz (N)\tFx (N)\tPosition (mm)\tMonitor (V)\n" + rows)


def lvm(made, path, x_columns="One", began=()):
    """A LabVIEW measurement file, by its specification (version 2)."""
    columns, count = columns_of(made)[1:], len(made.t_s)
    lines = [
        "LabVIEW Measurement\t", "Writer_Version\t2", "Reader_Version\t2", "Separator\tTab",
        "Decimal_Separator\t,", "Multi_Headings\tYes", f"X_Columns\t{x_columns}",
        "Time_Pref\tRelative", "Date\t2026/11/27", "Time\t10:11:12,123",
        "***End_of_Header***\t", "\t", "Channels\t4\t\t\t\t",
        *began, "Samples" + f"\t{count}" * 4, "Y_Unit_Label\tN\tN\tmm\tV",
        "X_Dimension" + "\tTime" * 4,
        "X0" + "\t0,0000000000000000E+0" * 4, "Delta_X" + "\t0,000500" * 4,
        "***End_of_Header***\t\t\t\t\t", "X_Value\tFz\tFx\tPosition\tMonitor\tComment",
    ]  # fmt: skip
    first = [made.t_s] if x_columns == "One" else []
    rows = text_of([*first, *columns], "\t", True)
    if not first:
        rows = "".join(f"\t{row}\n" for row in rows.splitlines())
    path.write_text("\n".join(lines) + "\n" + rows)


def lvm_without_times(made, path):
    lvm(made, path, "No")


def tdms_of(path, *groups, starts=None):
    from nptdms import ChannelObject, TdmsWriter

    with TdmsWriter(path) as file:
        for number, (group, channels) in enumerate(groups):
            began = {} if starts is None else {"wf_start_time": starts[number]}
            file.write_segment([
                ChannelObject(group, name, values, {
                    "wf_increment": step, "wf_start_offset": 0.0, "unit_string": unit, **began})
                for name, unit, step, values in channels
            ])  # fmt: skip


def tdms(made, path):
    """Force and stage at rates of their own."""
    _, fz, fx, x, v = columns_of(made)
    step = 1 / RATE_HZ
    force = [("Fz", "N", step, fz), ("Fx", "N", step, fx), ("AO monitor", "V", step, v)]
    tdms_of(path, ("Force", force), ("Stage", [("Position", "m", 20 * step, x[::20] / 1e3)]))


def lvm_of_two_tasks(made, path):
    """Each channel has its own start; the place was measured from 0.1 s on, over midnight."""
    dates = "Date\t2026/11/27\t2026/11/27\t2026/11/28\t2026/11/27"
    times = "Time\t23:59:59,950\t23:59:59,95\t00:00:00,050000000\t23:59:59,950"
    later = replace(made, x_mm=np.roll(made.x_mm, -round(0.1 * RATE_HZ)))
    lvm(later, path, "No", (dates, times))


def tdms_of_axes(made, path):
    """The groups of both instruments have an X and a Z."""
    _, fz, fx, x, v = columns_of(made)
    step = 1 / RATE_HZ
    force = [("X", "N", step, fx), ("Z", "N", step, fz)]
    stage = [("X", "mm", step, x), ("Z", "mm", step, 0 * x)]
    tdms_of(path, ("Force", force), ("Position", stage), ("Drive", [("AO", "V", step, v)]))


BEGAN = np.datetime64("2026-11-27T10:00:00.000000")


def tdms_of_two_tasks(made, path, began=BEGAN):
    """The stage was measured from 0.1 s on."""
    _, fz, fx, x, v = columns_of(made)
    step, late = 1 / RATE_HZ, round(0.1 * RATE_HZ)
    force = [("Fz", "N", step, fz), ("Fx", "N", step, fx), ("AO monitor", "V", step, v)]
    stage = [("Position", "m", step, x[late:] / 1e3)]
    starts = (began, BEGAN + np.timedelta64(100_000, "us"))
    tdms_of(path, ("Force", force), ("Stage", stage), starts=starts)


@pytest.mark.parametrize(
    ("write", "name"),
    [(lvm_of_two_tasks, "a.lvm"), (tdms_of_two_tasks, "a.tdms"), (waveforms_of_two_tasks, "a.txt")],
)
def test_channels_that_began_at_different_times_are_put_in_line(made, tmp_path, write, name):
    write(made, tmp_path / name)
    columns, missing, _ = proposed(read_table(tmp_path / name))
    assert missing == ()
    found = columns.signals(tmp_path / name)
    # From where both are measured, and half a step of the slower one before that.
    half_s = 2.5e-3 if name == "a.txt" else 0.0
    assert found["t_s"][0] == pytest.approx(0.1 - half_s / 2, abs=half_s / 2 + 1e-6)
    at = np.round(found["t_s"] * RATE_HZ).astype(int)
    at = at[at < len(made.t_s)]
    for signal in NAMES[1:]:
        wanted = getattr(made, signal)[at]
        # The place of waveforms is on lines of 5 ms.
        atol = 0.1 if (name, signal) == ("a.txt", "x_mm") else 2e-5
        np.testing.assert_allclose(found[signal][: len(at)], wanted, atol=atol)


def test_a_start_that_labview_has_not_set_is_none(made, tmp_path):
    """It writes 0, which is 1904: one channel of that and one of today are not 120 years apart."""
    tdms_of_two_tasks(made, tmp_path / "a.tdms", np.datetime64("1904-01-01T00:00:00.000000"))
    times = read_table(tmp_path / "a.tdms").times_s
    assert times["Force/Fz"][0] == times["Stage/Position"][0] == 0.0


def of_a_scope(head, row, count=2500):
    """A file of an oscilloscope: 400 ns a sample, the sine of k/30 V."""
    rows = [row(k, k * 4e-7 - 5e-4, np.sin(k / 30)) for k in range(count)]
    return "\n".join([*head, *rows]) + "\n"


#: Tektronix TDS 1000 and 2000 have their settings left of the first samples.
SETTINGS = (
    "Record Length,2500,", "Sample Interval,4e-07,", "Trigger Point,1250,", ",,", ",,", ",,",
    "Source,CH1,", "Vertical Units,V,", "Vertical Scale,0.5,", "Horizontal Units,s,",
)  # fmt: skip


def tektronix(k, t, volts):
    return f"{SETTINGS[k] if k < len(SETTINGS) else ',,'},{t:018.12f},{volts:10.5f},"


@pytest.mark.parametrize(
    ("text", "t", "volts"),
    [
        (of_a_scope((), tektronix), "4", "5"),
        (
            of_a_scope(
                ("x-axis,1,2", "second,Volt,Volt"),
                lambda k, t, v: f"{t:+.8E},{v:+.5E},{k / 1e3:+.5E}",
            ),
            "x-axis", "1",
        ),
    ],
    ids=["Tektronix", "Keysight"],
)  # fmt: skip
def test_an_oscilloscopes_file_is_read(tmp_path, text, t, volts):
    (tmp_path / "a.csv").write_text(text)
    table = read_table(tmp_path / "a.csv")
    assert np.diff(table.columns[t]) == pytest.approx(4e-7, abs=1e-11)
    np.testing.assert_allclose(table.columns[volts], np.sin(np.arange(2500) / 30), atol=1e-5)
    if table.units:
        assert table.units == {"x-axis": "s", "1": "V", "2": "V"}


def test_waveforms_whose_starts_are_no_times_begin_together(tmp_path):
    rows = "".join(f"{k}\t{2 * k}\n" for k in range(20))
    head = "t0\t0\t0\ndelta t\t0.001\t0.002\n\nFz (N)\tx (mm)\n"
    (tmp_path / "a.txt").write_text(head + rows)
    times = read_table(tmp_path / "a.txt").times_s
    assert (times["Fz (N)"][1], times["x (mm)"][1]) == (0.001, 0.002)


def test_two_columns_of_one_name_are_two(tmp_path):
    rows = "".join(f"{k},{k * 2},{k * 3}\n" for k in range(20))
    (tmp_path / "a.csv").write_text("Time (s),Force (N),Force (N)\n" + rows)
    columns = read_table(tmp_path / "a.csv").columns
    assert [(name, values[1]) for name, values in columns.items()] == [
        ("Time (s)", 1.0), ("Force (N)", 2.0), ("Force (N) 2", 3.0),
    ]  # fmt: skip


def test_a_stages_record_is_read(tmp_path):
    """A GCS array as `savegcsarray` of PIPython 2.11.0.6 writes it, with blanks at the ends."""
    head = (
        "# VERSION = 1 \n# TYPE = 1 \n# SEPARATOR = 32 \n# DIM = 2 \n# SAMPLE_TIME = 0.001 \n"
        "# NDATA = 2500 \n# NAME0 = Actual Position of Axis 1 \n"
        "# NAME1 = Position Error of Axis 1 \n# \n# END_HEADER \n"
    )
    rows = "".join(f"{k * 0.05:.6f} {0.001 * (k % 10):.6f} \n" for k in range(2500))
    (tmp_path / "a.dat").write_text(head + rows)
    table = read_table(tmp_path / "a.dat")
    assert [*table.columns] == ["Actual Position of Axis 1", "Position Error of Axis 1"]
    assert table.rate_hz == pytest.approx(1000.0)
    np.testing.assert_allclose(
        table.columns["Actual Position of Axis 1"], 0.05 * np.arange(2500), atol=1e-6
    )


FILES = {
    "decimal commas, cp1252": (semicolons, "a.csv"),
    "a row of units": (units_row, "a.txt"),
    "UTF-16": (of_excel, "a.txt"),
    "decimal commas in quotes": (quoted, "a.csv"),
    "blanks": (blanks, "a.dat"),
    "times of day": (clock, "a.csv"),
    "dates": (dates, "a.csv"),
    "half days": (half_days, "a.csv"),
    "counts of a network sensor": (counts_of_ati, "a.csv"),
    "waveforms of LabVIEW": (waveforms, "a.txt"),
    "LVM": (lvm, "a.lvm"),
    "LVM without times": (lvm_without_times, "a.lvm"),
    "TDMS of two rates": (tdms, "a.tdms"),
    "TDMS of axes": (tdms_of_axes, "a.tdms"),
}


@pytest.mark.parametrize("kind", FILES)
def test_what_an_instrument_wrote_is_read_by_the_map_that_is_proposed(made, tmp_path, kind):
    write, name = FILES[kind]
    write(made, tmp_path / name)
    columns, missing, _ = proposed(read_table(tmp_path / name))
    assert missing == ()
    columns.save(tmp_path / "map.toml")
    found = ColumnMap.load(tmp_path / "map.toml").signals(tmp_path / name)
    assert np.diff(found["t_s"]) == pytest.approx(1 / RATE_HZ, abs=2e-6)
    count = len(found["t_s"])
    assert count >= len(made.t_s) - 20  # of the slower rate, after its last sample
    for signal in NAMES[1:]:
        # Seven digits; the position of the slower stage is exact on its lines of 10 ms.
        atol = 0.3 if (kind, signal) == ("TDMS of two rates", "x_mm") else 2e-5
        np.testing.assert_allclose(found[signal], getattr(made, signal)[:count], atol=atol)


def test_a_proposed_map_takes_the_unit_of_each_file(made, tmp_path):
    """An instrument's unit changes with its range."""
    for number, (unit, scale) in enumerate((("mN", 1e3), ("N", 1.0))):
        scales = {"normal_force_n": scale, "tangential_force_n": scale}
        head = f"t,Fz,Fx,Position,Monitor\ns,{unit},{unit},mm,V\n"
        (tmp_path / f"{number}.csv").write_text(head + text_of(columns_of(made, **scales)))
    columns, _, _ = proposed(read_table(tmp_path / "0.csv"))
    for number in range(2):
        found = columns.signals(tmp_path / f"{number}.csv")
        np.testing.assert_allclose(found["normal_force_n"], made.normal_force_n, atol=1e-6)


def test_a_unit_that_nobody_states_is_asked_for(made, tmp_path):
    (tmp_path / "a.csv").write_text("t,Fz,Fx,pos,volts\n" + text_of(columns_of(made)))
    columns, missing, _ = proposed(read_table(tmp_path / "a.csv"))
    assert sorted(note.partition(":")[0] for note in missing) == sorted(NAMES)
    with pytest.raises(
        haptix.HaptixError, match=r'a\.csv: expected the unit of column "t".*ms, us'
    ):
        columns.signals(tmp_path / "a.csv")


def test_a_rate_stands_for_times(made, tmp_path):
    (tmp_path / "a.csv").write_text("Fz,Fx,x\n" + text_of(columns_of(made)[1:4]))
    signals = {"normal_force_n": "Fz", "tangential_force_n": "Fx"}
    columns = {name: {"column": at, "unit": "N"} for name, at in signals.items()}
    columns["x_mm"] = {"column": "x", "unit": "mm"}
    with pytest.raises(haptix.HaptixError, match=r"expected t_s.*rate_hz"):
        ColumnMap(columns=columns).signals(tmp_path / "a.csv")
    found = ColumnMap(columns=columns, rate_hz=RATE_HZ).signals(tmp_path / "a.csv")
    np.testing.assert_allclose(found["t_s"], made.t_s, atol=1e-9)
    counted = {**columns, "t_s": {"column": "Fz", "unit": "samples"}}
    with pytest.raises(haptix.HaptixError, match="rate_hz with samples"):
        ColumnMap(columns=counted).signals(tmp_path / "a.csv")


def two_files(made, folder, head, other, **of_x):
    t, fz, fx, _, v = columns_of(made)
    (folder / "stroke-001.csv").write_text(
        f"{head},Fz (N),Fx (N),V (V)\n" + text_of([t + 100.0, fz, fx, v])
    )
    (folder / "stroke-001-stage.csv").write_text(other)
    columns = {
        "t_s": {"column": head}, "normal_force_n": {"column": "Fz"},
        "tangential_force_n": {"column": "Fx"}, "drive_v": {"column": "V (V)"},
        "x_mm": {"column": "pos", "unit": "mm", "file": "-stage.csv", **of_x},
    }  # fmt: skip
    return ColumnMap(columns=columns)


def test_two_files_of_two_rates_are_one_recording(made, tmp_path):
    slow = slice(40, -60, 10)
    stage = "time (ms),pos\n" + text_of([(made.t_s[slow] + 100.0) * 1e3, made.x_mm[slow]])
    columns = two_files(made, tmp_path, "Time (s)", stage, time="time (ms)")
    found = columns.signals(tmp_path / "stroke-001.csv")
    # Half a step of the stage beyond its first sample.
    assert found["t_s"][0] - 100 == pytest.approx(made.t_s[40] - 2.5e-3, abs=1e-6)
    at = np.rint((found["t_s"] - 100) * RATE_HZ).astype(int)
    np.testing.assert_allclose(found["x_mm"], made.x_mm[at], atol=0.15)
    np.testing.assert_allclose(found["drive_v"], made.drive_v[at], atol=1e-4)
    source = CsvSource(tmp_path, columns)
    source.start(STROKE, None)
    assert source.assumed == ()
    point = reduce_stroke(StrokeRecording.of(STROKE, source.finish()))
    assert point.outlier == "" and point.mu == pytest.approx(0.3, rel=0.02)


@pytest.mark.parametrize(
    ("head", "scale", "stated"),
    [("Time (min)", 1 / 60, {}), ("Time (ns)", 1e9, {}), ("Time", 1e3, {"time_unit": "ms"})],
)
def test_times_of_a_second_file_have_units_as_those_of_the_first(
    made, tmp_path, head, scale, stated
):
    rows = zip(((made.t_s + 100.0) * scale).tolist(), made.x_mm.tolist(), strict=True)
    stage = f"{head},pos\n" + "".join(f"{t!r},{x!r}\n" for t, x in rows)
    columns = two_files(made, tmp_path, "Time (s)", stage, time=head, **stated)
    found = columns.signals(tmp_path / "stroke-001.csv")
    np.testing.assert_allclose(found["x_mm"], made.x_mm, atol=1e-3)


@pytest.mark.parametrize("head", ["Time", "Time (turns)"])
def test_times_of_a_second_file_without_a_unit_are_asked_for(made, tmp_path, head):
    stage = f"{head},pos\n" + text_of([made.t_s * 1e3, made.x_mm])
    columns = two_files(made, tmp_path, "Time (s)", stage, time=head)
    with pytest.raises(haptix.HaptixError, match=r"-stage\.csv: expected the unit.*time_unit"):
        columns.signals(tmp_path / "stroke-001.csv")


def test_two_files_by_two_clocks_are_refused(made, tmp_path):
    stage = "time (s),pos\n" + text_of([made.t_s, made.x_mm])
    columns = two_files(made, tmp_path, "Time (s)", stage, time="time (s)")
    with pytest.raises(haptix.HaptixError, match="no times in common"):
        columns.signals(tmp_path / "stroke-001.csv")
    columns = two_files(made, tmp_path, "Time (s)", stage)
    with pytest.raises(haptix.HaptixError, match=r"-stage\.csv: expected time = .*rate_hz"):
        columns.signals(tmp_path / "stroke-001.csv")


def test_a_drive_slower_than_the_forces_is_refused(made, tmp_path):
    step = 1 / RATE_HZ
    _, fz, fx, x, v = columns_of(made)
    force = [("Fz", "N", step, fz), ("Fx", "N", step, fx), ("x", "mm", step, x)]
    tdms_of(tmp_path / "a.tdms", ("F", force), ("D", [("drive", "V", 4 * step, v[::4])]))
    columns, _, _ = proposed(read_table(tmp_path / "a.tdms"))
    with pytest.raises(haptix.HaptixError, match="fewer samples per second"):
        columns.signals(tmp_path / "a.tdms")


GAUGES = [f"SG{k}" for k in range(6)]


@pytest.mark.parametrize("stage", [slice(None, None, 10), slice(None)])
def test_a_channel_of_another_length_without_times_is_refused(made, tmp_path, stage):
    """Its samples are not those of the first times, one after the other."""
    from nptdms import ChannelObject, TdmsWriter

    t, fz, fx, x, _ = columns_of(made)
    force = slice(None, None, 2) if stage == slice(None) else slice(None)
    with TdmsWriter(tmp_path / "a.tdms") as file:
        file.write_segment([
            ChannelObject(group, name, values, {"unit_string": unit})
            for group, name, unit, values in (
                ("Force", "Time", "s", t[force]), ("Force", "Fz", "N", fz[force]),
                ("Force", "Fx", "N", fx[force]), ("Stage", "Position", "mm", x[stage]),
            )
        ])  # fmt: skip
    columns, missing, _ = proposed(read_table(tmp_path / "a.tdms"))
    assert missing == ()
    with pytest.raises(haptix.HaptixError, match=r'a\.tdms: column "Stage/Position" has .*rate_hz'):
        columns.signals(tmp_path / "a.tdms")


def test_gauge_voltages_and_their_matrix_are_forces(made, tmp_path):
    matrix = np.random.default_rng(0).normal(0, 5, (6, 6))
    t, fz, fx, x, v = columns_of(made)
    zero = np.zeros_like(t)
    volts = np.linalg.solve(matrix, np.stack([fx, zero, fz, zero, zero, zero]))
    head = ",".join(["t (s)", *GAUGES, "x (mm)", "V (V)"])
    (tmp_path / "a.csv").write_text(head + "\n" + text_of([t, *volts, x, v]))
    columns = {
        "t_s": {"column": "t"}, "normal_force_n": {"column": "Fz"},
        "tangential_force_n": {"column": "Fx"}, "x_mm": {"column": "x"},
        "drive_v": {"column": "V (V)"},
    }  # fmt: skip
    gauges = {"columns": GAUGES, "matrix": matrix.tolist()}
    found = ColumnMap(columns=columns, gauges=gauges).signals(tmp_path / "a.csv")
    np.testing.assert_allclose(found["normal_force_n"], fz, atol=1e-5)
    np.testing.assert_allclose(found["tangential_force_n"], fx, atol=1e-5)
    wrong = {**gauges, "columns": [*GAUGES[:5], "SG9"]}
    with pytest.raises(haptix.HaptixError, match=r"missing columns 'SG9'"):
        ColumnMap(columns=columns, gauges=wrong).signals(tmp_path / "a.csv")


@pytest.fixture(scope="module")
def session(recorded):
    """Three strokes of very different force, one after the other."""
    forces = (0.1, 0.9, 0.3)
    parts = [
        recorded(STROKE.model_copy(update={"normal_force_n": n}), rate_hz=RATE_HZ) for n in forces
    ]
    joined = [np.concatenate([getattr(p, name) for p in parts]) for name in NAMES]
    joined[0] = np.arange(len(joined[0])) / RATE_HZ
    numbers = np.repeat([1, 2, 3], [len(p.t_s) for p in parts])
    return parts, joined, numbers


@pytest.mark.parametrize("how", ["touches", "column", "TDMS"])
def test_one_file_of_all_strokes(session, tmp_path, how):
    parts, joined, numbers = session
    path = tmp_path / ("all.tdms" if how == "TDMS" else "all.csv")
    head = "Time (s),Fz (N),Fx (N),x (mm),Drive (V)"
    if how == "column":
        path.write_text(f"{head},Trial\n" + text_of([*joined, numbers]))
    elif how == "touches":
        path.write_text(f"{head}\n" + text_of(joined))
    else:
        units = dict(zip(("Fz", "Fx", "x", "drive"), ("N", "N", "mm", "V"), strict=True))
        tdms_of(path, *[
            (f"stroke {k}", [(name, unit, 1 / RATE_HZ, values) for (name, unit), values
                             in zip(units.items(), columns_of(part)[1:], strict=True)])
            for k, part in enumerate(parts, 1)
        ])  # fmt: skip
    columns, missing, _ = proposed(read_table(path))
    assert missing == ()
    source = CsvSource(path, columns, 3)
    for number, part in enumerate(parts, 1):
        stroke = part.stroke.model_copy(update={"number": number})
        source.start(stroke, None)
        found = StrokeRecording.of(stroke, source.finish())
        point, plain = reduce_stroke(found), reduce_stroke(part)
        assert point.outlier == ""
        assert point.mu == pytest.approx(plain.mu, rel=0.01)
    source.start(STROKE.model_copy(update={"number": 9}), None)
    with pytest.raises(haptix.HaptixError, match="has no stroke 9, but 1, 2, 3"):
        source.finish()
    if how == "touches":
        with pytest.raises(haptix.HaptixError, match="expected 4 strokes in it, got 3 touches"):
            CsvSource(path, columns, 4)


def test_touches_meet_between_two(session):
    _, joined, numbers = session
    ends = np.flatnonzero(np.diff(numbers)) + 1
    found = touches(joined[0], joined[1])
    assert [b for _, b in found[:-1]] == pytest.approx(ends, abs=0.05 * RATE_HZ)
    assert touches(joined[0], np.zeros_like(joined[1])) == []


def test_the_long_stroke_of_the_default_plan_is_read(tmp_path):
    count = 157_991
    t = np.arange(count) * 1e-4
    table = np.c_[t, t * 0 + 0.8123, t * 0 + 0.2345, t * 2.5, t * 0 + 150]
    np.savetxt(tmp_path / "a.csv", table, "%.7g", ",", header="Time,Fz,Fx,x,V", comments="")
    units = dict(zip(NAMES, ("s", "N", "N", "mm", "V"), strict=True))
    headings = dict(zip(NAMES, ("Time", "Fz", "Fx", "x", "V"), strict=True))
    columns = {name: {"column": headings[name], "unit": unit} for name, unit in units.items()}
    found = ColumnMap(columns=columns).read(tmp_path / "a.csv")
    assert len(found["t_s"]) == count and found["t_s"][-1] == pytest.approx(t[-1])
    assert set(found) == set(SIGNALS)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("0,001,0,2,0,3\n" * 20, "1, 2"),  # six columns of whole numbers
        ("no numbers\nat all\n", "decimal commas need another sign"),
        ("", "expected a table"),
    ],
)
def test_what_is_no_table(tmp_path, text, said):
    (tmp_path / "a.csv").write_text(text)
    try:
        table = read_table(tmp_path / "a.csv")
    except haptix.HaptixError as error:
        assert said in str(error) and "a.csv" in str(error)
    else:
        assert "no headings" in table.understood[1] and len(table.columns) == 6


def test_headings_have_units():
    found = [split_unit(text) for text in ("Fz (mN)", "Fz [N]", "Fz/N", "t / msec", "pos (1)", "a")]
    assert found == [("Fz", "mN"), ("Fz", "N"), ("Fz", "N"), ("t", "ms"), ("pos", "1"), ("a", "")]


def test_the_command_shows_what_it_understood(made, tmp_path):
    semicolons(made, tmp_path / "a.csv")
    done = run_haptix("calibrate", "columns", tmp_path / "a.csv", "--out", tmp_path / "map.toml")
    assert done.code == 0
    for said in ("semicolons between 5 columns, decimal commas", "Fz [mN]", "normal_force_n"):
        assert said in done.out
    assert set(ColumnMap.load(tmp_path / "map.toml").signals(tmp_path / "a.csv")) == set(SIGNALS)
    path = tmp_path / "a.csv"
    lines = path.read_text(encoding="cp1252").splitlines(keepends=True)
    lines[4] = lines[4].replace(lines[4].split(";")[1], "Infinity")
    path.write_text("".join(lines), encoding="cp1252")
    done = run_haptix("calibrate", "columns", path)
    assert "Fz [mN]: 1 cells are no finite numbers" in done.out and " inf " not in done.out
    (tmp_path / "b.csv").write_text("t,Fz\n" + text_of(columns_of(made)[:2]))
    done = run_haptix("calibrate", "columns", tmp_path / "b.csv")
    assert done.code == 1 and "open: tangential_force_n: not found" in done.out
