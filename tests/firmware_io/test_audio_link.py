"""The audio link on a PortAudio that is moved by hand; the real one: tests/devices."""

import sys
import threading
from dataclasses import replace
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest

from firmware_io import (
    Device,
    DeviceBusyError,
    DeviceDisconnectedError,
    DeviceError,
    DeviceNotFoundError,
    LimitError,
    Playback,
    WaveSource,
    open_device,
)
from firmware_io.links import audio, hosted
from firmware_io.links.audio import AudioProfile
from firmware_io.links.hosted import read_rig_profile
from tests.links import open_link
from tests.waiting import wait_for

PERIOD = 64
STILL_S = hosted.STILL_S


class OutputStream:
    """Calls back from a thread, as PortAudio does, in time or late; keeps what it is given.

    A machine that stalls delays its callbacks, and so lets less time pass for the driver. With a
    watchdog of 1 s the host would have to be held up during 750 callbacks.
    """

    refusal = None
    latency = 0.003
    buffered = 2  # blocks between the callback and the output, which `abort` drops

    def __init__(self, device, samplerate, channels, dtype, latency, callback, finished_callback):
        if self.refusal:
            raise PortAudioError(self.refusal)
        assert dtype == "float32"
        self.device, self.samplerate, self.channels = device, samplerate, channels
        self.callback, self.finished = callback, finished_callback
        self.heard: list[np.ndarray] = []
        self.pending: list[np.ndarray] = []
        self.is_late = threading.Event()
        self.stands = threading.Event()
        self.end = threading.Event()
        self.thread = threading.Thread(target=self._run)
        streams.append(self)

    def _run(self):
        while not self.end.wait(PERIOD / self.samplerate):
            if self.stands.is_set():
                continue
            out = np.full((PERIOD, self.channels), np.nan, np.float32)
            late = self.is_late.is_set()
            if late:
                self.is_late.clear()
            self.callback(out, PERIOD, None, SimpleNamespace(output_underflow=late))
            self.pending.append(out)
            if len(self.pending) > self.buffered:
                self.heard.append(self.pending.pop(0))

    def start(self):
        self.thread.start()

    def abort(self):
        if not self.end.is_set():
            self.end.set()
            self.thread.join()
            self.finished()

    def stop(self):
        self.abort()
        self.heard += self.pending

    def close(self):
        self.abort()


class PortAudioError(Exception):
    pass


streams = []
HOST_APIS = [
    {"name": "ALSA", "default_output_device": 2},
    {"name": "JACK Audio Connection Kit", "default_output_device": 4},
]


def check_output_settings(device, samplerate, dtype):
    assert dtype == "float32"
    if samplerate not in (44_100, 96_000):
        raise PortAudioError("Invalid sample rate")


@pytest.fixture
def portaudio(monkeypatch, no_thread_is_left):
    module: Any = ModuleType("sounddevice")
    devices = [
        {"name": "microphone", "max_output_channels": 0, "hostapi": 0},
        {"name": "Scarlett 2i2: USB", "max_output_channels": 2, "hostapi": 0},
        {"name": "HDMI", "max_output_channels": 8, "hostapi": 0},
        {"name": "speaker", "max_output_channels": 1, "hostapi": 0},
        {"name": "Scarlett 2i2: USB", "max_output_channels": 2, "hostapi": 1},
        {"name": "Fireface: Out (hw:2,0)", "max_output_channels": 2, "hostapi": 0},
        {"name": "Twin (hw:3,0)", "max_output_channels": 2, "hostapi": 0},
        {"name": "Twin (hw:4,0)", "max_output_channels": 2, "hostapi": 0},
    ]
    module.query_hostapis = lambda index=None: HOST_APIS if index is None else HOST_APIS[index]
    module.__version__ = "0.5"
    module.get_portaudio_version = lambda: (1, "PortAudio V19")
    module.check_output_settings = check_output_settings
    module.query_devices = lambda index=None: devices if index is None else devices[index]
    module.default = SimpleNamespace(device=(0, 2))
    module.PortAudioError = PortAudioError
    module.OutputStream = OutputStream
    monkeypatch.setattr(OutputStream, "refusal", None)
    monkeypatch.setattr(hosted, "HOLD_EXTRA_S", 300.0)  # however late the callbacks come
    monkeypatch.setattr(hosted, "HOLD_S", 0.001)
    monkeypatch.setattr(hosted, "STILL_S", 300.0)
    monkeypatch.setitem(sys.modules, "sounddevice", module)
    monkeypatch.setattr(audio, "SCHEME", replace(audio.SCHEME, open=audio.open_here))
    streams.clear()
    yield module
    for stream in streams:
        stream.close()


def heard():
    return np.concatenate(streams[-1].heard)


