"""Panels of a material's fields: the JSON Schema with help, and the effect of a step of a field.

The JSON Schema has title, help, unit, step and usual range of each field as annotations. Help comes
from the docstrings, the unit from the end of the field's name, and the range from the field's
limits or, without limits, from its default.
"""

from __future__ import annotations

import inspect
import re
from math import floor, inf, log10
from typing import Any

import numpy as np
from pydantic.json_schema import models_json_schema

from haptix.base.checks import Array
from haptix.base.errors import InputError
from haptix.base.kinds import AnyAsset, Kind
from haptix.base.units import title_of, unit_of
from haptix.feel.materials import as_mu
from haptix.feel.materials.material import (
    ANY_KIND,
    KINDS,
    AnyMaterial,
    Material,
    Scaled,
    load,
    material_of,
)
from haptix.feel.motion import Motion
from haptix.feel.signals.signal import ANY_SIGNAL
from haptix.feel.signals.signal import KINDS as SIGNALS

__all__ = [
    "KINDS",
    "AnyAsset",
    "AnyMaterial",
    "Material",
    "Scaled",
    "describe",
    "effects_of_steps",
    "load",
    "material_of",
    "schema",
    "steps_of",
]
"""Names that `haptix.feel.materials` exports."""

_FAMILIES = {"material": KINDS, "signal": SIGNALS}
_MATERIAL, _SIGNAL = {"$ref": "#/$defs/material"}, {"$ref": "#/$defs/signal"}
_REFERENCES: dict[str, dict[str, Any]] = {
    ANY_KIND: _MATERIAL,
    ANY_SIGNAL: {"anyOf": [_SIGNAL, {"type": "number"}]},
}

_USUAL = {
    "mm": (0.0, 60.0), "mm/s": (0.0, 200.0), "°/s": (-180.0, 180.0), "°": (-180.0, 180.0),
    "N": (0.05, 2.0), "s": (0.0, 2.0),
}  # fmt: skip
_STEPS = {"mm": 0.1, "°": 5.0, "°/s": 5.0, "mm/s": 5.0, "N": 0.05}
_FIELD = re.compile(r"^([a-z_, ]+?) :.*\n((?:    .*\n?)+)", re.MULTILINE)

_STATES = 2000
_SECONDS = 2.0
_SPEED_MM_S = (20.0, 200.0)
_FORCES_N = (0.2, 1.2)
_FELT = 95.0  # percentile: an edge that moves changes few places, but changes them much


def describe(model: type[Kind], definition: dict[str, Any]) -> None:
    """Add the annotations of a panel to a kind's definition in the JSON Schema."""
    help_texts = _help_of(model)
    doc = inspect.cleandoc(model.__doc__ or "")
    definition["title"] = str(model.model_fields["kind"].default).replace("-", " ").capitalize()
    definition["description"] = " ".join(doc.split("\n\n")[0].split())
    for name, field in definition["properties"].items():
        if name in ("kind", "schema_version"):
            continue
        unit = unit_of(name)
        field["title"] = title_of(name)
        if name in help_texts:
            field["description"] = help_texts[name]
        if unit:
            field["x-unit"] = unit
        number = _number(field)
        if number is not None:
            low, high = _range(number, field.get("default"), unit)
            field["x-range"] = [low, high]
            is_whole = number["type"] == "integer"
            field["x-step"] = 1 if is_whole else _STEPS.get(unit, _step(low, high))


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
    alternatives = [field, *field.get("anyOf", [])]
    return next(
        (
            alternative
            for alternative in alternatives
            if alternative.get("type") in ("number", "integer")
        ),
        None,
    )


def _range(number: dict[str, Any], default: Any, unit: str) -> tuple[float, float]:
    """Return a slider's range for a number: the field's limits, or the usual range of the unit."""
    low, high = _USUAL.get(unit, (0.0, 1.0))
    if number["type"] == "integer":
        low, high = 0, 4 * default if isinstance(default, int) and default else 40
    elif isinstance(default, int | float) and default > high:
        high = 4.0 * default
    step = _STEPS.get(unit, 0.01)
    if "exclusiveMinimum" in number:
        low = max(low, number["exclusiveMinimum"] + step)
    if "exclusiveMaximum" in number:
        high = min(high, number["exclusiveMaximum"] - step)
    return max(low, number.get("minimum", low)), min(high, number.get("maximum", high))


