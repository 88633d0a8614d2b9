"""The kind "surfaces": a planned friction surface for every finger on every screen."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, Literal

from haptix.campaign.kinds import Outcome, Task
from haptix.campaign.people import PeopleOnScreens
from haptix.planning import plan_scene
from haptix.scene import Scene


class Surfaces(PeopleOnScreens):
    """A surface for every finger on every screen, as ``haptix build SCENE.toml`` makes it.

    Parameters
    ----------
    scene : mapping
        The fields of a `Scene` without finger, screen and name.
    """

    shown = ("mu_at_rest", "mu_span", "surface_bytes", "voltage_end_v")
    maps = (("seconds", "error_max"), ("mu_at_rest", "mu_span"))

    kind: Literal["surfaces"]
    scene: dict[str, Any]

    def tasks(self) -> Iterator[Task]:
        """Yield a task for each finger on each screen."""
        for finger, screen, labels in self.pairs():
            yield Task(self.kind, scene_document(self, finger, screen), labels)

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


def scene_document(plan: Any, finger: Any, screen: Any) -> dict[str, Any]:
    """Return the document of a scene with this finger and screen; it names no file.

    Textures and materials are left out, since no surface depends on them.
    """
    fields = {**plan.scene, "name": plan.name, "finger": finger, "screen": screen}
    scene = Scene(**fields, folder=plan.folder)
    return scene.model_dump(mode="json", exclude={"textures", "materials"}, exclude_none=True)
