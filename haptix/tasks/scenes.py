"""Tasks of scenes: the effect of each part of the model, and the costs of a surface."""

from __future__ import annotations

from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Annotated

from pydantic import Field

from haptix.desk import Context, Result, Task
from haptix.fields import Argument, FileThere, Folder
from haptix.report import record
from haptix.terminal import breakdown_note, placeholder_note, warning_note

_STAGES = {
    "run": "build, query and invert",
    "measure": "solve boundary elements",
    "write": "write tables and plot",
}


class PlanScene(Task, command="plan"):
    """Measure the effect of each part of the model in a scene, and drop what its budget allows.

    An effect is the largest over points of the scene, in friction coefficient and in
    just-noticeable differences (JND). A cost is the time that it adds to the contact's table and
    2,000 states.
    """

    scene: Annotated[FileThere, Argument] = Field(description="Scene: a TOML file.")

    def run(self, context: Context) -> Result:
        """Plan it."""
        context.progress("plan the scene", 0.0)  # the bar appears before torch loads, for seconds
        from haptix.pair import described, first_line
        from haptix.planning import plan_scene
        from haptix.scene import Scene

        plan = plan_scene(Scene.load(self.scene), partial(context.progress, "plan the scene"))
        dtype = str(plan.dtype).removeprefix("torch.")
        about = described(plan.model.finger, plan.model.screen)
        title = (
            f"{first_line(about)}\n{plan.scene.name}: {plan.model.fidelity}, {dtype}, "
            f"tolerance {plan.tolerance.value:.3g} {plan.tolerance.unit}; left out "
            f"{plan.effect.jnd_max:.2g} of {plan.scene.budget_jnd:g} JND"
        )
        title += f"; x = p0/(E* slope) from {plan.lowest_x:.2g}; {plan.accuracy}"
        title += warning_note(plan.warnings)
        title += placeholder_note(plan.model.placeholders(), plan.placeholder_spread_jnd)
        title += breakdown_note(plan.pull_past_breakdown)
        spread = {"placeholder_spread_jnd": dict(plan.placeholder_spread_jnd)}
        document = []
        for row in plan.rows:
            effect = {f"effect_{name}": value for name, value in asdict(row.effect).items()}
            document.append({**row.decision, **effect, "cost_s": row.cost_s, **spread, **about})
        return Result(document, [(title, plan.rows)])


class TradeOff(Task, command="tradeoff", route="tradeoffs", keeps="results"):
    """Measure error, build time, query time and memory of many ways to build a scene's surface.

    Writes tradeoff.csv, tradeoff.json and tradeoff.png.
    """

    scene: Annotated[FileThere, Argument] | None = Field(
        None, description="Scene: a TOML file. [default: one that is built in]"
    )
    out: Folder = Field(Path("haptix-tradeoff"), description="Folder for the outputs.")
    quick: bool = Field(False, description="Few runs and short timings.")
    boundary_elements: bool = Field(
        False, description="Also measure a surface that boundary elements correct; takes minutes."
    )

    def run(self, context: Context) -> Result:
        """Measure, and write the files."""
        context.progress(_STAGES["run"], 0.0)
        from haptix.pair import described, first_line
        from haptix.scene import Scene
        from haptix.tradeoff import default_scene, write_tradeoff

        scene = default_scene() if self.scene is None else Scene.load(self.scene)
        study = write_tradeoff(
            scene,
            (context.folder or Path()) / self.out,
            self.quick,
            lambda stage, share: context.progress(_STAGES[stage], share),
            self.boundary_elements,
        )
        first = first_line(described(scene.finger, scene.screen))
        title = (
            f"{first}\nhaptix tradeoff: what to take; all {len(study.runs)} runs and the picture "
            f"in {self.out}; budget {scene.budget_jnd:g} JND"
        )
        return Result(record(study.runs), [(title, [run for run in study.runs if run.take])])
