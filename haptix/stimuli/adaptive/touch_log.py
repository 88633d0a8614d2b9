"""The finger's path and force in every trial, as the panel reports them: a table beside the log."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from dataclasses import astuple
from pathlib import Path

from haptix.errors import FileFormatError, InputError
from haptix.files import LARGEST_TABLE_BYTES, read_text, write_failure
from haptix.render.intervals import TouchSample

COLUMNS = (
    "session", "trial", "attempt", "t_s", "x_mm", "y_mm", "normal_force_n", "contact", "phase",
)  # fmt: skip
"""Columns of the table; `t_s` is on the time of the log."""

_HEAD = "\t".join(COLUMNS) + "\n"


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

        Raises
        ------
        FileFormatError
            If the file there is no table of touches; it stays as it is.
        InputError
            If it cannot be written.
        """
        if not samples:
            return
        place = (session, trial, attempt)
        text = "".join(
            "\t".join("n/a" if cell is None else str(cell) for cell in (*place, *astuple(one)))
            + "\n"
            for one in samples
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
        if not self.path.exists() or not self.path.stat().st_size:
            return _HEAD
        with self.path.open("r+b") as file:
            known = file.read(LARGEST_TABLE_BYTES)
            if not known.startswith(_HEAD.encode()):
                raise FileFormatError(f"{self.path}: is no table of touches, and stays as it is")
            if not known.endswith(b"\n"):
                file.truncate(known.rfind(b"\n") + 1)
        return ""

    def rows(self) -> Iterator[dict[str, str]]:
        """Yield the rows that are whole; none where no panel has reported."""
        if not self.path.exists():
            return
        head, *lines = read_text(self.path, LARGEST_TABLE_BYTES).splitlines(keepends=True)
        if head != _HEAD:
            raise FileFormatError(f"{self.path}: is no table of touches")
        for line in lines:
            cells = line.rstrip("\n").split("\t")
            if line.endswith("\n") and len(cells) == len(COLUMNS):
                yield dict(zip(COLUMNS, cells, strict=True))
