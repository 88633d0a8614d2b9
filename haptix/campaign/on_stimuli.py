"""The kinds of campaigns "stimulus-sets" and "experiment-simulations"."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import asdict, replace
from pathlib import Path
from shutil import rmtree
from tempfile import mkdtemp
from typing import Annotated, Any, Literal
from weakref import finalize

from pydantic import Field, NonNegativeFloat, PositiveFloat, PositiveInt

from haptix.campaign.kinds import Campaign, CampaignTask, Outcome, Value, places_of
from haptix.documents import Part
from haptix.errors import InputError
from haptix.files import Content, csv_text
from haptix.finger import Finger
from haptix.perception import Perception
from haptix.population import DrawnPeople, Population
from haptix.screen import Screen
from haptix.stimuli.power import simulated, simulations
from haptix.stimuli.recipe import ExperimentRecipe, Recipe
from haptix.stimuli.set_plan import TrialPlan
from haptix.stimuli.stimulus import stimulus_from
from haptix.stimuli.stimulus_set import StimulusSet

_Several = Annotated[tuple[str, ...], Field(min_length=1)]
_SET_FIELDS = (
    *("sample_rate_hz", "container", "encoding", "full_scale_v", "ceiling_v", "trigger"),
    "unreachable",
)


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
    recipes: _Several
    fingers: tuple[str, ...] = ()
    population: DrawnPeople | None = None

    def tasks(self) -> Iterator[CampaignTask]:
        """Yield a task for each recipe and finger."""
        for path in places_of(self.recipes, self.folder):
            parts = Recipe.load(path).stimulus_set()
            for finger, labels in self._fingers(parts):
                who = replace(parts, finger=finger)
                yield CampaignTask(self.kind, _described(who), {"recipe": path.name, **labels})

    def _fingers(self, parts: StimulusSet) -> Iterator[tuple[Any, dict[str, Value]]]:
        named: list[Finger | Population] = [
            Finger.named(name, self.folder) for name in self.fingers
        ]
        drawn = self.population
        for finger in named or [parts.finger]:
            if isinstance(finger, Population):
                if drawn is not None:
                    why = "has people of its own; leave out one of the two"
                    raise InputError(f"population: {parts.name!r} {why}")
                yield finger, {"finger": "population"}
                continue
            if drawn is None:
                yield finger, {"finger": finger.name}
                continue
            people = Population.draw(finger, drawn.size, drawn.spread, drawn.seed)
            for number, (one, ratios) in enumerate(people):
                yield one, {"finger": finger.name, "person": number, **ratios}

    @staticmethod
    def run(document: Mapping[str, Any]) -> Outcome:
        """Make one set."""
        folder = Path(mkdtemp(prefix="haptix-set-"))
        moves = _Moves(folder)
        made = _set_of(document).make(folder, threads=1)
        names = sorted(path.name for path in folder.iterdir() if path.is_file())
        row: dict[str, Value] = {
            "stimuli": len(made.sidecars),
            "length_s": sum(one["length_s"] for one in made.sidecars),
            "peak_v": max(one["peak_v"] for one in made.sidecars),
            "current_peak_a": max(one["current"]["expected_peak_a"] for one in made.sidecars),
            "files_bytes": sum(one["bytes"] for one in made.manifest["files"].values()),
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
        from shutil import move

        return lambda path: move(self._folder / name, path)


def _described(parts: StimulusSet) -> dict[str, Any]:
    """Everything that a set depends on, as plain values."""
    people = parts.finger.fingers if isinstance(parts.finger, Population) else (parts.finger,)
    stimuli = [one.describe() for one in parts.stimuli]
    found = {
        "name": parts.name,
        "stimuli": stimuli,
        "fingers": [one.model_dump(mode="json", exclude_none=True) for one in people],
        "screens": [one.model_dump(mode="json", exclude_none=True) for one in parts.screens],
        "trials": asdict(parts.trials),
        "perception": parts.perception.model_dump(mode="json", exclude_none=True),
        **{name: getattr(parts, name) for name in _SET_FIELDS},
    }
    if isinstance(parts.finger, Population):
        found["statement"] = parts.finger.statement
    return json.loads(json.dumps(found))  # type: ignore[no-any-return]  # an object, of lists


def _set_of(document: Mapping[str, Any]) -> StimulusSet:
    people = tuple(Finger(**one) for one in document["fingers"])
    statement = document.get("statement")
    return StimulusSet(
        document["name"],
        tuple(
            stimulus_from(one["name"], {k: v for k, v in one.items() if k != "name"})
            for one in document["stimuli"]
        ),
        people[0] if statement is None else Population(people, statement),
        tuple(Screen(**one) for one in document["screens"]),
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

    participants: Annotated[tuple[PositiveInt, ...], Field(min_length=1)]
    difference_db: Annotated[tuple[float, ...], Field(min_length=1)] = (2.0,)
    between_db: Annotated[tuple[NonNegativeFloat, ...], Field(min_length=1)] = (3.0,)


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
    experiments: _Several
    threshold_db: Annotated[tuple[float, ...], Field(min_length=1)]
    slope: Annotated[tuple[PositiveFloat, ...], Field(min_length=1)] = (1.5, 3.5)
    lapse: Annotated[tuple[NonNegativeFloat, ...], Field(min_length=1)] = (0.02, 0.08)
    runs: Annotated[int, Field(ge=10)] = 200
    comparison: Comparison | None = None

    def tasks(self) -> Iterator[CampaignTask]:
        """Yield a task for each experiment and observer, and for each comparison."""
        asked: list[dict[str, Any] | None] = [None]
        if (more := self.comparison) is not None:
            asked += [
                {"participants": [size], "difference": far, "between": wide}
                for size in more.participants
                for far in more.difference_db
                for wide in more.between_db
            ]
        for path in places_of(self.experiments, self.folder):
            recipe = ExperimentRecipe.load(path)
            for one in asked:
                found = simulations(
                    recipe, self.threshold_db, self.slope, self.lapse, self.runs, one
                )
                for document in found:
                    labels = {
                        "experiment": path.name,
                        "what": "accuracy" if one is None else "power",
                    }
                    observer = document["observer"]
                    labels |= {name: observer[name] for name in ("threshold", "slope", "lapse")}
                    if one is not None:
                        labels["between"] = one["between"]
                    yield CampaignTask(self.kind, document, labels)

    @staticmethod
    def run(document: Mapping[str, Any]) -> Outcome:
        """Simulate one observer, or one comparison."""
        [row] = json.loads(simulated(json.dumps(document)))
        row = {name: None if value != value else value for name, value in row.items()}
        return Outcome(row, {"simulation.csv": csv_text(row, [row.values()])})
