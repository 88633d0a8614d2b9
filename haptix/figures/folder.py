"""Write all figures into a folder: a PNG and a CSV each, and the captions as JSON."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
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
from haptix.files import check_folder, csv_text, json_text, write_folder
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
"""Every figure by the stem of its files; `haptix.presets.FIGURES` has the names."""

CAPTIONS = "captions.json"


def write_figures(
    folder: Path,
    on_progress: Progress = lambda stage, share: None,
    names: Sequence[str] = (),
) -> tuple[FigureData, ...]:
    """Draw figures into a folder, which is made if needed, and return their data.

    A figure's files are NAME.png and NAME.csv. Files of the same names are replaced, others are
    left alone. All is computed and drawn before the first file is written.

    Parameters
    ----------
    folder : Path
        Where the files go.
    on_progress : callable
        Called with "model", "draw" or "write" and the share of it that is done.
    names : sequence of str
        Figures to draw, such as "fig2d" or "2d"; by default all of them.

    Raises
    ------
    InputError
        If the folder cannot be used or a figure is unknown; nothing is computed then.
    """
    chosen = _chosen(names)
    names_of_files = [f"{name}{end}" for name in chosen for end in (".png", ".csv")]
    check_folder(folder, [*names_of_files, CAPTIONS])
    figures = []
    for number, name in enumerate(chosen, start=1):
        figures.append(FIGURES[name]())
        on_progress("model", number / len(chosen))
    files: dict[str, bytes | str] = {}
    for number, data in enumerate(figures, start=1):
        files[f"{data.name}.png"] = png(data)
        files[f"{data.name}.csv"] = table(data)
        on_progress("draw", number / len(figures))
    captions = {
        data.name: {
            "title": data.title,
            "caption": data.caption,
            "png": f"{data.name}.png",
            "csv": f"{data.name}.csv",
            "columns": list(data.columns),
        }
        for data in figures
    }
    files[CAPTIONS] = json_text({"haptix": __version__, "figures": captions})
    write_folder(folder, files)
    on_progress("write", 1.0)
    return tuple(figures)


def table(data: FigureData) -> str:
    """CSV of a figure: a line of names with units, then numbers; NaN is an empty cell.

    It carries no comment lines, which spreadsheets would take for data.
    """
    rows = zip(*data.columns.values(), strict=True)
    cells = ((None if isnan(value) else value for value in row) for row in rows)
    return csv_text(data.columns, cells, 10)


def _chosen(names: Sequence[str]) -> list[str]:
    """Names as they stand in `FIGURES`, in its order."""
    found = {name if name in FIGURES else f"fig{name}" for name in names}
    if unknown := found - set(FIGURES):
        raise InputError(
            f"figures: unknown {', '.join(sorted(n.removeprefix('fig') for n in unknown))}; "
            f"expected any of {', '.join(name.removeprefix('fig') for name in FIGURES)}"
        )
    return [name for name in FIGURES if name in found or not names]
