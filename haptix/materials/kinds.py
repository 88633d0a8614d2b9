"""All kinds together, and the JSON Schema of their documents."""

from __future__ import annotations

from typing import Any

from pydantic.json_schema import models_json_schema

from haptix.kinds import AnyAsset
from haptix.materials.described import describe
from haptix.texture.material import (
    ANY_KIND,
    KINDS,
    AnyMaterial,
    Material,
    Scaled,
    load,
    material_of,
)

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

    Fields have titles, help, and for panels ``x-unit``, ``x-step`` and ``x-range``.
    """
    models: list[tuple[type[Material], Any]] = [(one, "validation") for one in KINDS.values()]
    _, found = models_json_schema(models)
    definitions = _with_references(found["$defs"])
    name_of = {kind: model.__name__ for kind, model in KINDS.items()}
    for kind, name in name_of.items():
        definitions[name]["properties"]["kind"] = {"const": kind}
        definitions[name]["required"] = sorted({"kind", *definitions[name].get("required", [])})
        definitions[name]["properties"]["schema_version"] = {"const": 1}
        describe(KINDS[kind], definitions[name])
    refs = {kind: f"#/$defs/{name}" for kind, name in sorted(name_of.items())}
    definitions["material"] = {
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
    if part.get("title") == ANY_KIND:
        return {"$ref": "#/$defs/material"}
    return {key: _with_references(item) for key, item in part.items()}
