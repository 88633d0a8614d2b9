"""CSV tables with named columns, as recorders and spreadsheets write them."""

from __future__ import annotations

import csv
from collections.abc import Iterator, Sequence
from pathlib import Path

from haptix.errors import InputError


def read_table(
    path: Path, what: str, required: Sequence[str], optional: Sequence[str] = ()
) -> Iterator[tuple[int, dict[str, str]]]:
    """Yield line number and cells by name of each row that is not empty.

    Columns may stand in any order; others than those named are skipped.

    Raises
    ------
    InputError
        If the file cannot be read, a column is missing or named twice, or a row is too short or too
        long.
    """
    try:
        # Spreadsheets put a byte-order mark before the first name.
        with path.open(newline="", encoding="utf-8-sig") as file:
            rows = list(csv.reader(file, skipinitialspace=True))
    except OSError as error:
        raise InputError(f"cannot read {what} {path}: {error.strerror}") from None
    except (UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"{path}: expected a CSV text file, got: {error}") from None
    names = [name.strip() for name in rows[0]] if rows else []
    wrong = [name for name in required if names.count(name) != 1]
    wrong += [name for name in optional if names.count(name) > 1]
    if wrong:
        raise InputError(
            f"{path}: expected a first line naming {', '.join(required)}, each once; "
            f"missing or repeated: {', '.join(wrong)}"
        )
    for line, row in enumerate(rows[1:], 2):
        if not row:
            continue
        if len(row) != len(names):
            why = (
                f"{names[len(row)]} is missing"
                if len(row) < len(names)
                else "decimals need a point, not a comma"
            )
            raise InputError(
                f"{path}, line {line}: expected {len(names)} values, got {len(row)}; {why}"
            )
        yield line, dict(zip(names, row, strict=True))


def number_in(path: Path, line: int, name: str, text: str) -> float:
    """Return the number of a cell, or raise `InputError` naming the place."""
    try:
        return float(text)
    except ValueError:
        raise InputError(f"{path}, line {line}: {name}: expected a number, got {text!r}") from None
