"""Planning: model only what a scene requires, with reasons; the surface stores the plan."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
import torch

from haptix.base.checks import Array
from haptix.base.errors import InputError, ToleranceError
from haptix.base.report import Heading, HeadingsOf
from haptix.base.task import Context, Result, Task
from haptix.feel.materials import as_mu
from haptix.feel.materials.material import Material
from haptix.feel.motion import Depends, Motion
from haptix.model.fidelity import FIDELITIES, Ability
from haptix.model.friction import ContactModel
from haptix.model.friction.placeholders import largest_spread
from haptix.model.status import Status, limits_passed
from haptix.model.surface import LARGEST_BYTES, FrictionSurface
from haptix.model.surface.axes import AXIS_NAMES
from haptix.model.surface.tolerance import LEAST, Tolerance
from haptix.model.terms import TERMS, Term, chosen_terms
from haptix.plan.scene import Scene
from haptix.plan.trials import (
    COARSE,
    FULL,
    Choice,
    Effect,
    Kind,
    Omission,
    Trials,
    friction_terms,
    kept_reports,
    omissions,
    reporting_terms,
)

__all__ = ["BuildSurface", "Effect", "Plan", "Row", "holding", "plan_scene"]

MODELLING_SHARE = 0.5
"""Share of the budget for the effect of omissions; the surface's tolerance gets the rest."""

HOLDABLE = (Depends.TIME, Depends.DIRECTION, Depends.SPEED, Depends.FORCE)
"""Variables of a material that can be held: time at 0, direction to the right, speed and force in
the middle of the scene's range."""

Decision = tuple[bool, str]
"""Whether something is kept, and why."""

_UNSEEN = 1.25  # between the measured points, effects may be larger by this factor
_NO_EFFECT = Effect()
_MATERIAL_STATES, _SECONDS, _FORCES = 4000, 10.0, 9
_SPEED_MM_S = (20.0, 200.0)  # if the scene gives none


class BuildSurface(Task):
    """The planned surface of a scene, as ``haptix build SCENE.toml`` makes it."""

    scene: Scene

    def run(self, context: Context) -> Result:
        """Plan the scene, and build its surface."""
        surface = plan_scene(self.scene).build()
        names = ("mu_low", "mu_high", "error_max", "pull_past_breakdown")
        row = {name: surface.info[name] for name in names}
        row |= {"mu_span": row["mu_high"] / row["mu_low"], "surface_bytes": surface.nbytes}
        return Result(row, files={"friction.surface": surface.save})


@dataclass(frozen=True)
class Row:
    """One thing that a model can leave out."""

    kind: Kind
    name: Annotated[str, Heading("")]
    """Name of the thing that would be left out."""
    kept: Annotated[bool, Heading("decision", "dropped|kept")]
    effect: Annotated[Effect, HeadingsOf(("mu_max", "jnd_max", "contrast_jnd"))] = _NO_EFFECT
    """Effect of leaving out this thing alone."""
    cost_s: Annotated[float, Heading("costs [s]", ".2g")] = 0.0
    """Time that it adds to a table of the contact and 2000 states; of terms and fidelities."""
    why: Annotated[str, Heading("why")] = ""
    """The reason."""

    @property
    def decision(self) -> dict[str, Any]:
        """The thing, the decision on it and the reason."""
        decision = "kept" if self.kept else "dropped"
        return {"kind": self.kind, "name": self.name, "decision": decision, "why": self.why}