@pytest.mark.parametrize("buffered", [0, 2, 40])
def test_the_ramp_is_played_out_before_the_stream_ends(portaudio, monkeypatch, buffered):
    monkeypatch.setattr(OutputStream, "buffered", buffered)
    monkeypatch.setattr(OutputStream, "latency", (buffered + 1) * PERIOD / 48_000)
    link = open_link("audio:device=scarlett,host_api=alsa,full_scale_v=200")
    device = Device(link)
    device.__enter__()
    # Up to a crest of 173 V, which stands there until the watchdog's time is over.
    device.write(173.0 * np.sin(np.arange(1, 2401) * np.pi / 4800))
    while not (streams[-1].heard and np.abs(streams[-1].heard[-1]).max() > 0.8):
        streams[-1].end.wait(1e-4)
    link.close()
    drive = heard()[:, 0] * 200.0
    assert drive.max() > 160.0
    # The ramp of 5 ms from the crest, and one code of rounding.
    assert np.abs(np.diff(drive)).max() <= 173.0 / 240 + 200.0 / 32767
    assert drive[-1] == 0.0


def test_opening_again_begins_no_second_anew(portaudio, monkeypatch):
    """180 V for 45 ms, again and again: each opening holds 0 V before, as long as is asked for."""
    monkeypatch.setattr(hosted, "HOLD_S", 0.2)
    for _ in range(2):
        device = open_device("audio:device=scarlett,host_api=alsa,full_scale_v=200")
        with device:
            device.write(np.r_[90.0, np.full(2160, 180.0)])
        device.close()
    # 0.2 s of 0 V, to the block, in front of each.
    for stream in streams:
        drive = np.concatenate(stream.heard)[:, 0]
        assert np.flatnonzero(drive)[0] >= 9_600
        assert np.abs(drive).sum() / 48_000 * 200.0 <= 10.0


def test_an_interface_that_asks_for_nothing(portaudio, monkeypatch):
    monkeypatch.setattr(hosted, "HOLD_EXTRA_S", 0.01)
    monkeypatch.setattr(OutputStream, "_run", lambda self: self.end.wait())
    with pytest.raises(DeviceError, match="takes no samples"):
        open_device("audio:full_scale_v=200")


def test_what_is_heard_is_the_share_of_full_scale(portaudio):
    device = open_device("audio:device=scarlett,host_api=alsa,full_scale_v=180,trigger=yes")
    assert device.name == "audio:device=Scarlett 2i2: USB"
    assert device.capabilities.full_scale_v == device.limits.ceiling_v == 180.0
    volts = np.r_[5.0, 150.0 * np.sin(np.arange(1, 9600) / 6)]
    with device:
        device.write(volts)
    device.close()
    drive, trigger = heard().T
    first = np.flatnonzero(drive)[0]
    # Half a code of 32767, and float32.
    np.testing.assert_allclose(
        drive[first : first + volts.size], volts / 180.0, atol=0.5 / 32767 + 1e-7
    )
    assert not drive[-PERIOD:].any()
    assert np.flatnonzero(trigger).tolist() == list(range(first, first + 48))  # 1 ms at 48 kHz


def test_a_mark_raises_the_trigger_with_its_sample(portaudio):
    device = open_device("audio:device=scarlett,host_api=alsa,full_scale_v=180,trigger=yes")
    with device:
        device.mark(1000, 7)
        device.write(np.r_[5.0, 150.0 * np.sin(np.arange(1, 2400) / 6)])
    device.close()
    drive, trigger = heard().T
    first = np.flatnonzero(drive)[0]
    rises = np.flatnonzero(np.diff(trigger, prepend=0.0) > 0)
    assert rises.tolist() == [first, first + 1000]


def test_volts_from_converter_and_amplifier(portaudio, tmp_path):
    path = tmp_path / "rig.toml"
    path.write_text('device = "HDMI"\ndac_full_scale_v = 1.5\namplifier_gain = 100\n')
    device = open_device(f"audio:profile={path},ceiling_v=120")
    assert device.name == "audio:device=HDMI"
    assert device.capabilities.full_scale_v == 150.0
    assert device.limits.ceiling_v == 120.0
    with device, pytest.raises(LimitError, match=r"120\.0 V"):
        device.write([121.0])
    device.close()


def test_the_firmware_in_front_has_its_watchdog(portaudio):
    device = open_device("audio:full_scale_v=200,watchdog_s=0.02")
    device.arm()
    with pytest.raises(DeviceError, match="starved"):
        device.write(np.linspace(0.0, 100.0, 100))
        wait_for(lambda: device.progress() is None)
    wait_for(lambda: heard()[-1, 0] == 0.0)  # its ramp
    device.close()


