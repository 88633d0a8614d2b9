"""Where a region of a layout lies, and how: declared once, for Python, documents and the wire.

The schema of the messages, and the types of all clients, are made from these classes.
"""

from __future__ import annotations

from math import cos, radians, sin
from typing import Annotated, Any, Literal

from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    ValidationError,
    ValidatorFunctionWrapHandler,
    WrapValidator,
)

from haptix.base.files import checked_values

Number = Annotated[float, Field(allow_inf_nan=False)]
Size = Annotated[float, Field(gt=0, le=1e4, allow_inf_nan=False)]
GroupName = Annotated[str, Field(min_length=1, max_length=100), AfterValidator(checked_values)]
Blend = Literal["over", "add", "multiply", "max", "min"]


def _one_sentence(shape: Any, read: ValidatorFunctionWrapHandler) -> Any:
    if isinstance(shape, list):  # JSON has lists, and a strict model takes tuples only here
        shape = tuple(tuple(each) if isinstance(each, list) else each for each in shape)
    try:
        return read(shape)
    except ValidationError:
        raise ValueError("expected rectangle, ellipse, or 3 corners (x_mm, y_mm) to 256") from None


Shape = Annotated[
    Literal["rectangle", "ellipse"]
    | Annotated[tuple[tuple[Number, Number], ...], Field(min_length=3, max_length=256)],
    WrapValidator(_one_sentence),
]
"""A rectangle, the ellipse in it, or the corners of a polygon [mm] from the region's corner."""


class _Fields(BaseModel):
    # Built at their first use: most processes use only some of them.
    model_config = ConfigDict(frozen=True, extra="forbid", defer_build=True)


class Place(_Fields):
    """Where a region lies; a None keeps the value, or takes that of a new region.

    Parameters
    ----------
    x_mm, y_mm : float, optional
        Corner on the screen, upper left, before it is turned; 0 of a new region.
    rotation_deg : float, optional
        Rotation about the middle, clockwise; 0 of a new region.
    """

    x_mm: Number | None = None
    y_mm: Number | None = None
    rotation_deg: Number | None = None


class RegionFields(Place):
    """Where a region lies, and how it combines with the regions below.

    Parameters
    ----------
    width_mm, height_mm : float, optional
        Size; some materials have their own. A button or toggle that states none has this one.
    shape : {"rectangle", "ellipse"} or sequence of (x_mm, y_mm), optional
        The outline; a rectangle of a new region.
    scale : float, optional
        Millimetres on the screen for one of the material's, about the corner; the size grows with
        it. 1 of a new region.
    z : float, optional
        Order: a higher region lies on top; of two at one height, the later one. 0 of a new region.
    blend : {"over", "add", "multiply", "max", "min"}, optional
        How it changes the friction below it: over it, of a new region. One that multiplies is a
        share.
    opacity : float, optional
        0 to 1; 1 of a new region.
    priority : int, optional
        Of several fingers, those on the region of the highest priority get the electrode. 0 of a
        new region.
    group : str, optional
        Name of the regions that an editor chooses together; nothing of it is felt.
    """

    width_mm: Size | None = None
    height_mm: Size | None = None
    shape: Shape | None = None
    scale: Size | None = None
    z: Number | None = None
    blend: Blend | None = None
    opacity: Annotated[float, Field(ge=0, le=1)] | None = None
    priority: Annotated[int, Field(ge=-1000, le=1000)] | None = None
    group: GroupName | None = None

    def corner(self, width_mm: float, height_mm: float) -> tuple[float, float, float, float]:
        """Turned corner x, y [mm], angle [rad] and scale of a region of a size.

        Parameters
        ----------
        width_mm, height_mm : float
            The region's size [mm], before it is scaled.
        """
        x, y = self.x_mm or 0.0, self.y_mm or 0.0
        angle, scale = radians(self.rotation_deg or 0.0), self.scale or 1.0
        if angle == 0.0:
            return x, y, 0.0, scale
        half_x, half_y = width_mm * scale / 2, height_mm * scale / 2
        c, s = cos(angle), sin(angle)
        corner = x + half_x - half_x * c + half_y * s, y + half_y - half_x * s - half_y * c
        return *corner, angle, scale


class PixelPlaces(_Fields):
    """Pixels to millimetres: ``mm = origin + turn(rotation) (px / px_per_mm)``."""

    px_per_mm: Annotated[float, Field(gt=0, le=1e4, allow_inf_nan=False)]
    origin_mm: tuple[Number, Number] = (0.0, 0.0)
    rotation_deg: Number = 0.0

    def mm(self, x_px: float, y_px: float) -> tuple[float, float]:
        """Place on the screen [mm]."""
        turn, x, y = radians(self.rotation_deg), x_px / self.px_per_mm, y_px / self.px_per_mm
        return (
            self.origin_mm[0] + x * cos(turn) - y * sin(turn),
            self.origin_mm[1] + x * sin(turn) + y * cos(turn),
        )
