"""What a step of each field changes, in just-noticeable differences (JND)."""

from __future__ import annotations

import numpy as np

from haptix.checks import Array
from haptix.errors import InputError
from haptix.materials.described import steps_of
from haptix.motion import Motion
from haptix.perception import WEBER_FRACTION
from haptix.texture import as_mu
from haptix.texture.material import Material

_STATES = 2000
_SECONDS = 2.0
_SPEED_MM_S = (20.0, 200.0)
_FORCES_N = (0.2, 1.2)
_FELT = 95.0  # percentile: an edge that moves changes few places, but these much


def effects_of_steps(material: Material, lowest_mu: float, highest_mu: float) -> dict[str, float]:
    """Return what a step up of each numeric field changes, or down where up is refused.

    Parameters
    ----------
    material : Material
        The material; only its own fields are looked at, not those of materials within it.
    lowest_mu, highest_mu : float
        Reachable friction coefficients.

    Returns
    -------
    dict
        The 95th percentile of the change, in JND, over seeded places, times, directions, speeds and
        forces, by the field's name; without those that allow no step. A pattern that is moved
        changes by its whole height: that is what a finger would feel at a place, not how well it
        could tell both patterns apart.
    """
    motion = _motion(material)
    before = _friction(material, motion, lowest_mu, highest_mu)
    found = {}
    for name, step in steps_of(type(material)).items():
        value = getattr(material, name)
        if isinstance(value, bool) or not isinstance(value, int | float):
            continue
        for by in (step, -step):
            try:  # some rules are those of what is made of the document
                changed = material.replace(**{name: value + by})
                after = _friction(changed, motion, lowest_mu, highest_mu)
            except InputError:
                continue
            away = np.abs(after - before) / (WEBER_FRACTION * before)
            found[name] = float(np.percentile(away, _FELT))
            break
    return found


def _motion(material: Material) -> Motion:
    random = np.random.default_rng(0)
    left, right, top, bottom = material.extent_mm
    x, y = random.uniform(left, right, _STATES), random.uniform(top, bottom, _STATES)
    t, turn = random.uniform(0, _SECONDS, _STATES), random.uniform(0, 2 * np.pi, _STATES)
    speed, force = random.uniform(*_SPEED_MM_S, _STATES), random.uniform(*_FORCES_N, _STATES)
    return Motion.of(x, y, t, speed * np.cos(turn), speed * np.sin(turn), force)


def _friction(material: Material, motion: Motion, lowest_mu: float, highest_mu: float) -> Array:
    evaluator = material.evaluator
    mu = as_mu(evaluator.target, evaluator.wanted(motion), lowest_mu, highest_mu)
    return np.asarray(np.clip(mu, lowest_mu, highest_mu))
