"""Logs of trials and of touches: on the disk as soon as each is over, and read again."""

from __future__ import annotations

import csv
import errno
import hashlib
import io
import json
import os
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import astuple, dataclass, replace
from datetime import UTC, datetime
from itertools import pairwise
from pathlib import Path
from typing import Any

from filelock import FileLock, Timeout
from pydantic import BaseModel, ConfigDict, NonNegativeInt

from haptix.base.errors import FileFormatError, InputError
from haptix.base.files import (
    LARGEST_TABLE_BYTES,
    digest,
    json_text,
    parse_json,
    place,
    read_bytes,
    read_json,
    read_text,
    reading,
    write_failure,
    write_whole,
)
from haptix.base.version import __version__, code_digest
from haptix.play.render.intervals import TouchSample

COLUMNS = (
    "trial", "attempt", "time_s", "level_asked", "level", "lowered_to_ceiling", "right", "answer",
    "is_right", "normal_force_n", "speed_mm_per_s", "accepted", "why", "session", "onset_s",
    "reaction_s", "date", "version", "device", "profile", "kind", "condition", "other_level",
    "source", "before",
)  # fmt: skip
"""Columns of the table, in their order."""

_FORMAT = 3
_RESTED_MIN = 10.0  # after a stop; a person who goes on does so sooner

_TRIALS_DEPEND_ON = (
    "firmware_io", "haptix/base", "haptix/model", "haptix/feel", "haptix/play", "haptix/lab",
)  # fmt: skip
"""Folders that make, present and count a trial. All others may change during a study."""


def program() -> str:
    """Version of haptix, and a hash of the code that makes and counts trials."""
    return f"{__version__}+{code_digest(*_TRIALS_DEPEND_ON)[:12]}"


