"""An audio interface with a high-voltage amplifier as the driver: the firmware runs on the host.

An interface plays whatever it is given and has no watchdog. So the firmware runs in front of it,
with its queue, limits, ramp and watchdog; PortAudio's callback is its output stage.
"""

from __future__ import annotations

import math
import threading
import tomllib
from contextlib import suppress
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from firmware_io.address import number, yes_or_no
from firmware_io.errors import (
    DeviceBusyError,
    DeviceDisconnectedError,
    DeviceError,
    DeviceNotFoundError,
)
from firmware_io.firmware.core import Output
from firmware_io.firmware.opening import open_core
from firmware_io.limits import (
    ABSOLUTE_CEILING_V,
    DEFAULT_MAX_SLEW_V_PER_S,
    DEFAULT_WINDOW_S,
    WATCHDOG_S,
)
from firmware_io.link import Link
from firmware_io.protocol import FULL_SCALE_CODE, VERSION, CapabilitiesReport, Rate, StreamMode
from firmware_io.scheme import Bus, DeviceInfo, Scheme

_LARGEST_PROFILE = 10_000  # bytes of its file, which has some hundreds
_LOWEST_V, _HIGHEST_V = 1e-3, 1e6  # beyond these a number is no amplifier's
_HIGHEST_RATE_HZ = 1_000_000  # above those of all interfaces
_TRIGGER_S = 0.001
_QUEUE_S = 0.5
_MOST_LATENCY_S = 10.0  # JACK's virtual ports state latencies of a day
_POLL_S = 0.0005
#: 0 V at the beginning. The firmware here begins with each opening; what it drove before, in this
#: process or another, must have left the second over which energy and mean are taken.
_HOLD_S = DEFAULT_WINDOW_S
_HOLD_EXTRA_S = 5.0  # after which a stream that asks for nothing counts as broken


