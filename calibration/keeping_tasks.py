"""Tasks over days and panels: batches, certificates, instruments, standards, the register."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from datetime import UTC, date, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from pydantic import Field

from calibration.tasks import RunCalibration, SessionFolder, SessionThere
from haptix.base.errors import InputError
from haptix.base.fields import (
    Argument,
    FileOrFolder,
    FileThere,
    FolderThere,
    NewFile,
    Positive,
    Text,
)
from haptix.base.report import record
from haptix.base.task import Context, Result, Task
from haptix.model.presets import FingerName

if TYPE_CHECKING:
    from calibration.keep.gauge import GaugeStudy

RegisterFile = Annotated[NewFile, Argument, Field(description="The register: a JSON file.")]


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
        from calibration.measure.session import Instruments

        known, today = Instruments.load(self.file), _today()
        faults = {instrument: instrument.fault(today) for instrument in known.instruments}
        if self.session is not None:
            from calibration.measure.session import Session

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
    about: FileThere | None = Field(
        None,
        description="Laboratory, customer, serial number and condition of the panel, place, agreed "
        "due date, template, as TOML. [default: certificate.toml in the session's folder]",
    )

    def run(self, context: Context) -> Result:
        """Write it."""
        from calibration.fit.result import Fit
        from calibration.keep.session_report import CERTIFICATE, CertificateText, write_certificate
        from calibration.measure.session import INSTRUMENTS, Instruments, Session
        from calibration.steps import FIT, Finished, rig_check, verify_folder, written_screen
        from haptix.model.finger import Finger
        from haptix.model.pair import FINGER

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
        path, about = self.folder / CERTIFICATE, self.about or self.folder / "certificate.toml"
        text = CertificateText()
        if about.exists():
            text = CertificateText.load(about)
            if text.template is not None:
                text = text.replace(template=about.parent / text.template)
        number = write_certificate(
            path, screen, Finger.load(self.folder / FINGER), Fit.load(self.folder / FIT),
            verification, Session.open(self.folder).recordings, Instruments.load(file),
            rig_check(self.folder), text,
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
        from calibration.register import Panel, Register, update_register, write_register_page

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
        rows = [
            {**panel.model_dump(mode="json", exclude={"strokes"}), "due": panel.due(today)}
            for panel in kept.panels
        ]
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
        """Run the remaining panels."""
        from filelock import FileLock, Timeout

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
        from calibration.register import Panel, update_register

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
        from calibration.keep.profile import check_profile
        from calibration.measure.session import Session
        from calibration.plan.predict import StrokePredictor
        from calibration.register import Register, StandardReading, update_register
        from calibration.steps import reduce_folder
        from haptix.model.friction import ContactModel
        from haptix.model.pair import profiles

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
    """Find the shares of panels, operators and days in the variance of the measured values.

    Analysis of variance of sessions, or of a CSV file whose last column is the value and whose
    other columns are factors: the panel first, then such as operator and day. Every panel by every
    operator on every day, as often. The value of a session is ln mu(0) at 0.5 N and 50 mm/s over
    0.11, in JND. ndc is how many kinds of panels are told apart; the verdict is that of AIAG.
    """

    sources: Annotated[tuple[FileOrFolder, ...], Field(min_length=1), Argument] = Field(
        description="Folders of sessions, or one CSV file."
    )
    tolerance: Positive | None = Field(
        None, description="On either side, in the value's unit. [default: 0.5 JND of sessions]"
    )

    def run(self, context: Context) -> Result:
        """Analyse it."""
        from calibration.verify.steadiness import TOLERANCE_JND

        is_table = self.sources[0].is_file()
        rows = _of_table(self.sources) if is_table else _of_sessions(self.sources)
        study, title = self.study(*rows), ""
        document = {
            "components": record(study.components),
            **{
                name: getattr(study, name)
                for name in ("reproducibility", "gauge", "distinct_categories")
            },
        }
        tolerance = self.tolerance or (None if is_table else TOLERANCE_JND)
        if tolerance is not None:
            share, verdict = study.share_of_tolerance(tolerance), study.verdict(tolerance)
            document |= {"share_of_tolerance": share, "verdict": verdict}
            title = f"; {share:.0%} of the tolerance of {tolerance:g}: {verdict}"
        title = f"{study.text}; ndc {study.distinct_categories}{title}"
        return Result(document, [(title, study.components)])

    def study(
        self, factors: Sequence[str], cells: Mapping[tuple[str, ...], Sequence[float]]
    ) -> GaugeStudy:
        """Analyse the values of each combination of the factors' levels."""
        import numpy as np

        from calibration.keep.gauge import GaugeStudy

        levels = [sorted({key[at] for key in cells}) for at in range(len(factors))]
        trials = {len(cell) for cell in cells.values()}
        if len(trials) > 1 or len(cells) != np.prod([len(level) for level in levels]):
            raise InputError(
                f"{self.sources[0]}: expected every {' with every '.join(factors)}, as often; "
                f"got {len(cells)} combinations with {', '.join(map(str, sorted(trials)))} values"
            )
        values = np.array([cells[key] for key in sorted(cells)])
        return GaugeStudy.of(values.reshape(*map(len, levels), -1), factors)


Cells = dict[tuple[str, ...], list[float]]


def _of_table(sources: Sequence[Path]) -> tuple[list[str], Cells]:
    """Factors of a CSV file, and the values of each combination of their levels, in any order."""
    from haptix.base.files import read_csv

    (table, *others) = sources
    lines = list(read_csv(table, []))
    names = list(lines[0].cells) if lines else []
    if len(names) < 3 or others:
        raise InputError(f"{table}: expected one file, with two factors or more, and a value")
    *factors, value = names
    cells: Cells = {}
    for line in lines:
        try:
            number = float(line.cells[value])
        except ValueError:
            raise InputError(
                f"{table}: expected a number in {value}, got {line.cells[value]!r}"
            ) from None
        cells.setdefault(tuple(line.cells[name] for name in factors), []).append(number)
    return factors, cells


def _of_sessions(sources: Sequence[Path]) -> tuple[list[str], Cells]:
    """Panel, and operator and day where there are several; ln mu(0) of each session in JND."""
    import numpy as np

    from calibration.measure.session import Session
    from calibration.plan.predict import StrokeConditions, StrokePredictor
    from calibration.plan.protocol import FREQUENCY_HZ
    from calibration.steps import profile_model, written_screen
    from calibration.verify.budget import FORCE_N, SPEED_MM_PER_S
    from haptix.model.perception.thresholds import WEBER_FRACTION

    found = []
    for folder in sources:
        screen, info = written_screen(folder), Session.open(folder).info
        if screen is None or screen.calibration is None:
            raise InputError(f"{folder}: expected a session that is verified; it has no profile")
        at = [np.array([one]) for one in (FORCE_N, 0.0, FREQUENCY_HZ, SPEED_MM_PER_S)]
        seen = StrokePredictor(profile_model(folder)).by_profiles(StrokeConditions(*at))
        place = screen.name, info.operator or "not named", str(screen.calibration.date)
        found.append((place, float(seen.log_mu[0]) / WEBER_FRACTION))
    kept = [k for k in range(3) if k == 0 or len({place[k] for place, _ in found}) > 1]
    cells: Cells = {}
    for place, value in found:
        cells.setdefault(tuple(place[k] for k in kept), []).append(value)
    return [("panel", "operator", "day")[k] for k in kept], cells


def _today() -> date:
    return datetime.now(UTC).date()
