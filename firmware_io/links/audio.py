"""An audio interface with a high-voltage amplifier as the driver: the firmware runs on the host.

PortAudio's callback is its output stage. Both are in a process of their own, see
`firmware_io.links.own_process`.
"""

from __future__ import annotations

import json
import logging
import math
import re
import sys
from contextlib import suppress
from dataclasses import dataclass
from importlib import import_module
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from firmware_io.device_errors import DeviceBusyError, DeviceError, DeviceNotFoundError
from firmware_io.link import Bus, DeviceInfo, Scheme, number, yes_or_no
from firmware_io.links.hosted import HostedLink, RigProfile, read_rig_profile
from firmware_io.links.own_process import OwnProcessLink, ask_in_own_process, serve_link
from firmware_io.protocol import FULL_SCALE_CODE

_LOG = logging.getLogger("firmware_io.links")

_MOST_LATENCY_S = 10.0  # JACK's virtual ports state latencies of a day
_JACK = "JACK Audio Connection Kit"
_RATES_HZ = (8000, 11_025, 16_000, 22_050, 32_000, 44_100, 48_000, 88_200, 96_000, 176_400, 192_000)


@dataclass(frozen=True, kw_only=True)
class AudioProfile(RigProfile):
    """The interface and amplifier behind an audio output.

    Raises `DeviceError` if the full scale is not given in exactly one way, or a number is
    impossible.
    """

    device_name: ClassVar[str] = "audio interface"

    device: str | None = None
    """Name of the interface or a unique part of it; default: the system's."""
    full_scale_v: float | None = None
    """Volts on the screen at digital full scale; otherwise the product of `dac_full_scale_v` and
    `amplifier_gain`."""
    trigger: bool = False
    """Whether the second channel is a digital line, high for 1 ms from the first sample of each
    playback and from each mark."""
    host_api: str | None = None
    """The system's way to it, or a part of its name, where several offer it: such as ALSA, JACK,
    Core Audio, WASAPI."""

    def __post_init__(self) -> None:
        parts = (self.dac_full_scale_v, self.amplifier_gain)
        if (self.full_scale_v is None) == (None in parts) or (
            self.full_scale_v is not None and parts != (None, None)
        ):
            raise DeviceError(
                "An audio device does not say how many volts it makes: give full_scale_v, the "
                "volts on the screen at digital full scale, or both dac_full_scale_v and "
                "amplifier_gain."
            )
        super().__post_init__()

    @property
    def screen_full_scale_v(self) -> float:
        """Volts on the screen at digital full scale."""
        if self.full_scale_v is not None:
            return self.full_scale_v
        assert self.dac_full_scale_v is not None and self.amplifier_gain is not None
        return self.dac_full_scale_v * self.amplifier_gain

    @property
    def has_line(self) -> bool:
        """Whether the second channel is its digital line."""
        return self.trigger


class AudioLink(HostedLink):
    """The firmware, playing into an output stream of PortAudio.

    Opening takes a second, in which the output is held at 0 V. Raises `DeviceNotFoundError` or
    `DeviceBusyError` or `DeviceError` if the interface cannot be opened.

    Parameters
    ----------
    profile : AudioProfile
        The interface, and the volts at its full scale.

    Attributes
    ----------
    underflows : int
        Number of times that PortAudio served the interface too late.
    """

    def __init__(self, profile: AudioProfile) -> None:
        self._sounddevice = sounddevice = _sounddevice()
        self.underflows = 0
        index = _find_device(sounddevice, profile)
        about = sounddevice.query_devices(index)
        super().__init__(profile, f"audio:device={about['name']}")
        self._is_on_jack = _host_api(sounddevice, about) == _JACK
        self._lead_s = 0.0
        self._stream: Any = None
        try:
            self._stream = sounddevice.OutputStream(
                device=index,
                samplerate=profile.sample_rate_hz,
                channels=2 if profile.trigger else 1,
                dtype="float32",
                latency="low",
                callback=self._fill,
                finished_callback=self._finished,
            )
            self._stream.start()
        except sounddevice.PortAudioError as error:
            self._shut()
            rates = _rates(sounddevice, index) if "sample rate" in str(error).lower() else []
            raise _refusal(self.name, error, rates) from error
        self._hold()

    @property
    def latency_s(self) -> float | None:
        """Latency that the interface states, in seconds; None if it is implausible.

        On JACK, where PortAudio's is a block too short, it is the time to the output of the last
        block, if that is known.
        """
        latency_s = float(self._stream.latency) if self._stream is not None else math.nan
        latency_s = self._lead_s or latency_s
        return latency_s if 0.0 <= latency_s <= _MOST_LATENCY_S else None

    def _fill(self, out: npt.NDArray[np.float32], frames: int, times: Any, status: Any) -> None:
        """Fill a block of PortAudio with the firmware's output."""
        if status and status.output_underflow:
            self.underflows += 1
            _LOG.info("%s: PortAudio was served too late, %d times", self.name, self.underflows)
        if self._is_on_jack and times is not None:
            self._lead_s = times.outputBufferDacTime - times.currentTime
        codes, line = self._next(frames)
        np.divide(codes, FULL_SCALE_CODE, out=out[:, 0], dtype=np.float32)
        if out.shape[1] > 1:
            out[:, 1] = line

    def _finished(self) -> None:
        if not self._is_released:
            self._fail("PortAudio ended the stream; the interface was unplugged or its server quit")

    def _end(self, plays_on: bool) -> None:
        """Close; a stream that plays on is stopped, which plays out its queue."""
        stream, self._stream = self._stream, None
        if stream is not None:
            with suppress(self._sounddevice.PortAudioError):
                if plays_on:
                    stream.stop()
                else:
                    stream.abort()
            with suppress(self._sounddevice.PortAudioError):
                stream.close()


