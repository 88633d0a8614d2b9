"""Campaigns, which are documents that expand to tasks, and the kinds of them that haptix has.

The tasks of a kind are defined elsewhere, so a worker that does one loads nothing of the others.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from importlib import import_module
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

from pydantic import Field, NonNegativeFloat, PositiveFloat, PositiveInt, ValidationError

from haptix.base.documents import Document, Part
from haptix.base.errors import FileFormatError, InputError
from haptix.base.files import file_at, read_json, read_text, read_toml
from haptix.base.results import result_key
from haptix.base.task import Task, first_wrong, task_at
from haptix.base.units import with_numbers
from haptix.lab.population import DrawnPeople, Population, SolveStates
from haptix.model.finger import Finger
from haptix.model.screen import Screen
from haptix.plan.scene import Scene

if TYPE_CHECKING:
    from haptix.lab.stimuli.stimulus_set import StimulusSet

Value = str | float | int | bool | None
Labels = dict[str, Value]
AtLeastOne = Field(min_length=1)
Names = Annotated[tuple[str, ...], AtLeastOne]
Several = Annotated[tuple[PositiveFloat, ...], AtLeastOne]
SeveralOrZero = Annotated[tuple[NonNegativeFloat, ...], AtLeastOne]


@dataclass(frozen=True)
class CampaignTask:
    """A task of a campaign.

    Parameters
    ----------
    task : Task
        Its results depend on it and on the version of haptix alone.
    labels : mapping
        Names for people, for the table; no result depends on them.
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
        Kind of the tasks: a name of `KINDS`, or ``module:Class``.
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
        """Yield each combination; the last parameter varies fastest."""
        kind = task_at(self.kind)
        body = kind.body()
        task, vary = with_numbers("task", self.task), with_numbers("vary", self.vary)
        for values in product(*vary.values()):
            labels = dict(zip(vary, values, strict=True))
            try:
                checked = body.model_validate({**task, **labels})
            except ValidationError as error:
                raise InputError(": ".join(filter(None, first_wrong(error)))) from None
            fields = checked.model_dump(mode="json", exclude_unset=True)
            if files := [value for value in fields.values() if str(value).endswith(".toml")]:
                raise InputError(f"{files[0]}: expected a preset, for workers have no such file")
            yield CampaignTask(kind(**fields), {name: str(value) for name, value in labels.items()})


def people_of(
    finger: Finger, name: str, drawn: DrawnPeople | None
) -> Iterator[tuple[Finger, Labels]]:
    """Yield a finger, or the people who are drawn around it, each with its labels."""
    if drawn is None:
        yield finger, {"finger": name}
        return
    people = Population.draw(finger, drawn.size, drawn.spread, drawn.seed)
    for number, (person, drawn_fields) in enumerate(people):
        yield person, {"finger": name, "person": number, **drawn_fields}


def places_of(patterns: tuple[str, ...], folder: Path) -> Iterator[Path]:
    """Yield the files or folders of names and patterns within a folder, in order.

    Raises `InputError` if there is nothing of a name or pattern.
    """
    for pattern in patterns:
        paths = [folder / pattern] if Path(pattern).is_absolute() else sorted(folder.glob(pattern))
        if not paths:
            raise InputError(
                f"{folder / pattern}: expected a file, or a pattern of some; none is there"
            )
        yield from paths


