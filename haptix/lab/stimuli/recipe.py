"""Recipes of stimuli: a set as a TOML file."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from shutil import copyfile
from typing import Annotated, Any, Literal, Self

from pydantic import BeforeValidator, Field, PositiveFloat, model_validator

from haptix.base.documents import Document, Part
from haptix.base.errors import InputError
from haptix.base.kinds import in_folder
from haptix.base.task import Context, Result, Task
from haptix.feel.signals.audio_files import Container, Encoding
from haptix.lab.population import DrawnPeople, Population
from haptix.lab.stimuli.designs import Design, equal_friction
from haptix.lab.stimuli.set_plan import TrialPlan, drive_limits
from haptix.lab.stimuli.stimulus import Stimulus, stimulus_from
from haptix.lab.stimuli.stimulus_set import StimulusSet
from haptix.model.finger import Finger
from haptix.model.perception.thresholds import Perception
from haptix.model.screen import Screen


class PopulationTable(DrawnPeople):
    """Table of a recipe: how its fingers differ."""

    size: Annotated[int, Field(le=1000)]  # each has a surface of its own


class TrialsTable(Part):
    """Table of a recipe: its trial plan."""

    repeats: Annotated[int, Field(le=10_000)] = 1
    gap_s: float = 1.0
    seed: int = 0
    in_order: bool = False


class Recipe(Document):
    """A set of stimuli, read from a file.

    Parameters
    ----------
    name : str
        Name of the set.
    finger : str
        Preset, or TOML file relative to the recipe's folder.
    population : PopulationTable, optional
        How fingers differ around that one.
    screens : list of str
        Presets or TOML files.
    stimuli : mapping of name to table
        Single stimuli, see `haptix.lab.stimuli.stimulus.stimulus_from`.
    designs : list of tables
        Designs, each with its `kind`.
    format, encoding, sample_rate_hz, full_scale_v, ceiling_v, trigger, unreachable, trials
        As in `StimulusSet`.
    perception : str, optional
        File of detection thresholds and JNDs.
    """

    name: str
    finger: str = "semi-wet"
    population: PopulationTable | None = None
    screens: Annotated[tuple[str, ...], Field(min_length=1)] = ("3m-sct3250",)
    stimuli: Annotated[dict[str, dict[str, Any]], Field(default_factory=dict)]
    designs: tuple[Design, ...] = ()
    sample_rate_hz: PositiveFloat = 48_000.0
    format: Container = "wav"
    encoding: Encoding = "float32"
    full_scale_v: PositiveFloat = 250.0
    ceiling_v: PositiveFloat | None = None
    trigger: bool = True
    unreachable: Literal["reject", "nearest"] = "reject"
    trials: TrialsTable = TrialsTable()
    perception: str | None = None
    folder: Annotated[Path, Field(exclude=True)] = Path()

    @model_validator(mode="after")
    def _has_stimuli(self) -> Self:
        if not self.stimuli and not self.designs:
            raise ValueError("expected stimuli or designs, got neither")
        return self

    def stimulus_set(self) -> StimulusSet:
        """Make the set.

        Raises `HaptixError` if a profile, a stimulus or a design is wrong.
        """
        known = Perception.default()
        if self.perception is not None:
            known = Perception.load(self.folder / self.perception)
        screens = tuple(Screen.named(name, self.folder) for name in self.screens)
        with in_folder(self.folder):
            stimuli = self._found(known, screens)
        median = Finger.named(self.finger, self.folder)
        finger: Finger | Population = median
        if self.population is not None:
            finger = Population.around(median, **self.population.model_dump())
        order = None if self.trials.in_order else self.trials.seed
        return StimulusSet(
            self.name, tuple(stimuli), finger, screens, self.sample_rate_hz, self.format,
            self.encoding, self.full_scale_v, self.ceiling_v, self.trigger, self.unreachable,
            TrialPlan(self.trials.repeats, self.trials.gap_s, order), known,
        )  # fmt: skip

    def _found(self, known: Perception, screens: tuple[Screen, ...]) -> list[Stimulus]:
        """Make all stimuli."""
        stimuli = [stimulus_from(name, table) for name, table in self.stimuli.items()]
        limits = drive_limits(screens, self.ceiling_v)
        for design in self.designs:
            try:
                made = design.stimuli(known, limits)
            except InputError as error:
                raise InputError(f"design {design.name!r}: {error}") from None
            if design.kind == "equal-friction":
                equal_friction(made, screens)
            stimuli += made
        return stimuli


class MakeStimuli(Task):
    """A set of stimuli with everything that it depends on; it reads no files.

    The fields are those of `StimulusSet`, but for the stimuli, as `Stimulus.describe` has them, and
    the fingers of a population with its statement.
    """

    name: str
    stimuli: tuple[dict[str, Any], ...]
    fingers: tuple[Finger, ...]
    statement: str | None
    screens: tuple[Screen, ...]
    sample_rate_hz: float
    container: str
    encoding: str
    full_scale_v: float
    ceiling_v: float | None
    trigger: bool
    unreachable: str
    trials: Annotated[
        TrialPlan,
        BeforeValidator(lambda table: TrialPlan(**table) if isinstance(table, dict) else table),
    ]
    perception: Perception

    @classmethod
    def of(cls, parts: StimulusSet) -> Self:
        """Describe a set."""
        people = parts.finger if isinstance(parts.finger, Population) else None
        described = {
            "stimuli": [stimulus.describe() for stimulus in parts.stimuli],
            "fingers": [parts.finger] if people is None else people.fingers,
            "statement": None if people is None else people.statement,
        }
        return cls(**{name: getattr(parts, name, None) for name in cls.model_fields} | described)

    def run(self, context: Context) -> Result:
        """Make it."""
        fields = dict(self)
        people, statement = fields.pop("fingers"), fields.pop("statement")
        fields["finger"] = people[0] if statement is None else Population(people, statement)
        fields["stimuli"] = tuple(
            stimulus_from(table.pop("name"), table) for table in map(dict, self.stimuli)
        )
        folder = Path(context.folder or ".")
        made = StimulusSet(**fields).make(folder, threads=1)
        sidecars = made.sidecars
        row = {
            "stimuli": len(sidecars),
            "length_s": sum(sidecar["length_s"] for sidecar in sidecars),
            "peak_v": max(sidecar["peak_v"] for sidecar in sidecars),
            "current_peak_a": max(sidecar["current"]["expected_peak_a"] for sidecar in sidecars),
            "files_bytes": sum(file["bytes"] for file in made.manifest["files"].values()),
        }
        files = sorted(path for path in folder.iterdir() if path.is_file())
        return Result(row, files={path.name: partial(copyfile, path) for path in files})

    @property
    def needed_bytes(self) -> int:
        """Memory of a surface that is built."""
        return 700_000_000
