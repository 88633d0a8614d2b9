"""``haptix build``, ``query`` and ``invert``."""

from __future__ import annotations

import sys
from collections.abc import Callable
from functools import partial
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from haptix.arguments import (
    Check,
    file_to_write,
    is_there,
    number,
    numbers,
    one_of,
    preset_or_file,
    read_numbers,
    read_pair,
    refuse_input,
    some_of,
)
from haptix.errors import InputError, LimitError, ToleranceError
from haptix.files import reading
from haptix.presets import FINGERS, SCREENS, TERMS
from haptix.terminal import (
    AsJson,
    accuracy_note,
    breakdown_note,
    placeholder_note,
    progress_bar,
    show,
    warning_note,
)

if TYPE_CHECKING:
    from haptix.friction import ContactModel
    from haptix.surface import FrictionSurface

Finger = Annotated[
    str,
    typer.Option(
        help="Finger: a preset (dry, semi-wet, wet) or a TOML file.",
        callback=preset_or_file("finger", FINGERS),
    ),
]
Screen = Annotated[
    str,
    typer.Option(
        help="Screen: a preset (3m-sct3250) or a TOML file.",
        callback=preset_or_file("screen", SCREENS),
    ),
]
Fidelity = Annotated[
    str,
    typer.Option(
        help="mean-field; closed-form: faster and coarser; boundary-element: the reference, slow.",
        callback=one_of("mean-field", "closed-form", "boundary-element"),
    ),
]
Theory = Annotated[
    str | None,
    typer.Option(
        help="Mean field: corrected by boundary elements, open-gaps or as-published; tau_f is "
        "carried over. [default: the finger's]",
        callback=one_of("corrected", "open-gaps", "as-published"),
    ),
]
Skin = Annotated[
    str | None,
    typer.Option(
        help="Skin dielectric: order-of-magnitude, gabriel-dry or gabriel-wet. [default: the "
        "finger's own]",
        callback=one_of("order-of-magnitude", "gabriel-dry", "gabriel-wet"),
    ),
]
With = Annotated[
    list[str] | None,
    typer.Option(
        "--with",
        help="Switch a term on, such as finite-size; may be repeated.",
        callback=some_of(*TERMS),
    ),
]
Without = Annotated[
    list[str] | None,
    typer.Option("--without", help="Switch a term off; may be repeated.", callback=some_of(*TERMS)),
]
_POSITIVE, _RANGE = numbers(above=0), numbers(above=0, is_range=True)
Force = Annotated[str, typer.Option(help="Normal forces [N], comma-separated.", callback=_POSITIVE)]
Voltage = Annotated[
    str, typer.Option(help="Amplitudes [V], comma-separated.", callback=numbers(least=0))
]
Frequency = Annotated[
    str | None,
    typer.Option(
        help="Drive frequencies [Hz]. Without them the skin is a conductor.", callback=_POSITIVE
    ),
]
Thickness = Annotated[
    str | None,
    typer.Option(
        help="d1/eps1 of the insulator [m]. [default: the screen's own]", callback=_POSITIVE
    ),
]


def _tolerance(value: str | None) -> str | None:
    from haptix.surface.tolerance import Tolerance

    if value is not None:
        try:
            Tolerance.read(value)
        except InputError as error:
            raise InputError(f"--{error}") from None
    return value


def _scene_or_file(option: typer.CallbackParam, value: Path) -> Path:
    check: Check = is_there if value.suffix == ".toml" else file_to_write
    check(option, value)
    return value


# Options of `build` that a scene sets itself.
_IN_A_SCENE = (
    "finger", "screen", "skin_dielectric", "fidelity", "theory", "normal_force_n", "voltage_v",
    "frequency_hz", "h0_m", "with_terms", "without_terms",
)  # fmt: skip


