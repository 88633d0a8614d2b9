"""``haptix build``, ``query`` and ``invert``."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from haptix.terminal import AsJson, placeholder_note, progress_bar, show

if TYPE_CHECKING:
    from haptix.friction import ContactModel
    from haptix.surface import FrictionSurface

    Update = Callable[[str, float], None]
    Work = Callable[[Update, int], FrictionSurface]

_DEFAULTS = {
    "finger": "semi-wet",
    "screen": "3m-sct3250",
    "fidelity": "mean-field",
    "theory": "open-gaps",
}

_FINGER_HELP = "Finger: a preset (dry, semi-wet, wet) or a TOML file."
_SCREEN_HELP = "Screen: a preset (3m-sct3250) or a TOML file."
_FIDELITY_HELP = (
    "mean-field; closed-form: faster and coarser; boundary-element: the reference, slow."
)
Finger = Annotated[str, typer.Option(help=_FINGER_HELP)]
Screen = Annotated[str, typer.Option(help=_SCREEN_HELP)]
Fidelity = Annotated[str, typer.Option(help=_FIDELITY_HELP)]
_THEORY_HELP = "Mean field: open-gaps, as-published, or corrected by boundary elements."
Theory = Annotated[str, typer.Option(help=_THEORY_HELP)]
With = Annotated[
    list[str] | None,
    typer.Option("--with", help="Switch a term on, such as finite-size; may be repeated."),
]
Without = Annotated[
    list[str] | None, typer.Option("--without", help="Switch a term off; may be repeated.")
]
Force = Annotated[str, typer.Option(help="Normal forces [N], comma-separated.")]
Voltage = Annotated[str, typer.Option(help="Amplitudes [V], comma-separated.")]
Frequency = Annotated[
    str | None,
    typer.Option(help="Drive frequencies [Hz]; without, the skin counts as a conductor."),
]
Thickness = Annotated[
    str | None, typer.Option(help="d1/eps1 of the insulator [m]. [default: the screen's own]")
]


def build(
    what: Annotated[
        Path,
        typer.Argument(
            metavar="OUT|SCENE.toml",
            help="File to write, such as my.surface; or a scene, whose plan is built.",
        ),
    ],
    out: Annotated[
        Path | None, typer.Option(help="File to write for a scene. [default: SCENE.surface]")
    ] = None,
    finger: Annotated[str | None, typer.Option(help=f"{_FINGER_HELP} [default: semi-wet]")] = None,
    screen: Annotated[
        str | None, typer.Option(help=f"{_SCREEN_HELP} [default: 3m-sct3250]")
    ] = None,
    normal_force_n: Annotated[
        str | None,
        typer.Option(help="Range of normal force [N]: LOW,HIGH or one value. [default: 0.1,1]"),
    ] = None,
    voltage_v: Annotated[
        float | None, typer.Option(help="Highest amplitude [V]. [default: the screen's limit]")
    ] = None,
    frequency_hz: Annotated[
        str | None,
        typer.Option(help="Drive frequency [Hz]: LOW,HIGH or one; without, the skin conducts."),
    ] = None,
    h0_m: Annotated[
        str | None, typer.Option(help="Range of d1/eps1 [m]. [default: the screen's own]")
    ] = None,
    tolerance: Annotated[
        str | None,
        typer.Option(
            help='Largest error: in mu, "0.05 JND" or "0.2 %" of the range. '
            "[default: 0.002, or the plan's]"
        ),
    ] = None,
    largest_mb: Annotated[float, typer.Option(help="Size that the surface may have.")] = 64.0,
    accept_best: Annotated[
        bool, typer.Option(help="Write the best of that size, where the tolerance cannot be met.")
    ] = False,
    overwrite: Annotated[bool, typer.Option(help="Replace an existing file.")] = False,
    fidelity: Annotated[
        str | None, typer.Option(help=f"{_FIDELITY_HELP} [default: mean-field]")
    ] = None,
    theory: Annotated[str | None, typer.Option(help=f"{_THEORY_HELP} [default: open-gaps]")] = None,
    with_terms: With = None,
    without_terms: Without = None,
    as_json: AsJson = False,
) -> None:
    """Solve the contact model once and write its friction surface.

    Exit code 3: the tolerance cannot be met within the size, and nothing is written unless
    --accept-best.
    """
    from haptix.errors import InputError, ToleranceError

    scene = what if what.suffix == ".toml" else None
    if scene is None and out is not None:
        raise InputError(f"--out goes with a scene; {what} is the file to write")
    target = what if scene is None else out or what.with_suffix(".surface")
    _check_writable(target, overwrite)
    if not largest_mb > 0:
        raise InputError(f"--largest-mb: expected a size above 0, got {largest_mb:g}")
    size = int(min(largest_mb, 1e6) * 1e6)
    ranges = {
        "normal-force-n": normal_force_n,
        "voltage-v": None if voltage_v is None else f"0,{voltage_v!r}",
        "frequency-hz": frequency_hz,
        "h0-m": h0_m,
    }
    named = {"finger": finger, "screen": screen, "fidelity": fidelity, "theory": theory}
    if scene is not None:
        _refuse_beside_a_scene({**named, **ranges, "with": with_terms, "without": without_terms})
        work = _planned(scene, tolerance)
    else:
        given = {name: value for name, value in named.items() if value is not None}
        model = _model(**_DEFAULTS | given, with_terms=with_terms, without_terms=without_terms)
        work = _unplanned(model, _ranges(ranges), tolerance or "0.002", target)
    stages = {"plan": "plan the scene", "build": "build the surface"}
    try:
        with progress_bar(stages) as update:
            surface = work(update, size)
    except ToleranceError as error:
        if not accept_best or error.best is None:
            sys.stderr.write(f"haptix: {error}; or pass --accept-best\n")
            raise typer.Exit(3) from None
        surface = error.best
    surface.save(target)
    title = f"friction surface{placeholder_note(surface.info['model']['placeholders'])}"
    show(title, [_summary(target, surface)], as_json)


def query(
    normal_force_n: Force,
    voltage_v: Voltage,
    frequency_hz: Frequency = None,
    h0_m: Thickness = None,
    surface: Annotated[
        Path | None, typer.Option(help="Read this surface instead of solving the model.")
    ] = None,
    finger: Finger = _DEFAULTS["finger"],
    screen: Screen = _DEFAULTS["screen"],
    fidelity: Fidelity = _DEFAULTS["fidelity"],
    theory: Theory = _DEFAULTS["theory"],
    with_terms: With = None,
    without_terms: Without = None,
    as_json: AsJson = False,
) -> None:
    """Friction for a force and a voltage, from the model or from a surface."""
    from haptix.errors import LimitError
    from haptix.surface import FrictionSurface

    inputs = _product(
        normal_force_n=normal_force_n, voltage_v=voltage_v, frequency_hz=frequency_hz, h0_m=h0_m
    )
    if surface is None:
        model = _model(finger, screen, fidelity, theory, with_terms, without_terms)
        state, placeholders = model.solve(**inputs), model.placeholders()
        outputs = {
            "mu": state.mu,
            "area_fraction": state.area_fraction,
            "attraction_pa": state.attraction_pa,
            "pull_in_voltage_v": state.pull_in_voltage_v,
        }
        status = state.status
    else:
        table = FrictionSurface.load(surface)
        limit = table.info["model"]["screen"]["max_voltage_v"]
        highest = float(inputs["voltage_v"].max())
        if highest > limit:
            raise LimitError(
                f"voltage_v: {highest:g} V is above the limit of {limit:g} V of the "
                "surface's screen; lower it (it is rejected, not clamped)"
            )
        sample, placeholders = table.evaluate(**inputs), table.info["model"]["placeholders"]
        outputs, status = {"mu": sample.mu}, sample.status
    show(f"friction{placeholder_note(placeholders)}", _rows(inputs, outputs, status), as_json)


def invert(
    surface: Annotated[Path, typer.Argument(help="Surface made by `haptix build`.")],
    mu: Annotated[str, typer.Option(help="Friction coefficients, comma-separated.")],
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
    title = f"voltage{placeholder_note(table.info['model']['placeholders'])}"
    show(title, _rows(inputs, {"voltage_v": found.voltage_v}, found.status), as_json)


def _check_writable(path: Path, overwrite: bool) -> None:
    from haptix.errors import InputError

    if path.exists() and not overwrite:
        raise InputError(f"{path} exists: name another file, or pass --overwrite to replace it")
    if path.is_dir() or not _makeable(path.absolute().parent):
        raise InputError(f"{path}: expected a file in a folder that can be made")


def _refuse_beside_a_scene(options: dict[str, Any]) -> None:
    from haptix.errors import InputError

    given = [f"--{name}" for name, value in options.items() if value is not None]
    if given:
        raise InputError(
            f"{', '.join(given)}: a scene says this itself; change it there, or in its [override]"
        )


def _planned(scene: Path, tolerance: str | None) -> Work:
    def work(update: Update, largest_bytes: int) -> FrictionSurface:
        from haptix.planning import plan_scene
        from haptix.scene import Scene

        plan = plan_scene(Scene.load(scene), lambda share: update("plan", share))
        asked = plan.tolerance if tolerance is None else tolerance
        return plan.build(lambda share: update("build", share), asked, largest_bytes)

    return work


def _unplanned(model: ContactModel, ranges: dict[str, Any], tolerance: str, target: Path) -> Work:
    from haptix.surface import FrictionSurface

    if model.boxed is not None:
        return _measured(model, ranges, tolerance, target)

    def work(update: Update, largest_bytes: int) -> FrictionSurface:
        return FrictionSurface.build(
            model, ranges, tolerance, lambda share: update("build", share), largest_bytes
        )

    return work


def _measured(model: ContactModel, ranges: dict[str, Any], tolerance: str, target: Path) -> Work:
    """Correct the mean field by boundary elements; an interrupted build resumes."""
    from haptix.surface import FrictionSurface, MeasuringJob

    job = MeasuringJob(model, ranges)
    kept = target.with_name(target.name + ".partial.npz")
    target.parent.mkdir(parents=True, exist_ok=True)
    sys.stderr.write(
        f"haptix: {job.states} states of boundary elements, some {job.estimated_seconds():.2g} s; "
        f"an interrupted build resumes from {kept}\n"
    )

    def work(update: Update, largest_bytes: int) -> FrictionSurface:
        surface = FrictionSurface.measured(
            job, tolerance, lambda share: update("build", share), largest_bytes, checkpoint=kept
        )
        kept.unlink(missing_ok=True)
        return surface

    return work


def _ranges(options: dict[str, str | None]) -> dict[str, Any]:
    from haptix.cli.numbers import read_pair

    return {
        option.replace("-", "_"): read_pair(option, text)
        for option, text in options.items()
        if text is not None
    }


def _summary(path: Path, surface: FrictionSurface) -> dict[str, Any]:
    info = surface.info
    return {
        "file": str(path),
        "grid": " x ".join(str(size) for size in surface.mu_table.shape if size > 1),
        "bytes": path.stat().st_size,
        "mu_low": info["mu_low"],
        "mu_high": info["mu_high"],
        "error_max": info["error_max"],
        "error_p99": info["error_p99"],
        "tolerance": info["tolerance"]["value"],
        "unit": info["tolerance"]["unit"],
        "met": info["tolerance_met"],
    }


def _makeable(folder: Path) -> bool:
    while not folder.exists():
        folder = folder.parent
    return folder.is_dir()


def _model(
    finger: str,
    screen: str,
    fidelity: str,
    theory: str,
    with_terms: list[str] | None,
    without_terms: list[str] | None,
) -> ContactModel:
    from haptix.finger import Finger
    from haptix.friction import ContactModel
    from haptix.screen import Screen

    return ContactModel(
        Finger.named(finger),
        Screen.named(screen),
        fidelity=fidelity,  # type: ignore[arg-type]  # checked by the model
        theory=theory,
        terms=dict.fromkeys(with_terms or [], True) | dict.fromkeys(without_terms or [], False),
    )


def _product(**options: str | None) -> dict[str, Any]:
    """Every combination of the options' numbers, one row each; an option left out stays None."""
    import torch

    from haptix.cli.numbers import read_numbers

    given = {
        name: torch.tensor(read_numbers(name.replace("_", "-"), text), dtype=torch.float64)
        for name, text in options.items()
        if text is not None
    }
    grids = torch.meshgrid(*given.values(), indexing="ij")
    rows = {name: grid.reshape(-1) for name, grid in zip(given, grids, strict=True)}
    return {name: rows.get(name) for name in options}


def _rows(inputs: dict[str, Any], outputs: dict[str, Any], status: Any) -> list[dict[str, Any]]:
    from haptix.status import Status

    columns = {name: column for name, column in (inputs | outputs).items() if column is not None}
    return [
        {name: float(column[row]) for name, column in columns.items()}
        | {"status": Status(int(status[row])).name}
        for row in range(len(status))
    ]
