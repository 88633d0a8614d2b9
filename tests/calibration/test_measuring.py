"""Playing a protocol: what is on disk, when, and what becomes of strokes that are off."""

import logging
from unittest.mock import patch

import numpy as np
import pytest

import firmware_io
import haptix
from calibration import (
    AnalogSource,
    ColumnMap,
    CsvSource,
    Protocol,
    Session,
    SessionInfo,
    Stroke,
    StrokeRecording,
    measure,
)
from calibration.measure.measuring import Watcher, drive_for
from calibration.measure.recording import SIGNALS
from calibration.measure.sources import InputChannel, Live, StrokeDrive, open_inputs


def protocol(count=3, volts=100.0):
    return Protocol(
        strokes=tuple(
            Stroke(number=n + 1, normal_force_n=0.5, voltage_v=volts, frequency_hz=125.0)
            for n in range(count)
        )
    )


class Scripted:
    """A source that gives a fault for each attempt, in turn."""

    is_live = False
    instruments = {"force sensor": "FT1"}  # noqa: RUF012

    def __init__(self, recorded, faults=(), before=lambda: None):
        self.recorded, self.faults, self.before = recorded, list(faults), before
        self.played = []

    def start(self, stroke, played):
        self.before()
        self.played.append(played)
        fault = self.faults.pop(0) if self.faults else {}
        made = self.recorded(stroke, **{"seed": stroke.number, **fault})
        self.signals = {name: getattr(made, name) for name in SIGNALS}

    def live(self, t_s):
        return Live.at(self.signals, t_s)

    def finish(self):
        return self.signals


@pytest.fixture
def session(tmp_path, screen, finger):
    return Session.begin(tmp_path / "s", protocol(), SessionInfo(screen=screen, finger=finger))


def test_every_stroke_is_on_disk_before_the_next_starts(session, recorded):
    on_disk = []
    before = lambda: on_disk.append(len(session.recordings))  # noqa: E731
    outcome = measure(session, Scripted(recorded, before=before))
    assert on_disk == [0, 1, 2]
    assert (outcome.accepted, outcome.rejected, outcome.still_open) == (3, 0, ())
    first = session.recordings[0]
    assert first.conditions.instruments == {"force sensor": "FT1"}
    assert first.conditions.started  # a date


def test_strokes_that_are_off_are_repeated_and_kept_apart(session, recorded, caplog):
    caplog.set_level(logging.INFO, "calibration")
    told = []
    faults = [{"force_share": 1.3}, {"speed_share": 0.6}, {}]
    source = Scripted(recorded, faults)
    watcher = Watcher(
        done=lambda stroke, wrong: told.append((stroke.number, [w.kind for w in wrong]))
    )
    outcome = measure(session, source, watcher=watcher)
    assert told[:3] == [(1, ["force off"]), (1, ["speed off"]), (1, [])]
    assert (outcome.accepted, outcome.rejected) == (3, 2)
    logged = [record.getMessage().partition(":")[0] for record in caplog.records]
    repeated, kept_ones = ["stroke 1 is repeated"] * 2, [f"stroke {n} is kept" for n in (1, 2, 3)]
    assert logged == repeated + kept_ones
    kept = sorted(path.name for path in (session.folder / "rejected").iterdir())
    assert kept == ["stroke-001-1.h5", "stroke-001-2.h5"]
    assert (
        StrokeRecording.load(session.folder / "rejected" / kept[0]).findings[0].startswith("force")
    )


def test_a_stroke_that_never_succeeds_stays_open(session, recorded):
    outcome = measure(session, Scripted(recorded, [{"way_share": 0.0}] * 2), most_tries=2)
    assert [one.number for one in outcome.still_open] == [1]
    assert outcome.accepted == 2


