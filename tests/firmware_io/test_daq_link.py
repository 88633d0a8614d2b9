"""The analog output of a card that is stood in for: unproven on hardware."""

import sys
import time

import numpy as np
import pytest

pytest.importorskip("nidaqmx", reason="the extra daq holds the signatures that calls are bound to")

from nidaqmx.errors import DaqFunctionNotSupportedError, DaqNotFoundError

from firmware_io import (
    DeviceBusyError,
    DeviceDisconnectedError,
    DeviceError,
    DeviceNotFoundError,
    LimitError,
    open_device,
    survey_buses,
)
from firmware_io.links import daq, hosted
from firmware_io.links.daq import DaqProfile, beyond
from firmware_io.links.hosted import read_rig_profile
from tests.firmware_io.pretend_daq import Card, Level, pretend
from tests.links import stream_of
from tests.waiting import wait_for

RIG = "daq:channel=Dev1/ao0,amplifier_gain=50"
WATCHED = f"{RIG},watchdog=yes"


@pytest.fixture
def card(monkeypatch, no_thread_is_left):
    card = Card()
    for name, module in pretend(card).items():
        monkeypatch.setitem(sys.modules, name, module)
    monkeypatch.setattr(hosted, "HOLD_S", 0.001)
    monkeypatch.setattr(hosted, "HOLD_EXTRA_S", 300.0)  # however late the card asks
    monkeypatch.setattr(daq, "WATCHDOG_S", 0.001)
    return card


WAVE = 150.0 * np.sin(np.arange(1, 4000) / 6)


def test_the_card_plays_volts_by_gain_and_ends_at_zero(card):
    device = open_device(f"{WATCHED},ceiling_v=180,trigger=Dev1/ao1,monitor=Dev1/_ao0_vs_aognd")
    assert device.capabilities.full_scale_v == device.limits.ceiling_v == 180.0
    assert card.range_v["Dev1/ao0"] == (-3.6, 3.6)  # the card refuses more by itself
    with device:
        device.mark(1000, 7)
        device.write(np.r_[5.0, WAVE])
    device.close()
    volts, line = card.volts(), card.volts("Dev1/ao1")
    first = np.flatnonzero(volts)[0]
    # Half a code of 32767.
    np.testing.assert_allclose(
        50.0 * volts[first : first + WAVE.size + 1], np.r_[5.0, WAVE], atol=0.51 * 180 / 32767
    )
    assert volts[-1] == 0.0
    rises = np.flatnonzero(np.diff(line, prepend=0.0) > 0)
    assert rises.tolist() == [first, first + 1000]
    assert set(line[:-1]) == {0.0, 5.0}
    (watchdog,) = card.watchdogs
    assert watchdog.states == [
        ("Dev1/ao0", 0.0, daq.nidaqmx_module().constants.WatchdogAOExpirState.VOLTAGE)
    ]
    assert watchdog.resets > 10 and watchdog.is_closed
    assert card.open_tasks == []


def test_a_card_whose_watchdog_knows_lines_only_takes_the_amplifiers(card):
    device = open_device(f"{RIG},watchdog=Dev1/port0/line0")
    assert card.lines == {"Dev1/port0/line0": True}
    device.close()
    assert card.lines == {"Dev1/port0/line0": False}
    (watchdog,) = card.watchdogs
    assert watchdog.states == [("Dev1/port0/line0", Level.LOW)]


def test_a_module_has_the_watchdog_and_the_clock_of_its_chassis(card):
    card.chassis = "cDAQ1"
    open_device(f"{WATCHED},monitor=Dev1/ai0").close()
    assert card.watchdogs[0].device == "cDAQ1"


def test_without_watchdog_or_interlock_it_does_not_open(card):
    for said in ("", ",interlock=yes", ",interlock=        "):
        with pytest.raises(DeviceError, match="last voltage"):
            open_device(RIG + said)
    open_device(f"{RIG},interlock=foot switch in the enable").close()
    assert card.watchdogs == []


def test_limits_hold_in_front_of_the_card(card):
    device = open_device(f"{WATCHED},ceiling_v=120")
    with device, pytest.raises(LimitError, match=r"120\.0 V"):
        device.write([121.0])
    device.close()
    device = open_device(f"{WATCHED},watchdog_s=0.02")
    device.arm()
    with pytest.raises(DeviceError, match="starved"):
        device.write(np.linspace(0.0, 100.0, 100))
        wait_for(lambda: device.progress() is None)
    device.close()
    # 100 V are 2 V of the card; half a code.
    assert np.abs(card.volts()).max() <= 2.0 + 4.0 / 65534 and card.volts()[-1] == 0.0


