"""``haptix calibrate`` and ``python -m calibration``: the commands, in the order of their use."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer
from pydantic import Field

from calibration.result_commands import (
    check,
    fit,
    install,
    match,
    period,
    reduce,
    show_parts,
    verify,
)
from haptix import fields, terminal
from haptix.desk import argument, option
from haptix.errors import InputError
from haptix.fields import (
    Address,
    FileThere,
    FingerName,
    NewFile,
    NotNegative,
    Positive,
    ScreenName,
    Text,
)
from haptix.files import json_text
from haptix.report import record
from haptix.terminal import AsJson, show

if TYPE_CHECKING:
    from calibration.rig import RigCheck
    from calibration.session import Session
    from calibration.sources import ForceSource

# Options that several commands have.
Folder = Annotated[Path, argument("Folder of the session.", fields.Folder)]
FingerOption = Annotated[
    str, option("Finger: a preset (semi-wet, wet) or a TOML file.", FingerName)
]
ScreenOption = Annotated[str, option("Assumed screen: a preset or a TOML file.", ScreenName)]
PanelName = Annotated[str | None, option("Name of this screen alone; required.", Text)]
Csv = Annotated[Path | None, option("For csv: folder of stroke-001.csv ...", fields.Folder)]
Columns = Annotated[Path | None, option("For csv: column map, as TOML.", FileThere)]
Inputs = Annotated[Path | None, option("For inputs: channels, as TOML.", FileThere)]
Minutes = Annotated[float, option("Time for a short one.", float, gt=0, le=1000)]
Operator = Annotated[str, typer.Option(help="Who measures.")]
NoPrompts = Annotated[bool, typer.Option("--yes", help="Do not wait before each stroke.")]
Source = Annotated[
    str, option("Of the forces: virtual, csv or inputs.", Literal["virtual", "csv", "inputs"])
]
_Protocol = Literal["paper", "full", "short"]
_Seed = Annotated[int, Field(ge=0, le=2**63 - 1)]


def plan(
    out: Annotated[Path, argument("File to write: TOML, or JSON.", NewFile)],
    protocol: Annotated[
        str, option("paper: its 25 strokes; full: and a frequency sweep; short.", _Protocol)
    ] = "short",
    minutes: Minutes = 3.0,
    max_voltage_v: Annotated[
        float | None, option("Highest amplitude [V]. [default: the screen's limit]", Positive)
    ] = None,
    finger: FingerOption = "semi-wet",
    screen: ScreenOption = "3m-sct3250",
    as_json: AsJson = False,
) -> None:
    """Write the protocol, that is which strokes to make, and print the errors to expect."""
    from calibration.fitting import reported_within
    from calibration.steps import plan_strokes
    from haptix.finger import Finger
    from haptix.screen import Screen

    own_finger, own_screen = Finger.named(finger), Screen.named(screen)
    planned = plan_strokes(protocol, own_finger, own_screen, minutes, max_voltage_v)
    planned.protocol.save(out)
    title = (
        f"{out}: {planned.protocol.name}, {len(planned.protocol.strokes)} strokes, some "
        f"{planned.protocol.duration_s / 60:.1f} minutes; expected errors"
    )
    rows: list[dict[str, object]] = [
        {"name": name, "expected_spread": record(sd), "is_reported": sd <= reported_within(name)}
        for name, sd in planned.expected_spread.items()
    ]
    show(title, rows, as_json)
    if planned.past_light_contact:
        sys.stderr.write(
            f"{planned.past_light_contact} strokes are past the light contact of "
            f"{own_finger.name!r} on {own_screen.name!r} and will not be used: lower "
            "--max-voltage-v\n"
        )


def measure(
    folder: Folder,
    protocol: Annotated[
        Path | None, option("Protocol. [default: that of a resumed session]", FileThere, "--plan")
    ] = None,
    source: Source = "inputs",
    device: Annotated[
        str | None, option("Driver, such as usb: or mock:; by default, nothing plays.", Address)
    ] = None,
    screen: Annotated[
        str | None, option("Assumed screen: a preset or a file. [default: 3m-sct3250]", ScreenName)
    ] = None,
    name: PanelName = None,
    finger: Annotated[
        str | None, option("Finger: a preset or a file. [default: semi-wet]", FingerName)
    ] = None,
    operator: Operator = "",
    csv: Csv = None,
    columns: Columns = None,
    inputs: Inputs = None,
    crosstalk: Annotated[
        float, option("Share of the normal force on the tangential axis.", float, ge=-1, le=1)
    ] = 0.0,
    temperature_c: Annotated[float | None, option("Of the room.", float, ge=-50, le=100)] = None,
    humidity_percent: Annotated[float | None, option("Of the room.", float, ge=0, le=100)] = None,
    resume: Annotated[bool, typer.Option("--resume", help="Continue a session.")] = False,
    yes: NoPrompts = False,
    seed: Annotated[int, option("Of the virtual finger.", _Seed)] = 0,
    as_json: AsJson = False,
    quiet: Annotated[bool, typer.Option("--quiet", help="Print no table.")] = False,
) -> None:
    """Play the protocol stroke by stroke. A stroke with a fault is repeated, a good one is kept.

    Exit code 1 if strokes are still open at the end.
    """
    from contextlib import ExitStack, closing

    from calibration.measuring import measure as measure_session
    from calibration.measuring import terminal_watcher
    from calibration.profile import check_name
    from calibration.protocol import Protocol
    from calibration.recording import Conditions
    from calibration.session import Session, SessionInfo
    from firmware_io import open_device
    from haptix.finger import Finger
    from haptix.screen import Screen

    plan = None if protocol is None else Protocol.load(protocol)
    if plan is None and not resume:
        raise InputError("--plan: expected a protocol; write one with `haptix calibrate plan`")
    open_source = _source_of(source, csv, columns, inputs, seed)
    if resume and (plan is None or (folder / "session.json").exists()):
        before = Session.open(folder)
        own_screen = before.info.screen if screen is None else Screen.named(screen)
        info = before.info.replace(
            screen=own_screen.replace(name=before.info.screen.name if name is None else name),
            finger=before.info.finger if finger is None else Finger.named(finger),
        )
        session = Session.begin(folder, plan or before.protocol, info, resume)
    else:
        assert plan is not None
        own_screen = Screen.named(screen or "3m-sct3250")
        if name is None and (own_screen.name in Screen.presets or screen is None):
            raise InputError('--name: expected a name of this panel alone, such as "panel 7"')
        own_screen = own_screen if name is None else own_screen.replace(name=name)
        check_name(own_screen)
        own_finger = Finger.named(finger or "semi-wet")
        info = SessionInfo(
            screen=own_screen, finger=own_finger, operator=operator, crosstalk=crosstalk
        )
        session = Session.begin(folder, plan, info)
    count = len(session.protocol.strokes)
    forces = open_source(session)
    with ExitStack() as stack:
        watcher = stack.enter_context(terminal_watcher(count, not yes and source == "inputs"))
        done = measure_session(
            session,
            forces,
            None if device is None else stack.enter_context(closing(open_device(device))),
            watcher,
            Conditions({}, temperature_c, humidity_percent, operator),
            most_tries=1 if source == "csv" else 5,
        )
    numbers = [one.number for one in done.still_open]
    if not quiet or numbers:
        show(
            f"{folder}: {done.accepted} of {count} strokes on disk",
            [{"accepted": done.accepted, "rejected": done.rejected, "still_open": numbers}],
            as_json,
        )
    if done.still_open:
        raise typer.Exit(1)


def _source_of(
    kind: str, csv: Path | None, columns: Path | None, inputs: Path | None, seed: int = 0
) -> Callable[[Session], ForceSource]:
    """Return what opens the source of the forces; what it could not open is refused at once."""
    if kind == "virtual":
        from calibration.practice import virtual_source

        return lambda session: virtual_source(session, seed)
    from calibration.sources import ColumnMap, CsvSource, open_inputs
    from calibration.sources import Inputs as AnalogInputs

    if kind == "csv":
        if csv is None or columns is None:
            raise InputError("--source csv: expected --csv FOLDER and --columns MAP.toml")
        files = CsvSource(csv, ColumnMap.load(columns))
        return lambda session: files
    if inputs is None:
        raise InputError("--source inputs: expected --inputs FILE.toml, the analog channels")
    AnalogInputs.load(inputs)
    return lambda session: open_inputs(inputs)


def rig(
    folder: Annotated[Path, argument("Folder of the session, or a new one.", fields.Folder)],
    weight_n: Annotated[float, option("Force of a known weight [N]: m x 9.81.", Positive)],
    inputs: Annotated[
        Path | None, option("Channels, as TOML: the readings are recorded.", FileThere)
    ] = None,
    device: Annotated[
        str | None, option("Driver, such as usb:, that plays for a voltmeter.", Address)
    ] = None,
    normal_reading_n: Annotated[
        float | None, option("Without --inputs: the weight on the screen, less zero.", float)
    ] = None,
    tangential_reading_n: Annotated[
        float | None, option("The weight that pulls towards growing x, less zero.", float)
    ] = None,
    monitor_v: Annotated[
        float | None, option("Amplitude that the recordings show or the driver plays.", Positive)
    ] = None,
    voltmeter_v: Annotated[
        float | None, option("Amplitude on the screen by another instrument.", NotNegative)
    ] = None,
    tap: Annotated[
        Path | None, option("CSV file of a tap: columns t_s, tangential_force_n.", FileThere)
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Check gain, sign and unit of both forces, the sensor's bandwidth, and the volts.

    Writes rig.toml, which `fit` and `verify` use: without it a verdict is provisional. Exit code 1
    if the rig has a fault.
    """
    from calibration.rig import RIG

    if inputs is not None:
        checked = _recorded(inputs, device, weight_n)
    else:
        checked = _stated(
            weight_n, normal_reading_n, tangential_reading_n, monitor_v, voltmeter_v, tap
        )
    folder.mkdir(parents=True, exist_ok=True)
    checked.save(folder / RIG)
    names = "normal_gain", "tangential_gain", "voltage_gain", "pole_hz", "resonance_hz", "quality"
    show(str(folder / RIG), [record(checked, names)], as_json)
    faults = checked.faults()
    sys.stderr.writelines(f"{line}\n" for line in faults)
    if faults:
        raise typer.Exit(1)


