"""The kinds of campaigns that haptix has: people on screens, calibrations, stimuli, experiments.

A worker that does one kind loads nothing of the others.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import asdict, replace
from pathlib import Path
from shutil import move, rmtree
from tempfile import TemporaryDirectory, mkdtemp
from typing import TYPE_CHECKING, Annotated, Any, Literal
from weakref import finalize

from pydantic import BaseModel, Field, NonNegativeFloat, PositiveFloat, PositiveInt

from haptix.campaign.kinds import Campaign, CampaignTask, Outcome, Value, places_of
from haptix.documents import Part
from haptix.errors import FileFormatError, InputError
from haptix.files import Content, csv_text, json_text, read_text
from haptix.finger import Finger
from haptix.population import DrawnPeople, Population, states_of
from haptix.scene import Scene, plain_scene
from haptix.screen import Screen

if TYPE_CHECKING:
    from haptix.stimuli.stimulus_set import StimulusSet

Labels = dict[str, Value]
AtLeastOne = Field(min_length=1)
Names = Annotated[tuple[str, ...], AtLeastOne]
Several = Annotated[tuple[PositiveFloat, ...], AtLeastOne]
SeveralOrZero = Annotated[tuple[NonNegativeFloat, ...], AtLeastOne]

_COSTS = ("build_s", "query_s_per_million", "invert_s_per_million")
# Of a float32 surface, for the table; the file has all ways to ask it.
_WAY = {"dtype": "float32", "form": "surface", "device": "cpu"}
_SET_FIELDS = (
    *("sample_rate_hz", "container", "encoding", "full_scale_v", "ceiling_v", "trigger"),
    "unreachable",
)


def plain(document: BaseModel) -> dict[str, Any]:
    """Return a document as plain values."""
    return document.model_dump(mode="json", exclude_none=True)


def people_of(
    finger: Finger, name: str, drawn: DrawnPeople | None
) -> Iterator[tuple[Finger, Labels]]:
    """Yield a finger, or the people who are drawn around it, each with its labels."""
    if drawn is None:
        yield finger, {"finger": name}
        return
    people = Population.draw(finger, drawn.size, drawn.spread, drawn.seed)
    for number, (person, ratios) in enumerate(people):
        yield person, {"finger": name, "person": number, **ratios}


class PeopleOnScreens(Campaign):
    """Every finger on every screen.

    Parameters
    ----------
    fingers, screens : tuple of str
        Presets, or TOML files relative to the campaign's.
    population : DrawnPeople, optional
        People in place of each finger.
    insulator_thickness_m : tuple of float
        In place of that of each screen, one screen for each [m].
    """

    fingers: Names = ("semi-wet",)
    screens: Names = ("3m-sct3250",)
    population: DrawnPeople | None = None
    insulator_thickness_m: tuple[PositiveFloat, ...] = ()

    def pairs(self) -> Iterator[tuple[Finger, Screen, Labels]]:
        """Yield every finger with every screen, and how the pair is called."""
        screens: list[tuple[Screen, Labels]] = []
        for name in self.screens:
            screen, labels = Screen.named(name, self.folder), {"screen": name}
            screens += [
                (screen.replace(insulator_thickness_m=d), {**labels, "insulator_thickness_m": d})
                for d in self.insulator_thickness_m
            ] or [(screen, dict(labels))]
        for name in self.fingers:
            whole = Finger.named(name, self.folder)
            for finger, who in people_of(whole, name, self.population):
                for screen, which in screens:
                    yield finger, screen, {**who, **which}


class ScenesOfPeople(PeopleOnScreens):
    """A scene for every finger on every screen.

    Parameters
    ----------
    scene : mapping
        The fields of a `Scene` but finger, screen and name.
    """

    scene: dict[str, Any]

    def scenes(self) -> Iterator[tuple[Scene, Labels]]:
        """Yield every scene, and how it is called."""
        for finger, screen, labels in self.pairs():
            # Not the campaign's name: a result has no part in it.
            name = f"{finger.name} on {screen.name}"
            fields = {"name": name, **self.scene, "finger": finger, "screen": screen}
            yield Scene(**fields, folder=self.folder), labels


class SurfacesOfPeople(ScenesOfPeople):
    """A surface for every finger on every screen, as ``haptix build SCENE.toml`` makes it."""

    shown = ("mu_low", "mu_high", "mu_span", "surface_bytes")
    maps = (("mu_low", "mu_high"), ("cpu_seconds", "error_max"))

    kind: Literal["surfaces"]

    def tasks(self) -> Iterator[CampaignTask]:
        """Yield a task for each finger on each screen."""
        for scene, labels in self.scenes():
            yield CampaignTask(self.kind, plain_scene(scene), labels)

    @staticmethod
    def run(document: Mapping[str, Any]) -> Outcome:
        """Plan the scene, and build its surface."""
        from haptix.planning import plan_scene

        surface = plan_scene(Scene(**document)).build()
        info = surface.info
        row = {
            "mu_low": info["mu_low"],
            "mu_high": info["mu_high"],
            "mu_span": info["mu_high"] / info["mu_low"],
            "error_max": info["error_max"],
            "pull_past_breakdown": info["pull_past_breakdown"],
            "surface_bytes": surface.nbytes,
        }
        return Outcome(row, {"friction.surface": surface.save})


class Tradeoffs(ScenesOfPeople):
    """A task for each model and tolerance, see `haptix.tradeoff`.

    Parameters
    ----------
    quick : bool
        Two tolerances and small batches.
    boundary_elements : bool
        Also a surface that they correct.
    """

    shown = ("error_max_jnd", "memory_bytes")
    maps = (("build_s", "error_max_jnd"), ("memory_bytes", "error_max_jnd"))

    kind: Literal["trade-off"]
    quick: bool = False
    boundary_elements: bool = False

    def tasks(self) -> Iterator[CampaignTask]:
        """Yield a task for each setting of each scene."""
        from haptix.tradeoff.runs import setting_jobs

        for scene, labels in self.scenes():
            for job in setting_jobs(scene, self.quick, self.boundary_elements):
                way = {"model": job["model"], "tolerance": job["tolerance"]}
                yield CampaignTask(self.kind, job, {**labels, **way})

    @staticmethod
    def run(document: Mapping[str, Any]) -> Outcome:
        """Build and measure one setting; its times are costs, and no results."""
        from haptix.tradeoff.runs import measure_setting

        measured = measure_setting(document)
        runs = measured["runs"]
        usual = next((run for run in runs if _WAY.items() <= run.items()), runs[0])
        times: Labels = {name: usual[name] for name in _COSTS}
        for run in runs:
            way = f"{run['dtype']} {run['form']} {run['device']}"
            times |= {f"{way} {name}": run.pop(name) for name in _COSTS}
            del run["fronts"], run["take"]  # they are among all settings
        kept = ("error_max_jnd", "error_p99_jnd", "outside_share", "memory_bytes")
        row = {name: usual[name] for name in kept}
        return Outcome(row, {"runs.json": json_text(measured)}, times)


class FrictionOfPeople(PeopleOnScreens):
    """Friction of every finger on every screen at all combinations of some values.

    Parameters
    ----------
    normal_force_n, voltage_v, frequency_hz : tuple of float
        The values.
    """

    shown = ("mu_first", "mu_last", "ratio")
    maps = (("mu_first", "mu_last"),)

    kind: Literal["population"]
    normal_force_n: Several
    voltage_v: SeveralOrZero
    frequency_hz: Several

    def tasks(self) -> Iterator[CampaignTask]:
        """Yield a task for each finger on each screen."""
        for finger, screen, labels in self.pairs():
            document: dict[str, Any] = {"finger": plain(finger), "screen": plain(screen)}
            for name in ("normal_force_n", "voltage_v", "frequency_hz"):
                document[name] = list(getattr(self, name))
            yield CampaignTask(self.kind, document, labels)

    @staticmethod
    def run(document: Mapping[str, Any]) -> Outcome:
        """Solve all states of one finger on one screen, or of one surface."""
        states = states_of(document)
        mu, area = states["mu"], states["area_fraction"]
        row = {
            "mu_first": mu[0],
            "mu_last": mu[-1],
            "ratio": mu[-1] / mu[0],
            "area_first": area[0],
            "area_last": area[-1],
            "not_ok": sum(status != "OK" for status in states["status"]),
        }
        return Outcome(row, {"states.csv": csv_text(states, zip(*states.values(), strict=True))})


class Box(Part):
    """Box of the boundary elements, see `haptix.fidelity.BoundaryElementBox`."""

    points: PositiveInt = 128
    waves: PositiveFloat = 2.0
    tolerance: PositiveFloat = 1e-5


class BoundaryElementSets(FrictionOfPeople):
    """The same states, point by point on random surfaces, each of which is a task.

    Parameters
    ----------
    surfaces : int
        Surfaces of each finger on each screen.
    seed : int
        Seed of the first; each next one has the next.
    box : Box
        Their grid.
    """

    shown = ("area_first", "area_last", "mu_last")
    maps = (("area_first", "area_last"),)

    kind: Literal["boundary-elements"]  # type: ignore[assignment]  # in place of its parent's
    surfaces: PositiveInt = 4
    seed: int = 0
    box: Box = Box()

    def tasks(self) -> Iterator[CampaignTask]:
        """Yield a task for each surface."""
        for task in super().tasks():
            for number in range(self.seed, self.seed + self.surfaces):
                box = {**self.box.model_dump(), "surfaces": 1, "seed": number}
                labels = {**task.labels, "surface": number}
                yield CampaignTask(self.kind, {**task.document, "box": box}, labels)

    @staticmethod
    def needed_bytes(document: Mapping[str, Any]) -> int:
        """Memory of one surface."""
        from haptix.contact.boundary_elements import estimated_bytes

        return estimated_bytes(document["box"]["points"], 1, coupled=True)


class CalibrationFits(Campaign):
    """A fit of each session, and one more for each prior that is tried, see `fit_folder`.

    Parameters
    ----------
    sessions : tuple of str
        Folders with a ``reduced.csv``, relative to the campaign's file; a pattern such as
        ``screens/*`` stands for several.
    priors : mapping
        Spreads of the prior to be tried, one at a time, by parameter: ``{youngs_modulus_pa =
        [0.15, 0.6]}``. The strokes are fitted with the usual ones as well.
    fixed : mapping
        Values at which parameters are held.
    leaky_gap : bool
        Whether the gap's resistivity is fitted.
    compare : bool
        Whether the uncertainty is widened by other forms of the model.
    """

    shown = ("h0_m", "h0_m spread")
    maps = (("prior_spread", "h0_m"), ("h0_m", "frictional_shear_stress_pa"))

    kind: Literal["calibration-fits"]
    sessions: Names
    priors: Annotated[dict[str, tuple[PositiveFloat, ...]], Field(default_factory=dict)]
    fixed: Annotated[dict[str, PositiveFloat], Field(default_factory=dict)]
    leaky_gap: bool = False
    compare: bool = True

    def tasks(self) -> Iterator[CampaignTask]:
        """Yield a task for each session with its usual priors, then for each other prior."""
        from calibration.parameters import Parameters
        from calibration.session import Session
        from calibration.steps import REDUCED, rig_check

        tried: list[tuple[str, float | None]] = [("", None)]
        tried += [(name, spread) for name, spreads in self.priors.items() for spread in spreads]
        for folder in places_of(self.sessions, self.folder):
            info = Session.open(folder).info
            known = Parameters.of(info.finger, info.screen, self.leaky_gap).with_rig()
            for name in (*self.priors, *self.fixed):
                known[name]  # an unknown one is refused here, by name
            if not (folder / REDUCED).exists():
                raise FileFormatError(f"{folder}: has no {REDUCED}; `haptix calibrate reduce`")
            rig = rig_check(folder)
            tapped = {} if rig is None else {name: [*ends] for name, ends in rig.sensor().items()}
            shared = {
                "reduced": read_text(folder / REDUCED),
                "finger": plain(info.finger),
                "screen": plain(info.screen),
                "fixed": self.fixed,
                "leaky_gap": self.leaky_gap,
                "compare": self.compare,
            }
            for name, spread in tried:
                priors = {**tapped, **({name: [None, spread]} if name else {})}
                labels: Labels = {"session": folder.name, "prior": name, "prior_spread": spread}
                yield CampaignTask(self.kind, {**shared, "priors": priors}, labels)

    @staticmethod
    def run(document: Mapping[str, Any]) -> Outcome:
        """Fit one session by one set of priors."""
        from calibration.reduction import Reduced
        from calibration.steps import FIT, REDUCED, fit_reduced

        with TemporaryDirectory(prefix="haptix-fit-") as folder:
            path = Path(folder, REDUCED)
            path.write_text(document["reduced"], encoding="utf-8")
            reduced = Reduced.load(path)
        fit, _ = fit_reduced(
            reduced,
            Finger(**document["finger"]),
            Screen(**document["screen"]),
            document["fixed"],
            {name: (value, spread) for name, (value, spread) in document["priors"].items()},
            leaky_gap=document["leaky_gap"],
            compare=document["compare"],
        )
        row: Labels = {"theory": fit.theory, "strokes": len(fit.strokes)}
        for estimate in fit.estimates:
            row[estimate.name] = fit.best(estimate.name)
            row[f"{estimate.name} spread"] = estimate.spread
            row[f"{estimate.name} verdict"] = estimate.verdict
        return Outcome(row, {FIT: fit.save})


class StimulusSets(Campaign):
    """Every set for every finger, as ``haptix stimuli make RECIPE.toml`` makes it.

    Parameters
    ----------
    recipes : tuple of str
        Files relative to the campaign's; a pattern such as ``sets/*.toml`` stands for several.
    fingers : tuple of str
        In place of that of each recipe: presets, or TOML files.
    population : DrawnPeople, optional
        People around each finger, each with sets of their own.
    """

    shown = ("peak_v", "files_bytes")
    maps = (("files_bytes", "cpu_seconds"), ("peak_v", "current_peak_a"))

    kind: Literal["stimulus-sets"]
    recipes: Names
    fingers: tuple[str, ...] = ()
    population: DrawnPeople | None = None

    def tasks(self) -> Iterator[CampaignTask]:
        """Yield a task for each recipe and finger."""
        from haptix.stimuli.recipe import Recipe

        for path in places_of(self.recipes, self.folder):
            parts = Recipe.load(path).stimulus_set()
            for finger, labels in self._fingers(parts):
                who = replace(parts, finger=finger)
                yield CampaignTask(self.kind, _described(who), {"recipe": path.name, **labels})

    def _fingers(self, parts: StimulusSet) -> Iterator[tuple[Finger | Population, Labels]]:
        named: list[Finger | Population] = [
            Finger.named(name, self.folder) for name in self.fingers
        ]
        for finger in named or [parts.finger]:
            if isinstance(finger, Finger):
                yield from people_of(finger, finger.name, self.population)
            elif self.population is None:
                yield finger, {"finger": "population"}
            else:
                why = "has people of its own; leave out one of the two"
                raise InputError(f"population: {parts.name!r} {why}")

    @staticmethod
    def run(document: Mapping[str, Any]) -> Outcome:
        """Make one set."""
        folder = Path(mkdtemp(prefix="haptix-set-"))
        moves = _Moves(folder)
        made = _set_of(document).make(folder, threads=1)
        names = sorted(path.name for path in folder.iterdir() if path.is_file())
        sidecars = made.sidecars
        row: Labels = {
            "stimuli": len(sidecars),
            "length_s": sum(sidecar["length_s"] for sidecar in sidecars),
            "peak_v": max(sidecar["peak_v"] for sidecar in sidecars),
            "current_peak_a": max(sidecar["current"]["expected_peak_a"] for sidecar in sidecars),
            "files_bytes": sum(file["bytes"] for file in made.manifest["files"].values()),
        }
        return Outcome(row, {name: moves.of(name) for name in names})

    @staticmethod
    def needed_bytes(document: Mapping[str, Any]) -> int:
        """Memory of a surface that is built."""
        return 700_000_000


class _Moves:
    """Moves files out of a folder that ends with the last of them."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        finalize(self, rmtree, folder, True)

    def of(self, name: str) -> Content:
        """Return what moves a file to a path."""
        return lambda path: move(self._folder / name, path)


def _described(parts: StimulusSet) -> dict[str, Any]:
    """Everything that a set depends on, as plain values."""
    people: tuple[Any, ...] = (parts.finger,)
    statement = {}
    if isinstance(parts.finger, Population):
        people, statement = parts.finger.fingers, {"statement": parts.finger.statement}
    described = {
        "name": parts.name,
        "stimuli": [stimulus.describe() for stimulus in parts.stimuli],
        "fingers": [plain(finger) for finger in people],
        "screens": [plain(screen) for screen in parts.screens],
        "trials": asdict(parts.trials),
        "perception": plain(parts.perception),
        **{name: getattr(parts, name) for name in _SET_FIELDS},
        **statement,
    }
    return json.loads(json.dumps(described))  # type: ignore[no-any-return]  # an object, of lists


def _set_of(document: Mapping[str, Any]) -> StimulusSet:
    from haptix.perception import Perception
    from haptix.stimuli.set_plan import TrialPlan
    from haptix.stimuli.stimulus import stimulus_from
    from haptix.stimuli.stimulus_set import StimulusSet

    people = tuple(Finger(**finger) for finger in document["fingers"])
    statement = document.get("statement")
    stimuli = []
    for described in document["stimuli"]:
        fields = {name: value for name, value in described.items() if name != "name"}
        stimuli.append(stimulus_from(described["name"], fields))
    return StimulusSet(
        document["name"],
        tuple(stimuli),
        people[0] if statement is None else Population(people, statement),
        tuple(Screen(**screen) for screen in document["screens"]),
        trials=TrialPlan(**document["trials"]),
        perception=Perception(**document["perception"]),
        **{name: document[name] for name in _SET_FIELDS},
    )


class Comparison(Part):
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
    comparison : Comparison, optional
        Also the power of a comparison, for each observer, difference and spread.
    """

    shown = ("bias", "scatter", "power")
    maps = (("threshold", "bias"), ("trials", "scatter"), ("participants", "power"))

    kind: Literal["experiment-simulations"]
    experiments: Names
    threshold_db: Annotated[tuple[float, ...], AtLeastOne]
    slope: Several = (1.5, 3.5)
    lapse: SeveralOrZero = (0.02, 0.08)
    runs: Annotated[int, Field(ge=10)] = 200
    comparison: Comparison | None = None

    def tasks(self) -> Iterator[CampaignTask]:
        """Yield a task for each experiment and observer, and for each comparison."""
        from haptix.stimuli.power import simulations
        from haptix.stimuli.recipe import ExperimentRecipe

        comparisons: list[dict[str, Any] | None] = [None]
        if (more := self.comparison) is not None:
            comparisons += [
                {"participants": [size], "difference": difference, "between": between}
                for size in more.participants
                for difference in more.difference_db
                for between in more.between_db
            ]
        observers = (self.threshold_db, self.slope, self.lapse)
        for path in places_of(self.experiments, self.folder):
            recipe = ExperimentRecipe.load(path)
            for compared in comparisons:
                what = "accuracy" if compared is None else "power"
                for document in simulations(recipe, *observers, self.runs, compared):
                    labels: Labels = {"experiment": path.name, "what": what}
                    for name in ("threshold", "slope", "lapse"):
                        labels[name] = document["observer"][name]
                    if compared is not None:
                        labels["between"] = compared["between"]
                    yield CampaignTask(self.kind, document, labels)

    @staticmethod
    def run(document: Mapping[str, Any]) -> Outcome:
        """Simulate one observer, or one comparison."""
        from haptix.stimuli.power import simulated

        [row] = json.loads(simulated(json.dumps(document)))
        row = {name: None if value != value else value for name, value in row.items()}
        return Outcome(row, {"simulation.csv": csv_text(row, [row.values()])})
