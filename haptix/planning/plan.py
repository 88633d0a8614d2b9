"""What a scene requires: measured, decided, and kept with the surface."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import torch

from haptix.errors import ToleranceError
from haptix.fidelity import FIDELITIES, Ability
from haptix.friction import ContactModel
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
    Decision,
    decide_report,
    effect_alone,
    spend,
    with_overrides,
)
from haptix.planning.effects import Effect, Trials
from haptix.planning.grid import estimated_nodes, values
from haptix.scene import Scene
from haptix.surface import LARGEST_BYTES, FrictionSurface
from haptix.surface.axes import AXIS_NAMES
from haptix.surface.tolerance import Tolerance
from haptix.terms import TERMS

_UNSEEN = 1.25  # between the points measured, what is left out may do this much more


@dataclass(frozen=True)
class Row:
    """One thing that a model can do without.

    Parameters
    ----------
    kind, name : str
        "term", "axis", "fidelity" or "dtype"; the name is that of what would be lost.
    kept : bool
        Whether the plan has it.
    why : str
        The reason, in words.
    effect : Effect
        What friction would lose without it, all else being there.
    time_saved_s, memory_saved_bytes : float, int
        What the plan's surface gains by not having it; 0 where it is kept.
    savings : {"measured", "estimated", "none"}
        Whether the time saved was timed on the scene's points, or follows from the nodes that the
        axes are estimated to need.
    """

    kind: Kind
    name: str
    kept: bool
    why: str
    effect: Effect
    time_saved_s: float = 0.0
    memory_saved_bytes: int = 0
    savings: str = "none"

    @property
    def effect_mu(self) -> float:
        """Largest effect in mu."""
        return self.effect.mu_max

    @property
    def effect_thresholds(self) -> float:
        """Largest effect in just-noticeable differences (JND)."""
        return self.effect.thresholds_max


@dataclass(frozen=True)
class Plan:
    """What to build for a scene.

    Parameters
    ----------
    scene : Scene
        For this.
    rows : tuple of Row
        Terms, axes, fidelity and dtype.
    model : ContactModel
        To build from.
    ranges : mapping
        For `FrictionSurface.build`; a collapsed axis has its middle twice.
    tolerance : Tolerance
        Of the surface against `model`.
    dtype : torch.dtype
        In which the surface is to be kept.
    effect : Effect
        Of everything that is left out together.
    points : int
        States at which effects were measured.
    nodes : mapping of str to int
        Estimated nodes of each axis.
    """

    scene: Scene
    rows: tuple[Row, ...]
    model: ContactModel
    ranges: Mapping[str, tuple[float, float]]
    tolerance: Tolerance
    dtype: torch.dtype
    effect: Effect
    points: int
    nodes: Mapping[str, int]

    def record(self) -> dict[str, Any]:
        """Return the decision as plain values, to be stored in the surface.

        Without times: the same scene has the same record, and its surface the same bytes.
        """
        return {
            "scene": self.scene.name,
            "budget_thresholds": self.scene.budget_thresholds,
            "left_out_thresholds": self.effect.thresholds_max,
            "left_out_mu": self.effect.mu_max,
            "tolerance": str(self.tolerance),
            "dtype": str(self.dtype).removeprefix("torch."),
            "points": self.points,
            "rows": [
                {
                    "kind": row.kind,
                    "name": row.name,
                    "decision": "kept" if row.kept else "dropped",
                    "why": row.why,
                    "effect_mu": row.effect_mu,
                    "effect_thresholds": row.effect_thresholds,
                }
                for row in self.rows
            ],
        }

    def build(
        self,
        on_progress: Callable[[float], None] | None = None,
        tolerance: Tolerance | float | str | None = None,
        largest_bytes: int = LARGEST_BYTES,
    ) -> FrictionSurface:
        """Build just that, with the decision in ``info["notes"]["plan"]``.

        Parameters
        ----------
        on_progress : callable, optional
            Called with the share of the work that is done.
        tolerance : Tolerance, float or str, optional
            Instead of the planned one.
        largest_bytes : int
            Size that the surface may have.

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
                {"plan": self.record()},
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

    Each thing that can be left out is switched off, at the same seeded points of the scene, and
    what that does to friction is measured. Then things are dropped, those first that cost little
    for the work they save, and for each the effect of all that is dropped is measured again: it
    must stay within the share of the budget given to modelling. A larger budget never keeps more.
    What the scene overrides is decided and takes nothing of the budget: the rest is measured with
    it in force.

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
        If an override contradicts the scene, or the drive is no sine.
    """
    asked = scene.override.tolerance
    given = None if asked is None else Tolerance.read(asked)
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
    tolerance = given or Tolerance(rest, "JND")
    nodes = estimated_nodes(trials, chosen, _in_thresholds(tolerance, trials, chosen))
    on_progress(0.9)
    rows = [_row(one, decisions[one], effects[one], trials, chosen, nodes) for one in everything]
    for term in reporting_terms(scene):
        decision = decide_report(scene, trials, chosen, term)
        rows.append(Row("term", term.name, decision.kept, decision.why, Effect()))
    rows += _fixed_rows(scene)
    order = {name: rank for rank, name in enumerate((*TERMS, *AXIS_NAMES))}
    rows.sort(key=lambda row: order.get(row.name, len(order)))
    plan = Plan(
        scene=scene,
        rows=tuple(rows),
        model=_model(scene, trials.model(chosen)),
        ranges={**scene.ranges(), **{name: (value, value) for name, value in chosen.held}},
        tolerance=tolerance,
        dtype=getattr(torch, chosen.dtype),
        effect=joint,
        points=len(trials.voltage_v),
        nodes=nodes,
    )
    on_progress(1.0)
    return plan


def _model(scene: Scene, planned: ContactModel) -> ContactModel:
    """The planned model, or one of its terms by a fidelity that cannot be tabulated."""
    asked = scene.override.fidelity
    if asked is None or Ability.TABULATE in FIDELITIES[asked].can:
        return planned
    return scene.model(asked, planned.dtype, terms=planned.terms)


def _in_thresholds(tolerance: Tolerance, trials: Trials, chosen: Choice) -> float:
    if tolerance.unit == "JND":
        return tolerance.value
    mu = trials.friction(chosen, trials.points, trials.voltage_v)
    unit = tolerance.unit_in_mu(mu, float(mu.min()), float(mu.max()))
    return float((tolerance.value * unit / (WEBER_FRACTION * mu)).min())


def _row(
    one: Omission,
    decision: Decision,
    effect: Effect,
    trials: Trials,
    chosen: Choice,
    nodes: Mapping[str, int],
) -> Row:
    saved = (0.0, 0, "none") if decision.kept else _saved(one, trials, chosen, nodes)
    return Row(one.kind, one.name, decision.kept, decision.why, effect, *saved)


def _saved(
    one: Omission, trials: Trials, chosen: Choice, nodes: Mapping[str, int]
) -> tuple[float, int, str]:
    """Time [s] and bytes that a surface saves without one thing, and how they are known."""
    count = values(nodes)
    if one.kind == "dtype":
        return 0.0, 4 * count, "estimated"
    each = trials.seconds_per_state(chosen)
    if one.kind == "axis":
        # With the nodes that it would have needed, at the tolerance that the others have.
        budget = trials.scene.budget_thresholds
        needed = estimated_nodes(trials, one.into(chosen), budget)[one.name]
        more = values({**nodes, one.name: needed}) - count
        return more * each, more * (4 if chosen.dtype == "float32" else 8), "estimated"
    if one.kind == "fidelity":
        full = Choice(friction_terms(trials.scene))
        prepared = trials.seconds_to_prepare(full) - trials.seconds_to_prepare(chosen)
    elif one.name in trials.scene.possible_terms(chosen.fidelity):
        full, prepared = Choice(chosen.terms | {one.name}, chosen.fidelity), 0.0
    else:
        return 0.0, 0, "none"
    saved = prepared + count * (trials.seconds_per_state(full) - each)
    return max(0.0, saved), 0, "measured"


def _fixed_rows(scene: Scene) -> list[Row]:
    """Rows of what the scene itself decides: single values, and what is not given."""
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