class PeopleOnScreens(Campaign):
    """Tasks of every finger on every screen.

    Parameters
    ----------
    fingers, screens : tuple of str
        Presets, or TOML files relative to the campaign's.
    population : DrawnPeople, optional
        People in place of each finger.
    insulator_thickness_m : tuple of float
        Thicknesses [m] in place of each screen's own: one screen for each.
    """

    fingers: Names = ("semi-wet",)
    screens: Names = ("3m-sct3250",)
    population: DrawnPeople | None = None
    insulator_thickness_m: tuple[PositiveFloat, ...] = ()

    @abstractmethod
    def of_pair(self, finger: Finger, screen: Screen) -> Iterator[tuple[Task, Labels]]:
        """Yield the tasks of a finger on a screen, and how each is called."""

    def tasks(self) -> Iterator[CampaignTask]:
        """Yield the tasks of each finger on each screen."""
        screens: list[tuple[Screen, Labels]] = []
        for name in self.screens:
            screen = Screen.named(name, self.folder)
            screens += [
                (
                    screen.replace(insulator_thickness_m=d),
                    {"screen": name, "insulator_thickness_m": d},
                )
                for d in self.insulator_thickness_m
            ] or [(screen, {"screen": name})]
        for name in self.fingers:
            whole = Finger.named(name, self.folder)
            for finger, who in people_of(whole, name, self.population):
                for screen, which in screens:
                    for task, more in self.of_pair(finger, screen):
                        yield CampaignTask(task, {**who, **which, **more})


class SurfacesOfPeople(PeopleOnScreens):
    """A surface for every finger on every screen.

    Parameters
    ----------
    scene : mapping
        The fields of a `Scene`, except finger, screen and name.
    """

    maps = (("mu_low", "mu_high"), ("cpu_seconds", "error_max"))

    scene: dict[str, Any]

    def of_pair(self, finger: Finger, screen: Screen) -> Iterator[tuple[Task, Labels]]:
        """Yield one."""
        from haptix.plan.planning import BuildSurface

        yield BuildSurface(scene=self.scene_of(finger, screen)), {}

    def scene_of(self, finger: Finger, screen: Screen) -> Scene:
        """Return the scene of a finger on a screen, without fields that friction does not need."""
        # The campaign's name is left out: equal results of other campaigns have the same key.
        name = f"{finger.name} on {screen.name}"
        fields = {"name": name, **self.scene, "finger": finger, "screen": screen}
        return Scene(**fields, folder=self.folder).replace(textures=(), materials=())


class Tradeoffs(SurfacesOfPeople):
    """A task for each model and tolerance, see `haptix.plan.tradeoff`.

    Parameters
    ----------
    quick : bool
        Two tolerances and small batches.
    boundary_elements : bool
        Also measure a surface that boundary elements correct.
    """

    maps = (("build_s", "error_max_jnd"), ("memory_bytes", "error_max_jnd"))

    quick: bool = False
    boundary_elements: bool = False

    def of_pair(self, finger: Finger, screen: Screen) -> Iterator[tuple[Task, Labels]]:
        """Yield each setting of the scene."""
        from haptix.plan.tradeoff import settings

        scene = self.scene_of(finger, screen)
        for task in settings(scene, self.quick, self.boundary_elements):
            yield task, {"model": task.model, "tolerance": task.tolerance}


class FrictionOfPeople(PeopleOnScreens):
    """Friction of every finger on every screen at all combinations of some values.

    Parameters
    ----------
    normal_force_n, voltage_v, frequency_hz : tuple of float
        The values.
    """

    maps = (("mu_first", "mu_last"),)

    normal_force_n: Several
    voltage_v: SeveralOrZero
    frequency_hz: Several

    def of_pair(self, finger: Finger, screen: Screen) -> Iterator[tuple[SolveStates, Labels]]:
        """Yield one."""
        names = ("normal_force_n", "voltage_v", "frequency_hz")
        values = {name: getattr(self, name) for name in names}
        yield SolveStates(finger=finger, screen=screen, **values), {}


class BoundaryElementSets(FrictionOfPeople):
    """The same states, point by point on random surfaces, each of which is a task.

    Parameters
    ----------
    surfaces : int
        Surfaces of each finger on each screen.
    seed : int
        Seed of the first surface; it rises by one for each of the others.
    box : mapping
        Their grid: fields of `haptix.model.BoundaryElementBox`.
    """

    maps = (("area_first", "area_last"),)

    surfaces: PositiveInt = 4
    seed: int = 0
    box: dict[str, PositiveFloat] = Field(default={})

    def of_pair(self, finger: Finger, screen: Screen) -> Iterator[tuple[SolveStates, Labels]]:
        """Yield one for each surface."""
        [(task, _)] = super().of_pair(finger, screen)
        for seed in range(self.seed, self.seed + self.surfaces):
            box = {**self.box, "surfaces": 1, "seed": seed}
            yield SolveStates(**{**dict(task), "box": box}), {"surface": seed}


