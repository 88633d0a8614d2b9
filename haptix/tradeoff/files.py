"""Files of a tradeoff: CSV, JSON, and a picture of the runs to take among all others."""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path
from textwrap import wrap
from typing import Any

from haptix.errors import from_extra
from haptix.files import check_folder, csv_text, json_text, write_folder
from haptix.report import titles_of
from haptix.scene import Scene
from haptix.tradeoff.runs import COSTS, Progress, Run, Tradeoff, machine, run_tradeoff
from haptix.version import __version__

with from_extra("figures"):
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.layout_engine import ConstrainedLayoutEngine
    from matplotlib.ticker import LogLocator, NullFormatter

_FILES = ("tradeoff.csv", "tradeoff.png", "tradeoff.json")
_COLORS = ("#ee6677", "#4477aa", "#228833", "#aa3377")  # after P. Tol
_DPI = 150


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
    png = io.BytesIO()
    draw(tradeoff).savefig(png, format="png", dpi=_DPI)
    contents = (table, png.getvalue(), json_text(record))
    write_folder(folder, dict(zip(_FILES, contents, strict=True)))
    on_progress("write", 1.0)
    return tradeoff


def draw(tradeoff: Tradeoff) -> Figure:
    """Draw error against build time, query time and memory: what to take, and the rest in grey."""
    layout = ConstrainedLayoutEngine(rect=(0, 0.06, 1, 0.94))
    figure = Figure(figsize=(13, 5.6), layout=layout)
    panels, titles = figure.subplots(1, len(COSTS), sharey=True), titles_of(Run)
    for axes, name in zip(panels, COSTS, strict=True):
        _panel(axes, tradeoff, name)
        axes.set(xlabel=titles[COSTS[name]], xscale="log", yscale="log")
        for axis in (axes.xaxis, axes.yaxis):
            low, high = axis.get_view_interval()
            # Times often span less than a decade: powers of ten alone would leave them unlabelled.
            axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if high < 100 * low else (1.0,)))
            axis.set_major_formatter("{x:g}")
            axis.set_minor_formatter(NullFormatter())
        axes.grid(which="major", color="0.94", lw=0.7)
        axes.set_axisbelow(True)
    panels[0].set_ylabel(f"largest {titles['error_max_jnd']}")
    handles, labels = panels[0].get_legend_handles_labels()
    beside: dict[str, Any] = {"frameon": False, "alignment": "left"}
    figure.legend(handles[_GREY:], labels[_GREY:], loc="outside upper left", **beside)
    figure.legend(handles[:_GREY], labels[:_GREY], loc="outside upper right", **beside)
    what = machine()
    caption = (
        f"{tradeoff.scene.name}. Errors against the mean field with every term, at "
        f"{tradeoff.points} held-out points, for a slice at its own frequency and h0; times in "
        f"batches of {tradeoff.batch:,} on {what['threads']} thread(s) of {what['processor']}"
        f"{' and ' + what['gpu'] if what['gpu'] else ''}, torch {what['torch']}."
    )
    figure.text(0.01, 0.01, "\n".join(wrap(caption, 190)), fontsize=8, color="0.3", va="bottom")
    return figure


_GREY = 3  # what a panel draws before the runs to take


def _panel(axes: Axes, tradeoff: Tradeoff, name: str) -> None:
    def places(runs: Sequence[Run]) -> list[tuple[float, float]]:
        return [(float(getattr(run, COSTS[name])), run.error_max_jnd) for run in runs]

    others = places([run for run in tradeoff.runs if not run.take])
    label = "other surfaces, and slices of one frequency and h0"
    axes.plot(*zip(*others, strict=True), "o", color="0.85", ms=4, zorder=2, label=label)
    surfaces = [run for run in tradeoff.runs if run.form == "surface"]
    front = sorted(places([run for run in surfaces if name in run.fronts.split()]))
    label = "no other surface is better in both"
    axes.step(*zip(*front, strict=True), where="post", color="0.7", lw=1.0, zorder=1, label=label)
    budget = tradeoff.scene.budget_jnd
    axes.axhline(budget, color="0.4", ls="--", lw=1.0, zorder=1, label="budget of the scene")
    taken = sorted((run for run in surfaces if run.take), key=lambda run: run.memory_bytes)
    for number, (run, color) in enumerate(zip(taken, _COLORS, strict=False), start=1):
        [place] = places([run])
        label = f"{number}  {run.take}: {_description(run)}"
        axes.plot(*place, "o", color=color, ms=9, zorder=4, label=label)
        axes.annotate(
            str(number), place, (7, 5 - 15 * (number % 2)), textcoords="offset points",
            color=color, fontweight="bold", zorder=5,
        )  # fmt: skip
    axes.margins(0.1)


def _description(run: Run) -> str:
    """What a run is, and what it costs."""
    model = "" if run.model == "planned" else f"{run.model.replace('-', ' ')}, "
    where = "" if run.device == "cpu" else ", GPU"
    return (
        f"{model}{run.tolerance}, {run.dtype}{where} "
        f"({run.error_max_jnd:.2g} JND, {run.build_s:.2g} s, "
        f"{run.query_s_per_million:.2g} s/10⁶, {run.memory_bytes:,} B)"
    )
