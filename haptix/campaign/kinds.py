"""What a campaign is: a document that expands to tasks of the desk."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from importlib import import_module
from itertools import product
from pathlib import Path
from typing import Annotated, Any, ClassVar

from pydantic import Field, ValidationError

from haptix.desk import Task, first_wrong, task_at
from haptix.documents import Document
from haptix.errors import FileFormatError, InputError
from haptix.files import file_at, read_json, read_toml
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
    """A task of a campaign.

    Parameters
    ----------
    task : Task
        With the version of haptix, all that its results depend on.
    labels : mapping
        What people know it by, for the table; no result depends on them.
    """

    task: Task
    labels: Mapping[str, Value] = field(default_factory=dict)

    @cached_property
    def document(self) -> dict[str, Any]:
        """Parameters of the task as plain values."""
        return self.task.model_dump(mode="json")

    @cached_property
    def key(self) -> str:
        """Hash of task, parameters and version: the name of its results."""
        return result_key(self.task.path(), self.document)


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

    maps: ClassVar[tuple[tuple[str, str], ...]] = ()
    """Pairs of columns that the report draws against each other."""

    name: Annotated[str, Field(min_length=1)]
    kind: str
    folder: Annotated[Path, Field(exclude=True)] = Path()

    @abstractmethod
    def tasks(self) -> Iterator[CampaignTask]:
        """Yield the tasks, the same ones in the same order each time."""


class Sweep(Campaign):
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
        kind = task_at(self.kind)
        body = kind.body()
        task, vary = with_numbers("task", self.task), with_numbers("vary", self.vary)
        for values in product(*vary.values()):
            labels = dict(zip(vary, values, strict=True))
            try:
                made = body.model_validate({**task, **labels})
            except ValidationError as error:
                raise InputError(": ".join(filter(None, first_wrong(error)))) from None
            fields = made.model_dump(mode="json", exclude_unset=True)
            if files := [value for value in fields.values() if str(value).endswith(".toml")]:
                raise InputError(f"{files[0]}: expected a preset, for workers have no such file")
            yield CampaignTask(kind(**fields), {name: str(value) for name, value in labels.items()})


def kind_named(name: str) -> type[Campaign]:
    """Return the class of a kind; of a task that is `Sweep`.

    Raises
    ------
    InputError
        If there is no such kind, or its module is not installed.
    """
    module, _, attribute = KINDS.get(name, name).partition(":")
    expected = f"kind: expected one of {', '.join(KINDS)}, or an installed module:Class"
    if not attribute:
        raise InputError(f"{expected}, got {name!r:.80}")
    try:
        kind = getattr(import_module(module), attribute)
    except (ImportError, AttributeError) as error:
        raise InputError(f"{expected}, got {name!r:.80}: {error}") from None
    if isinstance(kind, type) and issubclass(kind, Task):
        return Sweep
    if not (isinstance(kind, type) and issubclass(kind, Campaign)):
        raise InputError(f"{expected}, got {name!r:.80}, which is neither a Task nor a Campaign")
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
