"""How a set is made: file by file into drafts, checked as a whole, then published."""

from __future__ import annotations

import hashlib
import json
import shutil
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from haptix.errors import FileFormatError, InputError, LimitError, RangeError
from haptix.files import json_text, publish, read_json, reading, write_failure
from haptix.screen import Screen
from haptix.signals.audio import file_hash, step_v
from haptix.stimuli.apparatus import TOLERANCE, Apparatus
from haptix.stimuli.drawing import contact_sheet
from haptix.stimuli.rendering import Rendering, write_drive
from haptix.stimuli.set_plan import SetPlan
from haptix.stimuli.sidecar import reach, sidecar
from haptix.stimuli.stimulus import Stimulus
from haptix.stimuli.trials import Trigger, events, trigger_code
from haptix.version import __version__

Progress = Callable[[str, float], None]

_DRAFTS = ".drafts"


@dataclass(frozen=True)
class SetResult:
    """A finished set."""

    folder: Path
    sidecars: tuple[dict[str, Any], ...]
    manifest: dict[str, Any]
    reused: int
    """Files that an earlier run had finished."""


class MakingJob:
    """One run of `StimulusSet.make`: it makes, checks and publishes."""

    def __init__(self, parts: SetPlan, folder: Path, threads: int, on_progress: Progress) -> None:
        self.parts, self.folder, self.threads = parts, folder, threads
        self.drafts = folder / _DRAFTS
        self.on_progress = on_progress
        self.reused = 0
        self.profiles: dict[str, Any] = {}
        self.limits: list[str] = []
        self.unreachable: list[str] = []

    def run(self) -> SetResult:
        """See `StimulusSet.make`."""
        parts = self.parts
        if self.folder.exists() and not self.folder.is_dir():
            raise InputError(f"{self.folder} is a file; name a folder")
        tables = self._tables()
        self._check_tables(tables)
        self.drafts.mkdir(parents=True, exist_ok=True)
        found: list[dict[str, Any]] = []
        total = len(parts.screens) * len(parts.stimuli)
        for screen in parts.screens:
            self.on_progress("surface", 0.0)
            apparatus = parts.apparatus(screen)
            self.on_progress("surface", 1.0)
            self.profiles[apparatus.profile_hash()] = apparatus.profiles()
            for index, stimulus in enumerate(parts.stimuli):
                found.append(self._one(apparatus, stimulus, index, len(found), total))
        if self.limits or (self.unreachable and parts.unreachable == "reject"):
            shutil.rmtree(self.drafts, ignore_errors=True)
            lines = "\n  ".join([*self.limits, *self.unreachable])
            head = f"set {parts.name!r} is rejected whole, nothing was written:\n  {lines}"
            if self.limits:
                raise LimitError(head)
            raise RangeError(
                f'{head}\nlower what they ask for, or say unreachable = "nearest" to play the '
                "nearest reachable friction"
            )
        return self._publish(found, tables)

    def _name(self, stimulus: Stimulus, screen: Screen) -> str:
        """Name of a drive file."""
        return f"{stimulus.name}{self.parts.suffix(screen)}.{self.parts.container}"

    def _tables(self) -> dict[str, bytes]:
        """Trial tables and their descriptions, by their names."""
        parts, found = self.parts, {}
        for screen in parts.screens:
            files = [self._name(one, screen) for one in parts.stimuli]
            table, columns = events(parts.stimuli, files, parts.trials)
            found[f"events{parts.suffix(screen)}.tsv"] = table.encode()
            found[f"events{parts.suffix(screen)}.json"] = json_text(columns).encode()
        return found

    def _check_tables(self, tables: dict[str, bytes]) -> None:
        """Refuse to replace a trial table that somebody has added to.

        Raises
        ------
        InputError
            If one in the folder is neither what this set has, nor what its manifest lists.
        """
        try:
            listed = read_json(self.folder / "manifest.json")["files"]
        except (FileFormatError, KeyError):
            listed = {}
        for name, table in tables.items():
            path = self.folder / name
            if not path.exists() or path.read_bytes() == table:
                continue
            if listed.get(name, {}).get("sha256") != file_hash(path):
                raise InputError(
                    f"{path}: was changed since it was made, and is not replaced; move it away, or "
                    "name another folder"
                )

    def _one(
        self, apparatus: Apparatus, stimulus: Stimulus, index: int, done: int, total: int
    ) -> dict[str, Any]:
        """Make one file and its sidecar in the drafts, or find them there or published."""
        parts = self.parts
        name = self._name(stimulus, apparatus.screen)
        recipe = self._recipe(apparatus, stimulus, index)
        if (finished := self._finished(name, recipe)) is not None:
            self.reused += 1
            self.on_progress("render", (done + 1) / total)
            return finished
        response, each = apparatus.responses(stimulus)
        rendering = Rendering(stimulus, response, parts.sample_rate_hz)
        if rendering.samples < 1:
            raise InputError(f"{stimulus.name}: expected one sample or more, got none")
        trigger = None
        if parts.trigger:
            trigger = Trigger(trigger_code(index), rendering.samples, parts.sample_rate_hz)
        draft = self.drafts / f"{name}.part"
        try:
            tally = write_drive(
                draft, rendering, parts, trigger, self.threads,
                lambda share: self.on_progress("render", (done + share) / total),
            )  # fmt: skip
        except OSError:
            draft.unlink(missing_ok=True)  # what is finished may need the room
            raise
        if tally.limits:
            self.limits += [f"{name}: {line}" for line in tally.limits]
            draft.unlink()
            return {}
        if not tally.is_reached:
            self.unreachable.append(reach(name, tally, response))
        table = {
            "haptix": __version__,
            "file": name,
            "set": parts.name,
            "volts": "sample of channel 1, read as -1 to 1, times full_scale_v",
            "full_scale_v": parts.full_scale_v,
            "format": parts.container,
            "encoding": parts.encoding,
            "quantisation_step_v": step_v(parts.encoding, parts.full_scale_v, tally.peak_v),
            "ceiling_v": parts.limits.ceiling_v,
            "trigger": None if trigger is None else trigger.describe(),
            **sidecar(rendering, apparatus, each, tally, parts.perception),
            "sha256": file_hash(draft),
            "recipe_sha256": recipe,
        }
        draft.replace(self.drafts / name)
        (self.drafts / _beside(name)).write_text(json_text(table), encoding="utf-8")
        return table

    def _recipe(self, apparatus: Apparatus, stimulus: Stimulus, index: int) -> str:
        """Hash of everything that determines a file and its sidecar."""
        parts = self.parts
        text = json.dumps(
            [
                __version__, stimulus.describe(), apparatus.surface_keys(),
                apparatus.profile_hash(), parts.sample_rate_hz, parts.container, parts.encoding,
                parts.full_scale_v, parts.limits.ceiling_v, parts.trigger and trigger_code(index),
                parts.name, TOLERANCE, repr(parts.perception),
            ],
            sort_keys=True,
        )  # fmt: skip
        return hashlib.sha256(text.encode()).hexdigest()

    def _finished(self, name: str, recipe: str) -> dict[str, Any] | None:
        """Sidecar of a file that this recipe has made before, if both are whole."""
        for place in (self.drafts, self.folder):
            try:
                table = read_json(place / _beside(name))
            except FileFormatError:
                continue
            made = table.get("recipe_sha256") == recipe and (place / name).is_file()
            if made and table.get("sha256") == file_hash(place / name):
                target = table.get("wanted") or {}
                if target.get("share_below_reach") or target.get("share_above_reach"):
                    continue  # rendered again, so that it is reported again
                return table
        return None

    def _publish(self, found: list[dict[str, Any]], tables: dict[str, bytes]) -> SetResult:
        parts = self.parts
        self.on_progress("write", 0.0)
        files = [str(table["file"]) for table in found]
        # Finished files are drafts, or published by an earlier run.
        places = {
            name: next(path for path in (self.drafts / name, self.folder / name) if path.exists())
            for one in files
            for name in (one, _beside(one))
        }
        others: dict[str, bytes] = {"profiles.json": json_text(self.profiles).encode(), **tables}
        others["sheet.png"] = contact_sheet(parts.name, [places[name] for name in files], found)
        for name, data in others.items():
            places[name] = self.drafts / name
            places[name].write_bytes(data)
        manifest = {
            "haptix": __version__,
            "set": parts.name,
            "is_placeholder": any(table["is_placeholder"] for table in found),
            "trials": asdict(parts.trials),
            "files": {
                name: {"sha256": file_hash(places[name]), "bytes": places[name].stat().st_size}
                for name in sorted(places)
            },
        }
        places["manifest.json"] = self.drafts / "manifest.json"
        places["manifest.json"].write_text(json_text(manifest), encoding="utf-8")
        self._check_tables(tables)  # rendering may have taken an hour
        for name in tables:
            # Without a manifest nothing says whose they are: a stop would leave them to be refused.
            (self.folder / name).unlink(missing_ok=True)
        drafts = {path: self.folder / path.name for path in places.values()}
        publish({path: target for path, target in drafts.items() if path != target})
        shutil.rmtree(self.drafts, ignore_errors=True)
        self.on_progress("write", 1.0)
        return SetResult(self.folder, tuple(found), manifest, self.reused)


