"""A link: the one interface that hardware and simulation both implement."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass

from firmware_io.errors import DeviceError


@dataclass(frozen=True)
class Capabilities:
    """What the driver at the other end of a link can do.

    Parameters
    ----------
    name : str
        For people.
    sample_rate_hz : float
        Samples that the driver plays per second.
    full_scale_v : float
        The voltage of code 32767.
    ceiling_v : float
        Largest voltage that the driver itself accepts.
    max_frame_samples : int
        Largest number of samples in one frame, 1 to 65535.

    Raises
    ------
    DeviceError
        If a number is not finite and positive, or a frame's size is out of range.
    """

    name: str
    sample_rate_hz: float
    full_scale_v: float
    ceiling_v: float
    max_frame_samples: int

    def __post_init__(self) -> None:
        for field in ("sample_rate_hz", "full_scale_v", "ceiling_v"):
            value = getattr(self, field)
            if not (math.isfinite(value) and value > 0):
                raise DeviceError(
                    f"{field} of device {self.name!r} must be a finite number above 0, "
                    f"but is {value!r}; correct the device's description."
                )
        if not 1 <= self.max_frame_samples <= 65535:
            raise DeviceError(
                f"max_frame_samples of device {self.name!r} must lie in 1..65535, "
                f"but is {self.max_frame_samples!r}; correct the device's description."
            )


class Link(ABC):
    """Carries whole frames to one driver.

    A link knows nothing of limits: only `firmware_io.Device` holds one, and checks first.
    An implementation turns its library's errors into those of `firmware_io.errors`; an OSError
    may pass, and counts as a lost link.
    """

    @property
    @abstractmethod
    def capabilities(self) -> Capabilities:
        """What the driver can do."""

    @abstractmethod
    def send(self, frame: bytes) -> None:
        """Deliver one encoded frame, in order.

        Raises
        ------
        DeviceDisconnectedError
            If the link is closed or lost.
        ProtocolError, DeviceFaultError
            If the driver refuses the frame; its output is then at 0 V.
        """

    @abstractmethod
    def close(self) -> None:
        """Let the driver go, which then ends at 0 V, at the latest by its watchdog. Idempotent."""
