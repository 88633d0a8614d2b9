"""Calibrate a screen: plan, measure, reduce, fit, verify; each step can be repeated."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack, closing
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

from pydantic import Field

from haptix.base.errors import InputError
from haptix.base.fields import (
    Address,
    Argument,
    FileOrFolder,
    FileThere,
    Folder,
    FolderName,
    FolderThere,
    Local,
    NewDocument,
    Positive,
    Seed,
    Text,
    Typed,
)
from haptix.base.report import record
from haptix.base.task import Context, Result, Task
from haptix.model.presets import FingerName, ScreenName

if TYPE_CHECKING:
    from calibration.measure.rig import RigCheck
    from calibration.measure.session import Session
    from calibration.measure.sources import ForceSource
    from calibration.steps import PlannedSession
    from haptix.model.finger import Finger
    from haptix.model.screen import Screen

INPUTS = "inputs.toml"
"""Instruments of a rig, in the folder of its calibration: a client names no files."""
_INSTALL, _LEAVE = "install it", "leave it"
_NO_NAME = '--name: expected a name of this panel alone, such as "panel 7"'

SessionFolder = Annotated[Folder, Argument]
SessionThere = Annotated[FolderThere, Argument, Field(description="Folder of the session.")]
PanelName = Annotated[Text | None, Field(description="Name of this screen alone; required.")]
Percent = Annotated[float, Field(ge=0, le=100)]


class Planned(Task):
    """Inputs of a plan of strokes."""

    protocol: Literal["paper", "full", "short"] = Field(
        "short", description="paper: its 25 strokes; full: and a frequency sweep; short."
    )
    minutes: Annotated[float, Field(gt=0, le=1000)] = Field(
        3.0, description="Time for a short one."
    )
    max_voltage_v: Positive | None = Field(
        None, description="Highest amplitude [V]. [default: the screen's limit]"
    )
    repeatability_percent: Annotated[float, Field(ge=0.1, le=20)] | None = Field(
        None,
        description="Within which strokes repeat on this rig, as in a report: strokes are added "
        "until a good screen passes in 95 % of sessions.",
    )
    finger: FingerName | None = Field(
        None,
        description="Finger: a preset (semi-wet, wet) or a TOML file. [default: finger.toml beside "
        "a calibrated screen, or semi-wet]",
    )
    screen: ScreenName = Field("3m-sct3250", description="Assumed screen: a preset or a TOML file.")

    def plan(self, name: str | None = None) -> tuple[Finger, Screen, PlannedSession]:
        """Return finger, screen, which gets a name, and the plan."""
        from calibration.steps import plan_strokes
        from haptix.model.pair import profiles

        finger, screen = profiles(self.finger, self.screen)
        repeats = self.repeatability_percent
        planned = plan_strokes(
            self.protocol,
            finger,
            screen,
            self.minutes,
            self.max_voltage_v,
            None if repeats is None else repeats / 100,
        )
        return finger, screen if name is None else screen.replace(name=name), planned


class PlanStrokes(Planned, command="calibrate plan"):
    """Write the protocol, that is which strokes to make, and print the errors to expect."""

    out: Annotated[NewDocument, Argument] = Field(description="File to write: TOML, or JSON.")

    def run(self, context: Context) -> Result:
        """Plan."""
        from calibration.fit.fitting import reported_within

        finger, screen, planned = self.plan()
        planned.protocol.save(self.out)
        power = {"minutes": planned.protocol.duration_s / 60, "chance_of_passing": planned.chance}
        rows = [
            {
                "name": name,
                "expected_spread": record(sd),
                "is_reported": sd <= reported_within(name),
                **power,
            }
            for name, sd in planned.expected_spread.items()
        ]
        if planned.past_light_contact:
            context.tell(
                step=f"{planned.past_light_contact} strokes are past the light contact of "
                f"{finger.name!r} on {screen.name!r} and will not be used: lower --max-voltage-v"
            )
        shown = [{k: v for k, v in row.items() if k not in power} for row in rows]
        return Result(rows, [(f"{self.out}: {planned.text}; expected errors", shown)])


class Columns(Task, command="calibrate columns"):
    """Show how a recording of another program was understood, and propose its column map.

    Exit code 1 if something is open: then the map is not complete.
    """

    file: Annotated[FileThere, Argument] = Field(
        description="Recording: text, LabVIEW's .lvm, or .tdms."
    )
    out: NewDocument | None = Field(None, description="Column map to write, as TOML.")

    def run(self, context: Context) -> Result:
        """Read it."""
        import numpy as np

        from calibration.measure.columns import proposed
        from haptix.base.tables import read_table

        table = read_table(self.file)
        columns, missing, assumed = proposed(table)
        means = {column.column: name for name, column in columns.columns.items()}
        rows = [
            {
                "column": name,
                "unit": table.units.get(name),
                "samples": len(values),
                "first": float(values[0]) if np.isfinite(values[0]) else None,
                "lowest": float(known.min()) if len(known) else None,
                "highest": float(known.max()) if len(known) else None,
                "taken as": means.get(name),
            }
            for name, values in table.columns.items()
            if len(values)
            for known in [values[np.isfinite(values)]]
        ]
        gaps = [
            f"{name}: {count} cells are no finite numbers"
            for name, values in table.columns.items()
            if (count := int((~np.isfinite(values)).sum()))
        ]
        lines = [*table.understood, *gaps, *assumed, *(f"open: {note}" for note in missing)]
        if self.out is not None:
            columns.save(self.out)
            lines.append(f"column map: {self.out}")
        else:
            import tomlkit

            plain = columns.model_dump(mode="json", exclude_defaults=True)
            lines += ["", *tomlkit.dumps(plain).splitlines()]
        return Result(rows, [(str(self.file), rows)], lines, failed=bool(missing))


class Measuring(Task):
    """A session, and where its forces come from."""

    folder: SessionFolder = Field(description="Folder of the session.")
    name: PanelName = None
    source: Literal["virtual", "csv", "inputs"] = Field(
        "inputs", description="Of the forces: virtual, csv or inputs."
    )
    device: Address | None = Field(
        None, description="Driver, such as usb: or mock:; by default, nothing plays."
    )
    inputs: FileThere | None = Field(None, description="For inputs: channels, as TOML.")
    csv: FileOrFolder | None = Field(
        None, description="For csv: folder of stroke-001.csv (or .lvm, .tdms) ..., or one file."
    )
    columns: FileThere | None = Field(
        None, description="For csv: column map, as TOML; `calibrate columns` proposes one."
    )
    operator: str = Field("", description="Who measures.")
    instruments: FileThere | None = Field(
        None, description="Certificates of the instruments, as TOML: an expired one is refused."
    )
    temperature_c: Annotated[float, Field(ge=-50, le=100)] | None = Field(
        None, description="Of the room."
    )
    humidity_percent: Percent | None = Field(None, description="Of the room.")
    yes: bool = Field(False, description="Do not wait before each stroke.")
    seed: Seed | None = Field(None, description="Of a virtual finger. [default: 0, or a new one]")

    @property
    def asks(self) -> bool:
        """Whether each stroke waits for the person."""
        return self.source == "inputs" and not self.yes

    def opening(self) -> Callable[[Session], ForceSource]:
        """Return the opener of the source of the forces; a wrong address is refused at once."""
        if self.source == "virtual":
            from calibration.keep.practice import virtual_source

            return lambda session: virtual_source(session, self.seed or 0)
        from calibration.measure.columns import ColumnMap
        from calibration.measure.sources import CsvSource, Inputs, open_inputs

        if self.source == "csv":
            if self.csv is None or self.columns is None:
                raise InputError("--source csv: expected --csv FOLDER and --columns MAP.toml")
            place, columns = self.csv, ColumnMap.load(self.columns)
            if place.is_dir():
                files = CsvSource(place, columns)
                return lambda session: files
            return lambda session: CsvSource(place, columns, len(session.protocol.strokes))
        inputs = self.inputs
        if inputs is None:
            raise InputError("--source inputs: expected --inputs FILE.toml, the analog channels")
        Inputs.load(inputs)
        return lambda session: open_inputs(inputs)

    def measured(self, session: Session, context: Context) -> Result:
        """Make the open strokes; where some stay open it has failed."""
        from calibration.measure.measuring import measure_guided
        from calibration.measure.recording import Conditions
        from calibration.measure.rig import today
        from calibration.measure.session import DRIVER, INSTRUMENTS, Instruments
        from firmware_io import open_device

        source = self.opening()(session)
        if self.instruments is not None:
            known = Instruments.load(self.instruments)
            known.check(source.instruments, today())
            known.save(session.folder / INSTRUMENTS)
        with ExitStack() as stack:
            device = None
            if self.device is not None:
                device = stack.enter_context(closing(open_device(self.device)))
            serial = None if device is None else device.capabilities.serial or self.device
            driver = {} if serial is None else {DRIVER: serial}
            room = Conditions(driver, self.temperature_c, self.humidity_percent, self.operator)
            most_tries = 1 if self.source == "csv" else 5
            outcome = measure_guided(session, source, device, context, self.asks, room, most_tries)
        numbers = [stroke.number for stroke in outcome.still_open]
        count = outcome.accepted + len(numbers)
        title = f"{self.folder}: {outcome.accepted} of {count} strokes on disk"
        rows = [{"accepted": outcome.accepted, "rejected": outcome.rejected, "still_open": numbers}]
        return Result(rows, [(title, rows)], failed=bool(numbers))


class Measure(Measuring, command="calibrate measure"):
    """Play the protocol stroke by stroke. A stroke with a fault is repeated, a good one is kept.

    Exit code 1 if strokes are still open at the end.
    """

    protocol: Annotated[FileThere, Typed("--plan")] | None = Field(
        None, description="Protocol. [default: that of a resumed session]"
    )
    screen: ScreenName | None = Field(
        None, description="Assumed screen: a preset or a file. [default: 3m-sct3250]"
    )
    finger: FingerName | None = Field(
        None,
        description="Finger: a preset or a file. [default: finger.toml beside a calibrated "
        "screen, or semi-wet]",
    )
    crosstalk: Annotated[float, Field(ge=-1, le=1)] = Field(
        0.0, description="Share of the normal force on the tangential axis."
    )
    resume: bool = Field(False, description="Continue a session.")
    quiet: bool = Field(False, description="Print no table.")

    def run(self, context: Context) -> Result:
        """Measure the open strokes."""
        from calibration.plan.protocol import Protocol

        plan = None if self.protocol is None else Protocol.load(self.protocol)
        if plan is None and not self.resume:
            raise InputError("--plan: expected a protocol; write one with `haptix calibrate plan`")
        self.opening()
        session = self.session(plan)
        result = self.measured(session, context)
        return replace(result, tables=()) if self.quiet and not result.failed else result

    def session(self, plan: Any) -> Session:
        """Begin a session, or open the one that is continued."""
        from calibration.keep.profile import check_name
        from calibration.measure.session import Session, SessionInfo
        from haptix.model.finger import Finger
        from haptix.model.pair import profiles
        from haptix.model.screen import Screen

        if self.resume and (plan is None or Session.has_begun(self.folder)):
            before = Session.open(self.folder)
            screen = before.info.screen if self.screen is None else Screen.named(self.screen)
            info = before.info.replace(
                screen=screen.replace(name=self.name or before.info.screen.name),
                finger=before.info.finger if self.finger is None else Finger.named(self.finger),
            )
            return Session.begin(self.folder, plan or before.protocol, info, self.resume)
        finger, screen = profiles(self.finger, self.screen)
        if self.name is None and (screen.name in Screen.presets or self.screen is None):
            raise InputError(_NO_NAME)
        screen = screen if self.name is None else screen.replace(name=self.name)
        check_name(screen)
        info = SessionInfo(
            screen=screen, finger=finger, operator=self.operator, crosstalk=self.crosstalk
        )
        return Session.begin(self.folder, plan, info)


class RunCalibration(Planned, Measuring, command="calibrate run"):
    """Check the rig, plan, measure, reduce, fit, verify. The same command again continues it.

    Exit code 1 if strokes are still open, or the verification fails.
    """

    weight_n: Positive | None = Field(
        None, description="Known weight [N]: the rig is checked before the strokes."
    )
    second_weight_n: Positive | None = Field(
        None, description="Another one, or its force at another angle, along the screen."
    )
    practice: bool = Field(False, description="On a virtual finger and screen, drawn at random.")

    def run(self, context: Context) -> Result:
        """Do all steps that are left."""
        from calibration.keep.practice import TRUTH
        from calibration.measure.measuring import GO, STOP
        from calibration.measure.rig import RIG
        from calibration.measure.session import Session
        from calibration.steps import REPORT, finish_decided, written_screen
        from haptix.model.pair import SCREEN

        if self.practice:
            virtual = {"source": "virtual", "device": self.device or "mock:"}
            virtual["name"] = self.name or "practice"
            self = self.model_copy(update=virtual)
        folder = self.folder
        self.opening()
        if not Session.has_begun(folder):
            session, planned = self.begin()
            context.tell(step=planned.text)
        elif self.practice != (folder / TRUTH).exists():
            kind = "a measured one" if self.practice else "a practice"
            raise InputError(
                f"{folder} is {kind}: choose another folder, or continue it as it began"
            )
        else:
            session = Session.open(folder)
            if self.name not in (None, "practice"):  # fields not given again are the session's
                info = session.info.replace(screen=session.info.screen.replace(name=self.name))
                Session.begin(folder, session.protocol, info, resume=True)
        if self.weight_n is not None and not (folder / RIG).exists():
            if self.inputs is None:
                raise InputError("--weight-n: expected --inputs, which read the weight")
            checked = _recorded(self.inputs, self, context)
            if faults := checked.faults():
                raise InputError(f"the rig is not right: {'; '.join(faults)}")
            checked.save(folder / RIG)
        if session.open_strokes and (measured := self.measured(session, context)).failed:
            return measured

        def go_on(session: Session, question: str) -> bool:
            if self.asks and context.ask(question, (GO, STOP)) == STOP:
                return False
            return not self.measured(session, context).failed

        # The files of strokes that nobody has made are not there.
        may_go_on = None if self.source == "csv" else go_on
        (verification, off, strokes_used, *_), was_known = finish_decided(
            folder, context, may_go_on
        )
        panel = written_screen(folder)
        document: dict[str, object] = {
            **record(verification),
            "strokes_used": strokes_used,
            "h0_m": None if panel is None else panel.h0_m,
            "screen": None if panel is None else str(folder / SCREEN),
            "report": str(folder / REPORT),
            "practice": None if off is None else record(off),
        }
        title = f"{verification.verdict}: {folder / REPORT}"
        if was_known:
            title += "; this session was finished before, and nothing is computed again"
        tables = [(title, ()), *verification.parts]
        if off is not None:
            tables.append(("how far the practice was off", [off]))
        return Result(document, tables, failed=bool(verification.failures))

    def begin(self) -> tuple[Session, PlannedSession]:
        """Plan, and begin the session; a practice draws a truth."""
        from calibration.keep.practice import draw_practice
        from calibration.keep.profile import check_name
        from calibration.measure.session import Session, SessionInfo

        if self.name is None:
            raise InputError(_NO_NAME)
        finger, screen, planned = self.plan(self.name)
        check_name(screen)
        if self.practice:
            self.folder.mkdir(parents=True, exist_ok=True)
            draw_practice(self.folder, finger, screen, planned.protocol, self.seed)
        info = SessionInfo(screen=screen, finger=finger, operator=self.operator)
        return Session.begin(self.folder, planned.protocol, info), planned


class CheckRig(Task, command="calibrate rig"):
    """Check gain, sign and unit of both forces, the sensor's bandwidth, and the volts.

    Writes rig.toml, which `fit` and `verify` use: without it a verdict is provisional. Exit code 1
    if the rig has a fault.
    """

    folder: SessionFolder = Field(description="Folder of the session, or a new one.")
    weight_n: Positive = Field(description="Force of a known weight [N]: m x 9.81.")
    inputs: FileThere | None = Field(
        None, description="Channels, as TOML: the readings are recorded."
    )
    second_weight_n: Positive | None = Field(
        None, description="Of a second weight along the screen, or of it at another angle [N]."
    )
    device: Address | None = Field(
        None, description="Driver, such as usb:, that plays for a voltmeter."
    )
    normal_reading_n: float | None = Field(
        None, description="Without --inputs: the weight on the screen, less zero."
    )
    tangential_reading_n: float | None = Field(
        None, description="The weight that pulls towards growing x, less zero."
    )
    second_tangential_reading_n: float | None = Field(
        None, description="The second weight that pulls likewise, less zero."
    )
    monitor_v: tuple[Positive, ...] = Field(
        (), description="Amplitude that the recordings show or the driver plays; may be repeated."
    )
    voltmeter_rms_v: tuple[Positive, ...] = Field(
        (),
        description="On the screen by another instrument, V rms as a multimeter shows, for each "
        "--monitor-v.",
    )
    monitor_hz: tuple[Positive, ...] = Field(
        (), description="Frequency of each --monitor-v. [default: one gain for all]"
    )
    tap: FileThere | None = Field(
        None, description="CSV file of a tap: columns t_s, tangential_force_n."
    )

    def run(self, context: Context) -> Result:
        """Check it."""
        from calibration.measure.rig import RIG

        checked = self.stated() if self.inputs is None else _recorded(self.inputs, self, context)
        self.folder.mkdir(parents=True, exist_ok=True)
        checked.save(self.folder / RIG)
        names = (
            "normal_gain", "tangential_gain", "second_tangential_gain", "voltage_gain",
            "volts", "pole_hz", "resonance_hz", "quality",
        )  # fmt: skip
        faults = checked.faults()
        for fault in faults:
            context.tell(step=fault)
        rows = [record(checked, names)]
        return Result(rows, [(str(self.folder / RIG), rows)], failed=bool(faults))

    def stated(self) -> RigCheck:
        """Check a rig by readings that a person has written down."""
        from calibration.measure.rig import RigCheck, VoltsRead, amplitude_gain, tap_response, today
        from haptix.base.files import read_csv

        names = "normal_reading_n", "tangential_reading_n", "monitor_v", "voltmeter_rms_v"
        readings = {name: getattr(self, name) for name in names}
        if missing := [name for name, reading in readings.items() if reading in (None, ())]:
            options = ", ".join(f"--{name.replace('_', '-')}" for name in missing)
            raise InputError(f"expected --inputs, or {options} as well")
        pairs = self.monitor_v, self.voltmeter_rms_v, self.monitor_hz or self.monitor_v
        if len({len(pair) for pair in pairs}) > 1 or (
            len(self.monitor_v) > 1 > len(self.monitor_hz)
        ):
            raise InputError(
                "--monitor-v, --voltmeter-rms-v, --monitor-hz: expected as many of each, got "
                f"{len(self.monitor_v)}, {len(self.voltmeter_rms_v)} and {len(self.monitor_hz)}"
            )
        twice = self.second_tangential_reading_n, self.second_weight_n
        if (twice[0] is None) != (twice[1] is None):
            raise InputError("expected --second-weight-n and --second-tangential-reading-n")
        second = None if twice[0] is None or twice[1] is None else twice[0] / twice[1]
        normal, tangential = self.normal_reading_n, self.tangential_reading_n
        assert normal is not None and tangential is not None  # none is missing
        gains = [amplitude_gain(read, shown) for shown, read in zip(*pairs[:2], strict=True)]
        volts = [
            VoltsRead(frequency_hz=hertz, monitor_v=shown, gain=gain)
            for hertz, shown, gain in zip(self.monitor_hz, self.monitor_v, gains, strict=False)
        ]
        bandwidth: dict[str, float] = {}
        if self.tap is not None:
            import numpy as np

            columns = ["t_s", "tangential_force_n"]
            lines = read_csv(self.tap, columns)
            try:
                samples = [[float(line.cells[name]) for name in columns] for line in lines]
            except ValueError as error:
                raise InputError(f"{self.tap}: expected numbers, got {error}") from None
            bandwidth = tap_response(*np.array(samples).T)._asdict()
        return RigCheck(
            normal_gain=normal / self.weight_n,
            tangential_gain=tangential / self.weight_n,
            second_tangential_gain=second,
            voltage_gain=None if volts else gains[0],
            volts=tuple(volts),
            **bandwidth,
            instruments=(f"weight: {self.weight_n:g} N", "voltmeter"),
            measured_on=today(),
        )


class CalibrationJob(
    Task, route="calibrations", kind="calibration", plays=True, keeps="calibrations"
):
    """Measure a screen stroke by stroke, and verify; each stroke asks."""

    stages: ClassVar[tuple[str, ...]] = ("measure", "fit", "verify")

    name: FolderName = Field(
        "practice",
        description="A calibration that was planned on this machine under this name is continued; "
        "another name begins a practice with a virtual finger.",
    )
    minutes: Annotated[float, Field(ge=2, le=60)] = Field(3.0, title="Minutes of a practice")
    finger: Annotated[FingerName, Local()] = "semi-wet"
    screen: Annotated[ScreenName, Local()] = "3m-sct3250"
    device: Address = "mock:"

    def run(self, context: Context) -> Result:
        """Measure the open strokes, verify, and install; a stopped session is continued.

        A practice plays on a mock, and is installed for that alone.
        """
        from calibration.keep.practice import TRUTH, virtual_source
        from calibration.measure.measuring import GO, STOP, measure_guided
        from calibration.measure.session import Session
        from calibration.measure.sources import open_inputs
        from calibration.steps import finish_decided, written_screen
        from haptix.model.pair import FINGER, SCREEN
        from haptix.play.devices import install_profile, open_device

        assert context.folder is not None
        folder = context.folder / self.name
        if not Session.has_begun(folder):
            profiles: dict[str, Any] = {
                "finger": self.finger,
                "screen": self.screen,
                "minutes": self.minutes,
            }
            RunCalibration(folder=folder, name=self.name, practice=True, **profiles).begin()
        session, inputs = Session.open(folder), folder / INPUTS
        practises = (folder / TRUTH).exists()
        if not practises and not inputs.exists():
            raise InputError(
                f"{self.name}: expected {INPUTS} in its folder, with the rig's instruments"
            )

        def measured(session: Session, question: str = "") -> bool:
            if question and context.ask(question, (GO, STOP)) == STOP:
                return False
            context.tell(step="measure")
            with closing(open_device("mock:" if practises else self.device)) as device:
                source = virtual_source(session) if practises else open_inputs(inputs)
                drivers.append((device.capabilities.serial, device.mock is not None))
                return not measure_guided(session, source, device, context).still_open

        drivers: list[tuple[str, bool]] = []
        measured(session)
        serial, is_mock = drivers[-1]
        numbers = [stroke.number for stroke in session.open_strokes]
        result: dict[str, Any] = {"name": self.name, "still_open": numbers, "verdict": None}
        if numbers:
            return Result(result)
        (verification, off, strokes_used, *_), _ = finish_decided(folder, context, measured)
        screen = written_screen(folder)
        result |= {
            "verdict": verification.verdict,
            "failures": list(verification.failures),
            "untested": list(verification.untested),
            "worst_jnd": verification.worst_jnd,
            "strokes_used": strokes_used,
            "h0_nm": None if screen is None else 1e9 * screen.h0_m,
            "installed_for": None,
        }
        if off is not None:
            plain = record(off)
            names = ("h0_error", "friction_error_median_jnd", "friction_error_worst_jnd")
            result["practice"] = {"true_h0_nm": 1e9 * off.true_h0_m}
            result["practice"] |= {name: plain[name] for name in names}
        if screen is not None and not screen.warnings() and serial:
            context.tell(step="install")
            prompt = (
                f"The calibration of {self.name} passed. Install its profile for driver {serial}?"
            )
            if context.ask(prompt, (_INSTALL, _LEAVE)) == _INSTALL:
                install_profile(serial, folder / SCREEN, folder / FINGER, is_mock)
                result["installed_for"] = serial
        return Result(result)


def _recorded(inputs: Path, task: RunCalibration | CheckRig, context: Context) -> RigCheck:
    """Check a rig with its own instruments, a person and a weight."""
    from calibration.measure.rig import measure_rig
    from calibration.measure.sources import open_inputs
    from firmware_io import open_device

    with ExitStack() as stack:
        driver = None
        if task.device is not None:
            driver = stack.enter_context(closing(open_device(task.device)))
        assert task.weight_n is not None
        second_n = task.second_weight_n
        return measure_rig(open_inputs(inputs), task.weight_n, context.ask, driver,
                           second_weight_n=second_n)  # fmt: skip