def _recorded(inputs: Path, device: str | None, weight_n: float) -> RigCheck:
    """Check a rig with its own instruments, a person and a weight."""
    from contextlib import ExitStack, closing

    from calibration.rig import measure_rig
    from calibration.sources import open_inputs
    from firmware_io import open_device

    with ExitStack() as stack:
        driver = None if device is None else stack.enter_context(closing(open_device(device)))
        return measure_rig(open_inputs(inputs), weight_n, _ask, driver)


def _ask(prompt: str) -> str:
    """Show a prompt and return what is typed."""
    sys.stderr.write(prompt)
    sys.stderr.flush()
    return sys.stdin.readline().strip()


def _stated(
    weight_n: float,
    normal_reading_n: float | None,
    tangential_reading_n: float | None,
    monitor_v: float | None,
    voltmeter_v: float | None,
    tap: Path | None,
) -> RigCheck:
    """Check a rig by readings that a person has written down."""
    from calibration.rig import RigCheck, tap_response, today
    from haptix.files import read_csv

    readings = {
        "--normal-reading-n": normal_reading_n,
        "--tangential-reading-n": tangential_reading_n,
        "--monitor-v": monitor_v,
        "--voltmeter-v": voltmeter_v,
    }
    if missing := [name for name, one in readings.items() if one is None]:
        raise InputError(f"expected --inputs, or {', '.join(missing)} as well")
    normal, tangential, monitor, voltmeter = (float(one or 0.0) for one in readings.values())
    bandwidth: dict[str, float] = {}
    if tap is not None:
        import numpy as np

        names = ["t_s", "tangential_force_n"]
        try:
            rows = [[float(row.cells[name]) for name in names] for row in read_csv(tap, names)]
        except ValueError as error:
            raise InputError(f"{tap}: expected numbers, got {error}") from None
        bandwidth = tap_response(*np.array(rows).T)._asdict()
    return RigCheck(
        normal_gain=normal / weight_n,
        tangential_gain=tangential / weight_n,
        voltage_gain=voltmeter / monitor,
        **bandwidth,
        instruments=(f"weight: {weight_n:g} N", "voltmeter"),
        measured_on=today(),
    )


