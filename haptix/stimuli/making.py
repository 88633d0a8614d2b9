"""How a set is made: file by file into drafts, checked as a whole, then published."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from contextlib import closing
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

from haptix.errors import FileFormatError, InputError, LimitError, RangeError
from haptix.executors import executor_of, finished
from haptix.files import json_text, publish, read_json, reading, write_failure
from haptix.signals.audio import file_hash
from haptix.stimuli.set_files import DRAFTS, Made, SetFiles, beside, make_batch
from haptix.stimuli.set_plan import SetPlan
from haptix.stimuli.trials import events
from haptix.version import __version__

Progress = Callable[[str, float], None]

_BATCHES = 32  # of a set, so that workers of different speed end at about one time
_LARGEST_BATCH = 64
_MANIFEST_BYTES, _MANIFEST_VALUES = 64_000_000, 2_000_000  # of some 200,000 files


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

    def __init__(
        self,
        parts: SetPlan,
        folder: Path,
        threads: int,
        on_progress: Progress,
        executor: Any = None,
    ) -> None:
        from haptix.stimuli.drawing import contact_sheet  # a missing extra is said at the start

        self.contact_sheet = contact_sheet
        self.parts, self.folder, self.threads = parts, folder, threads
        self.drafts = folder / DRAFTS
        self.on_progress, self.executor = on_progress, executor
        self.profiles: dict[str, Any] = {}

    def run(self) -> SetResult:
        """See `StimulusSet.make`."""
        parts = self.parts
        if self.folder.exists() and not self.folder.is_dir():
            raise InputError(f"{self.folder} is a file; name a folder")
        tables = self._tables()
        self._check_tables(tables)
        self.drafts.mkdir(parents=True, exist_ok=True)
        made: list[Made] = []
        for screen in parts.screens:
            self.on_progress("surface", 0.0)
            files = SetFiles.of(parts, screen, self.folder)  # the surface, which a cache keeps
            self.on_progress("surface", 1.0)
            self.profiles[files.apparatus.profile_hash()] = files.apparatus.profiles()
            made += self._all(files, len(made))
        limits = [line for one in made for line in one.limits]
        unreachable = [one.unreachable for one in made if one.unreachable]
        if limits or (unreachable and parts.unreachable == "reject"):
            shutil.rmtree(self.drafts, ignore_errors=True)
            lines = "\n  ".join([*limits, *unreachable])
            head = f"set {parts.name!r} is rejected whole, nothing was written:\n  {lines}"
            if limits:
                raise LimitError(head)
            raise RangeError(
                f'{head}\nlower what they ask for, or say unreachable = "nearest" to play the '
                "nearest reachable friction"
            )
        reused = sum(one.is_reused for one in made)
        known = {
            beside(str(one.table["file"])): one.sidecar_sha256 for one in made if one.sidecar_sha256
        }
        return self._publish([one.table for one in made], known, tables, reused)

    def _tables(self) -> dict[str, bytes]:
        """Trial tables and their descriptions, by their names."""
        parts, found = self.parts, {}
        for screen in parts.screens:
            files = [parts.file_name(one, screen) for one in parts.stimuli]
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
            listed = read_manifest(self.folder)["files"]
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

    def _all(self, files: SetFiles, done: int) -> list[Made]:
        """Make the files of one screen, here or by the executor."""
        count, total = len(self.parts.stimuli), len(self.parts.stimuli) * len(self.parts.screens)
        if self.executor is None:
            made = []
            for index, stimulus in enumerate(self.parts.stimuli):
                at = done + index

                def tell(share: float, at: int = at) -> None:
                    self.on_progress("render", (at + share) / total)

                made.append(files.make(index, stimulus, self.threads, tell))
                self.on_progress("render", (at + 1) / total)
            return made
        size = min(_LARGEST_BATCH, max(1, count // _BATCHES))
        batches = (files.batch(first, first + size) for first in range(0, count, size))
        work = partial(make_batch, threads=self.threads)
        found: dict[int, list[Made]] = {}
        so_far = done
        # A batch that has begun writes drafts: the call ends only after it.
        ends = finished(executor_of(self.executor), work, batches, until_idle=True)
        with closing(ends):
            for batch, future in ends:
                found[batch.first] = future.result()
                so_far += len(found[batch.first])
                self.on_progress("render", so_far / total)
        return [one for first in sorted(found) for one in found[first]]

    def _publish(
        self,
        found: list[dict[str, Any]],
        known: dict[str, str],
        tables: dict[str, bytes],
        reused: int,
    ) -> SetResult:
        """Move everything into place; `known` has hashes of sidecars, by their names."""
        parts = self.parts
        self.on_progress("write", 0.0)
        files = [str(table["file"]) for table in found]
        known = known | {str(table["file"]): str(table["sha256"]) for table in found}
        # Finished files are drafts, or published by an earlier run.
        places = {
            name: next(path for path in (self.drafts / name, self.folder / name) if path.exists())
            for one in files
            for name in (one, beside(one))
        }
        others: dict[str, bytes] = {"profiles.json": json_text(self.profiles).encode(), **tables}
        drives = [places[name] for name in files]
        others["sheet.png"] = self.contact_sheet(parts.name, drives, found)
        for name, data in others.items():
            places[name] = self.drafts / name
            places[name].write_bytes(data)
        manifest = {
            "haptix": __version__,
            "set": parts.name,
            "is_placeholder": any(table["is_placeholder"] for table in found),
            "trials": asdict(parts.trials),
            "files": {
                name: {
                    "sha256": known.get(name) or file_hash(places[name]),
                    "bytes": places[name].stat().st_size,
                }
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
        return SetResult(self.folder, tuple(found), manifest, reused)


class StimulusSet(SetPlan):
    """Stimuli that belong together; the parameters are those of `SetPlan`."""

    def make(
        self,
        folder: str | Path,
        threads: int = 2,
        on_progress: Progress = lambda stage, share: None,
        executor: Any = None,
    ) -> SetResult:
        """Render all stimuli, check the whole set, and publish it in a folder.

        Finished files wait in ``.drafts`` within the folder. If the disk fills up or the run is
        stopped, the same call continues from there.

        Parameters
        ----------
        folder : path-like
            Where the set is written.
        threads : int
            Threads that render one file; they pay for stimuli of many seconds.
        on_progress : callable
            Called with a stage and the share of it that is done.
        executor : concurrent.futures.Executor or Dask client, optional
            Makes files at the same time, in batches: threads, processes, or a cluster whose
            workers share `folder` and the cache of surfaces.
            The bytes do not depend on it. It stays open.

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
        job = MakingJob(self, Path(folder), threads, on_progress, executor)
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
    table = read_manifest(folder)
    with reading(folder / "manifest.json", "the manifest of a set"):
        return [
            name
            for name, entry in table["files"].items()
            if not (folder / name).is_file() or file_hash(folder / name) != entry["sha256"]
        ]


def read_manifest(folder: Path) -> dict[str, Any]:
    """Read the manifest of a finished folder, or raise `FileFormatError`."""
    return read_json(folder / "manifest.json", _MANIFEST_BYTES, _MANIFEST_VALUES)
