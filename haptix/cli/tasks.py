"""Commands of the desk's tasks: options with help, units and defaults from their parameters."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Sequence
from inspect import Parameter, Signature
from pathlib import Path
from typing import Annotated, Any, Literal, get_args, get_origin

import typer
from pydantic.fields import FieldInfo

from haptix.desk import Context, Task, inner, read, task_at, typed
from haptix.errors import InputError
from haptix.fields import Typed
from haptix.task_list import MODULES, tasks_of
from haptix.terminal import AsJson, ProgressBar, show
from haptix.units import unit_of

_UNDERSTOOD = "haptix.understood"


def command_of(task: type[Task]) -> Callable[..., None]:
    """Return a function whose signature Typer makes a command of."""

    def command(context: typer.Context, as_json: bool, **values: Any) -> None:
        typed_values = {name: values[name] for name in values if _is_typed(context, name)}
        with ProgressBar() as update:
            result = task(**typed_values).run(_Terminal(update))
        for line in context.meta.get(_UNDERSTOOD, ()):
            sys.stderr.write(f"haptix: {line}\n")
        if as_json:
            sys.stdout.write(json.dumps(result.document, indent=2, allow_nan=False) + "\n")
        else:
            for title, rows in result.tables:
                show(title, rows, False)
            sys.stdout.writelines(f"{line}\n" for line in result.lines)
        if result.failed:
            raise typer.Exit(1)

    kind = Parameter.KEYWORD_ONLY
    parameters = [
        Parameter("context", kind, annotation=typer.Context),
        *(
            _parameter(name, field, how)
            for name, field in task.model_fields.items()
            if (how := typed(field))
        ),
        Parameter("as_json", kind, annotation=AsJson, default=False),
    ]
    command.__signature__ = Signature(parameters)  # type: ignore[attr-defined]
    command.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
    command.__doc__ = task.__doc__
    return command


def option(text: str, kind: Any) -> Any:
    """Return an option of a command that is written by hand, with its help and check."""
    parameter = FieldInfo.from_annotation(kind)

    def check(info: typer.CallbackParam, value: Any) -> Any:
        if value is None:
            return None
        try:
            return read(str(info.name), parameter, value)
        except ValueError as error:
            raise InputError(f"{info.opts[0]}: {error}") from None

    return typer.Option(help=text, callback=check)


def group_of(word: str, about: str) -> typer.Typer:
    """Return the commands of tasks that begin with a word, such as ``material show``."""
    group = typer.Typer(
        help=about, no_args_is_help=True, add_completion=False, rich_markup_mode=None
    )
    for command, (path, _) in tasks_of(MODULES).items():
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


def _parameter(name: str, field: FieldInfo, how: Typed) -> Parameter:
    kind = inner(field.annotation)
    is_list = get_origin(kind) is tuple and get_args(kind)[-1] is Ellipsis
    taken: Any = bool if kind is bool else list[str] if is_list else str
    option = how.option or f"--{name.replace('_', '-')}"
    shown = name.upper() if how.is_argument else option
    default = Parameter.empty if field.is_required() else _text(field.default, taken)

    def check(context: typer.Context, value: Any) -> Any:
        if value is None or not _is_typed(context, name):
            return value
        try:
            understood = read(name, field, value)
        except ValueError as error:
            raise InputError(f"{shown}: {error}") from None
        _note(context, f"{shown}: {_shown(name, understood)}", value, understood)
        return understood

    about: dict[str, Any] = {"help": field.description, "callback": None if kind is bool else check}
    if how.metavar or not (how.is_argument or kind is bool):
        about["metavar"] = how.metavar or _metavar(name, kind)
    if how.is_argument:
        info: Any = typer.Argument(**about)
    else:
        info = typer.Option(*([option] if how.option or field.default is False else []), **about)
    annotation = taken | None if default is None else taken
    return Parameter(
        name, Parameter.KEYWORD_ONLY, default=default, annotation=Annotated[annotation, info]
    )


def _text(default: Any, taken: Any) -> Any:
    """Return a default as it would be typed."""
    if default is None or taken is bool:
        return default
    if isinstance(default, tuple):
        parts = [_text(part, str) for part in default]
        return parts if taken is not str else ",".join(parts)
    return f"{default:g}" if isinstance(default, float) else str(default)


def _metavar(name: str, kind: Any) -> str:
    if get_origin(kind) is Literal:
        return "WORD"
    if get_origin(kind) is tuple:
        several = "LOW,HIGH" if get_args(kind)[-1] is not Ellipsis else ""
        return several or f"{_metavar(name, inner(get_args(kind)[0]))},..."
    if kind is float:
        return unit_of(name) or "NUMBER"
    return {int: "WHOLE", Path: "PATH"}.get(kind, "TEXT")


def _note(context: typer.Context, line: str, value: Any, understood: Any) -> None:
    """Keep a line for what was understood of units and lists."""
    texts = [value] if isinstance(value, str) else value
    numbers = understood if isinstance(understood, tuple) else (understood,)
    is_plain = len(texts) == len(numbers) and not any(text[-1:].isalpha() for text in texts)
    if all(isinstance(number, float) for number in numbers) and not is_plain:
        context.meta.setdefault(_UNDERSTOOD, []).append(line)


def _shown(name: str, understood: Any) -> str:
    numbers = understood if isinstance(understood, tuple) else (understood,)
    said = [f"{number:.6g}" if isinstance(number, float) else str(number) for number in numbers]
    return (
        " and ".join(filter(None, (", ".join(said[:-1]), said[-1]))) + f" {unit_of(name)}".rstrip()
    )
