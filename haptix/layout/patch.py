"""A region on a layout, as an app holds it."""

from __future__ import annotations

from typing import Any

from haptix.checks import choice, number
from haptix.layout.controls import Controls
from haptix.layout.regions import GLIDE_S, Region, Regions
from haptix.region import Place
from haptix.texture import Feelable


class Patch:
    """A region on a layout; any thread may change it, at any time."""

    def __init__(self, regions: Regions, controls: Controls, key: int, material: Feelable) -> None:
        self._regions = regions
        self._controls = controls
        self.key = key
        self.material = material

    def move(
        self,
        x_mm: float | None = None,
        y_mm: float | None = None,
        *,
        over_s: float = GLIDE_S,
        **place: float | None,
    ) -> None:
        """Move along a line, from where it is; what is left out stays.

        Parameters
        ----------
        x_mm, y_mm : float, optional
            New corner, before it is turned.
        over_s : float
            Time that it takes; at 0 it jumps.
        **place
            The rotation and `scale`, see `haptix.region.RegionFields`.
        """
        choices = Place.model_fields.keys() | {"scale"}
        values = {choice("move", name, choices): one for name, one in place.items()}
        given = {"x_mm": x_mm, "y_mm": y_mm, **values}
        changed = {name: one for name, one in given.items() if one is not None}
        self._regions.move(self.key, changed, number("over_s", over_s, 0.0))

    def set(self, **changes: Any) -> None:
        """Change the material, or anything else that `Layout.add` takes, in a cross-fade.

        With `value`, set that of a control: a slider, toggle or dial. A finger that is on it is at
        this value from then on: detents move with the value, and none counts as crossed. Once that
        finger has left, they lie where they were.
        """
        value = changes.pop("value", None)
        with self._regions.change():
            if changes:
                self._regions.set(self.key, changes)
                self.material = changes.get("material", self.material)
            if value is not None:
                self._controls.push(self.key, value)

    def remove(self) -> None:
        """Take it off the layout; it fades out. Nothing happens if it is gone."""
        self._regions.remove(self.key)

    @property
    def value(self) -> float:
        """Value of a control, 0 to 1: of the finger that was on it last, or what was set."""
        return self._controls.value(self.key)

    @property
    def is_there(self) -> bool:
        """Whether it is on the layout."""
        return self._regions.has(self.key)

    @property
    def region(self) -> Region:
        """Its fields; where a move goes."""
        return self._regions.given(self.key)

    @property
    def x_mm(self) -> float:
        """Corner, before it is turned; where a move goes."""
        return self.region.x_mm or 0.0

    @property
    def y_mm(self) -> float:
        """See `x_mm`."""
        return self.region.y_mm or 0.0

    @property
    def scale(self) -> float:
        """Millimetres on the screen for one of the material's; where a move goes."""
        return self.region.scale or 1.0

    @property
    def width_mm(self) -> float:
        """Width on the screen, before it is turned."""
        return self.region.size_mm[0] * self.scale

    @property
    def height_mm(self) -> float:
        """Height on the screen, before it is turned."""
        return self.region.size_mm[1] * self.scale

    def __repr__(self) -> str:
        return f"Patch({self.key}, {self.material!r:.60})"
