"""Check the ranges of a surface."""

from __future__ import annotations

from collections.abc import Mapping
from math import isfinite
from typing import Any

from haptix.errors import InputError, LimitError
from haptix.friction import ContactModel
from haptix.surface.axes import AXIS_NAMES

Ranges = Mapping[str, tuple[float, float] | None]

_NAMES = (*AXIS_NAMES, "voltage_v")


def read_ranges(model: ContactModel, scene: Any) -> dict[str, tuple[float, float] | None]:
    """Complete and check ranges: ``(low, high)`` per axis, None where absent.

    Parameters
    ----------
    model : ContactModel
        Gives the defaults.
    scene : mapping, or an object with ``ranges()``
        ``(low, high)`` or one value by name.
    """
    if not isinstance(scene, Mapping) and not hasattr(scene, "ranges"):
        raise InputError(f"scene: expected a scene or ranges by name, got {scene!r}")
    given = scene if isinstance(scene, Mapping) else scene.ranges()
    unknown = set(given) - set(_NAMES)
    if unknown:
        raise InputError(
            f"unknown range {', '.join(sorted(unknown))}: expected some of {', '.join(_NAMES)}"
        )
    ranges = {
        **dict.fromkeys(AXIS_NAMES),
        "normal_force_n": (0.1, 1.0),
        "h0_m": model.screen.h0_m,
        "voltage_v": (0.0, model.screen.max_voltage_v),
        **given,
    }
    checked = {name: _read_range(name, value) for name, value in ranges.items()}
    force, voltage = checked["normal_force_n"], checked["voltage_v"]
    if force is None or voltage is None:
        raise InputError("normal_force_n and voltage_v: expected a range, got None")
    if checked["h0_m"] is None:
        checked["h0_m"] = (model.screen.h0_m, model.screen.h0_m)
    if voltage[1] > model.screen.max_voltage_v:
        raise LimitError(
            f"voltage_v: {voltage[1]:g} V is above the limit of "
            f"{model.screen.max_voltage_v:g} V of screen {model.screen.name!r}; lower the range"
        )
    if voltage[1] <= 0:
        raise InputError("voltage_v: expected a range that reaches above 0 V")
    return checked


def _read_range(name: str, value: Any) -> tuple[float, float] | None:
    if value is None:
        return None
    if hasattr(value, "tolist"):
        value = value.tolist()
    try:
        ends = value if isinstance(value, tuple | list) else (value, value)
        if any(isinstance(end, str | bool) for end in ends):
            raise TypeError
        low, high = map(float, ends)
    except (TypeError, ValueError):
        raise InputError(f"{name}: expected (low, high) or one value, got {value!r}") from None
    least = 0.0 if name == "voltage_v" else 1e-300
    if not (isfinite(low) and isfinite(high) and least <= low <= high):
        raise InputError(
            f"{name}: expected finite low <= high, {'0 or more' if least == 0 else 'above 0'}, "
            f"got ({low:g}, {high:g})"
        )
    return low, high