class End(BaseModel):
    """The file beside a log, by which a missing tail is found.

    It is written after each row, so it is one row behind at most.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    rows: NonNegativeInt
    last: str
    """Hash of the last row; of the head, where there is none."""
    finished: bool
    """Whether the session is over."""

    @staticmethod
    def place(log: Path) -> Path:
        """Return where it lies."""
        return log.with_name(f"{log.stem}_end.json")

    @classmethod
    def of(cls, log: Path) -> End | None:
        """Read that of a log; None if there is none."""
        path = cls.place(log)
        if not path.exists():
            return None
        table = read_json(path)
        with reading(path, "rows, last and finished"):
            return cls(**table)


@dataclass(frozen=True)
class LogText:
    """The content of a log."""

    settings: dict[str, Any]
    """Its first line."""
    rows: list[dict[str, str]]
    last: str
    """Hash of the last line."""
    size: int
    """Bytes up to the last line that is whole."""
    finished: bool = False
    remarks: tuple[str, ...] = ()
    """What it leaves open."""


def parse_log(path: Path, data: bytes, end: End | None) -> LogText:
    """Check a log against its hashes and its end file, and return its content.

    Each row has the hash of the line before, the first row that of the head. A last line that was
    cut off while it was written is ignored.

    Raises
    ------
    FileFormatError
        If it is no log, a row was edited, added, taken out or moved, or rows are missing at its
        end. The first row that is wrong is named.
    """
    whole = data[: data.rfind(b"\n") + 1]
    try:
        head, names, *lines = [
            line.removesuffix("\r") for line in whole.decode("utf-8-sig").split("\n")[:-1]
        ]
        settings = parse_json(head.removeprefix("# ")) if head.startswith("# ") else None
    except ValueError:
        settings = None
    if not isinstance(settings, dict) or "method" not in settings:
        raise FileFormatError(f"{path}: is not a log of trials, and stays as it is")
    if settings.get("format") != _FORMAT or tuple(names.split("\t")) != COLUMNS:
        raise FileFormatError(f"{path}: is a log of another version of haptix; name a new file")
    restore = "restore the log as it was written"
    rows, last = list[dict[str, str]](), line_hash(f"{head}\n{names}")
    for number, line in enumerate(lines, 1):
        cells = line.split("\t")
        if len(cells) != len(COLUMNS):
            raise FileFormatError(
                f"{path}: row {number}: expected {len(COLUMNS)} columns, got {len(cells)}; "
                f"{restore}"
            )
        row = dict(zip(COLUMNS, cells, strict=True))
        if row["before"] != last:
            raise FileFormatError(
                f"{path}: row {number} (trial {row['trial']}) does not follow the line before it: "
                f"one of them was edited, moved, added or taken out; {restore}"
            )
        rows.append(row)
        last = line_hash(line)
    return _checked_by(end, LogText(settings, rows, last, len(whole)), path)


def _checked_by(end: End | None, log: LogText, path: Path) -> LogText:
    place, count = End.place(path), len(log.rows)
    if end is None:
        remark = f"{path}: whether rows at its end are missing is not known without {place}"
        return replace(log, remarks=(remark,))
    if count < end.rows:
        raise FileFormatError(
            f"{path}: has {count} rows, and {place} has {end.rows}: its end was cut off; restore "
            "the log as it was written"
        )
    # The line at which the end was written: the one after it has its hash.
    at = log.last if count == end.rows else log.rows[end.rows]["before"]
    if at != end.last or count > end.rows + (not end.finished):
        raise FileFormatError(
            f"{path}: {place} is of other rows than its {count}; restore both as they were written"
        )
    return replace(log, finished=end.finished)


def line_hash(line: str) -> str:
    """Return the hash of a line, which the next line repeats."""
    return hashlib.sha256(line.encode()).hexdigest()[:16]


class TrialLog:
    """A tab-separated table with a line per trial, on the disk before the next trial begins.

    Its first line describes the experiment. An existing log is continued, and only by the
    same `experiment`. A file that is no log is never written to. A last line that was cut off
    while it was written is dropped. From `open` to `close` a lock keeps other writers away.

    Parameters
    ----------
    path : path
        The table; beside it lie ``NAME_end.json`` (see `End`) and a file ``.NAME.lock``.
    experiment : mapping
        Settings and hashes, as plain values.
    """

    def __init__(self, path: str | Path, experiment: Mapping[str, Any]) -> None:
        self.path = Path(path)
        self._lock = FileLock(
            self.path.with_name(f".{self.path.name}.lock"), timeout=0, thread_local=False
        )
        self._experiment = json.loads(json.dumps(experiment))
        self.rows: list[dict[str, str]] = []
        self.version = program()
        """The program that wrote the last line; the head, where there is none yet."""
        self.finished = False
        """Whether the session is over, by its end file."""
        self._size = -1
        self._last = ""
        self.open()

    def open(self) -> None:
        """Lock the log, and read it again if it has changed since.

        Raises
        ------
        InputError
            If another process, or another experiment of this one, writes it.
        FileFormatError
            If it is no log, that of another experiment, or was changed (see `parse_log`).
        """
        if self._lock.is_locked:
            return
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            self._lock.acquire()
        except Timeout:
            raise InputError(
                f"{self.path}: another experiment is writing this log; end that one, or name "
                "another file"
            ) from None
        except OSError as error:
            raise InputError(f"cannot use {self.path} as a log: {error.strerror}") from None
        try:
            self._read_file()
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Let others write it."""
        self._lock.release()

    def go_on(self) -> None:
        """Let this program write a log that another began; its rows say so in ``version``."""
        self.version = program()

    def _read_file(self) -> None:
        known = b""
        try:
            if place(self.path)[1] is not None:
                known = read_bytes(self.path, LARGEST_TABLE_BYTES)
        except OSError as error:
            raise InputError(f"cannot use {self.path} as a log: {error.strerror}") from None
        if self._size >= 0 and len(known) != self._size:
            raise _changed(self.path)
        if self._size >= 0:
            return
        end = End.of(self.path)
        if not known and end is not None and end.rows:
            raise FileFormatError(
                f"{self.path}: is gone or empty, and {End.place(self.path)} states that it had "
                f"{end.rows} rows; restore it, or name a new file"
            )
        if not known:  # an empty file holds nothing to lose
            self._begin()
            return
        log = parse_log(self.path, known, end)
        head = dict(log.settings)
        self.version = str(head.pop("version", ""))
        del head["format"]
        then, now = _flat(head), _flat(self._experiment)
        # Another program may know more settings.
        names = set(then) | (set(now) if self.version == program() else set())
        if different := sorted(name for name in names if then.get(name) != now.get(name)):
            raise FileFormatError(
                f"{self.path}: is the log of another experiment, or of other settings: "
                f"{', '.join(different)}; name a new file, or restore them"
            )
        if end is None:
            raise FileFormatError(
                f"{self.path}: expected {End.place(self.path)} beside it, which states whether "
                "rows are missing at its end; restore it"
            )
        self.rows = log.rows
        if self.rows:
            self.version = self.rows[-1]["version"]
        self._size, self._last, self.finished = log.size, log.last, log.finished
        if log.size != len(known):
            with self.path.open("r+b") as file:
                file.truncate(log.size)
                os.fsync(file.fileno())
        # Where it was stopped between the two.
        if end.rows < len(self.rows):
            self._write_end(len(self.rows), self._last)

    def append(self, row: Mapping[str, Any]) -> None:
        """Write one trial, and wait until the disk has it.

        Raises
        ------
        InputError
            If it cannot be written; the experiment must stop then.
        """
        cells = [cell({**row, "before": self._last}.get(name)) for name in COLUMNS]
        text = "\t".join(cells)
        line = f"{text}\n".encode()
        try:
            # Never makes a file that somebody took away; nothing waits in a buffer.
            with self.path.open("r+b", buffering=0) as file:
                if file.seek(0, os.SEEK_END) != self._size:
                    raise _changed(self.path)
                try:
                    if file.write(line) != len(line):
                        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
                    os.fsync(file.fileno())
                except OSError:
                    with suppress(OSError):
                        file.truncate(self._size)
                    raise
        except OSError as error:
            raise InputError(
                f"cannot write trial {row['trial']} to {self.path}: "
                f"{write_failure(error, self.path)}; start again: the run continues from its log"
            ) from None
        self._size += len(line)
        self._last = line_hash(text)
        self.rows.append(dict(zip(COLUMNS, cells, strict=True)))
        self._write_end(len(self.rows), self._last)

    def finish(self) -> None:
        """Mark the session as finished."""
        if not self.finished:
            self._write_end(len(self.rows), self._last, finished=True)
            self.finished = True

    def resumed(self, now_s: float) -> tuple[int, float]:
        """Return this session's number, and the log's clock [s] at its start.

        A resumed log goes on after its last trial, by as much as has passed since.
        """
        if not self.rows:
            return 1, now_s
        last = self.rows[-1]
        return int(last["session"]) + 1, now_s - float(last["time_s"]) - self.rested_s

    @property
    def rested_s(self) -> float:
        """Time since the last trial; 0 where there is none."""
        if not self.rows:
            return 0.0
        last = datetime.fromisoformat(self.rows[-1]["date"])
        return max(0.0, (datetime.now(UTC) - last).total_seconds())

    def _begin(self) -> None:
        """Write the head, the end file first: alone it has no effect."""
        head = {"format": _FORMAT, "version": program(), **self._experiment}
        text = f"# {json.dumps(head)}\n" + "\t".join(COLUMNS)
        self._last = line_hash(text)
        self._write_end(0, self._last)
        write_whole(self.path, f"{text}\n")
        self._size = len(text.encode()) + 1

    def _write_end(self, rows: int, last: str, finished: bool = False) -> None:
        end = End(rows=rows, last=last, finished=finished)
        write_whole(End.place(self.path), json_text(end.model_dump()))