class StimulusSet(SetPlan):
    """Stimuli that belong together; the parameters are those of `SetPlan`."""

    def make(
        self,
        folder: str | Path,
        threads: int = 2,
        on_progress: Progress = lambda stage, share: None,
    ) -> SetResult:
        """Render all stimuli, check the whole set, and publish it in a folder.

        Finished files wait in ``.drafts`` within the folder. If the disk fills up or the run is
        stopped, the same call continues from there.

        Raises
        ------
        LimitError
            If any stimulus breaks a limit; nothing is published then.
        RangeError
            If any asks for friction outside the reachable range, unless `unreachable` is "nearest";
            the message has a line for each, with the nearest reachable friction.
        InputError
            If the folder cannot be written.
        """
        job = MakingJob(self, Path(folder), threads, on_progress)
        try:
            return job.run()
        except OSError as error:
            why = write_failure(error, Path(folder))
            raise InputError(
                f"cannot write to {folder}: {why}; no unfinished file has its final name, and the "
                "same command continues where this one stopped"
            ) from None


def check_manifest(folder: str | Path) -> list[str]:
    """Names of files in a finished folder that are missing or differ from its manifest.

    Raises
    ------
    FileFormatError
        If there is no manifest.
    """
    folder = Path(folder)
    table = read_json(folder / "manifest.json")
    with reading(folder / "manifest.json", "the manifest of a set"):
        return [
            name
            for name, entry in table["files"].items()
            if not (folder / name).is_file() or file_hash(folder / name) != entry["sha256"]
        ]


def _beside(name: str) -> str:
    return f"{Path(name).stem}.json"
