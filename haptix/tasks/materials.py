"""Materials: what a surface feels like, as documents."""

from __future__ import annotations

import json
from typing import Annotated, Any

from pydantic import Field

from haptix.desk import Context, Result, Task
from haptix.fields import Argument, MaterialFile, NewFile, refuse_input


class ShowMaterial(Task, command="material show"):
    """Draw a material: its friction by place, direction, speed, force and time."""

    file: Annotated[MaterialFile, Argument] = Field(
        description="Material: TOML or JSON, or gallery:NAME."
    )
    out: NewFile | None = Field(None, description="Picture. [default: FILE with .png]")

    def run(self, context: Context) -> Result:
        """Write the picture."""
        from haptix.files import write_whole
        from haptix.gallery import load
        from haptix.materials import draw

        name = self.file.name.removeprefix("gallery:")
        out = self.out or self.file.with_name(name).with_suffix(".png")
        refuse_input(out, self.file)
        material = load(self.file)
        figure = draw(material)
        write_whole(out, lambda draft: figure.savefig(draft, format="png", dpi=70))
        evaluator = material.evaluator
        row = {
            "kind": material.kind,
            "target": evaluator.target,
            "depends_on": ", ".join(str(flag.name).lower() for flag in evaluator.depends_on),
            "picture": str(out),
        }
        return Result([row], [(f"haptix material: {self.file}", [row])])


class ListKinds(Task, command="material kinds"):
    """List the kinds of materials with their fields."""

    def run(self, context: Context) -> Result:
        """List them."""
        from haptix.materials import KINDS

        rows: list[dict[str, Any]] = []
        for name, kind in sorted(KINDS.items()):
            fields = {
                key: "required" if field.is_required() else str(field.default)
                for key, field in kind.model_fields.items()
                if key != "kind"
            }
            about = (kind.__doc__ or "").strip().split("\n")[0]
            rows.append({"kind": name, "what": about, "fields": fields})
        shown = [{**row, "fields": _listed(row["fields"])} for row in rows]
        return Result(rows, [("kinds of materials", shown)])


def _listed(fields: dict[str, str]) -> str:
    return ", ".join(
        name if default in ("required", "None") else f"{name}={default}"
        for name, default in fields.items()
    )


class ListGallery(Task, command="material gallery"):
    """List the presets of the gallery, which ``gallery:NAME`` names."""

    def run(self, context: Context) -> Result:
        """List them."""
        from haptix.gallery import presets

        rows = [
            {
                "name": preset.name,
                "family": preset.family,
                "kind": preset.document["kind"],
                "what": preset.help,
            }
            for preset in presets()
        ]
        return Result(rows, [("presets of materials", rows)])


class PrintSchema(Task, command="material schema"):
    """Print the JSON Schema of all materials."""

    def run(self, context: Context) -> Result:
        """Print it."""
        from haptix.materials import schema

        document = schema()
        return Result(document, lines=[json.dumps(document, indent=2)])
