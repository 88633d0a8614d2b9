"""``haptix calibrate plan`` and ``measure``."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from calibration.options import (
    Columns,
    Csv,
    FingerOption,
    Folder,
    Inputs,
    Minutes,
    PanelName,
    ScreenOption,
    Source,
    protocol_kind,
    seed_number,
)
from haptix.desk import argument, option
from haptix.errors import InputError
from haptix.fields import Address, FileThere, FingerName, NewFile, Positive, ScreenName
from haptix.report import record
from haptix.terminal import AsJson, show

if TYPE_CHECKING:
    from calibration.session import Session
    from calibration.sources import ForceSource


def plan(
    out: Annotated[Path, argument("File to write: TOML, or JSON.", NewFile)],
    protocol: Annotated[
        str,
        typer.Option(
            help="paper: its 25 strokes; full: and a frequency sweep; short.",
            callback=protocol_kind,
        ),
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
    found = plan_strokes(protocol, own_finger, own_screen, minutes, max_voltage_v)
    found.protocol.save(out)
    title = (
        f"{out}: {found.protocol.name}, {len(found.protocol.strokes)} strokes, some "
        f"{found.protocol.duration_s / 60:.1f} minutes; expected errors"
    )
    rows: list[dict[str, object]] = [
        {"name": name, "expected_spread": record(sd), "is_reported": sd <= reported_within(name)}
        for name, sd in found.expected_spread.items()
    ]
    show(title, rows, as_json)
    if found.past_light_contact:
        sys.stderr.write(
            f"{found.past_light_contact} strokes are past the light contact of "
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
    operator: Annotated[str, typer.Option(help="Who measures.")] = "",
    csv: Csv = None,
    columns: Columns = None,
    inputs: Inputs = None,
    crosstalk: Annotated[
        float, option("Share of the normal force on the tangential axis.", float, ge=-1, le=1)
    ] = 0.0,
    temperature_c: Annotated[float | None, option("Of the room.", float, ge=-50, le=100)] = None,
    humidity_percent: Annotated[float | None, option("Of the room.", float, ge=0, le=100)] = None,
    resume: Annotated[bool, typer.Option("--resume", help="Continue a session.")] = False,
    yes: Annotated[bool, typer.Option("--yes", help="Do not wait before each stroke.")] = False,
    seed: Annotated[int, typer.Option(help="Of the virtual finger.", callback=seed_number)] = 0,
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
    check_source(source, csv, columns, inputs)
    if resume and (plan is None or (folder / "session.json").exists()):
        there = Session.open(folder)
        own_screen = there.info.screen if screen is None else Screen.named(screen)
        info = there.info.replace(
            screen=own_screen.replace(name=there.info.screen.name if name is None else name),
            finger=there.info.finger if finger is None else Finger.named(finger),
        )
        session = Session.begin(folder, plan or there.protocol, info, resume)
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
    chosen = _source(source, session, csv, columns, inputs, seed)
    with ExitStack() as stack:
        watcher = stack.enter_context(terminal_watcher(count, not yes and source == "inputs"))
        done = measure_session(
            session,
            chosen,
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


def check_source(kind: str, csv: Path | None, columns: Path | None, inputs: Path | None) -> None:
    """Refuse, before anything is planned or written, what `_source` could not open."""
    if kind == "csv":
        from calibration.column_map import ColumnMap

        if csv is None or columns is None:
            raise InputError("--source csv: expected --csv FOLDER and --columns MAP.toml")
        ColumnMap.load(columns)
    elif kind == "inputs":
        from calibration.inputs import Inputs

        if inputs is None:
            raise InputError("--source inputs: expected --inputs FILE.toml, the analog channels")
        Inputs.load(inputs)


def _source(
    kind: str,
    session: Session,
    csv: Path | None,
    columns: Path | None,
    inputs: Path | None,
    seed: int,
) -> ForceSource:
    if kind == "virtual":
        from calibration.practice import TRUTH, Truth
        from calibration.virtual import VirtualFingerSource
        from haptix.friction import ContactModel

        # A resumed session goes on with other noise, not with the same again.
        done = len(session.protocol.strokes) - len(session.open_strokes)
        if (session.folder / TRUTH).exists():
            truth = Truth.load(session.folder / TRUTH)
            return VirtualFingerSource(truth.model, seed=truth.seed + done)
        own = ContactModel(session.info.finger, session.info.screen)
        return VirtualFingerSource(own, seed=seed + done)
    if kind == "csv":
        from calibration.column_map import ColumnMap
        from calibration.sources import CsvSource

        assert csv is not None and columns is not None  # `check_source`
        return CsvSource(csv, ColumnMap.load(columns))
    from calibration.inputs import open_inputs

    assert inputs is not None
    return open_inputs(inputs)
