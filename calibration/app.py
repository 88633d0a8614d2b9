"""``haptix calibrate`` and ``python -m calibration``: plan, measure, reduce, fit, verify."""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from calibration.sources import ForceSource
    from haptix.finger import Finger
    from haptix.screen import Screen

app = typer.Typer(
    name="calibrate",
    help="Calibrate a screen: plan, measure, reduce, fit, verify; each step can be repeated.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)

AsJson = Annotated[bool, typer.Option("--json", help="Print JSON instead of a table.")]
Folder = Annotated[Path, typer.Argument(help="Folder of the session.")]
FingerOption = Annotated[str, typer.Option(help="Finger: a preset (semi-wet, wet) or a TOML file.")]
ScreenOption = Annotated[
    str, typer.Option(help="Screen as it is believed to be: a preset or a TOML file.")
]


@app.command()
def plan(
    out: Annotated[Path, typer.Argument(help="File to write: TOML, or JSON.")],
    protocol: Annotated[
        str, typer.Option(help="paper: its 25 strokes; full: and a frequency sweep; short.")
    ] = "short",
    minutes: Annotated[float, typer.Option(help="Time for a short one.")] = 3.0,
    max_voltage_v: Annotated[
        float | None, typer.Option(help="Highest amplitude [V]. [default: the screen's limit]")
    ] = None,
    finger: FingerOption = "semi-wet",
    screen: ScreenOption = "3m-sct3250",
    as_json: AsJson = False,
) -> None:
    """Write the protocol: which strokes to make, and what they are expected to tell."""
    from calibration.design import expected_rows, expected_spread, short_protocol
    from calibration.parameters import Parameters
    from calibration.predict import StrokeConditions, StrokePredictor
    from calibration.protocol import full_protocol, paper_protocol
    from haptix.errors import InputError
    from haptix.friction import ContactModel

    own_finger, own_screen = _finger(finger), _screen(screen, None)
    limit = own_screen.max_voltage_v if max_voltage_v is None else max_voltage_v
    if limit > own_screen.max_voltage_v:
        raise InputError(
            f"--max-voltage-v: expected at most the {own_screen.max_voltage_v:g} V of screen "
            f"{own_screen.name!r}, got {limit:g} V"
        )
    predictor = StrokePredictor(ContactModel(own_finger, own_screen))
    parameters = Parameters.of(own_finger, own_screen)
    if protocol == "paper":
        found = paper_protocol(limit)
    elif protocol == "full":
        found = full_protocol(limit)
    elif protocol == "short":
        found = short_protocol(predictor, parameters, minutes, limit)
    else:
        raise InputError(f"--protocol: expected paper, full or short, got {protocol!r}")
    found.save(out)
    used = StrokeConditions.of(one for one in found.strokes if not one.held_out)
    spread = expected_spread(predictor, parameters, used)
    _show(
        f"{out}: {found.name}, {len(found.strokes)} strokes, some {found.duration_s / 60:.1f} "
        "minutes; expected errors",
        [
            {
                "parameter": name,
                "expected error": f"{one:.1%}",
                "reported": "yes" if one <= 0.1 else "no",
            }
            for name, one in spread.items()
        ],
        as_json,
    )
    _, is_light = expected_rows(predictor, parameters, used)
    if not is_light.all():
        sys.stderr.write(
            f"{int((~is_light).sum())} strokes are past the light contact of {own_finger.name!r} "
            f"on {own_screen.name!r} and will not be used: lower --max-voltage-v\n"
        )


@app.command()
def measure(
    folder: Folder,
    protocol: Annotated[
        Path | None, typer.Option("--plan", help="Protocol. [default: that of a resumed session]")
    ] = None,
    source: Annotated[
        str, typer.Option(help="Where force comes from: virtual, csv or inputs.")
    ] = "inputs",
    device: Annotated[
        str | None, typer.Option(help="Driver, such as usb: or mock:; without, nothing is played.")
    ] = None,
    screen: ScreenOption = "3m-sct3250",
    name: Annotated[str | None, typer.Option(help="Name of this very screen.")] = None,
    finger: FingerOption = "semi-wet",
    operator: Annotated[str, typer.Option(help="Who measures.")] = "",
    csv: Annotated[
        Path | None, typer.Option(help="For csv: folder of stroke-001.csv and so on.")
    ] = None,
    columns: Annotated[
        Path | None, typer.Option(help="For csv: column map (TOML): what is what, and its unit.")
    ] = None,
    inputs: Annotated[
        Path | None, typer.Option(help="For inputs: TOML file of the analog channels.")
    ] = None,
    crosstalk: Annotated[
        float, typer.Option(help="Share of the normal force on the tangential axis.")
    ] = 0.0,
    temperature_c: Annotated[float | None, typer.Option(help="Of the room.")] = None,
    humidity_percent: Annotated[float | None, typer.Option(help="Of the room.")] = None,
    resume: Annotated[bool, typer.Option("--resume", help="Go on with a session.")] = False,
    yes: Annotated[bool, typer.Option("--yes", help="Do not wait before each stroke.")] = False,
    seed: Annotated[int, typer.Option(help="Of the virtual finger.")] = 0,
    as_json: AsJson = False,
) -> None:
    """Play the protocol stroke by stroke; what is off is repeated, what is good is on disk at once.

    Exit code 1 if strokes are still open at the end.
    """
    from calibration.measuring import measure as measure_session
    from calibration.profile import check_name
    from calibration.protocol import Protocol
    from calibration.recording import Conditions
    from calibration.session import Session, SessionInfo
    from firmware_io import open_device
    from haptix.errors import InputError

    if protocol is None:
        if not resume:
            raise InputError("--plan: expected a protocol; write one with `haptix calibrate plan`")
        session = Session.open(folder)
    else:
        own_screen = _screen(screen, name)
        check_name(own_screen)
        info = SessionInfo(
            screen=own_screen, finger=_finger(finger), operator=operator, crosstalk=crosstalk
        )
        session = Session.begin(folder, Protocol.load(protocol), info, resume)
    room = Conditions({}, temperature_c, humidity_percent, operator)
    chosen = _source(source, session.info.finger, session.info.screen, csv, columns, inputs, seed)
    ask = not yes and source == "inputs"
    tries = 1 if source == "csv" else 5
    with _watcher(len(session.protocol.strokes), ask) as watcher:
        opened = None if device is None else open_device(device)
        try:
            done = measure_session(session, chosen, opened, watcher, room, tries)
        finally:
            if opened is not None:
                opened.close()
    _show(
        f"{folder}: {done.accepted} of {len(session.protocol.strokes)} strokes on disk",
        [
            {
                "accepted": done.accepted,
                "rejected": done.rejected,
                "still open": ", ".join(str(one.number) for one in done.still_open) or "none",
            }
        ],
        as_json,
    )
    if done.still_open:
        raise typer.Exit(1)


@app.command("reduce")
def reduce_(folder: Folder, as_json: AsJson = False) -> None:
    """Make mu(F_N, V0, f) of the raw forces, and name the strokes that cannot be used."""
    from calibration.steps import REDUCED, reduce_folder

    found = reduce_folder(folder)
    rows = [
        {
            "stroke": one.number,
            "force [N]": _rounded(one.normal_force_n),
            "volts": _rounded(one.voltage_v),
            "hertz": one.frequency_hz,
            "mu": _rounded(one.mu),
            "error": _rounded(one.mu_sd),
            "ripple": _rounded(one.ripple),
            "": one.outlier or ("held out" if one.held_out else "; ".join(one.notes)),
        }
        for one in found.points
    ]
    _show(
        f"{folder / REDUCED}: {len(found.used)} strokes to fit, {len(found.held_out)} held out, "
        f"{len(found.outliers)} not used",
        rows,
        as_json,
    )


@app.command()
def fit(
    folder: Folder,
    fix: Annotated[
        list[str] | None, typer.Option(help="Hold a parameter: NAME=VALUE; may be repeated.")
    ] = None,
    prior: Annotated[
        list[str] | None,
        typer.Option(help="Know one: NAME=VALUE,SPREAD (0.1 for 10 %); may be repeated."),
    ] = None,
    finger: Annotated[
        Path | None, typer.Option(help="fit.json of the same finger on another screen.")
    ] = None,
    leaky_gap: Annotated[
        bool, typer.Option("--leaky-gap", help="Fit the resistivity of the gap.")
    ] = False,
    with_: Annotated[list[str] | None, typer.Option("--with", help="Switch a term on.")] = None,
    without: Annotated[list[str] | None, typer.Option(help="Switch a term off.")] = None,
    compare: Annotated[bool, typer.Option(help="Ask which terms the strokes need.")] = True,
    as_json: AsJson = False,
) -> None:
    """Fit screen and finger, and report what the strokes determine.

    What they do not determine has no number, but the experiment that would give it one.
    """
    from calibration.fitting import refusal
    from calibration.steps import FIT, fit_folder

    terms = dict.fromkeys(with_ or [], True) | dict.fromkeys(without or [], False)
    found, needs = fit_folder(
        folder,
        fixed=_fixed(fix or []),
        priors=_priors(prior or []),
        finger_fit=finger,
        leaky_gap=leaky_gap,
        terms=terms or None,
        compare=compare,
    )
    rows: list[dict[str, Any]] = [
        {
            "parameter": one.name,
            "value": one.value if one.value is not None else "not determined",
            "low": _finite(one.low),
            "high": _finite(one.high),
            "spread": f"{one.spread:.1%}",
            "verdict": one.verdict,
        }
        for one in found.estimates
    ]
    if as_json:
        document = {
            "estimates": rows,
            "advice": [refusal(one) for one in found.estimates if one.value is None],
            "left_out": dict(found.left_out),
            "scatter": {"log_mu": found.repeatability.log_mu, "ripple": found.repeatability.ripple},
            "terms": [vars(one) for one in needs],
        }
        sys.stdout.write(json.dumps(document, indent=2) + "\n")
        return
    _show(
        f"{folder / FIT}: {len(found.strokes)} strokes, which repeat within "
        f"{found.repeatability.log_mu:.1%}",
        rows,
        False,
    )
    for one in found.estimates:
        if one.value is None:
            sys.stdout.write(f"{refusal(one)}\n")
    for number, why in sorted(found.left_out.items()):
        sys.stdout.write(f"stroke {number} was not used: {why}\n")
    if needs:
        _show(
            "which terms the strokes need",
            [
                {
                    "term": one.term,
                    "in the fit": "on" if one.is_on else "off",
                    "the strokes say": one.need,
                    "evidence": f"{one.evidence:+.1f}",
                    "thresholds": f"{one.effect_thresholds:.2g}",
                }
                for one in needs
            ],
            False,
        )


@app.command("verify")
def verify_(
    folder: Folder,
    tolerance_thresholds: Annotated[
        float, typer.Option(help="Largest residual, in difference thresholds.")
    ] = 0.5,
    as_json: AsJson = False,
) -> None:
    """Judge the fit by strokes kept out of it; write profiles, report and archive.

    Exit code 1 if it fails.
    """
    from calibration.steps import REPORT, SCREEN, verify_folder

    found = verify_folder(folder, tolerance_thresholds)
    verdict = "passed" if found.verification.passed else "failed"
    written = "no profile" if found.screen is None else str(folder / SCREEN)
    rows = [
        {
            "stroke": one.number,
            "mu": _rounded(one.mu),
            "predicted": _rounded(one.predicted_mu),
            "thresholds": _rounded(one.residual_thresholds),
            "of the ripple": _rounded(one.ripple_residual_thresholds),
        }
        for one in found.verification.rows
    ]
    if as_json:
        document = {
            "verdict": verdict,
            "failures": list(found.verification.failures),
            "worst_thresholds": _rounded(found.verification.worst_thresholds),
            "strokes": rows,
        }
        sys.stdout.write(json.dumps(document, indent=2) + "\n")
    else:
        _show(f"{verdict}: {written}, {folder / REPORT}", rows, False)
        for failure in found.verification.failures:
            sys.stdout.write(f"{failure}\n")
    if not found.verification.passed:
        raise typer.Exit(1)


def main() -> None:
    """Run the steps; a wrong input is one sentence and exit code 2, never a traceback."""
    try:
        app()
    except Exception as error:
        from firmware_io.errors import HaptixError  # loads numpy: too slow for --help

        if not isinstance(error, HaptixError):
            raise
        sys.stderr.write(f"calibration: {error}\n")
        sys.exit(2)


def _finger(name: str) -> Finger:
    from haptix.finger import Finger

    return Finger.load(name) if name.endswith(".toml") else Finger.preset(name)


def _screen(name: str, own_name: str | None) -> Screen:
    from haptix.screen import Screen

    found = Screen.load(name) if name.endswith(".toml") else Screen.preset(name)
    return found if own_name is None else found.replace(name=own_name)


def _source(
    kind: str,
    finger: Finger,
    screen: Screen,
    csv: Path | None,
    columns: Path | None,
    inputs: Path | None,
    seed: int,
) -> ForceSource:
    from haptix.errors import InputError

    if kind == "virtual":
        from calibration.virtual import VirtualFingerSource
        from haptix.friction import ContactModel

        return VirtualFingerSource(ContactModel(finger, screen), seed=seed)
    if kind == "csv":
        from calibration.column_map import ColumnMap
        from calibration.sources import CsvSource

        if csv is None or columns is None:
            raise InputError("--source csv: expected --csv FOLDER and --columns MAP.toml")
        return CsvSource(csv, ColumnMap.load(columns))
    if kind == "inputs":
        from calibration.inputs import open_inputs

        if inputs is None:
            raise InputError("--source inputs: expected --inputs FILE.toml, the analog channels")
        return open_inputs(inputs)
    raise InputError(f"--source: expected virtual, csv or inputs, got {kind!r}")


def _fixed(texts: Sequence[str]) -> dict[str, float]:
    found = {}
    for text in texts:
        name, numbers = _named("--fix", text, "NAME=VALUE", 1)
        found[name] = numbers[0]
    return found


def _priors(texts: Sequence[str]) -> dict[str, tuple[float | None, float]]:
    found: dict[str, tuple[float | None, float]] = {}
    for text in texts:
        name, numbers = _named("--prior", text, "NAME=VALUE,SPREAD", 2)
        found[name] = numbers[0], numbers[1]
    return found


def _named(option: str, text: str, form: str, count: int) -> tuple[str, list[float]]:
    from haptix.errors import InputError

    name, _, values = text.partition("=")
    try:
        numbers = [float(value) for value in values.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) != count:
        raise InputError(f"{option}: expected {form}, such as h0_m=1.2e-7, got {text!r}")
    return name.strip(), numbers


def _watcher(strokes: int, ask: bool) -> Any:
    """Prompts and live numbers on the terminal; yields the `Watcher`."""
    from contextlib import contextmanager

    from calibration.measuring import Watcher

    @contextmanager
    def show() -> Any:
        from rich.console import Console
        from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn

        console = Console(stderr=True)
        bars = Progress(
            TextColumn("{task.description}"),
            BarColumn(),
            MofNCompleteColumn(),
            console=console,
            disable=not console.is_terminal,
        )
        task = bars.add_task("calibrate", total=strokes)

        def prompt(stroke: Any, tries: int) -> None:
            if ask:
                bars.stop()
                again = f" (attempt {tries + 1})" if tries else ""
                console.input(f"{stroke.label}{again}: press Enter, wait a moment, then slide ")
                bars.start()

        def live(stroke: Any, t_s: float, now: Any) -> None:
            bars.update(
                task,
                description=f"stroke {stroke.number}: {now.normal_force_n:5.2f} of "
                f"{stroke.normal_force_n:.2f} N, {now.speed_mm_per_s:5.1f} of "
                f"{stroke.speed_mm_per_s:.0f} mm/s",
            )

        def done(stroke: Any, wrong: Any) -> None:
            for one in wrong:
                console.print(f"stroke {stroke.number}: {one}", markup=False, highlight=False)
            if not any(one.is_fatal for one in wrong):
                bars.advance(task)

        with bars:
            yield Watcher(prompt, live, done)

    return show()


def _rounded(value: float) -> float | None:
    return float(f"{value:.4g}") if value == value else None


def _finite(value: float) -> float | None:
    return value if abs(value) < float("inf") else None


def _show(title: str, rows: Sequence[Mapping[str, Any]], as_json: bool) -> None:
    """Print rows of one set of columns."""
    if as_json:
        sys.stdout.write(json.dumps(rows, indent=2, allow_nan=False) + "\n")
        return
    from rich.box import SIMPLE
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    sys.stdout.write(f"{title}\n")
    table = Table(box=SIMPLE, padding=0)
    for name, value in rows[0].items() if rows else ():
        table.add_column(Text(name), justify="right" if isinstance(value, float) else "left")
    for row in rows:
        table.add_row(*(Text(_text(value)) for value in row.values()))
    Console().print(table)


def _text(value: Any) -> str:
    if value is None:
        return "-"
    return f"{value:.4g}" if isinstance(value, float) else str(value)
