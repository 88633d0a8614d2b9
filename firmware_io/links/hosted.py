"""An output without firmware of its own: a profile of its hardware, and firmware on the host.

A sound card or an analog output plays all samples, has neither limits nor watchdog, and does not
know its volts. So the firmware runs in this process, with its queue, limits, ramp and watchdog. The
output is its output stage, and a profile states converter and amplifier.
"""

from __future__ import annotations

import logging
import math
import threading
import time
import tomllib
from abc import ABC, abstractmethod
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from firmware_io.device_errors import DeviceDisconnectedError, DeviceError
from firmware_io.firmware.core import LINE, Core, Output
from firmware_io.limits import (
    ABSOLUTE_CEILING_V,
    DEFAULT_MAX_SLEW_V_PER_S,
    DEFAULT_WINDOW_S,
    WATCHDOG_S,
)
from firmware_io.link import Link
from firmware_io.protocol import VERSION, CapabilitiesReport, Rate, StreamMode

_LARGEST_FILE = 10_000  # bytes of a profile, which has some hundreds
_LOWEST_V, _HIGHEST_V = 1e-3, 1e6  # no amplifier has a number beyond these
_HIGHEST_RATE_HZ = 1_000_000  # above those of all interfaces
_QUEUE_S = 0.5
_LOG = logging.getLogger("firmware_io.links")

_TRIGGER_S = 0.001
_POLL_S = 0.0005
_LOOK_S = 0.02
#: Time at 0 V at the beginning. The firmware starts anew at each opening, so earlier output, of
#: this process or another, must have left the second over which energy and mean are taken.
HOLD_S = DEFAULT_WINDOW_S
HOLD_EXTRA_S = 5.0
"""An output that asks for no samples for so long after it was opened counts as broken."""
STILL_S = 0.11
"""An output that asks for no samples for so long while it is open has stopped: a playback looks at
least every 50 ms, so that this is a fault within the watchdog's 0.16 s. Blocks of 4096 samples at
44.1 kHz last 0.093 s; one of 8192 would starve the firmware, whose watchdog counts its samples."""


@dataclass(frozen=True, kw_only=True)
class RigProfile(ABC):
    """An output and the amplifier behind it.

    Raises `DeviceError` if a number is impossible.
    """

    device_name: ClassVar[str]

    dac_full_scale_v: float | None = None
    """Peak volts at the output of the converter at digital full scale."""
    amplifier_gain: float | None = None
    """Gain of the amplifier, in V/V."""
    ceiling_v: float = ABSOLUTE_CEILING_V
    """Largest voltage that amplifier and screen withstand."""
    sample_rate_hz: float = 48_000.0
    """A rate of the converter."""

    @property
    @abstractmethod
    def screen_full_scale_v(self) -> float:
        """Volts on the screen at digital full scale."""

    @property
    @abstractmethod
    def has_line(self) -> bool:
        """Whether a second channel is its digital line."""

    def __post_init__(self) -> None:
        for name in ("full_scale_v", "dac_full_scale_v", "amplifier_gain", "ceiling_v"):
            value = getattr(self, name, None)
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
        if not _LOWEST_V <= self.screen_full_scale_v <= _HIGHEST_V:
            raise DeviceError(
                f"The full scale must lie in {_LOWEST_V:g}..{_HIGHEST_V:g} V, but is "
                f"{self.screen_full_scale_v:g} V."
            )

    def capabilities(self) -> CapabilitiesReport:
        """Return the capabilities of the firmware in front of the output."""
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
            name=self.device_name,
            serial="",
            calibration_id="",
            reports_touch=False,
            rates=tuple(rates),
            takes_marks=self.has_line,
        )


def read_rig_profile(path: str | Path, kind: type[RigProfile]) -> dict[str, Any]:
    """Return the entries of a TOML file with some or all of the keys of a profile.

    Raises `DeviceError` if the file cannot be read or understood.
    """
    try:
        with Path(path).open("rb") as file:
            text = file.read(_LARGEST_FILE + 1)
        if len(text) > _LARGEST_FILE:
            raise ValueError(f"expected at most {_LARGEST_FILE} bytes")
        entries = tomllib.loads(text.decode())
    except (OSError, RecursionError, ValueError) as error:
        raise DeviceError(f"The profile {path} cannot be read: {error}") from error
    types = {field.name: str(field.type) for field in fields(kind)}
    for key, value in entries.items():
        if key not in types:
            known = ", ".join(types)
            raise DeviceError(f"The profile {path} has {key!r:.60}; the keys are {known}.")
        if isinstance(value, int) and value.bit_length() > 64:
            raise DeviceError(f"{key} in the profile {path} has more than 64 bits.")
        if not isinstance(value, _KINDS[types[key]]) or (
            isinstance(value, bool) and types[key] != "bool"
        ):
            raise DeviceError(f"{key} in the profile {path} cannot be {value!r:.60}; correct it.")
    return entries


#: Types by the annotation of a field, which is a text because of this module's future import.
_KINDS: dict[str, tuple[type, ...]] = {
    "bool": (bool,),
    "str": (str,),
    "str | None": (str,),
    "str | int | None": (str, int),
    "float": (int, float),
    "float | None": (int, float),
}


