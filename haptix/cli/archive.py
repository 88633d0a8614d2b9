"""``haptix export``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from haptix.arguments import file_to_write, is_there, refuse_input
from haptix.cli.building import check_writable
from haptix.terminal import AsJson, show


def export(
    surface: Annotated[
        Path, typer.Argument(help="Surface made by `haptix build`.", callback=is_there)
    ],
    out: Annotated[
        Path,
        typer.Argument(help="NetCDF file to write, such as my.nc.", callback=file_to_write),
    ],
    overwrite: Annotated[bool, typer.Option(help="Replace an existing file.")] = False,
    as_json: AsJson = False,
) -> None:
    """Write a surface's numbers as NetCDF, for other programs; needs xarray and h5netcdf."""
    from haptix.surface import FrictionSurface

    check_writable(out, overwrite)
    refuse_input(out, surface)
    table = FrictionSurface.load(surface)
    table.to_netcdf(out)
    rows = [{"file": str(out), "values": table.mu_table.numel(), "bytes": out.stat().st_size}]
    show("exported surface", rows, as_json)
