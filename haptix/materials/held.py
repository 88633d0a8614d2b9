"""Materials of which part of what they depend on is left out."""

from __future__ import annotations

import numpy as np

from haptix.checks import Array
from haptix.materials.material import Answering
from haptix.motion import Depends, Motion
from haptix.texture import Evaluator

DROPPABLE = (Depends.TIME, Depends.DIRECTION, Depends.SPEED, Depends.FORCE)
"""What can be held: time at 0, direction to the right, speed and force at given values."""


def without(
    evaluator: Evaluator, dropped: Depends, speed_mm_s: float, normal_force_n: float
) -> Answering:
    """Return an evaluator that is asked as if what is dropped never changed."""

    def held(motion: Motion) -> Motion:
        ones = np.ones(motion.x_mm.shape)

        def velocity() -> tuple[Array, Array]:
            if dropped & Depends.SPEED:
                vx, vy = motion.ux * speed_mm_s, motion.uy * speed_mm_s
            else:
                vx, vy = motion.vx_mm_s, motion.vy_mm_s
            return (np.hypot(vx, vy), 0 * ones) if dropped & Depends.DIRECTION else (vx, vy)

        return motion.changed(
            0 * ones if dropped & Depends.TIME else None,
            normal_force_n * ones if dropped & Depends.FORCE else None,
            velocity,
        )

    return Answering(
        lambda motion: evaluator.wanted(held(motion)),
        evaluator.target,
        evaluator.outside,
        evaluator.depends_on & ~dropped,
        evaluator.drives_at_rest,
        evaluator.react,
    )
