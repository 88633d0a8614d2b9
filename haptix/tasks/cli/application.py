"""The commands as Typer takes them: those of tasks are made from the parameters of the task.

A command, and torch with it, loads when it is called.
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable, Sequence
from importlib import import_module
from inspect import Parameter, Signature
from pathlib import Path
from typing import Annotated, Any, Literal, get_args, get_origin

import typer
from pydantic.fields import FieldInfo
from typer.completion import completion_init, get_completion_script  # type: ignore[attr-defined]
from typer.core import TyperGroup

from haptix.base.errors import InputError
from haptix.base.fields import Typed
from haptix.base.task import Context, Task, inner, read, task_at, typed
from haptix.base.task_list import TASKS
from haptix.base.terminal import AsJson, ProgressBar, show
from haptix.base.units import unit_of
from haptix.base.version import __version__
from haptix.tasks.cli import ABOUT, COMMANDS, LOG_HELP

_UNDERSTOOD = "haptix.understood"


def command_of(task: type[Task]) -> Callable[..., None]:
    """Return a function whose signature Typer makes a command of."""

    def command(context: typer.Context, as_json: bool, **values: Any) -> None:
        typed_values = {name: value for name, value in values.items() if _is_typed(context, name)}
        with ProgressBar() as update:
            result = task(**typed_values).run(_Terminal(update))
        sys.stderr.writelines(context.meta.get(_UNDERSTOOD, ()))
        if as_json:
            sys.stdout.write(json.dumps(result.document, indent=2, allow_nan=False) + "\n")
        else:
            for title, rows in result.tables:
                show(title, rows, False)
            sys.stdout.writelines(f"{line}\n" for line in result.lines)
        if result.failed:
            raise typer.Exit(1)

    of_fields = [_parameter(*field) for field in task.model_fields.items() if typed(field[1])]
    first = Parameter("context", Parameter.KEYWORD_ONLY, annotation=typer.Context)
    last = Parameter("as_json", Parameter.KEYWORD_ONLY, annotation=AsJson, default=False)
    signature = Signature([first, *of_fields, last])
    command.__signature__ = signature  # type: ignore[attr-defined]
    command.__annotations__ = {p.name: p.annotation for p in signature.parameters.values()}
    command.__doc__ = task.__doc__
    return command


def option(text: str, kind: Any) -> Any:
    """Return an option of a command that is written by hand, with its help and check."""
    return typer.Option(help=text, callback=_checked(kind))


def argument(text: str, kind: Any) -> Any:
    """Return an argument of such a command."""
    return typer.Argument(help=text, callback=_checked(kind))


def _checked(kind: Any) -> Any:
    parameter = FieldInfo.from_annotation(kind)

    def check(info: typer.CallbackParam, value: Any) -> Any:
        if value is None:
            return None
        try:
            return read(str(info.name), parameter, value)
        except ValueError as error:
            name = info.opts[0] if info.opts[0].startswith("-") else info.opts[0].upper()
            raise InputError(f"{name}: {error}") from None

    return check


def group_of(word: str, about: str) -> typer.Typer:
    """Return the commands of tasks that begin with a word, such as ``material show``."""
    group = typer.Typer(
        help=about, no_args_is_help=True, add_completion=False, rich_markup_mode=None
    )
    group.callback()(lambda: None)  # or a single command would stand for the group
    for command, (path, _) in TASKS.items():
        first, _, rest = command.partition(" ")
        if first == word and rest:
            group.command(rest)(command_of(task_at(path)))
    return group


class _Terminal(Context):
    """Progress on the standard error; a person answers on the standard input."""

    def __init__(self, update: ProgressBar) -> None:
        super().__init__(Path())
        self._update = update

    def progress(self, stage: str, share: float) -> None:
        super().progress(stage, share)
        self._update(stage, share)

    def tell(self, **what: Any) -> None:
        if "step" in what:
            sys.stderr.write(f"haptix: {what['step']}\n")
        if "trace" in what:
            latest = {k: v[-1] if isinstance(v, list) else v for k, v in what["trace"].items()}
            shown = (f"{name.replace('_', ' ')} {value:.3g}" for name, value in latest.items())
            self._update.note(", ".join(shown))

    def ask(self, prompt: str, choices: Sequence[str] = ()) -> str:
        """Ask until the answer is one of the choices; Enter alone takes the first."""
        self._update.pause()
        words = [prompt.rstrip(), *(["/".join(choices)] if choices else []), ""]
        while True:
            sys.stderr.write(" ".join(words))
            sys.stderr.flush()
            if not (line := sys.stdin.readline()):
                raise InputError(f"the input ended before an answer to: {words[0]}")
            answer = line.strip()
            if not choices or answer in choices:
                return answer
            if not answer:
                return choices[0]


def _is_typed(context: typer.Context, name: str) -> bool:
    source = context.get_parameter_source(name)
    return source is not None and source.name != "DEFAULT"


def _parameter(name: str, field: FieldInfo) -> Parameter:
    """Return a parameter of a task as Typer takes it."""
    how, kind = typed(field) or Typed(), inner(field.annotation)
    is_list = get_origin(kind) is tuple and get_args(kind)[-1] is Ellipsis
    taken: Any = bool if kind is bool else list[str] if is_list else str
    option = how.option or f"--{name.replace('_', '-')}"
    shown = name.upper() if how.is_argument else option

    def check(context: typer.Context, texts: Any) -> Any:
        if texts is None or not _is_typed(context, name):
            return texts
        try:
            value = read(name, field, texts)
        except ValueError as error:
            raise InputError(f"{shown}: {error}") from None
        if numbers := _understood(texts, value):
            line = f"haptix: {shown}: {numbers} {unit_of(name)}".rstrip() + "\n"
            context.meta.setdefault(_UNDERSTOOD, []).append(line)
        return value

    default = Parameter.empty if field.is_required() else _text(field.default, taken)
    about: dict[str, Any] = {"help": field.description, "callback": None if kind is bool else check}
    if how.is_argument:
        info: Any = typer.Argument(metavar=how.metavar, **about)
    else:
        metavar = how.metavar or (None if kind is bool else _metavar(name, kind))
        options = [option] if how.option or field.default is False else []
        info = typer.Option(*options, metavar=metavar, **about)
    annotation: Any = taken | None if default is None else taken
    annotation = Annotated[annotation, info]
    return Parameter(name, Parameter.KEYWORD_ONLY, default=default, annotation=annotation)


def _text(default: Any, taken: Any) -> Any:
    """Return a default as it would be typed."""
    if default is None or taken is bool:
        return default
    if isinstance(default, tuple):
        parts = [_text(part, str) for part in default]
        return parts if taken is not str else ",".join(parts)
    return f"{default:g}" if isinstance(default, float) else str(default)


def _metavar(name: str, kind: Any) -> str:
    if get_origin(kind) is tuple:
        several = get_args(kind)[-1] is Ellipsis
        return f"{_metavar(name, inner(get_args(kind)[0]))},..." if several else "LOW,HIGH"
    if kind is float:
        return unit_of(name) or "NUMBER"
    return "WORD" if get_origin(kind) is Literal else {int: "WHOLE", Path: "PATH"}.get(kind, "TEXT")


def _understood(texts: str | Sequence[str], value: Any) -> str:
    """Say which numbers were understood of units and lists, where they are not as typed."""
    numbers = value if isinstance(value, tuple) else (value,)
    if not all(isinstance(number, float) for number in numbers):
        return ""
    parts = [texts] if isinstance(texts, str) else texts
    if len(parts) == len(numbers) and not any(part[-1:].isalpha() for part in parts):
        return ""
    *first, last = [f"{number:.6g}" for number in numbers]
    return f"{', '.join(first)} and {last}" if first else last


def _loaded(word: str) -> typer.Typer:
    """Return a task's command, a group of them, or a command written by hand."""
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
            command: Any = typer.main.get_command(_loaded(cmd_name))
            command.name = cmd_name
            self.commands[cmd_name] = command
        return self.commands.get(cmd_name)

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        with formatter.section("Commands"):
            formatter.write_dl([(name, about) for name, (_, about) in COMMANDS.items()])


def completion(
    shell: Annotated[
        Literal["bash", "zsh", "fish"], typer.Argument(help="bash, zsh or fish.", metavar="SHELL")
    ],
) -> None:
    """Print the script that completes commands in a shell: eval "$(haptix completion bash)"."""
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
    context: typer.Context,
    version: Annotated[bool, typer.Option("--version", help="Print the version.")] = False,
    log: Annotated[
        Literal["info", "debug"] | None, typer.Option(help=LOG_HELP, metavar="LEVEL")
    ] = None,
) -> None:
    if not version and context.invoked_subcommand is None:
        context.fail("Missing command.")
    if log:
        from haptix.base.log import start

        start(log)
    if version:
        sys.stdout.write(f"haptix {__version__}\n")
        raise typer.Exit
