"""Outlines of regions: how much of a finger's place is inside."""

from __future__ import annotations

from dataclasses import dataclass
from math import hypot
from typing import Any

import numpy as np

from haptix.checks import Array
from haptix.region import Shape


@dataclass(frozen=True)
class Outline:
    """A shape in a rectangle whose corner is the origin.

    Parameters
    ----------
    width_mm, height_mm : float
        Size of the rectangle.
    shape : {"rectangle", "ellipse"} or sequence of (x_mm, y_mm)
        The shape; a polygon need not be convex, and its edges may not cross.
    """

    width_mm: float
    height_mm: float
    shape: Shape = "rectangle"

    def cover(self, x_mm: Array, y_mm: Array, ramp_mm: float) -> Array:
        """Share of each place that is inside, 0 to 1: a ramp across the edge, or a step at 0."""
        ramp = max(ramp_mm, 1e-9)
        width, height = self.width_mm, self.height_mm
        if self.shape == "rectangle":
            # A step less the next one is right for regions narrower than the ramps, too.
            inside = _step(x_mm, ramp) - _step(x_mm - width, ramp)
            inside *= _step(y_mm, ramp) - _step(y_mm - height, ramp)
            return inside
        if self.shape == "ellipse":
            a, b = width / 2, height / 2
            away = np.hypot(x_mm / a - 1, y_mm / b - 1)
            return _step((1 - away) * min(a, b), ramp)
        return _step(_depth_in(self.shape, x_mm, y_mm), ramp)

    def contains(self, x_mm: float, y_mm: float) -> bool:
        """Whether a place is inside."""
        if self.shape == "rectangle":
            return 0.0 <= x_mm <= self.width_mm and 0.0 <= y_mm <= self.height_mm
        if self.shape == "ellipse":
            return hypot(2 * x_mm / self.width_mm - 1, 2 * y_mm / self.height_mm - 1) <= 1.0
        return bool(self.cover(np.array([x_mm]), np.array([y_mm]), 0.0)[0] >= 0.5)


def _step(depth_mm: Array, ramp_mm: float) -> Array:
    """Return a step from 0 to 1, as a ramp around a depth of 0."""
    return np.asarray(np.clip(0.5 + depth_mm / ramp_mm, 0.0, 1.0))


def _depth_in(corners: Any, x_mm: Array, y_mm: Array) -> Array:
    """Distance to a polygon's nearest edge, negative outside."""
    nearest = np.full(x_mm.shape, np.inf)
    inside = np.zeros(x_mm.shape, dtype=bool)
    x0, y0 = corners[-1]
    for x1, y1 in corners:
        dx, dy = x1 - x0, y1 - y0
        along = ((x_mm - x0) * dx + (y_mm - y0) * dy) / max(dx * dx + dy * dy, 1e-300)
        along = np.clip(along, 0.0, 1.0)
        np.minimum(nearest, np.hypot(x_mm - x0 - along * dx, y_mm - y0 - along * dy), out=nearest)
        if dy:  # a ray to the right crosses this edge
            inside ^= ((y0 > y_mm) != (y1 > y_mm)) & (x_mm < x0 + (y_mm - y0) * dx / dy)
        x0, y0 = x1, y1
    return np.where(inside, nearest, -nearest)