def _step(low: float, high: float) -> float:
    """A hundredth of a range, rounded down to 1, 2 or 5 times a power of ten."""
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


def schema() -> dict[str, Any]:
    """JSON Schema of a document of any kind in `KINDS`, discriminated by ``kind``.

    Fields have titles, help, and for panels ``x-unit``, ``x-step`` and ``x-range``. Signals stand
    beside the materials, as ``#/$defs/signal``.
    """
    models: list[tuple[type[Kind], Any]] = [
        (model, "validation") for kinds in _FAMILIES.values() for model in kinds.values()
    ]
    references, generated = models_json_schema(models)
    # Two packages may name their classes alike: pydantic then names both by their modules, too.
    names = {model: ref["$ref"].rpartition("/")[2] for (model, _), ref in references.items()}
    definitions = _with_references(generated["$defs"])
    for family, kinds in _FAMILIES.items():
        for kind, model in kinds.items():
            definition = definitions[names[model]]
            definition["properties"]["kind"] = {"const": kind}
            definition["required"] = sorted({"kind", *definition.get("required", [])})
            definition["properties"]["schema_version"] = {"const": 1}
            describe(model, definition)
        refs = {kind: f"#/$defs/{names[model]}" for kind, model in kinds.items()}
        definitions[family] = {
            "oneOf": [{"$ref": ref} for ref in refs.values()],
            "discriminator": {"propertyName": "kind", "mapping": refs},
        }
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "A haptix material",
        "$ref": "#/$defs/material",
        "$defs": definitions,
    }


def _with_references(part: Any) -> Any:
    if isinstance(part, list):
        return [_with_references(item) for item in part]
    if not isinstance(part, dict):
        return part
    if part.get("title") in _REFERENCES:
        return dict(_REFERENCES[part["title"]])
    return {key: "forever" if item == inf else _with_references(item) for key, item in part.items()}


def effects_of_steps(material: Material, lowest_mu: float, highest_mu: float) -> dict[str, float]:
    """Return the effect of a step of each numeric field, upwards or, if that is refused, downwards.

    Parameters
    ----------
    material : Material
        The material; only its own fields are looked at, not those of materials within it.
    lowest_mu, highest_mu : float
        Reachable friction coefficients.

    Returns
    -------
    dict
        The 95th percentile of the change, in JND, over seeded places, times, directions, speeds and
        forces, by the field's name; without those that allow no step. A pattern that is moved
        changes by its whole height: a finger would feel that at a place, which is not how well it
        could tell both patterns apart.
    """
    from haptix.model.perception.thresholds import WEBER_FRACTION  # with torch

    motion = _motion(material)
    before = _friction(material, motion, lowest_mu, highest_mu)
    effects = {}
    for name, step in steps_of(type(material)).items():
        value = getattr(material, name)
        if isinstance(value, bool) or not isinstance(value, int | float):
            continue
        for by in (step, -step):
            try:  # some rules are checked only when the evaluator is made
                changed = material.replace(**{name: value + by})
                after = _friction(changed, motion, lowest_mu, highest_mu)
            except InputError:
                continue
            change_jnd = np.abs(after - before) / (WEBER_FRACTION * before)
            effects[name] = float(np.percentile(change_jnd, _FELT))
            break
    return effects


def _motion(material: Material) -> Motion:
    random = np.random.default_rng(0)
    left, right, top, bottom = material.extent_mm
    x, y = random.uniform(left, right, _STATES), random.uniform(top, bottom, _STATES)
    t, turn = random.uniform(0, _SECONDS, _STATES), random.uniform(0, 2 * np.pi, _STATES)
    speed, force = random.uniform(*_SPEED_MM_S, _STATES), random.uniform(*_FORCES_N, _STATES)
    return Motion.of(x, y, t, speed * np.cos(turn), speed * np.sin(turn), force)


def _friction(material: Material, motion: Motion, lowest_mu: float, highest_mu: float) -> Array:
    evaluator = material.evaluator
    mu = as_mu(evaluator.target, evaluator.wanted(motion), lowest_mu, highest_mu)
    return np.asarray(np.clip(mu, lowest_mu, highest_mu))
