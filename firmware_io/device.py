"""A device: the only way from the host to a link, with every sample checked on the way."""

from __future__ import annotations

import weakref
from dataclasses import replace
from types import TracebackType
from typing import Self

import numpy as np
import numpy.typing as npt

from firmware_io.errors import DeviceDisconnectedError, DeviceError, LimitError
from firmware_io.limits import DriveLimits
from firmware_io.link import Capabilities, Link
from firmware_io.mock import MockDriver, MockLink
from firmware_io.stream import Stream


class Device:
    """Streams voltages to one driver, within limits.

    As a context manager it arms on entry and always ends at 0 V; `close` lets the link go. A
    device that is forgotten closes itself, at the latest when the interpreter exits. Where STOP
    cannot be delivered it stays owed (`stop_is_owed`), and `stop`, `close`, `arm` and leaving the
    context try again; the driver's watchdog ends the output meanwhile. It belongs to one thread.

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
        self._stream = Stream(link, replace(limits, ceiling_v=ceiling_v))
        self._is_closed = False
        # Holds the stream alone: a reference to the device would keep it from being forgotten.
        weakref.finalize(self, self._stream.abandon)

    @property
    def capabilities(self) -> Capabilities:
        """What the driver can do."""
        return self._stream.link.capabilities

    @property
    def limits(self) -> DriveLimits:
        """The limits in force: the tighter of the host's and the driver's."""
        return self._stream.limits

    @property
    def is_armed(self) -> bool:
        """Whether samples can be written."""
        return self._stream.is_armed

    @property
    def stop_is_owed(self) -> bool:
        """Whether the driver may be armed: from the first try to arm it until a STOP arrived."""
        return self._stream.stop_is_owed

    @property
    def frames_sent(self) -> int:
        """Frames delivered since construction, of every kind."""
        return self._stream.frames_sent

    @property
    def bytes_sent(self) -> int:
        """Bytes delivered since construction."""
        return self._stream.bytes_sent

    @property
    def samples_sent(self) -> int:
        """Samples delivered since construction, ramps included."""
        return self._stream.samples_sent

    @property
    def last_v(self) -> float:
        """The last voltage that may stand on the output: the last written, 0.0 when stopped.

        While a lost link leaves open whether the last frame arrived, it is the larger of the
        voltages before and after that frame, until a STOP arrives.
        """
        return self._stream.last_v

    @property
    def mock(self) -> MockDriver | None:
        """The driver behind a mock link, for tests and the demo; None for any other link."""
        link = self._stream.link
        return link.driver if isinstance(link, MockLink) else None

    def lower_ceiling(self, ceiling_v: float) -> None:
        """Lower the ceiling, for a screen that bears less than the driver gives.

        If the output stands above the new ceiling, the device stops first.

        Raises
        ------
        LimitError
            If `ceiling_v` is above the present ceiling, or not finite and positive.
        DeviceError
            If the device had to stop and could not; the ceiling is lowered all the same.
        """
        stream = self._stream
        lowered = replace(stream.limits, ceiling_v=ceiling_v)
        if ceiling_v > stream.limits.ceiling_v:
            raise LimitError(
                f"The ceiling is {stream.limits.ceiling_v!r} V and can only be lowered, but "
                f"{ceiling_v!r} V was asked for; open the device anew for a higher one."
            )
        try:
            if abs(stream.last_v) > ceiling_v:
                stream.stop()
        finally:
            stream.limits = lowered

    def arm(self) -> None:
        """Make the driver ready to play, from sample index 0; no effect if armed.

        A stop still owed is delivered first.

        Raises
        ------
        DeviceDisconnectedError
            If the device is closed or its link lost.
        DeviceError
            If the driver refuses.
        """
        if self._is_closed:
            raise DeviceDisconnectedError("The device is closed; open it again before arming.")
        self._stream.arm()

    def write(self, volts: npt.ArrayLike) -> None:
        """Send samples to be played after those already sent.

        All samples are checked before the first is sent. On any error the output is brought to
        0 V and the device is disarmed before the error is raised. Samples must keep coming: a
        driver that has played all it was sent, and waits longer than its watchdog allows, stops
        by itself, and the next call raises `DeviceFaultError`.

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
        if not self._stream.is_armed:
            raise DeviceError(
                "The device must be armed to write to it, but is not; call arm() first, "
                "or use it in a with statement."
            )
        try:
            self._stream.write(_as_samples(volts))
        except BaseException as error:
            self._stop_after(error)
            raise

    def stop(self) -> None:
        """Bring the output to 0 V and disarm. Idempotent.

        Raises
        ------
        DeviceFaultError
            If the driver had stopped by itself before; it is at 0 V and nothing is owed.
        DeviceError
            If the ramp or STOP could not be delivered. The device is disarmed all the same; if
            it was STOP, `stop_is_owed` stays True and the next call tries again.
        """
        self._stream.stop()

    def close(self) -> None:
        """Stop, then let the link go. Idempotent.

        Raises
        ------
        DeviceError
            As from `stop`; the link is let go all the same.
        """
        if self._is_closed and not self.stop_is_owed:
            return
        self._is_closed = True
        self._stream.close()

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
