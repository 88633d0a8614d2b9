"""Friction by speed or by normal force: curves, alone or as factors of another material."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from typing import Annotated, ClassVar, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from haptix.base.checks import Array, increasing
from haptix.feel.materials import Evaluator, TargetKind
from haptix.feel.materials.material import Answering, AnyMaterial, Material
from haptix.feel.motion import Depends, Motion

Row = Annotated[tuple[float, ...], Field(min_length=2)]

SIDE_BANDS = 1.4
"""Factor on the footprint of a material that is multiplied by a varying factor. The product has
waves on both sides of the material's waves; this leaves room for a factor that varies at up to 0.3
times the highest frequency."""


class _ByCurve(Material):
    """Base of both: straight lines between corners, held beyond them.

    Parameters
    ----------
    share : list of float
        At the corners: shares of the reachable range; with `of`, factors.
    mu : list of float
        Friction coefficients instead.
    of : material, optional
        Material that the curve multiplies.
    """

    corners: ClassVar[str]
    _read: ClassVar[Callable[[Motion], Array]]

    share: Row | None = None
    mu: Row | None = None
    of: AnyMaterial | None = None

    @model_validator(mode="after")
    def _is_a_curve(self) -> Self:
        rows = [row for row in (self.share, self.mu) if row is not None]
        if len(rows) != 1 or (self.of is not None and self.share is None):
            raise ValueError("expected share or mu, and share where it multiplies another material")
        corners = increasing(self.corners, getattr(self, self.corners), 2)
        if len(corners) != len(rows[0]):
            raise ValueError(f"expected {self.corners} and values of one length")
        if min(rows[0]) < 0:
            raise ValueError("expected values of 0 or more")
        return self

    @cached_property
    def points(self) -> tuple[Array, Array]:
        """Corners of the curve, and its values there."""
        return np.array(getattr(self, self.corners)), np.array(self.share or self.mu)

    def factor(self, motion: Motion) -> Array:
        """The curve's value under the fingers."""
        return np.asarray(np.interp(type(self)._read(motion), *self.points))

    @cached_property
    def evaluator(self) -> Evaluator:
        """The curve, or its product."""
        if self.of is None:
            target: TargetKind = "share" if self.mu is None else "mu"
            outside = float(self.points[1][0])
            return Answering(self.factor, target, outside, self.depends_on, material=self)
        return product(self, self.of.evaluator, self.factor, self.depends_on)


class BySpeed(_ByCurve):
    """Friction that depends on the finger's speed: a surface that drags more, or slips, the faster.

    Parameters
    ----------
    speed_mm_s : list of float
        Corners of the curve [mm/s].

    Examples
    --------
    >>> drag = BySpeed(speed_mm_s=(10.0, 100.0), share=(0.2, 0.8))
    >>> drag.speed_mm_s
    (10.0, 100.0)
    """

    kind: Literal["by-speed"] = "by-speed"
    speed_mm_s: Row
    depends_on = Depends.SPEED
    corners = "speed_mm_s"
    _read = lambda motion: motion.speed_mm_s  # noqa: E731


class ByForce(_ByCurve):
    """Friction that depends on the normal force, measured or assumed.

    Parameters
    ----------
    normal_force_n : list of float
        Corners of the curve [N].

    Examples
    --------
    >>> stiff = ByForce(normal_force_n=(0.2, 1.0), share=(0.2, 0.8))
    >>> stiff.share
    (0.2, 0.8)
    """

    kind: Literal["by-force"] = "by-force"
    normal_force_n: Row
    depends_on = Depends.FORCE
    corners = "normal_force_n"
    _read = lambda motion: motion.normal_force_n  # noqa: E731


def product(
    material: Material, of: Evaluator, factor: Callable[[Motion], Array], depends_on: Depends
) -> Answering:
    """Evaluate a material that is another one times a factor."""

    def wanted(motion: Motion) -> Array:
        wider = motion.with_footprint(SIDE_BANDS * motion.footprint_mm)
        return factor(motion) * of.wanted(wider)

    return Answering(
        wanted, of.target, of.outside, of.depends_on | depends_on, of.drives_at_rest, of.react,
        material,
    )  # fmt: skip
