"""The capabilities that a driver states, in volts and seconds."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, Self

from firmware_io.errors import DeviceError, ProtocolError
from firmware_io.protocol import MAX_SAMPLES, CapabilitiesReport, StreamMode

Mode = Literal["waveform", "envelope"]

#: Bounds of PROTOCOL.md on what a device may state.
MAX_RATE_HZ = 1_000_000
MAX_QUEUE_SAMPLES = 2**24


@dataclass(frozen=True)
class Capabilities:
    """The capabilities of the driver at the other end of a link.

    Parameters
    ----------
    name : str
        Name for display.
    sample_rate_hz : float
        Samples per second in the present set-up.
    full_scale_v : float
        The voltage of code 32767.
    ceiling_v : float
        Largest voltage that the driver accepts.
    max_frame_samples : int
        Largest number of samples in one frame.
    max_slew_v_per_s : float
        Steepest slew that the driver accepts.
    queue_samples : int
        Depth of its queue.
    max_watchdog_s : float
        Longest watchdog time that it accepts.
    serial : str
        Serial number; empty if it has none.
    calibration_id : str
        Profile that was measured with it; empty if none was.
    rates : tuple of (int, tuple of str)
        Each sample rate, with the modes in which it is offered.
    reports_touch : bool
        Whether it reports where fingers are.
    guard_s : float
        Time ahead of the output from which queued samples can be revised, in seconds; 0 if they
        cannot.
    takes_marks : bool
        Whether it tells by a digital line, and by its clock, when a sample is played.

    Raises
    ------
    DeviceError
        If a number is impossible.
    """

    name: str
    sample_rate_hz: float
    full_scale_v: float
    ceiling_v: float
    max_frame_samples: int
    max_slew_v_per_s: float
    queue_samples: int
    max_watchdog_s: float
    serial: str
    calibration_id: str
    rates: tuple[tuple[int, tuple[Mode, ...]], ...]
    reports_touch: bool
    guard_s: float = 0.0
    takes_marks: bool = False

    def __post_init__(self) -> None:
        for field in ("sample_rate_hz", "full_scale_v", "ceiling_v", "max_slew_v_per_s"):
            value = getattr(self, field)
            if not (math.isfinite(value) and value > 0):
                raise DeviceError(
                    f"{field} of device {self.name!r} must be a finite number above 0, "
                    f"but is {value!r}; correct the device's description."
                )
        # A device that states more would make the host keep a second of it in memory.
        if self.sample_rate_hz > MAX_RATE_HZ or self.queue_samples > MAX_QUEUE_SAMPLES:
            raise DeviceError(
                f"Device {self.name!r} states {self.sample_rate_hz:g} samples a second and a queue "
                f"of {self.queue_samples}, but at most {MAX_RATE_HZ} and {MAX_QUEUE_SAMPLES} are "
                "possible; correct the device's description."
            )
        if not 1 <= self.max_frame_samples <= MAX_SAMPLES:
            raise DeviceError(
                f"max_frame_samples of device {self.name!r} must lie in 1..{MAX_SAMPLES}, "
                f"but is {self.max_frame_samples!r}; correct the device's description."
            )
        if self.queue_samples < self.max_frame_samples:
            raise DeviceError(
                f"The queue of device {self.name!r} must hold a frame, {self.max_frame_samples} "
                f"samples, but holds {self.queue_samples}; correct the device's description."
            )

    @classmethod
    def from_report(cls, report: CapabilitiesReport, sample_rate_hz: int) -> Self:
        """Return the capabilities in a driver's report, at one of its rates."""
        return cls(
            name=report.name,
            sample_rate_hz=float(sample_rate_hz),
            full_scale_v=report.full_scale_mv / 1e3,
            ceiling_v=report.ceiling_mv / 1e3,
            max_frame_samples=report.max_frame_samples,
            max_slew_v_per_s=float(report.max_slew_v_per_s),
            queue_samples=report.queue_samples,
            max_watchdog_s=report.max_watchdog_ms / 1e3,
            serial=report.serial,
            calibration_id=report.calibration_id,
            rates=tuple((rate.sample_rate_hz, _modes(rate.modes)) for rate in report.rates),
            reports_touch=report.reports_touch,
            guard_s=report.guard_ticks / report.output_rate_hz,
            takes_marks=report.takes_marks,
        )

    def best_rate_hz(self, mode: Mode, most_hz: float = math.inf) -> int:
        """Return the highest rate in a mode that is at most `most_hz`.

        Raises
        ------
        ProtocolError
            If the driver offers none.
        """
        fitting = [rate for rate, modes in self.rates if mode in modes and rate <= most_hz]
        if not fitting:
            raise ProtocolError(
                f"Device {self.name!r} offers no {mode} mode at up to {most_hz:g} Hz; it offers "
                f"{self.offers()}."
            )
        return max(fitting)

    def offers(self) -> str:
        """Return its rates and modes as a text."""
        return ", ".join(f"{' and '.join(modes)} at {rate} Hz" for rate, modes in self.rates)


def _modes(modes: frozenset[StreamMode]) -> tuple[Mode, ...]:
    named: tuple[tuple[StreamMode, Mode], ...] = (
        (StreamMode.WAVEFORM, "waveform"),
        (StreamMode.ENVELOPE, "envelope"),
    )
    return tuple(name for mode, name in named if mode in modes)
