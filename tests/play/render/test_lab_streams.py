"""Streams of the Lab Streaming Layer, recorded as XDF and read by pyxdf."""

import struct
import time
import warnings
from secrets import token_hex
from types import SimpleNamespace

import numpy as np
import pytest

from firmware_io import Device, MockDriver, MockLink
from firmware_io.firmware.core import LINE
from firmware_io.progress import Marked
from firmware_io.protocol import TouchPhase
from haptix import InputError, LiveRenderer, Texture
from haptix.base.errors import OverloadWarning
from haptix.lab.experiment import ConstantStimuli, Experiment, Presentation
from haptix.play.render import LiveSettings, Sliding
from haptix.play.render.intervals import play
from haptix.play.render.lab_streams import LabOutlets, LiveOutlets
from tests.hand_clock import HandClock
from tests.waiting import PATIENCE_S

pylsl = pytest.importorskip("pylsl", reason="the extra lab is not installed")
pyxdf = pytest.importorskip("pyxdf", reason="pyxdf is not installed")

RATE = 48_000.0
NAME = f"haptix-{token_hex(4)}"  # others may test in the same network


def chunk(tag, content):
    body = struct.pack("<H", tag) + content
    return b"\x08" + struct.pack("<Q", len(body)) + body


def written(stream, info, values, times):
    """Header and samples of a stream, as the XDF specification lays them out."""
    head = chunk(2, struct.pack("<I", stream) + info.as_xml().encode())
    samples = b"\x08" + struct.pack("<Q", len(times))
    for row, at in zip(values, times, strict=True):
        samples += b"\x08" + struct.pack("<d", at)
        for one in row:
            if isinstance(one, str):
                samples += b"\x04" + struct.pack("<I", len(one.encode())) + one.encode()
            else:
                samples += struct.pack("<d", one)
    return head + chunk(3, struct.pack("<I", stream) + samples)


def record(outlets, act, counts, path, name=NAME):
    """Record what is sent in `act`, until as many samples of each stream have come."""
    inlets = {}
    for kind in counts:
        (found,) = pylsl.resolve_byprop("name", f"{name}-{kind}", 1, timeout=PATIENCE_S)
        inlets[kind] = pylsl.StreamInlet(found)
        inlets[kind].open_stream(timeout=PATIENCE_S)
    until = time.monotonic() + PATIENCE_S
    while not outlets.has_recorders():
        assert time.monotonic() < until, "nobody listens"
        time.sleep(0.01)
    act()
    data = b"XDF:" + chunk(1, b"<?xml version='1.0'?><info><version>1.0</version></info>")
    for number, (kind, inlet) in enumerate(inlets.items(), 1):
        values, times = [], []
        while len(times) < counts[kind]:
            assert time.monotonic() < until, f"{kind}: {len(times)} of {counts[kind]} came"
            more = inlet.pull_chunk(timeout=0.5, max_samples=4096)
            values += more[0]
            times += more[1]
        data += written(number, inlet.info(), values, times)
    path.write_bytes(data)
    streams, _ = pyxdf.load_xdf(str(path), synchronize_clocks=False)  # by its defaults
    return {one["info"]["name"][0].removeprefix(f"{name}-"): one for one in streams}


@pytest.fixture
def clock(monkeypatch):
    """The clock of host and driver, and 1000 s ahead of it that of the laboratory."""
    hand = HandClock()
    monkeypatch.setattr(pylsl, "local_clock", lambda: hand() + 1000.0)
    return hand


