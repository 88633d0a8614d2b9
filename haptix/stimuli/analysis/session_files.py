"""Sessions that were run, read from a log, a folder of logs, or a study in the form of BIDS."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from haptix.errors import FileFormatError, InputError
from haptix.files import LARGEST_TABLE_BYTES, parse_json, read_json, read_text, reading
from haptix.stimuli.adaptive.log import COLUMNS

SETTINGS = "Experiment"
"""Key of a ``*_beh.json`` under which the head of the log is."""

_NAME = re.compile(r"sub-([A-Za-z0-9]+)_ses-([A-Za-z0-9]+)_task-([A-Za-z0-9]+)_(?:log|beh)\.tsv")


@dataclass(frozen=True)
class LoggedSession:
    """A session of one participant.

    Parameters
    ----------
    participant, session, task : str
        Labels; a log outside of a study has its file's name as participant.
    path : Path
        The file that it was read from.
    settings : mapping
        Head of the log: method, task, seed, hashes, plan.
    rows : tuple of dict
        Attempts, by the columns of the log.
    """

    participant: str
    session: str
    task: str
    path: Path
    settings: Mapping[str, Any]
    rows: tuple[Mapping[str, str], ...]

    @property
    def name(self) -> str:
        """Participant and session, for people."""
        return f"{self.participant}, session {self.session}" if self.session else self.participant


def read_sessions(source: str | Path) -> list[LoggedSession]:
    """Read the sessions of a log, of a folder of logs, or of a study.

    Of a study those in ``sourcedata`` count, as they are the logs themselves; where a study is
    without, as one that was passed on, its ``*_beh.tsv``.

    Raises
    ------
    FileFormatError
        If a file is no log of trials.
    InputError
        If there is none.
    """
    source = Path(source)
    if not source.is_dir():
        return [read_log(source)]
    if (source / "dataset_description.json").exists():
        found: dict[tuple[str, ...], LoggedSession] = {}
        for path in sorted(source.glob("sub-*/**/*_beh.tsv")):
            one = _read_beh(path)
            found[one.participant, one.session, one.task] = one
        for path in sorted(source.glob("sourcedata/sub-*/**/*_log.tsv")):
            one = read_log(path)
            found[one.participant, one.session, one.task] = one
        sessions = [found[key] for key in sorted(found)]
    else:
        logs = (path for path in sorted(source.rglob("*.tsv")) if is_log(path))
        sessions = [read_log(path) for path in logs]
    if not sessions:
        raise InputError(f"{source}: has no log of trials; name a log, or the folder of a study")
    return sessions


def is_log(path: Path) -> bool:
    """Whether a file begins as a log of trials does."""
    with reading(path, "a table"), path.open("rb") as file:
        return file.read(3) == b"# {"


def read_log(path: Path) -> LoggedSession:
    """Read a log; a last line that was cut off while it was written is no trial."""
    lines = read_text(path, LARGEST_TABLE_BYTES).splitlines(keepends=True)
    if len(lines) < 2 or not lines[0].startswith("# {"):
        raise FileFormatError(f"{path}: is not a log of trials")
    with reading(path, "a log of trials"):
        settings = parse_json(lines[0].removeprefix("# "))
    if lines[1].split() != list(COLUMNS) or "method" not in settings:
        raise FileFormatError(
            f"{path}: is a log of another version of haptix; continue it with --another-program "
            "first"
        )
    rows = []
    for number, line in enumerate(lines[2:], 3):
        cells = line.rstrip("\r\n").split("\t")
        if len(cells) == len(COLUMNS) and line.endswith("\n"):
            rows.append(dict(zip(COLUMNS, cells, strict=True)))
        elif number < len(lines) or line.endswith("\n"):
            raise FileFormatError(
                f"{path}, line {number}: expected {len(COLUMNS)} columns, got {len(cells)}; "
                "restore the log as it was written"
            )
    return LoggedSession(*_labels(path), path, settings, tuple(rows))


def _read_beh(path: Path) -> LoggedSession:
    about = read_json(path.with_suffix(".json"))
    if not isinstance(about.get(SETTINGS), dict):
        raise FileFormatError(
            f"{path.with_suffix('.json')}: has no {SETTINGS!r}, which says by what method the "
            "levels were chosen; export its log again (haptix stimuli bids)"
        )
    text = io.StringIO(read_text(path, LARGEST_TABLE_BYTES), newline="")
    rows = []
    for row in csv.DictReader(text, delimiter="\t"):
        known = {"right": row.get("correct"), "onset_s": row.get("onset"), **row}
        rows.append({name: known.get(name) or "n/a" for name in COLUMNS})
    return LoggedSession(*_labels(path), path, about[SETTINGS], tuple(rows))


def _labels(path: Path) -> tuple[str, str, str]:
    found = _NAME.fullmatch(path.name)
    return (found[1], found[2], found[3]) if found else (path.stem, "", "")
