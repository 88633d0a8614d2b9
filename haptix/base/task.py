"""Tasks: each is one model of its parameters with one `run`, from which every door is made.

    class Query(Task, command="query"):
        \"\"\"Friction for a force and a voltage.\"\"\"

        voltage_v: tuple[NotNegative, ...] = Field(description="Amplitudes.")

        def run(self, context: Context) -> Result: ...

The doors are the command line (`haptix.tasks.cli.application`), the service's routes, jobs and
forms (`haptix.service.front.rest`), and campaigns (`haptix.tasks.campaign`), which also do tasks
that have no other door. `haptix.base.task_list` lists all tasks and loads none.
"""

from __future__ import annotations

import re
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from types import UnionType
from typing import Annotated, Any, ClassVar, Union, get_args, get_origin

from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    TypeAdapter,
    ValidationError,
    ValidationInfo,
    create_model,
    field_validator,
)
from pydantic.fields import FieldInfo

from haptix.base.errors import HaptixError, InputError
from haptix.base.fields import ForClients, Local, ProfileName, Typed, expected_words
from haptix.base.task_list import TASKS, WITHOUT_COMMAND
from haptix.base.units import decimal_comma, read_number, title_of, unit_of

_EXPECTED = {
    "greater_than": "a finite number above {gt:g}",
    "greater_than_equal": "a finite number of at least {ge:g}",
    "less_than": "a finite number below {lt:g}",
    "less_than_equal": "a finite number of at most {le:g}",
    "finite_number": "a finite number",
    "int_parsing": "a whole number",
    "int_from_float": "a whole number",
    "int_parsing_size": "a whole number of fewer digits",
}


@dataclass(frozen=True)
class Result:
    """The result of a task."""

    document: Any
    """For programs: plain values for JSON."""
    tables: Sequence[tuple[str, Sequence[Any]]] = ()
    """For people: titles and rows, which are mappings, results with headings, or lines."""
    lines: Sequence[str] = ()
    """Lines below the tables."""
    files: Mapping[str, Any] = field(default_factory=dict)
    """Files that a campaign keeps, by name: bytes, text, or a function that writes to a path."""
    failed: bool = False
    """Whether a test that the task makes failed; that is a result and no error."""
    costs: Mapping[str, Any] = field(default_factory=dict)
    """Numbers that differ from run to run, such as times; a campaign keeps them apart."""

    @property
    def row(self) -> dict[str, Any]:
        """Numbers and texts of the document's first row, for a campaign's table."""
        first = self.document[0] if isinstance(self.document, list) else self.document
        kinds = str | float | int | bool | None
        return {name: value for name, value in first.items() if isinstance(value, kinds)}


class CancelledError(HaptixError):
    """A task was cancelled."""


class Context:
    """The surroundings of a task; each door has its own, and this base shows and asks nothing.

    Parameters
    ----------
    folder : Path, optional
        Place for results; without one, a task writes none.
    """

    def __init__(self, folder: Path | None = None) -> None:
        self.folder, self._is_cancelled = folder, False

    def progress(self, stage: str, share: float) -> None:
        """Report which share of a stage is done; raises `CancelledError` if it was cancelled."""
        if self._is_cancelled:
            raise CancelledError("cancelled")

    def cancel(self) -> None:
        """End the task at its next report of progress."""
        self._is_cancelled = True

    def ask(self, prompt: str, choices: Sequence[str] = ()) -> str:
        """Ask a person."""
        raise InputError(f"nobody is here to answer: {prompt}")

    def tell(self, **what: Any) -> None:
        """Send a `step` or a `trace` to those who watch."""


class Task(BaseModel, ABC):
    """A task: its parameters, with their units, ranges and help; its docstring is its help.

    Raises `InputError` if a parameter is unknown, missing or outside its range.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    command: ClassVar[str] = ""
    """Words that call it on the command line."""
    route: ClassVar[str] = ""
    """Route of the service, ``POST /v1/route``; none if empty."""
    kind: ClassVar[str] = ""
    """Kind of the service's jobs that run it."""
    plays: ClassVar[bool] = False
    """Whether it plays on the device in use."""
    keeps: ClassVar[str] = ""
    """Folder of the service for its files; none if empty."""
    stages: ClassVar[tuple[str, ...]] = ()
    """Stages that it reports, in order; each counts as equally long."""

    def __init__(self, /, **fields: Any) -> None:
        try:
            super().__init__(**fields)
        except ValidationError as error:
            place, why = first_wrong(error)
            raise InputError(f"{place}: {why}" if place else why) from None

    @field_validator("*")
    @classmethod
    def _has_a_value(cls, value: Any, info: ValidationInfo) -> Any:
        """Refuse an empty list, whose product with others has no row, where there is no default."""
        if value == () and cls.model_fields[str(info.field_name)].default != ():
            raise ValueError("expected at least one value")
        return value

    def __init_subclass__(
        cls,
        command: str = "",
        route: str = "",
        kind: str = "",
        plays: bool = False,
        keeps: str = "",
    ) -> None:
        super().__init_subclass__()
        cls.command, cls.route, cls.plays, cls.keeps = command, route, plays, keeps
        cls.kind = kind or command

    @abstractmethod
    def run(self, context: Context) -> Result:
        """Do the task."""

    @property
    def needed_bytes(self) -> int:
        """Memory that it needs beside the process itself."""
        return 500_000_000

    @classmethod
    def path(cls) -> str:
        """Path by which another process imports it."""
        return f"{cls.__module__}:{cls.__qualname__}"

    @classmethod
    def body(cls) -> type[BaseModel]:
        """Return the model of the fields that a client of the network may send."""
        fields: dict[str, Any] = {}
        for name, parameter in cls.model_fields.items():
            kind: Any = parameter.annotation
            field: Any = copy(parameter)
            marks = marks_of(parameter)
            if Local in marks:
                continue
            title, unit = parameter.title or title_of(name), unit_of(name)
            extra: Any = {"x-unit": unit} if unit else None
            if ProfileName in marks:  # the names that a client may use are checked at the run
                kind = Annotated[str, Field(min_length=1, max_length=200)] | None
                known = [*marks[ProfileName].presets]
                field = Field(None, description=parameter.description, examples=known)
            elif ForClients in marks and not parameter.is_required():
                kind = get_args(kind)[0]
                field = Field(  # title here: beside an Annotated type, one set later is lost
                    title=title,
                    description=parameter.description,
                    examples=parameter.examples,
                    json_schema_extra=extra,
                )
            field.title, field.json_schema_extra = title, extra
            fields[name] = (kind, field)
        settings = ConfigDict(extra="forbid", allow_inf_nan=False)
        name = f"{cls.__name__}Request"
        return create_model(name, __config__=settings, __doc__=cls.__doc__, **fields)


