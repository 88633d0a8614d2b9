"""Play a protocol on a screen, stroke by stroke, and keep what was recorded."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime

import numpy as np

from calibration.protocol import Protocol, Stroke
from calibration.recording import Conditions, StrokeRecording
from calibration.recording_checks import Complaint, complaints
from calibration.session import Session
from calibration.sources import ForceSource, Live, Played
from firmware_io import Device
from haptix.errors import HaptixError, InputError

MOST_TRIES = 5
"""Attempts at one stroke before the next comes; it stays open for a resumed session."""

_SLACK_S = 1.2  # to press, turn and lift
_RAMP_S = 0.02  # over which the drive comes and goes
_BLOCK_S = 0.05
_LEAD_S = 0.1  # that the driver may be ahead of the clock
_WITHOUT_DEVICE_HZ = 48_000.0


@dataclass(frozen=True)
class Watcher:
    """What the person is told; each may do nothing.

    Parameters
    ----------
    prompt : callable
        Called before a stroke with its number of tries so far; returns when the person is ready.
    live : callable
        Called while a stroke is made.
    done : callable
        Called with what is wrong with a stroke; an empty list where it was accepted.
    """

    prompt: Callable[[Stroke, int], None] = lambda stroke, tries: None
    live: Callable[[Stroke, float, Live], None] = lambda stroke, t_s, now: None
    done: Callable[[Stroke, list[Complaint]], None] = lambda stroke, wrong: None


@dataclass(frozen=True)
class SessionOutcome:
    """What became of a protocol.

    Parameters
    ----------
    accepted : int
        StrokeConditions on disk.
    rejected : int
        Attempts that were not accepted, this time.
    still_open : tuple of Stroke
        Strokes that nothing usable was recorded of.
    """

    accepted: int
    rejected: int
    still_open: tuple[Stroke, ...] = field(default=())


def drive_for(stroke: Stroke, protocol: Protocol, sample_rate_hz: float) -> Played:
    """Return the voltage of one recording: a sine from before the touch until after the lift.

    Raises
    ------
    InputError
        If the driver is too slow for the frequency.
    """
    if sample_rate_hz < 4 * stroke.frequency_hz:
        raise InputError(
            f"{stroke.label}: expected a driver of {4 * stroke.frequency_hz:g} samples a second "
            f"or more, got {sample_rate_hz:g} Hz"
        )
    duration = 2 * protocol.idle_s + stroke.sliding_s + _SLACK_S
    t = np.arange(round(duration * sample_rate_hz)) / sample_rate_hz
    end = float(t[-1])
    envelope = np.interp(t, [0.0, _RAMP_S, end - _RAMP_S, end], [0.0, 1.0, 1.0, 0.0])
    volts = stroke.voltage_v * envelope * np.sin(2 * np.pi * stroke.frequency_hz * t)
    return Played(volts, sample_rate_hz)


def measure(
    session: Session,
    source: ForceSource,
    device: Device | None = None,
    watcher: Watcher | None = None,
    conditions: Conditions | None = None,
    most_tries: int = MOST_TRIES,
    clock: Callable[[], float] = time.monotonic,
    sleep: Callable[[float], None] = time.sleep,
) -> SessionOutcome:
    """Measure all strokes of a session that are still open.

    Every stroke is on disk before the next starts: an interrupted session loses the stroke under
    way. The driver is armed for each stroke alone, and at 0 V while the person reads.

    Parameters
    ----------
    session : Session
        Where to keep strokes.
    source : ForceSource
        Instruments.
    device : Device, optional
        Plays the drive; without one nothing is played (a replay).
    watcher : Watcher, optional
        Prompts and shows.
    conditions : Conditions, optional
        Room; instruments and time are added.
    most_tries : int
        Attempts at each stroke.
    clock, sleep : callable
        For instruments that record in real time.

    Raises
    ------
    LimitError, DeviceError
        If a stroke is not allowed or the driver fails; what was measured stays on disk.
    """
    if most_tries < 1:
        raise InputError(f"most_tries: expected 1 or more, got {most_tries}")
    watcher = Watcher() if watcher is None else watcher
    _check_protocol(session, device)
    rejected = 0
    for stroke in session.open_strokes:
        for tries in range(most_tries):
            watcher.prompt(stroke, tries)
            recording = _record(session, stroke, source, device, watcher, conditions, clock, sleep)
            wrong = complaints(recording, session.protocol.idle_s, session.protocol.tolerance)
            fatal = tuple(str(one) for one in wrong if one.is_fatal)
            session.keep(replace(recording, complaints=fatal))
            watcher.done(stroke, wrong)
            if not fatal:
                break
            rejected += 1
    still_open = session.open_strokes
    return SessionOutcome(len(session.protocol.strokes) - len(still_open), rejected, still_open)


def _check_protocol(session: Session, device: Device | None) -> None:
    """Refuse before the first stroke what the screen must not carry."""
    ceilings = {f"screen {session.info.screen.name!r}": session.info.screen.max_voltage_v}
    if device is not None:
        ceilings["the driver"] = device.limits.ceiling_v
    for stroke in session.protocol.strokes:
        for what, ceiling in ceilings.items():
            if stroke.voltage_v > ceiling:
                raise InputError(
                    f"{stroke.label}: {what} bears {ceiling:g} V; plan with --max-voltage-v "
                    f"{ceiling:g}"
                )


def _record(
    session: Session,
    stroke: Stroke,
    source: ForceSource,
    device: Device | None,
    watcher: Watcher,
    conditions: Conditions | None,
    clock: Callable[[], float],
    sleep: Callable[[float], None],
) -> StrokeRecording:
    rate = _WITHOUT_DEVICE_HZ if device is None else device.capabilities.sample_rate_hz
    played = drive_for(stroke, session.protocol, rate)
    room = conditions or Conditions()
    room = replace(
        room,
        instruments={**room.instruments, **source.instruments},
        operator=room.operator or session.info.operator,
        started=datetime.now(UTC).isoformat(timespec="seconds"),
    )
    source.start(stroke, played)
    try:
        if device is None:
            _watch(stroke, source, played, watcher, clock, sleep)
        else:
            _play(stroke, source, played, device, watcher, clock, sleep)
    except BaseException:
        _abandon(source)
        raise
    return StrokeRecording.of(stroke, source.finish(), room)


def _play(
    stroke: Stroke,
    source: ForceSource,
    played: Played,
    device: Device,
    watcher: Watcher,
    clock: Callable[[], float],
    sleep: Callable[[float], None],
) -> None:
    block = max(1, round(_BLOCK_S * played.sample_rate_hz))
    with device:
        begun = clock()
        for first in range(0, len(played.volts), block):
            device.write(played.volts[first : first + block])
            if source.is_live:
                ahead = first / played.sample_rate_hz - (clock() - begun) - _LEAD_S
                if ahead > 0:
                    sleep(ahead)
            now = source.live((first + block) / played.sample_rate_hz)
            if now is not None:
                watcher.live(stroke, (first + block) / played.sample_rate_hz, now)
        if source.is_live:
            sleep(max(played.duration_s - (clock() - begun), 0.0))


def _watch(
    stroke: Stroke,
    source: ForceSource,
    played: Played,
    watcher: Watcher,
    clock: Callable[[], float],
    sleep: Callable[[float], None],
) -> None:
    begun = clock()
    for t_s in np.arange(_BLOCK_S, played.duration_s, _BLOCK_S):
        if source.is_live:
            sleep(max(float(t_s) - (clock() - begun), 0.0))
        now = source.live(float(t_s))
        if now is not None:
            watcher.live(stroke, float(t_s), now)


def _abandon(source: ForceSource) -> None:
    """Let instruments go after a failure, which stays the one to be raised."""
    with suppress(HaptixError):
        source.finish()
