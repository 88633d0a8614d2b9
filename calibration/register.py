"""The register of all panels: their state, due dates, and the check standard of each rig.

One file for any number of rigs: a lock lets one write at a time, and a write is whole or not at
all. A damaged register is never written over.
"""

from __future__ import annotations

from collections.abc import Callable
from datetime import date, timedelta
from pathlib import Path
from typing import Annotated, Literal

from filelock import FileLock, Timeout
from pydantic import Field

from calibration.keep.gauge import RATES, RULES, ControlChart
from calibration.keep.practice import TRUTH
from calibration.keep.session_report import chart_picture
from calibration.measure.session import Session
from calibration.steps import Finished, written_screen
from haptix.base.documents import Document, Part
from haptix.base.errors import InputError
from haptix.base.files import write_whole
from haptix.base.report import Heading, listed, page, part, picture
from haptix.model.screen import CALIBRATION_VALID_DAYS

_LOCK_S = 20.0
SOON_DAYS = 30
"""Before its due date a panel counts as due soon."""

State = Literal["open", "measured", "passed", "provisional", "failed", "practice"]
_VERDICTS = ("passed", "provisional", "failed")


class Panel(Part):
    """One calibration of a panel."""

    panel: Annotated[str, Heading("panel")]
    session: Annotated[str, Heading("session")]
    """Its name, and the folder of its session."""
    state: Annotated[State, Heading("state")]
    """"open" with strokes still to be made, "measured" where they are not yet verified, "practice"
    where no panel was measured."""
    open_strokes: Annotated[int, Heading("open strokes")] = 0
    """How many strokes are still to be made."""
    operator: Annotated[str, Heading("operator")] = ""
    calibration_id: Annotated[str, Heading("calibration")] = ""
    """Who measured, and the start of the profile's hash."""
    measured_on: Annotated[date | None, Heading("measured on")] = None
    due_on: Annotated[date | None, Heading("due on")] = None
    """Day of the strokes, and that from which the calibration is old."""
    h0_m: Annotated[float | None, Heading("d1/eps1 [m]", ".4g")] = None
    """d1/eps1 [m]."""

    strokes: Annotated[tuple[str, ...], Field(exclude_if=lambda value: not value)] = ()
    """Start of the hash of each stroke's file, by which a copied session is found."""

    @classmethod
    def of(cls, folder: Path) -> Panel:
        """Read the state of a session's folder."""
        session = Session.open(folder)
        still_open, screen = len(session.open_strokes), written_screen(folder)
        hashes = session.hashes().items()
        found = cls(
            panel=session.info.screen.name, session=str(folder.resolve()),
            state="open" if still_open else "measured", open_strokes=still_open,
            operator=session.info.operator,
            strokes=tuple(digest[:16] for name, digest in hashes if name.startswith("strokes/")),
        )  # fmt: skip
        known = Finished.load(folder)
        if (folder / TRUTH).exists():
            return found.model_copy(update={"state": "practice"})
        if still_open or screen is None or screen.calibration is None:
            if known is None or not known.verification.failures:
                return found
            days = [recording.conditions.started[:10] for recording in session.recordings]
            failed = {"state": "failed", "measured_on": date.fromisoformat(max(days))}
            return found.model_copy(update=failed)
        made = screen.calibration
        return found.model_copy(update={
            "state": "practice" if made.is_virtual else made.verdict, "operator": made.operator,
            "calibration_id": screen.calibration_id, "measured_on": made.date,
            "due_on": made.date + timedelta(days=CALIBRATION_VALID_DAYS), "h0_m": screen.h0_m,
        })  # fmt: skip

    @property
    def rank(self) -> tuple[bool, bool, date]:
        """By which one stands for its panel: no practice, with a verdict, and the newest."""
        is_real, is_judged = self.state != "practice", self.state in _VERDICTS
        return is_real, is_judged, self.measured_on or date.min

    def is_same(self, other: Panel) -> bool:
        """Whether both are of the same session, be it copied or grown."""
        return self.session == other.session or bool({*self.strokes} & {*other.strokes})

    def due(self, today: date) -> str:
        """Say when it is to be measured again."""
        if self.state == "practice":
            return "a practice, of no panel"
        if self.due_on is None:
            return "not calibrated"
        days = (self.due_on - today).days
        if days < 0:
            return f"overdue for {-days} days"
        return f"due in {days} days" if days <= SOON_DAYS else "not due"


