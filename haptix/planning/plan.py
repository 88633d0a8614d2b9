"""Plan of a scene's surface: measured, decided, and kept with the surface."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import inf
from typing import Any

import torch

from haptix.contact import shown_accuracy
from haptix.errors import InputError, ToleranceError
from haptix.fidelity import FIDELITIES, Ability
from haptix.friction import ContactModel
from haptix.friction.placeholders import largest_spread
from haptix.planning.choices import (
    COARSE,
    FULL,
    Choice,
    Kind,
    Omission,
    friction_terms,
    kept_reports,
    omissions,
    reporting_terms,
)
from haptix.planning.materials import effects_of_materials
from haptix.planning.trials import Effect, Trials
from haptix.scene import Scene
from haptix.status import Status
from haptix.surface import LARGEST_BYTES, FrictionSurface
from haptix.surface.axes import AXIS_NAMES
from haptix.surface.tolerance import LEAST, Tolerance
from haptix.terms import TERMS, Term, chosen_terms

MODELLING_SHARE = 0.5
"""Share of the budget that may go into what is left out; the surface's tolerance gets the rest."""

_OVERREACH = 0.05  # past breakdown, whose "about 350 V/um" is not known better than that
_UNSEEN = 1.25  # between the points measured, effects may be larger by this factor


_NO_EFFECT = Effect()

Decision = tuple[bool, str]
"""Whether something is kept, and why."""


@dataclass(frozen=True)
class Row:
    """One thing that a model can leave out."""

    kind: Kind
    name: str
    """Name of what would be left out."""
    kept: bool
    why: str
    effect: Effect = _NO_EFFECT
    """Effect of leaving out this alone."""
    cost_s: float = 0.0
    """Time that it adds to a table of the contact and 2000 states; of terms and fidelities."""


@dataclass(frozen=True)
class Plan:
    """Plan of the surface for a scene: model, ranges and accuracy, with the reasons."""

    scene: Scene
    rows: tuple[Row, ...]
    """Terms, axes and fidelity; of materials, what they depend on."""
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
    placeholder_spread_jnd: Mapping[str, float]
    """Largest difference that others in place of unmeasured values make, at the same states."""
    pull_past_breakdown: float
    """Largest share of the attraction that comes from gaps past what they bear."""
    lowest_x: float
    """Lowest ``p0/(E* slope)`` of the scene."""
    accuracy: str
    """Errors that the theory was shown to have there, see `haptix.contact.shown_accuracy`."""
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
    and its effect on friction and its time are measured. Then things are dropped one by one, those
    first that cost little for the work they save, while the joint effect of all that is dropped
    stays within the share of the budget given to modelling. A larger budget never keeps more.
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
    base, settled = _with_overrides(scene, everything)
    trials = Trials(scene, base, points)
    on_progress(0.1)
    rows: list[Row] = []
    effects: dict[Omission, Effect] = {}
    for number, omission in enumerate(everything, start=1):
        effects[omission] = _effect_alone(trials, base, omission)
        on_progress(0.1 + 0.7 * number / len(everything))
    free = [one for one in everything if one not in settled]
    chosen, joint, decisions = _spend(trials, base, free, effects)
    decisions |= settled
    for one, effect in effects.items():
        rows.append(Row(one.kind, one.name, *decisions[one], effect, _cost_s(trials, base, one)))
    rows += [_report_row(trials, chosen, term) for term in reporting_terms(scene)]
    rows += _fixed_rows(scene)
    order = {name: rank for rank, name in enumerate((*TERMS, *AXIS_NAMES))}
    rows.sort(key=lambda row: order.get(row.name, len(order)))
    spare = max(0.0, scene.budget_thresholds * MODELLING_SHARE - joint.thresholds_max)
    for name, effect in effects_of_materials(scene, trials.model(chosen)):
        felt = effect.thresholds_max > spare
        why = "felt" if felt else f"not felt: below the {spare:.2g} JND left of the budget"
        rows.append(Row("material", name, felt, why, effect))
    dtype = getattr(torch, scene.override.dtype or "float32")
    model, asked_for = trials.model(chosen, dtype), scene.override.fidelity
    if asked_for is not None and Ability.TABULATE not in FIDELITIES[asked_for].can:
        model = scene.model(asked_for, model.dtype, terms=model.terms)
    lightest = trials.model(chosen).solve(
        scene.normal_force_n[0], 0.0, scene.ranges()["frequency_hz"][0]
    )
    on_progress(1.0)
    return Plan(
        scene=scene,
        rows=tuple(rows),
        model=model,
        ranges={**scene.ranges(), **{name: (value, value) for name, value in chosen.held}},
        tolerance=asked
        or _surface_tolerance(scene, scene.budget_thresholds - _UNSEEN * joint.thresholds_max),
        dtype=dtype,
        effect=joint,
        points=len(trials.voltage_v),
        placeholder_spread_jnd=largest_spread(
            trials.model(base), trials.points.places, trials.voltage_v
        ),
        pull_past_breakdown=trials.pull_past_breakdown(chosen),
        lowest_x=float(lightest.x),
        accuracy=shown_accuracy(model.theory, float(lightest.x)),
        warnings=tuple(lightest.warnings()),
    )


