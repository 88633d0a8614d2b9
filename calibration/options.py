"""Options that several commands of ``haptix calibrate`` have."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from haptix.arguments import (
    folder,
    folder_there,
    is_there,
    number,
    one_of,
    preset_or_file,
    text,
)
from haptix.presets import FINGERS, SCREENS

Folder = Annotated[Path, typer.Argument(help="Folder of the session.", callback=folder)]
Measured = Annotated[Path, typer.Argument(help="Folder of the session.", callback=folder_there)]
finger_name, screen_name = preset_or_file("finger", FINGERS), preset_or_file("screen", SCREENS)
FingerOption = Annotated[
    str,
    typer.Option(help="Finger: a preset (semi-wet, wet) or a TOML file.", callback=finger_name),
]
ScreenOption = Annotated[
    str,
    typer.Option(help="Assumed screen: a preset or a TOML file.", callback=screen_name),
]
PanelName = Annotated[
    str | None, typer.Option(help="Name of this screen alone; required.", callback=text)
]
seed_number = number(least=0, most=2**63 - 1)
protocol_kind = one_of("paper", "full", "short")
source_kind = one_of("virtual", "csv", "inputs")
Csv = Annotated[
    Path | None,
    typer.Option(help="For csv: folder of stroke-001.csv ...", callback=folder),
]
Columns = Annotated[
    Path | None, typer.Option(help="For csv: column map, as TOML.", callback=is_there)
]
Inputs = Annotated[
    Path | None, typer.Option(help="For inputs: channels, as TOML.", callback=is_there)
]
Minutes = Annotated[
    float,
    typer.Option(help="Time for a short one.", callback=number(above=0, most=1000)),
]
Source = Annotated[
    str, typer.Option(help="Of the forces: virtual, csv or inputs.", callback=source_kind)
]