def test_what_is_recorded_is_what_the_driver_played_and_when(tmp_path, clock):
    driver = MockDriver()
    device = Device(MockLink(driver), mode="waveform", sample_rate_hz=RATE, clock=clock)
    volts = 20 * np.sin(2 * np.pi * 120 * np.arange(4800) / RATE)
    mu = 0.3 + volts**2 / 1e4
    with LabOutlets(device, NAME, clock) as outlets, device:

        def act():
            device.mark(0, 11)
            device.mark(2400, 12)
            outlets.drive(0, volts[:3000], mu[:3000])  # waits until the driver has told
            device.write(volts)
            assert driver.touch(12.5, 40.0, 0.48, 1, TouchPhase.DOWN)
            device.progress(is_fresh=True)
            outlets.follow()
            outlets.drive(3000, volts[3000:])
            device.mark(5, 13)  # has been played
            device.progress(is_fresh=True)
            outlets.follow()

        found = record(
            outlets, act, {"markers": 2, "drive": 4800, "touch": 1}, tmp_path / "session.xdf"
        )
        assert outlets.unplayed == 1
        with pytest.raises(InputError, match="as many as volts"):
            outlets.drive(0, [1.0, 2.0], [0.3])
    markers, drive, touch = (found[kind] for kind in ("markers", "drive", "touch"))
    assert markers["time_series"] == [["11", "0"], ["12", "2400"]]
    began, after = markers["time_stamps"]
    # The driver's clock, not when a message was read: this one's has stood still meanwhile.
    assert after - began == pytest.approx(2400 / RATE, abs=1e-9)
    np.testing.assert_array_equal(drive["time_series"][:, 0], volts)
    np.testing.assert_array_equal(drive["time_series"][:3000, 1], mu[:3000])
    assert np.isnan(drive["time_series"][3000:, 1]).all()
    expected = began + np.arange(4800) / RATE
    np.testing.assert_allclose(drive["time_stamps"], expected, rtol=0, atol=1e-6)
    assert drive["info"]["desc"][0]["sample_rate_hz"] == ["48000"]
    np.testing.assert_array_equal(touch["time_series"], [[12.5, 40.0, 0.48, 1.0, 1.0]])
    labels = [one["label"][0] for one in touch["info"]["desc"][0]["channels"][0]["channel"]]
    assert labels == ["x", "y", "normal_force", "contact", "phase"]


def test_marks_wait_for_a_recorder(tmp_path, clock):
    name = f"{NAME}-late"
    device = Device(MockLink(MockDriver()), mode="waveform", sample_rate_hz=RATE, clock=clock)
    with LabOutlets(device, name, clock) as outlets, device:
        with pytest.raises(InputError, match="expected a recorder"):
            outlets.wait_for_recorders(0.01)
        outlets.marks([Marked(0, 7, 0, clock()), Marked(9, 8, 0, clock() + 0.5)])

        def act():
            outlets.wait_for_recorders()
            outlets.marks([Marked(20, 9, 0, clock() + 1.0)])

        counts = {"markers": 3, "drive": 0, "touch": 0}
        found = record(outlets, act, counts, tmp_path / "late.xdf", name)["markers"]
    assert found["time_series"] == [["7", "0"], ["8", "9"], ["9", "20"]]
    np.testing.assert_allclose(np.diff(found["time_stamps"]), 0.5, rtol=0, atol=1e-6)


class LateLink(MockLink):
    """What the driver sends is read up to 8 ms later, by the clock of driver and host."""

    def __init__(self, clock, seed):
        super().__init__(MockDriver(pace="real", clock=clock), sleep=clock.sleep)
        self.clock, self.rng = clock, np.random.default_rng(seed)

    def receive(self, timeout_s=0.0):
        data = super().receive(timeout_s)
        if data:
            self.clock.sleep(self.rng.uniform(0, 8e-3))
        return data


def test_each_interval_of_an_experiment_is_marked_and_timed_by_its_driver(tmp_path, clock):
    name = f"{NAME}-experiment"
    driver_began_s, link = clock(), LateLink(clock, 3)
    device = Device(link, mode="waveform", clock=clock)
    wave = np.sin(2 * np.pi * 1000 * np.arange(96) / RATE)

    def peak(level):
        return 10 ** (level / 20)

    def answer(question):
        clock.sleep(0.4)
        return question.right

    with LabOutlets(device, name, clock) as outlets:
        run = Experiment(
            ConstantStimuli([20.0, 30.0], 2),
            Presentation(lambda at: peak(at) * wave, 0 * wave, peak),
            device, answer, tmp_path / "t.tsv", clock=clock, wait=clock.sleep, outlets=outlets,
        )  # fmt: skip
        zero_s = clock()  # of the log
        found = record(
            outlets,
            run.run,
            {"markers": 8, "drive": 8 * 96, "touch": 0},
            tmp_path / "session.xdf",
            name,
        )
    _, kinds = link.driver.output
    device.close()
    told = [int(code) for code, _ in found["markers"]["time_series"]]
    assert told == [10 * trial + interval for trial in range(4) for interval in (1, 2)]
    stamps = found["markers"]["time_stamps"] - 1000.0 - zero_s
    onsets = [float(row["onset_s"]) for row in run.log.rows]
    # The log has tenths of a millisecond.
    np.testing.assert_allclose(stamps[::2], onsets, rtol=0, atol=0.51e-4)
    # The digital line rose with the first sample. A report is read late, never early, and the best
    # of a second counts: of ten or more that are up to 8 ms late.
    is_high = (kinds & LINE) != 0
    rises = np.flatnonzero(is_high & ~np.r_[False, is_high[:-1]])
    late_s = stamps - (driver_began_s + rises / RATE - zero_s)
    assert (late_s > -1 / RATE).all() and (late_s < 3e-3).all()
    played = found["drive"]["time_series"][:, 0].reshape(8, 96)
    np.testing.assert_allclose(
        found["drive"]["time_stamps"][::96], found["markers"]["time_stamps"], rtol=0, atol=1e-6
    )
    for row, (first, second) in zip(run.log.rows, zip(played[::2], played[1::2], strict=True),
                                    strict=True):  # fmt: skip
        target, reference = (first, second) if row["right"] == "1" else (second, first)
        np.testing.assert_array_equal(target, peak(float(row["level"])) * wave)
        assert not reference.any()


