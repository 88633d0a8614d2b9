"""Decide what to leave out: first the scene's overrides, then as much as its budget allows."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import inf

from haptix.fidelity import FIDELITIES
from haptix.planning.choices import COARSE, FULL, Choice, Omission, friction_terms, kept_reports
from haptix.planning.effects import Effect, Trials
from haptix.scene import Scene
from haptix.status import Status
from haptix.terms import TERMS, Term, chosen_terms

MODELLING_SHARE = 0.5
"""Share of the budget that may go into what is left out; the surface's tolerance gets the rest."""

_OVERREACH = 0.05  # past breakdown, whose "about 350 V/um" is not known better than that


@dataclass(frozen=True)
class Decision:
    """Whether something is kept, and why."""

    kept: bool
    why: str


def with_overrides(
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
            settled[one] = Decision(kept, f"{'kept' if kept else 'dropped'} by the scene")
            base = base if kept else one.of(base)
        elif one.kind == "term" and TERMS[one.name].left_to_scene:
            settled[one] = Decision(False, "on request, and the scene does not ask for it")
    for one in everything:
        if one.kind == "term" and one.name not in base.terms and one not in settled:
            settled[one] = Decision(False, "contradicts the scene's fidelity")
        if one.kind == "fidelity" and one not in settled:
            needed = (on.keys() & friction_terms(scene)) - one.possible
            if needed:
                names = ", ".join(sorted(needed))
                settled[one] = Decision(True, f"needed by {names}, kept by the scene")
    return base, settled


def _overridden(scene: Scene, one: Omission) -> bool | None:
    """Return the scene's decision on one thing: True to keep it, None without one."""
    override = scene.override
    if one.kind == "term":
        return override.terms.get(one.name)
    if one.kind == "axis":
        asked = override.axes.get(one.name)
        return None if asked is None else asked == "keep"
    if one.kind == "dtype":
        return None if override.dtype is None else override.dtype == one.name
    # A fidelity that cannot be tabulated corrects a surface of the full one.
    return None if override.fidelity is None else override.fidelity != COARSE


def effect_alone(scene: Scene, trials: Trials, base: Choice, one: Omission) -> Effect:
    """Effect of leaving out one thing, all else being as in `base`."""
    without = one.of(base)
    if without != base:
        return trials.effect(base, without)
    # An override has left it out already.
    if one.kind == "term" and one.name not in scene.possible_terms(base.fidelity):
        return Effect()
    return trials.effect(one.into(base), base)


def spend(
    scene: Scene,
    trials: Trials,
    base: Choice,
    free: list[Omission],
    effects: Mapping[Omission, Effect],
) -> tuple[Choice, Effect, dict[Omission, Decision]]:
    """Drop things while the budget lasts, as if the budget grew from 0.

    A larger budget therefore drops everything that a smaller one drops.
    """
    share = MODELLING_SHARE * scene.budget_thresholds
    chosen, joint = base, Effect()
    decisions: dict[Omission, Decision] = {}
    left = [one for one in free if _price(one, effects[one]) <= share]
    while left:
        together = {one: trials.effect(base, one.of(chosen)) for one in left}
        due = {one: max(_price(one, effects[one]), _cost(together[one])) for one in left}
        nearest = min(left, key=lambda one: due[one])
        if due[nearest] > share:
            break
        left.remove(nearest)
        if nearest.of(chosen) == chosen:
            decisions[nearest] = Decision(False, "not in the coarser fidelity")
            continue
        chosen, joint = nearest.of(chosen), together[nearest]
        why = f"held at {nearest.value:.4g}; " if nearest.kind == "axis" else ""
        if effects[nearest].thresholds_max == 0:
            why += "changes nothing here"
        else:
            why += f"all dropped so far cost {joint.thresholds_max:.2g} JND"
        decisions[nearest] = Decision(False, why)
    for one in free:
        if one not in decisions:
            decisions[one] = Decision(True, _why_kept(one, effects[one], share))
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


def decide_report(scene: Scene, trials: Trials, chosen: Choice, term: Term) -> Decision:
    """Decide on a term that reports a status and changes no friction.

    The surface ends where the term reports only if the scene asks for it. The reason says how near
    the voltages come.
    """
    is_kept = term.name in kept_reports(scene)
    share = trials.share_of_limit(chosen, term)
    why = f"voltages reach {share:.0%} of its voltage"
    if term.reports == Status.BREAKDOWN:
        past = trials.pull_past_breakdown(chosen)
        why += f", {past:.0%} of the attraction is past what gaps bear"
    if term.name in scene.override.terms:
        why = f"{'kept' if is_kept else 'dropped'} by the scene; {why}"
    return Decision(is_kept, why + (": the surface ends there" if is_kept and share >= 1 else ""))
