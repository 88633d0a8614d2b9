"""The kinds "population" and "boundary-elements": friction of people at some states."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from typing import Annotated, Any, Literal

from pydantic import Field, NonNegativeFloat, PositiveFloat, PositiveInt

from haptix.campaign.kinds import CampaignTask, Outcome
from haptix.campaign.people import PeopleOnScreens
from haptix.campaign.solving import states_of
from haptix.contact.boundary_elements import estimated_bytes
from haptix.documents import Part
from haptix.files import csv_text
from haptix.finger import Finger
from haptix.screen import Screen

Several = Annotated[tuple[PositiveFloat, ...], Field(min_length=1)]


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
        found = json.loads(states_of(json.dumps(document)))
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
