"""The report of an analysis: tables, and a picture of each group and each run."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import isnan
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from haptix.errors import MissingExtraError, from_extra
from haptix.files import json_text, write_folder
from haptix.report import page, paragraph, picture, table
from haptix.stimuli.adaptive import Magnitudes, Pairs, UpDown
from haptix.stimuli.adaptive.evidence import counted
from haptix.stimuli.adaptive.psychometric import function_named
from haptix.stimuli.analysis.results import Analysis
from haptix.stimuli.analysis.runs import RunOfMethod
from haptix.stimuli.analysis.scales import ALL
from haptix.stimuli.study_files import BIDS_VERSION
from haptix.version import __version__

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MOST_PICTURES = 100
"""Of runs; those after them are in the tables alone."""

_INTERVAL = 0.95


def report_html(analysis: Analysis, title: str) -> str:
    """Return the page; without the extra ``stimuli`` it has no pictures, and says so."""
    parts = [paragraph(line) for line in (f"haptix {__version__}", *analysis.notes)]
    parts += [table(name, rows) for name, rows in analysis.tables.items()]
    drawn = [run for run in analysis.runs if run.rows]
    try:
        parts += [picture(name, figure) for name, figure in _of_groups(analysis)]
        parts += [picture(_name(run), _of_run(run)) for run in drawn[:MOST_PICTURES]]
    except MissingExtraError as error:
        parts.append(paragraph(f"Without pictures: {error}"))
    if len(drawn) > MOST_PICTURES:
        parts.append(paragraph(f"{len(drawn) - MOST_PICTURES} more runs are in the tables alone."))
    return page(title, parts)


def write_analysis(
    analysis: Analysis, out: str | Path, title: str, of_study: bool = False
) -> list[Path]:
    """Write each table as NAME.tsv, and the report; those of an earlier analysis are replaced.

    Parameters
    ----------
    analysis : Analysis
        What is written.
    out : path
        Folder.
    title : str
        Of the report.
    of_study : bool
        Describe the folder as a data set of its own that was derived from another (BIDS).
    """
    files: dict[str, str] = {}
    if of_study:
        about = {
            "Name": f"Analysis of {title}",
            "BIDSVersion": BIDS_VERSION,
            "DatasetType": "derivative",
            "GeneratedBy": [{"Name": "haptix", "Version": __version__}],
        }
        files["dataset_description.json"] = json_text(about)
    for name, rows in analysis.tables.items():
        lines = [list(rows[0]), *([_cell(value) for value in row.values()] for row in rows)]
        files[f"{name}.tsv"] = "".join("\t".join(line) + "\n" for line in lines)
    files["report.html"] = report_html(analysis, title)
    return write_folder(Path(out), files)


def _cell(value: Any) -> str:
    """Text of a cell as BIDS has it; the shortest number that reads the same."""
    return "n/a" if value in (None, "") else " ".join(str(value).split())


def _name(run: RunOfMethod) -> str:
    return " ".join(filter(None, (run.session.name, run.session.task, run.condition)))


def _axes(count: int, title: str) -> tuple[Figure, Sequence[Any]]:
    with from_extra("stimuli"):
        from matplotlib.figure import Figure

    figure = Figure(figsize=(4.2 * count, 3.2), layout="constrained")
    figure.suptitle(title)
    return figure, [figure.add_subplot(1, count, k + 1) for k in range(count)]


def _of_groups(analysis: Analysis) -> Iterator[tuple[str, Figure]]:
    """Thresholds of all participants; scales of all."""
    rows = analysis.tables.get("thresholds", [])
    for group in analysis.tables.get("group", []):
        keys = ("task", "condition", "experiment")
        own = [row for row in rows if all(row[key] == group[key] for key in keys)]
        own = [row for row in own if row["threshold_db"] is not None]
        if len(own) < 2:
            continue
        figure, (axes,) = _axes(1, "")
        names = [row["participant"] for row in own]
        axes.errorbar(
            [row["threshold_db"] for row in own], names,
            xerr=[row["spread_db"] or 0.0 for row in own], fmt="o", capsize=3,
        )  # fmt: skip
        if group["low"] is not None:
            axes.axvspan(group["low"], group["high"], alpha=0.2)
            axes.axvline(group["threshold_db"])
        axes.set(xlabel="threshold [dB]; the band: mean with its 95 % interval")
        yield " ".join(filter(None, ("thresholds", group["task"], group["condition"]))), figure
    for name, column in (("scales", "scale_logit"), ("magnitudes", "mean")):
        listed = analysis.tables.get(name, [])
        for condition in dict.fromkeys((row["condition"], row["experiment"]) for row in listed):
            figure, (axes,) = _axes(1, "")
            own = [row for row in listed if (row["condition"], row["experiment"]) == condition]
            for who in dict.fromkeys((row["participant"], row["session"]) for row in own):
                line = [row for row in own if (row["participant"], row["session"]) == who]
                axes.plot(
                    [row["level_db"] for row in line], [row[column] for row in line],
                    "o-", linewidth=3 if who[0] == ALL else 1, label=who[0],
                )  # fmt: skip
            axes.set(xlabel="level [dB]", ylabel=column.replace("_", " "))
            if name == "magnitudes":
                axes.set_yscale("log")
            axes.legend(fontsize="small")
            yield " ".join(filter(None, (name, condition[0]))), figure


def _of_run(run: RunOfMethod) -> Figure:
    """Levels trial by trial; and against them the share right, or the numbers."""
    levels = np.array([float(row["level"]) for row in run.rows])
    trials = np.array([int(row["trial"]) for row in run.rows])
    if isinstance(run.method, Pairs | Magnitudes):
        figure, (axes,) = _axes(1, "")
        axes.plot(trials, levels, ".")
        axes.set(xlabel="trial", ylabel="level [dB]")
        return figure
    right = np.array([row["is_right"] == "true" for row in run.rows])
    figure, (walk, shares) = _axes(2, "")
    walk.plot(trials, levels, "-", color="0.7")
    walk.plot(trials[right], levels[right], "o", markersize=4, label="right")
    walk.plot(trials[~right], levels[~right], "x", markersize=5, label="wrong")
    walk.set(xlabel="trial", ylabel="level [dB]")
    walk.legend(fontsize="small")
    _draw_shares(shares, run, [*zip(levels.tolist(), right.tolist(), strict=True)])
    return figure


def _draw_shares(axes: Any, run: RunOfMethod, answers: list[tuple[float, bool]]) -> None:
    """Share right at each level with Wilson's interval, and the function where it was fitted."""
    from scipy.stats import binomtest

    at, right, wrong = counted(answers)
    total = right + wrong
    low, high = np.array(
        [
            binomtest(int(k), int(n)).proportion_ci(_INTERVAL, "wilson")
            for k, n in zip(right, total, strict=True)
        ]
    ).T
    share = right / total
    bounds = np.clip([share - low, high - share], 0, None)
    axes.errorbar(at, share, bounds, fmt="none", color="0.6")
    axes.scatter(at, share, 10 + 4 * total)
    found, method = run.found, run.method
    if not isnan(found.threshold):
        if not isnan(found.spread):
            ends = found.threshold - found.spread, found.threshold + found.spread
            axes.axvspan(*ends, alpha=0.2, lw=0)
        axes.axvline(found.threshold)
        if isinstance(method, UpDown):
            axes.axhline(method.target, linestyle=":")
        elif "slope" in found.others:
            fixed = {
                name: found.others.get(name, getattr(method, name, 0.0))
                for name in ("guess", "lapse")
            }
            x = np.linspace(at.min(), at.max(), 200)
            curve = function_named(getattr(method, "function", "weibull"))
            axes.plot(x, curve(x, found.threshold, found.others["slope"], **fixed))
    axes.set(xlabel="level [dB]", ylabel="share right", ylim=(-0.05, 1.05))
