"""Pictures of materials: the wanted friction on a grid, and against all that it depends on."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from haptix.base.checks import Array, positive, whole
from haptix.base.errors import from_extra
from haptix.feel.materials.field import FORCE_N, SPEED_MM_S, WORDS
from haptix.feel.materials.material import Material
from haptix.feel.motion import Depends, Facts, Motion, Trajectory
from haptix.feel.motion.block import History, facts_on

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


_EVENT_S = 0.1
_LONGEST_S = 0.5
_FASTEST_MM_S = 200.0

_STROKE = 0.7  # share of the height; a stroke through a dial's centre would cross no ridge
_SECONDS = 1.2
_STORY_EVENT_S = 0.2


def picture(
    material: Material,
    width_mm: float,
    height_mm: float,
    columns: int = 240,
    t_s: float = 0.0,
    sweeps: bool = False,
    corner_mm: tuple[float, float] = (0.0, 0.0),
) -> Array:
    """Return the wanted friction of a material on a grid, in its target's values.

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
        Where friction does not depend on the place, the width stands for the other input: speeds up
        to 200 mm/s, or the first half second, at 0.1 s of which an event happens. Where it depends
        on force, the height stands for 0 to 1 N.
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


def draw(material: Material) -> Figure:
    """Draw a material, with a panel for each quantity that it depends on.

    The map and the strokes are those of a finger at 80 mm/s, 0.5 N. Against time, the finger slides
    through the middle; its force goes from 0.2 to 1.1 N and back, and an event happens at 0.2 s.
    """
    with from_extra("figures"):
        from matplotlib.figure import Figure

    depends_on = material.evaluator.depends_on
    panels = [
        (Depends.PLACE, _map),
        (Depends.PLACE | Depends.DIRECTION, _strokes),
        (Depends.SPEED, _by_speed),
        (Depends.FORCE, _by_force),
        (Depends.TIME | Depends.FACTS, _in_time),
    ]
    drawn = [draw_panel for flags, draw_panel in panels if flags & depends_on]
    rows = (len(drawn) + 1) // 2
    figure = Figure(figsize=(11, 3.4 * rows), layout="constrained")
    axes = np.atleast_1d(figure.subplots(rows, min(len(drawn), 2))).ravel()
    for panel, draw_panel in zip(axes, drawn, strict=False):
        draw_panel(panel, material)
    for unused in axes[len(drawn) :]:
        unused.remove()
    figure.suptitle(f"{material.kind}: {WORDS[material.evaluator.target]}")
    return figure


def _middle(material: Material) -> tuple[float, float]:
    left, right, top, bottom = material.extent_mm
    return (left + right) / 2, (top + bottom) / 2


def _map(axes: Axes, material: Material) -> None:
    material.plot(axes).set_title("on the way to the right, at 0 s")


def _strokes(axes: Axes, material: Material) -> None:
    left, right, top, bottom = material.extent_mm
    x = np.linspace(left, right, 2000)
    y = top + _STROKE * (bottom - top)
    strokes = [("right", 1.0, "-"), ("left", -1.0, "--"), ("at rest", 0.0, ":")]
    differ = bool(material.evaluator.depends_on & (Depends.DIRECTION | Depends.SPEED))
    for name, speed, style in strokes if differ else strokes[:1]:
        motion = Motion.of(x, y, 0.0, speed * SPEED_MM_S, normal_force_n=0.5)
        axes.plot(x, material.evaluator.wanted(motion), style, lw=1.5, label=name)
    axes.set(xlabel="x (mm)", title=f"along y = {y:g} mm")
    if differ:
        axes.legend(loc="best", fontsize=8)


def _by_speed(axes: Axes, material: Material) -> None:
    speed = np.linspace(0, 250, 400)
    motion = Motion.of(*_middle(material), 0.0, speed, normal_force_n=0.5)
    axes.plot(speed, material.evaluator.wanted(motion))
    axes.set_ylim(bottom=min(0.0, axes.get_ylim()[0]))
    axes.set(xlabel="speed (mm/s)", title="by speed, in the middle")


def _by_force(axes: Axes, material: Material) -> None:
    force = np.linspace(0, 1.2, 400)
    motion = Motion.of(*_middle(material), 0.0, SPEED_MM_S, normal_force_n=force)
    axes.plot(force, material.evaluator.wanted(motion))
    axes.set(xlabel="normal force (N)", title="by force, in the middle")


def _in_time(axes: Axes, material: Material) -> None:
    t, value, force = story(material)
    axes.plot(t, value)
    depends_on = material.evaluator.depends_on
    if depends_on & Depends.FORCE:
        beside = axes.twinx()
        beside.plot(t, force, color="0.6", ls="--")
        beside.set_ylabel("normal force (N), dashed")
    axes.set(xlabel="time (s)", title="against time, in the middle")


def story(material: Material) -> tuple[Array, Array, Array]:
    """Times, values and normal forces of a finger in the middle, see `draw`; shape (points,)."""
    t = np.arange(0, _SECONDS, 1 / 12_000)
    x, y = _middle(material)
    force = np.interp(t, [0, _STORY_EVENT_S, 0.4, 0.7, 0.9], [0.2, 0.2, 1.1, 1.1, 0.2])
    evaluator = material.evaluator
    history = facts_on(Trajectory.of(t[::60], x, y, force[::60]), evaluator.react, 0.0)
    if len(history) < 2:  # the material made no event of this stroke
        at = _STORY_EVENT_S
        history = ((at, Facts(at, at, at, 1.0, at)),)
    motion = Motion.of(x, y, t, SPEED_MM_S, 0.0, force, history=history)
    return t, evaluator.wanted(motion), force
