"""How a set is made: file by file into drafts, checked as a whole, then published."""

from __future__ import annotations

import hashlib
import pickle
import shutil
from collections.abc import Callable
from contextlib import closing
from dataclasses import asdict, dataclass, replace
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import numpy as np

from haptix.base.errors import FileFormatError, InputError, LimitError, RangeError
from haptix.base.executors import executor_of, finished
from haptix.base.files import (
    digest,
    json_table,
    json_text,
    publish,
    read_json,
    reading,
    write_failure,
    write_whole,
)
from haptix.base.version import __version__
from haptix.feel.signals.audio_files import AudioWriter, file_hash, step_v
from haptix.lab.population import Population
from haptix.lab.stimuli.rendering import TOLERANCE, Apparatus, Rendering, Tally
from haptix.lab.stimuli.set_plan import SetPlan, Trigger, events, pulses
from haptix.lab.stimuli.sidecar import reach, sidecar
from haptix.lab.stimuli.stimulus import Stimulus, stimulus_from
from haptix.model.finger import Finger
from haptix.model.perception.sensation import SensationInTime
from haptix.model.screen import Screen
from haptix.play.devices import DriveWindow


def write_drive(
    path: Path,
    rendering: Rendering,
    plan: SetPlan,
    trigger: Trigger | None,
    threads: int,
    on_progress: Callable[[float], None],
) -> Tally:
    """Render into a file, and check every sample against the limits of the set.

    The file ends at the first limit that is broken, which `Tally.limits` names. An `OSError` states
    that the file cannot be written.
    """
    rate, limits = rendering.sample_rate_hz, plan.limits
    tally = Tally(SensationInTime(plan.perception, rate, rendering.skin))
    window = DriveWindow(limits, rate)
    previous, total = 0.0, rendering.samples
    form = plan.container, plan.encoding, rate, plan.full_scale_v
    with AudioWriter(path, *form, total, trigger is not None) as file:
        for block in rendering.stream(threads):
            drive = block.drive_v
            last = block.first + len(drive) == total
            try:
                limits.check(drive, previous, rate)
                window.check(drive)
                if last:  # past the end the output is at 0 V
                    limits.check(np.zeros(1), float(drive[-1]), rate)
            except LimitError as error:
                second = block.first / rate
                tally.limits.append(
                    f"within {len(drive) / rate:.3g} s from {second:.3f} s: {error}"
                )
                break
            window.take(drive)
            tally.take(block, rendering.response)
            file.write(drive, None if trigger is None else trigger.values(block.first, len(drive)))
            previous = float(drive[-1])
            on_progress((block.first + len(drive)) / total)
    return tally


DRAFTS = ".drafts"
"""Folder of finished files within that of the set."""


@dataclass(frozen=True)
class Made:
    """The result of one stimulus on one screen."""

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
    """A batch for a worker: some stimuli of a set on one screen."""

    plan: SetPlan
    screen: Screen
    folder: Path
    first: int
    """Place of its first stimulus in the whole set."""
    pulses: int
    """Of an onset's trigger, see `haptix.lab.stimuli.set_plan.pulses`."""


