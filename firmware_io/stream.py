"""The host's end of one stream: what was sent, what may stand on the output, the stop owed."""

from __future__ import annotations

from contextlib import suppress

import numpy as np
import numpy.typing as npt

from firmware_io.errors import DeviceDisconnectedError, DeviceFaultError, ProtocolError
from firmware_io.limits import DriveLimits
from firmware_io.link import Link
from firmware_io.protocol import SEQUENCE_MODULUS, Frame, FrameKind, encode, volts_to_codes


class Stream:
    """Frames to one driver, and the stop that is owed for them.

    It does not know the `Device` that it serves: it must be able to stop the driver after that
    device was forgotten.

    Parameters
    ----------
    link : Link
        The way to the driver.
    limits : DriveLimits
        What every sample must keep to.

    Attributes
    ----------
    is_armed : bool
        Whether samples can be written.
    stop_is_owed : bool
        Whether the driver may be armed: from the first try to arm it until a STOP arrived.
    last_v : float
        The last voltage that may stand on the output. Of a frame that may have arrived or not,
        the larger of the voltages before and after it.
    frames_sent, bytes_sent, samples_sent : int
        What was delivered since construction.
    """

    def __init__(self, link: Link, limits: DriveLimits) -> None:
        self.link = link
        self.limits = limits
        self.is_armed = False
        self.stop_is_owed = False
        self.last_v = 0.0
        self.frames_sent = 0
        self.bytes_sent = 0
        self.samples_sent = 0
        self._sequence = 0
        self._sample_index = 0
        self._is_in_doubt = False

    def arm(self) -> None:
        """Deliver a stop still owed, then arm the driver; no effect if armed."""
        if self.is_armed:
            return
        self.stop()
        self._sample_index = 0
        # Before the send: an ARM whose delivery fails may have arrived all the same.
        self.stop_is_owed = True
        self._send(FrameKind.ARM)
        self.is_armed = True

    def write(self, volts: npt.NDArray[np.float64]) -> None:
        """Check all samples, then send them frame by frame."""
        reach = self.link.capabilities
        self.limits.check(volts, self.last_v, reach.sample_rate_hz)
        codes = volts_to_codes(volts, reach.full_scale_v, self.limits.ceiling_v)
        for start in range(0, codes.size, reach.max_frame_samples):
            chunk = codes[start : start + reach.max_frame_samples]
            self._send(FrameKind.STREAM, chunk, float(volts[start + chunk.size - 1]))

    def stop(self) -> None:
        """Ramp to 0 V and deliver STOP, if one is owed; it stays owed if that fails."""
        if not self.stop_is_owed:
            return
        self.is_armed = False
        try:
            # In doubt about what stands on the output, only the driver knows where to ramp from.
            if self.last_v != 0.0 and not self._is_in_doubt:
                rate = self.link.capabilities.sample_rate_hz
                self.write(self.limits.ramp_to_zero(self.last_v, rate))
        finally:
            # A driver ramps on STOP too, so a ramp that fails is no reason to withhold STOP.
            self._send_stop()

    def close(self) -> None:
        """Stop, then let the link go even if that failed."""
        try:
            self.stop()
        finally:
            try:
                self.link.close()
            except OSError as error:
                raise self._lost(error) from error

    def abandon(self) -> None:
        """Close without a word, for a device that was forgotten: nobody is left to be told."""
        with suppress(Exception):
            self.close()

    def _send_stop(self) -> None:
        was_in_doubt = self._is_in_doubt
        try:
            self._send(FrameKind.STOP)
        except (ProtocolError, DeviceFaultError):
            # A driver that refuses STOP has stopped as well. After a frame in doubt that is no
            # news: it only means that the frame had arrived, and STOP did not follow on it.
            if not was_in_doubt:
                self.stop_is_owed = False
                raise
        self.stop_is_owed = False

    def _send(
        self,
        kind: FrameKind,
        codes: npt.NDArray[np.int16] | None = None,
        reached_v: float = 0.0,
    ) -> None:
        """Send one frame, after which `reached_v` stands on the output."""
        samples = np.empty(0, dtype=np.int16) if codes is None else codes
        data = encode(Frame(kind, self._sequence, self._sample_index, samples))
        self._is_in_doubt = True
        self.last_v = max(self.last_v, reached_v, key=abs)
        try:
            self.link.send(data)
        except (ProtocolError, DeviceFaultError):
            # The driver refused the frame and has ramped down by itself: nothing left to ramp.
            self._is_in_doubt = False
            self.last_v = 0.0
            raise
        except OSError as error:
            raise self._lost(error) from error
        # Only now: the driver counts what it received, and STOP must follow on that.
        self._sequence = (self._sequence + 1) % SEQUENCE_MODULUS
        self._sample_index += samples.size
        self._is_in_doubt = False
        self.last_v = reached_v
        self.frames_sent += 1
        self.bytes_sent += len(data)
        self.samples_sent += samples.size

    def _lost(self, error: OSError) -> DeviceDisconnectedError:
        return DeviceDisconnectedError(
            f"The link to {self.link.capabilities.name!r} failed: {error}; check its cable and "
            "power, then stop or arm it again."
        )
