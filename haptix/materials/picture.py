"""Pictures of materials as numbers: what they ask for on a grid of places."""

from __future__ import annotations

from typing import Any

import numpy as np

from haptix.checks import Array, positive, whole
from haptix.motion import Depends, Facts, Motion
from haptix.motion.block import History
from haptix.texture.material import Material

SPEED_MM_S = 80.0
"""Speed, to the right, of the finger for which a picture holds."""
FORCE_N = 0.5
_EVENT_S = 0.1
_LONGEST_S = 0.5
_FASTEST_MM_S = 200.0


def picture(
    material: Material,
    width_mm: float,
    height_mm: float,
    columns: int = 240,
    t_s: float = 0.0,
    sweeps: bool = False,
    corner_mm: tuple[float, float] = (0.0, 0.0),
) -> Array:
    """Return what a material asks for on a grid, in its target's values.

    Parameters
    ----------
    material : Material
        The material.
    width_mm, height_mm : float
        Size of the grid.
    columns : int
        Places along the width; as dense down the height, one at least.
    t_s : float
        When.
    sweeps : bool
        Where the place says nothing, the width stands for what does: speeds up to 200 mm/s, or the
        first half second, at 0.1 s of which an event happens. Of what depends on force, the height
        stands for 0 to 1 N.
    corner_mm : (float, float)
        Upper left corner of the grid.

    Returns
    -------
    ndarray, shape (rows, columns)
        For a finger that goes right at 80 mm/s with 0.5 N.
    """
    pixel_mm = positive("width_mm", width_mm) / whole("columns", columns, 1)
    rows = max(1, round(positive("height_mm", height_mm) / pixel_mm))
    x, y = np.meshgrid((np.arange(columns) + 0.5) * pixel_mm, (np.arange(rows) + 0.5) * pixel_mm)
    depends_on = material.evaluator.depends_on
    speed: Any = SPEED_MM_S
    force: Any = FORCE_N
    moment = np.full(x.shape, float(t_s))
    history: History = ()
    if sweeps and not depends_on & Depends.PLACE:
        if depends_on & (Depends.TIME | Depends.FACTS):
            moment = _LONGEST_S * x / width_mm
            history = ((_EVENT_S, Facts(*(_EVENT_S,) * 5)),)
        elif depends_on & Depends.SPEED:
            speed = _FASTEST_MM_S * x / width_mm
    if sweeps and depends_on & Depends.FORCE and not depends_on & Depends.FACTS:
        force = y / height_mm
    motion = Motion.of(
        x + corner_mm[0], y + corner_mm[1], moment, speed, 0.0, force,
        footprint_mm=pixel_mm / 2, history=history,
    )  # fmt: skip
    return np.asarray(material.evaluator.wanted(motion)).reshape(x.shape)


def reachable_share(material: Material, width_mm: float, height_mm: float) -> float:
    """Return the share of the places of a `picture` that ask for shares of 0 to 1, within 0.005.

    That little is a tenth of a just-noticeable difference at most where the whole range has 20.
    """
    wanted = picture(material, width_mm, height_mm, 120, sweeps=True)
    return float((np.abs(wanted - 0.5) <= 0.505).mean())
