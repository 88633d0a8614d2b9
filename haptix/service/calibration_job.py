"""A calibration as a job: measure stroke by stroke, reduce, fit, verify, install the profile."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from secrets import randbelow
from typing import Any

from calibration.measuring import Watcher, measure
from calibration.practice import (
    TRUTH,
    VIRTUAL_RIG,
    Truth,
    VirtualFingerSource,
    compare_with_truth,
    draw_truth,
)
from calibration.profile import FINGER, SCREEN
from calibration.protocol import Stroke
from calibration.rig import RIG
from calibration.session import Session, SessionInfo
from calibration.sources import ForceSource, Live, open_inputs
from calibration.steps import fit_folder, plan_strokes, reduce_folder, verify_folder
from firmware_io import Device
from haptix.devices import open_device
from haptix.errors import InputError
from haptix.finger import Finger
from haptix.profiles import install_profile
from haptix.screen import Screen

INPUTS = "inputs.toml"
"""Instruments of a rig, in the folder of its calibration: a client names no files."""
GO, AGAIN, STOP = "go", "repeat the last one", "stop"
INSTALL, LEAVE = "install it", "leave it"
_MEASURED = 0.7  # share of the work
_TRACE_S = 0.1  # between two traces of a stroke that is made in real time


Ask = Callable[[str, tuple[str, ...]], str]
"""Shows a prompt and returns one of its choices."""
Tell = Callable[..., None]
"""Takes a `share` that is done, a `step`, or a `trace`."""


class _Stopped(Exception):
    """The person wants no more strokes."""


class _Again(Exception):
    """The person wants to make the last stroke once more."""


@dataclass
class _Strokes:
    """Guides the person from stroke to stroke."""

    session: Session
    ask: Ask
    tell: Tell
    last: Stroke | None = None
    repeat_reason: str = ""

    def watcher(self) -> Watcher:
        return Watcher(self._prompt, self._live, self._done)

    def __post_init__(self) -> None:
        self._count = len(self.session.protocol.strokes)
        self._rows: list[tuple[float, ...]] = []
        self._tries, self._traced_s = 0, 0.0

    def _prompt(self, stroke: Stroke, tries: int) -> None:
        self._tries = tries
        ways = "there and back" if stroke.there_and_back else "one way"
        instruction = (
            f"{self.repeat_reason}Stroke {stroke.number} of {self._count}: press with "
            f"{stroke.normal_force_n:g} N and slide {stroke.length_mm:g} mm {ways} at "
            f"{stroke.speed_mm_per_s:g} mm/s."
        )
        can_repeat = self.last is not None and tries == 0
        answer = self.ask(instruction, (GO, AGAIN, STOP) if can_repeat else (GO, STOP))
        if answer == AGAIN:
            raise _Again
        if answer == STOP:
            raise _Stopped

    def _live(self, stroke: Stroke, t_s: float, now: Live) -> None:
        self._rows.append((t_s, now.normal_force_n, now.tangential_force_n, now.speed_mm_per_s))
        if time.monotonic() - self._traced_s > _TRACE_S:
            self._tell(stroke)

    def _done(self, stroke: Stroke, findings: Sequence[Any]) -> None:
        self._tell(stroke)
        fatal = [str(finding) for finding in findings if finding.is_fatal]
        self.last = None if fatal else stroke
        self.repeat_reason = f"Once more, please. {'; '.join(fatal)}. " if fatal else ""
        done = self._count - len(self.session.open_strokes)
        self.tell(share=_MEASURED * done / self._count)

    def _tell(self, stroke: Stroke) -> None:
        if self._rows:
            names = ("t_s", "normal_force_n", "tangential_force_n", "speed_mm_per_s")
            columns = {
                name: [round(value, 4) for value in column]
                for name, column in zip(names, zip(*self._rows, strict=True), strict=True)
            }
            self._rows, self._traced_s = [], time.monotonic()
            planned = {
                "asked_normal_force_n": stroke.normal_force_n,
                "asked_speed_mm_per_s": stroke.speed_mm_per_s,
            }
            trace = {"stroke": stroke.number, "tries": self._tries, **planned, **columns}
            self.tell(trace=trace)


def begin_practice(
    folder: Path, finger: str, screen: str, minutes: float, seed: int | None = None
) -> None:
    """Plan a calibration of a screen that is drawn at random, with a virtual finger."""
    finger_used, screen_used = Finger.named(finger), Screen.named(screen).replace(name=folder.name)
    planned = plan_strokes("short", finger_used, screen_used, minutes).protocol
    drawn = randbelow(2**31) if seed is None else seed
    truth = draw_truth(finger_used, screen_used, planned, drawn)
    folder.mkdir(parents=True, exist_ok=True)
    truth.save(folder / TRUTH)
    VIRTUAL_RIG.save(folder / RIG)
    Session.begin(folder, planned, SessionInfo(screen=screen_used, finger=finger_used))


def calibrate(folder: Path, device: str, ask: Ask, tell: Tell) -> dict[str, Any]:
    """Measure what is open, verify, and install; a session that is stopped is continued.

    Parameters
    ----------
    folder : Path
        Of a session.
    device : str
        Address of the driver; a practice plays on a mock, and is installed for that alone.
    person : Person
        At the screen.

    Returns
    -------
    dict
        Strokes that are still open, and the verdict once none is.

    Raises
    ------
    InputError
        If the folder has no instruments.
    """
    session = Session.open(folder)
    practises = (folder / TRUTH).exists()
    with closing(open_device("mock:" if practises else device)) as opened:
        tell(step="measure")
        _measure(session, opened, ask, tell)
        if still_open := [stroke.number for stroke in session.open_strokes]:
            return {"name": folder.name, "still_open": still_open, "verdict": None}
        serial = opened.capabilities.serial
    tell(step="fit")
    reduce_folder(folder)
    tell(share=0.75)
    fit, _ = fit_folder(folder)
    tell(share=0.95, step="verify")
    verification, screen = verify_folder(folder)
    result: dict[str, Any] = {
        "name": folder.name,
        "still_open": [],
        "verdict": verification.verdict,
        "failures": list(verification.failures),
        "untested": list(verification.untested),
        "worst_jnd": verification.worst_jnd,
        "strokes_used": len(fit.strokes),
        "h0_nm": None if screen is None else 1e9 * screen.h0_m,
        "installed_for": None,
    }
    if practises and screen is not None:
        highest_v = max(stroke.voltage_v for stroke in session.protocol.strokes)
        off = compare_with_truth(folder, highest_v)
        result["practice"] = {
            "true_h0_nm": 1e9 * off.true_h0_m,
            "h0_error": off.h0_error,
            "friction_error_median_jnd": off.friction_error_median_jnd,
            "friction_error_worst_jnd": off.friction_error_worst_jnd,
        }
    if screen is not None and not screen.warnings() and serial:
        tell(step="install")
        question = (
            f"The calibration of {folder.name} passed. Install its profile for driver {serial}?"
        )
        if ask(question, (INSTALL, LEAVE)) == INSTALL:
            install_profile(serial, folder / SCREEN, folder / FINGER)
            result["installed_for"] = serial
    return result


def _measure(session: Session, device: Device, ask: Ask, tell: Tell) -> None:
    """Make the open strokes; the last one once more if the person wants to."""
    strokes, source = _Strokes(session, ask, tell), _source(session)
    while True:
        try:
            measure(session, source, device, strokes.watcher())
        except _Again:
            assert strokes.last is not None
            session.open_again(strokes.last)
            strokes.last = None
        except _Stopped:
            return
        else:
            return


def _source(session: Session) -> ForceSource:
    truth, inputs = session.folder / TRUTH, session.folder / INPUTS
    if truth.exists():
        known = Truth.load(truth)
        made = len(session.protocol.strokes) - len(session.open_strokes)
        return VirtualFingerSource(known.model, seed=known.seed + made)
    if inputs.exists():
        return open_inputs(inputs)
    raise InputError(
        f"{session.folder.name}: expected {INPUTS} in its folder, with the rig's instruments"
    )