@dataclass(frozen=True)
class Plan:
    """Plan of the surface for a scene: model, ranges and accuracy, with the reasons."""

    scene: Scene
    rows: tuple[Row, ...]
    """Decisions on terms, axes and fidelity, and on the variables of materials."""
    model: ContactModel
    ranges: Mapping[str, tuple[float, float]]
    """Ranges for `FrictionSurface.build`; both ends of a collapsed axis are its middle."""
    tolerance: Tolerance
    """Largest error of the surface against `model`."""
    dtype: torch.dtype
    """Precision of the surface."""
    effect: Effect
    """Joint effect of everything that is left out."""
    points: int
    """States at which effects were measured."""
    placeholder_spread_jnd: Mapping[str, float]
    """Largest difference that other values in place of unmeasured ones make, at the same states."""
    pull_past_breakdown: float
    """Largest share of the attraction that comes from gaps whose field exceeds what they bear."""
    lowest_x: float
    """Lowest ``p0/(E* slope)`` of the scene."""
    accuracy: str
    """Intervals at the scene's highest drives, see `haptix.model.Accuracy`."""
    warnings: tuple[str, ...]
    """Where the scene lies below the validated range, or its highest voltages past a limit."""

    def record(self) -> dict[str, Any]:
        """Return the decisions as plain values, to be stored in the surface.

        They leave out times and materials, on which the surface does not depend. So the same scene
        gives the same record, and a surface of the same bytes.
        """
        same = ("points", "pull_past_breakdown", "lowest_x", "accuracy")
        return {
            "scene": self.scene.name,
            "budget_jnd": self.scene.budget_jnd,
            "left_out_jnd": self.effect.jnd_max,
            "left_out_mu": self.effect.mu_max,
            "tolerance": str(self.tolerance),
            "dtype": str(self.dtype).removeprefix("torch."),
            **{name: getattr(self, name) for name in same},
            "warnings": list(self.warnings),
            "rows": [
                {**row.decision, "effect_mu": row.effect.mu_max, "effect_jnd": row.effect.jnd_max}
                for row in self.rows
                if row.kind != "material"
            ],
        }

    def build(
        self,
        on_progress: Callable[[float], None] | None = None,
        tolerance: Tolerance | float | str | None = None,
        largest_bytes: int = LARGEST_BYTES,
        past_limits: bool = False,
    ) -> FrictionSurface:
        """Build the planned surface, with the decisions in ``info["notes"]["plan"]``.

        Parameters
        ----------
        on_progress, largest_bytes, past_limits
            As in `FrictionSurface.build`, whose errors are raised, too.
        tolerance : Tolerance, float or str, optional
            As there; by default the planned one.
        """
        spread = {"placeholder_spread_jnd": dict(self.placeholder_spread_jnd)}
        notes = {"plan": self.record(), **spread}
        wanted = self.tolerance if tolerance is None else tolerance
        try:
            surface = FrictionSurface.build(
                self.model, self.ranges, wanted, on_progress, largest_bytes, notes, past_limits
            )
        except ToleranceError as error:
            if error.best is not None:
                error.best = error.best.to(self.dtype)
            raise
        return surface.to(self.dtype)


