"""What the materials of a scene depend on, and what of it a budget allows to leave out."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import torch

from haptix.checks import Array
from haptix.friction import ContactModel
from haptix.materials.held import DROPPABLE, without
from haptix.materials.material import Material
from haptix.motion import Depends, Motion
from haptix.planning.effects import Effect
from haptix.scene import Scene
from haptix.texture import Evaluator, as_mu

_STATES = 4000
_SECONDS = 10.0
_SPEED_MM_S = (20.0, 200.0)  # where the scene gives none
_FORCES = 9


@dataclass(frozen=True)
class MaterialDecision:
    """One thing that a material depends on."""

    name: str
    kept: bool
    effect: Effect
    """Effect of holding this alone: time at 0, the direction to the right, speed and force in the
    middle of the scene's."""
    why: str


def decide_materials(
    scene: Scene, model: ContactModel, budget_jnd: float
) -> tuple[tuple[MaterialDecision, ...], tuple[Evaluator, ...]]:
    """Hold what changes a material's friction by less than a budget, one thing after the other.

    Parameters
    ----------
    scene : Scene
        Its ranges of force and speed are those of the seeded states that are compared.
    model : ContactModel
        Gives the reachable friction.
    budget_jnd : float
        Largest joint effect of all that is left out of one material [JND].

    Returns
    -------
    tuple of MaterialDecision, tuple of Evaluator
        A decision for each thing that a material depends on and that can be held; each material's
        evaluator without what was dropped.
    """
    decisions: list[MaterialDecision] = []
    evaluators: list[Evaluator] = []
    for number, material in enumerate(scene.materials):
        evaluator, rows = _decided(scene, model, material, budget_jnd)
        evaluators.append(evaluator)
        decisions += [
            MaterialDecision(f"materials.{number} ({material.kind}) {name}", kept, effect, why)
            for name, kept, effect, why in rows
        ]
    return tuple(decisions), tuple(evaluators)


def _decided(
    scene: Scene, model: ContactModel, material: Material, budget_jnd: float
) -> tuple[Evaluator, list[tuple[str, bool, Effect, str]]]:
    evaluator = material.evaluator
    low, high = scene.speed_mm_per_s or _SPEED_MM_S
    force = sum(scene.normal_force_n) / 2
    motion = _motion(scene, material, (low, high))
    reach = _reach(scene, model, motion.normal_force_n)
    motion = motion.within(lambda force_n, _: _reach(scene, model, force_n))

    def friction(one: Evaluator) -> torch.Tensor:
        mu = as_mu(one.target, one.wanted(motion), *reach)
        return torch.from_numpy(np.clip(mu, *reach))

    truth, dropped = friction(evaluator), Depends.NOTHING
    alone = {
        flag: Effect.between(truth, friction(without(evaluator, flag, (low + high) / 2, force)))
        for flag in _droppable(evaluator)
    }
    rows = []
    for flag, effect in sorted(alone.items(), key=lambda item: item[1].thresholds_max):
        more = without(evaluator, dropped | flag, (low + high) / 2, force)
        joint = Effect.between(truth, friction(more)).thresholds_max
        kept = joint > budget_jnd
        if not kept:
            dropped |= flag
        why = f"{joint:.2g} of {budget_jnd:.2g} JND left out" if not kept else "above the budget"
        rows.append((str(flag.name).lower(), kept, effect, why))
    if dropped:
        evaluator = without(evaluator, dropped, (low + high) / 2, force)
    return evaluator, rows


def _droppable(evaluator: Evaluator) -> Iterator[Depends]:
    return (flag for flag in DROPPABLE if flag & evaluator.depends_on)


def _motion(scene: Scene, material: Material, speeds: tuple[float, float]) -> Motion:
    """Seeded places, times, directions, speeds and forces; the same for the same scene."""
    random = np.random.default_rng(0)
    left, right, top, bottom = material.extent_mm
    x, y = random.uniform(left, right, _STATES), random.uniform(top, bottom, _STATES)
    t, turn = random.uniform(0, _SECONDS, _STATES), random.uniform(0, 2 * np.pi, _STATES)
    speed = random.uniform(*speeds, _STATES)
    force = random.uniform(*scene.normal_force_n, _STATES)
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
