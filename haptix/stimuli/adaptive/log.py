"""The log of trials: on the disk as soon as each is over."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from haptix.errors import FileFormatError, InputError
from haptix.files import LARGEST_TABLE_BYTES, parse_json, read_bytes, write_failure, write_whole

COLUMNS = (
    "trial", "attempt", "time_s", "level_asked", "level", "lowered_to_ceiling", "right", "answer",
    "is_right", "normal_force_n", "speed_mm_per_s", "accepted", "why",
)  # fmt: skip
"""Columns of the table, in their order."""


class TrialLog:
    """A tab-separated table with a line per trial, on the disk before the next trial begins.

    An existing log is continued, unless its description is that of another `experiment`. A
    last line that was cut off while it was written is dropped.
    """

    def __init__(self, path: str | Path, experiment: Mapping[str, Any]) -> None:
        self.path = Path(path)
        first = json.dumps(experiment)
        head = f"# {first}\n" + "\t".join(COLUMNS) + "\n"
        try:
            known = read_bytes(self.path, LARGEST_TABLE_BYTES) if self.path.exists() else b""
            whole = known[: known.rfind(b"\n") + 1]
            lines = whole.decode().splitlines()
            if len(lines) < 2:
                whole, lines = head.encode(), head.splitlines()
            if lines[1].split("\t") != list(COLUMNS) or _settings(lines[0]) != json.loads(first):
                raise FileFormatError(
                    f"{self.path}: is the log of another experiment, or of other settings; name a "
                    "new file, or restore the settings in its first line"
                )
            self.rows = [self._read(line) for line in lines[2:]]
        except OSError as error:
            raise InputError(f"cannot use {self.path} as a log: {error.strerror}") from None
        except UnicodeDecodeError:
            raise FileFormatError(f"{self.path}: is not a log of trials") from None
        if whole != known:
            write_whole(self.path, whole)

    def append(self, row: Mapping[str, Any]) -> None:
        """Write one trial, and wait until the disk has it.

        Raises
        ------
        InputError
            If it cannot be written; the experiment must stop then.
        """
        cells = [_cell(row[name]) for name in COLUMNS]
        try:
            with self.path.open("ab") as file:
                file.write(("\t".join(cells) + "\n").encode())
                file.flush()
                os.fsync(file.fileno())
        except OSError as error:
            raise InputError(
                f"cannot write trial {row['trial']} to {self.path}: "
                f"{write_failure(error, self.path)}; start again: the run continues from its log"
            ) from None
        self.rows.append(dict(zip(COLUMNS, cells, strict=True)))

    def _read(self, line: str) -> dict[str, str]:
        cells = line.split("\t")
        if len(cells) != len(COLUMNS):
            raise FileFormatError(
                f"{self.path}: expected {len(COLUMNS)} columns, got {len(cells)} in: {line[:60]!r}"
            )
        return dict(zip(COLUMNS, cells, strict=True))


def _settings(line: str) -> object:
    """Settings in the first line of a log; None where it has none. Their order may differ."""
    try:
        return parse_json(line.removeprefix("# "))
    except ValueError:
        return None


def _cell(value: Any) -> str:
    if value is None or value == "":
        return "n/a"
    return str(value).lower() if isinstance(value, bool) else " ".join(str(value).split())
