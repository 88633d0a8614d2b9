"""``haptix plan`` and ``tradeoff``."""

from __future__ import annotations

from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from haptix.desk import argument, option
from haptix.fields import FileThere, Folder
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
    from haptix.planning import Plan

_TRADEOFF_STAGES = {
    "run": "build, query and invert",
    "measure": "solve boundary elements",
    "write": "write tables and plot",
}


def plan(
    scene: Annotated[Path, argument("Scene: a TOML file.", FileThere)],
    as_json: AsJson = False,
) -> None:
    """Measure what each part of the model does in a scene, and drop what its budget allows.

    An effect is the largest over points of the scene, in friction coefficient and in
    just-noticeable differences (JND). A cost is the time that it adds to the contact's table and
    2,000 states.
    """
    with progress_bar({"plan": "plan the scene"}) as update:
        # torch loads here; the bar shows those seconds too.
        update("plan", 0.0)
        from haptix.planning import plan_scene
        from haptix.scene import Scene

        found = plan_scene(Scene.load(scene), partial(update, "plan"))
    dtype = str(found.dtype).removeprefix("torch.")
    title = (
        f"{found.scene.name}: {found.model.fidelity}, {dtype}, "
        f"tolerance {found.tolerance.value:.3g} {found.tolerance.unit}; left out "
        f"{found.effect.thresholds_max:.2g} of {found.scene.budget_thresholds:g} JND"
    )
    title += accuracy_note(found.lowest_x, found.accuracy) + warning_note(found.warnings)
    title += placeholder_note(found.model.placeholders(), found.placeholder_spread_jnd)
    title += breakdown_note(found.pull_past_breakdown)
    show(title, _full_rows(found) if as_json else _rows(found), as_json)


def _rows(plan: Plan) -> list[dict[str, Any]]:
    return [
        {
            "": row.name,
            "decision": "kept" if row.kept else "dropped",
            "mu": f"{row.effect.mu_max:.2g}",
            "JND": f"{row.effect.thresholds_max:.2g}",
            "costs": f"{row.cost_s * 1e3:.2g} ms" if row.cost_s else "-",
            "why": row.why,
        }
        for row in plan.rows
    ]


def _full_rows(plan: Plan) -> list[dict[str, Any]]:
    return [
        {
            "kind": row.kind,
            "name": row.name,
            "decision": "kept" if row.kept else "dropped",
            "why": row.why,
            **{f"effect_{name}": value for name, value in asdict(row.effect).items()},
            "cost_s": row.cost_s,
            "placeholder_spread_jnd": dict(plan.placeholder_spread_jnd),
        }
        for row in plan.rows
    ]


def tradeoff(
    scene: Annotated[
        Path | None, argument("Scene: a TOML file. [default: one that is built in]", FileThere)
    ] = None,
    out: Annotated[Path, option("Folder for the outputs.", Folder)] = Path("haptix-tradeoff"),
    quick: Annotated[bool, typer.Option("--quick", help="Few runs and short timings.")] = False,
    boundary_elements: Annotated[
        bool,
        typer.Option("--boundary-elements", help="Also a surface that they correct: minutes."),
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Measure error, build time, query time and memory of many ways to build a scene's surface.

    Writes tradeoff.csv, tradeoff.json and tradeoff.png.
    """
    with progress_bar(_TRADEOFF_STAGES) as update:
        update("run", 0.0)
        from haptix.scene import Scene
        from haptix.tradeoff import default_scene, write_tradeoff

        chosen = default_scene() if scene is None else Scene.load(scene)
        found = write_tradeoff(chosen, out, quick, update, boundary_elements)
    shown = found.runs if as_json else [run for run in found.runs if run.take]
    title = (
        f"haptix tradeoff: what to take; all {len(found.runs)} runs and the picture in {out}; "
        f"budget {chosen.budget_thresholds:g} JND"
    )
    show(title, shown, as_json)