def build(
    context: typer.Context,
    what: Annotated[
        Path,
        typer.Argument(
            metavar="OUT|SCENE.toml",
            help="File to write, such as my.surface; or a scene, whose plan is built.",
            callback=_scene_or_file,
        ),
    ],
    out: Annotated[
        Path | None,
        typer.Option(
            help="File to write for a scene. [default: SCENE.surface]", callback=file_to_write
        ),
    ] = None,
    finger: Finger = "semi-wet",
    screen: Screen = "3m-sct3250",
    skin_dielectric: Skin = None,
    normal_force_n: Annotated[
        str | None,
        typer.Option(
            help="Range of normal force [N]: LOW,HIGH or one value. [default: 0.1,1]",
            callback=_RANGE,
        ),
    ] = None,
    voltage_v: Annotated[
        float | None,
        typer.Option(
            help="Highest amplitude [V]. [default: the screen's limit]", callback=number(above=0)
        ),
    ] = None,
    frequency_hz: Annotated[
        str | None,
        typer.Option(
            help="Drive frequency [Hz]: LOW,HIGH or one. Without it the skin conducts.",
            callback=_RANGE,
        ),
    ] = None,
    h0_m: Annotated[
        str | None,
        typer.Option(help="Range of d1/eps1 [m]. [default: the screen's own]", callback=_RANGE),
    ] = None,
    tolerance: Annotated[
        str | None,
        typer.Option(
            help='Largest error: in mu, "0.05 JND" or "0.2 %" of the range. '
            "[default: 0.002, or the plan's]",
            callback=_tolerance,
        ),
    ] = None,
    largest_mb: Annotated[
        float, typer.Option(help="Size that the surface may have.", callback=number(above=0))
    ] = 64.0,
    accept_best: Annotated[
        bool, typer.Option(help="Write the best of that size, where the tolerance cannot be met.")
    ] = False,
    overwrite: Annotated[bool, typer.Option(help="Replace an existing file.")] = False,
    fidelity: Fidelity = "mean-field",
    theory: Theory = None,
    with_terms: With = None,
    without_terms: Without = None,
    as_json: AsJson = False,
) -> None:
    """Solve the contact model once and write its friction surface.

    Exit code 3: the tolerance cannot be met within the size, and nothing is written unless
    --accept-best.
    """
    scene = what if what.suffix == ".toml" else None
    if scene is None and out is not None:
        raise InputError(f"--out goes with a scene; {what} is the file to write")
    if scene is not None:
        _refuse_beside_a_scene(context)
    target = what if scene is None else out or what.with_suffix(".surface")
    check_writable(target, overwrite)
    refuse_input(target, *_files(scene, finger, screen))
    largest_bytes = int(min(largest_mb, 1e6) * 1e6)
    texts = {"normal_force_n": normal_force_n, "frequency_hz": frequency_hz, "h0_m": h0_m}
    ranges = {
        name: read_pair(_option(name), text) for name, text in texts.items() if text is not None
    }
    if voltage_v is not None:
        ranges["voltage_v"] = (0.0, voltage_v)
    try:
        with progress_bar({"plan": "plan the scene", "build": "build the surface"}) as update:
            on_progress = partial(update, "build")
            if scene is not None:
                from haptix.planning import plan_scene
                from haptix.scene import Scene

                plan = plan_scene(Scene.load(scene), partial(update, "plan"))
                surface = plan.build(on_progress, tolerance, largest_bytes)
            else:
                model = _model(
                    finger, screen, skin_dielectric, fidelity, theory, with_terms, without_terms
                )
                tolerance = tolerance or "0.002"
                surface = _built(model, ranges, tolerance, target, largest_bytes, on_progress)
    except ToleranceError as error:
        if not accept_best or error.best is None:
            sys.stderr.write(f"haptix: {error}; or pass --accept-best\n")
            raise typer.Exit(3) from None
        surface = error.best
    surface.save(target)
    title = f"friction surface{_note(surface, target)}"
    title += breakdown_note(surface.info["pull_past_breakdown"])
    row = _summary(target, surface)
    if as_json:  # the title says it in a table, which has no room for more
        row["pull_past_breakdown"] = surface.info["pull_past_breakdown"]
    show(title, [row], as_json)


