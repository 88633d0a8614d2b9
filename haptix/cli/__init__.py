"""The command line. Nothing here imports torch before a command runs, so that --help is instant."""

from __future__ import annotations

import sys
from typing import Annotated

import typer

from calibration.app import app as calibrate
from haptix.cli import (
    archive,
    demo,
    figures,
    hardware,
    materials,
    rendering,
    scenes,
    service,
    stimuli,
    surfaces,
)
from haptix.terminal import run
from haptix.version import __version__

app = typer.Typer(
    name="haptix",
    help="Haptic rendering for electrovibration touchscreens: from contact mechanics to volts.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,  # which would take units such as [m] for markup
)
app.command("demo")(demo.demo)
app.command("build")(surfaces.build)
app.command("query")(surfaces.query)
app.command("invert")(surfaces.invert)
app.command("export")(archive.export)
app.command("render")(rendering.render)
app.command("play")(rendering.play)
app.command("serve")(service.serve)
app.command("plan")(scenes.plan)
app.command("tradeoff")(scenes.tradeoff)
app.add_typer(materials.app, name="material")
app.add_typer(stimuli.app, name="stimuli")
app.add_typer(calibrate, name="calibrate")
app.command("figures")(figures.figures)
app.command("devices")(hardware.devices)
app.command("doctor")(hardware.doctor)


@app.callback(invoke_without_command=True)
def _options(
    version: Annotated[bool, typer.Option("--version", help="Print the version.")] = False,
) -> None:
    if version:
        sys.stdout.write(f"haptix {__version__}\n")
        raise typer.Exit


def main() -> None:
    """Run the command line."""
    run(app, "haptix")