def test_an_interrupted_session_is_taken_up(tmp_path, session, recorded, screen, finger):
    class Unplugged(Exception):
        pass

    def unplug():
        if session.recordings:
            raise Unplugged

    with pytest.raises(Unplugged):
        measure(session, Scripted(recorded, before=unplug))
    first = session.path_of(session.protocol.strokes[0]).read_bytes()
    info = SessionInfo(screen=screen, finger=finger)
    with pytest.raises(haptix.InputError, match="--resume"):
        Session.begin(session.folder, protocol(), info)
    with pytest.raises(haptix.InputError, match="another protocol"):
        Session.begin(session.folder, protocol(4), info, resume=True)
    resumed = Session.begin(session.folder, protocol(), info, resume=True)
    source = Scripted(recorded)
    assert measure(resumed, source).accepted == 3
    assert len(source.played) == 2  # not again what was there
    assert session.path_of(session.protocol.strokes[0]).read_bytes() == first


def test_a_device_plays_each_stroke_and_rests_at_zero_between(session, recorded):
    with_prompt = []
    with_live = []
    device = firmware_io.open_device("mock:")
    watcher = Watcher(
        prompt=lambda stroke, tries: with_prompt.append((device.is_armed, device.last_v)),
        live=lambda stroke, t_s, now: with_live.append(now),
    )
    source = Scripted(recorded)
    measure(session, source, device, watcher)
    assert with_prompt == [(False, 0.0)] * 3
    assert not device.is_armed
    assert len(with_live) > 60  # every 50 ms of 3 strokes
    pressed = [now.normal_force_n for now in with_live]
    assert max(pressed) == pytest.approx(0.5, rel=0.05)
    played = device.mock.played_v
    assert np.abs(played).max() == pytest.approx(100.0, rel=1e-3)
    assert played[-1] == 0.0


def test_a_driver_that_fails_loses_nothing_that_was_measured(session, recorded):
    device = firmware_io.open_device("mock:")

    def fail():
        if session.recordings:
            device.close()

    with pytest.raises(haptix.HaptixError):
        measure(session, Scripted(recorded, before=fail), device)
    assert len(session.recordings) == 1
    assert len(session.open_strokes) == 2


def test_what_a_screen_does_not_bear_is_refused_before_the_first_stroke(tmp_path, finger, screen):
    info = SessionInfo(screen=screen.replace(max_voltage_v=90.0), finger=finger)
    session = Session.begin(tmp_path / "s", protocol(), info)
    with pytest.raises(haptix.InputError, match="--max-voltage-v 90"):
        measure(session, Scripted(None))
    assert session.recordings == []


def test_a_recording_under_two_numbers_is_refused_also_after_a_pause(session, recorded):
    told = []
    watcher = Watcher(done=lambda stroke, wrong: told.append([str(one) for one in wrong]))
    source = Scripted(recorded, [{"seed": 5}, {"seed": 5}, {"seed": 6}])
    outcome = measure(session, source, watcher=watcher, most_tries=1)
    assert [one.number for one in outcome.still_open] == [2]
    assert told[0] == told[2] == []
    assert "those of stroke 1, bit for bit" in told[1][0]
    outcome = measure(session, Scripted(recorded, [{"seed": 6}]), watcher=watcher, most_tries=1)
    assert [one.number for one in outcome.still_open] == [2]
    assert "those of stroke 3" in told[3][0]


def test_the_drive_is_a_sine_that_comes_and_goes():
    stroke = protocol().strokes[0]
    played = drive_for(stroke, protocol(), 48_000.0)
    assert played.duration_s > stroke.sliding_s + 2 * protocol().idle_s
    middle = played.volts[10_000:50_000]
    t = np.arange(10_000, 50_000) / 48_000
    np.testing.assert_allclose(middle, 100 * np.sin(2 * np.pi * 125 * t), atol=1e-9)
    assert played.volts[0] == 0
    assert abs(played.volts[-1]) < 1e-9
    with pytest.raises(haptix.InputError, match="500 samples"):
        drive_for(stroke, protocol(), 400.0)


def write_csv(path, recording):
    lines = ["time,fz,fx,x,drive"]
    columns = [getattr(recording, name) for name in SIGNALS]
    lines += [",".join(f"{v:.6g}" for v in row) for row in zip(*columns, strict=True)]
    path.write_text("\n".join(lines))


