"""Evaluators, which give the renderer the wanted friction, and fields of friction."""

from __future__ import annotations

from abc import ABC, abstractmethod
from math import cos, radians, sin
from typing import TYPE_CHECKING, Any, Literal, Protocol, get_args

import numpy as np
import numpy.typing as npt

from haptix.base.checks import Array, choice, shown
from haptix.base.display import axes_or_new
from haptix.base.errors import InputError
from haptix.feel.motion import FARTHEST_MM, Depends, Facts, Motion, Report
from haptix.feel.motion.block import unmoved

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SPEED_MM_S = 80.0
"""Speed of the finger of a picture, which moves to the right."""
FORCE_N = 0.5
_PIXELS = 400  # along the width of a map
WORDS = {"share": "share of the reachable friction", "mu": "friction coefficient",
         "contrast": "relative change of friction", "plain": ""}  # fmt: skip
"""Quantity of a target's numbers, for labels."""

Floats = Any
"""Numbers of any shape, or one number."""

TargetKind = Literal["mu", "contrast", "share", "plain"]
"""Quantity of a field's numbers, see `as_mu`; "plain" ones are not friction."""


def check_target(target: str) -> None:
    """Raise `InputError` unless `target` is a `TargetKind`."""
    choice("target", target, get_args(TargetKind))


def check_range(name: str, target: TargetKind, low: float, high: float) -> None:
    """Raise `InputError` unless `low` and `high` are finite, increasing and possible."""
    if target == "plain":
        return
    least = {"mu": 0.0, "contrast": -1.0, "share": 0.0}[target]
    most = {"mu": np.inf, "contrast": np.inf, "share": 1.0}[target]
    if not (least <= low < high <= most and high < np.inf):
        raise InputError(
            f"{name}: expected finite {least:g} <= low < high"
            f"{f' <= {most:g}' if most < np.inf else ''} "
            f"for a target of {target}, got {low:g}, {high:g}"
        )


def as_mu(target: TargetKind, value: Floats, lowest_mu: Floats, highest_mu: Floats) -> Any:
    """Convert values of a field to friction coefficients; arrays or tensors that broadcast.

    Parameters
    ----------
    target : {"mu", "contrast", "share"}
        Target of the field. Values are friction coefficients; relative changes from `lowest_mu`,
        ``mu = lowest_mu (1 + value)``; or shares of the reachable range, 0 for `lowest_mu` and 1
        for `highest_mu`.
    value
        What `FrictionField.friction` returned.
    lowest_mu, highest_mu
        Friction without voltage and at the highest voltage, at the finger's force, see
        `FrictionSurface.reachable`.

    Examples
    --------
    >>> round(as_mu("share", 0.5, lowest_mu=0.2, highest_mu=0.4), 6)  # half of the reach
    0.3
    >>> as_mu("mu", 0.35, lowest_mu=0.2, highest_mu=0.4)
    0.35
    """
    if target == "plain":
        raise InputError("target: plain numbers are not friction; give mu, contrast or share")
    if target == "mu":
        return value
    if target == "contrast":
        return lowest_mu * (1 + value)
    return lowest_mu + value * (highest_mu - lowest_mu)


class Feelable(Protocol):
    """An object that a renderer can render: a field of friction, a material, a layout."""

    @property
    def evaluator(self) -> Evaluator:
        """The object that gives the friction."""


if TYPE_CHECKING:  # by name, for pyright takes no cached property for that of a protocol
    _Feelable = Feelable
else:  # a protocol cannot stand beside a model of pydantic
    _Feelable = object


class Mapped(_Feelable):
    """Base of objects that can be drawn as a map of friction: fields and materials."""

    @property
    def extent_mm(self) -> tuple[float, float, float, float]:
        """Left, right, top and bottom of the part that is worth drawing, in its axes."""
        return (0.0, 40.0, 0.0, 20.0)

    def plot(
        self, ax: Axes | None = None, extent_mm: tuple[float, float, float, float] | None = None
    ) -> Axes:
        """Draw the wanted friction for a finger that moves right at 80 mm/s and 0.5 N.

        Parameters
        ----------
        ax : Axes, optional
            Axes of matplotlib to draw into; without them, those of a new figure.
        extent_mm : (float, float, float, float), optional
            Left, right, top and bottom; without it, all that is worth drawing.

        Returns
        -------
        Axes
            The axes.
        """
        left, right, top, bottom = extent_mm or self.extent_mm
        pixel_mm = (right - left) / _PIXELS
        x = np.arange(left, right, pixel_mm) + pixel_mm / 2
        y = np.arange(top, bottom, pixel_mm) + pixel_mm / 2
        places = np.meshgrid(x, y)
        to_the_right = Motion.of(*places, 0.0, SPEED_MM_S, 0.0, FORCE_N, footprint_mm=pixel_mm / 2)
        value = self.evaluator.wanted(to_the_right).reshape(places[0].shape)
        ax = axes_or_new(ax)
        picture = ax.imshow(value, extent=(left, right, bottom, top), cmap="viridis")
        assert ax.figure is not None
        ax.figure.colorbar(picture, ax=ax, shrink=0.8, label=WORDS[self.evaluator.target])
        ax.set(xlabel="x (mm)", ylabel="y (mm)")
        return ax


