"""Pictures of materials: what they ask for, by everything that they depend on."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from haptix.checks import Array
from haptix.errors import from_extra
from haptix.motion import Depends, Facts, Motion, Trajectory
from haptix.motion.block import facts_on
from haptix.texture.material import Material

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_SPEED_MM_S = 80.0
_PIXELS = 400
_STROKE = 0.7  # of the height: a stroke through a dial's centre would cross no ridge
_SECONDS = 1.2
_EVENT_S = 0.2
_WORDS = {"share": "share of the reachable friction", "mu": "friction coefficient",
          "contrast": "relative change of friction"}  # fmt: skip


def draw(material: Material) -> Figure:
    """Draw a material: a panel for each thing that it depends on.

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
    for panel, one in zip(axes, drawn, strict=False):
        one(panel, material)
    for unused in axes[len(drawn) :]:
        unused.remove()
    figure.suptitle(f"{material.kind}: {_WORDS[material.evaluator.target]}")
    return figure


def _middle(material: Material) -> tuple[float, float]:
    left, right, top, bottom = material.extent_mm
    return (left + right) / 2, (top + bottom) / 2


def _map(axes: Axes, material: Material) -> None:
    left, right, top, bottom = material.extent_mm
    pixel_mm = (right - left) / _PIXELS
    x = np.arange(left, right, pixel_mm) + pixel_mm / 2
    y = np.arange(top, bottom, pixel_mm) + pixel_mm / 2
    places = np.meshgrid(x, y)
    motion = Motion.of(*places, 0.0, _SPEED_MM_S, normal_force_n=0.5, footprint_mm=pixel_mm / 2)
    value = material.evaluator.wanted(motion).reshape(places[0].shape)
    picture = axes.imshow(value, extent=(left, right, bottom, top), cmap="viridis")
    assert axes.figure is not None
    axes.figure.colorbar(picture, ax=axes, shrink=0.8)
    axes.set(xlabel="x (mm)", ylabel="y (mm)", title="on the way to the right, at 0 s")


def _strokes(axes: Axes, material: Material) -> None:
    left, right, top, bottom = material.extent_mm
    x = np.linspace(left, right, 2000)
    y = top + _STROKE * (bottom - top)
    strokes = [("right", 1.0, "-"), ("left", -1.0, "--"), ("at rest", 0.0, ":")]
    differ = bool(material.evaluator.depends_on & (Depends.DIRECTION | Depends.SPEED))
    for name, speed, style in strokes if differ else strokes[:1]:
        motion = Motion.of(x, y, 0.0, speed * _SPEED_MM_S, normal_force_n=0.5)
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
    motion = Motion.of(*_middle(material), 0.0, _SPEED_MM_S, normal_force_n=force)
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
    force = np.interp(t, [0, _EVENT_S, 0.4, 0.7, 0.9], [0.2, 0.2, 1.1, 1.1, 0.2])
    evaluator = material.evaluator
    history = facts_on(Trajectory.of(t[::60], x, y, force[::60]), evaluator.react, 0.0)
    if len(history) < 2:  # nothing of its own happens
        at = _EVENT_S
        history = ((at, Facts(at, at, at, 1.0, at)),)
    motion = Motion.of(x, y, t, _SPEED_MM_S, 0.0, force, history=history)
    return t, evaluator.wanted(motion), force
