"""Request for a surface: its ranges, and the key under which the cache stores the result."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from functools import cache
from math import inf
from pathlib import Path
from typing import Any

from haptix.errors import InputError, LimitError
from haptix.files import digest
from haptix.friction import ContactModel
from haptix.perception import WEBER_FRACTION
from haptix.surface.axes import AXES, AXIS_NAMES
from haptix.surface.tolerance import Tolerance
from haptix.version import __version__

Ranges = Mapping[str, tuple[float, float] | None]

_NAMES = (*AXIS_NAMES, "voltage_v")


def read_ranges(model: ContactModel, scene: Any) -> dict[str, tuple[float, float] | None]:
    """Complete and check ranges: ``(low, high)`` by name, None for an axis that is left out.

    `scene` is a mapping, or an object with ``ranges()``; the model gives the defaults.
    """
    if not isinstance(scene, Mapping) and not hasattr(scene, "ranges"):
        raise InputError(f"scene: expected a scene or ranges by name, got {scene!r}")
    named = scene if isinstance(scene, Mapping) else scene.ranges()
    unknown = set(named) - set(_NAMES)
    if unknown:
        raise InputError(
            f"unknown range {', '.join(sorted(unknown))}: expected any of {', '.join(_NAMES)}"
        )
    screen = model.screen
    ranges: dict[str, Any] = {"voltage_v": (0.0, screen.max_voltage_v), **named}
    for axis in AXES:
        if axis.name not in ranges or (axis.is_collapsible and ranges[axis.name] is None):
            ranges[axis.name] = axis.default(screen)
    checked = {name: _read_range(name, ranges[name]) for name in _NAMES}
    force, voltage = checked["normal_force_n"], checked["voltage_v"]
    if force is None or voltage is None:
        raise InputError("normal_force_n and voltage_v: expected a range, got None")
    if voltage[1] > screen.max_voltage_v:
        raise LimitError(
            f"voltage_v: {voltage[1]:g} V is above the limit of "
            f"{screen.max_voltage_v:g} V of screen {screen.name!r}; lower the range"
        )
    if voltage[1] <= 0:
        raise InputError("voltage_v: expected a range that reaches above 0 V")
    return checked


def _read_range(name: str, value: Any) -> tuple[float, float] | None:
    zero = name == "voltage_v"
    try:
        return None if value is None else low_and_high(value, zero)
    except ValueError:
        raise InputError(
            f"{name}: expected (low, high) or one value, with finite low <= high, "
            f"{'0 or more' if zero else 'above 0'}, got {value!r}"
        ) from None


def low_and_high(value: Any, zero: bool = False) -> tuple[float, float]:
    """Return a finite range above 0, or with `zero` from 0; a single number is both ends.

    Other values raise `ValueError`, which pydantic turns into its error.
    """
    if hasattr(value, "tolist"):
        value = value.tolist()
    ends = value if isinstance(value, tuple | list) else (value, value)
    try:
        if any(isinstance(end, str | bool) for end in ends):
            raise TypeError
        low, high = map(float, ends)
    except (TypeError, ValueError):
        raise ValueError("expected one number, or [low, high]") from None
    if not ((low >= 0 if zero else low > 0) and low <= high < inf):
        raise ValueError(f"expected finite 0 {'<=' if zero else '<'} low <= high")
    return low, high


LARGEST_BYTES = 64_000_000
"""Default limit of the size of a surface."""


def surface_key(
    model: ContactModel,
    scene: Any,
    tolerance: Tolerance | float | str,
    largest_bytes: int = LARGEST_BYTES,
    past_limits: bool = False,
) -> str:
    """Hash of everything that determines a surface's numbers; the name of its cache entry.

    Parameters
    ----------
    model, scene, tolerance, largest_bytes, past_limits
        As in `FrictionSurface.build`.

    Examples
    --------
    >>> import haptix
    >>> model = haptix.ContactModel(haptix.Finger(), haptix.Screen())
    >>> keys = {surface_key(model, {"normal_force_n": (0.1, 1.0)}, jnd) for jnd in (0.01, 0.02)}
    >>> len(keys)  # another tolerance, another file
    2
    """
    return digest(
        {
            "haptix": __version__,
            "code": _code_digest(),
            "model": model.describe(),
            "response_hz_per_mm_per_s": model.finger.response_hz_per_mm_per_s,
            "ranges": read_ranges(model, scene),
            "tolerance": str(Tolerance.read(tolerance)),
            "jnd": WEBER_FRACTION,
            "largest_bytes": largest_bytes,
            **({"past_limits": True} if past_limits else {}),
        }
    )


@cache
def _code_digest() -> str:
    """Hash of the source code, so that the cache never returns a surface of an earlier solver."""
    code = hashlib.sha256()
    package = Path(__file__).parent.parent
    files = list(package.glob("*.py"))
    for folder in ("contact", "electro", "fidelity", "friction", "surface"):
        files += (package / folder).rglob("*.py")
    for file in sorted(files):
        code.update(file.read_bytes())
    return code.hexdigest()
