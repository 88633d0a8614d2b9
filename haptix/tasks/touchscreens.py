"""The touch panel of this machine: where it lies on the picture."""

from __future__ import annotations

import time
from collections.abc import Iterator
from itertools import pairwise
from statistics import fmean, median
from typing import TYPE_CHECKING, Annotated

from pydantic import Field

from haptix.base.errors import InputError
from haptix.base.fields import FileThere, Typed
from haptix.base.task import Context, Result, Task

if TYPE_CHECKING:
    from haptix.play.touch import TouchEvent, Touchscreen

_WAITS_S = 60.0
_MOST_OFF_MM = 5.0  # of a fingertip that aims at a mark
_SLIDE_REPORTS = 40
Side = Annotated[float, Field(ge=20, le=3000)]


class CalibrateTouchscreen(Task, command="touchscreen calibrate"):
    """Find how a touch panel lies on the picture, and its size, with a finger on four marks.

    Measure the picture with a ruler, and mark four points, each --inset-mm from the nearest two
    edges. The result is kept in the screen's profile.
    """

    touchscreen: Annotated[str, Typed(is_argument=True)] = Field(
        description="Device file of the touchscreen, see `haptix devices`."
    )
    screen: FileThere = Field(description="The screen's profile, a TOML file.")
    width_mm: Side = Field(description="Width of the picture.")
    height_mm: Side = Field(description="Height of the picture.")
    inset_mm: Annotated[float, Field(ge=0, le=500)] = Field(
        20.0, description="Distance of the marks from the edges."
    )

    def run(self, context: Context) -> Result:
        """Ask for the touches, fit, and write the profile."""
        from haptix.model.screen import Screen, TouchArea
        from haptix.play.touch import Touchscreen, fitted_matrix

        if 4 * self.inset_mm > min(self.width_mm, self.height_mm):
            raise InputError("--inset-mm: expected at most a quarter of the picture's sides")
        profile = Screen.load(self.screen)
        across, down = self.inset_mm / self.width_mm, self.inset_mm / self.height_mm
        marks = {
            "upper left": (across, down),
            "upper right": (1 - across, down),
            "lower right": (1 - across, 1 - down),
            "lower left": (across, 1 - down),
        }
        # Of a size of 1 each place is a share of the panel's axis.
        with Touchscreen(self.touchscreen, 1.0, 1.0, matrix="normal") as panel:
            places = []
            for mark in marks:
                context.tell(step=f"touch the {mark} mark, and lift the finger")
                places.append(_touched(panel))
            context.tell(step="slide a finger to and fro")
            rate_hz = _rate_hz(panel)
        matrix, off = fitted_matrix(places, [*marks.values()])
        sides = (self.width_mm, self.height_mm)
        off_mm = max(((x * sides[0]) ** 2 + (y * sides[1]) ** 2) ** 0.5 for x, y in off.tolist())
        if off_mm > _MOST_OFF_MM:
            raise InputError(
                f"touchscreen: expected marks within {_MOST_OFF_MM:g} mm of a parallelogram, got "
                f"{off_mm:.1f} mm; touch the marks again, one after the other as they are named"
            )
        touch = TouchArea(
            width_mm=self.width_mm, height_mm=self.height_mm, matrix=matrix, rate_hz=rate_hz
        )
        profile.replace(touch=touch).save(self.screen)
        found = touch.model_dump(mode="json") | {"off_mm": off_mm}
        shown = {
            "rate (Hz)": rate_hz,
            "off at most (mm)": off_mm,
            "matrix": " ".join(f"{number:.4g}" for number in matrix),
        }
        return Result(found, [(f"{self.screen}: the touch panel", [shown])])


def _touched(panel: Touchscreen) -> tuple[float, float]:
    """Return the mean place of the next touch that comes down."""
    touches: dict[int, list[TouchEvent]] = {}
    for event in _events(panel):
        if event.kind == "down":
            touches[event.touch_id] = [event]
        elif event.kind == "move" and event.touch_id in touches:
            touches[event.touch_id].append(event)
        elif event.kind == "up" and (found := touches.pop(event.touch_id, None)):
            return fmean(each.x_mm for each in found), fmean(each.y_mm for each in found)
    raise InputError(f"touchscreen: expected a touch within {_WAITS_S:g} s, got none")


def _rate_hz(panel: Touchscreen) -> float:
    """Return the reports per second of a finger that slides."""
    times: list[float] = []
    for event in _events(panel):
        if event.kind == "move" and (not times or event.t_s > times[-1]):
            times.append(event.t_s)
        if len(times) > _SLIDE_REPORTS:
            break
    if len(times) < 3:
        raise InputError(f"touchscreen: expected a finger that slides within {_WAITS_S:g} s")
    return 1 / median(b - a for a, b in pairwise(times))


def _events(panel: Touchscreen) -> Iterator[TouchEvent]:
    until_s = time.monotonic() + _WAITS_S
    while time.monotonic() < until_s:
        yield from panel.read(0.2)
