"""``haptix calibrate reduce``, ``fit``, ``verify``, and what is done with profiles and strokes."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from haptix.desk import argument, option
from haptix.errors import InputError
from haptix.fields import Address, FileThere, FingerName, FolderThere, Positive, TermName, Text
from haptix.files import json_text
from haptix.report import record, row
from haptix.terminal import AsJson, show

if TYPE_CHECKING:
    from calibration.parameters import Array
    from haptix.finger import Finger
    from haptix.screen import Screen

Measured = Annotated[Path, argument("Folder of the session.", FolderThere)]
FingerFile = Annotated[
    str | None,
    option("Finger: a preset or a file. [default: finger.toml beside the profile]", FingerName),
]


def _assignments(
    option: str, form: str, texts: Sequence[str] | None
) -> dict[str, tuple[float, ...]]:
    """Read options such as ``h0_m=1.2e-7,0.1``, with as many numbers as `form` has."""
    read = {}
    for text in texts or ():
        name, _, values = text.partition("=")
        try:
            numbers = tuple(float(value) for value in values.split(","))
        except ValueError:
            numbers = ()
        is_whole = len(numbers) == form.count(",") + 1 and all(map(isfinite, numbers))
        if not (is_whole and name.strip()):
            raise InputError(f"{option}: expected {form}, such as h0_m=1.2e-7, got {text!r:.80}")
        read[name.strip()] = numbers
    return read


def _readable(option: str, form: str) -> Callable[..., Any]:
    """Return the check of an option by `_assignments`."""

    def check(value: list[str] | None) -> list[str] | None:
        _assignments(option, form, value)
        return value

    return check


def reduce(folder: Measured, as_json: AsJson = False) -> None:
    """Compute mu(F_N, V0, f) from the raw forces, and name the strokes that cannot be used."""
    from calibration.steps import REDUCED, reduce_folder

    reduced = reduce_folder(folder)
    rows = [{"stroke": point.number, **record(point)} for point in reduced.points]
    title = (
        f"{folder / REDUCED}: {len(reduced.used)} strokes to fit, {len(reduced.held_out)} held "
        f"out, {len(reduced.outliers)} not used"
    )
    show(title, rows if as_json else reduced.points, as_json)


def fit(
    folder: Measured,
    fix: Annotated[
        list[str] | None,
        typer.Option(
            help="Hold a parameter: NAME=VALUE; may be repeated.",
            callback=_readable("--fix", "NAME=VALUE"),
        ),
    ] = None,
    prior: Annotated[
        list[str] | None,
        typer.Option(
            help="Prior: NAME=VALUE,SPREAD (0.1 for 10 %); may be repeated.",
            callback=_readable("--prior", "NAME=VALUE,SPREAD"),
        ),
    ] = None,
    finger: Annotated[
        Path | None, option("fit.json of the same finger on another screen.", FileThere)
    ] = None,
    leaky_gap: Annotated[
        bool, typer.Option("--leaky-gap", help="Fit the resistivity of the gap.")
    ] = False,
    with_: Annotated[
        list[str] | None, option("Switch a term on.", tuple[TermName, ...], "--with")
    ] = None,
    without: Annotated[list[str] | None, option("Switch a term off.", tuple[TermName, ...])] = None,
    compare: Annotated[bool, typer.Option(help="Find which terms the strokes need.")] = True,
    as_json: AsJson = False,
) -> None:
    """Fit screen and finger, and report what the strokes determine.

    A parameter that they do not determine has no value, but the experiment that would give one.
    """
    from calibration.steps import FIT, fit_folder

    terms = dict.fromkeys(with_ or [], True) | dict.fromkeys(without or [], False)
    fixed = {n: value for n, (value,) in _assignments("--fix", "NAME=VALUE", fix).items()}
    priors: dict[str, tuple[float | None, float]] = {
        name: (value, spread)
        for name, (value, spread) in _assignments("--prior", "NAME=VALUE,SPREAD", prior).items()
    }
    result, needs = fit_folder(folder, fixed, priors, finger, leaky_gap, terms or None, compare)
    if as_json:
        shown = ("name", "value", "low", "high", "spread", "verdict")
        document = {
            "estimates": [record(estimate, shown) for estimate in result.estimates],
            "advice": [estimate.refusal() for estimate in result.undetermined],
            **record(result, ("left_out", "theory", "repeatability", "forms")),
            "terms": record(needs),
        }
        sys.stdout.write(json_text(document))
        return
    show_parts(
        f"{folder / FIT}: {len(result.strokes)} strokes, which repeat within "
        f"{result.repeatability.log_mu:.1%}; theory {result.theory}",
        result.parts(needs),
    )


def verify(
    folder: Measured,
    tolerance_jnd: Annotated[
        float, option("Largest error, in just-noticeable differences (JND).", Positive)
    ] = 0.5,
    as_json: AsJson = False,
) -> None:
    """Verify the fit by strokes kept out of it; write profiles, report and archive.

    Exit code 1 if it fails.
    """
    from calibration.profile import SCREEN
    from calibration.steps import REPORT, verify_folder

    verification, screen = verify_folder(folder, tolerance_jnd)
    if as_json:
        sys.stdout.write(json_text(record(verification)))
    else:
        written = "no profile" if screen is None else folder / SCREEN
        show_parts(f"{verification.verdict}: {written}, {folder / REPORT}", verification.parts)
    if verification.failures:
        raise typer.Exit(1)


def show_parts(title: str, parts: Sequence[tuple[str, Sequence[Any]]]) -> None:
    """Show a result to people: each of its parts as a table, or line by line."""
    sys.stdout.write(f"{title}\n")
    for name, rows in parts:
        if rows and isinstance(rows[0], str):
            sys.stdout.writelines(f"{name}: {line}\n" for line in rows)
        elif rows:
            show(name, rows, False)


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
    from calibration.predict import StrokePredictor
    from calibration.steps import reduce_folder
    from calibration.verification import check_profile
    from haptix.friction import ContactModel

    screen, own_finger = _profiles(profile, finger)
    checked = check_profile(
        reduce_folder(folder), StrokePredictor(ContactModel(own_finger, screen))
    )
    days = _days_between(screen, folder)
    if as_json:
        drifts = {"drift": record(checked.drifts), "strokes": record(checked.strokes)}
        sys.stdout.write(json_text({"verdict": checked.verdict, "days": days, **drifts}))
    else:
        since = "" if days is None else f", {days} days after its calibration"
        rows = [
            {"": name.replace("_", " "), **row(drift)} for name, drift in checked.drifts.items()
        ]
        show(f"{checked.verdict}: {screen.name}{since}; drift in JND", rows, False)
    if not checked.passed:
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
    from calibration.profile import match_profiles

    forces = normal_force_n or (0.2, 0.5, 0.8)
    profile_a, profile_b = _profiles(a, finger), _profiles(b, finger)
    matches = match_profiles(profile_a, profile_b, forces, frequency_hz, levels)
    if as_json:
        sys.stdout.write(json_text(record(matches)))
        return
    for place in matches:
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
    installed = install_profile(serial or "", profile, finger or profile.with_name("finger.toml"))
    shown = {"serial": serial, "calibration_id": Screen.load(installed.screen).calibration_id}
    shown |= {"screen": str(installed.screen), "finger": str(installed.finger)}
    show("installed", [shown], as_json)


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
        result = spatial_period(t, x, signals, shortest_mm, longest_mm)
        is_sure &= result.is_significant
        rows.append(
            {"file": file.name, **(record(result) if as_json else row(result, ("summary",)))}
        )
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
    from calibration.sources import ColumnMap, CsvColumn

    if columns is None:
        raise InputError(f"--columns: expected a column map, to read {file}")
    column_map = ColumnMap.load(columns)
    if speed_mm_per_s is not None:
        x_mm = CsvColumn(speed_mm_per_s=speed_mm_per_s)
        column_map = column_map.replace(columns={**column_map.columns, "x_mm": x_mm})
    if "x_mm" not in column_map.columns:
        raise InputError("--speed-mm-per-s: expected a speed, or x_mm in the column map")
    signals = column_map.read(file)
    names = [name for name in signals if name not in ("t_s", "x_mm", "normal_force_n", "drive_v")]
    if not names:
        raise InputError(f"{columns}: expected a signal beside time and place")
    return signals["t_s"], signals["x_mm"], np.stack([signals[name] for name in names], axis=-1)


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
    measured_with = Finger.load(beside)
    check_measured_with(screen, measured_with, beside)
    return screen, measured_with


def _days_between(screen: Screen, folder: Path) -> int | None:
    """Days from a calibration to the strokes of a session."""
    from datetime import date

    from calibration.session import Session

    started = min((one.conditions.started for one in Session.open(folder).recordings), default="")
    if screen.calibration is None or not started:
        return None
    return (date.fromisoformat(started[:10]) - screen.calibration.date).days
