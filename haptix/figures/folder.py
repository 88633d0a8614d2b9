"""All figures into a folder: a PNG and a CSV each, and the captions as JSON."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import isnan
from pathlib import Path

from haptix.errors import InputError
from haptix.figures.area_against_frequency import area_against_frequency
from haptix.figures.area_against_pressure import area_against_pressure
from haptix.figures.area_against_voltage import area_against_voltage
from haptix.figures.data import FigureData
from haptix.figures.drawing import png
from haptix.figures.friction_against_force import friction_against_force
from haptix.figures.friction_in_time import friction_in_time
from haptix.figures.gap_distributions import gap_distributions
from haptix.figures.roughness_spectra import roughness_spectra
from haptix.version import __version__

Progress = Callable[[str, float], None]

FIGURES: Mapping[str, Callable[[], FigureData]] = {
    "fig2d": area_against_pressure,
    "fig3b": friction_in_time,
    "fig3c": friction_against_force,
    "fig3d": area_against_voltage,
    "fig4": area_against_frequency,
    "roughness": roughness_spectra,
    "gaps": gap_distributions,
}
"""Every figure by the stem of its files; the numbered ones are the paper's."""

CAPTIONS = "captions.json"


@dataclass(frozen=True)
class Written:
    """One figure and its files."""

    data: FigureData
    png: Path
    csv: Path


def write_figures(
    folder: Path,
    on_progress: Progress = lambda stage, share: None,
    names: Sequence[str] = (),
) -> tuple[Written, ...]:
    """Draw figures into a folder, which is made if needed.

    Files of the same names are replaced, others are left alone. All is computed and drawn before
    the first file is written.

    Parameters
    ----------
    folder : Path
        Where the files go.
    on_progress : callable
        Called with "model", "draw" or "write" and the share of it that is done.
    names : sequence of str
        Figures to draw, such as "fig2d" or "2d"; all of them without.

    Raises
    ------
    InputError
        If the folder cannot be used or a figure is unknown; nothing is computed then.
    """
    chosen = _chosen(names)
    written = [folder / f"{name}{end}" for name in chosen for end in (".png", ".csv")]
    _check(folder, [*written, folder / CAPTIONS])
    figures = []
    for number, name in enumerate(chosen, start=1):
        figures.append(FIGURES[name]())
        on_progress("model", number / len(chosen))
    files: dict[str, bytes] = {}
    for number, data in enumerate(figures, start=1):
        files[f"{data.name}.png"] = png(data)
        files[f"{data.name}.csv"] = table(data).encode("utf-8")
        on_progress("draw", number / len(figures))
    files[CAPTIONS] = (_captions(figures)).encode("utf-8")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name, content in files.items():
            _replace(folder / name, content)
    except OSError as error:
        raise InputError(f"--out: cannot write into {folder}: {error.strerror}") from None
    on_progress("write", 1.0)
    return tuple(
        Written(data, folder / f"{data.name}.png", folder / f"{data.name}.csv") for data in figures
    )


def table(data: FigureData) -> str:
    """CSV of a figure: a line of names with units, then numbers; an empty cell is none.

    It carries no comment lines, which spreadsheets would take for data.
    """
    text = io.StringIO()
    rows = csv.writer(text, lineterminator="\n")
    rows.writerow(data.columns)
    for row in zip(*data.columns.values(), strict=True):
        rows.writerow("" if isnan(value) else f"{value:.10g}" for value in row)
    return text.getvalue()


def _captions(figures: list[FigureData]) -> str:
    content = {
        "haptix": __version__,
        "figures": {
            data.name: {
                "title": data.title,
                "caption": data.caption,
                "png": f"{data.name}.png",
                "csv": f"{data.name}.csv",
                "columns": list(data.columns),
            }
            for data in figures
        },
    }
    return json.dumps(content, indent=2, ensure_ascii=False) + "\n"


def _chosen(names: Sequence[str]) -> list[str]:
    """Names as they stand in `FIGURES`, in its order."""
    found = {name if name in FIGURES else f"fig{name}" for name in names}
    if unknown := found - set(FIGURES):
        raise InputError(
            f"figures: unknown {', '.join(sorted(n.removeprefix('fig') for n in unknown))}; "
            f"expected some of {', '.join(name.removeprefix('fig') for name in FIGURES)}"
        )
    return [name for name in FIGURES if name in found or not names]


def _check(folder: Path, files: list[Path]) -> None:
    """Refuse what is no folder, before the work."""
    for above in (folder, *folder.parents):
        if above.exists():
            if not above.is_dir():
                raise InputError(f"--out: {above} is a file; name a folder")
            break
    for file in files:
        if file.is_dir():
            raise InputError(f"--out: {file} is a folder where a file goes; name another --out")


def _replace(file: Path, content: bytes) -> None:
    """Write whole or not at all: a figure that is open elsewhere is never half a file."""
    part = file.with_name(file.name + ".part")
    try:
        part.write_bytes(content)
        part.replace(file)
    finally:
        part.unlink(missing_ok=True)
