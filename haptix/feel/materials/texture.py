"""A texture: a map of friction over the screen, from a photograph or a height map."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import cos, radians, sin
from pathlib import Path
from typing import Annotated, Any, Literal, Self, cast, get_args

import numpy as np
import numpy.typing as npt
from pydantic import Field, PositiveFloat, model_validator

from haptix.base.checks import Array, choice, number, positive, shown
from haptix.base.display import Displayed
from haptix.base.documents import Document
from haptix.base.errors import FileFormatError, InputError
from haptix.base.kinds import AnyAsset
from haptix.feel.materials.decoded import LARGEST_BYTES
from haptix.feel.materials.field import FrictionField, TargetKind, check_range
from haptix.feel.materials.material import Scaled
from haptix.feel.materials.pyramid import Pyramid

HeightRule = Literal["height", "slope-magnitude", "slope-along"]
"""``"height"``: the higher, the more friction. ``"slope-magnitude"``: the steeper in whatever
direction, the more. ``"slope-along"``: like the lateral force on a finger that strokes along
`direction_deg`, more uphill and less downhill, with level 0.5 on the flat (Robles-De-La-Torre and
Hayward, Nature 412, 445 (2001)); a stroke against the direction feels it inside out."""

LEFT_OUT: float = cast("float", None)
"""An end that is not given: 0 or 1 of a share, refused for other targets."""

_CLIPPED = 99.0  # percentile of steepness that is the end of the range


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
    """Levels from 0 to 1 between the 1st and 99th percentile, which single pixels do not move."""
    low, high = np.percentile(values, (1.0, 99.0))
    if high <= low:
        raise InputError("image: expected some contrast, got pixels of one grey")
    level = values - low
    level /= high - low
    return np.asarray(np.clip(level, 0.0, 1.0, out=level))


Polarity = Literal["bright-high", "dark-high"]


class Sidecar(Document):
    """Size and friction of a photograph; JSON beside it, ``brick.json`` for ``brick.png``.

    Parameters
    ----------
    width_mm : float
        Width on the screen.
    polarity : {"bright-high", "dark-high"}
        Which end of the grey scale has the higher friction.
    target : {"mu", "contrast", "share"}
        What `low` and `high` are, see `haptix.feel.as_mu`.
    low, high : float
        Values of the two ends of the grey scale; 0 and 1 where the target is a share.
    """

    width_mm: Annotated[float, Field(gt=0, strict=True)]
    polarity: Polarity
    target: Literal["mu", "contrast", "share"] = "share"
    low: Annotated[float, Field(strict=True)] = 0.0
    high: Annotated[float, Field(strict=True)] = 1.0

    @model_validator(mode="after")
    def _is_a_range(self) -> Self:
        if self.target != "share" and not {"low", "high"} <= self.model_fields_set:
            raise ValueError(f"expected low and high for a target of {self.target}")
        check_range("low, high", self.target, self.low, self.high)
        return self

    @classmethod
    def path_for(cls, image: str | Path) -> Path:
        """Path of the sidecar of an image."""
        return Path(image).with_suffix(".json")

    @classmethod
    def load(cls, path: str | Path) -> Self:
        """Read a JSON file; see `haptix.base.documents.Document.load`."""
        if not Path(path).exists():
            raise FileFormatError(
                f"cannot read {path}: no such file; it says how the image beside it is felt: "
                '{"width_mm": 60, "polarity": "bright-high"}'
            )
        return super().load(path)


_COARSE_MM = 0.5  # coarser pixels are split; a fingertip resolves about a millimetre

_MOST_PIXELS = 4_000_000  # of a map after its pixels are split


@dataclass(frozen=True)
class Texture(Displayed, FrictionField):
    """Friction over a rectangle with its corner at (0, 0), x to the right and y downwards.

    Without a target a level is a share of the reachable friction range at the finger's force.
    Beyond the edges the level is 0, the lowest friction. With a footprint the edge is a ramp at
    least as wide as a pixel, since a step would alias; at a point it is a step.

    Parameters
    ----------
    level : ndarray, shape (rows, columns)
        0 to 1: from the lowest to the highest friction, at the pixels' centres.
    width_mm : float
        Width on the screen; the height follows from the pixels, which are square.
    target : {"share", "mu", "contrast"}
        Quantity of `low` and `high`: shares of the reach of the screen, friction coefficients, or
        relative changes of friction; see `haptix.feel.as_mu`.
    low, high : float
        Friction at levels 0 and 1; of a share, 0 and 1 where they are left out.
    beyond : {"outside", "hold"}
        Level beyond the edges: level 0, or that of the edge.

    Raises
    ------
    InputError
        If a value is outside its range, or missing.

    Examples
    --------
    >>> from haptix.feel import Motion
    >>> stripes = Texture([[0.0, 1.0, 0.0, 1.0]], width_mm=4.0)
    >>> stripes.pixel_mm, stripes.height_mm
    (1.0, 1.0)
    >>> stripes.evaluator.wanted(Motion.of([1.5, 2.5], 0.5)).tolist()  # amid two pixels
    [1.0, 0.0]
    """

    level: Array
    width_mm: float
    target: TargetKind = "share"
    low: float = LEFT_OUT
    high: float = LEFT_OUT
    beyond: Literal["outside", "hold"] = "outside"

    def __post_init__(self) -> None:
        positive("width_mm", self.width_mm)
        try:
            level = np.asarray(self.level, dtype=np.float64)
        except (TypeError, ValueError):
            raise InputError(
                f"level: expected rows of numbers, got {shown(self.level)}; haptix.Texture."
                "from_image(path, width_mm) reads a photograph"
            ) from None
        object.__setattr__(self, "level", level)
        if level.ndim != 2 or 0 in level.shape or not ((level >= 0) & (level <= 1)).all():
            raise InputError(
                f"level: expected a map of values from 0 to 1, got shape {level.shape}"
            )
        number("width_mm of a pixel", self.pixel_mm, least=1e-9)
        choice("beyond", self.beyond, ("outside", "hold"))
        choice("target", self.target, ("share", "mu", "contrast"))
        for name, of_share in (("low", 0.0), ("high", 1.0)):
            value = getattr(self, name)
            if value is LEFT_OUT and self.target == "share":
                object.__setattr__(self, name, of_share)
            elif value is LEFT_OUT:
                raise InputError(f"expected low and high for a target of {self.target}")
            number(name, getattr(self, name))
        check_range("low, high", self.target, self.low, self.high)

    @classmethod
    def from_image(
        cls,
        image: str | Path | npt.ArrayLike,
        width_mm: float,
        polarity: Polarity = "bright-high",
        target: TargetKind = "share",
        low: float = LEFT_OUT,
        high: float = LEFT_OUT,
        largest_bytes: int = LARGEST_BYTES,
    ) -> Self:
        """Take a photograph: grey between its 1st and 99th percentile becomes level 0 to 1.

        Where it is transparent, friction is the lowest.

        Parameters
        ----------
        image : path or array_like
            A file, or grey (rows, columns) or colour (rows, columns, 3 or 4) pixels.
        polarity : {"bright-high", "dark-high"}
            Which end of the grey scale has the higher friction.
        width_mm, target, low, high
            See the class.
        largest_bytes : int
            Memory that the texture may take while it is made.

        Raises
        ------
        InputError
            If the file is missing, not an image or too large, or a value is outside its range.

        Examples
        --------
        >>> grey = np.tile(np.linspace(0.0, 1.0, 64), (32, 1))
        >>> texture = Texture.from_image(grey, width_mm=32.0, target="mu", low=0.2, high=0.4)
        >>> texture.target, texture.outside
        ('mu', 0.2)
        """
        from haptix.feel.materials.pictures import read_grey  # needs an extra

        choice("polarity", polarity, get_args(Polarity))
        beneath = float(polarity == "dark-high")  # the colour of the lowest friction
        level = stretched(read_grey(image, largest_bytes, beneath))
        if polarity == "dark-high":
            level = 1 - level
        return cls(level, width_mm, target, low, high)

    @classmethod
    def load(cls, image: str | Path, largest_bytes: int = LARGEST_BYTES) -> Self:
        """Read a photograph with the JSON beside it, see `haptix.feel.Sidecar`.

        Parameters
        ----------
        image : str or Path
            The photograph; the other file has the same name with ``.json``.
        largest_bytes : int
            Size in memory that it may take.

        Raises
        ------
        FileFormatError, InputError
            If one of the two files is missing, or is of another format.
        """
        beside = Sidecar.load(Sidecar.path_for(image))
        how = (beside.width_mm, beside.polarity, beside.target, beside.low, beside.high)
        return cls.from_image(image, *how, largest_bytes)

    @classmethod
    def from_heights(
        cls,
        heights: str | Path | npt.ArrayLike,
        width_mm: float,
        rule: HeightRule,
        direction_deg: float = 0.0,
        target: TargetKind = "share",
        low: float = LEFT_OUT,
        high: float = LEFT_OUT,
        largest_bytes: int = LARGEST_BYTES,
    ) -> Self:
        """Take a height map, bright or large being high.

        Parameters
        ----------
        heights : path or array_like
            An image file, or heights of shape (rows, columns) in any unit.
        rule : {"height", "slope-magnitude", "slope-along"}
            What makes friction, see `haptix.feel.HeightRule`.
        direction_deg : float
            Direction of the stroke for "slope-along": 0 to the right, 90 down.
        width_mm, target, low, high, largest_bytes
            See the class and `from_image`.

        Raises
        ------
        InputError
            If the heights cannot be read or hold nothing to feel, or a value is outside its range.
        """
        from haptix.feel.materials.pictures import read_grey  # needs an extra

        number("direction_deg", direction_deg)
        level = levels_by_rule(read_grey(heights, largest_bytes), rule, direction_deg)
        return cls(level, width_mm, target, low, high)

    @cached_property
    def pyramid(self) -> Pyramid:
        """Its map, computed at first use: a layout uses a copy that is held at its edges."""
        low, high = self.low, self.high
        level = self.level
        values = level if (low, high) == (0.0, 1.0) else low + (high - low) * level
        finer = _finer(self.pixel_mm, values.shape)
        if finer > 1:  # bilinear between the pixels' centres
            from scipy.ndimage import zoom

            values = zoom(values, finer, order=1, mode="nearest", grid_mode=True)
        return Pyramid(values, self.pixel_mm / finer, low, self.beyond, self.beyond)

    @property
    def evaluator(self) -> Self:
        """Itself, with its pyramid computed."""
        _ = self.pyramid
        return self

    @property
    def outside(self) -> float:
        """Value of level 0."""
        return self.low

    @property
    def extent_mm(self) -> tuple[float, float, float, float]:
        """Left, right, top and bottom [mm]."""
        return (0.0, self.width_mm, 0.0, self.height_mm)

    @property
    def pixel_mm(self) -> float:
        """Side of a pixel."""
        return self.width_mm / int(self.level.shape[1])

    @property
    def height_mm(self) -> float:
        """Height on the screen."""
        return self.pixel_mm * int(self.level.shape[0])

    def _anywhere(self, x_mm: Array, y_mm: Array, footprint_mm: float | Array) -> Array:
        if isinstance(footprint_mm, np.ndarray) or footprint_mm > 0 or self.beyond == "hold":
            return self.pyramid.sample(x_mm, y_mm, footprint_mm)
        return super()._anywhere(x_mm, y_mm, 0.0)

    def _sample(self, x_mm: Array, y_mm: Array, footprint_mm: float | Array) -> Array:
        # At a point the edge is a step. The pyramid has a ramp there, so read inside of it.
        half, width, height = self.pixel_mm / 2, self.width_mm, self.height_mm
        inside = (x_mm >= 0) & (x_mm <= width) & (y_mm >= 0) & (y_mm <= height)
        x_mm, y_mm = x_mm.clip(half, width - half), y_mm.clip(half, height - half)
        return np.where(inside, self.pyramid.sample(x_mm, y_mm, 0.0), self.outside)


def _finer(pixel_mm: float, shape: tuple[int, ...]) -> int:
    """Parts into which a coarse map's pixels are split.

    The ramp at the map's edge is a pixel wide, which would be most of a map of a few pixels. With
    an odd number of parts one lies at every old centre, so that the values there stay.
    """
    parts = min(pixel_mm / _COARSE_MM, (_MOST_PIXELS / (shape[0] * shape[1])) ** 0.5)
    return max(1, 2 * int(parts / 2) + 1)


class _Pictured(Scaled):
    """Base of the documents of a `Texture`.

    Parameters
    ----------
    width_mm : float
        Width on the screen; the height follows from the pixels.
    """

    file: AnyAsset
    width_mm: PositiveFloat

    @cached_property
    def evaluator(self) -> Texture:
        """The texture; documents of one picture share it."""
        parameters = self.model_dump(mode="json", exclude={"file"})
        ends = (self.target, self.low, self.high)
        return self.file.shared(parameters, lambda path: self._texture(path, ends))

    def _texture(self, path: Path, ends: Any) -> Texture:
        raise NotImplementedError

    @property
    def extent_mm(self) -> tuple[float, float, float, float]:
        """Its size."""
        return (0.0, self.evaluator.width_mm, 0.0, self.evaluator.height_mm)


class Photograph(_Pictured):
    """A photograph, whose grey from the 1st to the 99th percentile becomes friction.

    Parameters
    ----------
    file : str
        The photograph: PNG, JPEG or TIFF.
    polarity : {"bright-high", "dark-high"}
        Which end of the grey scale has the higher friction.
    """

    kind: Literal["photograph"] = "photograph"
    polarity: Polarity = "bright-high"

    def _texture(self, path: Path, ends: Any) -> Texture:
        return Texture.from_image(path, self.width_mm, self.polarity, *ends)


class Heights(_Pictured):
    """A height map, felt by one rule; `relief` is right in every direction.

    Parameters
    ----------
    file : str
        Picture of the heights, bright is high.
    rule : {"height", "slope-magnitude", "slope-along"}
        What makes friction.
    direction_deg : float
        Direction of the stroke for "slope-along": 0 to the right, 90 down.
    """

    kind: Literal["heights"] = "heights"
    rule: HeightRule = "height"
    direction_deg: float = 0.0

    def _texture(self, path: Path, ends: Any) -> Texture:
        return Texture.from_heights(path, self.width_mm, self.rule, self.direction_deg, *ends)
