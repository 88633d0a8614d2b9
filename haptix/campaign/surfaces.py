"""The kind "surfaces": a planned friction surface for every finger on every screen."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, Literal

from haptix.campaign.kinds import CampaignTask, Outcome
from haptix.campaign.people import ScenesOfPeople
from haptix.planning import plan_scene
from haptix.scene import Scene, plain_scene


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
