"""What a panel shows of a material's fields: title, help, unit, step and a usual range.

They are annotations in the JSON Schema. Help comes from the docstrings, the unit from the end of a
field's name, the range from its limits, or else from around its default.
"""

from __future__ import annotations

import inspect
import re
from math import floor, log10
from typing import Any

from haptix.kinds import Kind

UNITS = {
    "_mm_per_s": "mm/s", "_mm_s": "mm/s", "_deg_s": "°/s", "_deg": "°", "_mm": "mm", "_kg": "kg",
    "_hz": "Hz", "_n": "N", "_s": "s",
}  # fmt: skip
"""Units by the ends of the names of fields; the longest first."""

_USUAL = {
    "mm": (0.0, 60.0), "mm/s": (0.0, 200.0), "°/s": (-180.0, 180.0), "°": (-180.0, 180.0),
    "N": (0.05, 2.0), "s": (0.0, 2.0),
}  # fmt: skip
_STEPS = {"mm": 0.1, "°": 5.0, "°/s": 5.0, "mm/s": 5.0, "N": 0.05}
_FIELD = re.compile(r"^([a-z_, ]+?) :.*\n((?:    .*\n?)+)", re.MULTILINE)


def describe(model: type[Kind], definition: dict[str, Any]) -> None:
    """Add to a kind's definition in the JSON Schema what a panel shows."""
    help_texts = _help_of(model)
    doc = inspect.cleandoc(model.__doc__ or "")
    definition["title"] = str(model.model_fields["kind"].default).replace("-", " ").capitalize()
    definition["description"] = " ".join(doc.split("\n\n")[0].split())
    for name, field in definition["properties"].items():
        if name in ("kind", "schema_version"):
            continue
        unit = next((unit for end, unit in UNITS.items() if name.endswith(end)), None)
        words = name.removesuffix(next((end for end in UNITS if name.endswith(end)), ""))
        field["title"] = words.replace("_", " ").capitalize()
        if name in help_texts:
            field["description"] = help_texts[name]
        if unit is not None:
            field["x-unit"] = unit
        number = _number(field)
        if number is not None:
            low, high = _range(number, field.get("default"), unit)
            field["x-range"] = [low, high]
            is_whole = number["type"] == "integer"
            field["x-step"] = 1 if is_whole else _STEPS.get(unit or "", _step(low, high))


def _help_of(model: type[Kind]) -> dict[str, str]:
    """Help for fields, from the docstrings of a kind and its bases."""
    help_texts: dict[str, str] = {}
    for base in reversed(model.__mro__):
        text = inspect.cleandoc(base.__doc__ or "") if issubclass(base, Kind) else ""
        _, _, fields = text.partition("Parameters\n----------\n")
        for names, help_text in _FIELD.findall(fields):
            for name in names.split(", "):
                help_texts[name] = " ".join(help_text.split())
    return help_texts


def _number(field: dict[str, Any]) -> dict[str, Any] | None:
    """Return the numeric alternative of a field; None if it has none."""
    ways = [field, *field.get("anyOf", [])]
    return next((way for way in ways if way.get("type") in ("number", "integer")), None)


def _range(way: dict[str, Any], default: Any, unit: str | None) -> tuple[float, float]:
    """Return a range for a slider: the field's limits, or what is usual."""
    low, high = _USUAL.get(unit or "", (0.0, 1.0))
    if way["type"] == "integer":
        low, high = 0, 4 * default if isinstance(default, int) and default else 40
    elif isinstance(default, int | float) and default > high:
        high = 4.0 * default
    step = _STEPS.get(unit or "", 0.01)
    if "exclusiveMinimum" in way:
        low = max(low, way["exclusiveMinimum"] + step)
    if "exclusiveMaximum" in way:
        high = min(high, way["exclusiveMaximum"] - step)
    return max(low, way.get("minimum", low)), min(high, way.get("maximum", high))


def _step(low: float, high: float) -> float:
    """A hundredth of a range, rounded down to 1, 2 or 5 of a power of ten."""
    rough = (high - low) / 100
    power = 10.0 ** floor(log10(rough))
    return float(f"{max(part for part in (1, 2, 5) if part * power <= rough * 1.0001) * power:g}")


def steps_of(model: type[Kind]) -> dict[str, float]:
    """Steps of a kind's numeric fields, by their names."""
    definition = model.model_json_schema()
    describe(model, definition)
    return {
        name: field["x-step"]
        for name, field in definition["properties"].items()
        if "x-step" in field
    }
