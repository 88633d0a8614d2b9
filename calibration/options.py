"""Options that several commands of ``haptix calibrate`` have."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from haptix import fields
from haptix.desk import argument, checked, option
from haptix.fields import FileThere, FingerName, FolderThere, ScreenName, Text

Folder = Annotated[Path, argument("Folder of the session.", fields.Folder)]
Measured = Annotated[Path, argument("Folder of the session.", FolderThere)]
finger_name, screen_name = checked(FingerName), checked(ScreenName)
FingerOption = Annotated[
    str, option("Finger: a preset (semi-wet, wet) or a TOML file.", FingerName)
]
ScreenOption = Annotated[str, option("Assumed screen: a preset or a TOML file.", ScreenName)]
PanelName = Annotated[str | None, option("Name of this screen alone; required.", Text)]
seed_number = checked(int, ge=0, le=2**63 - 1)
protocol_kind = checked(Literal["paper", "full", "short"])
source_kind = checked(Literal["virtual", "csv", "inputs"])
Csv = Annotated[Path | None, option("For csv: folder of stroke-001.csv ...", fields.Folder)]
Columns = Annotated[Path | None, option("For csv: column map, as TOML.", FileThere)]
Inputs = Annotated[Path | None, option("For inputs: channels, as TOML.", FileThere)]
Minutes = Annotated[float, option("Time for a short one.", float, gt=0, le=1000)]
Source = Annotated[
    str, typer.Option(help="Of the forces: virtual, csv or inputs.", callback=source_kind)
]
