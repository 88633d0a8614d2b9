"""A driver's capabilities, and a stream's set-up that fits them: limits, rates, sizes."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace
from numbers import Real
from typing import Literal, Self

from firmware_io.device_errors import DeviceError, ProtocolError
from firmware_io.limits import MIN_CARRIER_HZ, RAMP_S, WATCHDOG_S, DriveLimits
from firmware_io.link import Link
from firmware_io.protocol import (
    FULL_SCALE_CODE,
    MAX_SAMPLES,
    CapabilitiesReport,
    Setup,
    StreamMode,
    samples_per_frame,
)

Mode = Literal["waveform", "envelope"]

#: Bounds of PROTOCOL.md on the values that a device may state.
MAX_RATE_HZ = 1_000_000
MAX_QUEUE_SAMPLES = 2**24
DEFAULT_CARRIER_HZ = 4000.0
"""The carrier of a driver in envelope mode: above what skin feels."""

#: Share of a link's bytes for samples of two bytes; the rest is headers, questions, revisions.
_STREAM_SHARE = 0.9
_LEAD_S = 0.025  # default delay before playback begins
MOST_REPORTS_PER_S = 900.0
"""Reports a second that are used, of the 1000 that a full-speed device accepts."""


MOCK_NAME = "mock"


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
        Queued samples can be revised from this long before they are played, in seconds; 0 if they
        cannot be revised.
    takes_marks : bool
        Whether it reports by a digital line and by its clock when a sample is played.
    sense_rate_hz : float
        Readings of its current a second; 0.0 if it has no sensor.

    Raises
    ------
    DeviceError
        If a number is impossible.

    Examples
    --------
    >>> from firmware_io import open_device
    >>> with open_device("mock:") as device:
    ...     print(device.capabilities.ceiling_v <= 200.0)
    True
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
    sense_rate_hz: float = 0.0

    @property
    def is_virtual(self) -> bool:
        """Whether it is the mock driver, in this process or another: no screen is behind it."""
        return self.name == MOCK_NAME

    def __post_init__(self) -> None:
        above_0 = (
            "sample_rate_hz",
            "full_scale_v",
            "ceiling_v",
            "max_slew_v_per_s",
            "max_watchdog_s",
        )
        for field in above_0:
            value = getattr(self, field)
            if not (math.isfinite(value) and value > 0):
                raise DeviceError(
                    f"{field} of device {self.name!r} must be a finite number above 0, "
                    f"but is {value!r}; correct the device's description."
                )
        # The host keeps a second of samples in memory, so a device cannot state any number.
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
        """Return the capabilities in a driver's report, at one of its rates.

        Parameters
        ----------
        report : CapabilitiesReport
            The driver's report.
        sample_rate_hz : int
            One of its rates [Hz].
        """
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
            sense_rate_hz=float(report.sense_rate_hz),
        )

    def best_rate_hz(self, mode: Mode, most_hz: float = math.inf) -> int:
        """Return the highest rate in a mode that is at most `most_hz`.

        Parameters
        ----------
        mode : Mode
            The driver's mode.
        most_hz : float
            Highest rate that is acceptable [Hz].

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


def choose_mode(mode: Mode | None, driver: Capabilities, link: Link) -> Mode:
    """Return the chosen mode, or the one that suits driver and link."""
    if mode is None:
        offered = {mode for _, modes in driver.rates for mode in modes}
        by_reports = link.report_bytes is not None and "envelope" in offered
        return "envelope" if by_reports or "waveform" not in offered else "waveform"
    if mode not in ("waveform", "envelope"):
        raise DeviceError(f"The mode is waveform or envelope, but is {mode!r}; correct it.")
    return mode


def choose_rate(sample_rate_hz: float | None, mode: Mode, driver: Capabilities, link: Link) -> int:
    """Return the chosen rate, or the highest in this mode that the link can carry."""
    if sample_rate_hz is not None:
        if (sample_rate_hz, True) not in [(rate, mode in modes) for rate, modes in driver.rates]:
            raise ProtocolError(
                f"{link.name} offers {driver.offers()}, but {mode} at {sample_rate_hz!r} Hz was "
                "asked for; choose one of these."
            )
        return round(sample_rate_hz)
    most_hz = math.inf
    if link.report_bytes is not None:
        most_hz = MOST_REPORTS_PER_S / 3 * samples_per_frame(3, link.report_bytes)
    elif link.bytes_per_s is not None:
        most_hz = _STREAM_SHARE * link.bytes_per_s / 2
    return driver.best_rate_hz(mode, most_hz)


def first_setup(driver: Capabilities, mode: Mode, rate_hz: int, carrier_hz: float | None) -> Setup:
    """Return the default set-up of a driver."""
    wire_mode = StreamMode.ENVELOPE if mode == "envelope" else StreamMode.WAVEFORM
    if carrier_hz is None and mode == "envelope":
        carrier_hz = DEFAULT_CARRIER_HZ
    watchdog_s = min(WATCHDOG_S, driver.max_watchdog_s)
    return Setup(
        mode=wire_mode,
        watchdog_ms=int(watchdog_s * 1e3),
        sample_rate_hz=rate_hz,
        full_scale_mv=round(driver.full_scale_v * 1e3),
        ceiling_mv=round(driver.ceiling_v * 1e3),
        max_slew_v_per_s=round(driver.max_slew_v_per_s),
        carrier_mhz=0 if carrier_hz is None else _carrier_mhz(carrier_hz, wire_mode),
        lead_us=round(min(_LEAD_S, watchdog_s) * 1e6),
    )


