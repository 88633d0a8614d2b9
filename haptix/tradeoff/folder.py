"""Files of a tradeoff: CSV, JSON and the plot."""

from __future__ import annotations

from pathlib import Path

from haptix.files import check_folder, csv_text, json_text, write_folder
from haptix.scene import Scene
from haptix.tradeoff.drawing import png
from haptix.tradeoff.run import Progress, Tradeoff, run_tradeoff
from haptix.version import __version__

_FILES = ("tradeoff.csv", "tradeoff.png", "tradeoff.json")


def write_tradeoff(
    scene: Scene,
    folder: Path,
    quick: bool = False,
    on_progress: Progress = lambda stage, share: None,
    boundary_elements: bool = False,
) -> Tradeoff:
    """Write `run_tradeoff` into a folder, which is made if needed; its last stage is "write".

    Raises
    ------
    InputError
        If the folder cannot be used, before anything is measured; or the scene contradicts itself.
    """
    check_folder(folder, _FILES)
    tradeoff = run_tradeoff(scene, quick, on_progress, boundary_elements)
    record = {"haptix": __version__, **tradeoff.record()}
    rows = record["runs"]
    table = csv_text(rows[0], (row.values() for row in rows), 6)  # names with units, then the runs
    contents = (table, png(tradeoff), json_text(record))
    write_folder(folder, dict(zip(_FILES, contents, strict=True)))
    on_progress("write", 1.0)
    return tradeoff
