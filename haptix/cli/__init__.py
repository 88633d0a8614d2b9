"""The command line. A command's module, and torch with it, load when the command is called."""

from __future__ import annotations

import sys
from importlib import import_module
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from haptix.terminal import run
from haptix.version import __version__

# Where each command stands, and the first sentence of its help. Building all of them from their
# annotations takes longer than everything else that --help does.
COMMANDS = {
    "demo": (
        "haptix.cli.demo:demo",
        "From a photograph to volts: everything once, without hardware.",
    ),
    "build": (
        "haptix.cli.surfaces:build",
        "Solve the contact model once and write its friction surface.",
    ),
    "query": (
        "haptix.cli.surfaces:query",
        "Friction for a force and a voltage, from the model or from a surface.",
    ),
    "invert": (
        "haptix.cli.surfaces:invert",
        "Voltage for a friction, with the status of each: OK, BELOW, ABOVE, PULL_IN.",
    ),
    "export": (
        "haptix.cli.archive:export",
        "Write a surface's numbers as NetCDF, for other programs; needs xarray and h5netcdf.",
    ),
    "render": (
        "haptix.cli.rendering:render",
        "Simulate live touches: a virtual finger feels what is played, and the error is split.",
    ),
    "play": ("haptix.cli.rendering:play", "Play a recorded path on a device, in real time."),
    "serve": (
        "haptix.cli.service:serve",
        "Serve apps in any language on this machine: touches and materials in, friction out.",
    ),
    "studio": (
        "haptix.cli.service:studio",
        "Open the studio in a browser: feel textures by mouse, pen or touch, make and test them.",
    ),
    "plan": (
        "haptix.cli.scenes:plan",
        "Measure what each part of the model does in a scene, and drop what its budget allows.",
    ),
    "tradeoff": (
        "haptix.cli.scenes:tradeoff",
        "Measure error, build time, query time and memory of many ways to build a scene's surface.",
    ),
    "campaign": (
        "haptix.cli.campaign:campaign",
        "Do many independent tasks: surfaces of many people and screens, calibrations, and more.",
    ),
    "material": ("haptix.cli.materials:app", "Materials: what a surface feels like, as documents."),
    "stimuli": (
        "haptix.cli.stimuli:app",
        "Stimuli for perception experiments: make sets, look at them, run trials.",
    ),
    "calibrate": (
        "calibration.app:app",
        "Calibrate a screen: plan, measure, reduce, fit, verify; each step can be repeated.",
    ),
    "figures": (
        "haptix.cli.figures:figures",
        "Draw the paper's figures, and those of roughness and gaps, from the model.",
    ),
    "devices": (
        "haptix.cli.hardware:devices",
        "List what can be opened, and what the buses show: USB, HID, serial, audio, NI outputs.",
    ),
    "doctor": (
        "haptix.cli.hardware:doctor",
        "Check this machine: packages, system libraries, cache, and a solve against known numbers.",
    ),
    "cache": (
        "haptix.cli.cache:cache",
        "List what is kept so that it is not made twice, or remove it.",
    ),
}


class _Commands(TyperGroup):
    def __init__(self, **options: Any) -> None:
        super().__init__(**options)
        not_made_yet: dict[str, Any] = dict.fromkeys(COMMANDS)
        self.commands = not_made_yet

    def list_commands(self, ctx: Any) -> list[str]:
        return list(COMMANDS)

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        if cmd_name in COMMANDS and self.commands[cmd_name] is None:
            module, _, name = COMMANDS[cmd_name][0].partition(":")
            found = getattr(import_module(module), name)
            if not isinstance(found, typer.Typer):
                found, command = typer.Typer(add_completion=False, rich_markup_mode=None), found
                found.command(cmd_name)(command)
            made: Any = typer.main.get_command(found)
            made.name = cmd_name
            self.commands[cmd_name] = made
        return self.commands.get(cmd_name)

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        with formatter.section("Commands"):
            formatter.write_dl([(name, about) for name, (_, about) in COMMANDS.items()])


app = typer.Typer(
    name="haptix",
    cls=_Commands,
    help="Haptic rendering for electrovibration touchscreens: from contact mechanics to volts.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,  # which would take units such as [m] for markup
)


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
