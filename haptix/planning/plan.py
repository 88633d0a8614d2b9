"""Plan of a scene's surface: measured, decided, and kept with the surface."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import prod
from typing import Any

import torch

from haptix.contact import shown_accuracy
from haptix.errors import InputError, ToleranceError
from haptix.fidelity import FIDELITIES, Ability
from haptix.friction import ContactModel
from haptix.friction.placeholders import largest_spread
from haptix.perception import WEBER_FRACTION
from haptix.planning.choices import (
    Choice,
    Kind,
    Omission,
    friction_terms,
    omissions,
    reporting_terms,
)
from haptix.planning.decisions import (
    MODELLING_SHARE,
    decide_report,
    effect_alone,
    spend,
    with_overrides,
)
from haptix.planning.effects import Effect, Trials
from haptix.planning.grid import estimated_nodes
from haptix.planning.materials import decide_materials
from haptix.scene import Scene
from haptix.surface import LARGEST_BYTES, FrictionSurface
from haptix.surface.axes import AXIS_NAMES
from haptix.surface.tolerance import LEAST, Tolerance
from haptix.terms import TERMS
from haptix.texture import Evaluator

_UNSEEN = 1.25  # between the points measured, effects may be larger by this factor


@dataclass(frozen=True)
class Row:
    """One thing that a model can leave out."""

    kind: Kind
    name: str
    """Name of what would be left out."""
    kept: bool
    why: str
    effect: Effect
    """Effect of leaving out this alone."""
    time_saved_s: float = 0.0
    """Saved by leaving it out; time and memory are 0 where it is kept."""
    memory_saved_bytes: int = 0
    savings: str = "none"
    """"measured" on the scene's points, "estimated" from the axes' nodes, or "none"."""


@dataclass(frozen=True)
class Plan:
    """Plan of the surface for a scene: model, ranges and accuracy, with the reasons."""

    scene: Scene
    rows: tuple[Row, ...]
    """Terms, axes, fidelity and dtype; of materials, what they depend on."""
    model: ContactModel
    ranges: Mapping[str, tuple[float, float]]
    """For `FrictionSurface.build`; both ends of a collapsed axis are its middle."""
    tolerance: Tolerance
    """Largest error of the surface against `model`."""
    dtype: torch.dtype
    """Precision of the surface."""
    effect: Effect
    """Joint effect of everything that is left out."""
    points: int
    """States at which effects were measured."""
    nodes: Mapping[str, int]
    """Estimated nodes of each axis."""
    placeholder_spread_jnd: Mapping[str, float]
    """Largest difference that others in place of unmeasured values make, at the same states."""
    pull_past_breakdown: float
    """Largest share of the attraction that comes from gaps past what they bear."""
    lowest_x: float
    """Lowest ``p0/(E* slope)`` of the scene."""
    accuracy: str
    """Errors that the theory was shown to have there, see `haptix.contact.shown_accuracy`."""
    materials: tuple[Evaluator, ...]
    """Of each material of the scene, without what of its dependence was dropped."""
    warnings: tuple[str, ...]
    """Where the scene lies below what was validated, see `ContactState.warnings`."""

    def record(self) -> dict[str, Any]:
        """Return the decisions as plain values, to be stored in the surface.

        They hold no times, and no materials, on which the surface does not depend: the same scene
        has the same record, and its surface the same bytes.
        """
        return {
            "scene": self.scene.name,
            "budget_thresholds": self.scene.budget_thresholds,
            "left_out_thresholds": self.effect.thresholds_max,
            "left_out_mu": self.effect.mu_max,
            "tolerance": str(self.tolerance),
            "dtype": str(self.dtype).removeprefix("torch."),
            "points": self.points,
            "pull_past_breakdown": self.pull_past_breakdown,
            "lowest_x": self.lowest_x,
            "accuracy": self.accuracy,
            "warnings": list(self.warnings),
            "rows": [
                {
                    "kind": row.kind,
                    "name": row.name,
                    "decision": "kept" if row.kept else "dropped",
                    "why": row.why,
                    "effect_mu": row.effect.mu_max,
                    "effect_thresholds": row.effect.thresholds_max,
                }
                for row in self.rows
                if row.kind != "material"
            ],
        }

    def build(
        self,
        on_progress: Callable[[float], None] | None = None,
        tolerance: Tolerance | float | str | None = None,
        largest_bytes: int = LARGEST_BYTES,
    ) -> FrictionSurface:
        """Build the planned surface, with the decisions in ``info["notes"]["plan"]``.

        Parameters
        ----------
        on_progress : callable, optional
            Called with the share of the work that is done.
        tolerance : Tolerance, float or str, optional
            Tolerance instead of the planned one.
        largest_bytes : int
            Largest size of the surface.

        Raises
        ------
        InputError, ToleranceError
            As `FrictionSurface.build` does.
        """
        try:
            surface = FrictionSurface.build(
                self.model,
                self.ranges,
                self.tolerance if tolerance is None else tolerance,
                on_progress,
                largest_bytes,
                {
                    "plan": self.record(),
                    "placeholder_spread_jnd": dict(self.placeholder_spread_jnd),
                },
            )
        except ToleranceError as error:
            if error.best is not None:
                error.best = error.best.to(self.dtype)
            raise
        return surface.to(self.dtype)


def plan_scene(
    scene: Scene, on_progress: Callable[[float], None] = lambda share: None, points: int = 300
) -> Plan:
    """Decide what a scene's surface needs.

    Each thing that can be left out is switched off alone, at the same seeded points of the scene,
    and its effect on friction is measured. Then things are dropped one by one. Those that cost
    little for the work they save come first. After each, the joint effect of all that is dropped
    must stay within the share of the budget given to modelling. A larger budget never keeps more.
    Overrides of the scene are applied first and cost no budget.

    Parameters
    ----------
    scene : Scene
        The scene.
    on_progress : callable
        Called with the share of the work that is done.
    points : int
        Random states, beside the corners of the scene.

    Raises
    ------
    InputError
        If an override contradicts the scene, or the drive is not a sine.
    """
    given = scene.override.tolerance
    asked = None if given is None else Tolerance.read(given)
    if asked is None:
        _surface_tolerance(scene, scene.budget_thresholds)  # what it would be at best
    everything = omissions(scene)
    base, settled = with_overrides(scene, everything)
    trials = Trials(scene, base, points)
    on_progress(0.1)
    effects: dict[Omission, Effect] = {}
    for number, omission in enumerate(everything, start=1):
        effects[omission] = effect_alone(scene, trials, base, omission)
        on_progress(0.1 + 0.6 * number / len(everything))
    free = [one for one in everything if one not in settled]
    chosen, joint, decisions = spend(scene, trials, base, free, effects)
    on_progress(0.8)
    decisions = {**settled, **decisions}
    rest = scene.budget_thresholds - _UNSEEN * joint.thresholds_max
    tolerance = asked or _surface_tolerance(scene, rest)
    nodes = estimated_nodes(trials, chosen, _in_jnd(tolerance, trials, chosen))
    on_progress(0.9)
    rows = []
    for one, effect in effects.items():
        kept, why = decisions[one].kept, decisions[one].why
        saved = () if kept else _saved(one, trials, chosen, nodes)
        rows.append(Row(one.kind, one.name, kept, why, effect, *saved))
    for term in reporting_terms(scene):
        decision = decide_report(scene, trials, chosen, term)
        rows.append(Row("term", term.name, decision.kept, decision.why, Effect()))
    rows += _fixed_rows(scene)
    order = {name: rank for rank, name in enumerate((*TERMS, *AXIS_NAMES))}
    rows.sort(key=lambda row: order.get(row.name, len(order)))
    model, asked_for = trials.model(chosen), scene.override.fidelity
    if asked_for is not None and Ability.TABULATE not in FIDELITIES[asked_for].can:
        model = scene.model(asked_for, model.dtype, terms=model.terms)
    lightest = trials.model(chosen).solve(
        scene.normal_force_n[0], 0.0, scene.ranges()["frequency_hz"][0]
    )
    spare = scene.budget_thresholds * MODELLING_SHARE - joint.thresholds_max
    decided, materials = decide_materials(scene, trials.model(chosen), max(spare, 0.0))
    rows += [Row("material", one.name, one.kept, one.why, one.effect) for one in decided]
    plan = Plan(
        scene=scene,
        rows=tuple(rows),
        model=model,
        ranges={**scene.ranges(), **{name: (value, value) for name, value in chosen.held}},
        tolerance=tolerance,
        dtype=getattr(torch, chosen.dtype),
        effect=joint,
        points=len(trials.voltage_v),
        nodes=nodes,
        placeholder_spread_jnd=largest_spread(
            trials.model(base), trials.points.places, trials.voltage_v
        ),
        pull_past_breakdown=trials.pull_past_breakdown(chosen),
        lowest_x=float(lightest.x),
        accuracy=shown_accuracy(model.theory, float(lightest.x)),
        materials=materials,
        warnings=tuple(lightest.warnings()),
    )
    on_progress(1.0)
    return plan


def _surface_tolerance(scene: Scene, rest: float) -> Tolerance:
    """Return what is left of the budget for the surface; say of the budget that it is too small."""
    if rest < LEAST["JND"]:
        raise InputError(
            f"budget_thresholds: expected a budget that leaves the surface {LEAST['JND']:g} JND, "
            f"since the model is no more exact, got {scene.budget_thresholds:g} JND"
        )
    return Tolerance(rest, "JND")


def _in_jnd(tolerance: Tolerance, trials: Trials, chosen: Choice) -> float:
    if tolerance.unit == "JND":
        return tolerance.value
    mu = trials.friction(chosen, trials.points, trials.voltage_v)
    unit = tolerance.unit_in_mu(mu, float(mu.min()), float(mu.max()))
    return float((tolerance.value * unit / (WEBER_FRACTION * mu)).min())


def _saved(
    one: Omission, trials: Trials, chosen: Choice, nodes: Mapping[str, int]
) -> tuple[float, int, str]:
    """Time [s], memory [bytes] and kind of the savings of something left out, see `Row`."""
    count = prod(nodes.values())
    each = trials.seconds_per_state(chosen)
    if one.kind == "axis":
        # At the tolerance that the other axes have.
        budget = trials.scene.budget_thresholds
        needed = estimated_nodes(trials, one.into(chosen), budget)[one.name]
        more = prod({**nodes, one.name: needed}.values()) - count
        return more * each, more * (4 if chosen.dtype == "float32" else 8), "estimated"
    if one.kind == "dtype":
        return 0.0, 4 * count, "estimated"
    if one.kind == "fidelity":
        full = Choice(friction_terms(trials.scene))
        tables_s = trials.seconds_to_prepare(full) - trials.seconds_to_prepare(chosen)
    elif one.name in trials.scene.terms(chosen.fidelity):
        full, tables_s = one.into(chosen), 0.0
    else:
        return 0.0, 0, "none"
    return max(0.0, tables_s + count * (trials.seconds_per_state(full) - each)), 0, "measured"


def _fixed_rows(scene: Scene) -> list[Row]:
    """Rows that the scene itself decides: single values, and terms whose fields are missing."""
    rows = []
    ranges = scene.ranges()
    for name in AXIS_NAMES:
        low, high = ranges[name]
        if low == high:
            rows.append(Row("axis", name, False, f"one value: {low:g}", Effect()))
        elif name == "normal_force_n":
            rows.append(Row("axis", name, True, "friction is asked for by force", Effect()))
    for name in sorted(set(TERMS) - scene.possible_terms()):
        fields = ", ".join(TERMS[name].missing(scene.finger, scene.screen))
        rows.append(Row("term", name, False, f"{fields} not given", Effect()))
    return rows