class SetFiles:
    """Files of a set for one screen.

    Parameters
    ----------
    plan : SetPlan
        The set, or some stimuli of it.
    screen : Screen
        One of its screens.
    folder : Path
        Where the set is published.
    pulses : int
        Of an onset's trigger.
    """

    def __init__(self, plan: SetPlan, screen: Screen, folder: Path, pulses: int) -> None:
        self.plan, self.screen, self.folder = plan, screen, folder
        self._perception = repr(plan.perception)
        self.drafts, self.pulses = folder / DRAFTS, pulses

    @classmethod
    def of(
        cls, plan: SetPlan, screen: Screen, folder: Path, on_progress: Callable[[float], None]
    ) -> SetFiles:
        """Return the files of a whole set, whose surfaces are in the cache then."""
        files = cls(plan, screen, folder, pulses(len(plan.stimuli)))
        for number, stimulus in enumerate(plan.stimuli, 1):
            files.apparatus(stimulus)
            on_progress(number / len(plan.stimuli))
        return files

    def apparatus(self, stimulus: Stimulus) -> Apparatus:
        """Apparatus of one stimulus: no other one changes its bytes."""
        return _apparatus(pickle.dumps((self.plan.finger, self.screen, self._ranges(stimulus))))

    def _ranges(self, stimulus: Stimulus) -> dict[str, Any]:
        return Apparatus.ranges(self.screen, [stimulus], self.plan.limits.ceiling_v)

    def batch(self, first: int, end: int) -> Batch:
        """Return a worker's inputs for the stimuli from number `first` to before `end`."""
        some = replace(self.plan, stimuli=self.plan.stimuli[first:end])
        return Batch(some, self.screen, self.folder, first, self.pulses)

    def make(
        self,
        index: int,
        stimulus: Stimulus,
        threads: int = 1,
        on_progress: Callable[[float], None] = lambda share: None,
    ) -> Made:
        """Make one file and its sidecar in the drafts, or find them there or published."""
        plan, apparatus = self.plan, self.apparatus(stimulus)
        name = plan.file_name(stimulus, self.screen)
        recipe = self._recipe(stimulus, index, apparatus)
        if (finished := self._finished(name, recipe)) is not None:
            return Made(finished, is_reused=True)
        response, each = apparatus.responses(stimulus)
        skin = apparatus.skin(stimulus)
        rendering = Rendering(stimulus, response, plan.sample_rate_hz, skin)
        if rendering.samples < 1:
            raise InputError(f"{stimulus.name}: expected one sample or more, got none")
        trigger = None
        if plan.trigger:
            trigger = Trigger(index + 1, rendering.samples, plan.sample_rate_hz, self.pulses)
        draft = self.drafts / f"{name}.part"
        try:
            tally = write_drive(draft, rendering, plan, trigger, threads, on_progress)
        except OSError:
            draft.unlink(missing_ok=True)  # finished files may need the space
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
            **sidecar(rendering, apparatus, each, tally, plan.perception),
            "surface_ranges": {key: list(ends) for key, ends in self._ranges(stimulus).items()},
            "sha256": file_hash(draft),
            "recipe_sha256": recipe,
        }
        draft.replace(self.drafts / name)
        text = json_table(table).encode()
        (self.drafts / beside(name)).write_bytes(text)
        unreachable = "" if tally.is_reached else reach(name, tally, response)
        return Made(table, (), unreachable, sidecar_sha256=hashlib.sha256(text).hexdigest())

    def _recipe(self, stimulus: Stimulus, index: int, apparatus: Apparatus) -> str:
        """Hash of everything that determines a file and its sidecar."""
        plan = self.plan
        return digest([
            __version__, stimulus.describe(), apparatus.surface_keys(),
            apparatus.profile_hash(), plan.sample_rate_hz, plan.container, plan.encoding,
            plan.full_scale_v, plan.limits.ceiling_v, plan.trigger and [index + 1, self.pulses],
            plan.name, TOLERANCE, self._perception,
        ])  # fmt: skip

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
    files = SetFiles(batch.plan, batch.screen, batch.folder, batch.pulses)
    return [
        files.make(batch.first + index, stimulus, threads)
        for index, stimulus in enumerate(batch.plan.stimuli)
    ]


