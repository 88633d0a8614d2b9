"""How a driver is set up: from what is wished, what it can do and what its link can carry."""

from __future__ import annotations

import math
from dataclasses import replace

from firmware_io.capabilities import Capabilities, Mode
from firmware_io.errors import DeviceError, ProtocolError
from firmware_io.limits import WATCHDOG_S, DriveLimits
from firmware_io.link import Link
from firmware_io.protocol import FULL_SCALE_CODE, Setup, StreamMode, samples_per_frame

DEFAULT_CARRIER_HZ = 4000.0
"""Of a driver that makes the carrier: above what skin feels."""

_LEAD_S = 0.025  # before playback begins, unless a playback chooses its own
_MOST_REPORTS_PER_S = 900.0  # of the 1000 that a full-speed device takes


def choose_mode(mode: Mode | None, reach: Capabilities, link: Link) -> Mode:
    """Return the wished mode, or the one that suits driver and link."""
    if mode is None:
        offered = {mode for _, modes in reach.rates for mode in modes}
        by_reports = link.report_bytes is not None and "envelope" in offered
        return "envelope" if by_reports or "waveform" not in offered else "waveform"
    if mode not in ("waveform", "envelope"):
        raise DeviceError(f"The mode is waveform or envelope, but is {mode!r}; correct it.")
    return mode


def choose_rate(sample_rate_hz: float | None, mode: Mode, reach: Capabilities, link: Link) -> int:
    """Return the wished rate, or the highest in this mode that the link can carry."""
    if sample_rate_hz is not None:
        if (sample_rate_hz, True) not in [(rate, mode in modes) for rate, modes in reach.rates]:
            raise ProtocolError(
                f"{link.name} offers {reach.offers()}, but {mode} at {sample_rate_hz!r} Hz was "
                "asked for; choose one of these."
            )
        return round(sample_rate_hz)
    most_hz = math.inf
    if link.report_bytes is not None:
        most_hz = _MOST_REPORTS_PER_S / 3 * samples_per_frame(3, link.report_bytes)
    return reach.best_rate_hz(mode, most_hz)


def first_setup(reach: Capabilities, mode: Mode, rate_hz: int, carrier_hz: float | None) -> Setup:
    """Return what a driver is told if nobody asks for more."""
    wire_mode = StreamMode.ENVELOPE if mode == "envelope" else StreamMode.WAVEFORM
    if carrier_hz is None and mode == "envelope":
        carrier_hz = DEFAULT_CARRIER_HZ
    watchdog_s = min(WATCHDOG_S, reach.max_watchdog_s)
    return Setup(
        mode=wire_mode,
        watchdog_ms=int(watchdog_s * 1e3),
        sample_rate_hz=rate_hz,
        full_scale_mv=round(reach.full_scale_v * 1e3),
        ceiling_mv=round(reach.ceiling_v * 1e3),
        max_slew_v_per_s=round(reach.max_slew_v_per_s),
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
    """Return a set-up with what is given changed; see `firmware_io.Device.set_up`."""
    if carrier_hz is not None:
        setup = replace(setup, carrier_mhz=_carrier_mhz(carrier_hz, setup.mode))
    if watchdog_s is not None:
        _check_span("watchdog_s", watchdog_s, 0.01, max_watchdog_s)
        lead_us = min(setup.lead_us, round(watchdog_s * 5e5))
        setup = replace(setup, watchdog_ms=round(watchdog_s * 1e3), lead_us=lead_us)
    if lead_s is not None:
        _check_span("lead_s", lead_s, 0.0, setup.watchdog_ms / 1e3)
        setup = replace(setup, lead_us=round(lead_s * 1e6))
    if status_s is not None:
        _check_span("status_s", status_s, 0.0, 1.0)
        setup = replace(setup, status_ms=math.ceil(status_s * 1e3))
    return setup


def bounded_setup(setup: Setup, limits: DriveLimits, reach: Capabilities) -> Setup:
    """Return a set-up by which the driver refuses what the host does, but nothing less."""
    slew = limits.max_slew_v_per_s + _slew_of_a_step(reach, setup)
    return replace(
        setup,
        ceiling_mv=math.ceil(min(limits.ceiling_v, reach.ceiling_v) * 1e3),
        max_slew_v_per_s=int(min(math.ceil(slew), reach.max_slew_v_per_s)),
    )


def lowered_limits(limits: DriveLimits, reach: Capabilities, setup: Setup) -> DriveLimits:
    """Return the tighter of the host's limits and the driver's."""
    slew = reach.max_slew_v_per_s - _slew_of_a_step(reach, setup)
    if slew <= 0.0:
        raise DeviceError(
            f"Device {reach.name!r} takes {reach.max_slew_v_per_s:g} V/s, less than one code per "
            f"sample at {setup.sample_rate_hz} Hz; choose a lower sample rate."
        )
    return replace(
        limits,
        ceiling_v=min(limits.ceiling_v, reach.ceiling_v, reach.full_scale_v),
        max_slew_v_per_s=min(limits.max_slew_v_per_s, slew),
    )


def _carrier_mhz(carrier_hz: float, mode: StreamMode) -> int:
    if mode is not StreamMode.ENVELOPE:
        raise DeviceError(
            f"A driver makes the carrier only in envelope mode, but carrier_hz={carrier_hz!r} was "
            "given in waveform mode; leave it out, or choose mode=envelope."
        )
    _check_span("carrier_hz", carrier_hz, 0.001, 4e6)
    return round(carrier_hz * 1e3)


def _check_span(name: str, value: float, least: float, most: float) -> None:
    if not least <= value <= most:
        raise DeviceError(f"{name} must lie in {least:g}..{most:g}, but is {value!r}; correct it.")


def _slew_of_a_step(reach: Capabilities, setup: Setup) -> float:
    """What rounding to codes can add to a slew with any carrier, in V/s.

    With any: a driver lets its limits be lowered only, and carriers change both ways.
    """
    step_v = reach.full_scale_v / FULL_SCALE_CODE
    fastest_hz = max(rate for rate, _ in reach.rates)
    return step_v * (setup.sample_rate_hz + math.pi * fastest_hz)
