"""The commands as Typer takes them. A command, and torch with it, loads when it is called."""

from __future__ import annotations

import os
import sys
from importlib import import_module
from typing import Annotated, Any, Literal

import typer
from typer.completion import completion_init, get_completion_script  # type: ignore[attr-defined]
from typer.core import TyperGroup

from haptix.cli import ABOUT, COMMANDS, LOG_HELP
from haptix.cli.task_commands import command_of, group_of
from haptix.version import __version__


def _loaded(word: str) -> typer.Typer:
    """Return a task's command, a group of them, or what is written by hand."""
    path, about = COMMANDS[word]
    if not path:
        return group_of(word, about)
    module, _, name = path.partition(":")
    command: Any = getattr(import_module(module), name)
    app = typer.Typer(add_completion=False, rich_markup_mode=None)
    app.command(word)(command_of(command) if isinstance(command, type) else command)
    return app


class _Commands(TyperGroup):
    def __init__(self, **options: Any) -> None:
        super().__init__(**options)
        not_made_yet: dict[str, Any] = dict.fromkeys(COMMANDS)
        self.commands = not_made_yet

    def list_commands(self, ctx: Any) -> list[str]:
        return list(COMMANDS)

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        if cmd_name in COMMANDS and self.commands.get(cmd_name) is None:
            made: Any = typer.main.get_command(_loaded(cmd_name))
            made.name = cmd_name
            self.commands[cmd_name] = made
        return self.commands.get(cmd_name)

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        with formatter.section("Commands"):
            formatter.write_dl([(name, about) for name, (_, about) in COMMANDS.items()])


def completion(
    shell: Annotated[
        Literal["bash", "zsh", "fish"], typer.Argument(help="bash, zsh or fish.", metavar="SHELL")
    ],
) -> None:
    """Print what completes commands in a shell: eval "$(haptix completion bash)"."""
    sys.stdout.write(
        get_completion_script(prog_name="haptix", complete_var="_HAPTIX_COMPLETE", shell=shell)
        + "\n"
    )


if "_HAPTIX_COMPLETE" in os.environ:
    completion_init()

app = typer.Typer(
    name="haptix",
    cls=_Commands,
    help=ABOUT,
    no_args_is_help=True,
    add_completion=False,
    context_settings={"help_option_names": ["--help", "-h"]},
    pretty_exceptions_enable=False,
    rich_markup_mode=None,  # which would take units such as [m] for markup
)


@app.callback(invoke_without_command=True)
def _options(
    version: Annotated[bool, typer.Option("--version", help="Print the version.")] = False,
    log: Annotated[
        Literal["info", "debug"] | None, typer.Option(help=LOG_HELP, metavar="LEVEL")
    ] = None,
) -> None:
    if log:
        from haptix.log import start

        start(log)
    if version:
        sys.stdout.write(f"haptix {__version__}\n")
        raise typer.Exit