def _surface_tolerance(scene: Scene, rest: float) -> Tolerance:
    """Return what is left of the budget for the surface; say of the budget that it is too small."""
    if rest < LEAST["JND"]:
        raise InputError(
            f"budget_thresholds: expected a budget that leaves the surface {LEAST['JND']:g} JND, "
            f"since the model is no more exact, got {scene.budget_thresholds:g} JND"
        )
    return Tolerance(rest, "JND")


def _cost_s(trials: Trials, base: Choice, one: Omission) -> float:
    """Time that a term or a fidelity takes, see `Row.cost_s`."""
    if one.kind not in ("term", "fidelity"):
        return 0.0
    if one.kind == "term" and one.name not in trials.scene.terms(base.fidelity):
        return 0.0
    full = one.into(base) if one.kind == "term" else Choice(friction_terms(trials.scene))
    return max(0.0, trials.seconds(full) - trials.seconds(one.of(full)))


def _with_overrides(
    scene: Scene, everything: list[Omission]
) -> tuple[Choice, dict[Omission, Decision]]:
    """Return the model before planning, and the decisions that the scene takes itself."""
    override, fidelity = scene.override, scene.override.fidelity or FULL
    base = Choice(friction_terms(scene, fidelity))
    on = {name: True for name, is_on in override.terms.items() if is_on}
    # Raises where the profiles or the fidelity do not allow it.
    chosen_terms(on, scene.finger, scene.screen, FIDELITIES[fidelity])
    settled: dict[Omission, Decision] = {}
    for one in everything:
        kept = _overridden(scene, one)
        if kept is not None:
            settled[one] = (kept, f"{'kept' if kept else 'dropped'} by the scene")
            base = base if kept else one.of(base)
        elif one.kind == "term" and TERMS[one.name].left_to_scene:
            settled[one] = (False, "on request, and the scene does not ask for it")
    for one in everything:
        if one.kind == "term" and one.name not in base.terms and one not in settled:
            settled[one] = (False, "contradicts the scene's fidelity")
        if one.kind == "fidelity" and one not in settled:
            needed = (on.keys() & friction_terms(scene)) - one.possible
            if needed:
                names = ", ".join(sorted(needed))
                settled[one] = (True, f"needed by {names}, kept by the scene")
    return base, settled


def _overridden(scene: Scene, one: Omission) -> bool | None:
    """Return the scene's decision on one thing: True to keep it, None without one."""
    override = scene.override
    if one.kind == "term":
        return override.terms.get(one.name)
    if one.kind == "axis":
        asked = override.axes.get(one.name)
        return None if asked is None else asked == "keep"
    # A fidelity that cannot be tabulated corrects a surface of the full one.
    return None if override.fidelity is None else override.fidelity != COARSE