def _changed(path: Path) -> InputError:
    return InputError(f"{path}: was changed meanwhile; start again to continue from it")


def _flat(table: Mapping[str, Any], before: str = "") -> dict[str, Any]:
    """Values by dotted names."""
    flat: dict[str, Any] = {}
    for name, value in table.items():
        inner = isinstance(value, dict) and value
        flat |= _flat(value, f"{before}{name}.") if inner else {f"{before}{name}": value}
    return flat


def cell(value: Any) -> str:
    """Return a value as a log has it."""
    if value is None or value == "":
        return "n/a"
    return str(value).lower() if isinstance(value, bool) else " ".join(str(value).split())


TOUCH_COLUMNS = (
    "session", "trial", "attempt", "t_s", "x_mm", "y_mm", "normal_force_n", "contact", "phase",
)  # fmt: skip
"""Columns of the table; `t_s` is on the time of the log."""

_TOUCH_HEAD = "\t".join(TOUCH_COLUMNS) + "\n"


class TouchLog:
    """A table of touches, which is on the disk before the row of their trial is.

    A trial that was stopped before its answer leaves touches without a row; its repetition is of
    another session.

    Parameters
    ----------
    log : path
        Of the trials; the table is ``NAME_touches.tsv`` beside it, made with the first touch.
    """

    def __init__(self, log: Path) -> None:
        self.path = log.with_name(f"{log.stem}_touches.tsv")
        self._is_checked = False

    def append(
        self, session: int, trial: int, attempt: int, samples: Sequence[TouchSample]
    ) -> None:
        """Write the touches of a trial, and wait until the disk has them.

        Raises `FileFormatError` if the file there is no table of touches; it stays as it is;
        `InputError` if it cannot be written.
        """
        if not samples:
            return
        place = (session, trial, attempt)
        text = "".join(
            "\t".join("n/a" if cell is None else str(cell) for cell in (*place, *astuple(sample)))
            + "\n"
            for sample in samples
        )
        try:
            if not self._is_checked:
                text = self._check() + text
                self._is_checked = True
            with self.path.open("ab", buffering=0) as file:
                file.write(text.encode())
                os.fsync(file.fileno())
        except OSError as error:
            raise InputError(
                f"cannot write touches to {self.path}: {write_failure(error, self.path)}"
            ) from None

    def _check(self) -> str:
        """Return the head if there is no table yet; cut off a line that was not finished."""
        file_stat = place(self.path)[1]
        if file_stat is None or not file_stat.st_size:
            return _TOUCH_HEAD
        with self.path.open("r+b") as file:
            known = file.read(LARGEST_TABLE_BYTES)
            if not known.startswith(_TOUCH_HEAD.encode()):
                raise FileFormatError(f"{self.path}: is no table of touches, and stays as it is")
            if not known.endswith(b"\n"):
                file.truncate(known.rfind(b"\n") + 1)
        return ""

    def rows(self) -> Iterator[dict[str, str]]:
        """Yield the complete rows; none if no panel has reported."""
        if not self.path.exists():
            return
        head, *lines = read_text(self.path, LARGEST_TABLE_BYTES).splitlines(keepends=True)
        if head != _TOUCH_HEAD:
            raise FileFormatError(f"{self.path}: is no table of touches")
        for line in lines:
            cells = line.rstrip("\n").split("\t")
            if line.endswith("\n") and len(cells) == len(TOUCH_COLUMNS):
                yield dict(zip(TOUCH_COLUMNS, cells, strict=True))


