"""All kinds together, and the JSON Schema of their documents and of the signals within them."""

from __future__ import annotations

from math import inf
from typing import Any

from pydantic.json_schema import models_json_schema

from haptix.kinds import AnyAsset, Kind
from haptix.materials.described import describe
from haptix.signals.signal import ANY_SIGNAL
from haptix.signals.signal import KINDS as SIGNALS
from haptix.texture.material import (
    ANY_KIND,
    KINDS,
    AnyMaterial,
    Material,
    Scaled,
    load,
    material_of,
)

_FAMILIES = {"material": KINDS, "signal": SIGNALS}
_MATERIAL, _SIGNAL = {"$ref": "#/$defs/material"}, {"$ref": "#/$defs/signal"}
_REFERENCES: dict[str, dict[str, Any]] = {
    ANY_KIND: _MATERIAL,
    ANY_SIGNAL: {"anyOf": [_SIGNAL, {"type": "number"}]},
}

__all__ = [
    "KINDS",
    "AnyAsset",
    "AnyMaterial",
    "Material",
    "Scaled",
    "load",
    "material_of",
    "schema",
]


def schema() -> dict[str, Any]:
    """JSON Schema of a document of any kind in `KINDS`, discriminated by ``kind``.

    Fields have titles, help, and for panels ``x-unit``, ``x-step`` and ``x-range``. Signals stand
    beside the materials, as ``#/$defs/signal``.
    """
    models: list[tuple[type[Kind], Any]] = [
        (model, "validation") for kinds in _FAMILIES.values() for model in kinds.values()
    ]
    _, generated = models_json_schema(models)
    definitions = _with_references(generated["$defs"])
    for family, kinds in _FAMILIES.items():
        for kind, model in kinds.items():
            definition = definitions[model.__name__]
            definition["properties"]["kind"] = {"const": kind}
            definition["required"] = sorted({"kind", *definition.get("required", [])})
            definition["properties"]["schema_version"] = {"const": 1}
            describe(model, definition)
        refs = {kind: f"#/$defs/{model.__name__}" for kind, model in kinds.items()}
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
