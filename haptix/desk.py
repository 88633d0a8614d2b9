"""The desk: a task is one model of its parameters and one `run`, and every door is made from it.

    class Query(Task, command="query"):
        \"\"\"Friction for a force and a voltage.\"\"\"

        voltage_v: tuple[NotNegative, ...] = Field(description="Amplitudes.")

        def run(self, context: Context) -> Result: ...

The doors are the command line (`haptix.cli.tasks`), the service's routes, jobs and forms
(`haptix.service.rest`), and campaigns (`haptix.campaign.kinds`). Which tasks there are is
read from the text of `MODULES`, so that a list of them loads nothing.
"""

from __future__ import annotations

import re
import time
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass, field
from functools import cached_property
from importlib import import_module
from pathlib import Path
from types import UnionType
from typing import Annotated, Any, ClassVar, Union, get_args, get_origin

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError, create_model
from pydantic.fields import FieldInfo

from haptix.errors import HaptixError, InputError
from haptix.fields import ForClients, Local, Profile, Typed, expected_words
from haptix.task_list import MODULES
from haptix.units import read_number, title_of, unit_of

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
    """What a task found.

    Parameters
    ----------
    document : dict or list
        For programs: plain values for JSON.
    tables : sequence of (str, sequence)
        For people: titles and rows, which are mappings, results with headings, or lines.
    lines : sequence of str
        What stands below the tables.
    files : mapping
        What a campaign keeps, by name: bytes, text, or a function that writes to a path.
    failed : bool
        Whether what was tested failed, which is no error.
    """

    document: Any
    tables: Sequence[tuple[str, Sequence[Any]]] = ()
    lines: Sequence[str] = ()
    files: Mapping[str, Any] = field(default_factory=dict)
    failed: bool = False

    @property
    def row(self) -> dict[str, Any]:
        """Its numbers and words, for a campaign's table: those of its first row."""
        first = self.document[0] if isinstance(self.document, list) else self.document
        kinds = str | float | int | bool | None
        return {name: value for name, value in first.items() if isinstance(value, kinds)}


class CancelledError(HaptixError):
    """A task was cancelled."""


class Context:
    """What a task may use: each door brings its own. This one says nothing and asks nobody.

    Parameters
    ----------
    folder : Path, optional
        Place for results; without one, a task writes none.
    seed : int
        Of its random numbers.
    executor : Executor, optional
        On which it does many calls; by default here.
    """

    def __init__(self, folder: Path | None = None, seed: int = 0, executor: Any = None) -> None:
        self.folder, self._seed, self._executor = folder, seed, executor
        self._stage, self._share, self._began_s = "", 0.0, 0.0
        self._is_cancelled = False

    def progress(self, stage: str, share: float) -> None:
        """Say which share of a stage is done; raises `CancelledError` once it is cancelled."""
        if self._is_cancelled:
            raise CancelledError("cancelled")
        if stage != self._stage:
            self._stage, self._began_s = stage, time.monotonic()
        self._share = share

    @property
    def seconds_left(self) -> float | None:
        """Of the present stage, from what it took so far."""
        took_s = time.monotonic() - self._began_s
        return took_s * (1 / self._share - 1) if self._share > 0 else None

    def cancel(self) -> None:
        """End the task where it says next how far it is."""
        self._is_cancelled = True

    def ask(self, prompt: str, choices: Sequence[str] = ()) -> str:
        """Ask a person."""
        raise InputError(f"nobody is here to answer: {prompt}")

    def tell(self, **what: Any) -> None:
        """Tell who watches of a `step` or a `trace`."""

    @cached_property
    def random(self) -> Any:
        """Generator of numpy."""
        from numpy.random import default_rng

        return default_rng(self._seed)

    @cached_property
    def executor(self) -> Any:
        """An executor of `concurrent.futures`."""
        from haptix.executors import executor_of

        return executor_of(self._executor)


