"""Recipes: a set of stimuli, or an experiment, as a TOML file."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import Field, PositiveFloat, model_validator

from haptix.devices import DriveLimits
from haptix.documents import Document, Part
from haptix.errors import InputError
from haptix.finger import Finger
from haptix.kinds import in_folder
from haptix.perception import Perception
from haptix.population import DrawnPeople, Population
from haptix.screen import Screen
from haptix.signals.audio import Container, Encoding
from haptix.stimuli.designs import (
    constant_stimuli,
    equal_friction,
    equal_mean,
    full_factorial,
    matched_intensity,
    stimulus_maker,
    variants_of,
)
from haptix.stimuli.making import StimulusSet
from haptix.stimuli.set_plan import drive_limits
from haptix.stimuli.stimulus import Stimulus, stimulus_from
from haptix.stimuli.trials import TrialPlan

Table = dict[str, Any]


class FactorialDesign(Part):
    """Every combination of values put at dotted places of a base stimulus.

    For equal friction the stimuli are in mu, rendered for each of several screens. For equal mean
    friction they are shifted to one `mean`, in their quantity. `variants` draws each several times,
    with other seeds.
    """

    kind: Literal["factorial", "equal-friction", "equal-mean-friction"]
    name: str
    base: Table
    factors: dict[str, list[Any]] = Field(default={})
    variants: Annotated[int, Field(ge=1)] = 1
    mean: float | None = None

    @model_validator(mode="after")
    def _has_a_mean(self) -> Self:
        if (self.mean is None) == (self.kind == "equal-mean-friction"):
            raise ValueError("mean: expected with equal-mean-friction, and only with it")
        return self

    def stimuli(self, known: Perception, limits: DriveLimits) -> list[Stimulus]:
        """Make the stimuli; without factors only the base, under the design's name."""
        if self.factors:
            make = stimulus_maker(self.base, f"{self.name}.factors")
            found = full_factorial(self.name, make, **self.factors)
        else:
            found = [stimulus_from(self.name, self.base)]
        found = variants_of(found, self.variants) if self.variants > 1 else found
        return found if self.mean is None else equal_mean(found, self.mean)


class ConstantStimuliDesign(Part):
    """Stimuli of one design whose levels are in dB relative to a detection threshold."""

    kind: Literal["constant-stimuli"]
    name: str
    base: Table
    vary: str = "signal.amplitude"
    threshold: PositiveFloat
    steps_db: list[float]

    def stimuli(self, known: Perception, limits: DriveLimits) -> list[Stimulus]:
        """Make the stimuli of the design."""
        make = stimulus_maker(self.base, f"{self.name}.vary")
        return constant_stimuli(
            self.name, lambda name, at: make(name, **{self.vary: at}), self.threshold, self.steps_db
        )


class MatchedIntensityDesign(Part):
    """Tones at one level above the detection threshold."""

    kind: Literal["matched-intensity"]
    name: str
    felt_hz: list[float]
    sensation_db: float
    length_s: PositiveFloat
    drive: Literal["direct", "carrier"] = "direct"
    normal_force_n: PositiveFloat = 0.5
    carrier_hz: PositiveFloat = 4000.0
    fade_s: Annotated[float, Field(ge=0)] = 0.05

    def stimuli(self, known: Perception, limits: DriveLimits) -> list[Stimulus]:
        """Make the stimuli of the design."""
        given = self.model_dump(exclude={"kind"})
        return matched_intensity(**given, perception=known, limits=limits)


Design = Annotated[
    FactorialDesign | ConstantStimuliDesign | MatchedIntensityDesign, Field(discriminator="kind")
]


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
        Single stimuli, see `haptix.stimuli.stimulus.stimulus_from`.
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
    stimuli: Annotated[dict[str, Table], Field(default_factory=dict)]
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

    @classmethod
    def _from_table(cls, fields: dict[str, Any], folder: Path) -> Self:
        if "folder" in fields:
            raise InputError("Recipe.folder: a file has none; its paths are relative to the file")
        return cls(**fields, folder=folder)

    def stimulus_set(self) -> StimulusSet:
        """Make the set.

        Raises
        ------
        HaptixError
            If a profile, a stimulus or a design is wrong.
        """
        known = Perception.default()
        if self.perception is not None:
            known = Perception.load(self.folder / self.perception)
        screens = tuple(Screen.named(name, self.folder) for name in self.screens)
        with in_folder(self.folder):
            found = self._found(known, screens)
        one = Finger.named(self.finger, self.folder)
        finger: Finger | Population = one
        if self.population is not None:
            finger = Population.around(one, **self.population.model_dump())
        order = None if self.trials.in_order else self.trials.seed
        return StimulusSet(
            self.name, tuple(found), finger, screens, self.sample_rate_hz, self.format,
            self.encoding, self.full_scale_v, self.ceiling_v, self.trigger, self.unreachable,
            TrialPlan(self.trials.repeats, self.trials.gap_s, order), known,
        )  # fmt: skip

    def _found(self, known: Perception, screens: tuple[Screen, ...]) -> list[Stimulus]:
        """Make all stimuli."""
        found = [stimulus_from(name, table) for name, table in self.stimuli.items()]
        limits = drive_limits(screens, self.ceiling_v)
        for design in self.designs:
            try:
                made = design.stimuli(known, limits)
            except InputError as error:
                raise InputError(f"design {design.name!r}: {error}") from None
            if design.kind == "equal-friction":
                equal_friction(made, screens)
            found += made
        return found