def plan_scene(
    scene: Scene, on_progress: Callable[[float], None] = lambda share: None, points: int = 300
) -> Plan:
    """Decide on the terms and accuracy of a scene's surface.

    Each thing that can be left out is switched off alone, at the same seeded points of the scene,
    and its effect on friction and its time are measured. Then things are dropped one by one, first
    those with a small effect for the work that they save, as long as the joint effect of all
    omissions stays within modelling's share of the budget. A larger budget never keeps more.
    Overrides of the scene are applied first and use none of the budget.

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
        If an override contradicts the scene, the drive is not a sine, or the scene refuses
        accuracy that was not shown.

    Examples
    --------
    >>> import haptix
    >>> drive = {"scheme": "carrier", "carrier_hz": 10e3}
    >>> scene = haptix.Scene(finger="wet", screen="3m-sct3250", normal_force_n=0.5, drive=drive)
    >>> plan = plan_scene(scene)
    >>> len(plan.rows) > 0
    True
    """
    override = scene.override
    tolerance = None if override.tolerance is None else Tolerance.read(override.tolerance)
    if tolerance is None:
        _surface_tolerance(scene, scene.budget_jnd)  # refuses a budget that is too small at best
    everything = omissions(scene)
    base, settled = _with_overrides(scene, everything)
    trials = Trials(scene, base, points)
    on_progress(0.1)
    alone: dict[Omission, tuple[Effect, float]] = {}
    for number, omission in enumerate(everything, start=1):
        alone[omission] = _alone(trials, base, omission)
        on_progress(0.1 + 0.8 * number / len(everything))
    effects = {omission: effect for omission, (effect, _) in alone.items()}
    free = [omission for omission in everything if omission not in settled]
    chosen, joint, decisions = _spend(trials, base, free, effects)
    decisions |= settled
    rows = [
        Row(out.kind, out.name, kept, *alone[out], why)
        for out in everything
        for kept, why in [decisions[out]]
    ]
    highest = trials.highest(chosen)
    past_gaps = float(highest.pull_past_breakdown.max())
    rows += [_report_row(trials, chosen, term, past_gaps) for term in reporting_terms(scene)]
    rows += _fixed_rows(scene)
    order = {name: rank for rank, name in enumerate((*TERMS, *AXIS_NAMES))}
    rows.sort(key=lambda row: order.get(row.name, len(order)))
    spare = max(0.0, scene.budget_jnd * MODELLING_SHARE - joint.jnd_max)
    for name, effect in effects_of_materials(scene, trials.model(chosen)):
        felt = effect.jnd_max > spare
        why = "felt" if felt else f"not felt: below the {spare:.2g} JND left of the budget"
        rows.append(Row("material", name, felt, effect, why=why))
    dtype = getattr(torch, override.dtype or "float32")
    model, fidelity = trials.model(chosen, dtype), override.fidelity
    if fidelity is not None and Ability.TABULATE not in FIDELITIES[fidelity].can:
        model = scene.model(fidelity, model.dtype, terms=model.terms)
    ranges = scene.ranges()
    if scene.not_shown == "refuse" and highest.accuracy.not_shown:
        raise InputError(
            "not_shown: the scene refuses states whose accuracy was not shown, and its "
            f"{highest.accuracy}; narrow "
            'it to states where it was (docs/mean-field.md), or set not_shown = "warn"'
        )
    lightest = trials.model(chosen).solve(scene.normal_force_n[0], 0.0, ranges["frequency_hz"][0])
    verified = scene.screen.verified
    beyond = []
    if verified is not None:
        force, volts, hertz = (ranges[n] for n in ("normal_force_n", "voltage_v", "frequency_hz"))
        beyond = verified.beyond(force, volts, hertz, scene.speed_mm_per_s)
    on_progress(1.0)
    return Plan(
        scene=scene,
        rows=tuple(rows),
        model=model,
        ranges={**ranges, **{name: (value, value) for name, value in chosen.held}},
        tolerance=tolerance
        or _surface_tolerance(scene, scene.budget_jnd - _UNSEEN * joint.jnd_max),
        dtype=dtype,
        effect=joint,
        points=len(trials.voltage_v),
        placeholder_spread_jnd=largest_spread(
            trials.model(base), {axis: trials.points[axis] for axis in AXIS_NAMES}, trials.voltage_v
        ),
        pull_past_breakdown=past_gaps,
        lowest_x=float(lightest.x),
        accuracy=str(highest.accuracy),
        warnings=(*lightest.warnings(), *limits_passed(highest.status), *beyond),
    )


def _surface_tolerance(scene: Scene, rest: float) -> Tolerance:
    """Return the rest of the budget as the surface's tolerance; refuse too small a budget."""
    if rest < LEAST["JND"]:
        raise InputError(
            f"budget_jnd: expected a budget that leaves the surface {LEAST['JND']:g} JND, "
            f"since the model is no more exact, got {scene.budget_jnd:g} JND"
        )
    return Tolerance(rest, "JND")


def _with_overrides(
    scene: Scene, everything: list[Omission]
) -> tuple[Choice, dict[Omission, Decision]]:
    """Return the model before planning, and the decisions that the scene takes itself."""
    override, fidelity = scene.override, scene.override.fidelity or FULL
    base = Choice(friction_terms(scene, fidelity))
    on = {name: True for name, is_on in override.terms.items() if is_on}
    # Raises if the profiles or the fidelity do not allow it.
    chosen_terms(on, scene.finger, scene.screen, FIDELITIES[fidelity])
    settled: dict[Omission, Decision] = {}
    for out in everything:
        kept = _overridden(scene, out)
        if kept is not None:
            settled[out] = (kept, f"{'kept' if kept else 'dropped'} by the scene")
            base = base if kept else out.out_of(base)
        elif out.kind == "term" and TERMS[out.name].left_to_scene:
            settled[out] = (False, "on request, and the scene does not ask for it")
    for out in everything:
        if out in settled:
            continue
        if out.kind == "term" and out.name not in base.terms:
            settled[out] = (False, "contradicts the scene's fidelity")
        elif out.kind == "fidelity" and (
            needed := (on.keys() & friction_terms(scene)) - out.possible
        ):
            settled[out] = (True, f"needed by {', '.join(sorted(needed))}, kept by the scene")
    return base, settled


