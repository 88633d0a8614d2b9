"""Tasks over days and panels: batches, certificates, instruments, standards, the register."""

from __future__ import annotations

import re
from collections.abc import Callable
from datetime import UTC, date, datetime, timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from filelock import FileLock, Timeout
from pydantic import Field

from calibration.tasks import RunCalibration, SessionFolder, SessionThere
from haptix.desk import Context, Result, Task
from haptix.documents import Document, Part
from haptix.errors import InputError
from haptix.fields import Argument, FileThere, FingerName, FolderThere, NewFile, Text
from haptix.report import Heading, record

if TYPE_CHECKING:
    from calibration.gauge import ControlChart, GaugeStudy

RegisterFile = Annotated[NewFile, Argument, Field(description="The register: a JSON file.")]

_LOCK_S = 20.0
SOON_DAYS = 30
"""Before its due date a panel counts as due soon."""

State = Literal["open", "measured", "passed", "provisional", "failed"]


class Panel(Part):
    """The latest calibration of one panel.

    Parameters
    ----------
    panel, session : str
        Its name, and the folder of its session.
    state : {"open", "measured", "passed", "provisional", "failed"}
        "open" with strokes still to be made, "measured" where they are not yet verified.
    open_strokes : int
        How many strokes are still to be made.
    operator, calibration_id : str
        Who measured, and the start of the profile's hash.
    measured_on, due_on : datetime.date or None
        Day of the strokes, and that from which the calibration is old.
    h0_m : float or None
        d1/eps1 [m].
    """

    panel: Annotated[str, Heading("panel")]
    session: Annotated[str, Heading("session")]
    state: Annotated[State, Heading("state")]
    open_strokes: Annotated[int, Heading("open strokes")] = 0
    operator: Annotated[str, Heading("operator")] = ""
    calibration_id: Annotated[str, Heading("calibration")] = ""
    measured_on: Annotated[date | None, Heading("measured on")] = None
    due_on: Annotated[date | None, Heading("due on")] = None
    h0_m: Annotated[float | None, Heading("d1/eps1 [m]", ".4g")] = None

    @classmethod
    def of(cls, folder: Path) -> Panel:
        """Read the state of a session's folder."""
        from calibration.session import Session
        from calibration.steps import Finished, written_screen
        from haptix.screen import CALIBRATION_VALID_DAYS

        session = Session.open(folder)
        name, still_open = session.info.screen.name, len(session.open_strokes)
        place = str(folder.resolve())
        screen, known = written_screen(folder), Finished.load(folder)
        if still_open or screen is None or screen.calibration is None:
            state: State = "open" if still_open else "measured"
            if known is not None and known.verification.failures:
                state = "failed"
            return cls(panel=name, session=place, state=state, open_strokes=still_open,
                       operator=session.info.operator)  # fmt: skip
        made = screen.calibration
        return cls(
            panel=name, session=place, state=made.verdict, operator=made.operator,
            calibration_id=screen.calibration_id, measured_on=made.date,
            due_on=made.date + timedelta(days=CALIBRATION_VALID_DAYS), h0_m=screen.h0_m,
        )  # fmt: skip

    def due(self, today: date) -> str:
        """Say when it is to be measured again."""
        if self.due_on is None:
            return "not calibrated"
        days = (self.due_on - today).days
        if days < 0:
            return f"overdue for {-days} days"
        return f"due in {days} days" if days <= SOON_DAYS else "not due"


class StandardReading(Part):
    """One measurement of a check standard.

    Parameters
    ----------
    standard : str
        Name of the panel that is kept for it.
    measured_on : datetime.date
        Day of the strokes.
    operator : str
        Who measured.
    change_jnd : float
        Mean of measured minus predicted friction [JND].
    """

    standard: Annotated[str, Heading("standard")]
    measured_on: Annotated[date, Heading("measured on")]
    operator: Annotated[str, Heading("operator")] = ""
    change_jnd: Annotated[float, Heading("change [JND]", "+.3f")]


