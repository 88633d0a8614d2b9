"""Measure: play a protocol on a screen stroke by stroke, and keep the recordings."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from contextlib import nullcontext, suppress
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from hashlib import sha256
from typing import NamedTuple

import numpy as np

from calibration.measure.clocks import even_times
from calibration.measure.recording import Conditions, StrokeRecording
from calibration.measure.recording_checks import Finding, check_recording
from calibration.measure.session import Session
from calibration.measure.sources import ForceSource, Live, StrokeDrive
from calibration.plan.parameters import Array
from calibration.plan.protocol import Protocol, Stroke
from firmware_io import Device
from haptix.base.checks import whole
from haptix.base.errors import HaptixError, InputError
from haptix.base.task import Context

_LOG = logging.getLogger("calibration")

_SLACK_S = 0.8  # to press and lift
_TURN_S = 0.2  # each way
_RAMP_S = 0.02  # over which the drive comes and goes
_BLOCK_S = 0.05
_LEAD_S = 0.1  # that the driver may be ahead of the clock
_WITHOUT_DEVICE_HZ = 48_000.0


@dataclass(frozen=True)
class Watcher:
    """Prompts and progress for the person at the screen."""

    prompt: Callable[[Stroke, int], None] = lambda stroke, tries: None
    """Called before a stroke with its number of attempts so far; returns when the person is
    ready."""
    live: Callable[[Stroke, float, Live], None] = lambda stroke, t_s, now: None
    """Called while a stroke is recorded, with the time since its start [s]."""
    done: Callable[[Stroke, list[Finding]], None] = lambda stroke, findings: None
    """Called with the findings of a stroke; an empty list where it is good."""


class SessionOutcome(NamedTuple):
    """Strokes on disk, attempts of this run that were rejected, and strokes that are still open."""

    accepted: int
    rejected: int
    still_open: tuple[Stroke, ...]


def drive_for(stroke: Stroke, protocol: Protocol, sample_rate_hz: float) -> StrokeDrive:
    """Return the voltage of one recording: a sine from before the touch until after the lift.

    Raises `InputError` if the driver is too slow for the frequency.
    """
    if sample_rate_hz < 4 * stroke.frequency_hz:
        raise InputError(
            f"{stroke.label}: expected a driver of {4 * stroke.frequency_hz:g} samples a second "
            f"or more, got {sample_rate_hz:g} Hz"
        )
    duration = 2 * protocol.idle_s + stroke.sliding_s + _SLACK_S + _TURN_S * max(stroke.slides, 2)
    t = np.arange(round(duration * sample_rate_hz)) / sample_rate_hz
    end = float(t[-1])
    envelope = np.interp(t, [0.0, _RAMP_S, end - _RAMP_S, end], [0.0, 1.0, 1.0, 0.0])
    volts = stroke.voltage_v * envelope * np.sin(2 * np.pi * stroke.frequency_hz * t)
    return StrokeDrive(volts, sample_rate_hz)


def measure(
    session: Session,
    source: ForceSource,
    device: Device | None = None,
    watcher: Watcher | None = None,
    conditions: Conditions | None = None,
    most_tries: int = 5,
    clock: Callable[[], float] = time.monotonic,
    sleep: Callable[[float], None] = time.sleep,
) -> SessionOutcome:
    """Measure all strokes of a session that are still open.

    Every stroke is on disk before the next starts: an interrupted session loses only the current
    one. The driver is armed for each stroke alone, and at 0 V in between.

    Parameters
    ----------
    session, source : Session, ForceSource
        Folder that keeps the strokes, and the instruments.
    device : Device, optional
        Plays the drive; without one nothing is played (a replay).
    watcher : Watcher, optional
        Prompts the person and shows progress.
    conditions : Conditions, optional
        Room; instruments and time are added.
    most_tries : int
        Attempts at each stroke. After them it stays open for a resumed session.
    clock, sleep : callable
        Time [s] and waiting, for instruments that record in real time.

    Raises
    ------
    LimitError, DeviceError
        If a stroke is not allowed or the driver fails; finished recordings stay on disk.
    """
    whole("most_tries", most_tries, 1)
    _check_voltages(session, device)
    unmeasured = set(getattr(source, "assumed", ()))
    if source.is_live and device is None and "drive_v" in unmeasured:
        driven = [
            open_stroke.number for open_stroke in session.open_strokes if open_stroke.voltage_v > 0
        ]
        if driven:
            raise InputError(
                f"stroke {driven[0]} has a voltage, but nothing plays it and nothing measures it: "
                "give --device, or a channel drive_v in --inputs that reads the screen's voltage"
            )
    watcher = watcher or Watcher()
    protocol, room = session.protocol, conditions or Conditions()
    rejected = 0
    # No instrument reads the same noise twice, but a file may be there under two numbers.
    seen = {} if source.is_live else {_samples(one): one.stroke for one in session.recordings}
    for stroke in session.open_strokes:
        for tries in range(most_tries):
            watcher.prompt(stroke, tries)
            began = replace(
                room,
                instruments={**room.instruments, **source.instruments},
                operator=room.operator or session.info.operator,
                started=datetime.now(UTC).isoformat(timespec="seconds"),
            )
            signals, played = _record(stroke, protocol, source, device, watcher.live, clock, sleep)
            if "drive_v" not in signals:
                t_s = even_times(signals["t_s"])
                signals["drive_v"] = played.at(t_s - t_s[0])
                unmeasured.add("drive_v")
            recording = StrokeRecording.of(stroke, signals, began, tuple(sorted(unmeasured)))
            findings = check_recording(recording, protocol.idle_s, protocol.tolerance)
            if not source.is_live and (first := seen.get(_samples(recording))) is not None:
                findings.append(_repeated(first))
            fatal = tuple(str(finding) for finding in findings if finding.is_fatal)
            session.keep(replace(recording, findings=fatal))
            texts = "; ".join(map(str, findings))
            _LOG.info("stroke %d is %s: %s", stroke.number, "repeated" if fatal else "kept", texts)
            watcher.done(stroke, findings)
            if not fatal:
                seen[_samples(recording)] = stroke
                break
            rejected += 1
    still_open = session.open_strokes
    return SessionOutcome(len(protocol.strokes) - len(still_open), rejected, still_open)


GO, AGAIN, STOP = "go", "repeat the last one", "stop"
_TOLD_S = 0.1  # between two traces of a stroke that is made in real time


class _StoppedError(Exception):
    """The person wants no more strokes."""


class _AgainError(Exception):
    """The person wants to make the last stroke once more."""


class _Guide:
    """Guides a person from stroke to stroke, by the context of a task."""

    def __init__(self, session: Session, context: Context, asks: bool) -> None:
        self._session, self._context, self._asks = session, context, asks
        self.watcher = Watcher(self._prompt, self._live, self._done)
        self.last: Stroke | None = None
        """A stroke that was just accepted, and may be repeated."""
        self.rejected = 0
        self._why = ""
        self._rows: list[tuple[float, ...]] = []
        self._tries, self._told_s = 0, 0.0

    def _prompt(self, stroke: Stroke, tries: int) -> None:
        self._tries = tries
        if not self._asks:
            return
        prompt = (
            f"{self._why}Stroke {stroke.number} of {len(self._session.protocol.strokes)}: press "
            f"with {stroke.normal_force_n:g} N and slide {stroke.length_mm:g} mm {stroke.ways} "
            f"at {stroke.speed_mm_per_s:g} mm/s."
        )
        can_repeat = self.last is not None and tries == 0
        answer = self._context.ask(prompt, (GO, AGAIN, STOP) if can_repeat else (GO, STOP))
        if answer == AGAIN:
            raise _AgainError
        if answer == STOP:
            raise _StoppedError

    def _live(self, stroke: Stroke, t_s: float, now: Live) -> None:
        self._rows.append((t_s, now.normal_force_n, now.tangential_force_n, now.speed_mm_per_s))
        if time.monotonic() - self._told_s > _TOLD_S:
            self._tell_trace(stroke)

    def _done(self, stroke: Stroke, findings: list[Finding]) -> None:
        self._tell_trace(stroke)
        fatal = [str(finding) for finding in findings if finding.is_fatal]
        self.rejected += bool(fatal)
        self.last = None if fatal else stroke
        self._why = f"Once more, please. {'; '.join(fatal)}. " if fatal else ""
        for finding in findings:
            self._context.tell(step=f"stroke {stroke.number}: {finding}")
        count = len(self._session.protocol.strokes)
        self._context.progress("measure", 1 - len(self._session.open_strokes) / count)

    def _tell_trace(self, stroke: Stroke) -> None:
        if not self._rows:
            return
        names = ("t_s", "normal_force_n", "tangential_force_n", "speed_mm_per_s")
        columns = zip(names, zip(*self._rows, strict=True), strict=True)
        trace = {
            "stroke": stroke.number,
            "tries": self._tries,
            "asked_normal_force_n": stroke.normal_force_n,
            "asked_speed_mm_per_s": stroke.speed_mm_per_s,
            **{name: [round(value, 4) for value in column] for name, column in columns},
        }
        self._rows, self._told_s = [], time.monotonic()
        self._context.tell(trace=trace)


def _samples(recording: StrokeRecording) -> bytes:
    """Hash of what the instruments read."""
    read = recording.normal_force_n, recording.tangential_force_n, recording.x_mm
    return sha256(b"".join(np.ascontiguousarray(one).tobytes() for one in read)).digest()


def _repeated(stroke: Stroke) -> Finding:
    return Finding(
        "same samples",
        f"they are those of stroke {stroke.number}, bit for bit: is a file there twice, under two "
        "numbers? Give each stroke its own recording",
    )


def measure_guided(
    session: Session,
    source: ForceSource,
    device: Device | None,
    context: Context,
    asks: bool = True,
    conditions: Conditions | None = None,
    most_tries: int = 5,
) -> SessionOutcome:
    """Measure open strokes with a person, who continues, repeats the last stroke, or stops.

    Without `asks` there are no prompts. For the other parameters see `measure`.
    """
    guide = _Guide(session, context, asks)
    while True:
        try:
            measure(session, source, device, guide.watcher, conditions, most_tries)
        except _AgainError:
            assert guide.last is not None
            session.open_again(guide.last)
            guide.last = None
            continue
        except _StoppedError:
            pass
        still_open = session.open_strokes
        accepted = len(session.protocol.strokes) - len(still_open)
        return SessionOutcome(accepted, guide.rejected, still_open)


def _check_voltages(session: Session, device: Device | None) -> None:
    """Refuse a protocol above a limit before the first stroke."""
    limits = {f"screen {session.info.screen.name!r}": session.info.screen.max_voltage_v}
    if device is not None:
        limits["the driver"] = device.limits.ceiling_v
    for stroke in session.protocol.strokes:
        for what, limit in limits.items():
            if stroke.voltage_v > limit:
                raise InputError(
                    f"{stroke.label}: {what} bears {limit:g} V; plan with --max-voltage-v {limit:g}"
                )


def record_stroke(
    stroke: Stroke, source: ForceSource, device: Device | None = None
) -> dict[str, Array]:
    """Record as long as one stroke takes, while its drive plays; nothing is checked or kept."""
    whole_time = Protocol(strokes=(stroke,))
    signals, _ = _record(
        stroke, whole_time, source, device, lambda *_: None, time.monotonic, time.sleep
    )
    return signals


def _record(
    stroke: Stroke,
    protocol: Protocol,
    source: ForceSource,
    device: Device | None,
    live: Callable[[Stroke, float, Live], None],
    clock: Callable[[], float],
    sleep: Callable[[float], None],
) -> tuple[dict[str, Array], StrokeDrive]:
    """Play and record one stroke; return its signals and the played samples."""
    rate = _WITHOUT_DEVICE_HZ if device is None else device.capabilities.sample_rate_hz
    lead_s = 0.0 if device is None else _LEAD_S
    played = drive_for(stroke, protocol, rate)
    block = max(1, round(_BLOCK_S * rate))

    def wait_until(time_s: float) -> None:
        if source.is_live:
            sleep(max(time_s - clock(), 0.0))

    source.start(stroke, played)
    try:
        with nullcontext() if device is None else device:
            begun = clock()
            for first in range(0, len(played.volts), block):
                if device is not None:
                    device.write(played.volts[first : first + block])
                wait_until(begun + first / rate - lead_s)
                t_s = (first + block) / rate
                if (now := source.live(t_s)) is not None:
                    live(stroke, t_s, now)
            wait_until(begun + played.duration_s)
    except BaseException:
        # Release the instruments; the first failure is the one that is raised.
        with suppress(HaptixError):
            source.finish()
        raise
    return source.finish(), played