@lru_cache(maxsize=64)
def _apparatus(pickled: bytes) -> Apparatus:
    """Surfaces of one touch, which a worker keeps for its next stimuli."""
    return Apparatus.over(*pickle.loads(pickled))


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
        from haptix.lab.stimuli.drawing import contact_sheet  # a missing extra raises at the start

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
            files = SetFiles.of(
                parts, screen, self.folder, partial(self.on_progress, "surface")
            )  # the surfaces, which a cache keeps
            apparatus = files.apparatus(parts.stimuli[0])
            self.profiles[apparatus.profile_hash()] = apparatus.profiles()
            made += self._all(files, len(made))
        limits = [line for entry in made for line in entry.limits]
        unreachable = [entry.unreachable for entry in made if entry.unreachable]
        if limits or (unreachable and parts.unreachable == "reject"):
            shutil.rmtree(self.drafts, ignore_errors=True)
            lines = "\n  ".join([*limits, *unreachable])
            head = f"set {parts.name!r} is rejected whole, nothing was written"
            if limits:
                raise LimitError(f"{head}:\n  {lines}")
            raise RangeError(
                f'{head}; lower what its stimuli ask for, or say unreachable = "nearest" to play '
                f"the nearest reachable friction:\n  {lines}"
            )
        reused = sum(entry.is_reused for entry in made)
        known = {
            beside(str(entry.table["file"])): entry.sidecar_sha256
            for entry in made
            if entry.sidecar_sha256
        }
        return self._publish([entry.table for entry in made], known, tables, reused)

    def _tables(self) -> dict[str, bytes]:
        """Trial tables and their descriptions, by their names."""
        parts, files_by_name = self.parts, {}
        for screen in parts.screens:
            files = [parts.file_name(stimulus, screen) for stimulus in parts.stimuli]
            table, columns = events(parts.stimuli, files, parts.trials)
            files_by_name[f"events{parts.suffix(screen)}.tsv"] = table.encode()
            files_by_name[f"events{parts.suffix(screen)}.json"] = json_text(columns).encode()
        return files_by_name

    def _check_tables(self, tables: dict[str, bytes]) -> None:
        """Refuse to replace a trial table to which somebody has added rows.

        Raises `InputError` if one in the folder is neither of this set nor in its manifest.
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
        made_by_first: dict[int, list[Made]] = {}
        so_far = done
        # A batch that has begun writes drafts: the call ends only after it.
        ends = finished(executor_of(self.executor), work, batches, until_idle=True)
        with closing(ends):
            for batch, future in ends:
                made_by_first[batch.first] = future.result()
                so_far += len(made_by_first[batch.first])
                self.on_progress("render", so_far / total)
        return [entry for first in sorted(made_by_first) for entry in made_by_first[first]]

    def _publish(
        self,
        sidecars: list[dict[str, Any]],
        known: dict[str, str],
        tables: dict[str, bytes],
        reused: int,
    ) -> SetResult:
        """Move everything into place; `known` has hashes of sidecars, by their names."""
        parts = self.parts
        self.on_progress("write", 0.0)
        files = [str(table["file"]) for table in sidecars]
        known = known | {str(table["file"]): str(table["sha256"]) for table in sidecars}
        # Finished files are drafts, or published by an earlier run.
        places = {
            name: next(path for path in (self.drafts / name, self.folder / name) if path.exists())
            for file in files
            for name in (file, beside(file))
        }
        others: dict[str, bytes] = {"profiles.json": json_text(self.profiles).encode(), **tables}
        drives = [places[name] for name in files]
        others["sheet.png"] = self.contact_sheet(parts.name, drives, sidecars)
        for name, data in others.items():
            places[name] = self.drafts / name
            places[name].write_bytes(data)
        manifest = {
            "haptix": __version__,
            "set": parts.name,
            "is_placeholder": any(table["is_placeholder"] for table in sidecars),
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
            # Without a manifest their set is unknown: a stop would leave them to be refused.
            (self.folder / name).unlink(missing_ok=True)
        drafts = {path: self.folder / path.name for path in places.values()}
        publish({path: target for path, target in drafts.items() if path != target})
        shutil.rmtree(self.drafts, ignore_errors=True)
        self.on_progress("write", 1.0)
        return SetResult(self.folder, tuple(sidecars), manifest, reused)


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
    if (folder / "dataset_description.json").exists():
        raise FileFormatError(
            f"{folder}: is a study, and not a set of stimuli; haptix stimuli analyse {folder} "
            "shows its sessions"
        )
    if not (folder / "manifest.json").exists():
        raise FileFormatError(
            f"{folder}: is not a set of stimuli, it has no manifest.json; name the folder that "
            "haptix stimuli make wrote"
        )
    return read_json(folder / "manifest.json", _MANIFEST_BYTES, _MANIFEST_VALUES)


def make_again(sidecar: str | Path, out: str | Path, threads: int = 1) -> Path:
    """Make the drive file that a sidecar describes, and check that it is the same.

    Of the set only the sidecar and ``profiles.json`` are read, and the files of recordings in the
    stimulus. The surfaces are built anew if the cache does not have them. Raises `FileFormatError`
    if a file is missing, or is no sidecar of a set; `InputError` if something is there, or the
    bytes differ: of another version of haptix, say.

    Parameters
    ----------
    sidecar : path-like
        JSON of a stimulus, beside the ``profiles.json`` of its set.
    out : path-like
        Drive file to write; nothing may be there.
    threads : int
        Threads; they change no byte.
    """
    sidecar, out = Path(sidecar), Path(out)
    if out.exists():
        raise InputError(f"{out}: is there already; name another file")
    table = read_json(sidecar)
    profiles = read_json(sidecar.with_name("profiles.json"))
    with reading(sidecar, "the sidecar of a stimulus, of this version"):
        plan, apparatus, trigger = _parts(table, profiles[table["profile_hash"]])
        stimulus = plan.stimuli[0]
        keys = apparatus.surface_keys()
        due, version = str(table["sha256"]), table["haptix"]
    response, _ = apparatus.responses(stimulus)
    rendering = Rendering(stimulus, response, plan.sample_rate_hz, apparatus.skin(stimulus))

    def write(draft: Path) -> None:
        write_drive(draft, rendering, plan, trigger, threads, lambda share: None)
        if file_hash(draft) != due:
            why = "its surfaces differ" if keys != table["surface_hash"] else "its samples differ"
            raise InputError(
                f"{sidecar}: cannot be made again by this haptix ({why}; made by {version})"
            )

    write_whole(out, write)
    return out


def _parts(
    table: dict[str, Any], profiles: dict[str, Any]
) -> tuple[SetPlan, Apparatus, Trigger | None]:
    """Set of one stimulus, its apparatus, and its trigger."""
    described = {key: value for key, value in table["stimulus"].items() if key != "name"}
    stimulus = stimulus_from(str(table["name"]), described)
    screen = Screen(**profiles["screen"])
    people = tuple(Finger(**fields) for fields in profiles["fingers"])
    finger = people[0] if len(people) == 1 else Population(people, str(table["fingers"]))
    plan = SetPlan(
        str(table["set"]), (stimulus,), finger, (screen,), float(table["sample_rate_hz"]),
        table["format"], table["encoding"], float(table["full_scale_v"]),
        float(table["ceiling_v"]), table["trigger"] is not None, "nearest",
    )  # fmt: skip
    ranges = {name: tuple(ends) for name, ends in table["surface_ranges"].items()}
    trigger = None
    if table["trigger"] is not None:
        code, codes = int(table["trigger"]["onset_code"]), table["trigger"].get("onset_codes", [0])
        trigger = Trigger(code, int(table["samples"]), plan.sample_rate_hz, len(codes))
    return plan, Apparatus.over(finger, screen, ranges), trigger