def first_wrong(error: ValidationError) -> tuple[str, str]:
    """Return the place of the first error, the expected value and the received one."""
    errors = error.errors()
    # A mistyped name gives two errors, "unknown" and "missing": the first is more precise.
    first = next((wrong for wrong in errors if wrong["type"] == "extra_forbidden"), errors[0])
    place = ".".join(str(part) for part in first["loc"] if str(part).isidentifier())
    kind, message = first["type"], first["msg"].removeprefix("Value error, ")
    if kind == "literal_error":
        words = re.findall("'([^']+)'", first["ctx"]["expected"])
        return place, expected_words(words, str(first["input"]))
    why = message[0].lower() + message[1:]
    if kind in ("value_error", "missing", "extra_forbidden"):
        return place, why
    if kind in _EXPECTED:
        why = f"expected {_EXPECTED[kind].format(**first.get('ctx', {}))}"
    value = first["input"]
    return place, f"{why}, got {f'{value:g}' if isinstance(value, float) else f'{value!r:.40}'}"


def inner(annotation: Any) -> Any:
    """Return a type without its annotations and without None."""
    if get_origin(annotation) is Annotated:
        return inner(get_args(annotation)[0])
    if get_origin(annotation) in (Union, UnionType):
        (only,) = (kind for kind in get_args(annotation) if kind is not type(None))
        return inner(only)
    return annotation


def marks_of(parameter: FieldInfo) -> dict[type, Any]:
    """Return the annotations of a parameter, at any depth, by type."""
    marks, kinds = [*parameter.metadata], [parameter.annotation]
    for kind in kinds:
        marks += getattr(kind, "__metadata__", ())
        kinds += get_args(kind)
    return {type(mark): mark for mark in marks}


def typed(parameter: FieldInfo) -> Typed | None:
    """Return how the command line takes a parameter; None if it does not."""
    marks = marks_of(parameter)
    return None if ForClients in marks else marks.get(Typed, Typed())


def read(name: str, parameter: FieldInfo, texts: Any) -> Any:
    """Return the value of a parameter that was typed; numbers may have units.

    Raises `ValueError` if the text is no such value; the message names the expected one.
    """
    kind: Any = Annotated[parameter.annotation, parameter]
    adapter = TypeAdapter[Any](kind, config=ConfigDict(allow_inf_nan=False))
    try:
        return adapter.validate_python(_values(name, inner(parameter.annotation), texts))
    except ValidationError as error:
        lists = [texts] if isinstance(texts, str) else texts if isinstance(texts, list) else []
        comma = max((decimal_comma(str(text)) for text in lists), default="")
        raise ValueError(first_wrong(error)[1] + comma) from None


def _values(name: str, kind: Any, texts: Any) -> Any:
    """Split lists at commas and read numbers; values that are no text stay as they are."""
    if get_origin(kind) is not tuple:
        return read_number(name, texts) if kind is float and isinstance(texts, str) else texts
    item, lists = inner(get_args(kind)[0]), [texts] if isinstance(texts, str) else texts
    if item is Path or not all(isinstance(text, str) for text in lists):
        return lists
    parts = [part for text in lists for part in ([text] if "=" in text else text.split(","))]
    if item is not float:
        return parts
    try:
        numbers = [read_number(name, part) for part in parts]
    except ValueError:
        also = f", or with the unit {unit_of(name)}" if unit_of(name) else ""
        raise ValueError(
            f"expected numbers separated by commas, such as 0.2,0.5{also}, got {lists[-1]!r:.80}"
        ) from None
    if get_args(kind)[-1] is Ellipsis:
        return numbers
    if len(numbers) > len(get_args(kind)):
        raise ValueError(f"expected LOW,HIGH or one value, got {lists[-1]!r:.80}")
    return [numbers[0], numbers[-1]]


def task_at(path: str) -> type[Task]:
    """Return the class of a task from ``module:Class``."""
    module, _, name = path.partition(":")
    task = getattr(import_module(module), name)
    if not (isinstance(task, type) and issubclass(task, Task)):
        raise InputError(f"expected a task, got {path!r:.80}")
    return task


def all_tasks() -> list[type[Task]]:
    """Return all tasks of the table."""
    return [task_at(path) for path in (*(path for path, _ in TASKS.values()), *WITHOUT_COMMAND)]