class FrictionField(Mapped, ABC):
    """Target friction at every place of the screen, limited to the band that the drive can follow.

    A field depends on places alone, and so is its evaluator itself. x points right and y down, in
    millimetres from the screen's corner. A field has no state, so that any thread may use it.
    """

    depends_on = Depends.PLACE
    drives_at_rest = False

    if TYPE_CHECKING:  # fields of some, and properties of others

        @property
        def target(self) -> TargetKind:
            """Quantity of the numbers, see `as_mu`."""

        @property
        def outside(self) -> float:
            """Value outside the texture, and where a place is not a finite number."""

    @abstractmethod
    def _sample(self, x_mm: Array, y_mm: Array, footprint_mm: float | Array) -> Array:
        """`friction` at places within `FARTHEST_MM`, shape (places,); footprints of 0 or more."""

    def _anywhere(self, x_mm: Array, y_mm: Array, footprint_mm: float | Array) -> Array:
        """`_sample`, and `outside` at places that are NaN or farther than `FARTHEST_MM`."""
        # argmin and argmax find NaN, and take a fraction of the time of min and max.
        if (
            x_mm[x_mm.argmin()] >= -FARTHEST_MM
            and x_mm[x_mm.argmax()] <= FARTHEST_MM
            and y_mm[y_mm.argmin()] >= -FARTHEST_MM
            and y_mm[y_mm.argmax()] <= FARTHEST_MM
        ):
            return self._sample(x_mm, y_mm, footprint_mm)
        near = (np.abs(x_mm) <= FARTHEST_MM) & (np.abs(y_mm) <= FARTHEST_MM)
        value = self._sample(np.where(near, x_mm, 0.0), np.where(near, y_mm, 0.0), footprint_mm)
        return np.where(near, value, self.outside)

    @property
    def evaluator(self) -> FrictionField:
        """Itself."""
        return self

    def wanted(self, motion: Motion) -> Array:
        """`friction` under the fingers of a block."""
        x, y = motion.x_mm, motion.y_mm
        return self._anywhere(x, y, motion.footprint_mm) if x.size else np.empty(0)

    react = staticmethod(unmoved)

    def friction(
        self, x_mm: npt.ArrayLike, y_mm: npt.ArrayLike, footprint_mm: npt.ArrayLike = 0.0
    ) -> Array:
        """Target friction at places and footprints that broadcast together.

        Parameters
        ----------
        x_mm, y_mm : array_like
            Places. NaN, infinite and absurdly far ones have the value `outside`.
        footprint_mm : array_like
            Distance slid during one sample of the drive's envelope. Waves along the path that are
            shorter than two footprints would be felt as other, longer waves, and are left out. At
            0, below 0 or NaN the value is that of the point, with all detail. One number for a
            whole block is fastest.

        Returns
        -------
        ndarray
            Numbers of the kind `target`, of the common shape.

        Raises
        ------
        InputError
            If these are not numbers, or their shapes do not broadcast.
        """
        try:
            x = np.asarray(x_mm, dtype=np.float64)
            y = np.asarray(y_mm, dtype=np.float64)
        except (TypeError, ValueError):
            raise InputError("x_mm, y_mm: expected numbers in rows of one length") from None
        footprint: float | Array
        if isinstance(footprint_mm, float | int):
            footprint = footprint_mm if footprint_mm > 0 else 0.0
            if x.ndim == 1 and x.shape == y.shape and x.size:
                return self._anywhere(x, y, footprint)
        try:
            widths = np.fmax(np.asarray(footprint_mm, dtype=np.float64), 0.0)
        except (TypeError, ValueError):
            raise InputError(f"footprint_mm: expected numbers, got {footprint_mm!r:.80}") from None
        try:
            x, y, widths = np.broadcast_arrays(x, y, widths)
        except ValueError:
            raise InputError(
                "x_mm, y_mm and footprint_mm: expected shapes that broadcast together, got "
                f"{x.shape}, {y.shape} and {widths.shape}"
            ) from None
        if x.size == 0:
            return np.empty(x.shape)
        flat = widths.ravel()
        footprint = float(flat[0]) if (flat == flat[0]).all() else flat
        return self._anywhere(x.ravel(), y.ravel(), footprint).reshape(x.shape)


def turned(x_mm: Array, y_mm: Array, angle_deg: float) -> tuple[Array, Array]:
    """Places in axes that are turned by an angle, from x towards y."""
    if angle_deg == 0:
        return x_mm, y_mm
    c, s = np.array(cos(radians(angle_deg))), np.array(sin(radians(angle_deg)))
    return x_mm * c + y_mm * s, y_mm * c - x_mm * s


class Evaluator(Protocol):
    """Gives the wanted friction for blocks of motion, in any thread. A `FrictionField` is one."""

    @property
    def target(self) -> TargetKind:
        """Quantity of the numbers, see `haptix.feel.as_mu`."""

    @property
    def outside(self) -> float:
        """The number where there is nothing to feel."""

    @property
    def depends_on(self) -> Depends:
        """The quantities on which the numbers depend; while these stay, the numbers stay."""

    @property
    def drives_at_rest(self) -> bool:
        """Whether a finger that does not slide may get voltage."""

    def wanted(self, motion: Motion) -> Array:
        """Friction wanted under the fingers, of the motion's shape."""

    def react(self, facts: Facts, before: Report | None, now: Report) -> Facts:
        """Return a finger's facts after a report; if `before` is None, it has just come down.

        Parameters
        ----------
        facts : Facts
            Past events of the finger.
        before : Report or None
            The report before; None when it comes down.
        now : Report
            The new report.
        """


def check_feelable(name: str, texture: Any) -> None:
    """Raise `InputError` unless a renderer can render the texture.

    Parameters
    ----------
    name : str
        Name of the argument, with which the message begins.
    texture : object
        Value of the argument.
    """
    # Look at the class first: reading the instance's property may compute much.
    has_one = hasattr(type(texture), "evaluator") or hasattr(texture, "evaluator")
    if isinstance(texture, type) or not has_one:
        hint = "haptix.Texture.from_image(path, width_mm=60) reads a photograph"
        raise InputError(
            f"{name}: expected a texture, a material or a layout, got {shown(texture)}; {hint}"
        )