def query(
    normal_force_n: Force,
    voltage_v: Voltage,
    frequency_hz: Frequency = None,
    h0_m: Thickness = None,
    surface: Annotated[
        Path | None,
        typer.Option(help="Read this surface instead of solving the model.", callback=is_there),
    ] = None,
    finger: Finger = "semi-wet",
    screen: Screen = "3m-sct3250",
    skin_dielectric: Skin = None,
    fidelity: Fidelity = "mean-field",
    theory: Theory = None,
    with_terms: With = None,
    without_terms: Without = None,
    as_json: AsJson = False,
) -> None:
    """Friction for a force and a voltage, from the model or from a surface."""
    from haptix.contact import shown_accuracy
    from haptix.friction import placeholder_spread
    from haptix.surface import FrictionSurface

    inputs = _product(
        normal_force_n=normal_force_n, voltage_v=voltage_v, frequency_hz=frequency_hz, h0_m=h0_m
    )
    if surface is None:
        model = _model(finger, screen, skin_dielectric, fidelity, theory, with_terms, without_terms)
        state, spread = model.solve(**inputs), placeholder_spread(model, **inputs)
        largest = {name: float(jnd.max()) for name, jnd in spread.items()}
        note = placeholder_note(model.placeholders(), largest)
        outputs: dict[str, Any] = {
            "mu": state.mu,
            "x": state.x,
            "area_fraction": state.area_fraction,
            "attraction_pa": state.attraction_pa,
            "pull_in_voltage_v": state.pull_in_voltage_v,
            "pull_past_breakdown": state.pull_past_breakdown,
        }
        if as_json:
            outputs |= {f"{name.replace(' ', '_')}_spread_jnd": jnd for name, jnd in spread.items()}
        share = float(state.pull_past_breakdown.max())
        status, warnings = state.status, state.warnings()
        x = float(state.x.min())
        note += accuracy_note(x, shown_accuracy(model.theory, x))
    else:
        table = FrictionSurface.load(surface)
        with reading(surface, "a surface with its model"):
            limit = float(table.info["model"]["screen"]["max_voltage_v"])
        highest = float(inputs["voltage_v"].max())
        if highest > limit:
            raise LimitError(
                f"voltage_v: {highest:g} V is above the limit of {limit:g} V of the "
                "surface's screen; lower it (it is rejected, not clamped)"
            )
        sample, note = table.evaluate(**inputs), _note(table, surface)
        outputs, status, warnings = {"mu": sample.mu}, sample.status, []
        # Surfaces of earlier versions do not know.
        share = float(table.info.get("pull_past_breakdown", 0.0))
    title = f"friction at the period's mean attraction{note}"
    title += breakdown_note(share) + warning_note(warnings)
    show(title, _rows(inputs, outputs, status), as_json)


def invert(
    surface: Annotated[
        Path, typer.Argument(help="Surface made by `haptix build`.", callback=is_there)
    ],
    mu: Annotated[
        str, typer.Option(help="Friction coefficients, comma-separated.", callback=numbers())
    ],
    normal_force_n: Force,
    frequency_hz: Frequency = None,
    h0_m: Thickness = None,
    as_json: AsJson = False,
) -> None:
    """Voltage for a friction, with the status of each: OK, BELOW, ABOVE, PULL_IN."""
    from haptix.surface import FrictionSurface

    inputs = _product(mu=mu, normal_force_n=normal_force_n, frequency_hz=frequency_hz, h0_m=h0_m)
    table = FrictionSurface.load(surface)
    found = table.voltage(**inputs)
    title = f"voltage{_note(table, surface)}"
    show(title, _rows(inputs, {"voltage_v": found.voltage_v}, found.status), as_json)


def _files(scene: Path | None, *names: str) -> list[Path]:
    return [*([] if scene is None else [scene]), *(Path(one) for one in names)]


def _option(name: str) -> str:
    return f"--{name.replace('_', '-')}"


def _note(table: FrictionSurface, file: Path) -> str:
    with reading(file, "a surface with its model"):
        placeholders = [str(one) for one in table.info["model"]["placeholders"]]
        # A surface of an earlier version, or one made in Python, does not have it.
        spread = table.info.get("notes", {}).get("placeholder_spread_jnd", {})
        return placeholder_note(placeholders, {str(k): float(v) for k, v in spread.items()})


def check_writable(path: Path, overwrite: bool) -> None:
    """Refuse, before the work, a file that exists or that cannot be made."""
    if path.exists() and not overwrite:
        raise InputError(f"{path} exists: name another file, or pass --overwrite to replace it")
    there = next(above for above in path.absolute().parents if above.exists())
    if path.is_dir() or not there.is_dir():
        raise InputError(f"{path}: expected a file in a folder that can be made")


