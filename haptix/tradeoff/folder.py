"""Files of a tradeoff: CSV, JSON, and the plot of error against time and memory."""

from __future__ import annotations

import io
from pathlib import Path
from textwrap import wrap

from haptix.errors import from_extra
from haptix.files import check_folder, csv_text, json_text, write_folder
from haptix.scene import Scene
from haptix.tradeoff.run import Progress, Tradeoff, machine, run_tradeoff
from haptix.tradeoff.settings import COSTS
from haptix.version import __version__

with from_extra("figures"):
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.layout_engine import ConstrainedLayoutEngine
    from matplotlib.lines import Line2D
    from matplotlib.ticker import LogLocator, NullFormatter

_FILES = ("tradeoff.csv", "tradeoff.png", "tradeoff.json")

_COLORS = {
    "mean-field": "tab:blue",
    "closed-form": "tab:orange",
    "boundary-element": "tab:purple",
    "planned": "tab:red",
}
_SHAPES = {"surface": "o", "slice": "s"}
_DPI = 150

_LABELS = {
    "build": "build time [s]",
    "query": "query time [s per million]",
    "memory": "memory [bytes]",
}


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
    """Draw error against build time, query time and memory, with fronts and the scene's budget."""
    layout = ConstrainedLayoutEngine(rect=(0, 0.08, 1, 0.92))
    figure = Figure(figsize=(13, 5.2), layout=layout)
    panels = figure.subplots(1, len(COSTS), sharey=True)
    for axes, name in zip(panels, COSTS, strict=True):
        _panel(axes, tradeoff, name)
        title = f"Error against {_LABELS[name].partition(' [')[0]}"
        axes.set(xlabel=_LABELS[name], xscale="log", yscale="log", title=title)
        for axis in (axes.xaxis, axes.yaxis):
            low, high = axis.get_view_interval()
            # Times often span less than a decade: powers of ten alone would leave them unlabelled.
            axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if high < 100 * low else (1.0,)))
            axis.set_major_formatter("{x:g}")
            axis.set_minor_formatter(NullFormatter())
        axes.grid(which="major", color="0.9", lw=0.7)
        axes.set_axisbelow(True)
    panels[0].set_ylabel("largest error [JND]")
    figure.legend(
        handles=_legend(tradeoff), loc="outside right upper", frameon=False, alignment="left"
    )
    figure.text(0.01, 0.01, _caption(tradeoff), fontsize=8, color="0.3", va="bottom")
    return figure


def _panel(axes: Axes, tradeoff: Tradeoff, name: str) -> None:
    cost = COSTS[name]
    for run in tradeoff.runs:
        color = _COLORS[run.setting.model]
        is_planned = run.setting.model == "planned"
        axes.plot(
            cost(run),
            run.error.thresholds_max,
            "*" if is_planned else _SHAPES[run.setting.form],
            ms=13 if is_planned else 6,
            mfc=color if run.setting.dtype == "float32" else "white",
            mec="black" if run.setting.device != "cpu" else color,
            mew=1.3,
            zorder=4 if is_planned else 3,
        )
    front = sorted(
        (cost(run), run.error.thresholds_max) for run in tradeoff.runs if name in run.fronts
    )
    axes.step(*zip(*front, strict=True), where="post", color="0.4", lw=1.2, zorder=2)
    axes.axhline(tradeoff.scene.budget_thresholds, color="tab:green", ls="--", lw=1.2, zorder=1)


def _legend(tradeoff: Tradeoff) -> list[Line2D]:
    def mark(shape: str, color: str, label: str, filled: bool = True, edge: str = "") -> Line2D:
        return Line2D(
            [], [], ls="", marker=shape, ms=7, mec=edge or color, mew=1.3, label=label,
            mfc=color if filled else "white",
        )  # fmt: skip

    handles = [
        mark("o", _COLORS["mean-field"], "mean field, all terms"),
        mark("o", _COLORS["closed-form"], "closed form"),
    ]
    if any(run.setting.model == "boundary-element" for run in tradeoff.runs):
        handles.append(mark("o", _COLORS["boundary-element"], "boundary elements"))
    handles += [
        mark("*", _COLORS["planned"], "as planned"),
        mark("o", "0.3", "whole surface"),
        mark("s", "0.3", "slice at one frequency"),
        mark("o", "0.3", "float32"),
        mark("o", "0.3", "float64", filled=False),
    ]
    if any(run.setting.device != "cpu" for run in tradeoff.runs):
        handles.append(mark("o", "0.8", "on the GPU", edge="black"))
    return [
        *handles,
        Line2D([], [], color="0.4", lw=1.2, label="no other is better in both"),
        Line2D([], [], color="tab:green", ls="--", lw=1.2, label="budget of the scene"),
    ]


def _caption(tradeoff: Tradeoff) -> str:
    what = machine()
    text = (
        f"{tradeoff.scene.name}. Errors against the mean field with every term, at "
        f"{tradeoff.points} held-out points, for a slice at its own frequency and h0; times "
        f"in batches of {tradeoff.batch:,} on "
        f"{what['threads']} thread(s) of {what['processor']}"
        + (f" and {what['gpu']}" if what["gpu"] else "")
        + f", torch {what['torch']}. Planning itself took {tradeoff.plan_s:.2g} s."
    )
    return "\n".join(wrap(text, 190))