@dataclass(frozen=True)
class AudioProfile:
    """The interface and amplifier behind an audio output.

    Parameters
    ----------
    device : str or int, optional
        Name of the interface, a unique part of it, or its number; default: the system's.
    full_scale_v : float, optional
        Volts on the screen at digital full scale; otherwise the product of the next two.
    dac_full_scale_v : float, optional
        Peak volts at the output of the interface at digital full scale.
    amplifier_gain : float, optional
        Gain of the amplifier, in V/V.
    ceiling_v : float
        Largest voltage that amplifier and screen stand.
    sample_rate_hz : float
        A rate of the interface.
    trigger : bool
        Whether the second channel gives a 1 ms pulse with the first sample of each playback.

    Raises
    ------
    DeviceError
        If the full scale is not given in exactly one way, or a number is impossible.
    """

    device: str | int | None = None
    full_scale_v: float | None = None
    dac_full_scale_v: float | None = None
    amplifier_gain: float | None = None
    ceiling_v: float = ABSOLUTE_CEILING_V
    sample_rate_hz: float = 48_000.0
    trigger: bool = False

    def __post_init__(self) -> None:
        for name in ("full_scale_v", "dac_full_scale_v", "amplifier_gain", "ceiling_v"):
            value = getattr(self, name)
            if value is not None and not 0 < value <= _HIGHEST_V:
                raise DeviceError(
                    f"{name} must be a number above 0 and at most {_HIGHEST_V:g}, but is "
                    f"{value!r:.60}."
                )
        if not 8000 <= self.sample_rate_hz <= _HIGHEST_RATE_HZ:
            raise DeviceError(
                f"sample_rate_hz must be 8000 to {_HIGHEST_RATE_HZ}, but is "
                f"{self.sample_rate_hz!r:.60}."
            )
        parts = (self.dac_full_scale_v, self.amplifier_gain)
        if (self.full_scale_v is None) == (None in parts) or (
            self.full_scale_v is not None and parts != (None, None)
        ):
            raise DeviceError(
                "An audio device does not say how many volts it makes: give full_scale_v, the "
                "volts on the screen at digital full scale, or both dac_full_scale_v and "
                "amplifier_gain."
            )
        if not _LOWEST_V <= self.screen_full_scale_v <= _HIGHEST_V:
            raise DeviceError(
                f"The full scale must lie in {_LOWEST_V:g}..{_HIGHEST_V:g} V, but is "
                f"{self.screen_full_scale_v:g} V."
            )

    @property
    def screen_full_scale_v(self) -> float:
        """Volts on the screen at digital full scale."""
        if self.full_scale_v is not None:
            return self.full_scale_v
        assert self.dac_full_scale_v is not None and self.amplifier_gain is not None
        return self.dac_full_scale_v * self.amplifier_gain

    def capabilities(self) -> CapabilitiesReport:
        """Return the capabilities of the firmware in front of the interface."""
        rate = round(self.sample_rate_hz)
        slow = next(rate // n for n in range(math.ceil(rate / 16e3), rate) if rate % n == 0)
        full_scale_mv = round(self.screen_full_scale_v * 1e3)
        modes = frozenset((StreamMode.WAVEFORM, StreamMode.ENVELOPE))
        rates = [Rate(rate, modes)]
        if slow != rate:
            rates.append(Rate(slow, frozenset((StreamMode.ENVELOPE,))))
        return CapabilitiesReport(
            oldest_version=VERSION,
            newest_version=VERSION,
            report_bytes=0,
            output_rate_hz=rate,
            full_scale_mv=full_scale_mv,
            ceiling_mv=min(round(self.ceiling_v * 1e3), full_scale_mv),
            max_slew_v_per_s=math.floor(DEFAULT_MAX_SLEW_V_PER_S),
            queue_samples=round(_QUEUE_S * rate),
            max_frame_samples=1024,
            max_watchdog_ms=round(WATCHDOG_S * 1e3),
            name="audio interface",
            serial="",
            calibration_id="",
            reports_touch=False,
            rates=tuple(rates),
        )


def read_audio_profile(path: str | Path) -> dict[str, Any]:
    """Return the entries of a TOML file with some or all of the keys of `AudioProfile`.

    Raises
    ------
    DeviceError
        If the file cannot be read or understood.
    """
    try:
        with Path(path).open("rb") as file:
            text = file.read(_LARGEST_PROFILE + 1)
        if len(text) > _LARGEST_PROFILE:
            raise ValueError(f"expected at most {_LARGEST_PROFILE} bytes")
        entries = tomllib.loads(text.decode())
    except (OSError, RecursionError, ValueError) as error:
        raise DeviceError(f"The audio profile {path} cannot be read: {error}") from error
    kinds = {"device": str | int, "trigger": bool}
    for key, value in entries.items():
        if key not in AudioProfile.__dataclass_fields__:
            known = ", ".join(AudioProfile.__dataclass_fields__)
            raise DeviceError(f"The audio profile {path} has {key!r:.60}; the keys are {known}.")
        if isinstance(value, int) and value.bit_length() > 64:
            raise DeviceError(f"{key} in the audio profile {path} has more than 64 bits.")
        if not isinstance(value, kinds.get(key, int | float)):
            raise DeviceError(
                f"{key} in the audio profile {path} cannot be {value!r:.60}; correct it."
            )
    return entries


class AudioLink(Link):
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
        self._core = open_core(profile.capabilities())
        self._lock = threading.Lock()
        self._is_resting = threading.Event()
        self._failure: str | None = None
        self._is_released = False
        self._rest_samples = 0
        self._rate_hz = profile.sample_rate_hz
        self._trigger_samples = round(_TRIGGER_S * profile.sample_rate_hz)
        self._trigger_left = 0
        self._was_streaming = False
        self._hold_samples = math.ceil(_HOLD_S * profile.sample_rate_hz)
        self._has_held = threading.Event()
        index = _find_device(sounddevice, profile)
        self._name = f"audio:device={sounddevice.query_devices(index)['name']}"
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
            self._close_stream()
            raise _refusal(self._name, error) from error
        self._hold()

    def _hold(self) -> None:
        """Wait until the output was held at 0 V."""
        try:
            has_held = self._has_held.wait(_HOLD_S + (self.latency_s or 0.0) + _HOLD_EXTRA_S)
            self._check_open()
            if not has_held:
                raise DeviceError(
                    f"{self._name} takes no samples, though its stream is open; check its server."
                )
        except BaseException:
            self._close_stream()
            raise

    @property
    def name(self) -> str:
        """Its address."""
        return self._name

    @property
    def latency_s(self) -> float | None:
        """Latency that the interface states, in seconds; None if it is implausible."""
        latency_s = float(self._stream.latency) if self._stream is not None else math.nan
        return latency_s if 0.0 <= latency_s <= _MOST_LATENCY_S else None

    def send(self, data: bytes) -> None:
        """Hand bytes to the firmware; see `Link.send`."""
        self._check_open()
        with self._lock:
            self._core.receive(data)

    def receive(self, timeout_s: float = 0.0) -> bytes:
        """Return the firmware's answers; see `Link.receive`."""
        waited_s = 0.0
        while True:
            self._check_open()
            with self._lock:
                data = self._core.transmit()
            if data or waited_s >= timeout_s:
                return data
            self._is_resting.wait(_POLL_S)
            waited_s += _POLL_S

    def close(self) -> None:
        """Ramp to 0 V, wait until that was played, and close the stream. Idempotent."""
        if self._stream is None:
            return
        with self._lock:
            self._core.release()
            self._is_released = True
            self._is_resting.clear()
        plays_on = False
        if self._failure is None:
            # The ramp takes 5 ms, and what it waits behind as long as the interface says; a stream
            # that has stopped never rests.
            plays_on = self._is_resting.wait(0.5 + (self.latency_s or 0.0))
        self._close_stream(plays_on)

    def _fill(self, out: npt.NDArray[np.float32], frames: int, times: Any, status: Any) -> None:
        """Fill a block of PortAudio with what the firmware plays."""
        if status and status.output_underflow:
            self.underflows += 1
        if not self._has_held.is_set():
            out[:] = 0.0
            self._hold_samples -= frames
            if self._hold_samples <= 0:
                self._has_held.set()
            return
        with self._lock:
            codes, what = self._core.play(frames)
            if self._is_released:
                self._count_rest(codes)
        np.divide(codes, FULL_SCALE_CODE, out=out[:, 0], dtype=np.float32)
        if out.shape[1] > 1:
            out[:, 1] = self._trigger(what)

    def _count_rest(self, codes: npt.NDArray[np.int16]) -> None:
        """Tell `close` once enough zeros came behind the ramp to have pushed it out."""
        self._rest_samples = 0 if codes.any() else self._rest_samples + codes.size
        buffered = (self.latency_s or 0.0) * self._rate_hz
        # Two blocks more: the one that is being handed over, and one of the server behind it.
        if self._rest_samples >= buffered + 2 * codes.size:
            self._is_resting.set()

    def _trigger(self, what: npt.NDArray[np.uint8]) -> npt.NDArray[np.float32]:
        pulse = np.zeros(what.size, dtype=np.float32)
        left = min(self._trigger_left, pulse.size)
        pulse[:left] = 1.0
        self._trigger_left -= left
        plays = (what == Output.STREAM) | (what == Output.HELD)
        if plays.any() and not self._was_streaming:
            first = int(plays.argmax())
            pulse[first : first + self._trigger_samples] = 1.0
            self._trigger_left = max(0, self._trigger_samples - (pulse.size - first))
        self._was_streaming = bool(plays[-1])
        return pulse

    def _finished(self) -> None:
        if not self._is_released:
            self._failure = (
                "PortAudio ended the stream; the interface was unplugged or its server quit"
            )
            self._has_held.set()

    def _check_open(self) -> None:
        if self._stream is None:
            raise DeviceDisconnectedError(f"{self._name} is closed; open the device again.")
        if self._failure is not None:
            raise DeviceDisconnectedError(
                f"{self._name} is gone: {self._failure}; open the device again."
            )

    def _close_stream(self, plays_on: bool = False) -> None:
        """Close; a stream that plays on is stopped, which plays out what it holds."""
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


def _find_device(sounddevice: Any, profile: AudioProfile) -> int:
    found = list(sounddevice.query_devices())
    outputs = {
        index: device["name"]
        for index, device in enumerate(found)
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
    known = {} if profile is None else read_audio_profile(profile)
    return AudioLink(AudioProfile(**{**known, **values}))


def _search() -> tuple[str, list[DeviceInfo]]:
    sounddevice = import_module("sounddevice")
    note = "Say what its full scale means on the screen: full_scale_v=."
    devices = [
        DeviceInfo(f"audio:device={index}", "audio", found["name"], True, note)
        for index, found in enumerate(sounddevice.query_devices())
        if found["max_output_channels"] > 0
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
