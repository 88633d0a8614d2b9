"""An audio interface with a high-voltage amplifier as the driver: the firmware runs on the host.

PortAudio's callback is its output stage.
"""

from __future__ import annotations

import logging
import math
from contextlib import suppress
from dataclasses import dataclass
from importlib import import_module
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from firmware_io.device_errors import DeviceBusyError, DeviceError, DeviceNotFoundError
from firmware_io.link import Bus, DeviceInfo, Scheme, number, yes_or_no
from firmware_io.links.hosted import HostedLink, RigProfile, read_rig_profile
from firmware_io.protocol import FULL_SCALE_CODE

_LOG = logging.getLogger("firmware_io.links")

_MOST_LATENCY_S = 10.0  # JACK's virtual ports state latencies of a day


@dataclass(frozen=True, kw_only=True)
class AudioProfile(RigProfile):
    """The interface and amplifier behind an audio output.

    Parameters
    ----------
    device : str or int, optional
        Name of the interface, a unique part of it, or its number; default: the system's.
    full_scale_v : float, optional
        Volts on the screen at digital full scale; otherwise the product of `dac_full_scale_v` and
        `amplifier_gain`.
    trigger : bool
        Whether the second channel is a digital line, high for 1 ms from the first sample of each
        playback and from each mark.

    Raises
    ------
    DeviceError
        If the full scale is not given in exactly one way, or a number is impossible.
    """

    device_name: ClassVar[str] = "audio interface"

    device: str | int | None = None
    full_scale_v: float | None = None
    trigger: bool = False

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

    Opening takes a second, in which the output is held at 0 V.

    Parameters
    ----------
    profile : AudioProfile
        The interface, and the volts at its full scale.

    Attributes
    ----------
    underflows : int
        Number of times that PortAudio served the interface too late.

    Raises
    ------
    DeviceNotFoundError, DeviceBusyError, DeviceError
        If the interface cannot be opened.
    """

    def __init__(self, profile: AudioProfile) -> None:
        self._sounddevice = sounddevice = _sounddevice()
        self.underflows = 0
        self._has_finished = False
        index = _find_device(sounddevice, profile)
        super().__init__(profile, f"audio:device={sounddevice.query_devices(index)['name']}")
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
            raise _refusal(self.name, error) from error
        self._hold()

    @property
    def latency_s(self) -> float | None:
        """Latency that the interface states, in seconds; None if it is implausible."""
        latency_s = float(self._stream.latency) if self._stream is not None else math.nan
        return latency_s if 0.0 <= latency_s <= _MOST_LATENCY_S else None

    def _fill(self, out: npt.NDArray[np.float32], frames: int, times: Any, status: Any) -> None:
        """Fill a block of PortAudio with what the firmware plays."""
        if status and status.output_underflow:
            self.underflows += 1
            _LOG.info("%s: PortAudio was served too late, %d times", self.name, self.underflows)
        codes, line = self._next(frames)
        np.divide(codes, FULL_SCALE_CODE, out=out[:, 0], dtype=np.float32)
        if out.shape[1] > 1:
            out[:, 1] = line

    def _finished(self) -> None:
        self._has_finished = True
        if not self._is_released:
            self._fail("PortAudio ended the stream; the interface was unplugged or its server quit")

    def _end(self, plays_on: bool) -> None:
        """Close; a stream that plays on is stopped, which plays out what it holds."""
        stream, self._stream = self._stream, None
        # Of a stream on JACK whose server has ended, PortAudio waits ten minutes for the end.
        if stream is not None and (stream.active or self._has_finished):
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


def _find_device(sounddevice: Any, profile: AudioProfile) -> int:
    devices = list(sounddevice.query_devices())
    outputs = {
        index: device["name"]
        for index, device in enumerate(devices)
        if device["max_output_channels"] >= (2 if profile.trigger else 1)
    }
    wanted = profile.device
    if isinstance(wanted, int):
        matches = [index for index in outputs if index == wanted]
    elif wanted is None:
        matches = [index for index in outputs if index == sounddevice.default.device[1]]
    else:
        matches = [index for index, name in outputs.items() if name == wanted]
        matches = matches or [i for i, name in outputs.items() if wanted.lower() in name.lower()]
    if len(matches) == 1:
        return matches[0]
    known = ", ".join(f"{name!r} ({index})" for index, name in outputs.items()) or "none"
    channels = "two output channels" if profile.trigger else "an output"
    what = "is the default" if wanted is None else f"is called {wanted!r}"
    if matches:
        raise DeviceError(f"Several audio devices match {wanted!r}; name one of {known}.")
    raise DeviceNotFoundError(
        f"No audio device with {channels} {what}; connected: {known}. Name one by device=."
    )


def _refusal(name: str, error: Exception) -> DeviceError:
    text = str(error)
    if "Device unavailable" in text or "busy" in text.lower():
        return DeviceBusyError(f"{name} is in use by another program: {text}")
    return DeviceError(f"{name} cannot be opened: {text}; try another sample_rate_hz or device.")


def _open(profile: str | None = None, device: str | None = None, **values: Any) -> AudioLink:
    if device is not None:
        values["device"] = int(device) if device.isdigit() else device
    known = {} if profile is None else read_rig_profile(profile, AudioProfile)
    return AudioLink(AudioProfile(**{**known, **values}))


def _search() -> tuple[str, list[DeviceInfo]]:
    sounddevice = import_module("sounddevice")
    note = "Say what its full scale means on the screen: full_scale_v=."
    devices = [
        DeviceInfo(f"audio:device={index}", "audio", device["name"], True, note)
        for index, device in enumerate(sounddevice.query_devices())
        if device["max_output_channels"] > 0
    ]
    version = sounddevice.get_portaudio_version()[1]
    return f"sounddevice {sounddevice.__version__}, {version}", devices


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
    },
    makes_rate=True,
    bus=Bus(_search, "pip install sounddevice; on Debian: apt install libportaudio2"),
)