class CalibrationFits(Campaign):
    """A fit of each session, and one more for each prior that is tried, see `fit_folder`.

    Parameters
    ----------
    sessions : tuple of str
        Folders with a ``reduced.csv``, relative to the campaign's file; a pattern such as
        ``screens/*`` stands for several.
    priors : mapping
        Spreads of the prior to try, one at a time, by parameter: ``{youngs_modulus_pa = [0.15,
        0.6]}``. The strokes are also fitted with the usual priors.
    fixed : mapping
        Values at which parameters are held.
    leaky_gap : bool
        Whether the gap's resistivity is fitted.
    compare : bool
        Whether the uncertainty is widened by other forms of the model.
    """

    maps = (("prior_spread", "h0_m"), ("h0_m", "frictional_shear_stress_pa"))

    sessions: Names
    priors: Annotated[dict[str, tuple[PositiveFloat, ...]], Field(default_factory=dict)]
    fixed: Annotated[dict[str, PositiveFloat], Field(default_factory=dict)]
    leaky_gap: bool = False
    compare: bool = True

    def tasks(self) -> Iterator[CampaignTask]:
        """Yield a task for each session with its usual priors, then for each other prior."""
        from calibration.measure.session import Session
        from calibration.plan.parameters import Parameters
        from calibration.steps import REDUCED, FitStrokes, rig_check

        tried: list[tuple[str, float | None]] = [("", None)]
        tried += [(name, spread) for name, spreads in self.priors.items() for spread in spreads]
        how = {"fixed": self.fixed, "leaky_gap": self.leaky_gap, "compare": self.compare}
        for folder in places_of(self.sessions, self.folder):
            info = Session.open(folder).info
            known = Parameters.of(info.finger, info.screen, self.leaky_gap).with_rig()
            for name in (*self.priors, *self.fixed):
                known[name]  # refuses an unknown name here
            if not (folder / REDUCED).exists():
                raise FileFormatError(f"{folder}: has no {REDUCED}; `haptix calibrate reduce`")
            rig = rig_check(folder)
            shared = {"finger": info.finger, "screen": info.screen, **how}
            shared["reduced"] = read_text(folder / REDUCED)
            priors: dict[str, Any] = {} if rig is None else rig.sensor()
            for name, spread in tried:
                task = FitStrokes(
                    **shared, priors=priors | ({name: (None, spread)} if name else {})
                )
                labels: Labels = {"session": folder.name, "prior": name, "prior_spread": spread}
                yield CampaignTask(task, labels)


class StimulusSets(Campaign):
    """Every set for every finger.

    Parameters
    ----------
    recipes : tuple of str
        Files relative to the campaign's; a pattern such as ``sets/*.toml`` stands for several.
    fingers : tuple of str
        Fingers in place of each recipe's own: presets, or TOML files.
    population : DrawnPeople, optional
        People around each finger, each with sets of their own.
    """

    maps = (("files_bytes", "cpu_seconds"), ("peak_v", "current_peak_a"))

    recipes: Names
    fingers: tuple[str, ...] = ()
    population: DrawnPeople | None = None

    def tasks(self) -> Iterator[CampaignTask]:
        """Yield a task for each recipe and finger."""
        from haptix.lab.stimuli.recipe import MakeStimuli, Recipe

        for path in places_of(self.recipes, self.folder):
            parts = Recipe.load(path).stimulus_set()
            for finger, labels in self._fingers(parts):
                task = MakeStimuli.of(replace(parts, finger=finger))
                yield CampaignTask(task, {"recipe": path.name, **labels})

    def _fingers(self, parts: StimulusSet) -> Iterator[tuple[Finger | Population, Labels]]:
        named: list[Finger | Population] = [
            Finger.named(finger, self.folder) for finger in self.fingers
        ]
        for finger in named or [parts.finger]:
            if isinstance(finger, Finger):
                yield from people_of(finger, finger.name, self.population)
            elif self.population is None:
                yield finger, {"finger": "population"}
            else:
                why = "has people of its own; leave out one of the two"
                raise InputError(f"population: {parts.name!r} {why}")