SETTINGS = "Experiment"
"""Key of a ``*_beh.json`` under which the head of the log is."""

_NAME = re.compile(r"sub-([A-Za-z0-9]+)_ses-([A-Za-z0-9]+)_task-([A-Za-z0-9]+)_(?:log|beh)\.tsv")


@dataclass(frozen=True)
class LoggedSession:
    """A session of one participant."""

    participant: str
    session: str
    task: str
    """Labels; a log outside of a study has its file's name as participant."""
    path: Path
    """The file that it was read from."""
    settings: Mapping[str, Any]
    """Head of the log: method, task, seed, hashes, plan."""
    rows: tuple[Mapping[str, str], ...]
    """Attempts, by the columns of the log."""
    finished: bool = False
    """Whether the session is over, by its log."""
    remarks: tuple[str, ...] = ()
    """What of the log could not be checked."""

    @property
    def source(self) -> str:
        """Source of the answers."""
        return str(self.settings.get("source", "n/a"))

    @property
    def name(self) -> str:
        """Participant and session, for people."""
        return f"{self.participant}, session {self.session}" if self.session else self.participant


def read_sessions(source: str | Path) -> list[LoggedSession]:
    """Read the sessions of a log, of a folder of logs, or of a study.

    Of a study the logs in ``sourcedata`` are read. A study without them, such as one that was
    passed on, is read from its ``*_beh.tsv``. Copies of a log, also those of its beginning, are
    one; the remarks name them. Raises `FileFormatError` if a file is no log of trials; `InputError`
    if there is none, a session goes on in two ways in two logs, or two logs of one experiment have
    one name.
    """
    source = Path(source)
    if not source.is_dir():
        return [read_log(source)]
    if (source / "dataset_description.json").exists():
        by_labels: dict[tuple[str, ...], LoggedSession] = {}
        for path in sorted(source.glob("sub-*/**/*_beh.tsv")):
            session = _read_beh(path)
            by_labels[session.participant, session.session, session.task] = session
        for path in sorted(source.glob("sourcedata/sub-*/**/*_log.tsv")):
            session = read_log(path)
            by_labels[session.participant, session.session, session.task] = session
        sessions = [by_labels[key] for key in sorted(by_labels)]
    else:
        # A log may have any name; those of the service's page end in .csv.
        files = sorted(path for path in source.rglob("*") if path.is_file())
        logs = (path for path in files if is_log(path))
        sessions = [read_log(path) for path in logs]
    if not sessions:
        raise InputError(f"{source}: has no log of trials; name a log, or the folder of a study")
    sessions = _without_copies(sessions)
    _check_names(sessions)
    return sessions


