"""``haptix build``."""

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
    read_pair,
    refuse_input,
)
from haptix.cli.options import Fidelity, Finger, Screen, Skin, Theory, With, Without
from haptix.cli.surfaces import model_of, note_of, option_of
from haptix.errors import InputError, ToleranceError
from haptix.terminal import AsJson, breakdown_note, progress_bar, show

if TYPE_CHECKING:
    from haptix.friction import ContactModel
    from haptix.surface import FrictionSurface

_RANGE = numbers(above=0, is_range=True)


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
        name: read_pair(option_of(name), text) for name, text in texts.items() if text is not None
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
                model = model_of(
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
    title = f"friction surface{note_of(surface, target)}"
    title += breakdown_note(surface.info["pull_past_breakdown"])
    row = _summary(target, surface)
    if as_json:  # the title says it in a table, which has no room for more
        row["pull_past_breakdown"] = surface.info["pull_past_breakdown"]
    show(title, [row], as_json)


def _files(scene: Path | None, *names: str) -> list[Path]:
    return [*([] if scene is None else [scene]), *(Path(one) for one in names)]


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
