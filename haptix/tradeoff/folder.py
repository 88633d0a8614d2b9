"""The trade as files: CSV, JSON and the plot."""

from __future__ import annotations

import csv
import io
import json
from pathlib import Path

from haptix.errors import InputError
from haptix.scene import Scene
from haptix.tradeoff.drawing import png
from haptix.tradeoff.run import Progress, Tradeoff, run_tradeoff
from haptix.version import __version__

_FILES = ("tradeoff.csv", "tradeoff.json", "tradeoff.png")


def write_tradeoff(
    scene: Scene,
    folder: Path,
    quick: bool = False,
    on_progress: Progress = lambda stage, share: None,
    boundary_elements: bool = False,
) -> Tradeoff:
    """Measure a scene into a folder, which is made if needed.

    Files of the same names are replaced, others are left alone; all is measured and drawn before
    the first is written.

    Parameters
    ----------
    scene, quick, on_progress, boundary_elements
        As for `run_tradeoff`; progress has the stage "write" as well.
    folder : Path
        Where the files go.

    Raises
    ------
    InputError
        If the folder cannot be used, before anything is measured; or the scene contradicts itself.
    """
    _check(folder)
    tradeoff = run_tradeoff(scene, quick, on_progress, boundary_elements)
    record = {"haptix": __version__, **tradeoff.record()}
    files = {
        "tradeoff.csv": table(tradeoff).encode("utf-8"),
        "tradeoff.json": (json.dumps(record, indent=2, allow_nan=False) + "\n").encode("utf-8"),
        "tradeoff.png": png(tradeoff),
    }
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name, content in files.items():
            _replace(folder / name, content)
    except OSError as error:
        raise InputError(f"--out: cannot write into {folder}: {error.strerror}") from None
    on_progress("write", 1.0)
    return tradeoff


def table(tradeoff: Tradeoff) -> str:
    """CSV: a line of names with units, then one run a line."""
    text = io.StringIO()
    rows = [run.row() for run in tradeoff.runs]
    lines = csv.DictWriter(text, list(rows[0]), lineterminator="\n")
    lines.writeheader()
    for row in rows:
        lines.writerow({k: f"{v:.6g}" if isinstance(v, float) else v for k, v in row.items()})
    return text.getvalue()


def _check(folder: Path) -> None:
    """Refuse what is no folder, before the work."""
    for above in (folder, *folder.parents):
        if above.exists():
            if not above.is_dir():
                raise InputError(f"--out: {above} is a file; name a folder")
            break
    for name in _FILES:
        if (folder / name).is_dir():
            raise InputError(f"--out: {folder / name} is a folder; name another --out")


def _replace(file: Path, content: bytes) -> None:
    """Write whole or not at all."""
    part = file.with_name(file.name + ".part")
    try:
        part.write_bytes(content)
        part.replace(file)
    finally:
        part.unlink(missing_ok=True)
