"""Controls on a layout: what value each has, by the finger on it and by the app."""

from __future__ import annotations

from typing import NamedTuple

from haptix.checks import number
from haptix.errors import InputError
from haptix.layout.region import Control
from haptix.layout.regions import Regions, control_of
from haptix.motion import Report


class _Finger(NamedTuple):
    touch_id: int
    x_mm: float
    y_mm: float


class Controls:
    """Values of the controls on a layout. Any thread may ask and push."""

    def __init__(self, regions: Regions) -> None:
        self._regions = regions
        self._values: dict[int, float] = {}
        self._fingers: dict[int, _Finger] = {}  # by the control: the last that was on it

    def heard(self, touch_id: int, report: Report) -> None:
        """Take a real report of a finger, on the clock of samples."""
        regions = self._regions
        for region in regions.shown.controls:
            key, control = region.key, region.control
            if control is None or region.opacity.after[0] == 0.0:
                continue
            finger = self._fingers.get(key)
            is_its_own = finger is not None and finger.touch_id == touch_id
            if not (is_its_own or region.is_near(report)):
                continue
            there, on = region.on_outline(report)
            with regions.lock:
                if on:
                    self._fingers[key] = _Finger(touch_id, there.x_mm, there.y_mm)
                    inner = region.within(there)
                    self._values[key] = control.value(inner.x_mm, inner.y_mm)
                elif is_its_own:
                    del self._fingers[key]
                    if region.inner is not None:
                        regions.show(key, None)

    def forget(self) -> None:
        """Forget all fingers; a renderer starts anew."""
        self._fingers.clear()

    def value(self, key: int) -> float:
        """Value of a control; 0 before a finger or the app has set it.

        Raises
        ------
        InputError
            If the region is no control.
        """
        self._control(key)
        return self._values.get(key, 0.0)

    def push(self, key: int, value: float) -> None:
        """Set the value of a control; a finger on it has that value from then on."""
        control = self._control(key)
        value = number("value", value, 0.0)
        if value > 1:
            raise InputError(f"value: expected 0 to 1, got {value:g}")
        with self._regions.lock:
            self._values[key] = value
            finger = self._fingers.get(key)
            if finger is not None:
                frame = control.frame_at(value, finger.x_mm, finger.y_mm)
                self._regions.show(key, frame)

    def _control(self, key: int) -> Control:
        control = control_of(self._regions.given(key).material)
        if control is None:
            raise InputError(
                "value: expected a control, such as haptix.materials.Slider; this material has "
                "no value"
            )
        return control