class Register(Document):
    """All panels, their state and due dates, and the readings of the check standard of each rig.

    One file for any number of rigs: a lock lets one write at a time, and a write is whole or not at
    all. A damaged register is never written over.
    """

    written_on: date
    panels: tuple[Panel, ...] = ()
    readings: tuple[StandardReading, ...] = ()

    def with_panel(self, panel: Panel) -> Register:
        """Return a register with this state of a panel in place of the one before."""
        others = [other for other in self.panels if other.panel != panel.panel]
        return self.replace(panels=(*others, panel))

    def chart(self, standard: str) -> ControlChart:
        """Chart the readings of a check standard, in order of time."""
        from calibration.gauge import ControlChart

        of_it = [reading for reading in self.readings if reading.standard == standard]
        ordered = sorted(of_it, key=lambda reading: reading.measured_on)
        return ControlChart.of([reading.change_jnd for reading in ordered])


def update_register(path: Path, today: date, change: Callable[[Register], Register]) -> Register:
    """Read a register, change it and write it, while no other rig may.

    Raises
    ------
    InputError
        If another rig holds it for too long, or the clock was set back.
    FileFormatError
        If it is damaged: it stays as it is.
    """
    if path.exists():
        Register.load(path)  # what is none gets no lock beside it
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with FileLock(f"{path}.lock", timeout=_LOCK_S):
            before = Register.load(path) if path.exists() else Register(written_on=today)
            if today < before.written_on:
                raise InputError(
                    f"{path} was written on {before.written_on}, and the clock says {today}: set "
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
    from calibration.session_report import chart_picture
    from haptix.files import write_whole
    from haptix.report import page, part, picture

    rows = [
        {"panel": panel.panel, "state": panel.state, "open strokes": panel.open_strokes,
         "due": panel.due(today), "due on": panel.due_on, "measured on": panel.measured_on,
         "operator": panel.operator, "calibration": panel.calibration_id, "session": panel.session}
        for panel in sorted(register.panels, key=lambda p: (p.due_on or date.min, p.panel))
    ]  # fmt: skip
    parts = [part("Panels", rows)]
    for standard in sorted({reading.standard for reading in register.readings}):
        chart = register.chart(standard)
        title = f"Check standard {standard}: {chart.text}"
        parts.append(picture(title, chart_picture(chart)))
    write_whole(path, page(f"Register of panels, {today}", parts))


class CheckInstruments(Task, command="calibrate instruments"):
    """Check the dates of the instruments in a file, and of those that a session used.

    Exit code 1 if a certificate has expired, or an instrument has none.
    """

    file: Annotated[FileThere, Argument] = Field(
        description="instruments.toml: name, serial, certificate, calibrated_on, due_on of each."
    )
    session: FolderThere | None = Field(
        None, description="Session whose strokes are checked, each on its day."
    )

    def run(self, context: Context) -> Result:
        """Check them."""
        from calibration.session import Instruments

        known, today = Instruments.load(self.file), _today()
        faults = {instrument: instrument.fault(today) for instrument in known.instruments}
        if self.session is not None:
            from calibration.session import Session

            known.check_strokes(Session.open(self.session).recordings)
        rows = [{**record(one), "holds": not fault, "remarks": fault}
                for one, fault in faults.items()]  # fmt: skip
        for row in rows:
            row.update(calibrated_on=str(row["calibrated_on"]), due_on=str(row["due_on"]))
        expired = [fault for fault in faults.values() if fault]
        title = f"{self.file}: {'; '.join(expired) or 'all certificates hold'}"
        return Result(rows, [(title, rows)], failed=bool(expired))


class Certify(Task, command="calibrate certificate"):
    """Write the certificate of a session that passed, as a PDF beside its report.

    A session that `run` did not verify is verified first. It is refused if the verification failed,
    or if an instrument had no certificate on the day of a stroke.
    """

    folder: SessionThere
    instruments: FileThere | None = Field(
        None, description="Instruments. [default: instruments.toml in the session's folder]"
    )

    def run(self, context: Context) -> Result:
        """Write it."""
        from calibration.fit import Fit
        from calibration.session import INSTRUMENTS, Instruments, Session
        from calibration.session_report import CERTIFICATE, write_certificate
        from calibration.steps import FIT, Finished, rig_check, verify_folder, written_screen
        from haptix.finger import Finger
        from haptix.pair import FINGER

        file = self.instruments or self.folder / INSTRUMENTS
        if not file.exists():
            raise InputError(
                f"expected --instruments, or {file}: name, serial, certificate, calibrated_on and "
                "due_on of each instrument"
            )
        known = Finished.load(self.folder)
        verification = known.verification if known else verify_folder(self.folder)[0]
        screen = written_screen(self.folder)
        if screen is None:
            raise InputError(f"{self.folder}: no profile: {'; '.join(verification.failures)}")
        path = self.folder / CERTIFICATE
        number = write_certificate(
            path, screen, Finger.load(self.folder / FINGER), Fit.load(self.folder / FIT),
            verification, Session.open(self.folder).recordings, Instruments.load(file),
            rig_check(self.folder),
        )  # fmt: skip
        rows = [{"number": number, "certificate": str(path), "verdict": verification.verdict}]
        return Result(rows, [(str(path), rows)])


class KeepRegister(Task, command="calibrate register"):
    """Keep the register of all panels: enter sessions, print states and due dates, write a page.

    Several rigs may use one register at the same time. Exit code 1 if a panel is overdue or failed.
    """

    register_file: RegisterFile
    sessions: Annotated[tuple[FolderThere, ...], Argument] = Field(
        (), description="Folders of sessions whose state is entered."
    )
    page: NewFile | None = Field(None, description="HTML page to write.")

    def run(self, context: Context) -> Result:
        """Enter, print and write."""
        today, entered = _today(), [Panel.of(folder) for folder in self.sessions]

        def with_all(register: Register) -> Register:
            for panel in entered:
                register = register.with_panel(panel)
            return register

        if not entered and not self.register_file.exists():
            raise InputError(f"{self.register_file}: expected a register, or sessions to enter")
        kept = update_register(self.register_file, today, with_all)
        if self.page is not None:
            write_register_page(self.page, kept, today)
        rows = [{**panel.model_dump(mode="json"), "due": panel.due(today)} for panel in kept.panels]
        late = [
            panel
            for panel in kept.panels
            if panel.state == "failed" or "overdue" in panel.due(today)
        ]
        shown = ("panel", "state", "open_strokes", "due", "measured_on", "operator", "session")
        table = [{name.replace("_", " "): row[name] for name in shown} for row in rows]
        title = f"{self.register_file}: {len(rows)} panels, {len(late)} overdue or failed"
        return Result(rows, [(title, table)], failed=bool(late))


class RunBatch(RunCalibration, command="calibrate batch"):
    """Run panel after panel, each in a folder of its own. The same command again continues.

    Finished panels are not computed again, and a panel that another rig measures is skipped. Exit
    code 1 if one failed, or strokes are still open.
    """

    folder: SessionFolder = Field(description="Folder of the sessions: one each.")
    panel: Annotated[tuple[Text, ...], Field(min_length=1)] = Field(
        description="Name of a panel; may be repeated."
    )
    register_file: NewFile | None = Field(
        None, description="The register into which the state of each is entered: a JSON file."
    )

    def run(self, context: Context) -> Result:
        """Run what is left."""
        if self.name is not None:
            raise InputError("--name: expected --panel NAME for each panel")
        folders = {name: self.folder / re.sub(r"[^\w.-]+", "-", name) for name in self.panel}
        if len({str(folder).casefold() for folder in folders.values()}) < len(self.panel):
            raise InputError(f"--panel: expected names that differ, got {', '.join(self.panel)}")
        self.folder.mkdir(parents=True, exist_ok=True)
        rows: list[dict[str, object]] = []
        for name, folder in folders.items():
            context.tell(step=f"panel {name}")
            try:
                with FileLock(f"{folder}.lock", timeout=0):
                    rows.append(self._one(name, folder, context))
            except Timeout:
                rows.append({"panel": name, "state": "measured by another rig", "open_strokes": 0})
            if rows[-1]["open_strokes"]:
                break  # the person has stopped, or a stroke cannot be made
        left = len(folders) - len(rows)
        failed = left > 0 or any(row["open_strokes"] or row["state"] == "failed" for row in rows)
        title = f"{self.folder}: {len(rows)} of {len(folders)} panels"
        return Result(rows, [(title, rows)], failed=failed)

    def _one(self, name: str, folder: Path, context: Context) -> dict[str, object]:
        fields = {field: getattr(self, field) for field in RunCalibration.model_fields}
        RunCalibration(**{**fields, "folder": folder, "name": name}).run(context)
        panel = Panel.of(folder)
        if self.register_file is not None:
            update_register(self.register_file, _today(), lambda kept: kept.with_panel(panel))
        return panel.model_dump(mode="json", include={"panel", "state", "open_strokes", "session"})


class ChartStandard(Task, command="calibrate standard"):
    """Enter strokes on a check standard into the register, and chart them over days.

    The standard is a panel that is kept, with a profile of its own. Exit code 1 where the chart
    says to stop and look.
    """

    register_file: RegisterFile
    folder: SessionThere
    profile: FileThere = Field(description="screen.toml of the standard.")
    finger: FingerName | None = Field(
        None, description="Finger: a preset or a file. [default: finger.toml beside the profile]"
    )

    def run(self, context: Context) -> Result:
        """Enter and chart."""
        from calibration.predict import StrokePredictor
        from calibration.profile import check_profile
        from calibration.session import Session
        from calibration.steps import reduce_folder
        from haptix.friction import ContactModel
        from haptix.pair import profiles

        finger, screen = profiles(self.finger, str(self.profile))
        checked = check_profile(
            reduce_folder(self.folder), StrokePredictor(ContactModel(finger, screen))
        )
        session = Session.open(self.folder)
        days = [recording.conditions.started[:10] for recording in session.recordings]
        reading = StandardReading(
            standard=screen.name, measured_on=date.fromisoformat(min(days)),
            operator=session.info.operator, change_jnd=checked.drifts["all"].mean_jnd,
        )  # fmt: skip

        def with_reading(register: Register) -> Register:
            if reading in register.readings:
                return register
            return register.replace(readings=(*register.readings, reading))

        kept = update_register(self.register_file, _today(), with_reading)
        chart = kept.chart(screen.name)
        of_it = [reading for reading in kept.readings if reading.standard == screen.name]
        document = {**record(chart), "standard": screen.name}
        return Result(
            document, [(f"{screen.name}: {chart.text}", of_it)], failed=bool(chart.findings)
        )


class StudyGauge(Task, command="calibrate gauge"):
    """Find how much of what was measured is the panels', and how much the operators' and the days'.

    Analysis of variance of a CSV file whose last column is the value and whose other columns are
    factors: the panel first, then such as operator and day. Every panel by every operator on every
    day, as often.
    """

    table: Annotated[FileThere, Argument] = Field(description="CSV file.")

    def run(self, context: Context) -> Result:
        """Analyse it."""
        study = self.study()
        document = {
            "components": record(study.components),
            **{name: getattr(study, name) for name in ("reproducibility", "gauge")},
        }
        return Result(document, [(study.text, study.components)])

    def study(self) -> GaugeStudy:
        """Read the table, in any order of its rows."""
        import numpy as np

        from calibration.gauge import GaugeStudy
        from haptix.files import read_csv

        lines = list(read_csv(self.table, []))
        names = list(lines[0].cells) if lines else []
        if len(names) < 3:
            raise InputError(f"{self.table}: expected two factors or more, and a value")
        *factors, value = names
        cells: dict[tuple[str, ...], list[float]] = {}
        for line in lines:
            try:
                number = float(line.cells[value])
            except ValueError:
                raise InputError(
                    f"{self.table}: expected a number in {value}, got {line.cells[value]!r}"
                ) from None
            cells.setdefault(tuple(line.cells[name] for name in factors), []).append(number)
        levels = [sorted({key[at] for key in cells}) for at in range(len(factors))]
        trials = {len(cell) for cell in cells.values()}
        if len(trials) > 1 or len(cells) != np.prod([len(level) for level in levels]):
            raise InputError(
                f"{self.table}: expected every {' with every '.join(factors)}, as often; "
                f"got {len(cells)} combinations with {', '.join(map(str, sorted(trials)))} values"
            )
        values = np.array([cells[key] for key in sorted(cells)])
        return GaugeStudy.of(values.reshape(*map(len, levels), -1), factors)


def _today() -> date:
    return datetime.now(UTC).date()