class PairedTests(Part):
    """Two conditions whose difference a paired t-test is to find.

    Parameters
    ----------
    participants : tuple of int
        Sample sizes.
    difference_db, between_db : tuple of float
        Difference of the conditions, and spread of thresholds between people [dB].
    """

    participants: Annotated[tuple[PositiveInt, ...], AtLeastOne]
    difference_db: Annotated[tuple[float, ...], AtLeastOne] = (2.0,)
    between_db: SeveralOrZero = (3.0,)


class ExperimentSimulations(Campaign):
    """Every experiment with every simulated observer, as ``haptix stimuli simulate`` has it.

    Parameters
    ----------
    experiments : tuple of str
        Files relative to the campaign's; a pattern such as ``studies/*.toml`` stands for several.
    threshold_db, slope, lapse : tuple of float
        Of the observers.
    runs : int
        Runs of each observer, or simulated participants of a comparison.
    comparison : PairedTests, optional
        Also the power of a comparison, for each observer, difference and spread.
    """

    maps = (("threshold", "bias"), ("trials", "scatter"), ("participants", "power"))

    experiments: Names
    threshold_db: Annotated[tuple[float, ...], AtLeastOne]
    slope: Several = (1.5, 3.5)
    lapse: SeveralOrZero = (0.02, 0.08)
    runs: Annotated[int, Field(ge=10)] = 200
    comparison: PairedTests | None = None

    def tasks(self) -> Iterator[CampaignTask]:
        """Yield a task for each experiment and observer, and for each comparison."""
        from haptix.lab.analysis.power import simulations
        from haptix.lab.experiment.recipe import ExperimentRecipe

        comparisons: list[dict[str, Any]] = [{}]
        if (more := self.comparison) is not None:
            comparisons += [
                {"participants": [size], "difference": difference, "between": between}
                for size, difference, between in product(
                    more.participants, more.difference_db, more.between_db
                )
            ]
        observers = (self.threshold_db, self.slope, self.lapse)
        for path in places_of(self.experiments, self.folder):
            recipe = ExperimentRecipe.load(path)
            for compared in comparisons:
                for task in simulations(recipe, *observers, self.runs, compared or None):
                    labels: Labels = {"experiment": path.name}
                    labels["what"] = "power" if compared else "accuracy"
                    for name in ("threshold", "slope", "lapse"):
                        labels[name] = getattr(task.observer, name)
                    if compared:
                        labels["between"] = compared["between"]
                    yield CampaignTask(task, labels)


KINDS: dict[str, type[Campaign]] = {
    "surfaces": SurfacesOfPeople,
    "population": FrictionOfPeople,
    "boundary-elements": BoundaryElementSets,
    "trade-off": Tradeoffs,
    "calibration-fits": CalibrationFits,
    "stimulus-sets": StimulusSets,
    "experiment-simulations": ExperimentSimulations,
}
"""Kinds by name; a plan may also name a class of an installed module, as "module:Class"."""


def kind_named(name: str) -> type[Campaign]:
    """Return the class of a kind; for a task it is `Sweep`.

    Raises `InputError` if there is no such kind, or its module is not installed.
    """
    if name in KINDS:
        return KINDS[name]
    module, _, attribute = name.partition(":")
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

    Raises `HaptixError` if the file cannot be read, or is no campaign; the message names the error.
    """
    path = file_at("path", path)
    fields = read_json(path) if path.suffix == ".json" else read_toml(path)
    if not isinstance(kind := fields.get("kind"), str):
        raise FileFormatError(
            f"{path}: expected a campaign, whose kind is one of {', '.join(KINDS)}, "
            f"got {kind!r:.40}"
        )
    return kind_named(kind).load(path)