def _sounddevice() -> Any:
    try:
        return import_module("sounddevice")
    except OSError as error:
        raise DeviceError(
            f"sounddevice found no PortAudio: {error}; on Debian: apt install libportaudio2."
        ) from error


def _host_api(sounddevice: Any, about: dict[str, Any]) -> str:
    return str(sounddevice.query_hostapis(about["hostapi"])["name"])


def _outputs(sounddevice: Any, channels: int) -> dict[int, tuple[str, str]]:
    """Return name and host API of each output, by PortAudio's number of the moment."""
    return {
        index: (about["name"], _host_api(sounddevice, about))
        for index, about in enumerate(sounddevice.query_devices())
        if about["max_output_channels"] >= channels
    }


def _find_device(sounddevice: Any, profile: AudioProfile) -> int:
    outputs = _outputs(sounddevice, 2 if profile.trigger else 1)
    wanted, by = profile.device, profile.host_api
    offered = {
        index: name
        for index, (name, api) in outputs.items()
        if by is None or by.lower() in api.lower()
    }
    if wanted is None:
        default = sounddevice.default.device[1]
        if by is not None:
            default = next(
                api["default_output_device"]
                for api in sounddevice.query_hostapis()
                if by.lower() in api["name"].lower()
            )
        matches = [index for index in offered if index == default]
    else:
        matches = [index for index, name in offered.items() if name == wanted]
        if not (matches or wanted.isdecimal()):  # no number: it is another interface's tomorrow
            matches = [i for i, name in offered.items() if wanted.lower() in name.lower()]
    if len(matches) == 1:
        return matches[0]
    known = ", ".join(f"{name!r} ({api})" for name, api in outputs.values()) or "none"
    if matches:
        raise DeviceError(
            f"Several audio devices match {wanted!r}; name one of {known} by device= and host_api=."
        )
    channels = "two output channels" if profile.trigger else "an output"
    what = "is the default" if wanted is None else f"is called {wanted!r}"
    way = "" if by is None else f" of host API {by!r}"
    raise DeviceNotFoundError(
        f"No audio device with {channels}{way} {what}; connected: {known}. Name one by device=."
    )


def _rates(sounddevice: Any, index: int) -> list[int]:
    """Return the usual rates at which an interface can be opened."""
    rates = []
    for rate_hz in _RATES_HZ:
        with suppress(sounddevice.PortAudioError):
            sounddevice.check_output_settings(device=index, samplerate=rate_hz, dtype="float32")
            rates.append(rate_hz)
    return rates


def _refusal(name: str, error: Exception, rates_hz: list[int]) -> DeviceError:
    text = str(error)
    if "Device unavailable" in text or "busy" in text.lower():
        return DeviceBusyError(f"{name} is in use by another program: {text}")
    advice = "try another sample_rate_hz or device."
    if rates_hz:
        advice = f"its rates are {', '.join(map(str, rates_hz))}: give one as sample_rate_hz=."
    return DeviceError(f"{name} cannot be opened: {text}; {advice}")


def open_here(profile: str | None = None, **values: Any) -> AudioLink:
    """Open an interface in this process, as its own process does."""
    known = {} if profile is None else read_rig_profile(profile, AudioProfile)
    return AudioLink(AudioProfile(**{**known, **values}))


def serve() -> None:
    """Be the process of an interface."""
    serve_link(open_here)


def list_here() -> tuple[str, list[tuple[str, str]]]:
    """Return PortAudio's version, and address and name of each output, as they are now."""
    sounddevice = _sounddevice()
    outputs = _outputs(sounddevice, 1).values()
    found = []
    for name, api in outputs:
        part = _NUMBERED.sub("", name)
        like = [other for other, its in outputs if its == api and part.lower() in other.lower()]
        device = part if len(like) == 1 else name
        found.append((f"audio:device={device},host_api={api}", f"{name} ({api})"))
    version = sounddevice.get_portaudio_version()[1]
    return f"sounddevice {sounddevice.__version__}, {version}", found


#: The end of a name on ALSA, whose first number is the card's of the moment.
_NUMBERED = re.compile(r" \(hw:\d+,\d+\)$")


def tell() -> None:
    """Write what `list_here` returns, or why it cannot, as JSON."""
    try:
        found: Any = list_here()
    except Exception as error:
        found = str(error)
    sys.stdout.write(json.dumps(found))


def _open(**values: Any) -> OwnProcessLink:
    return OwnProcessLink(__name__, values)


def _search() -> tuple[str, list[DeviceInfo]]:
    found = ask_in_own_process(__name__, "tell")
    if isinstance(found, str):
        raise DeviceError(found)
    note = "Say what its full scale means on the screen: full_scale_v=."
    detail, devices = found
    return detail, [DeviceInfo(address, "audio", name, True, note) for address, name in devices]


SCHEME = Scheme(
    _open,
    {
        "device": str,
        "profile": str,
        "full_scale_v": number,
        "dac_full_scale_v": number,
        "amplifier_gain": number,
        "ceiling_v": number,
        "trigger": yes_or_no,
        "host_api": str,
    },
    makes_rate=True,
    bus=Bus(_search, "pip install sounddevice; on Debian: apt install libportaudio2", is_slow=True),
)
