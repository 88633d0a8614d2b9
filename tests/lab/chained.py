"""Logs of tests that were not written by a run: chained as docs/experiment.md says."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from pathlib import Path


def hash_of(line: str) -> str:
    """First 16 digits of the SHA-256 of a line without its end."""
    return hashlib.sha256(line.encode()).hexdigest()[:16]


def rows_of(path: Path) -> list[dict[str, str]]:
    """Rows of a log."""
    _, names, *lines = path.read_text().splitlines()
    return [dict(zip(names.split("\t"), line.split("\t"), strict=True)) for line in lines]


def write_rows(path: Path, rows: Sequence[Mapping[str, str]], finished: bool = False) -> None:
    """Replace the rows of a log as if a run had written these: hashes and end file are right."""
    head, names, *_ = path.read_text().splitlines()
    lines = [head, names]
    last = hash_of("\n".join(lines))
    for row in rows:
        lines.append("\t".join({**row, "before": last}.values()))
        last = hash_of(lines[-1])
    path.write_text("\n".join(lines) + "\n")
    end = {"rows": len(rows), "last": last, "finished": finished}
    path.with_name(f"{path.stem}_end.json").write_text(json.dumps(end))


def stopped_after(path: Path, count: int) -> None:
    """Leave the first rows of a log, as if the run had been stopped after them."""
    write_rows(path, rows_of(path)[:count])
