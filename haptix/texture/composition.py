"""Compositions: sprites with places, masks and an order, on a background."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal, get_args

import numpy as np

from haptix.checks import Array, Positive, check_fields, choice, number
from haptix.errors import InputError
from haptix.texture.field import FrictionField, TargetKind, check_target
from haptix.texture.recorded import RecordedProfile
from haptix.texture.texture import Texture

Blend = Literal["over", "add", "multiply", "max", "min"]
_RULES = {"add": np.add, "multiply": np.multiply, "max": np.maximum, "min": np.minimum}


@dataclass(frozen=True)
class Sprite:
    """A field within a shape, somewhere on the screen.

    Parameters
    ----------
    field : FrictionField
        The texture; its origin lies at the sprite's corner.
    x_mm, y_mm : float
        Corner on the screen, upper left.
    width_mm, height_mm : float, optional
        Size; a texture has its own.
    z : float
        Order: a higher sprite lies on top; of two at one height, the later one.
    blend : {"over", "add", "multiply", "max", "min"}
        How the sprite changes the friction below it. One that multiplies must be a share.
    opacity : float
        Opacity, 0 to 1.
    shape : {"rectangle", "ellipse"}
        Its outline, the ellipse within the rectangle.
    mask : FrictionField, optional
        Opacity at every place of the sprite, as a share.

    Raises
    ------
    InputError
        If a value is outside its range, or the size is missing.
    """

    field: FrictionField
    x_mm: float = 0.0
    y_mm: float = 0.0
    width_mm: Positive | None = None
    height_mm: Positive | None = None
    z: float = 0.0
    blend: Blend = "over"
    opacity: float = 1.0
    shape: Literal["rectangle", "ellipse"] = "rectangle"
    mask: FrictionField | None = None

    def __post_init__(self) -> None:
        if not isinstance(self.field, FrictionField):
            raise InputError(
                "field: expected a texture or another field of friction, got a "
                f"{type(self.field).__name__}"
            )
        for name in ("width_mm", "height_mm"):
            if getattr(self, name) is None:
                if not isinstance(self.field, Texture):
                    raise InputError(f"{name}: expected a size, since the field has none")
                object.__setattr__(self, name, getattr(self.field, name))
        check_fields(self)
        choice("blend", self.blend, get_args(Blend))
        choice("shape", self.shape, ("rectangle", "ellipse"))
        if not 0 <= self.opacity <= 1:
            raise InputError(f"opacity: expected 0 to 1, got {self.opacity:g}")
        if self.blend == "multiply" and self.field.target != "share":
            raise InputError(
                f"blend: a sprite that multiplies is a share, got a field of {self.field.target}"
            )
        if self.mask is not None:
            if getattr(self.mask, "target", None) != "share":
                raise InputError(
                    "mask: expected a field of shares, got "
                    f"{getattr(self.mask, 'target', type(self.mask).__name__)!r}"
                )
            object.__setattr__(self, "mask", held(self.mask))
        object.__setattr__(self, "field", held(self.field))

    def cover(
        self, x_mm: Array, y_mm: Array, box: _Box, footprint_mm: float | Array
    ) -> float | Array:
        """Opacity of the sprite at places on the screen within a box, shape (places,): 0 to 1.

        One number if it is the same at all places.
        """
        width, height = self.width_mm or 0.0, self.height_mm or 0.0  # never None: set above
        left, right = box.left - self.x_mm, box.right - self.x_mm
        top, bottom = box.top - self.y_mm, box.bottom - self.y_mm
        half = 2 * box.footprint_mm + 1e-9
        if left > width + half or right < -half or top > height + half or bottom < -half:
            return 0.0
        level = left > half and right < width - half and top > half and bottom < height - half
        if level and self.shape == "rectangle" and self.mask is None:
            return float(self.opacity)
        x_mm, y_mm = x_mm - self.x_mm, y_mm - self.y_mm
        ramp = np.maximum(4 * np.asarray(footprint_mm), 1e-9)
        if self.shape == "ellipse":
            a, b = width / 2, height / 2
            depth = (1 - np.hypot(x_mm / a - 1, y_mm / b - 1)) * min(a, b)
            opaque = _step(depth, ramp)
        else:
            # A step less the next one is right for sprites narrower than the ramps, too.
            opaque = _step(x_mm, ramp) - _step(x_mm - width, ramp)
            opaque *= _step(y_mm, ramp) - _step(y_mm - height, ramp)
        if self.mask is not None:
            share = self.mask._sample(x_mm, y_mm, 2 * footprint_mm)
            opaque = opaque * np.clip(share, 0.0, 1.0)
        return np.asarray(self.opacity * opaque)


@dataclass(frozen=True)
class _Box:
    """The bounding box of some places, and their widest footprint [mm]."""

    left: float
    right: float
    top: float
    bottom: float
    footprint_mm: float

    @classmethod
    def around(cls, x_mm: Array, y_mm: Array, footprint_mm: float | Array) -> _Box:
        return cls(
            float(x_mm[x_mm.argmin()]),
            float(x_mm[x_mm.argmax()]),
            float(y_mm[y_mm.argmin()]),
            float(y_mm[y_mm.argmax()]),
            float(footprint_mm.max()) if isinstance(footprint_mm, np.ndarray) else footprint_mm,
        )


@dataclass(frozen=True)
class Composition(FrictionField):
    """Sprites on a background.

    Edges of sprites are ramps of four footprints; at a point they are steps. A product has the sums
    of its factors' wavenumbers, so with a sprite that multiplies every layer is evaluated at twice
    the footprint. "max" and "min" leave kinks where their fields cross; these are not band-limited.

    Parameters
    ----------
    sprites : sequence of Sprite
        In any order of their z.
    background : float or FrictionField
        Friction below all sprites.
    target : {"mu", "contrast", "share"}, optional
        What the values are; by default as in the background. All sprites must have the same, except
        those that multiply.

    Raises
    ------
    InputError
        If targets differ.
    """

    sprites: Sequence[Sprite]
    background: float | FrictionField = 0.0
    target: TargetKind = None  # type: ignore[assignment]  # replaced below, never None

    def __post_init__(self) -> None:
        below = self.background
        if self.target is None:
            target = below.target if isinstance(below, FrictionField) else "share"
            object.__setattr__(self, "target", target)
        check_target(self.target)
        if isinstance(below, FrictionField):
            if below.target != self.target:
                raise InputError(
                    f"background: expected a target of {self.target}, got {below.target}"
                )
        else:
            number("background", below)
        try:
            sprites = tuple(self.sprites)
        except TypeError:
            raise InputError("sprites: expected a list of them") from None
        for i, sprite in enumerate(sprites):
            if not isinstance(sprite, Sprite):
                raise InputError(f"sprite {i}: expected a Sprite, got a {type(sprite).__name__}")
            if sprite.blend != "multiply" and sprite.field.target != self.target:
                raise InputError(
                    f"sprite {i}: expected a target of {self.target}, the composition's, got "
                    f"{sprite.field.target}"
                )
        object.__setattr__(self, "sprites", tuple(sorted(sprites, key=lambda sprite: sprite.z)))

    @property
    def outside(self) -> float:
        """The background, or its own outside."""
        below = self.background
        return below.outside if isinstance(below, FrictionField) else float(below)

    def _sample(self, x_mm: Array, y_mm: Array, footprint_mm: float | Array) -> Array:
        if any(sprite.blend == "multiply" for sprite in self.sprites):
            footprint_mm = 2 * footprint_mm
        box = _Box.around(x_mm, y_mm, footprint_mm)
        layers: list[tuple[Sprite, float | Array]] = []
        hidden = False
        for sprite in reversed(self.sprites):
            cover = sprite.cover(x_mm, y_mm, box, footprint_mm)
            if isinstance(cover, float) and cover == 0:
                continue
            layers.append((sprite, cover))
            if isinstance(cover, float) and cover == 1 and sprite.blend == "over":
                hidden = True  # and so is all below it
                break
        value: float | Array = 0.0
        below = self.background
        if not hidden and isinstance(below, FrictionField):
            value = below._sample(x_mm, y_mm, footprint_mm)
        elif not isinstance(below, FrictionField):
            value = np.full(x_mm.shape, float(below))
        for sprite, cover in reversed(layers):
            x, y = x_mm - np.array(sprite.x_mm), y_mm - np.array(sprite.y_mm)
            felt = sprite.field._sample(x, y, footprint_mm)
            if isinstance(cover, float) and cover == 1:
                value = blended(sprite.blend, value, felt)
            else:
                value = value + cover * (blended(sprite.blend, value, felt) - value)
        return np.asarray(value)


def blended(blend: Blend, below: float | Array, felt: Array) -> Array:
    """Friction of a layer on what is below it."""
    rule = _RULES.get(blend)
    return felt if rule is None else np.asarray(rule(below, felt))


def _step(depth_mm: Array, ramp_mm: Array) -> Array:
    """Return a step from 0 to 1, as a ramp around a depth of 0."""
    return np.asarray(np.clip(0.5 + depth_mm / ramp_mm, 0.0, 1.0))


def held(field: FrictionField) -> FrictionField:
    """Return the field, held beyond its edges: a sprite ends at its outline."""
    if isinstance(field, Texture | RecordedProfile) and field.beyond == "outside":
        return replace(field, beyond="hold")
    return field