def _overridden(scene: Scene, omission: Omission) -> bool | None:
    """Return the scene's decision on one thing: True to keep it; None if there is no decision."""
    override = scene.override
    if omission.kind == "term":
        return override.terms.get(omission.name)
    if omission.kind == "axis":
        return {None: None, "keep": True}.get(override.axes.get(omission.name), False)
    # A fidelity that cannot be tabulated corrects a surface of the full fidelity.
    return None if override.fidelity is None else override.fidelity != COARSE


def _alone(trials: Trials, base: Choice, omission: Omission) -> tuple[Effect, float]:
    """Effect of leaving out one thing of `base`, and the time that the thing takes."""
    scene, is_term, name = trials.scene, omission.kind == "term", omission.name
    without, with_it = omission.out_of(base), omission.into(base)
    effect = _NO_EFFECT
    if without != base:
        effect = trials.effect(base, without)
    elif not is_term or name in scene.possible_terms(base.fidelity):  # left out by an override
        effect = trials.effect(with_it, base)
    if omission.kind == "axis" or (is_term and name not in scene.terms(base.fidelity)):
        return effect, 0.0
    full = with_it if is_term else Choice(friction_terms(scene))
    return effect, max(0.0, trials.seconds(full) - trials.seconds(omission.out_of(full)))


def _spend(
    trials: Trials, base: Choice, free: list[Omission], effects: Mapping[Omission, Effect]
) -> tuple[Choice, Effect, dict[Omission, Decision]]:
    """Drop things with the least effect for the work they save, until modelling's share is spent.

    The order does not depend on the budget, so a larger budget drops all that a smaller one drops.
    """
    share = MODELLING_SHARE * trials.scene.budget_jnd
    # The least share [JND] at which each is dropped: the less it saves, the less it may cost.
    prices = {out: effects[out].cost / out.work for out in free}
    chosen, joint = base, _NO_EFFECT
    decisions: dict[Omission, Decision] = {}
    for out in sorted(free, key=prices.__getitem__):
        if out.out_of(chosen) == chosen:
            decisions[out] = (False, "not in the coarser fidelity")
            continue
        together = trials.effect(base, out.out_of(chosen))
        if max(prices[out], together.cost) > share:
            break
        chosen, joint = out.out_of(chosen), together
        why = f"held at {out.value:.4g}; " if out.kind == "axis" else ""
        if effects[out].jnd_max == 0:
            why += "changes nothing here"
        else:
            why += f"all dropped so far cost {joint.jnd_max:.2g} JND"
        decisions[out] = (False, why)
    for out in free:
        if out in decisions:
            continue
        alone = effects[out]
        why = f"with all dropped parts, more than {share:.2g} JND"
        if alone.is_past_breakdown:
            why = f"without it the surface would end {alone.overreach:.0%} past breakdown"
        elif alone.jnd_max > share:
            why = f"matters: more than {share:.2g} JND"
        elif prices[out] > share:
            why = f"saves too little to cost more than {share * out.work:.2g} JND"
        decisions[out] = (True, why)
    return chosen, joint, decisions


def _report_row(trials: Trials, chosen: Choice, term: Term, past_gaps: float) -> Row:
    """Decide on a term that reports a status and changes no friction.

    The surface ends where the term reports its status only if the scene asks for it. The reason
    states how near the voltages come.
    """
    is_kept = term.name in kept_reports(trials.scene)
    share = trials.share_of_limit(chosen, term)
    why = f"voltages reach {share:.0%} of its voltage"
    if term.reports == Status.BREAKDOWN:
        why += f", {past_gaps:.0%} of the attraction is past what gaps bear"
    if term.name in trials.scene.override.terms:
        why = f"{'kept' if is_kept else 'dropped'} by the scene; {why}"
    if is_kept and share >= 1:
        why += ": the surface ends there"
    return Row("term", term.name, is_kept, why=why)