def _refuse_beside_a_scene(context: typer.Context) -> None:
    given = [
        option.opts[0]
        for option in context.command.params
        if (name := str(option.name)) in _IN_A_SCENE
        and (source := context.get_parameter_source(name))
        and source.name != "DEFAULT"
    ]
    if given:
        raise InputError(
            f"{', '.join(given)}: a scene says this itself; change it there, or in its [override]"
        )


def _built(
    model: ContactModel,
    ranges: dict[str, Any],
    tolerance: str,
    target: Path,
    largest_bytes: int,
    on_progress: Callable[[float], None],
) -> FrictionSurface:
    """Tabulate a model; boundary elements correct the mean field, and resume if interrupted."""
    from haptix.surface import FrictionSurface, MeasuringJob

    if model.boxed is None:
        notes = {"placeholder_spread_jnd": _spread_at_corners(model, ranges)}
        return FrictionSurface.build(model, ranges, tolerance, on_progress, largest_bytes, notes)
    job = MeasuringJob(model, ranges)
    kept = target.with_name(target.name + ".partial.npz")
    target.parent.mkdir(parents=True, exist_ok=True)
    sys.stderr.write(
        f"haptix: {job.states} states of boundary elements, some {job.estimated_seconds():.2g} s; "
        f"an interrupted build resumes from {kept}\n"
    )
    surface = FrictionSurface.measured(job, tolerance, on_progress, largest_bytes, checkpoint=kept)
    kept.unlink(missing_ok=True)
    return surface


def _spread_at_corners(model: ContactModel, ranges: dict[str, Any]) -> dict[str, float]:
    """Largest placeholder spread [JND] at the corners of a surface, at its highest voltage."""
    import torch

    from haptix.friction.placeholders import largest_spread
    from haptix.surface.axes import AXIS_NAMES
    from haptix.surface.request import read_ranges

    whole = read_ranges(model, ranges)
    ends = {name: whole[name] for name in (*AXIS_NAMES, "voltage_v")}
    given = {name: sorted(set(pair)) for name, pair in ends.items() if pair is not None}
    given["voltage_v"] = given["voltage_v"][-1:]
    corners = torch.tensor(list(product(*given.values())), dtype=torch.float64).T
    places = dict(zip(given, corners, strict=True))
    return largest_spread(model, places, places.pop("voltage_v"))


def _summary(path: Path, surface: FrictionSurface) -> dict[str, Any]:
    info = surface.info
    return {
        "file": str(path),
        "grid": " x ".join(str(size) for size in surface.mu_table.shape if size > 1),
        "bytes": path.stat().st_size,
        **{name: info[name] for name in ("mu_low", "mu_high", "error_max", "error_p99")},
        "tolerance": info["tolerance"]["value"],
        "unit": info["tolerance"]["unit"],
        "met": info["tolerance_met"],
    }


def _model(
    finger: str,
    screen: str,
    skin_dielectric: str | None,
    fidelity: str,
    theory: str | None,
    with_terms: list[str] | None,
    without_terms: list[str] | None,
) -> ContactModel:
    from haptix.finger import Finger
    from haptix.friction import ContactModel
    from haptix.screen import Screen

    chosen = Finger.named(finger)
    if skin_dielectric is not None:
        chosen = chosen.replace(dielectric=skin_dielectric)
    return ContactModel(
        chosen,
        Screen.named(screen),
        fidelity=fidelity,  # type: ignore[arg-type]  # checked by the model
        theory=theory,  # type: ignore[arg-type]
        terms=dict.fromkeys(with_terms or [], True) | dict.fromkeys(without_terms or [], False),
    )


def _product(**options: str | None) -> dict[str, Any]:
    """Every combination of the options' numbers, one row each; an option left out stays None."""
    import torch

    given = {
        name: read_numbers(_option(name), text)
        for name, text in options.items()
        if text is not None
    }
    columns = torch.tensor(list(product(*given.values())), dtype=torch.float64).T
    return dict.fromkeys(options) | dict(zip(given, columns, strict=True))


def _rows(inputs: dict[str, Any], outputs: dict[str, Any], status: Any) -> list[dict[str, Any]]:
    from haptix.status import Status

    columns = {name: column for name, column in (inputs | outputs).items() if column is not None}
    return [
        {name: float(column[row]) for name, column in columns.items()}
        | {"status": Status(int(status[row])).name}
        for row in range(len(status))
    ]