def run(
    folder: Folder,
    name: PanelName = None,
    source: Source = "inputs",
    device: Annotated[str | None, option("Driver, such as usb: or mock:.", Address)] = None,
    inputs: Inputs = None,
    csv: Csv = None,
    columns: Columns = None,
    protocol: Annotated[str, option("paper, full or short.", _Protocol)] = "short",
    minutes: Minutes = 3.0,
    max_voltage_v: Annotated[float | None, option("Highest amplitude [V].", Positive)] = None,
    screen: ScreenOption = "3m-sct3250",
    finger: FingerOption = "semi-wet",
    operator: Operator = "",
    weight_n: Annotated[
        float | None, option("Known weight [N]: the rig is checked before the strokes.", Positive)
    ] = None,
    practice: Annotated[
        bool, typer.Option("--practice", help="On a virtual finger and screen, drawn at random.")
    ] = False,
    seed: Annotated[int | None, option("Of a practice. [default: a new one]", _Seed)] = None,
    yes: NoPrompts = False,
    as_json: AsJson = False,
) -> None:
    """Check the rig, plan, measure, reduce, fit, verify. The same command again continues it.

    Exit code 1 if strokes are still open, or the verification fails.
    """
    from calibration.practice import TRUTH, compare_with_truth, draw_practice
    from calibration.profile import SCREEN
    from calibration.rig import RIG
    from calibration.session import Session
    from calibration.steps import REPORT, fit_folder, plan_strokes, reduce_folder, verify_folder
    from haptix.finger import Finger
    from haptix.screen import Screen

    source = "virtual" if practice else source
    _source_of(source, csv, columns, inputs)
    own_name = "practice" if practice and name is None else name
    is_new = not (folder / "session.json").exists()
    if not is_new and practice != (folder / TRUTH).exists():
        kind = "a measured one" if practice else "a practice"
        raise InputError(f"{folder} is {kind}: choose another folder, or continue it as it began")
    if is_new:
        if own_name is None:
            raise InputError('--name: expected a name of this panel alone, such as "panel 7"')
        own_screen, own_finger = Screen.named(screen), Finger.named(finger)
        planned = plan_strokes(protocol, own_finger, own_screen, minutes, max_voltage_v).protocol
        if practice:
            draw_practice(folder, own_finger, own_screen.replace(name=own_name), planned, seed)
        plan_file = folder / "plan.toml"
        planned.save(plan_file)
    if weight_n is not None and not practice and not (folder / RIG).exists():
        if inputs is None:
            raise InputError("--weight-n: expected --inputs, which read the weight")
        checked = _recorded(inputs, device, weight_n)
        if faults := checked.faults():
            raise InputError(f"the rig is not right: {'; '.join(faults)}")
        checked.save(folder / RIG)
    # What is not given again is that of the session.
    measure(
        folder,
        plan_file if is_new else None,
        source,
        device or ("mock:" if practice else None),
        screen=screen if is_new else None,
        name=own_name if is_new else name,
        finger=finger if is_new else None,
        operator=operator,
        csv=csv,
        columns=columns,
        inputs=inputs,
        resume=not is_new,
        yes=yes,
        quiet=True,
    )
    reduce_folder(folder)
    fitted, _ = fit_folder(folder)
    verification, panel = verify_folder(folder)
    document: dict[str, object] = {
        **record(verification),
        "strokes_used": len(fitted.strokes),
        "h0_m": None if panel is None else panel.h0_m,
        "screen": None if panel is None else str(folder / SCREEN),
        "report": str(folder / REPORT),
        "practice": None,
    }
    if practice and panel is not None:
        highest = max(one.voltage_v for one in Session.open(folder).protocol.strokes)
        off = compare_with_truth(folder, highest)
        document["practice"] = record(off)
    if as_json:
        sys.stdout.write(json_text(document))
    else:
        show_parts(f"{verification.verdict}: {folder / REPORT}", verification.parts)
        if document["practice"]:
            show("how far the practice was off", [off], False)
    if verification.failures:
        raise typer.Exit(1)


app = typer.Typer(
    name="calibrate",
    help="Calibrate a screen: plan, measure, reduce, fit, verify; each step can be repeated.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)
for _command in (plan, measure, reduce, fit, verify, run, rig, check, match, install, period):
    app.command()(_command)


def main() -> None:
    """Run the steps as a program."""
    terminal.run(app, "calibration")