def _fixed_rows(scene: Scene) -> Iterator[Row]:
    """Rows that the scene itself decides: single values, and terms whose fields are missing."""
    for name, (low, high) in scene.ranges().items():
        if low == high:
            yield Row("axis", name, False, why=f"one value: {low:g}")
        elif name == "normal_force_n":
            yield Row("axis", name, True, why="friction is asked for by force")
    for name in sorted(set(TERMS) - scene.possible_terms()):
        fields = ", ".join(TERMS[name].missing(scene.finger, scene.screen))
        yield Row("term", name, False, why=f"{fields} not given")


def effects_of_materials(scene: Scene, model: ContactModel) -> Iterator[tuple[str, Effect]]:
    """Yield each variable that a material depends on, and the effect of holding it alone.

    Parameters
    ----------
    scene : Scene
        Its ranges of force and speed are those of the seeded states that are compared.
    model : ContactModel
        Model of the reachable friction.
    """
    speeds = scene.speed_mm_per_s or _SPEED_MM_S
    centre = sum(speeds) / 2, sum(scene.normal_force_n) / 2
    for number, material in enumerate(scene.materials):
        evaluator = material.evaluator
        motion = _motion(scene, material, speeds)
        reach = _reach(scene, model, motion.normal_force_n)
        motion.reachable = lambda force_n, _: _reach(scene, model, force_n)
        flags = [flag for flag in HOLDABLE if flag & evaluator.depends_on]
        truth, *others = (
            torch.from_numpy(
                np.clip(as_mu(evaluator.target, evaluator.wanted(moved), *reach), *reach)
            )
            for moved in (motion, *(holding(motion, flag, *centre) for flag in flags))
        )
        for flag, mu in zip(flags, others, strict=True):
            name = f"materials.{number} ({material.kind}) {str(flag.name).lower()}"
            yield name, Effect.between(truth, mu)


def holding(motion: Motion, held: Depends, speed_mm_s: float, normal_force_n: float) -> Motion:
    """Return a motion in which the held variables never change.

    Parameters
    ----------
    motion : Motion
    held : Depends
        Variables that never change.
    speed_mm_s, normal_force_n : float
        Speed [mm/s] and normal force [N] that are held.
    """
    ones = np.ones(motion.x_mm.shape)

    def velocity() -> tuple[Array, Array]:
        if held & Depends.SPEED:
            vx, vy = motion.ux * speed_mm_s, motion.uy * speed_mm_s
        else:
            vx, vy = motion.vx_mm_s, motion.vy_mm_s
        return (np.hypot(vx, vy), 0 * ones) if held & Depends.DIRECTION else (vx, vy)

    return motion.changed(
        0 * ones if held & Depends.TIME else None,
        normal_force_n * ones if held & Depends.FORCE else None,
        velocity,
    )


def _motion(scene: Scene, material: Material, speeds: tuple[float, float]) -> Motion:
    """Seeded places, times, directions, speeds and forces; the same for the same scene."""
    uniform, states = np.random.default_rng(0).uniform, _MATERIAL_STATES
    left, right, top, bottom = material.extent_mm
    x, y = uniform(left, right, states), uniform(top, bottom, states)
    t, turn = uniform(0, _SECONDS, states), uniform(0, 2 * np.pi, states)
    speed, force = uniform(*speeds, states), uniform(*scene.normal_force_n, states)
    return Motion.of(x, y, t, speed * np.cos(turn), speed * np.sin(turn), force)


def _reach(scene: Scene, model: ContactModel, force_n: Array) -> tuple[Array, Array]:
    """Lowest and highest friction coefficient at forces."""
    forces = torch.linspace(*scene.normal_force_n, _FORCES, dtype=torch.float64)
    frequency = sum(scene.ranges()["frequency_hz"]) / 2
    low, high = (
        np.interp(force_n, forces.numpy(), model.solve(forces, volts, frequency).mu.cpu().numpy())
        for volts in (0.0, scene.max_voltage_v)
    )
    return low, high
