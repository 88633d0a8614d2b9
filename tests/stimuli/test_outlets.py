"""Streams of the Lab Streaming Layer, recorded as XDF and read by pyxdf."""

import struct
import time
from secrets import token_hex

import numpy as np
import pytest

from firmware_io import Device, MockDriver, MockLink
from firmware_io.protocol import TouchPhase
from haptix import InputError
from haptix.stimuli.outlets import LabOutlets

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


def record(outlets, act, counts, path):
    """Record what is sent in `act`, until as many samples of each stream have come."""
    inlets = {}
    for kind in counts:
        (found,) = pylsl.resolve_byprop("name", f"{NAME}-{kind}", 1, timeout=20.0)
        inlets[kind] = pylsl.StreamInlet(found)
        inlets[kind].open_stream(timeout=20.0)
    until = time.monotonic() + 20.0
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
    streams, _ = pyxdf.load_xdf(
        str(path), synchronize_clocks=False, dejitter_timestamps=False, verbose=False
    )
    return {one["info"]["name"][0].removeprefix(f"{NAME}-"): one for one in streams}


def test_what_is_recorded_is_what_the_driver_played_and_when(tmp_path):
    driver = MockDriver()
    device = Device(MockLink(driver), mode="waveform", sample_rate_hz=RATE)
    volts = 20 * np.sin(2 * np.pi * 120 * np.arange(4800) / RATE)
    mu = 0.3 + volts**2 / 1e4
    with LabOutlets(device, NAME) as outlets, device:

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
    # The driver's clock, not when a message was read: exact but for two readings of two clocks.
    assert after - began == pytest.approx(2400 / RATE, abs=1e-4)
    np.testing.assert_array_equal(drive["time_series"][:, 0], volts)
    np.testing.assert_array_equal(drive["time_series"][:3000, 1], mu[:3000])
    assert np.isnan(drive["time_series"][3000:, 1]).all()
    expected = began + np.arange(4800) / RATE
    np.testing.assert_allclose(drive["time_stamps"], expected, rtol=0, atol=2e-4)
    assert float(drive["info"]["nominal_srate"][0]) == RATE
    np.testing.assert_array_equal(touch["time_series"], [[12.5, 40.0, 0.48, 1.0, 1.0]])
    labels = [one["label"][0] for one in touch["info"]["desc"][0]["channels"][0]["channel"]]
    assert labels == ["x", "y", "normal_force", "contact", "phase"]
