"""``haptix material``."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Annotated

import typer

from haptix.desk import argument, option
from haptix.fields import MaterialFile, NewFile, refuse_input
from haptix.terminal import AsJson, show

app = typer.Typer(
    help="Materials: what a surface feels like, as documents.",
    no_args_is_help=True,
    rich_markup_mode=None,
)


@app.command("show")
def show_material(
    file: Annotated[Path, argument("Material: TOML or JSON, or gallery:NAME.", MaterialFile)],
    out: Annotated[Path | None, option("Picture. [default: FILE with .png]", NewFile)] = None,
    as_json: AsJson = False,
) -> None:
    """Draw a material: its friction by place, direction, speed, force and time."""
    from haptix.files import write_whole
    from haptix.gallery import load
    from haptix.materials import draw

    out = out or file.with_name(file.name.removeprefix("gallery:")).with_suffix(".png")
    refuse_input(out, file)
    material = load(file)
    figure = draw(material)
    write_whole(out, lambda draft: figure.savefig(draft, format="png", dpi=70))
    evaluator = material.evaluator
    row = {
        "kind": material.kind,
        "target": evaluator.target,
        "depends_on": ", ".join(_names(evaluator.depends_on)),
        "picture": str(out),
    }
    show(f"haptix material: {file}", [row], as_json)


@app.command("kinds")
def kinds(as_json: AsJson = False) -> None:
    """List the kinds of materials with their fields."""
    from haptix.materials import KINDS

    rows = []
    for name, kind in sorted(KINDS.items()):
        fields = {
            key: "required" if field.is_required() else str(field.default)
            for key, field in kind.model_fields.items()
            if key != "kind"
        }
        listed = ", ".join(
            key if default in ("required", "None") else f"{key}={default}"
            for key, default in fields.items()
        )
        about = (kind.__doc__ or "").strip().split("\n")[0]
        rows.append({"kind": name, "what": about, "fields": fields if as_json else listed})
    show("kinds of materials", rows, as_json)


@app.command("gallery")
def gallery(as_json: AsJson = False) -> None:
    """List the presets of the gallery, which ``gallery:NAME`` names."""
    from haptix.gallery import presets

    rows = [
        {
            "name": one.name,
            "family": one.family,
            "kind": one.document["kind"],
            "what": one.help,
        }
        for one in presets()
    ]
    show("presets of materials", rows, as_json)


@app.command("schema")
def schema() -> None:
    """Print the JSON Schema of all materials."""
    from haptix.materials import schema

    sys.stdout.write(json.dumps(schema(), indent=2) + "\n")


def _names(depends_on: object) -> list[str]:
    return [str(flag.name).lower() for flag in depends_on]  # type: ignore[attr-defined]
