"""A calibration as a job: measure stroke by stroke, then reduce, fit and verify."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import closing, suppress
from pathlib import Path
from secrets import randbelow
from typing import Any

from calibration.inputs import open_inputs
from calibration.measuring import Watcher, measure
from calibration.practice import TRUTH, VIRTUAL_RIG, Truth, draw_truth
from calibration.protocol import Stroke
from calibration.rig import RIG
from calibration.session import Session, SessionInfo
from calibration.sources import ForceSource
from calibration.steps import fit_folder, plan_strokes, reduce_folder, verify_folder
from calibration.virtual import VirtualFingerSource
from haptix.devices import open_device
from haptix.errors import InputError
from haptix.finger import Finger
from haptix.screen import Screen

INPUTS = "inputs.toml"
"""Instruments of a rig, in the folder of its calibration: a client names no files."""
GO, STOP = "go", "stop"
_MEASURED = 0.7  # share of the work


class _Stopped(Exception):
    """The person wants no more strokes."""


def begin_practice(folder: Path, finger: str, screen: str, minutes: float) -> None:
    """Plan a calibration of a screen that is drawn at random, with a virtual finger."""
    own_finger, own_screen = Finger.named(finger), Screen.named(screen).replace(name=folder.name)
    planned = plan_strokes("short", own_finger, own_screen, minutes).protocol
    truth = draw_truth(own_finger, own_screen, planned, randbelow(2**31))
    folder.mkdir(parents=True, exist_ok=True)
    truth.save(folder / TRUTH)
    VIRTUAL_RIG.save(folder / RIG)
    Session.begin(folder, planned, SessionInfo(screen=own_screen, finger=own_finger))


def calibrate(
    folder: Path,
    device: str,
    ask: Callable[[str, tuple[str, ...]], str],
    progress: Callable[[float], None],
) -> dict[str, Any]:
    """Measure what is open, and verify; a session that is stopped is continued by the next call.

    Parameters
    ----------
    folder : Path
        Of a session.
    device : str
        Address of the driver; a practice plays on a mock.
    ask : callable
        Shows a prompt and returns one of its choices.
    progress : callable
        Called with the share that is done.

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
    count = len(session.protocol.strokes)

    def prompt(stroke: Stroke, tries: int) -> None:
        again = "Again, since the last try had a fault. " if tries else ""
        said = f"{again}Stroke {stroke.number} of {count}: press with {stroke.normal_force_n:g} N"
        if ask(f"{said}, slide at {stroke.speed_mm_per_s:g} mm/s.", (GO, STOP)) == STOP:
            raise _Stopped

    def done(stroke: Stroke, findings: list[Any]) -> None:
        progress(_MEASURED * (count - len(session.open_strokes)) / count)

    source = _source(session)
    address = "mock:" if (folder / TRUTH).exists() else device
    with closing(open_device(address)) as opened, suppress(_Stopped):
        measure(session, source, opened, Watcher(prompt, done=done))
    still_open = [one.number for one in session.open_strokes]
    if still_open:
        return {"still_open": still_open, "verdict": None}
    reduce_folder(folder)
    progress(0.75)
    fit_folder(folder)
    progress(0.95)
    found, _ = verify_folder(folder)
    return {
        "still_open": [],
        "verdict": found.verdict,
        "failures": list(found.failures),
        "untested": list(found.untested),
        "worst_jnd": found.worst_thresholds,
    }


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