def test_an_onset_is_the_driver_s_however_late_it_is_read():
    class Late:
        """Its first sample is played 0.25 s after it was armed, and it tells so a second later."""

        capabilities = SimpleNamespace(takes_marks=True, sample_rate_hz=RATE)

        def __init__(self):
            self.clock = HandClock()
            self.told: list[Marked] = []

        def __enter__(self):
            self.began = self.clock()

        def __exit__(self, *error):
            self.told = [Marked(0, self.code, 7, self.began + 0.25)]
            self.clock.sleep(1.25)

        def mark(self, index, code):
            assert index == 0
            self.code = code

        def write(self, volts):
            pass

        def marked(self):
            return self.told

    device = Late()
    began_s = device.clock()
    played = play(device, np.zeros(3), device.clock, 41)
    assert played.marked[0].code == 41
    assert played.onset_s == pytest.approx(began_s + 0.25, abs=1e-9)


def test_a_live_renderer_sends_its_touches_drive_and_marks(surface, tmp_path):
    texture = Texture(np.full((2, 2), 0.6), width_mm=100.0, beyond="hold")
    device, name = Device(MockLink(MockDriver(pace="real"))), f"{NAME}-live"
    settings = LiveSettings(sliding=Sliding(is_needed=False))
    sent = []
    with (
        warnings.catch_warnings(),
        LiveRenderer(surface, texture, device, settings=settings) as renderer,
        LiveOutlets(renderer, name) as outlets,
    ):
        warnings.simplefilter("ignore", OverloadWarning)  # a busy machine is no failure

        def act():
            until, marks = time.monotonic() + PATIENCE_S, [11, 12]
            while len(sent) < 20 or outlets.marks_sent < 2:
                assert time.monotonic() < until, "the driver told of no marks"
                now_s = renderer.now_s()
                sent.append((10.0 + len(sent) % 50, 5.0))
                renderer.touch(now_s, *sent[-1], 0.5)
                if len(sent) > 5 and marks:
                    renderer.mark(marks.pop(0))
                time.sleep(0.01)
                outlets.follow()

        found = record(
            outlets, act, {"touch": 20, "markers": 2, "drive": 50}, tmp_path / "l.xdf", name
        )
        with pytest.raises(InputError, match="somebody takes"):
            LiveOutlets(renderer)
        with pytest.raises(InputError, match="65535"):
            renderer.mark(70_000)
    device.close()
    assert renderer.record is None and renderer.taken is None
    touches, markers, drive = (found[kind] for kind in ("touch", "markers", "drive"))
    at = touches["time_series"][:, :2].tolist()
    assert at == [list(one) for one in sent[: len(at)]]
    assert (touches["time_series"][:, 2] == 0.5).all()
    assert [code for code, _ in markers["time_series"]] == ["11", "12"]
    indices, (began, after) = (
        [int(index) for _, index in markers["time_series"]],
        markers["time_stamps"],
    )
    # The driver's clock between two of its samples; one that ran out of them played none meanwhile.
    assert after - began >= (indices[1] - indices[0]) / device.capabilities.sample_rate_hz - 1e-3
    volts, friction = drive["time_series"].T
    assert (np.diff(drive["time_stamps"]) > 0).all() and volts.max() > 10
    asked = friction[~np.isnan(friction)]
    low, high = renderer.reachable(np.array([0.5]), np.array([100.0]))
    assert len(asked) > 20 and asked == pytest.approx(float((low + 0.6 * (high - low))[0]))
