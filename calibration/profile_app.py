"""``haptix calibrate check``, ``match``, ``install`` and ``period``: beside the steps."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from haptix.desk import argument, option
from haptix.errors import InputError
from haptix.fields import Address, FileThere, FingerName, FolderThere, Positive, Text
from haptix.files import json_text
from haptix.report import record, row
from haptix.terminal import AsJson, show

if TYPE_CHECKING:
    from calibration.parameters import Array
    from haptix.finger import Finger
    from haptix.screen import Screen

FingerFile = Annotated[
    str | None,
    option("Finger: a preset or a file. [default: finger.toml beside the profile]", FingerName),
]


def check(
    folder: Annotated[Path, argument("Folder of a session with new strokes.", FolderThere)],
    profile: Annotated[Path, option("screen.toml of an earlier calibration.", FileThere)],
    finger: FingerFile = None,
    as_json: AsJson = False,
) -> None:
    """Compare new strokes with an existing profile: the drift since then, in JND.

    Passes if the mean change of friction, with its uncertainty, is within half a JND. Exit code 1
    if not.
    """
    from calibration.drift import check_profile
    from calibration.predict import StrokePredictor
    from calibration.steps import reduce_folder
    from haptix.friction import ContactModel

    screen, own_finger = _profiles(profile, finger)
    found = check_profile(reduce_folder(folder), StrokePredictor(ContactModel(own_finger, screen)))
    days = _days_between(screen, folder)
    if as_json:
        drifts = {"drift": record(found.drifts), "strokes": record(found.strokes)}
        sys.stdout.write(json_text({"verdict": found.verdict, "days": days, **drifts}))
    else:
        since = "" if days is None else f", {days} days after its calibration"
        rows = [{"": name.replace("_", " "), **row(one)} for name, one in found.drifts.items()]
        show(f"{found.verdict}: {screen.name}{since}; drift in JND", rows, False)
    if not found.passed:
        raise typer.Exit(1)


def match(
    a: Annotated[Path, argument("screen.toml of the first screen.", FileThere)],
    b: Annotated[Path, argument("screen.toml of the second one.", FileThere)],
    normal_force_n: Annotated[
        list[float] | None,
        option("May be repeated. [default: 0.2, 0.5, 0.8]", tuple[Positive, ...]),
    ] = None,
    frequency_hz: Annotated[float, option("Of the drive.", Positive)] = 4000.0,
    levels: Annotated[int, option("Frictions in the common range.", int, ge=2, le=1000)] = 5,
    finger: FingerFile = None,
    as_json: AsJson = False,
) -> None:
    """Find the friction that two screens can both give, and the voltages for it.

    difference: of the friction at equal voltages, B minus A; uncertainty: 90 %, of equal friction.
    """
    from calibration.matching import match_profiles

    forces = normal_force_n or (0.2, 0.5, 0.8)
    one, other = _profiles(a, finger), _profiles(b, finger)
    found = match_profiles(one, other, forces, frequency_hz, levels)
    if as_json:
        sys.stdout.write(json_text(record(found)))
        return
    for place in found:
        title = f"at {place.normal_force_n:g} N and {frequency_hz:g} Hz: {place.text}"
        show(title, place.levels, False)


def install(
    profile: Annotated[Path, argument("screen.toml of a calibration that passed.", FileThere)],
    serial: Annotated[str | None, option("Serial number of the driver.", Text)] = None,
    device: Annotated[str | None, option("The driver itself, such as usb:.", Address)] = None,
    finger: Annotated[
        Path | None, option("[default: finger.toml beside the profile]", FileThere)
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Install a profile for a driver, by whose serial number `haptix render` and `play` find it."""
    from contextlib import closing

    from firmware_io import open_device
    from haptix.profiles import install_profile
    from haptix.screen import Screen

    if (serial is None) == (device is None):
        raise InputError("expected --serial or --device, one of the two")
    if device is not None:
        with closing(open_device(device)) as opened:
            serial = opened.capabilities.serial
    made = install_profile(serial or "", profile, finger or profile.with_name("finger.toml"))
    said = {"serial": serial, "calibration_id": Screen.load(made.screen).calibration_id}
    said |= {"screen": str(made.screen), "finger": str(made.finger)}
    show("installed", [said], as_json)


def period(
    files: Annotated[
        list[Path],
        argument("Recordings: CSV files, or a session's stroke-001.h5.", tuple[FileThere, ...]),
    ],
    columns: Annotated[Path | None, option("For CSV: column map, as TOML.", FileThere)] = None,
    speed_mm_per_s: Annotated[
        float | None, option("Of the slide, in place of that in the column map.", Positive)
    ] = None,
    shortest_mm: Annotated[float, option("Shortest period.", Positive)] = 1.0,
    longest_mm: Annotated[float, option("Longest period.", Positive)] = 6.0,
    as_json: AsJson = False,
) -> None:
    """Find the spatial period of what was touched, with its significance and its harmonic.

    Every mapped column but time, place, normal force and drive is a signal; of a session's stroke
    it is the tangential force. Exit code 1 if a file shows no significant period.
    """
    from calibration.spatial_period import spatial_period

    rows, is_sure = [], True
    for file in files:
        t, x, signals = _signals_of(file, columns, speed_mm_per_s)
        found = spatial_period(t, x, signals, shortest_mm, longest_mm)
        is_sure &= found.is_significant
        rows.append({"file": file.name, **(record(found) if as_json else row(found, ("summary",)))})
    show("spatial period", rows, as_json)
    if not is_sure:
        raise typer.Exit(1)


def _signals_of(
    file: Path, columns: Path | None, speed_mm_per_s: float | None
) -> tuple[Array, Array, Array]:
    """Times, places and signals of a recording."""
    import numpy as np

    if file.suffix == ".h5":
        from calibration.recording import StrokeRecording

        stroke = StrokeRecording.load(file)
        return stroke.t_s, stroke.x_mm, stroke.tangential_force_n
    from calibration.column_map import ColumnMap, CsvColumn

    if columns is None:
        raise InputError(f"--columns: expected a column map, to read {file}")
    known = ColumnMap.load(columns)
    if speed_mm_per_s is not None:
        x_mm = CsvColumn(speed_mm_per_s=speed_mm_per_s)
        known = known.replace(columns={**known.columns, "x_mm": x_mm})
    if "x_mm" not in known.columns:
        raise InputError("--speed-mm-per-s: expected a speed, or x_mm in the column map")
    found = known.read(file)
    names = [one for one in found if one not in ("t_s", "x_mm", "normal_force_n", "drive_v")]
    if not names:
        raise InputError(f"{columns}: expected a signal beside time and place")
    return found["t_s"], found["x_mm"], np.stack([found[name] for name in names], axis=-1)


def _profiles(path: Path, finger: str | None) -> tuple[Screen, Finger]:
    from haptix.finger import Finger
    from haptix.profiles import check_measured_with
    from haptix.screen import Screen

    beside = path.with_name("finger.toml")
    if finger is None and not beside.exists():
        raise InputError(f"--finger: expected a finger, since there is no {beside}")
    screen = Screen.load(path)
    if finger is not None:
        return screen, Finger.named(finger)
    own = Finger.load(beside)
    check_measured_with(screen, own, beside)
    return screen, own


def _days_between(screen: Screen, folder: Path) -> int | None:
    """Days from a calibration to the strokes of a session."""
    from datetime import date

    from calibration.session import Session

    started = min((one.conditions.started for one in Session.open(folder).recordings), default="")
    if screen.calibration is None or not started:
        return None
    return (date.fromisoformat(started[:10]) - screen.calibration.date).days
