"""Materials that move: at a velocity, along a path, turning."""

from __future__ import annotations

from functools import cached_property
from math import pi
from typing import Literal, Self

import numpy as np
from pydantic import model_validator

from haptix.base.checks import Array, increasing
from haptix.base.documents import Part
from haptix.feel.materials import Evaluator
from haptix.feel.materials.by_curve import Row
from haptix.feel.materials.material import Answering, AnyMaterial, Material
from haptix.feel.motion import Depends, Facts, LocalFrame, Motion, Report

Pair = tuple[float, float]


class PathTable(Part):
    """Places against time, straight lines between them; beyond its ends it stays, or begins again.

    Parameters
    ----------
    t_s : list of float
        Times [s], increasing from 0.
    x_mm, y_mm : list of float
        How far the material has moved.
    angle_deg : list of float, optional
        How far it has turned, from x towards y.
    loop : bool
        Whether the path begins again at its end.

    Examples
    --------
    >>> PathTable(t_s=[0.0, 1.0], x_mm=[0.0, 50.0], y_mm=[0.0, 0.0]).loop
    False
    """

    t_s: Row
    x_mm: Row
    y_mm: Row
    angle_deg: Row | None = None
    loop: bool = False

    @model_validator(mode="after")
    def _is_a_path(self) -> Self:
        increasing("t_s", self.t_s, 2)
        if self.t_s[0] != 0:
            raise ValueError("expected the first of t_s at 0 s")
        columns = (self.x_mm, self.y_mm, self.angle_deg or self.t_s)
        if {len(column) for column in columns} != {len(self.t_s)}:
            raise ValueError("expected t_s, x_mm, y_mm and angle_deg of one length")
        return self

    @cached_property
    def columns(self) -> tuple[Array, Array]:
        """Times [s]; and at each x, y [mm] and angle [rad], shape (3, times)."""
        angle = self.angle_deg or (0.0,) * len(self.t_s)
        return np.array(self.t_s), np.array([self.x_mm, self.y_mm, np.deg2rad(angle)])

    def at(self, t_s: Array) -> tuple[Array, Array]:
        """Return x, y [mm] and angle [rad], and their rates; both of shape (3, times)."""
        knots, values = self.columns
        if self.loop:
            t_s = t_s % knots[-1]
        segment = np.clip(np.searchsorted(knots, t_s, side="right") - 1, 0, len(knots) - 2)
        slopes = (np.diff(values) / np.diff(knots))[:, segment]
        inside = t_s.clip(0.0, knots[-1])
        place = values[:, segment] + slopes * (inside - knots[segment])
        return place, np.where(inside == t_s, slopes, 0.0)


class Moving(Material):
    """Another material that moves over the screen; time counts from the first sample.

    A finger that rests on it gets no voltage, as everywhere: stripes that pass under a finger that
    does not slide are not felt. Electrovibration changes the friction of a finger that slides.

    Parameters
    ----------
    of : material
        What moves.
    velocity_mm_s : (float, float)
        Velocity along x and y.
    turn_deg_s : float
        How fast it turns, from x towards y, about `about_mm`.
    about_mm : (float, float)
        The place in the material about which it turns.
    path : table, optional
        Places against time, added to the velocity's.

    Examples
    --------
    >>> from haptix.feel import Grating
    >>> belt = Moving(of=Grating(period_mm=2.0), velocity_mm_s=(10.0, 0.0))
    >>> belt.of.period_mm
    2.0
    """

    kind: Literal["moving"] = "moving"
    of: AnyMaterial
    velocity_mm_s: Pair = (0.0, 0.0)
    turn_deg_s: float = 0.0
    about_mm: Pair = (0.0, 0.0)
    path: PathTable | None = None

    def frame(self, t_s: Array) -> LocalFrame:
        """Axes of the material at times: their origin is where `about_mm` is."""
        (vx, vy), turn = self.velocity_mm_s, self.turn_deg_s * pi / 180
        place = np.array([vx, vy, turn])[:, None] * t_s
        rate = np.array([[vx], [vy], [turn]])
        if self.path is not None:
            more, faster = self.path.at(t_s)
            place, rate = place + more, rate + faster
        x, y, angle = place
        return LocalFrame(x + self.about_mm[0], y + self.about_mm[1], angle, 1.0, *rate)

    def seen(self, motion: Motion) -> Motion:
        """Return the motion in the material's own axes."""
        moved = motion.seen_from(self.frame(motion.t_s))
        if self.about_mm == (0.0, 0.0):
            return moved
        return moved.seen_from(LocalFrame(-self.about_mm[0], -self.about_mm[1]))

    @cached_property
    def evaluator(self) -> Evaluator:
        """The evaluator of the material that moves, with motion in that material's axes."""
        of = self.of.evaluator
        return Answering(
            lambda motion: of.wanted(self.seen(motion)),
            of.target,
            of.outside,
            of.depends_on | Depends.TIME,
            of.drives_at_rest,
            self.react,
            self,
        )

    def react(self, facts: Facts, before: Report | None, now: Report) -> Facts:
        """Facts of the material that moves."""
        then = None if before is None else self._local(before)
        return self.of.evaluator.react(facts, then, self._local(now))

    def _local(self, report: Report) -> Report:
        place = Motion.of(report.x_mm, report.y_mm, report.t_s)
        seen = self.seen(place)
        return report._replace(x_mm=float(seen.x_mm[0]), y_mm=float(seen.y_mm[0]))