class HostedLink(Link):
    """The firmware, whose samples an output asks for block by block.

    An implementation opens its output, lets it call `_next` from a thread of its own, and then
    calls `_hold`.

    Parameters
    ----------
    profile : RigProfile
        The output, and the volts at its full scale.
    name : str
        Its address.
    """

    def __init__(self, profile: RigProfile, name: str) -> None:
        self.name = name
        self._core = Core(profile.capabilities())
        self._lock = threading.Lock()
        self._is_resting = threading.Event()
        self._failure: str | None = None
        self._is_open = True
        self._is_released = False
        self._rest_samples = 0
        self._rate_hz = profile.sample_rate_hz
        self._trigger_samples = round(_TRIGGER_S * profile.sample_rate_hz)
        self._trigger_left = 0
        self._was_streaming = False
        self._hold_samples = math.ceil(HOLD_S * profile.sample_rate_hz)
        self._has_held = threading.Event()
        self._asked_s = math.inf  # when the output last asked for samples

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
        """Ramp to 0 V, wait until that was played, and close the output. Idempotent."""
        if not self._is_open:
            return
        with self._lock:
            self._core.release()
            self._is_released = True
            self._is_resting.clear()
        plays_on = False
        if self._failure is None:
            # The ramp takes 5 ms after the samples before it, whose time the output states; an
            # output that has stopped never gets there.
            plays_on = self._is_resting.wait(0.5 + (self.latency_s or 0.0))
        self._shut(plays_on)

    @abstractmethod
    def _end(self, plays_on: bool) -> None:
        """Close the output. If it plays on, it holds zeros and may play them. Called once."""

    def _shut(self, plays_on: bool = False) -> None:
        if self._is_open:
            self._is_open = False
            self._end(plays_on)

    def _hold(self) -> None:
        """Wait until the output was held at 0 V."""
        try:
            end_s = time.monotonic() + HOLD_S + (self.latency_s or 0.0) + HOLD_EXTRA_S
            while not self._has_held.wait(_LOOK_S) and time.monotonic() < end_s:
                self._check_open()
            self._check_open()
            if not self._has_held.is_set():
                raise DeviceError(
                    f"{self.name} takes no samples, though it is open; check its server or clock."
                )
        except BaseException:
            self._shut()
            raise

    def _next(self, count: int) -> tuple[npt.NDArray[np.int16], npt.NDArray[np.bool_]]:
        """Return the next output samples as codes, and where the digital line is high."""
        self._follow_output()
        self._asked_s = time.monotonic()
        if self._failure is not None or not self._has_held.is_set():
            self._hold_samples -= count
            if self._hold_samples <= 0:
                self._has_held.set()
            return np.zeros(count, np.int16), np.zeros(count, np.bool_)
        with self._lock:
            codes, kinds = self._core.play(count)
            if self._is_released:
                self._count_rest(codes)
        return codes, self._trigger(kinds & ~np.uint8(LINE)) | (kinds >= LINE)

    def _count_rest(self, codes: npt.NDArray[np.int16]) -> None:
        """Wake `close` when enough zeros have followed the ramp for it to have been played."""
        self._rest_samples = 0 if codes.any() else self._rest_samples + codes.size
        buffered = (self.latency_s or 0.0) * self._rate_hz
        # Two blocks more: the one that is being handed over, and one that the server holds.
        if self._rest_samples >= buffered + 2 * codes.size:
            self._is_resting.set()

    def _trigger(self, kinds: npt.NDArray[np.uint8]) -> npt.NDArray[np.bool_]:
        """Return the pulse that begins with the first sample of each playback."""
        pulse = np.zeros(kinds.size, np.bool_)
        left = min(self._trigger_left, pulse.size)
        pulse[:left] = True
        self._trigger_left -= left
        plays = (kinds == Output.STREAM) | (kinds == Output.HELD)
        if plays.any() and not self._was_streaming:
            first = int(plays.argmax())
            pulse[first : first + self._trigger_samples] = True
            self._trigger_left = max(0, self._trigger_samples - (pulse.size - first))
        self._was_streaming = bool(plays[-1])
        return pulse

    def _fail(self, why: str) -> None:
        """Refuse all further use, and wake `_hold`."""
        self._failure = why
        _LOG.info("%s: fails: %s", self.name, why)
        self._has_held.set()

    def _follow_output(self) -> None:
        """Fail if the output has stopped, even if it goes on: its queued samples are late."""
        silent_s = time.monotonic() - self._asked_s
        if silent_s > STILL_S and self._failure is None and self._has_held.is_set():
            self._fail(
                f"its output stands, it has asked for no samples for {silent_s:.2g} s (its blocks "
                f"must be shorter than {STILL_S:g} s)"
            )

    def _check_open(self) -> None:
        if not self._is_open:
            raise DeviceDisconnectedError(f"{self.name} is closed; open the device again.")
        self._follow_output()
        if self._failure is not None:
            raise DeviceDisconnectedError(
                f"{self.name} is gone: {self._failure}; open the device again."
            )