def _without_copies(sessions: Sequence[LoggedSession]) -> list[LoggedSession]:
    """Keep the longest of the logs that begin with one row; a row has its time and date."""
    kept: dict[str, LoggedSession] = {}
    for one in sorted(sessions, key=lambda s: (-len(s.rows), len(s.path.name))):
        begin = digest([one.settings, one.rows[0]]) if one.rows else str(one.path)
        known = kept.setdefault(begin, one)
        if known.rows[: len(one.rows)] != one.rows:
            at = next(k for k, row in enumerate(one.rows) if row != known.rows[k])
            raise InputError(
                f"{one.path} and {known.path} have the same {at} rows first, and go on in two "
                "ways, as where a second person was given the log of a first one; keep the one "
                "that is right, and move the other away"
            )
        if known is not one:
            note = f"{one.path}: is a copy of {known.path}, and does not count again"
            kept[begin] = replace(known, remarks=(*known.remarks, note))
    return sorted(kept.values(), key=lambda s: (s.participant, s.session, s.task, s.path))


def _check_names(sessions: Sequence[LoggedSession]) -> None:
    known: dict[str, LoggedSession] = {}
    for one in sessions:
        labels = one.participant, one.session, one.task
        of = [one.settings.get(name) for name in ("task", "hashes")]
        other = known.setdefault(digest([labels, of]), one)
        if other is not one:
            who, task = one.participant, re.sub("[^A-Za-z0-9]", "", one.task) or "TASK"
            raise InputError(
                f"{other.path} and {one.path} have one name: are they of one person? Rename one "
                f"where they are not; else name them sub-{who}_ses-1_task-{task}_log.tsv and "
                f"sub-{who}_ses-2_task-{task}_log.tsv"
            )


def is_log(path: Path) -> bool:
    """Whether a file begins like a log of trials."""
    with reading(path, "a table"), path.open("rb") as file:
        return file.read(3) == b"# {"


def read_log(path: Path) -> LoggedSession:
    """Read a log, and check it as `parse_log` does."""
    end = End.of(path)  # first: a session that runs meanwhile may write a row
    log = parse_log(path, read_bytes(path, LARGEST_TABLE_BYTES), end)
    rows = (*log.rows,)
    remarks = (*log.remarks, *_rests(path, rows))
    return LoggedSession(*_labels(path), path, log.settings, rows, log.finished, remarks)


def _rests(path: Path, rows: Sequence[Mapping[str, str]]) -> Iterator[str]:
    """Say where a session went on so late that another person may have."""
    for before, row in pairwise(rows):
        if row["session"] == before["session"] or "n/a" in (before["date"], row["date"]):
            continue
        at, then = (datetime.fromisoformat(one["date"]) for one in (row, before))
        if (rested_min := (at - then).total_seconds() / 60) > _RESTED_MIN:
            yield (
                f"{path}: went on at trial {row['trial']} after {rested_min:.0f} minutes; was it "
                "the same person?"
            )


def _read_beh(path: Path) -> LoggedSession:
    about = read_json(path.with_suffix(".json"))
    if not isinstance(about.get(SETTINGS), dict):
        raise FileFormatError(
            f"{path.with_suffix('.json')}: has no {SETTINGS!r}, which names the method by which "
            "the levels were chosen; export its log again (haptix stimuli bids)"
        )
    text = io.StringIO(read_text(path, LARGEST_TABLE_BYTES), newline="")
    rows = []
    for row in csv.DictReader(text, delimiter="\t"):
        known = {"right": row.get("correct"), **row}
        rows.append({name: known.get(name) or "n/a" for name in COLUMNS})
    return LoggedSession(*_labels(path), path, about[SETTINGS], tuple(rows))


def _labels(path: Path) -> tuple[str, str, str]:
    match = _NAME.fullmatch(path.name)
    return (match[1], match[2], match[3]) if match else (path.stem, "", "")