def test_envelopes_and_slower_rates(portaudio):
    device = open_device("audio:full_scale_v=200,mode=envelope,carrier_hz=3000")
    assert device.carrier_hz == 3000.0
    rates = dict(device.capabilities.rates)
    assert rates == {48_000: ("waveform", "envelope"), 16_000: ("envelope",)}
    device.close()
    offered = AudioProfile(full_scale_v=100.0, sample_rate_hz=44_100.0).capabilities().rates
    assert [rate.sample_rate_hz for rate in offered] == [44_100, 14_700]


def test_closing_ramps_down(portaudio):
    device = open_device("audio:full_scale_v=200")
    device.arm()
    device.write(np.linspace(0.0, 150.0, 500))
    device.close()
    volts = heard()[:, 0] * 200.0
    assert volts[-1] == 0.0
    assert np.abs(np.diff(volts)).max() < 5.0  # 150 V in 5 ms are 0.6 V per sample
    with pytest.raises(DeviceDisconnectedError):
        device.arm()


def test_an_interface_that_goes_away(portaudio):
    link = open_link("audio:full_scale_v=200")
    device = Device(link)
    streams[0].is_late.set()
    wait_for(lambda: link.underflows)
    device.arm()
    device.write(np.linspace(0.0, 50.0, 500))
    streams[0].abort()
    with pytest.raises(DeviceDisconnectedError, match="unplugged"):
        device.write([50.0])
    assert link.underflows == 1
    with pytest.raises(DeviceDisconnectedError):
        device.close()
    open_device("audio:full_scale_v=200").close()


#: Every door by which a program uses an armed interface.
DOORS = {
    "write": lambda device: device.write(np.zeros(64)),
    "revise": lambda device: device.revise(400, np.zeros(8)),
    "progress": lambda device: device.progress(is_due=True),
    "mark": lambda device: device.mark(5),
    "stop": lambda device: device.stop(),
    "close": lambda device: device.close(),
}


@pytest.mark.parametrize("door", DOORS)
def test_an_interface_that_stops_without_a_word_is_a_fault_at_every_door(
    portaudio, monkeypatch, door
):
    device = open_device("audio:full_scale_v=200,trigger=yes,device=HDMI")
    device.arm(revisable=True)
    device.write(np.linspace(0.0, 50.0, 500))
    monkeypatch.setattr(hosted, "STILL_S", 0.05)
    streams[0].stands.set()
    streams[0].end.wait(0.06)
    with pytest.raises(DeviceDisconnectedError, match="asked for no samples"):
        DOORS[door](device)
    with pytest.raises(DeviceDisconnectedError):
        device.close()


def test_a_playback_ends_when_the_interface_has_stopped(portaudio, monkeypatch):
    device = open_device("audio:full_scale_v=200")
    tone = WaveSource(lambda first, count: 100 * np.sin(0.1 * np.arange(first, first + count)))
    playback = Playback(device, tone)
    playback.start()
    wait_for(lambda: playback.stats.samples_played > 4800)
    monkeypatch.setattr(hosted, "STILL_S", STILL_S)
    streams[0].stands.set()
    wait_for(lambda: not playback.is_running)
    with pytest.raises(DeviceDisconnectedError, match="asked for no samples"):
        playback.stop()
    with pytest.raises(DeviceDisconnectedError):
        device.close()


def test_samples_of_before_a_pause_are_not_played_after_it(portaudio, monkeypatch):
    device = open_device("audio:full_scale_v=200")
    device.arm()
    device.write(100.0 * np.sin(np.arange(4800) / 6))
    monkeypatch.setattr(hosted, "STILL_S", 0.02)
    streams[0].stands.set()
    streams[0].end.wait(0.05)
    blocks = len(streams[0].heard)
    streams[0].stands.clear()
    wait_for(lambda: len(streams[0].heard) > blocks + 10)
    after = np.concatenate(streams[0].heard[blocks + OutputStream.buffered + 1 :])
    assert not after.any()
    with pytest.raises(DeviceDisconnectedError, match="asked for no samples"):
        device.close()


@pytest.mark.parametrize(
    ("selector", "index"),
    [
        ("device=scarlett,host_api=jack", 4),
        ("host_api=jack", 4),
        ("device=Twin (hw:4,0)", 7),
        ("device=Twin (hw:3,0),trigger=yes", 6),
        ("", 2),
    ],
)
def test_interfaces_are_told_apart_by_name_and_host_api(portaudio, selector, index):
    device = open_device(f"audio:{selector},full_scale_v=200".replace(":,", ":"))
    assert streams[-1].device == index
    device.close()


def test_what_is_listed_can_be_opened(portaudio):
    _, found = audio.list_here()
    addresses = [address for address, _ in found]
    assert len(set(addresses)) == len(addresses) == 7
    assert "audio:device=Fireface: Out,host_api=ALSA" in addresses  # without a number of today
    for address in addresses:
        open_device(f"{address},full_scale_v=200").close()
    assert [stream.device for stream in streams] == [1, 2, 3, 4, 5, 6, 7]


