"""The log of trials: on the disk as soon as each is over."""

from __future__ import annotations

import errno
import hashlib
import json
import os
from collections.abc import Mapping
from contextlib import suppress
from datetime import UTC, datetime
from functools import cache
from pathlib import Path
from typing import Any

from filelock import FileLock, Timeout

from haptix.errors import FileFormatError, InputError
from haptix.files import LARGEST_TABLE_BYTES, parse_json, read_bytes, write_failure, write_whole
from haptix.version import __version__

COLUMNS = (
    "trial", "attempt", "time_s", "level_asked", "level", "lowered_to_ceiling", "right", "answer",
    "is_right", "normal_force_n", "speed_mm_per_s", "accepted", "why", "session", "onset_s",
    "reaction_s", "date", "version", "device", "profile", "kind", "condition", "other_level",
)  # fmt: skip
"""Columns of the table, in their order."""

_COLUMNS_OF_1 = COLUMNS[:13]
_FORMAT = 2
_OUTSIDE = ("cli", "client", "service", "studio")  # rooms that no trial depends on


@cache
def program() -> str:
    """Version of haptix, and a hash of the code that makes and counts trials."""
    package, code = Path(__file__).parents[2], hashlib.sha256()
    for file in sorted(package.rglob("*.py")):
        if file.relative_to(package).parts[0] not in _OUTSIDE:
            code.update(file.read_bytes())
    return f"{__version__}+{code.hexdigest()[:12]}"


class TrialLog:
    """A tab-separated table with a line per trial, on the disk before the next trial begins.

    Its first line holds what the trials rest on. An existing log is continued, and only by the
    same `experiment`. A file that no log has made is never written to. A last line that was cut off
    while it was written is dropped. From `open` to `close` a lock keeps other writers away.

    Parameters
    ----------
    path : path
        The table; a file ``.NAME.lock`` lies beside it.
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
        self._is_of_1 = False
        self._size = -1
        self.open()

    def open(self) -> None:
        """Lock the log, and read it again if it has changed since.

        Raises
        ------
        InputError
            If another process, or another experiment of this one, writes it.
        FileFormatError
            If it is no log, or that of another experiment.
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
        if self._is_of_1:
            lines = ["\t".join(row[name] for name in COLUMNS) + "\n" for row in self.rows]
            self._write(self._head() + "".join(lines))
            self._is_of_1 = False

    def _read_file(self) -> None:
        known = b""
        try:
            if self.path.exists():
                known = read_bytes(self.path, LARGEST_TABLE_BYTES)
        except OSError as error:
            raise InputError(f"cannot use {self.path} as a log: {error.strerror}") from None
        if self._size >= 0 and len(known) != self._size:
            raise _changed(self.path)
        if self._size >= 0:
            return
        if not known:  # an empty file holds nothing to lose
            self._write(self._head())
            return
        whole = known[: known.rfind(b"\n") + 1]
        try:
            first, second, *lines = whole.decode().splitlines()
            head = parse_json(first.removeprefix("# ")) if first.startswith("# ") else None
        except ValueError:
            head = None
        if not isinstance(head, dict) or "method" not in head:
            raise FileFormatError(f"{self.path}: is not a log of trials, and stays as it is")
        self._is_of_1 = "format" not in head
        columns = _COLUMNS_OF_1 if self._is_of_1 else COLUMNS
        if head.get("format", _FORMAT) != _FORMAT or tuple(second.split("\t")) != columns:
            raise FileFormatError(
                f"{self.path}: is a log of another version of haptix; name a new file"
            )
        self.version = str(head.pop("version", "0.1"))
        head.pop("format", None)
        then, now = _flat(head), _flat(self._experiment)
        # Another program may know more settings.
        names = set(then) | (set(now) if self.version == program() else set())
        if different := sorted(name for name in names if then.get(name) != now.get(name)):
            raise FileFormatError(
                f"{self.path}: is the log of another experiment, or of other settings: "
                f"{', '.join(different)}; name a new file, or restore them"
            )
        self.rows = [self._row(line, columns) for line in lines]
        if self.rows and not self._is_of_1:
            self.version = self.rows[-1]["version"]
        self._size = len(whole)
        if whole != known:
            with self.path.open("r+b") as file:
                file.truncate(len(whole))
                os.fsync(file.fileno())

    def append(self, row: Mapping[str, Any]) -> None:
        """Write one trial, and wait until the disk has it.

        Raises
        ------
        InputError
            If it cannot be written; the experiment must stop then.
        """
        cells = [_cell(row.get(name)) for name in COLUMNS]
        line = ("\t".join(cells) + "\n").encode()
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
        self.rows.append(dict(zip(COLUMNS, cells, strict=True)))

    def resumed(self, now_s: float) -> tuple[int, float]:
        """Number of this session, and the time by a clock that is 0 s in the log.

        A resumed log goes on after its last trial, by as much as has passed since.
        """
        if not self.rows:
            return 1, now_s
        last, past = self.rows[-1], 0.0
        if last["date"] != "n/a":
            past = (datetime.now(UTC) - datetime.fromisoformat(last["date"])).total_seconds()
        session = 1 if last["session"] == "n/a" else int(last["session"])
        return session + 1, now_s - float(last["time_s"]) - max(0.0, past)

    def _head(self) -> str:
        head = {"format": _FORMAT, "version": program(), **self._experiment}
        return f"# {json.dumps(head)}\n" + "\t".join(COLUMNS) + "\n"

    def _write(self, text: str) -> None:
        write_whole(self.path, text)
        self._size = len(text.encode())

    def _row(self, line: str, columns: tuple[str, ...]) -> dict[str, str]:
        cells = line.split("\t")
        if len(cells) != len(columns):
            raise FileFormatError(
                f"{self.path}: expected {len(columns)} columns, got {len(cells)} in: {line[:60]!r}"
            )
        return dict.fromkeys(COLUMNS, "n/a") | dict(zip(columns, cells, strict=True))


def _changed(path: Path) -> InputError:
    return InputError(f"{path}: was changed meanwhile; start again to continue from it")


def _flat(table: Mapping[str, Any], before: str = "") -> dict[str, Any]:
    """Values by dotted names."""
    found: dict[str, Any] = {}
    for name, value in table.items():
        inner = isinstance(value, dict) and value
        found |= _flat(value, f"{before}{name}.") if inner else {f"{before}{name}": value}
    return found


def _cell(value: Any) -> str:
    if value is None or value == "":
        return "n/a"
    return str(value).lower() if isinstance(value, bool) else " ".join(str(value).split())
