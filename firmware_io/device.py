"""A device: the only way from the host to a link, with every sample checked on the way."""

from __future__ import annotations

from dataclasses import replace
from types import TracebackType
from typing import Self

import numpy as np
import numpy.typing as npt

from firmware_io.errors import (
    DeviceDisconnectedError,
    DeviceError,
    DeviceFaultError,
    LimitError,
    ProtocolError,
)
from firmware_io.limits import DriveLimits
from firmware_io.link import Capabilities, Link
from firmware_io.mock import MockDriver, MockLink
from firmware_io.protocol import SEQUENCE_MODULUS, Frame, FrameKind, encode, volts_to_codes


class Device:
    """Streams voltages to one driver, within limits.

    As a context manager it arms on entry and always ends at 0 V; `close` lets the link go.
    It belongs to one thread.

    Parameters
    ----------
    link : Link
        The way to the driver; from now on used by this object alone.
    limits : DriveLimits, optional
        What every sample must keep to; the ceiling is lowered to what the driver accepts.
    """

    def __init__(self, link: Link, limits: DriveLimits | None = None) -> None:
        limits = DriveLimits() if limits is None else limits
        reach = link.capabilities
        ceiling_v = min(limits.ceiling_v, reach.ceiling_v, reach.full_scale_v)
        self._limits = replace(limits, ceiling_v=ceiling_v)
        self._link = link
        self._is_armed = False
        self._is_closed = False
        self._sequence = 0
        self._sample_index = 0
        self._last_v = 0.0
        self._frames_sent = 0
        self._bytes_sent = 0
        self._samples_sent = 0

    @property
    def capabilities(self) -> Capabilities:
        """What the driver can do."""
        return self._link.capabilities

    @property
    def limits(self) -> DriveLimits:
        """The limits in force: the tighter of the host's and the driver's."""
        return self._limits

    @property
    def is_armed(self) -> bool:
        """Whether samples can be written."""
        return self._is_armed

    @property
    def frames_sent(self) -> int:
        """Frames delivered since construction, of every kind."""
        return self._frames_sent

    @property
    def bytes_sent(self) -> int:
        """Bytes delivered since construction."""
        return self._bytes_sent

    @property
    def samples_sent(self) -> int:
        """Samples delivered since construction, ramps included."""
        return self._samples_sent

    @property
    def last_v(self) -> float:
        """The last voltage written; 0.0 when stopped."""
        return self._last_v

    @property
    def mock(self) -> MockDriver | None:
        """The driver behind a mock link, for tests and the demo; None for any other link."""
        return self._link.driver if isinstance(self._link, MockLink) else None

    def lower_ceiling(self, ceiling_v: float) -> None:
        """Lower the ceiling, for a screen that bears less than the driver gives.

        If the output stands above the new ceiling, the device stops first.

        Raises
        ------
        LimitError
            If `ceiling_v` is above the present ceiling, or not finite and positive.
        """
        lowered = replace(self._limits, ceiling_v=ceiling_v)
        if ceiling_v > self._limits.ceiling_v:
            raise LimitError(
                f"The ceiling is {self._limits.ceiling_v!r} V and can only be lowered, but "
                f"{ceiling_v!r} V was asked for; open the device anew for a higher one."
            )
        if abs(self._last_v) > ceiling_v:
            self.stop()
        self._limits = lowered

    def arm(self) -> None:
        """Make the driver ready to play, from sample index 0; no effect if armed.

        Raises
        ------
        DeviceDisconnectedError
            If the device is closed or its link lost.
        """
        if self._is_closed:
            raise DeviceDisconnectedError("The device is closed; open it again before arming.")
        if not self._is_armed:
            self._sample_index = 0
            self._last_v = 0.0
            self._send(FrameKind.ARM)
            self._is_armed = True

    def write(self, volts: npt.ArrayLike) -> None:
        """Send samples to be played after those already sent.

        All samples are checked before the first is sent. On any error the output is brought to
        0 V and the device is disarmed before the error is raised.

        Parameters
        ----------
        volts : array_like, shape (n,)
            Real voltages, one per sample at `capabilities.sample_rate_hz`.

        Raises
        ------
        LimitError
            If a sample breaks a limit; none of `volts` is played.
        DeviceError
            If the device is not armed, `volts` is not a 1-D real array, or the driver fails.
        """
        if not self._is_armed:
            raise DeviceError(
                "The device must be armed to write to it, but is not; call arm() first, "
                "or use it in a with statement."
            )
        try:
            self._stream(_as_samples(volts))
        except BaseException as error:
            self._stop_after(error)
            raise

    def stop(self) -> None:
        """Bring the output to 0 V and disarm. Idempotent.

        Raises
        ------
        DeviceError
            If the ramp or STOP could not be delivered; the device is disarmed all the same.
        """
        if not self._is_armed:
            return
        try:
            if self._last_v != 0.0:
                self._stream(
                    self._limits.ramp_to_zero(self._last_v, self.capabilities.sample_rate_hz)
                )
        finally:
            # A driver ramps on STOP too, so a ramp that fails is no reason to withhold STOP.
            self._is_armed = False
            self._last_v = 0.0
            self._send(FrameKind.STOP)

    def close(self) -> None:
        """Stop, then let the link go. Idempotent."""
        if self._is_closed:
            return
        self._is_closed = True
        try:
            self.stop()
        finally:
            self._link.close()

    def __enter__(self) -> Self:
        self.arm()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        if error is None:
            self.stop()
        else:
            self._stop_after(error)

    def _stop_after(self, error: BaseException) -> None:
        """Stop because of `error`, which stays the one to be raised."""
        try:
            self.stop()
        except Exception as failure:
            error.add_note(f"Bringing the output to 0 V failed as well: {failure}")

    def _stream(self, volts: npt.NDArray[np.float64]) -> None:
        reach = self.capabilities
        self._limits.check(volts, self._last_v, reach.sample_rate_hz)
        codes = volts_to_codes(volts, reach.full_scale_v, self._limits.ceiling_v)
        for start in range(0, codes.size, reach.max_frame_samples):
            chunk = codes[start : start + reach.max_frame_samples]
            # Known before the send: if that fails, the sample may stand on the output or not.
            self._last_v = float(volts[start + chunk.size - 1])
            self._send(FrameKind.STREAM, chunk)
            self._sample_index += chunk.size
            self._samples_sent += chunk.size

    def _send(self, kind: FrameKind, codes: npt.NDArray[np.int16] | None = None) -> None:
        samples = np.empty(0, dtype=np.int16) if codes is None else codes
        data = encode(Frame(kind, self._sequence, self._sample_index, samples))
        self._sequence = (self._sequence + 1) % SEQUENCE_MODULUS
        try:
            self._link.send(data)
        except (ProtocolError, DeviceFaultError):
            # The driver refused the frame and has ramped down by itself: nothing left to ramp.
            self._last_v = 0.0
            raise
        self._frames_sent += 1
        self._bytes_sent += len(data)


def _as_samples(volts: npt.ArrayLike) -> npt.NDArray[np.float64]:
    """Return `volts` as a 1-D float64 array, or raise DeviceError."""
    try:
        array = np.asarray(volts)
    except (TypeError, ValueError, RuntimeError) as error:
        raise DeviceError(
            f"Voltages must be a 1-D array of real numbers, but could not be read as one: {error}"
        ) from error
    if array.ndim != 1 or array.dtype.kind not in "fiu":
        raise DeviceError(
            f"Voltages must be a 1-D array of real numbers, but came as {array.ndim}-D "
            f"{array.dtype} of shape {array.shape}; give one voltage per sample."
        )
    return array.astype(np.float64)