def test_the_refusal_names_the_rates_of_the_interface(portaudio, monkeypatch):
    monkeypatch.setattr(OutputStream, "refusal", "Invalid sample rate [PaErrorCode -9997]")
    with pytest.raises(DeviceError, match="rates are 44100, 96000"):
        open_device("audio:device=HDMI,full_scale_v=200")


def test_on_jack_the_latency_is_that_of_the_last_block(portaudio):
    """PortAudio 19.6 and 19.7 state one block less; the time of the callback has it."""
    link = open_link("audio:host_api=jack,full_scale_v=200")
    out, status = np.zeros((PERIOD, 1), np.float32), SimpleNamespace(output_underflow=False)
    link._fill(out, PERIOD, SimpleNamespace(currentTime=9.0, outputBufferDacTime=9.25), status)
    assert link.latency_s == 0.25
    link._fill(out, PERIOD, SimpleNamespace(currentTime=9.0, outputBufferDacTime=9.0), status)
    assert link.latency_s == OutputStream.latency
    link.close()


def test_senseless_latencies_are_not_believed(portaudio, monkeypatch):
    link = open_link("audio:full_scale_v=200")
    assert link.latency_s == 0.003
    for latency in (89_478.0, -1.0, float("nan")):
        monkeypatch.setattr(OutputStream, "latency", latency)
        assert link.latency_s is None
    link.close()
    assert link.latency_s is None


@pytest.mark.parametrize(
    ("selector", "error", "says"),
    [
        ("", DeviceError, "how many volts"),
        ("full_scale_v=1,amplifier_gain=2", DeviceError, "full_scale_v, the volts"),
        ("dac_full_scale_v=1", DeviceError, "both dac_full_scale_v and amplifier_gain"),
        ("full_scale_v=-1", DeviceError, "full_scale_v must be"),
        ("full_scale_v=1,sample_rate_hz=10", DeviceError, "sample_rate_hz must be"),
        ("full_scale_v=1,trigger=maybe", DeviceError, "trigger of audio: must be yes or no"),
        ("full_scale_v=1,device=yamaha", DeviceNotFoundError, "'Scarlett 2i2: USB' .ALSA."),
        ("full_scale_v=1,device=0", DeviceNotFoundError, "called '0'"),
        ("full_scale_v=1,device=s", DeviceError, "Several.*'speaker' .ALSA."),
        ("full_scale_v=1,device=scarlett", DeviceError, "Several.*JACK.*host_api="),
        ("full_scale_v=1,device=HDMI,host_api=jack", DeviceNotFoundError, "host API 'jack'"),
        ("full_scale_v=1,device=speaker,trigger=yes", DeviceNotFoundError, "two output channels"),
        ("profile=missing.toml", DeviceError, "missing.toml cannot be read"),
    ],
)
def test_addresses_that_cannot_work(portaudio, selector, error, says):
    with pytest.raises(error, match=says):
        open_device(f"audio:{selector}")


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("volume = 11", r"'volume'; the keys are dac_full_scale_v, .*device, full_scale_v"),
        ('full_scale_v = "200 V"', "full_scale_v in the profile"),
        ("full_scale_v = ", "cannot be read"),
        ("trigger = 1", "trigger in the profile"),
        ("full_scale_v = " + "[" * 3000, "cannot be read"),
        ("a." * 4000 + "a = 1", "'a'; the keys are"),
        ("# " + "a" * 20_000, "at most 10000 bytes"),
        ("full_scale_v = 1" + "0" * 400, "more than 64 bits"),
        ("full_scale_v = 0x" + "f" * 9000, "more than 64 bits"),
        ("full_scale_v = inf", "full_scale_v must be a number above 0"),
        ("dac_full_scale_v = 1e5\namplifier_gain = 1e5", "The full scale must lie in"),
        ("full_scale_v = 1\nsample_rate_hz = 1e300", "sample_rate_hz must be 8000 to 1000000"),
    ],
)
def test_profiles_that_cannot_be_used(tmp_path, text, says):
    path = tmp_path / "rig.toml"
    path.write_text(text)
    with pytest.raises(DeviceError, match=says):
        AudioProfile(**read_rig_profile(path, AudioProfile))


@pytest.mark.parametrize(
    ("refusal", "error"),
    [("Device unavailable [-9985]", DeviceBusyError), ("Invalid sample rate", DeviceError)],
)
def test_an_interface_that_refuses(portaudio, monkeypatch, refusal, error):
    monkeypatch.setattr(OutputStream, "refusal", refusal)
    with pytest.raises(error, match="Scarlett"):
        open_device("audio:device=scarlett,host_api=alsa,full_scale_v=200")
