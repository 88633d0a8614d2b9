"""Tables of trials of other programs, such as PsychoPy's, as the sessions of an analysis."""

from __future__ import annotations

import csv
from collections.abc import Iterator
from contextlib import suppress
from itertools import groupby
from math import isfinite, log10
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field

from haptix.base.documents import Document
from haptix.base.errors import FileFormatError, InputError
from haptix.base.files import LARGEST_TABLE_BYTES, digest, read_text
from haptix.lab.experiment.methods import ConstantStimuli
from haptix.lab.experiment.session_plan import TASKS
from haptix.lab.experiment.trial_log import COLUMNS, LoggedSession

REPORT = "report.html"
"""File of an analysis, beside its tables."""
_SUFFIXES = (".csv", ".tsv", ".txt")
_RIGHT = {"1", "1.0", "true", "yes", "right", "correct", "hit"}
_WRONG = {"0", "0.0", "false", "no", "wrong", "incorrect", "miss"}
_RESULTS = ("thresholds.tsv", "group.tsv", "differences.tsv")
_HIGHEST_DB = 1000.0  # a ratio of 10^50, which no stimulus has
_NOTHING = {"", "none", "n/a", "nan", "na"}


class TrialColumns(Document):
    """Which column of a table of trials is what: a TOML file.

    ::

        level = "contrast"              # of each trial
        level_unit = "linear"           # or "dB"; decibels are 20 log10 of a linear level
        is_right = "key_resp.corr"      # 1 or 0, true or false, right or wrong
        task = "2ifc"

    Rows without a level or an answer, such as those of instructions, are left out, and so are
    tables of results that an earlier analysis left in the folder.

    Parameters
    ----------
    level, is_right : str
        Columns of the level, and of whether the answer was right.
    level_unit : {"dB", "linear"}
        Unit of the levels.
    task : {"2ifc", "2afc", "3afc"}
        Gives how often one who guesses is right.
    participant, session, condition : str
        Their columns, where there are any; a table without participants is of one, who is called
        as its file.
    reaction_s : str, optional
        Column of the reaction times [s], by which fast guesses are found.
    delimiter : str, optional
        Between two columns; found where it is not given.
    """

    level: str
    is_right: str
    level_unit: Literal["dB", "linear"]
    task: Literal["2ifc", "2afc", "3afc"]
    participant: str = "participant"
    session: str = "session"
    condition: str = "condition"
    reaction_s: str | None = None
    delimiter: Annotated[str | None, Field(min_length=1, max_length=1)] = None

    def sessions(self, source: str | Path) -> Iterator[tuple[LoggedSession, str, ConstantStimuli]]:
        """Yield each session in each condition, with its answers; a copy of a file is left out.

        Parameters
        ----------
        source : path
            A table, or a folder of tables.

        Raises
        ------
        FileFormatError
            If a column is missing, or a level or an answer is none.
        InputError
            If there is no table.
        """
        source = Path(source)
        files = [source]
        if source.is_dir():
            files = sorted(
                file
                for file in source.rglob("*")
                if file.suffix in _SUFFIXES and not _is_written_by_analysis(file)
            )
        known: dict[str, Path] = {}
        remarks: dict[Path, list[str]] = {}
        for file in sorted(files, key=lambda file: (len(file.name), file)):
            first = known.setdefault(digest(read_text(file, LARGEST_TABLE_BYTES)), file)
            if first is not file:
                note = f"{file}: is a copy of {first}, and does not count again"
                remarks.setdefault(first, []).append(note)
        if not known:
            raise InputError(f"{source}: expected a table of trials, as .csv, .tsv or .txt")
        owners: dict[tuple[str, str], Path] = {}
        for file in sorted(known.values()):
            rows = sorted(self._rows(file), key=_person)
            for (who, session), of_person in groupby(
                rows, lambda row: (row["who"], row["session"])
            ):
                if (other := owners.setdefault((who, session), file)) is not file:
                    raise InputError(
                        f"{other} and {file} both have participant {who!r}, session {session!r}: "
                        "are they of one person? Give each session a name of its own"
                    )
                trials = [*of_person]
                for name in sorted({row["condition"] for row in trials}):
                    part = tuple(row for row in trials if row["condition"] == name)
                    yield self._made(file, who, session, name, part, (*remarks.get(file, ()),))

    def _made(
        self,
        file: Path,
        who: str,
        session: str,
        condition: str,
        rows: tuple[dict[str, str], ...],
        remarks: tuple[str, ...],
    ) -> tuple[LoggedSession, str, ConstantStimuli]:
        levels = [float(row["level"]) for row in rows]
        # Only the answers count; a run of one level has no threshold, and the fit reports that.
        different = sorted({*levels, levels[0] + 1.0} if len(set(levels)) < 2 else {*levels})
        method = ConstantStimuli(different, 1, guess=TASKS[self.task].guess)
        for level, row in zip(levels, rows, strict=True):
            method.update(row["is_right"] == "true", level)
        settings: dict[str, object] = {"task": self.task, "source": "imported", "hashes": {}}
        logged = LoggedSession(who, session, self.task, file, settings, rows, True, remarks)
        return logged, condition, method

    def _rows(self, file: Path) -> Iterator[dict[str, str]]:
        text = read_text(file, LARGEST_TABLE_BYTES)
        head = text.split("\n", 1)[0]
        sign = self.delimiter or max("\t;,", key=head.count)
        table = csv.DictReader(text.splitlines(), delimiter=sign)
        names = [name.strip() for name in table.fieldnames or ()]
        table.fieldnames = names
        needed = [self.level, self.is_right, *filter(None, [self.reaction_s])]
        if missing := [name for name in needed if name not in names]:
            raise FileFormatError(
                f"{file}: missing columns {', '.join(map(repr, missing))}; the file has "
                f"{', '.join(filter(None, names))}"
            )
        count = 0
        for number, row in enumerate(table, 2):
            cells = {name: (value or "").strip() for name, value in row.items() if name}
            level, answer = cells[self.level], cells[self.is_right].lower()
            if level.lower() in _NOTHING or answer in _NOTHING:
                continue
            if answer not in _RIGHT | _WRONG:
                raise FileFormatError(
                    f"{file}, line {number}: {self.is_right}: expected 1 or 0, got {answer!r}"
                )
            count += 1
            yield {
                **dict.fromkeys(COLUMNS, "n/a"),
                "who": cells.get(self.participant) or file.stem,
                "session": cells.get(self.session, ""),
                "condition": cells.get(self.condition, ""),
                "trial": str(count),
                "level": repr(self._level_db(file, number, level)),
                "reaction_s": self._seconds(file, number, cells),
                "is_right": "true" if answer in _RIGHT else "false",
                "kind": "trial",
                "accepted": "true",
            }
        if not count:
            raise FileFormatError(
                f"{file}: expected trials with {self.level} and {self.is_right}, got none"
            )

    def _seconds(self, file: Path, number: int, cells: dict[str, str]) -> str:
        cell = cells.get(self.reaction_s or "", "").replace(",", ".")
        if cell.lower() in _NOTHING:
            return "n/a"
        with suppress(ValueError):
            if isfinite(seconds := float(cell)):
                return repr(seconds)
        raise FileFormatError(
            f"{file}, line {number}: {self.reaction_s}: expected seconds, got {cell!r}"
        )

    def _level_db(self, file: Path, number: int, cell: str) -> float:
        with suppress(ValueError):
            value = float(cell.replace(",", "."))
            level_db = value if self.level_unit == "dB" else 20 * log10(value)
            if abs(level_db) <= _HIGHEST_DB:
                return level_db
        wanted = "a level in dB" if self.level_unit == "dB" else "a level above 0"
        raise FileFormatError(
            f"{file}, line {number}: {self.level}: expected {wanted}, got {cell!r}"
        )


def _is_written_by_analysis(file: Path) -> bool:
    """Whether a table is a result of an earlier analysis, which has its report beside it."""
    return file.name in _RESULTS and file.with_name(REPORT).exists()


def _person(row: dict[str, str]) -> tuple[str, str]:
    return row["who"], row["session"]


def is_table(source: Path) -> bool:
    """Whether a path is that of a table, by its name."""
    return source.suffix in _SUFFIXES and source.is_file()


def advice(source: Path) -> str:
    """Return what to do with a table that is no log of haptix."""
    with source.open(encoding="utf-8-sig", errors="replace") as file:
        head = file.readline(4096)
    names = [name.strip().strip('"') for name in head.split(max("\t;,", key=head.count))]
    right = next((name for name in names if name.endswith(".corr")), "key_resp.corr")
    level = next((name for name in names if "intensity" in name or "level" in name), "level")
    whose = "PsychoPy's" if "psychopyVersion" in names else "another program's"
    return (
        f"{source}: is not a log of trials; if it is {whose} table of trials, say which column is "
        f'what in a TOML file, --columns map.toml: level = "{level}", level_unit = "dB" or '
        f'"linear", is_right = "{right}", task = "2ifc"; it has {", ".join(filter(None, names))}'
    )