class StandardReading(Part):
    """One measurement of a check standard."""

    standard: Annotated[str, Heading("standard")]
    """Name of the panel that is kept for it."""
    measured_on: Annotated[date, Heading("measured on")]
    """Day of the strokes."""
    operator: Annotated[str, Heading("operator")] = ""
    """Who measured."""
    change_jnd: Annotated[float, Heading("change [JND]", "+.3f")]
    """Mean of measured minus predicted friction [JND]."""


class Register(Document):
    """All panels and the readings of check standards; written on a day, by whichever rig.

    Of several calibrations of a panel the newest with a verdict stands, a practice never before a
    measured one; the others are its `history`.
    """

    written_on: date
    panels: tuple[Panel, ...] = ()
    history: tuple[Panel, ...] = ()
    readings: tuple[StandardReading, ...] = Field(default=())

    def with_panel(self, panel: Panel) -> Register:
        """Return a register with this calibration; one of the same session is replaced.

        Raises `InputError` if another panel has its strokes.
        """
        kept = [one for one in (*self.history, *self.panels) if not one.is_same(panel)]
        for one in (*self.history, *self.panels):
            if one.panel != panel.panel and {*one.strokes} & {*panel.strokes}:
                raise InputError(
                    f"{panel.session}: expected strokes on {panel.panel}, got those of "
                    f"{one.panel} ({one.session}): a session was copied under another name"
                )
        of_panel = [one for one in (*kept, panel) if one.panel == panel.panel]
        *before, stands = sorted(of_panel, key=lambda one: one.rank)
        others = [one for one in self.panels if one.panel != panel.panel and one in kept]
        history = [one for one in self.history if one.panel != panel.panel]
        return self.replace(panels=(*others, stands), history=(*history, *before))

    def chart(self, standard: str) -> ControlChart:
        """Chart the readings of a check standard, in order of time."""
        of_it = [reading for reading in self.readings if reading.standard == standard]
        ordered = sorted(of_it, key=lambda reading: reading.measured_on)
        return ControlChart.of([reading.change_jnd for reading in ordered])


def update_register(path: Path, today: date, change: Callable[[Register], Register]) -> Register:
    """Read a register, change it and write it, while no other rig may.

    Raises `InputError` if another rig holds it for too long, or the clock was set back;
    `FileFormatError` if it is damaged: it stays as it is.
    """
    if path.exists():
        Register.load(path)  # a file that is no register gets no lock beside it
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with FileLock(f"{path}.lock", timeout=_LOCK_S):
            before = Register.load(path) if path.exists() else Register(written_on=today)
            if today < before.written_on:
                raise InputError(
                    f"{path} was written on {before.written_on}, and the clock shows {today}: set "
                    "the clock right; nothing was changed"
                )
            after = change(before).replace(written_on=today)
            if after != before:
                after.save(path)
            return after
    except Timeout:
        raise InputError(
            f"{path}: another rig has written to it for {_LOCK_S:g} s; try again"
        ) from None


def write_register_page(path: Path, register: Register, today: date) -> None:
    """Write the register as one HTML page, with a control chart of each standard."""
    rows = [
        {"panel": panel.panel, "state": panel.state, "open strokes": panel.open_strokes,
         "due": panel.due(today), "due on": panel.due_on, "measured on": panel.measured_on,
         "operator": panel.operator, "calibration": panel.calibration_id, "session": panel.session}
        for panel in sorted(register.panels, key=lambda p: (p.due_on or date.min, p.panel))
    ]  # fmt: skip
    parts = [part("Panels", rows)]
    names = ("panel", "state", "measured_on", "operator", "calibration_id", "session")
    earlier = [one.model_dump(mode="json", include=set(names)) for one in register.history]
    parts += [part("Earlier calibrations", earlier)] if earlier else []
    for standard in sorted({reading.standard for reading in register.readings}):
        chart = register.chart(standard)
        title = f"Check standard {standard}: {chart.text}"
        parts += [picture(title, chart_picture(chart)), listed("Rules", (*RULES, RATES))]
    write_whole(path, page(f"Register of panels, {today}", parts))
