"""The kinds "surfaces", "trade-off", "population" and "boundary-elements": people on screens."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Annotated, Any, Literal

from pydantic import Field, NonNegativeFloat, PositiveFloat, PositiveInt

from haptix.campaign.kinds import Campaign, CampaignTask, Outcome, Value
from haptix.contact.boundary_elements import estimated_bytes
from haptix.documents import Part
from haptix.files import csv_text, json_text
from haptix.finger import Finger
from haptix.planning import plan_scene
from haptix.population import DrawnPeople, Population, states_of
from haptix.scene import Scene, plain_scene
from haptix.screen import Screen
from haptix.tradeoff.runs import measure_setting, setting_jobs

Several = Annotated[tuple[PositiveFloat, ...], Field(min_length=1)]
_COSTS = ("build_s", "query_s_per_million", "invert_s_per_million")
# Of a float32 surface, for the table; the file has all ways to ask it.
_WAY = {"dtype": "float32", "form": "surface", "device": "cpu"}


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

    fingers: Annotated[tuple[str, ...], Field(min_length=1)] = ("semi-wet",)
    screens: Annotated[tuple[str, ...], Field(min_length=1)] = ("3m-sct3250",)
    population: DrawnPeople | None = None
    insulator_thickness_m: tuple[PositiveFloat, ...] = ()

    def pairs(self) -> Iterator[tuple[Finger, Screen, dict[str, Value]]]:
        """Yield every finger with every screen, and how the pair is called."""
        screens: list[tuple[Screen, dict[str, Value]]] = []
        for name in self.screens:
            screen, labels = Screen.named(name, self.folder), {"screen": name}
            screens += [
                (screen.replace(insulator_thickness_m=d), {**labels, "insulator_thickness_m": d})
                for d in self.insulator_thickness_m
            ] or [(screen, dict(labels))]
        for finger, who in self._people():
            for screen, which in screens:
                yield finger, screen, {**who, **which}

    def _people(self) -> Iterator[tuple[Finger, dict[str, Value]]]:
        for name in self.fingers:
            finger, drawn = Finger.named(name, self.folder), self.population
            if drawn is None:
                yield finger, {"finger": name}
                continue
            people = Population.draw(finger, drawn.size, drawn.spread, drawn.seed)
            for number, (one, ratios) in enumerate(people):
                yield one, {"finger": name, "person": number, **ratios}


class ScenesOfPeople(PeopleOnScreens):
    """A scene for every finger on every screen.

    Parameters
    ----------
    scene : mapping
        The fields of a `Scene` but finger, screen and name.
    """

    scene: dict[str, Any]

    def scenes(self) -> Iterator[tuple[Scene, dict[str, Value]]]:
        """Yield every scene, and how it is called."""
        for finger, screen, labels in self.pairs():
            name = (
                f"{finger.name} on {screen.name}"  # not the campaign's: a result has no part in it
            )
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

    shown = ("error_max_thresholds", "memory_bytes")
    maps = (("build_s", "error_max_thresholds"), ("memory_bytes", "error_max_thresholds"))

    kind: Literal["trade-off"]
    quick: bool = False
    boundary_elements: bool = False

    def tasks(self) -> Iterator[CampaignTask]:
        """Yield a task for each setting of each scene."""
        for scene, labels in self.scenes():
            for job in setting_jobs(scene, self.quick, self.boundary_elements):
                way = {"model": job["model"], "tolerance": job["tolerance"]}
                yield CampaignTask(self.kind, job, {**labels, **way})

    @staticmethod
    def run(document: Mapping[str, Any]) -> Outcome:
        """Build and measure one setting; its times are costs, and no results."""
        found = measure_setting(document)
        runs = found["runs"]
        usual = next((run for run in runs if _WAY.items() <= run.items()), runs[0])
        times: dict[str, Value] = {name: usual[name] for name in _COSTS}
        for run in runs:
            way = f"{run['dtype']} {run['form']} {run['device']}"
            times |= {f"{way} {name}": run.pop(name) for name in _COSTS}
            del run["fronts"], run["take"]  # they are among all settings
        kept = ("error_max_thresholds", "error_p99_thresholds", "outside_share", "memory_bytes")
        row = {name: usual[name] for name in kept}
        return Outcome(row, {"runs.json": json_text(found)}, times)


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
    voltage_v: Annotated[tuple[NonNegativeFloat, ...], Field(min_length=1)]
    frequency_hz: Several

    def tasks(self) -> Iterator[CampaignTask]:
        """Yield a task for each finger on each screen."""
        for finger, screen, labels in self.pairs():
            yield CampaignTask(self.kind, self._document(finger, screen), labels)

    def _document(self, finger: Finger, screen: Screen) -> dict[str, Any]:
        return {
            "finger": finger.model_dump(mode="json", exclude_none=True),
            "screen": screen.model_dump(mode="json", exclude_none=True),
            "normal_force_n": list(self.normal_force_n),
            "voltage_v": list(self.voltage_v),
            "frequency_hz": list(self.frequency_hz),
        }

    @staticmethod
    def run(document: Mapping[str, Any]) -> Outcome:
        """Solve all states of one finger on one screen, or of one surface."""
        found = states_of(document)
        mu = found["mu"]
        row = {
            "mu_first": mu[0],
            "mu_last": mu[-1],
            "ratio": mu[-1] / mu[0],
            "area_first": found["area_fraction"][0],
            "area_last": found["area_fraction"][-1],
            "not_ok": sum(one != "OK" for one in found["status"]),
        }
        table = csv_text(found, zip(*found.values(), strict=True))
        return Outcome(row, {"states.csv": table})


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
        for finger, screen, labels in self.pairs():
            for number in range(self.seed, self.seed + self.surfaces):
                box = {**self.box.model_dump(), "surfaces": 1, "seed": number}
                document = {**self._document(finger, screen), "box": box}
                yield CampaignTask(self.kind, document, {**labels, "surface": number})

    @staticmethod
    def needed_bytes(document: Mapping[str, Any]) -> int:
        """Memory of one surface."""
        return estimated_bytes(document["box"]["points"], 1, coupled=True)
