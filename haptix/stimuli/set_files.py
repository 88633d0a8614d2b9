"""The files of a set, one by one or in batches: rendered, checked, and written as drafts."""

from __future__ import annotations

import hashlib
import json
import pickle
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

from haptix.errors import FileFormatError, InputError
from haptix.files import json_table, read_json
from haptix.screen import Screen
from haptix.signals.audio import file_hash, step_v
from haptix.stimuli.apparatus import TOLERANCE, Apparatus
from haptix.stimuli.rendering import Rendering, write_drive
from haptix.stimuli.set_plan import SetPlan
from haptix.stimuli.sidecar import reach, sidecar
from haptix.stimuli.stimulus import Stimulus
from haptix.stimuli.trials import Trigger, pulses
from haptix.version import __version__

DRAFTS = ".drafts"
"""Folder of finished files within that of the set."""


@dataclass(frozen=True)
class Made:
    """What became of one stimulus on one screen."""

    table: dict[str, Any]
    """Sidecar; empty where a limit is broken."""
    limits: tuple[str, ...] = ()
    unreachable: str = ""
    is_reused: bool = False
    """Whether an earlier run had finished it."""
    sidecar_sha256: str = ""
    """Hash of the sidecar's file, where it was written now."""


@dataclass(frozen=True)
class Batch:
    """Some stimuli of a set on one screen, as a worker gets them."""

    plan: SetPlan
    screen: Screen
    ranges: dict[str, Any]
    folder: Path
    first: int
    """Place of its first stimulus in the whole set."""
    pulses: int
    """Of an onset's trigger, see `haptix.stimuli.trials.pulses`."""


class SetFiles:
    """Files of a set for one screen.

    Parameters
    ----------
    plan : SetPlan
        The set, or some stimuli of it.
    screen : Screen
        One of its screens.
    ranges : mapping
        Of the surfaces, see `Apparatus.ranges`: those of the whole set.
    folder : Path
        Where the set is published.
    apparatus : Apparatus
        Over those ranges.
    pulses : int
        Of an onset's trigger.
    """

    def __init__(
        self,
        plan: SetPlan,
        screen: Screen,
        ranges: dict[str, Any],
        folder: Path,
        apparatus: Apparatus,
        pulses: int,
    ) -> None:
        self.plan, self.screen, self.ranges, self.folder = plan, screen, ranges, folder
        self._perception = repr(plan.perception)
        self.drafts, self.apparatus, self.pulses = folder / DRAFTS, apparatus, pulses

    @classmethod
    def of(cls, plan: SetPlan, screen: Screen, folder: Path) -> SetFiles:
        """Return the files of a whole set."""
        ranges = Apparatus.ranges(screen, plan.stimuli, plan.limits.ceiling_v)
        apparatus = Apparatus.over(plan.finger, screen, ranges)
        return cls(plan, screen, ranges, folder, apparatus, pulses(len(plan.stimuli)))

    def batch(self, first: int, end: int) -> Batch:
        """Return what a worker needs for the stimuli from number `first` to before `end`."""
        some = replace(self.plan, stimuli=self.plan.stimuli[first:end])
        return Batch(some, self.screen, self.ranges, self.folder, first, self.pulses)

    def make(
        self,
        index: int,
        stimulus: Stimulus,
        threads: int = 1,
        on_progress: Callable[[float], None] = lambda share: None,
    ) -> Made:
        """Make one file and its sidecar in the drafts, or find them there or published."""
        plan = self.plan
        name = plan.file_name(stimulus, self.screen)
        recipe = self._recipe(stimulus, index)
        if (finished := self._finished(name, recipe)) is not None:
            return Made(finished, is_reused=True)
        response, each = self.apparatus.responses(stimulus)
        rendering = Rendering(stimulus, response, plan.sample_rate_hz)
        if rendering.samples < 1:
            raise InputError(f"{stimulus.name}: expected one sample or more, got none")
        trigger = None
        if plan.trigger:
            trigger = Trigger(index + 1, rendering.samples, plan.sample_rate_hz, self.pulses)
        draft = self.drafts / f"{name}.part"
        try:
            tally = write_drive(draft, rendering, plan, trigger, threads, on_progress)
        except OSError:
            draft.unlink(missing_ok=True)  # what is finished may need the room
            raise
        if tally.limits:
            draft.unlink()
            return Made({}, tuple(f"{name}: {line}" for line in tally.limits))
        table = {
            "haptix": __version__,
            "file": name,
            "set": plan.name,
            "volts": "sample of channel 1, read as -1 to 1, times full_scale_v",
            "full_scale_v": plan.full_scale_v,
            "format": plan.container,
            "encoding": plan.encoding,
            "quantisation_step_v": step_v(plan.encoding, plan.full_scale_v, tally.peak_v),
            "ceiling_v": plan.limits.ceiling_v,
            "trigger": None if trigger is None else trigger.describe(),
            **sidecar(rendering, self.apparatus, each, tally, plan.perception),
            "surface_ranges": {key: list(ends) for key, ends in self.ranges.items()},
            "sha256": file_hash(draft),
            "recipe_sha256": recipe,
        }
        draft.replace(self.drafts / name)
        text = json_table(table).encode()
        (self.drafts / beside(name)).write_bytes(text)
        unreachable = "" if tally.is_reached else reach(name, tally, response)
        return Made(table, (), unreachable, sidecar_sha256=hashlib.sha256(text).hexdigest())

    def _recipe(self, stimulus: Stimulus, index: int) -> str:
        """Hash of everything that determines a file and its sidecar."""
        plan = self.plan
        text = json.dumps(
            [
                __version__, stimulus.describe(), self.apparatus.surface_keys(),
                self.apparatus.profile_hash(), plan.sample_rate_hz, plan.container, plan.encoding,
                plan.full_scale_v, plan.limits.ceiling_v, plan.trigger and [index + 1, self.pulses],
                plan.name, TOLERANCE, self._perception,
            ],
            sort_keys=True,
        )  # fmt: skip
        return hashlib.sha256(text.encode()).hexdigest()

    def _finished(self, name: str, recipe: str) -> dict[str, Any] | None:
        """Sidecar of a file that this recipe has made before, if both are whole."""
        for place in (self.drafts, self.folder):
            if not (place / beside(name)).exists():
                continue
            try:
                table = read_json(place / beside(name))
            except FileFormatError:
                continue
            made = table.get("recipe_sha256") == recipe and (place / name).is_file()
            if made and table.get("sha256") == file_hash(place / name):
                target = table.get("wanted") or {}
                if target.get("share_below_reach") or target.get("share_above_reach"):
                    continue  # rendered again, so that it is reported again
                return table
        return None


def beside(name: str) -> str:
    """Name of the sidecar of a file."""
    return f"{Path(name).stem}.json"


def make_batch(batch: Batch, threads: int = 1) -> list[Made]:
    """Make some files, in the process of a worker."""
    at = pickle.dumps((batch.plan.finger, batch.screen, batch.ranges))
    files = SetFiles(
        batch.plan, batch.screen, batch.ranges, batch.folder, _apparatus(at), batch.pulses
    )
    return [
        files.make(batch.first + index, stimulus, threads)
        for index, stimulus in enumerate(batch.plan.stimuli)
    ]


@lru_cache(maxsize=4)
def _apparatus(pickled: bytes) -> Apparatus:
    """Surfaces of a set, which a worker keeps for its next batch."""
    return Apparatus.over(*pickle.loads(pickled))