def _effect_alone(trials: Trials, base: Choice, one: Omission) -> Effect:
    """Effect of leaving out one thing, all else being as in `base`."""
    without = one.of(base)
    if without != base:
        return trials.effect(base, without)
    # An override has left it out already.
    if one.kind == "term" and one.name not in trials.scene.possible_terms(base.fidelity):
        return _NO_EFFECT
    return trials.effect(one.into(base), base)


def _spend(
    trials: Trials, base: Choice, free: list[Omission], effects: Mapping[Omission, Effect]
) -> tuple[Choice, Effect, dict[Omission, Decision]]:
    """Drop what costs least for the work it saves, until the share for modelling is spent.

    The order does not depend on the budget, so that a larger one drops everything that a smaller
    one drops.
    """
    share = MODELLING_SHARE * trials.scene.budget_thresholds
    chosen, joint = base, _NO_EFFECT
    decisions: dict[Omission, Decision] = {}
    for one in sorted(free, key=lambda one: _price(one, effects[one])):
        if one.of(chosen) == chosen:
            decisions[one] = (False, "not in the coarser fidelity")
            continue
        together = trials.effect(base, one.of(chosen))
        if max(_price(one, effects[one]), _cost(together)) > share:
            break
        chosen, joint = one.of(chosen), together
        why = f"held at {one.value:.4g}; " if one.kind == "axis" else ""
        if effects[one].thresholds_max == 0:
            why += "changes nothing here"
        else:
            why += f"all dropped so far cost {joint.thresholds_max:.2g} JND"
        decisions[one] = (False, why)
    for one in free:
        if one not in decisions:
            decisions[one] = (True, _why_kept(one, effects[one], share))
    return chosen, joint, decisions


def _price(one: Omission, alone: Effect) -> float:
    """Least modelling budget [JND] at which it is dropped: what saves little may cost little."""
    return _cost(alone) / one.work


def _cost(effect: Effect) -> float:
    """Largest effect [JND]; infinite where voltages would go past breakdown."""
    return inf if effect.overreach > _OVERREACH else effect.thresholds_max


def _why_kept(one: Omission, alone: Effect, share: float) -> str:
    if alone.overreach > _OVERREACH:
        return f"without it the surface would end {alone.overreach:.0%} past breakdown"
    if alone.thresholds_max > share:
        return f"matters: more than {share:.2g} JND"
    if _price(one, alone) > share:
        return f"saves too little to cost more than {share * one.work:.2g} JND"
    return f"with what is dropped, more than {share:.2g} JND"


def _report_row(trials: Trials, chosen: Choice, term: Term) -> Row:
    """Decide on a term that reports a status and changes no friction.

    The surface ends where the term reports only if the scene asks for it. The reason says how near
    the voltages come.
    """
    is_kept = term.name in kept_reports(trials.scene)
    share = trials.share_of_limit(chosen, term)
    why = f"voltages reach {share:.0%} of its voltage"
    if term.reports == Status.BREAKDOWN:
        past = trials.pull_past_breakdown(chosen)
        why += f", {past:.0%} of the attraction is past what gaps bear"
    if term.name in trials.scene.override.terms:
        why = f"{'kept' if is_kept else 'dropped'} by the scene; {why}"
    if is_kept and share >= 1:
        why += ": the surface ends there"
    return Row("term", term.name, is_kept, why)


def _fixed_rows(scene: Scene) -> list[Row]:
    """Rows that the scene itself decides: single values, and terms whose fields are missing."""
    rows = []
    ranges = scene.ranges()
    for name in AXIS_NAMES:
        low, high = ranges[name]
        if low == high:
            rows.append(Row("axis", name, False, f"one value: {low:g}"))
        elif name == "normal_force_n":
            rows.append(Row("axis", name, True, "friction is asked for by force"))
    for name in sorted(set(TERMS) - scene.possible_terms()):
        fields = ", ".join(TERMS[name].missing(scene.finger, scene.screen))
        rows.append(Row("term", name, False, f"{fields} not given"))
    return rows
