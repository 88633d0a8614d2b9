"""Greys and heights as levels of friction."""

from __future__ import annotations

from math import cos, radians, sin
from typing import Literal, get_args

import numpy as np

from haptix.checks import Array, choice
from haptix.errors import InputError

LARGEST_BYTES = 1_500_000_000
"""Default limit of the memory that making a texture takes: some 24 megapixels."""

HeightRule = Literal["height", "slope-magnitude", "slope-along"]
"""``"height"``: the higher, the more friction. ``"slope-magnitude"``: the steeper in whatever
direction, the more. ``"slope-along"``: what a finger that strokes along `direction_deg` feels as
lateral force, more uphill and less downhill, with level 0.5 on the flat (Robles-De-La-Torre and
Hayward, Nature 412, 445 (2001)); a stroke against the direction feels it inside out."""

_CLIPPED = 99.0  # percentile of steepness that becomes the end of the range


def levels_by_rule(heights: Array, rule: HeightRule, direction_deg: float) -> Array:
    """Levels from 0 to 1 of heights, both of shape (rows, columns).

    The scale of the heights does not matter: their 1st and 99th percentile, or the 99th of their
    slope's size, become the ends of the range. A map that is flat by the rule raises `InputError`.
    """
    choice("rule", rule, get_args(HeightRule))
    if rule == "height":
        return stretched(heights)
    if min(heights.shape) < 2:
        raise InputError(f"heights: expected 2 x 2 values or more for a slope, got {heights.shape}")
    down, right = np.gradient(heights)
    if rule == "slope-magnitude":
        steepness = np.hypot(right, down)
        offset, scale = 0.0, 1.0
    else:
        angle = radians(direction_deg)
        steepness = cos(angle) * right + sin(angle) * down
        offset, scale = 0.5, 0.5
    top = np.percentile(np.abs(steepness), _CLIPPED)
    if not top > 0:
        raise InputError("heights: expected slopes, got a plane of one height")
    return np.asarray(np.clip(offset + scale * steepness / top, 0.0, 1.0))


def stretched(values: Array) -> Array:
    """Levels from 0 to 1 between the 1st and 99th percentile: single pixels do not decide."""
    low, high = np.percentile(values, (1.0, 99.0))
    if high <= low:
        raise InputError("image: expected some contrast, got pixels of one grey")
    return np.asarray(np.clip((values - low) / (high - low), 0.0, 1.0))
