"""Relief: the lateral force of slopes, right for every direction of the stroke."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import Field, PositiveFloat, model_validator

from haptix.base.checks import Array
from haptix.base.errors import InputError
from haptix.base.kinds import AnyAsset
from haptix.feel.materials.material import Scaled
from haptix.feel.materials.pyramid import Pyramid
from haptix.feel.motion import Depends, Motion

_STEEPEST = 99.0  # percentile of steepness that reaches the ends of the range


@dataclass(frozen=True)
class Slopes:
    """Slopes of a relief over the screen, as parts of the steepest, band-limited.

    Right and down are the real and the imaginary part of one map, so that both cost one look-up.
    """

    pyramid: Pyramid
    width_mm: float
    height_mm: float

    @classmethod
    def of(cls, right: Array, down: Array, width_mm: float) -> Self:
        """Take slopes of shape (rows, columns), on any scale."""
        steepest = float(np.percentile(np.hypot(right, down), _STEEPEST))
        if not steepest > 0:
            raise InputError("relief: expected slopes, got a plane of one height")
        pixel_mm = width_mm / right.shape[1]
        pyramid = Pyramid((right + 1j * down) / steepest, pixel_mm, 0.0)
        return cls(pyramid, width_mm, pixel_mm * right.shape[0])

    def along(self, motion: Motion) -> Array:
        """Slope along the motion: above 0 uphill, -1 to 1."""
        slope = self.pyramid.sample(motion.x_mm, motion.y_mm, motion.footprint_mm)
        uphill = slope.real * motion.ux + slope.imag * motion.uy
        return np.asarray(np.clip(uphill, -1.0, 1.0))


def _slopes(path: Path, is_normals: bool, width_mm: float) -> Slopes:
    from haptix.feel.materials.pictures import read_grey, read_normals  # needs an extra

    if is_normals:
        return Slopes.of(*read_normals(path), width_mm)
    heights = read_grey(path)
    if min(heights.shape) < 2:
        raise InputError(f"heights: expected 2 x 2 pixels or more, got {heights.shape}")
    down, right = (np.asarray(slope) for slope in np.gradient(heights))
    return Slopes.of(right, down, width_mm)


class Relief(Scaled):
    """Bumps and edges that resist uphill and give way downhill, whichever way one strokes.

    A finger on a slope of angle a is pushed back by ``mu + s`` of its normal force, with s the
    slope along its motion; lateral force alone is felt as shape (Robles-De-La-Torre and Hayward,
    Nature 412, 445 (2001); on electrovibration Kim, Israr and Poupyrev, UIST 2013). The level is
    ``bias + s / (2 s_99)``, with s_99 the steepness that a hundredth of the map exceeds. The screen
    can only add friction, so a flat place needs a bias for a downhill slope to be felt.

    Parameters
    ----------
    heights : str, optional
        Picture of the heights, bright is high.
    normals : str, optional
        Picture of the surface's normals instead: red to the right, green up, as games have them.
    width_mm : float
        Width on the screen.
    bias : float
        Level on the flat; 0 where the relief is added to another material.
    edge_mm : float
        Within this from the edges the bias rises from 0.
    """

    kind: Literal["relief"] = "relief"
    heights: AnyAsset | None = None
    normals: AnyAsset | None = None
    width_mm: PositiveFloat
    bias: Annotated[float, Field(ge=0, le=1)] = 0.5
    edge_mm: Annotated[float, Field(ge=0)] = 5.0
    depends_on = Depends.PLACE | Depends.DIRECTION

    @model_validator(mode="after")
    def _has_one_map(self) -> Self:
        if (self.heights is None) == (self.normals is None):
            raise ValueError("expected heights or normals, and not both")
        return self

    @cached_property
    def slopes(self) -> Slopes:
        """The slopes; documents of the same picture share them."""
        asset = self.normals or self.heights
        assert asset is not None  # checked above
        is_normals, width_mm = self.normals is not None, self.width_mm
        parameters = ["slopes", is_normals, width_mm]
        return asset.shared(parameters, lambda path: _slopes(path, is_normals, width_mm))

    @property
    def extent_mm(self) -> tuple[float, float, float, float]:
        """Its size."""
        return (0.0, self.slopes.width_mm, 0.0, self.slopes.height_mm)

    def wanted(self, motion: Motion) -> Array:
        """Friction under the fingers."""
        level = 0.5 * self.slopes.along(motion)
        if self.bias > 0:
            level = level + self._bias_at(motion.x_mm, motion.y_mm)
        return self.scaled(level)

    def _bias_at(self, x_mm: Array, y_mm: Array) -> Array:
        """Bias at places: 0 outside, rising over `edge_mm` from the edge to the full bias."""
        width, height = self.slopes.width_mm, self.slopes.height_mm
        ramp = max(self.edge_mm, 1e-9)
        depth = np.minimum(np.minimum(x_mm, width - x_mm), np.minimum(y_mm, height - y_mm))
        return np.asarray(self.bias * np.clip(depth / ramp, 0.0, 1.0))
