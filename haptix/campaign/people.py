"""Who touches what: the fingers and the screens of a campaign, each pair with its labels."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Any

from pydantic import Field, PositiveFloat

from haptix.campaign.kinds import Campaign, Value
from haptix.campaign.population import DrawnPeople, Population
from haptix.finger import Finger
from haptix.scene import Scene
from haptix.screen import Screen


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
