"""``haptix calibrate`` and ``python -m calibration``: plan, measure, reduce, fit, verify."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from calibration import profile_app, rig_app
from calibration.profile_app import rounded, stroke_rows
from haptix.arguments import (
    Check,
    device_address,
    file_to_write,
    folder_there,
    is_there,
    number,
    one_of,
    preset_or_file,
    some_of,
    text,
)
from haptix.arguments import folder as folder_of
from haptix.errors import InputError
from haptix.files import json_text
from haptix.presets import FINGERS, SCREENS, TERMS
from haptix.terminal import AsJson, run, show

if TYPE_CHECKING:
    from calibration.session import Session
    from calibration.sources import ForceSource
    from calibration.verification import Verification

app = typer.Typer(
    name="calibrate",
    help="Calibrate a screen: plan, measure, reduce, fit, verify; each step can be repeated.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)

Folder = Annotated[Path, typer.Argument(help="Folder of the session.", callback=folder_of)]
Measured = Annotated[Path, typer.Argument(help="Folder of the session.", callback=folder_there)]
finger_name, screen_name = preset_or_file("finger", FINGERS), preset_or_file("screen", SCREENS)
FingerOption = Annotated[
    str,
    typer.Option(help="Finger: a preset (semi-wet, wet) or a TOML file.", callback=finger_name),
]
ScreenOption = Annotated[
    str,
    typer.Option(help="Assumed screen: a preset or a TOML file.", callback=screen_name),
]
PanelName = Annotated[
    str | None, typer.Option(help="Name of this screen alone; required.", callback=text)
]
seed_ = number(least=0, most=2**63 - 1)
protocol_kind = one_of("paper", "full", "short")
source_kind = one_of("virtual", "csv", "inputs")
Csv = Annotated[
    Path | None,
    typer.Option(help="For csv: folder of stroke-001.csv ...", callback=folder_of),
]
Columns = Annotated[
    Path | None, typer.Option(help="For csv: column map, as TOML.", callback=is_there)
]
Inputs = Annotated[
    Path | None, typer.Option(help="For inputs: channels, as TOML.", callback=is_there)
]
Minutes = Annotated[
    float,
    typer.Option(help="Time for a short one.", callback=number(above=0, most=1000)),
]
Source = Annotated[
    str, typer.Option(help="Of the forces: virtual, csv or inputs.", callback=source_kind)
]


def _numbers(
    option: str, texts: Sequence[str] | None, form: str
) -> list[tuple[str, tuple[float, ...]]]:
    """Read options such as ``h0_m=1.2e-7,0.1``, with as many numbers as `form` has."""
    found = []
    for pair in texts or ():
        name, _, values = pair.partition("=")
        try:
            numbers = tuple(float(value) for value in values.split(","))
        except ValueError:
            numbers = ()
        is_whole = len(numbers) == form.count(",") + 1 and all(map(isfinite, numbers))
        if not (is_whole and name.strip()):
            raise InputError(f"{option}: expected {form}, such as h0_m=1.2e-7, got {pair!r:.80}")
        found.append((name.strip(), numbers))
    return found


def _assignments(option: str, form: str) -> Check:
    """Refuse what `_numbers` cannot read."""

    def check(_: typer.CallbackParam, value: list[str] | None) -> list[str] | None:
        _numbers(option, value, form)
        return value

    return check


@app.command()
def plan(
    out: Annotated[
        Path, typer.Argument(help="File to write: TOML, or JSON.", callback=file_to_write)
    ],
    protocol: Annotated[
        str,
        typer.Option(
            help="paper: its 25 strokes; full: and a frequency sweep; short.",
            callback=protocol_kind,
        ),
    ] = "short",
    minutes: Minutes = 3.0,
    max_voltage_v: Annotated[
        float | None,
        typer.Option(
            help="Highest amplitude [V]. [default: the screen's limit]", callback=number(above=0)
        ),
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
        {"name": name, "expected_spread": rounded(sd), "is_reported": sd <= reported_within(name)}
        for name, sd in found.expected_spread.items()
    ]
    show(title, rows, as_json)
    if found.past_light_contact:
        sys.stderr.write(
            f"{found.past_light_contact} strokes are past the light contact of "
            f"{own_finger.name!r} on {own_screen.name!r} and will not be used: lower "
            "--max-voltage-v\n"
        )


@app.command()
def measure(
    folder: Folder,
    protocol: Annotated[
        Path | None,
        typer.Option(
            "--plan", help="Protocol. [default: that of a resumed session]", callback=is_there
        ),
    ] = None,
    source: Source = "inputs",
    device: Annotated[
        str | None,
        typer.Option(
            help="Driver, such as usb: or mock:; by default, nothing plays.",
            callback=device_address,
        ),
    ] = None,
    screen: Annotated[
        str | None,
        typer.Option(
            help="Assumed screen: a preset or a file. [default: 3m-sct3250]", callback=screen_name
        ),
    ] = None,
    name: PanelName = None,
    finger: Annotated[
        str | None,
        typer.Option(help="Finger: a preset or a file. [default: semi-wet]", callback=finger_name),
    ] = None,
    operator: Annotated[str, typer.Option(help="Who measures.")] = "",
    csv: Csv = None,
    columns: Columns = None,
    inputs: Inputs = None,
    crosstalk: Annotated[
        float,
        typer.Option(
            help="Share of the normal force on the tangential axis.",
            callback=number(least=-1, most=1),
        ),
    ] = 0.0,
    temperature_c: Annotated[
        float | None, typer.Option(help="Of the room.", callback=number(least=-50, most=100))
    ] = None,
    humidity_percent: Annotated[
        float | None, typer.Option(help="Of the room.", callback=number(least=0, most=100))
    ] = None,
    resume: Annotated[bool, typer.Option("--resume", help="Continue a session.")] = False,
    yes: Annotated[bool, typer.Option("--yes", help="Do not wait before each stroke.")] = False,
    seed: Annotated[int, typer.Option(help="Of the virtual finger.", callback=seed_)] = 0,
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
    if resume and (plan is None or (folder / "session.json").exists()):
        there = Session.open(folder)
        own_screen = there.info.screen if screen is None else Screen.named(screen)
        info = there.info.replace(
            screen=own_screen.replace(name=there.info.screen.name if name is None else name),
            finger=there.info.finger if finger is None else Finger.named(finger),
        )
        session = Session.begin(folder, plan or there.protocol, info, resume)
    elif plan is None:
        raise InputError("--plan: expected a protocol; write one with `haptix calibrate plan`")
    else:
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


@app.command("reduce")
def reduce_(folder: Measured, as_json: AsJson = False) -> None:
    """Compute mu(F_N, V0, f) from the raw forces, and name the strokes that cannot be used."""
    from calibration.steps import REDUCED, reduce_folder

    found = reduce_folder(folder)
    rows = [
        {
            "stroke": one.number,
            "normal_force_n": rounded(one.normal_force_n),
            "voltage_v": rounded(one.voltage_v),
            "frequency_hz": one.frequency_hz,
            "mu": rounded(one.mu),
            "mu_sd": rounded(one.mu_sd),
            "ripple": rounded(one.ripple),
            "ripple_sd": rounded(one.ripple_sd),
            "held_out": one.held_out,
            "remarks": "; ".join(filter(None, (one.outlier, *one.notes))),
        }
        for one in found.points
    ]
    show(
        f"{folder / REDUCED}: {len(found.used)} strokes to fit, {len(found.held_out)} held out, "
        f"{len(found.outliers)} not used",
        rows,
        as_json,
    )


@app.command()
def fit(
    folder: Measured,
    fix: Annotated[
        list[str] | None,
        typer.Option(
            help="Hold a parameter: NAME=VALUE; may be repeated.",
            callback=_assignments("--fix", "NAME=VALUE"),
        ),
    ] = None,
    prior: Annotated[
        list[str] | None,
        typer.Option(
            help="Prior: NAME=VALUE,SPREAD (0.1 for 10 %); may be repeated.",
            callback=_assignments("--prior", "NAME=VALUE,SPREAD"),
        ),
    ] = None,
    finger: Annotated[
        Path | None,
        typer.Option(help="fit.json of the same finger on another screen.", callback=is_there),
    ] = None,
    leaky_gap: Annotated[
        bool, typer.Option("--leaky-gap", help="Fit the resistivity of the gap.")
    ] = False,
    with_: Annotated[
        list[str] | None,
        typer.Option("--with", help="Switch a term on.", callback=some_of(*TERMS)),
    ] = None,
    without: Annotated[
        list[str] | None, typer.Option(help="Switch a term off.", callback=some_of(*TERMS))
    ] = None,
    compare: Annotated[bool, typer.Option(help="Find which terms the strokes need.")] = True,
    as_json: AsJson = False,
) -> None:
    """Fit screen and finger, and report what the strokes determine.

    A parameter that they do not determine has no value, but the experiment that would give one.
    """
    from calibration.steps import FIT, fit_folder

    terms = dict.fromkeys(with_ or [], True) | dict.fromkeys(without or [], False)
    fixed = {name: value for name, (value,) in _numbers("--fix", fix, "NAME=VALUE")}
    priors: dict[str, tuple[float | None, float]] = {
        name: (value, spread)
        for name, (value, spread) in _numbers("--prior", prior, "NAME=VALUE,SPREAD")
    }
    found, needs = fit_folder(folder, fixed, priors, finger, leaky_gap, terms or None, compare)
    advice = [one.refusal() for one in found.undetermined]
    if as_json:
        document = {
            "estimates": [
                one.model_dump(mode="json", exclude={"advice"}) for one in found.estimates
            ],
            "advice": advice,
            "left_out": found.left_out,
            "theory": found.theory,
            "repeatability": vars(found.repeatability),
            "forms": [
                {
                    key: rounded(one) if isinstance(one, float) else one
                    for key, one in vars(form).items()
                }
                for form in found.forms
            ],
            "terms": [
                {**vars(one), "evidence": rounded(one.evidence)}
                | {"effect_thresholds": rounded(one.effect_thresholds)}
                for one in needs
            ],
        }
        sys.stdout.write(json_text(document))
        return
    show(
        f"{folder / FIT}: {len(found.strokes)} strokes, which repeat within "
        f"{found.repeatability.log_mu:.1%}; theory {found.theory}",
        [one.row() for one in found.estimates],
        False,
    )
    left_out = [f"stroke {n} was not used: {why}" for n, why in sorted(found.left_out.items())]
    sys.stdout.writelines(f"{line}\n" for line in [*advice, *left_out])
    if found.forms:
        show("other forms of the model", [one.row() for one in found.forms], False)
    if needs:
        show("which terms the strokes need", [one.row() for one in needs], False)


@app.command("verify")
def verify_(
    folder: Measured,
    tolerance_thresholds: Annotated[
        float,
        typer.Option(
            help="Largest error, in just-noticeable differences (JND).", callback=number(above=0)
        ),
    ] = 0.5,
    as_json: AsJson = False,
) -> None:
    """Verify the fit by strokes kept out of it; write profiles, report and archive.

    Exit code 1 if it fails.
    """
    from calibration.profile import SCREEN
    from calibration.steps import REPORT, verify_folder

    found, screen = verify_folder(folder, tolerance_thresholds)
    if as_json:
        document = {**_verdict(found), "strokes": stroke_rows(found.rows)}
        sys.stdout.write(json_text(document))
    else:
        written = "no profile" if screen is None else folder / SCREEN
        _show_verdict(f"{found.verdict}: {written}, {folder / REPORT}", found)
    if found.failures:
        raise typer.Exit(1)


@app.command("run")
def run_(
    folder: Folder,
    name: PanelName = None,
    source: Source = "inputs",
    device: Annotated[
        str | None, typer.Option(help="Driver, such as usb: or mock:.", callback=device_address)
    ] = None,
    inputs: Inputs = None,
    csv: Csv = None,
    columns: Columns = None,
    protocol: Annotated[
        str, typer.Option(help="paper, full or short.", callback=protocol_kind)
    ] = "short",
    minutes: Minutes = 3.0,
    max_voltage_v: Annotated[
        float | None, typer.Option(help="Highest amplitude [V].", callback=number(above=0))
    ] = None,
    screen: ScreenOption = "3m-sct3250",
    finger: FingerOption = "semi-wet",
    operator: Annotated[str, typer.Option(help="Who measures.")] = "",
    weight_n: Annotated[
        float | None,
        typer.Option(
            help="Known weight [N]: the rig is checked before the strokes.",
            callback=number(above=0),
        ),
    ] = None,
    practice: Annotated[
        bool, typer.Option("--practice", help="On a virtual finger and screen, drawn at random.")
    ] = False,
    seed: Annotated[
        int | None, typer.Option(help="Of a practice. [default: a new one]", callback=seed_)
    ] = None,
    yes: Annotated[bool, typer.Option("--yes", help="Do not wait before each stroke.")] = False,
    as_json: AsJson = False,
) -> None:
    """Check the rig, plan, measure, reduce, fit, verify. The same command again continues it.

    Exit code 1 if strokes are still open, or the verification fails.
    """
    from secrets import randbelow

    from calibration.practice import TRUTH, VIRTUAL_RIG, compare_with_truth, draw_truth
    from calibration.profile import SCREEN
    from calibration.rig import RIG
    from calibration.session import Session
    from calibration.steps import REPORT, fit_folder, plan_strokes, reduce_folder, verify_folder
    from haptix.finger import Finger
    from haptix.screen import Screen

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
            drawn = randbelow(2**31) if seed is None else seed
            panel = own_screen.replace(name=own_name)
            draw_truth(own_finger, panel, planned, drawn).save(folder / TRUTH)
            VIRTUAL_RIG.save(folder / RIG)
        plan_file = folder / "plan.toml"
        planned.save(plan_file)
    if weight_n is not None and not practice and not (folder / RIG).exists():
        if inputs is None:
            raise InputError("--weight-n: expected --inputs, which read the weight")
        checked = rig_app.recorded(inputs, device, weight_n)
        if faults := checked.faults():
            raise InputError(f"the rig is not right: {'; '.join(faults)}")
        checked.save(folder / RIG)
    # What is not given again is that of the session.
    measure(
        folder,
        plan_file if is_new else None,
        "virtual" if practice else source,
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
    found_fit, _ = fit_folder(folder)
    found, made = verify_folder(folder)
    document: dict[str, object] = {
        **_verdict(found),
        "strokes_used": len(found_fit.strokes),
        "h0_m": None if made is None else made.h0_m,
        "screen": None if made is None else str(folder / SCREEN),
        "report": str(folder / REPORT),
        "practice": None,
    }
    if practice and made is not None:
        highest = max(one.voltage_v for one in Session.open(folder).protocol.strokes)
        off = compare_with_truth(folder, highest)
        document["practice"] = {key: rounded(value) for key, value in vars(off).items()}
    if as_json:
        sys.stdout.write(json_text(document))
    else:
        _show_verdict(f"{found.verdict}: {folder / REPORT}", found)
        if document["practice"]:
            show("how far the practice was off", [vars(off)], False)
    if found.failures:
        raise typer.Exit(1)


app.command("rig")(rig_app.rig)
app.command("check")(profile_app.check)
app.command("match")(profile_app.match)
app.command("install")(profile_app.install)
app.command("period")(profile_app.period)


def main() -> None:
    """Run the steps as a program."""
    run(app, "calibration")


def _verdict(found: Verification) -> dict[str, object]:
    """A verdict for JSON."""
    return {
        "verdict": found.verdict,
        "failures": found.failures,
        "untested": found.untested,
        "worst_thresholds": rounded(found.worst_thresholds),
        "bound_thresholds": rounded(found.bound_thresholds),
        "fit_bound_thresholds": rounded(found.fit_bound_thresholds),
        "steadiness": found.steadiness.values(),
        "groups": [
            {
                "group": one.group,
                "strokes": one.strokes,
                "mean_thresholds": rounded(one.mean_thresholds),
                "uncertainty_thresholds": rounded(one.uncertainty_thresholds),
                "rig_thresholds": rounded(one.rig_thresholds),
                "bound_thresholds": rounded(one.bound_thresholds),
            }
            for one in found.groups
        ],
    }


def _show_verdict(title: str, found: Verification) -> None:
    """Show a verdict to people: what was tested, every stroke, and what failed or is missing."""
    show(title, [one.row() for one in found.groups], False)
    show("strokes kept out of the fit", [one.row() for one in found.rows], False)
    sys.stdout.writelines(f"{line}\n" for line in found.failures)
    sys.stdout.writelines(f"not tested: {line}\n" for line in found.untested)
    sys.stdout.write(f"steadiness: {found.steadiness.text}\n")


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

        if csv is None or columns is None:
            raise InputError("--source csv: expected --csv FOLDER and --columns MAP.toml")
        return CsvSource(csv, ColumnMap.load(columns))
    if kind == "inputs":
        from calibration.inputs import open_inputs

        if inputs is None:
            raise InputError("--source inputs: expected --inputs FILE.toml, the analog channels")
        return open_inputs(inputs)
    raise InputError(f"--source: expected virtual, csv or inputs, got {kind!r}")
