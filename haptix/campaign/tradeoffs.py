"""The kind "trade-off": every way to build the surface of every finger on every screen."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from typing import Any, Literal

from haptix.campaign.kinds import CampaignTask, Outcome, Value
from haptix.campaign.people import ScenesOfPeople
from haptix.files import json_text
from haptix.tradeoff.run import measure_setting, setting_jobs

_COSTS = ("build_s", "query_s_per_million", "invert_s_per_million")
# Of a float32 surface, for the table; the file has all ways to ask it.
_WAY = {"dtype": "float32", "form": "surface", "device": "cpu"}


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
        found = json.loads(measure_setting(json.dumps(document)))
        runs = found["runs"]
        usual = next((run for run in runs if _WAY.items() <= run.items()), runs[0])
        times: dict[str, Value] = {name: usual[name] for name in _COSTS}
        for run in runs:
            way = f"{run['dtype']} {run['form']} {run['device']}"
            times |= {f"{way} {name}": run.pop(name) for name in _COSTS}
            del run["fronts"]  # they rest on times
        kept = ("error_max_thresholds", "error_p99_thresholds", "outside_share", "memory_bytes")
        row = {name: usual[name] for name in kept}
        return Outcome(row, {"runs.json": json_text(found)}, times)