class Task(BaseModel, ABC):
    """A task: its parameters, with their units, ranges and help; its docstring is its help.

    Raises
    ------
    InputError
        If a parameter is unknown, missing or outside its range.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    command: ClassVar[str] = ""
    """Words of the command line."""
    route: ClassVar[str] = ""
    """Of the service: ``POST /v1/route``; none where it is empty."""
    kind: ClassVar[str] = ""
    """Of its jobs."""
    plays: ClassVar[bool] = False
    """Whether it plays on the device in use."""
    keeps: ClassVar[str] = ""
    """Folder of the service for what it writes; none where it is empty."""
    stages: ClassVar[tuple[str, ...]] = ()
    """What it says it does, in order, each for as long."""

    def __init__(self, /, **fields: Any) -> None:
        try:
            super().__init__(**fields)
        except ValidationError as error:
            place, why = first_wrong(error)
            raise InputError(f"{place}: {why}" if place else why) from None

    def __init_subclass__(
        cls,
        command: str = "",
        route: str = "",
        kind: str = "",
        plays: bool = False,
        keeps: str = "",
        **more: Any,
    ) -> None:
        super().__init_subclass__(**more)
        cls.command, cls.route, cls.plays, cls.keeps = command, route, plays, keeps
        cls.kind = kind or command

    @abstractmethod
    def run(self, context: Context) -> Result:
        """Do it."""

    @classmethod
    def path(cls) -> str:
        """Where another process finds it."""
        return f"{cls.__module__}:{cls.__qualname__}"

    @classmethod
    def body(cls) -> type[BaseModel]:
        """Return the model of what a client of the network may send."""
        fields: dict[str, Any] = {}
        for name, parameter in cls.model_fields.items():
            kind: Any = parameter.annotation
            field: Any = parameter
            marks = {type(mark) for mark in marks_of(parameter)}
            if Local in marks:
                continue
            if Profile in marks:  # which of them a client may name is known where the task runs
                kind = Annotated[str, Field(min_length=1, max_length=200)] | None
                field = Field(None, description=parameter.description)
            elif ForClients in marks and not parameter.is_required():
                kind, field = get_args(kind)[0], Field(description=parameter.description)
            field = copy(field)
            field.title = parameter.title or title_of(name)
            field.json_schema_extra = {"x-unit": unit_of(name)} if unit_of(name) else None
            fields[name] = (kind, field)
        config = ConfigDict(extra="forbid", allow_inf_nan=False)
        return create_model(
            f"{cls.__name__}Request", __config__=config, __doc__=cls.__doc__, **fields
        )


def first_wrong(error: ValidationError) -> tuple[str, str]:
    """Return the place of the first error, and what was expected and given."""
    errors = error.errors()
    # A name that is not known is why another is missing, as where one is mistyped.
    first = next((wrong for wrong in errors if wrong["type"] == "extra_forbidden"), errors[0])
    place = ".".join(str(part) for part in first["loc"] if str(part).isidentifier())
    message = first["msg"].removeprefix("Value error, ")
    if first["type"] in ("value_error", "missing", "extra_forbidden"):
        return place, message[0].lower() + message[1:]
    if first["type"] == "literal_error":
        words = re.findall("'([^']+)'", first["ctx"]["expected"])
        return place, expected_words(words, str(first["input"]))
    expected = _EXPECTED.get(first["type"], "").format(**first.get("ctx", {}))
    value = first["input"]
    shown = f"{value:g}" if isinstance(value, float) else f"{value!r:.40}"
    why = f"expected {expected}" if expected else message[0].lower() + message[1:]
    return place, f"{why}, got {shown}"


def inner(annotation: Any) -> Any:
    """Return a type without what is annotated, and without None."""
    if get_origin(annotation) is Annotated:
        return inner(get_args(annotation)[0])
    if get_origin(annotation) in (Union, UnionType):
        (only,) = (kind for kind in get_args(annotation) if kind is not type(None))
        return inner(only)
    return annotation


def marks_of(parameter: FieldInfo) -> list[Any]:
    """Return what a parameter is annotated with, at any depth."""
    marks: list[Any] = [*parameter.metadata]
    kinds: list[Any] = [parameter.annotation]
    for kind in kinds:
        if get_origin(kind) is Annotated:
            marks += kind.__metadata__
        kinds += get_args(kind)
    return marks


def typed(parameter: FieldInfo) -> Typed | None:
    """Return how the command line takes a parameter; None if it does not."""
    marks = marks_of(parameter)
    if any(isinstance(mark, ForClients) for mark in marks):
        return None
    return next((mark for mark in marks if isinstance(mark, Typed)), Typed())


def read(name: str, parameter: FieldInfo, texts: str | Sequence[str]) -> Any:
    """Return the value of a parameter that was typed; numbers may have units.

    Raises
    ------
    ValueError
        If it is none; the message says what was expected.
    """
    kind: Any = parameter.annotation
    if parameter.metadata:
        kind = Annotated[(kind, *parameter.metadata)]
    adapter = TypeAdapter[Any](kind, config=ConfigDict(allow_inf_nan=False))
    try:
        return adapter.validate_python(_values(name, inner(parameter.annotation), texts))
    except ValidationError as error:
        raise ValueError(first_wrong(error)[1]) from None


def _values(name: str, kind: Any, texts: Any) -> Any:
    if get_origin(kind) is not tuple:
        return read_number(name, texts) if kind is float and isinstance(texts, str) else texts
    item, last = inner(get_args(kind)[0]), get_args(kind)[-1]
    lists = [texts] if isinstance(texts, str) else texts
    if item is Path or not all(isinstance(text, str) for text in lists):
        return lists
    parts = [part for text in lists for part in ([text] if "=" in text else text.split(","))]
    if item is not float:
        return parts
    try:
        numbers = [read_number(name, part) for part in parts]
    except ValueError:
        unit = unit_of(name)
        also = f", or with the unit {unit}" if unit else ""
        raise ValueError(
            f"expected numbers separated by commas, such as 0.2,0.5{also}, got {lists[-1]!r:.80}"
        ) from None
    if last is not Ellipsis:
        if len(numbers) > len(get_args(kind)):
            raise ValueError(f"expected LOW,HIGH or one value, got {lists[-1]!r:.80}")
        numbers = [numbers[0], numbers[-1]]
    return numbers


def task_at(path: str) -> type[Task]:
    """Return the class of a task from ``module:Class``."""
    module, _, name = path.partition(":")
    task = getattr(import_module(module), name)
    if not (isinstance(task, type) and issubclass(task, Task)):
        raise InputError(f"expected a task, got {path!r:.80}")
    return task


def all_tasks() -> list[type[Task]]:
    """Return all tasks that have a door."""
    values = [value for module in MODULES for value in vars(import_module(module)).values()]
    tasks = [value for value in values if isinstance(value, type) and issubclass(value, Task)]
    return [task for task in dict.fromkeys(tasks) if task.command or task.route]