@pytest.mark.parametrize(
    ("fault", "says"),
    [
        (("is_late", True), "stopped to prevent regeneration"),
        (("refusals", {"generated": -88705}), "refused for a reason"),
        (("refusals", {"write_many_sample": -88705}), "refused for a reason"),
        (("monitor_gain", 0.9), "monitor reads other volts"),
        (("stands", True), "sample clock stands"),
    ],
)
def test_what_goes_wrong_ends_at_zero_and_says_so(card, monkeypatch, fault, says):
    if fault[0] == "stands":
        monkeypatch.setattr(daq, "STILL_S", 0.01)
    device = open_device(f"{WATCHED},monitor=Dev1/ai0,buffer_s=0.004")
    device.arm()
    setattr(card, *fault)
    with pytest.raises(DeviceDisconnectedError, match=says):
        device.write(np.tile(WAVE, 20))
    wait_for(lambda: card.watchdogs[0].is_closed)
    assert card.volts()[-1] == 0.0
    with pytest.raises(DeviceDisconnectedError):
        device.close()
    assert card.open_tasks == []


def test_an_expired_watchdog_ends_the_session(card):
    device = open_device(WATCHED)
    card.watchdogs[0].expired = True
    with pytest.raises(DeviceDisconnectedError, match="watchdog has expired"):
        wait_for(lambda: device.progress(is_fresh=True) is None)
    device.close()
    assert card.open_tasks == []


def test_where_zero_cannot_be_written_the_watchdog_runs_out_first(card, monkeypatch):
    waited = []
    device = open_device(WATCHED)
    (watchdog,) = card.watchdogs
    monkeypatch.setattr(time, "sleep", lambda s: waited.append((s, watchdog.is_closed)))
    card.refusals["write"] = -200478
    stream_of(device).link.close()
    assert (0.002, False) in waited
    assert watchdog.is_closed


@pytest.mark.parametrize(
    ("refusals", "error", "says"),
    [
        ({"add_ao_voltage_chan": -200220}, DeviceNotFoundError, "haptix devices"),
        ({"add_ao_voltage_chan": -50103}, DeviceBusyError, "another program"),
        ({"Task": -1}, DeviceError, "cannot be opened"),
        ({"cfg_watchdog_ao_expir_states": -200452}, DeviceError, "no such watchdog.*interlock="),
        ({"clear_expiration": -200452}, None, ""),
    ],
)
def test_a_card_that_refuses(card, refusals, error, says):
    card.refusals = refusals
    if error is None:
        open_device(WATCHED).close()
    else:
        with pytest.raises(error, match=says):
            open_device(WATCHED)
    assert card.open_tasks == [] and all(one.is_closed for one in card.watchdogs)


def test_a_rate_that_the_card_does_not_have(card):
    card.rate_error = 0.002
    with pytest.raises(DeviceError, match="divides its timebase"):
        open_device(WATCHED)
    assert card.open_tasks == []


@pytest.mark.parametrize(
    ("selector", "says"),
    [
        ("amplifier_gain=50,watchdog=yes", "needs the analog output"),
        ("channel=Dev1/ao0,watchdog=yes", "needs amplifier_gain"),
        ("channel=Dev1/ao0,amplifier_gain=50,watchdog=maybe", "must be yes, or a digital line"),
        ("channel=Dev1/ao0,amplifier_gain=50,watchdog=yes,buffer_s=0", "buffer_s must be"),
        ("channel=Dev1/ao0,amplifier_gain=50,full_scale_v=3", "keys are channel, profile"),
    ],
)
def test_addresses_that_cannot_work(card, selector, says):
    with pytest.raises(DeviceError, match=says):
        open_device(f"daq:{selector}")


def test_a_profile_holds_the_rig(card, tmp_path):
    path = tmp_path / "rig.toml"
    path.write_text(
        'channel = "Dev1/ao0"\namplifier_gain = 20\nwatchdog = "Dev1/port0/line0"\n'
        "buffer_s = 0.01\n"
    )
    device = open_device(f"daq:profile={path},ceiling_v=120")
    assert (device.limits.ceiling_v, device.latency_s) == (120.0, 0.01)
    device.close()
    path.write_text("watchdog = true")
    with pytest.raises(DeviceError, match=r"watchdog .*True"):
        read_rig_profile(path, DaqProfile)


def test_outputs_are_found(card):
    report = next(report for report in survey_buses() if report.kind == "daq")
    assert report.available and report.detail.endswith("NI-DAQmx 24.5")
    assert [one.address for one in report.devices] == [
        "daq:channel=Dev1/ao0",
        "daq:channel=Dev1/ao1",
    ]


def test_readings_are_compared_with_the_last_samples():
    sent = np.array([0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0])
    late = np.array([0.0, 0.0, 1.0, 2.0])  # what the output had before each edge
    assert not beyond(late, sent, 0, 10.0).any()
    # Samples 1, 2 and 3, and 2 % of 10 V.
    read = np.array([0.7, 0.9, 3.1, 3.3])
    off = [bool(beyond(one, sent, 3, 10.0)[0]) for one in read[:, None]]
    assert off == [True, False, False, True]


@pytest.mark.parametrize(
    ("error", "says"),
    [
        (DaqNotFoundError("Could not find NI-DAQmx"), "not installed: install it"),
        (DaqFunctionNotSupportedError("no such function"), "too old: install a newer one"),
    ],
)
def test_a_machine_without_the_driver_of_the_card_is_told_what_to_install(error, says):
    refusal = daq._refusal("daq:channel=Dev1/ao0", error)
    assert says in str(refusal) and "address" not in str(refusal)
