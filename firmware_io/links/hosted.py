"""The firmware on the host, in front of an output that has none of its own.

A sound card or an analog output plays whatever it is given and has neither limits nor watchdog. So
the firmware runs in this process, with its queue, limits, ramp and watchdog, and the output is its
output stage.
"""

from __future__ import annotations

import logging
import math
import threading
from abc import abstractmethod

import numpy as np
import numpy.typing as npt

from firmware_io.errors import DeviceDisconnectedError, DeviceError
from firmware_io.firmware.core import LINE, Core, Output
from firmware_io.limits import DEFAULT_WINDOW_S
from firmware_io.link import Link
from firmware_io.links.rig_profile import RigProfile

_LOG = logging.getLogger("firmware_io.links")

_TRIGGER_S = 0.001
_POLL_S = 0.0005
#: 0 V at the beginning. The firmware here begins with each opening; what it drove before, in this
#: process or another, must have left the second over which energy and mean are taken.
HOLD_S = DEFAULT_WINDOW_S
HOLD_EXTRA_S = 5.0
"""After which an output that asks for nothing counts as broken."""


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
        self._name = name
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

    @property
    def name(self) -> str:
        """Its address."""
        return self._name

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
            # The ramp takes 5 ms, and what it waits behind as long as the output says; one that
            # has stopped never rests.
            plays_on = self._is_resting.wait(0.5 + (self.latency_s or 0.0))
        self._shut(plays_on)

    @abstractmethod
    def _end(self, plays_on: bool) -> None:
        """Close the output; one that plays on holds zeros, which it may play out. Called once."""

    def _shut(self, plays_on: bool = False) -> None:
        if self._is_open:
            self._is_open = False
            self._end(plays_on)

    def _hold(self) -> None:
        """Wait until the output was held at 0 V."""
        try:
            has_held = self._has_held.wait(HOLD_S + (self.latency_s or 0.0) + HOLD_EXTRA_S)
            self._check_open()
            if not has_held:
                raise DeviceError(
                    f"{self._name} takes no samples, though it is open; check its server or clock."
                )
        except BaseException:
            self._shut()
            raise

    def _next(self, count: int) -> tuple[npt.NDArray[np.int16], npt.NDArray[np.bool_]]:
        """Return the next output samples as codes, and where the digital line is high."""
        if not self._has_held.is_set():
            self._hold_samples -= count
            if self._hold_samples <= 0:
                self._has_held.set()
            return np.zeros(count, np.int16), np.zeros(count, np.bool_)
        with self._lock:
            codes, what = self._core.play(count)
            if self._is_released:
                self._count_rest(codes)
        return codes, self._trigger(what & ~np.uint8(LINE)) | (what >= LINE)

    def _count_rest(self, codes: npt.NDArray[np.int16]) -> None:
        """Tell `close` once enough zeros came behind the ramp to have pushed it out."""
        self._rest_samples = 0 if codes.any() else self._rest_samples + codes.size
        buffered = (self.latency_s or 0.0) * self._rate_hz
        # Two blocks more: the one that is being handed over, and one of the server behind it.
        if self._rest_samples >= buffered + 2 * codes.size:
            self._is_resting.set()

    def _trigger(self, what: npt.NDArray[np.uint8]) -> npt.NDArray[np.bool_]:
        """Return the pulse that begins with the first sample of each playback."""
        pulse = np.zeros(what.size, np.bool_)
        left = min(self._trigger_left, pulse.size)
        pulse[:left] = True
        self._trigger_left -= left
        plays = (what == Output.STREAM) | (what == Output.HELD)
        if plays.any() and not self._was_streaming:
            first = int(plays.argmax())
            pulse[first : first + self._trigger_samples] = True
            self._trigger_left = max(0, self._trigger_samples - (pulse.size - first))
        self._was_streaming = bool(plays[-1])
        return pulse

    def _fail(self, why: str) -> None:
        """Refuse all further use; wakes `_hold`."""
        self._failure = why
        _LOG.info("%s: fails: %s", self._name, why)
        self._has_held.set()

    def _check_open(self) -> None:
        if not self._is_open:
            raise DeviceDisconnectedError(f"{self._name} is closed; open the device again.")
        if self._failure is not None:
            raise DeviceDisconnectedError(
                f"{self._name} is gone: {self._failure}; open the device again."
            )