def test_csv_files_are_replayed(tmp_path, session, recorded):
    folder = tmp_path / "csv"
    folder.mkdir()
    for stroke, name in zip(session.protocol.strokes[:2], ("stroke-001.csv", "2.csv"), strict=True):
        write_csv(folder / name, recorded(stroke, rate_hz=2000.0, seed=stroke.number))
    names = zip(SIGNALS.items(), ("time", "fz", "fx", "x", "drive"), strict=True)
    columns = ColumnMap(
        columns={name: {"column": column, "unit": unit} for (name, unit), column in names}
    )
    with pytest.raises(haptix.HaptixError, match=r"stroke-003\.csv"):
        measure(session, CsvSource(folder, columns), most_tries=1)
    assert [one.stroke.number for one in session.recordings] == [1, 2]


class Inputs:
    """Analog inputs that deliver what is due on a clock."""

    sample_rate_hz = 1000.0
    serial = "fake"

    def __init__(self, clock, dead=None):
        self.clock, self.given, self.stopped, self.dead = clock, 0, False, dead

    def start(self):
        self.begun, self.given = self.clock(), 0

    def read(self):
        due = int((self.clock() - self.begun) * self.sample_rate_hz)
        t = np.arange(self.given, due) / self.sample_rate_hz
        self.given = due
        wave = 1e-6 * np.sin(70 * t)
        columns = [0.25 + wave, 0.1 + wave, 5 * t]
        if self.dead is not None:
            columns[self.dead] = np.full(len(t), 0.1)
        return np.stack(columns, axis=-1)

    def stop(self):
        self.stopped = True


THREE_CHANNELS = (
    InputChannel(signal="normal_force_n", scale=2.0),
    InputChannel(signal="tangential_force_n", scale=1.0, offset=-0.1),
    InputChannel(signal="x_mm", scale=10.0),
)


def test_a_voltage_that_nothing_plays_and_nothing_measures_is_refused(session):
    source = AnalogSource(Inputs(lambda: 0.0), THREE_CHANNELS, "FT1")
    with pytest.raises(haptix.InputError, match=r"stroke 1 .*--device"):
        measure(session, source)
    assert session.recordings == []
    monitored = (*THREE_CHANNELS, InputChannel(signal="drive_v", scale=100.0))
    assert AnalogSource(None, monitored, "FT1").assumed == ()


@pytest.mark.parametrize(("dead", "name"), [(0, "normal_force_n"), (1, "tangential_force_n")])
def test_a_dead_channel_ends_the_stroke_while_the_finger_slides(session, dead, name):
    now = [0.0]

    def sleep(seconds):
        now[0] += seconds

    source = AnalogSource(Inputs(lambda: now[0], dead), THREE_CHANNELS, "FT1")
    device = firmware_io.open_device("mock:")
    with pytest.raises(firmware_io.DeviceError, match=rf"{name}: .*does not change"):
        measure(session, source, device, clock=lambda: now[0], sleep=sleep)
    assert now[0] < drive_for(protocol().strokes[0], protocol(), 48_000.0).duration_s / 2
    assert not device.is_armed


def test_analog_inputs_are_scaled_and_paced_by_the_clock(session):
    now = [0.0]
    inputs = Inputs(lambda: now[0])
    source = AnalogSource(inputs, THREE_CHANNELS, "FT1")
    seen = []

    def sleep(seconds):
        now[0] += seconds

    watcher = Watcher(live=lambda stroke, t_s, live: seen.append(live))
    device = firmware_io.open_device("mock:")
    measure(session, source, device, watcher, most_tries=1, clock=lambda: now[0], sleep=sleep)
    assert inputs.stopped
    assert seen[-1].normal_force_n == pytest.approx(0.5, rel=1e-5)
    assert seen[-1].speed_mm_per_s == pytest.approx(50.0)
    # Never lifted, so rejected: but kept.
    (path, *_) = sorted((session.folder / "rejected").iterdir())
    made = StrokeRecording.load(path)
    np.testing.assert_allclose(made.tangential_force_n, 0.0, atol=2e-6)
    assert made.assumed == ("drive_v",)
    assert np.abs(made.drive_v).max() == pytest.approx(100.0, rel=0.01)
    assert made.conditions.instruments == {"force sensor": "FT1", "inputs": "fake"}


