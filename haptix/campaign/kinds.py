"""What a campaign is: a document that expands to tasks, each a pure function of its document."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cache, cached_property
from importlib import import_module
from itertools import product
from pathlib import Path
from typing import Annotated, Any, ClassVar, Self

from pydantic import Field, ValidationError

from haptix.desk import Context, Task, first_wrong, task_at
from haptix.documents import Document
from haptix.errors import FileFormatError, InputError
from haptix.files import Content, file_at, read_json, read_toml
from haptix.results import result_key
from haptix.units import with_numbers

# Where each kind stands; a plan may also name a class of an installed module, as "module:Class".
KINDS = {
    "surfaces": "haptix.campaign.plans:SurfacesOfPeople",
    "population": "haptix.campaign.plans:FrictionOfPeople",
    "boundary-elements": "haptix.campaign.plans:BoundaryElementSets",
    "trade-off": "haptix.campaign.plans:Tradeoffs",
    "calibration-fits": "haptix.campaign.plans:CalibrationFits",
    "stimulus-sets": "haptix.campaign.plans:StimulusSets",
    "experiment-simulations": "haptix.campaign.plans:ExperimentSimulations",
}

Value = str | float | int | bool | None


@dataclass(frozen=True)
class CampaignTask:
    """One task of a campaign.

    Parameters
    ----------
    kind : str
        Name of the kind whose `Campaign.run` does it.
    document : mapping
        Plain values: with the version of haptix, all that its results depend on.
    labels : mapping
        What people know it by, for the table; no result depends on them.
    """

    kind: str
    document: Mapping[str, Any]
    labels: Mapping[str, Value] = field(default_factory=dict)

    @cached_property
    def key(self) -> str:
        """Hash of kind, document and version: the name of its results."""
        return result_key(self.kind, self.document)


@dataclass(frozen=True)
class Outcome:
    """What a task leaves.

    Parameters
    ----------
    row : mapping
        Its numbers, for the table.
    files : mapping
        Its files by name: bytes, text, or a function that writes to a path.
    measured : mapping
        Numbers that differ from run to run, such as times: kept with the costs of the task, not
        among its results.
    """

    row: Mapping[str, Value]
    files: Mapping[str, Content] = field(default_factory=dict)
    measured: Mapping[str, Value] = field(default_factory=dict)


class Campaign(Document):
    """A plan of many tasks; each kind is a subclass.

    Parameters
    ----------
    name : str
        Name of the campaign.
    kind : str
        Which tasks these are: a name of `KINDS`, or ``module:Class``.
    folder : Path
        Folder to which paths are relative: that of the file, or the current one.
    """

    shown: ClassVar[tuple[str, ...]] = ()
    """Columns of the table whose distributions the report draws."""
    maps: ClassVar[tuple[tuple[str, str], ...]] = ()
    """Pairs of columns that the report draws against each other."""

    name: Annotated[str, Field(min_length=1)]
    kind: str
    folder: Annotated[Path, Field(exclude=True)] = Path()

    @abstractmethod
    def tasks(self) -> Iterator[CampaignTask]:
        """Yield the tasks, the same ones in the same order each time."""

    @staticmethod
    @abstractmethod
    def run(document: Mapping[str, Any]) -> Outcome:
        """Do one task: a pure function of its document."""

    @staticmethod
    def needed_bytes(document: Mapping[str, Any]) -> int:
        """Memory that a task needs beside the process itself."""
        return 500_000_000

    @classmethod
    def _from_table(cls, fields: dict[str, Any], folder: Path) -> Self:
        if "folder" in fields:
            raise InputError("folder: a file has none; its paths are relative to the file")
        return cls(**fields, folder=folder)


class OfTask(Campaign):
    """A plan of one task's runs.

    Parameters
    ----------
    task : mapping
        Its parameters, as clients of the service give them.
    vary : mapping of str to list
        Values of parameters; each combination is a run.
    """

    task: dict[str, Any] = Field(default={})
    vary: dict[str, Annotated[list[Any], Field(min_length=1)]] = Field(default={})

    def tasks(self) -> Iterator[CampaignTask]:
        """Yield each combination, the last parameter the fastest."""
        body = task_at(self.kind).body()
        task, vary = with_numbers("task", self.task), with_numbers("vary", self.vary)
        for values in product(*vary.values()):
            labels = dict(zip(vary, values, strict=True))
            try:
                made = body.model_validate({**task, **labels})
            except ValidationError as error:
                raise InputError(": ".join(filter(None, first_wrong(error)))) from None
            document = made.model_dump(mode="json", exclude_unset=True)
            if files := [value for value in document.values() if str(value).endswith(".toml")]:
                raise InputError(f"{files[0]}: expected a preset, for workers have no such file")
            yield CampaignTask(self.kind, document, {k: str(v) for k, v in labels.items()})


@cache
def campaign_of(task: type[Task]) -> type[OfTask]:
    """Return the kind of campaign that runs a task."""

    class OfOneTask(OfTask):
        @staticmethod
        def run(document: Mapping[str, Any]) -> Outcome:
            result = task(**document).run(Context())
            return Outcome(result.row, result.files)

    OfOneTask.__doc__ = task.__doc__
    return OfOneTask


def places_of(patterns: tuple[str, ...], folder: Path) -> Iterator[Path]:
    """Yield the files or folders of names and patterns within a folder, in order.

    Raises
    ------
    InputError
        If there is nothing of a name or pattern.
    """
    for pattern in patterns:
        paths = [folder / pattern] if Path(pattern).is_absolute() else sorted(folder.glob(pattern))
        if not paths:
            raise InputError(
                f"{folder / pattern}: expected a file, or a pattern of some; none is there"
            )
        yield from paths


def kind_named(name: str) -> type[Campaign]:
    """Return the class of a kind.

    Raises
    ------
    InputError
        If there is no such kind, or its module is not installed.
    """
    module, _, attribute = KINDS.get(name, name).partition(":")
    known = f"one of {', '.join(KINDS)}, or an installed module:Class"
    if not attribute:
        raise InputError(f"kind: expected {known}, got {name!r:.80}")
    try:
        kind = getattr(import_module(module), attribute)
    except (ImportError, AttributeError) as error:
        raise InputError(f"kind: expected {known}, got {name!r:.80}: {error}") from None
    if isinstance(kind, type) and issubclass(kind, Task):
        return campaign_of(kind)
    if not (isinstance(kind, type) and issubclass(kind, Campaign)):
        raise InputError(
            f"kind: expected {known}, got {name!r:.80}, which is neither a Task nor a Campaign"
        )
    return kind


def load_campaign(path: str | Path) -> Campaign:
    """Read a campaign's file, whatever its kind.

    Raises
    ------
    HaptixError
        If the file cannot be read, or is no campaign; the message says what is wrong.
    """
    path = file_at("path", path)
    fields = read_json(path) if path.suffix == ".json" else read_toml(path)
    if not isinstance(kind := fields.get("kind"), str):
        raise FileFormatError(
            f"{path}: expected a campaign, whose kind is one of {', '.join(KINDS)}, "
            f"got {kind!r:.40}"
        )
    return kind_named(kind).load(path)
