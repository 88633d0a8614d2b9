"""The mock link: a complete driver in process, which keeps everything it plays."""

from __future__ import annotations

import math
import time
from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from firmware_io.errors import (
    DeviceDisconnectedError,
    DeviceError,
    DeviceFaultError,
    ProtocolError,
)
from firmware_io.limits import ABSOLUTE_CEILING_V, WATCHDOG_S, DriveLimits
from firmware_io.link import Capabilities, Link
from firmware_io.protocol import (
    FULL_SCALE_CODE,
    SEQUENCE_MODULUS,
    Frame,
    FrameKind,
    codes_to_volts,
    decode,
    volts_to_codes,
)


class MockDriver:
    """The device side: receives bytes, trusts nothing, plays codes.

    A frame that breaks a rule is not played: the driver ramps to 0 V, disarms, remembers the
    first cause in `fault`, raises it to the sender, and plays nothing until it is armed again. It
    does the same when its stream starves, but has no thread to do so in time: whatever it is asked,
    it first catches up with what its watchdog has done by then.

    Parameters
    ----------
    sample_rate_hz : float
        Samples played per second.
    full_scale_v : float
        The voltage of code 32767.
    ceiling_v : float
        The driver's own ceiling, enforced on decoded volts whatever the host has checked.
    max_frame_samples : int
        Largest number of samples in a frame.
    lead_s : float
        Playback begins this long after the first STREAM frame, in seconds.
    watchdog_s : float
        The stream starves when no frame comes for this long after the last sample was played, in
        seconds.
    clock : callable
        Returns the time in seconds.

    Attributes
    ----------
    frames_received, bytes_received, underruns : int
        Counters since construction. A late frame is an underrun, one too late for the watchdog
        a fault.

    Raises
    ------
    DeviceError
        If a number describes no possible driver.
    LimitError
        If the ceiling is above the absolute one.
    """

    def __init__(
        self,
        sample_rate_hz: float = 48_000.0,
        full_scale_v: float = 250.0,
        ceiling_v: float = ABSOLUTE_CEILING_V,
        max_frame_samples: int = 1024,
        lead_s: float = 0.025,
        watchdog_s: float = WATCHDOG_S,
        clock: Callable[[], float] = time.perf_counter,
    ) -> None:
        for name, seconds in (("lead_s", lead_s), ("watchdog_s", watchdog_s)):
            if not (math.isfinite(seconds) and seconds >= 0):
                raise DeviceError(
                    f"{name} must be a finite number of at least 0, but is {seconds!r}; "
                    "give it in seconds."
                )
        self._capabilities = Capabilities(
            "mock", sample_rate_hz, full_scale_v, ceiling_v, max_frame_samples
        )
        self._limits = DriveLimits(ceiling_v=ceiling_v)
        self._lead_s = lead_s
        self._watchdog_s = watchdog_s
        self._clock = clock
        self._chunks: list[npt.NDArray[np.int16]] = []
        self._last_code = 0
        self._next_sequence = 0
        self._samples_since_arm = 0
        self._playback_start_s: float | None = None
        self._is_armed = False
        self._fault: str | None = None
        self._samples_played = 0
        self._faults = 0
        self.frames_received = 0
        self.bytes_received = 0
        self.underruns = 0

    @property
    def capabilities(self) -> Capabilities:
        """What the driver can do."""
        return self._capabilities

    @property
    def is_armed(self) -> bool:
        """Whether STREAM frames are accepted."""
        self._watch(self._clock())
        return self._is_armed

    @property
    def fault(self) -> str | None:
        """Why the driver stopped by itself; None if it did not, cleared by ARM."""
        self._watch(self._clock())
        return self._fault

    @property
    def faults(self) -> int:
        """Faults since construction."""
        self._watch(self._clock())
        return self._faults

    @property
    def samples_played(self) -> int:
        """Samples played since construction, the driver's own ramps included."""
        self._watch(self._clock())
        return self._samples_played

    @property
    def played_codes(self) -> npt.NDArray[np.int16]:
        """Every code played since construction, shape (samples_played,)."""
        self._watch(self._clock())
        self._chunks = [np.concatenate([np.empty(0, np.int16), *self._chunks])]
        return self._chunks[0].copy()

    @property
    def played_v(self) -> npt.NDArray[np.float64]:
        """Every voltage played since construction, shape (samples_played,)."""
        return codes_to_volts(self.played_codes, self.capabilities.full_scale_v)

    def receive(self, data: bytes) -> None:
        """Take one frame from the wire.

        Raises
        ------
        ProtocolError
            If the bytes are not a well-formed frame.
        DeviceFaultError
            If the frame breaks a rule, or the driver is not armed, or no longer as the stream has
            starved.
        """
        now_s = self._clock()
        self._watch(now_s)
        self.frames_received += 1
        self.bytes_received += len(data)
        try:
            frame = decode(data)
        except ProtocolError as error:
            self._enter_fault(str(error))
            raise
        violation = self._violation(frame)
        if violation is not None:
            self._enter_fault(violation)
            raise DeviceFaultError(
                f"The driver is in fault and at 0 V: {self._fault} Arm it again to go on."
            )
        if frame.kind is FrameKind.ARM:
            self._is_armed, self._fault = True, None
            self._samples_since_arm, self._playback_start_s = 0, None
        elif frame.kind is FrameKind.STREAM:
            self._follow_playback(now_s)
            self._samples_since_arm += frame.samples.size
            self._play(frame.samples)
        else:
            self._ramp_down()
        self._next_sequence = (frame.sequence + 1) % SEQUENCE_MODULUS

    def release(self) -> None:
        """Ramp to 0 V and disarm, as on STOP or when the host goes away."""
        self._watch(self._clock())
        self._ramp_down()

    def _ramp_down(self) -> None:
        if self._last_code:
            full_scale_v = self.capabilities.full_scale_v
            last_v = self._last_code / FULL_SCALE_CODE * full_scale_v
            ramp = self._limits.ramp_to_zero(last_v, self.capabilities.sample_rate_hz)
            self._play(volts_to_codes(ramp, full_scale_v))
        self._is_armed = False

    def _violation(self, frame: Frame) -> str | None:
        """Return the sentence for the first rule that the frame breaks."""
        if frame.kind is FrameKind.ARM:
            if self._is_armed:
                return "ARM came while armed."
            if frame.sample_index != 0:
                return f"ARM must carry sample index 0, but carried {frame.sample_index}."
            return None
        if not self._is_armed:
            # STOP asks for what already is; refusing it would only hide the first error.
            return None if frame.kind is FrameKind.STOP else "STREAM came while not armed."
        if frame.sequence != self._next_sequence:
            return f"Expected sequence {self._next_sequence}, but {frame.sequence} came."
        if frame.sample_index != self._samples_since_arm:
            return f"Expected sample index {self._samples_since_arm}, got {frame.sample_index}."
        most = self.capabilities.max_frame_samples
        if frame.samples.size > most:
            return f"A frame may carry {most} samples, but {frame.samples.size} came."
        volts = np.abs(codes_to_volts(frame.samples, self.capabilities.full_scale_v))
        if (volts > self._limits.ceiling_v).any():
            peak = float(volts.max())
            return f"A sample of {peak!r} V is above the ceiling of {self._limits.ceiling_v!r} V."
        return None

    def _enter_fault(self, cause: str) -> None:
        # The first cause is the one to report; what follows from it is not counted again.
        if self._fault is None:
            self._fault = cause
            self._faults += 1
        self._ramp_down()

    def _watch(self, now_s: float) -> None:
        """Do what the watchdog has done by now: end a stream that has starved."""
        # Before the first frame there is nothing to hold: the output is at 0 V.
        if not self._is_armed or self._playback_start_s is None:
            return
        if self._dry_for_s(now_s, self._playback_start_s) > self._watchdog_s:
            self._enter_fault(
                f"The stream starved, no frame came within {self._watchdog_s:g} s after the last "
                "sample was played; send samples earlier, with a longer lead or in longer blocks, "
                "and stop before a pause."
            )

    def _follow_playback(self, now_s: float) -> None:
        """Count an underrun if playback has already passed the last sample received."""
        if self._playback_start_s is None:
            self._playback_start_s = now_s + self._lead_s
            return
        dry_s = self._dry_for_s(now_s, self._playback_start_s)
        if dry_s > 0.0:
            self.underruns += 1
            self._playback_start_s += dry_s

    def _dry_for_s(self, now_s: float, start_s: float) -> float:
        """Time since the last sample received was played; negative while some are queued."""
        return now_s - (start_s + self._samples_since_arm / self._capabilities.sample_rate_hz)

    def _play(self, codes: npt.NDArray[np.int16]) -> None:
        if codes.size:
            self._chunks.append(codes)
            self._last_code = int(codes[-1])
            self._samples_played += codes.size


class MockLink(Link):
    """The link to a `MockDriver`.

    Parameters
    ----------
    driver : MockDriver, optional
        The driver at the other end; one with default properties if not given.
    """

    def __init__(self, driver: MockDriver | None = None) -> None:
        self.driver = MockDriver() if driver is None else driver
        self._closed = False

    @property
    def capabilities(self) -> Capabilities:
        """What the driver can do."""
        return self.driver.capabilities

    def send(self, frame: bytes) -> None:
        """Hand one frame to the driver; see `Link.send`."""
        if self._closed:
            raise DeviceDisconnectedError("The mock link is closed; open the device again.")
        self.driver.receive(frame)

    def close(self) -> None:
        """Let the driver go; it ends at 0 V. Idempotent."""
        self._closed = True
        self.driver.release()
