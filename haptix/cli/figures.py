"""``haptix figures``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from haptix.arguments import folder, some_of
from haptix.presets import FIGURES
from haptix.terminal import AsJson, progress_bar, show

_STAGES = {
    "model": "solve the model for every figure",
    "draw": "draw",
    "write": "write figures, numbers and captions",
}


_NAMES = tuple(name.removeprefix("fig") for name in FIGURES)


def _are_figures(option: typer.CallbackParam, value: list[str] | None) -> list[str] | None:
    some_of(*_NAMES)(option, [name.removeprefix("fig") for name in value or ()])
    return value


def figures(
    names: Annotated[
        list[str] | None,
        typer.Argument(
            help="Figures to draw, such as 2d or gaps. [default: all]", callback=_are_figures
        ),
    ] = None,
    out: Annotated[Path, typer.Option(help="Folder for the figures.", callback=folder)] = Path(
        "haptix-figures"
    ),
    as_json: AsJson = False,
) -> None:
    """Draw the paper's figures, and those of roughness and gaps, from the model.

    Writes a PNG and a CSV for each, and captions.json.
    """
    with progress_bar(_STAGES) as update:
        # torch and matplotlib load here; the bar shows those seconds too.
        update("model", 0.0)
        from haptix.figures import write_figures

        written = write_figures(out, update, names or ())
    rows = [
        {
            "figure": data.name,
            "title": data.title,
            "png": str(out / f"{data.name}.png"),
            "csv": str(out / f"{data.name}.csv"),
            "rows": len(next(iter(data.columns.values()))),
            "caption": data.caption,
        }
        if as_json
        else {"figure": data.name, "shows": data.title, "files": f"{data.name}.png, .csv"}
        for data in written
    ]
    show(f"haptix figures: in {out}", rows, as_json)