def changed_setup(
    setup: Setup,
    max_watchdog_s: float,
    *,
    carrier_hz: float | None,
    lead_s: float | None,
    watchdog_s: float | None,
    status_s: float | None,
) -> Setup:
    """Return a set-up with the given values; see `firmware_io.Device.set_up`."""
    if carrier_hz is not None:
        setup = replace(setup, carrier_mhz=_carrier_mhz(carrier_hz, setup.mode))
    if watchdog_s is not None:
        _check_span("watchdog_s", watchdog_s, 0.01, min(max_watchdog_s, WATCHDOG_S))
        lead_us = min(setup.lead_us, round(watchdog_s * 5e5))
        setup = replace(setup, watchdog_ms=round(watchdog_s * 1e3), lead_us=lead_us)
    if lead_s is not None:
        _check_span("lead_s", lead_s, 0.0, setup.watchdog_ms / 1e3)
        setup = replace(setup, lead_us=round(lead_s * 1e6))
    if status_s is not None:
        _check_span("status_s", status_s, 0.0, 1.0)
        setup = replace(setup, status_ms=math.ceil(status_s * 1e3))
    return setup


def bounded_setup(
    setup: Setup, limits: DriveLimits, driver: Capabilities, output_rate_hz: int
) -> Setup:
    """Return a set-up with the host's limits.

    The driver takes only a ceiling from which its safety ramp keeps the slew limit.
    """
    slew = math.floor(min(limits.max_slew_v_per_s, driver.max_slew_v_per_s))
    setup = replace(setup, max_slew_v_per_s=slew)
    ramp_codes = step_codes(setup, output_rate_hz) * math.ceil(output_rate_hz * RAMP_S)
    ceiling_mv = min(
        math.ceil(min(limits.ceiling_v, driver.ceiling_v) * 1e3),
        ramp_codes * setup.full_scale_mv // FULL_SCALE_CODE,
    )
    if ceiling_mv < 1:
        raise DeviceError(
            f"{slew} V/s are less than one code in an output sample of device {driver.name!r}, "
            f"whose full scale is {driver.full_scale_v:g} V; choose a driver with a lower output "
            "rate or full scale, or a higher slew limit."
        )
    return replace(setup, ceiling_mv=ceiling_mv)


def step_codes(setup: Setup, output_rate_hz: int) -> int:
    """Return the largest step in codes between output samples that the slew limit allows."""
    codes_per_s = setup.max_slew_v_per_s * 1000 * FULL_SCALE_CODE // setup.full_scale_mv
    return codes_per_s // output_rate_hz


def kept_limits(limits: DriveLimits, setup: Setup, output_rate_hz: int) -> DriveLimits:
    """Return limits for samples that keep a set-up's limits when they are rounded to codes.

    If two samples differ by at most a whole number of codes, so do their codes. With a carrier,
    rounding adds up to one code to a step and half a code to an amplitude, and the driver rounds
    the carrier up to whole radians per second.
    """
    step_v = setup.full_scale_mv / 1e3 / FULL_SCALE_CODE
    slew = step_codes(setup, output_rate_hz) * output_rate_hz * step_v * (1.0 - 1e-9)
    if setup.mode is StreamMode.ENVELOPE:
        carrier_rad_per_s = 2.0 * math.pi * setup.carrier_mhz / 1e3
        slew -= step_v * (setup.sample_rate_hz + 0.5 * carrier_rad_per_s)
        slew /= 1.0 + 1e-6 + 1.0 / carrier_rad_per_s
        if slew <= 0.0:
            raise DeviceError(
                f"A slew limit of {setup.max_slew_v_per_s} V/s is less than the rounding of "
                f"amplitudes at {setup.sample_rate_hz} Hz; choose a lower sample rate."
            )
    return replace(
        limits,
        ceiling_v=min(limits.ceiling_v, setup.ceiling_mv / 1e3),
        max_slew_v_per_s=min(limits.max_slew_v_per_s, slew),
    )


def lowered_limits(limits: DriveLimits, driver: Capabilities) -> DriveLimits:
    """Return the tighter of the host's limits and the driver's.

    They are of the class `DriveLimits` itself, since a subclass of the caller could check less.
    """
    if not isinstance(limits, DriveLimits):
        raise DeviceError(f"limits must be DriveLimits, but is {limits!r}; correct it.")
    limits = DriveLimits(
        **{field.name: getattr(limits, field.name) for field in fields(DriveLimits)}
    )
    return replace(
        limits,
        ceiling_v=min(limits.ceiling_v, driver.ceiling_v, driver.full_scale_v),
        max_slew_v_per_s=min(limits.max_slew_v_per_s, driver.max_slew_v_per_s),
    )


def _carrier_mhz(carrier_hz: float, mode: StreamMode) -> int:
    if mode is not StreamMode.ENVELOPE:
        raise DeviceError(
            f"A driver makes the carrier only in envelope mode, but carrier_hz={carrier_hz!r} was "
            "given in waveform mode; leave it out, or choose mode=envelope."
        )
    _check_span("carrier_hz", carrier_hz, MIN_CARRIER_HZ, 4e6)
    return round(carrier_hz * 1e3)


def _check_span(name: str, value: float, least: float, most: float) -> None:
    is_number = isinstance(value, Real) and not isinstance(value, bool)
    if not (is_number and least <= value <= most):
        raise DeviceError(f"{name} must lie in {least:g}..{most:g}, but is {value!r}; correct it.")