def test_channels_that_are_missing_are_named():
    with pytest.raises(haptix.InputError, match="tangential_force_n, x_mm"):
        AnalogSource(None, [InputChannel(signal="normal_force_n", scale=1.0)], "FT1")


HEAD = 'kind = "{}"\nsensor = "FT1"\n'
CHANNELS = "".join(
    f'[[channels]]\nsignal = "{name}"\nscale = 1\n'
    for name in ("normal_force_n", "tangential_force_n", "x_mm")
)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (HEAD.format("national-instruments") + CHANNELS, "expected the input of normal_force_n"),
        (HEAD.format("telepathy") + CHANNELS, r"Inputs\.kind: "),
        (HEAD.format("audio") + CHANNELS.replace("x_mm", "force"), r".*got 'force'"),
        ("kind =", "expected a TOML file"),
        (HEAD.format("audio"), r"Inputs\.channels: field required"),
    ],
)
def test_wrong_descriptions_of_inputs(tmp_path, text, said):
    (tmp_path / "inputs.toml").write_text(text)
    with pytest.raises(haptix.HaptixError, match=rf"inputs\.toml: {said}"):
        open_inputs(tmp_path / "inputs.toml")


@pytest.mark.parametrize(("stated", "range_v"), [("", 10.0), ("full_scale_v = 5.0\n", 5.0)])
def test_an_input_has_the_range_that_the_file_states(tmp_path, stated, range_v):
    """By nidaqmx's own default it has +-5 V, at which a sensor of +-10 V is clipped."""
    nidaqmx = pytest.importorskip("nidaqmx")
    names = "normal_force_n", "tangential_force_n", "x_mm"
    channels = "".join(
        f'[[channels]]\nsignal = "{name}"\nscale = 1.0\ninput = "Dev1/ai{number}"\n'
        for number, name in enumerate(names)
    )
    head = 'schema_version = 1\nkind = "national-instruments"\nsensor = "FT1"\n'
    (tmp_path / "inputs.toml").write_text(head + stated + channels)
    with patch.object(nidaqmx, "Task") as task:
        open_inputs(tmp_path / "inputs.toml")
    opened = task.return_value.ai_channels.add_ai_voltage_chan.call_args_list
    assert [one.args for one in opened] == [("Dev1/ai0",), ("Dev1/ai1",), ("Dev1/ai2",)]
    assert [one.kwargs for one in opened] == [{"min_val": -range_v, "max_val": range_v}] * 3


def test_the_monitor_sees_what_was_played():
    t = np.arange(4800) / 48_000
    played = StrokeDrive(200 * np.sin(2 * np.pi * 4000 * t), 48_000.0)
    at = np.arange(0.01, 0.09, 1e-4)
    # Twelve samples in a wave, by cubics.
    np.testing.assert_allclose(played.at(at), 200 * np.sin(2 * np.pi * 4000 * at), atol=0.2)
    assert played.at(np.array([-1.0, 5.0])).tolist() == [0.0, 0.0]


def test_live_needs_samples():
    signals = {"t_s": np.arange(3.0), "normal_force_n": np.ones(3), "x_mm": np.arange(3.0)}
    signals["tangential_force_n"] = 0 * signals["t_s"]
    assert Live.at(signals, 0.0) is None
    t = np.arange(0, 0.1, 1e-3)
    forces = {"normal_force_n": 0 * t + 2, "tangential_force_n": 0 * t - 0.5}
    found = Live.at({"t_s": t, **forces, "x_mm": 30 * t}, 0.1)
    assert (found.normal_force_n, found.speed_mm_per_s) == pytest.approx((2.0, 30.0))
    assert found.tangential_force_n == pytest.approx(-0.5)
    assert isinstance(found, Live)
