"""What it changes to hold one of the things that a scene's materials depend on."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import torch

from haptix.checks import Array
from haptix.friction import ContactModel
from haptix.motion import Depends, Motion
from haptix.planning.trials import Effect
from haptix.scene import Scene
from haptix.texture import as_mu
from haptix.texture.material import Material

HOLDABLE = (Depends.TIME, Depends.DIRECTION, Depends.SPEED, Depends.FORCE)
"""What can be held: time at 0, direction to the right, speed and force in the scene's middle."""

_STATES = 4000
_SECONDS = 10.0
_SPEED_MM_S = (20.0, 200.0)  # where the scene gives none
_FORCES = 9


def effects_of_materials(scene: Scene, model: ContactModel) -> Iterator[tuple[str, Effect]]:
    """Yield what each material depends on, and the effect of holding it alone.

    Parameters
    ----------
    scene : Scene
        Its ranges of force and speed are those of the seeded states that are compared.
    model : ContactModel
        Gives the reachable friction.
    """
    speeds = scene.speed_mm_per_s or _SPEED_MM_S
    for number, material in enumerate(scene.materials):
        evaluator = material.evaluator
        motion = _motion(scene, material, speeds)
        reach = _reach(scene, model, motion.normal_force_n)
        motion.reachable = lambda force_n, _: _reach(scene, model, force_n)
        middle = sum(speeds) / 2, sum(scene.normal_force_n) / 2
        held = [flag for flag in HOLDABLE if flag & evaluator.depends_on]
        motions = [motion, *(holding(motion, flag, *middle) for flag in held)]
        truth, *others = (
            torch.from_numpy(
                np.clip(as_mu(evaluator.target, evaluator.wanted(one), *reach), *reach)
            )
            for one in motions
        )
        for flag, mu in zip(held, others, strict=True):
            name = f"materials.{number} ({material.kind}) {str(flag.name).lower()}"
            yield name, Effect.between(truth, mu)


def holding(motion: Motion, held: Depends, speed_mm_s: float, normal_force_n: float) -> Motion:
    """Return a motion in which what is held never changes."""
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
