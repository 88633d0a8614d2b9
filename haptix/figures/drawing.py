"""Draw a figure's data: axes, legends that hide no curve, and the caption below them."""

from __future__ import annotations

import io
import re
from textwrap import wrap
from typing import Any

import matplotlib
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.ticker import NullFormatter

from haptix.figures.data import FigureData, Panel

_DPI = 200
_PANEL_IN = (4.4, 3.7)  # width, height
_LOW_PANEL_IN = 2.3  # height of each of several stacked panels
_LEGEND_IN = 1.6
_CAPTION_POINTS = 8.0
_LINE_IN = 1.35 * _CAPTION_POINTS / 72
_LETTERS_PER_IN = 16.3  # of the caption's font, on average

_TOGETHER = re.compile(r"(?<= =) | (?==)|(?<=\d) (?=[NVµkM]|Hz|Ohm)")  # spaces not to break at

_STYLE: dict[Any, Any] = {
    "font.size": 10.5,
    "axes.labelsize": 11.5,
    "legend.fontsize": 9.5,
    "legend.title_fontsize": 9.5,
    "axes.linewidth": 0.9,
    "xtick.direction": "in",
    "ytick.direction": "in",
    "xtick.top": True,
    "ytick.right": True,
}


def draw(data: FigureData) -> Figure:
    """Return the drawing of a figure."""
    with matplotlib.rc_context(_STYLE):
        count = len(data.panels)
        legends = [panel.has_legend for panel in data.panels]
        if data.stacked:
            width = _PANEL_IN[0] + 1.2 + _LEGEND_IN * any(legends)
            height = _LOW_PANEL_IN * count
        else:
            width = (_PANEL_IN[0] + (0.9 if count == 1 else 0.0)) * count + _LEGEND_IN * sum(
                legends
            )
            height = _PANEL_IN[1]
        lines = wrap(
            _TOGETHER.sub("\N{NO-BREAK SPACE}", data.caption), round(width * _LETTERS_PER_IN)
        )
        below = _LINE_IN * (len(lines) + 1)
        share = height / (height + below)
        layout = ConstrainedLayoutEngine(rect=(0, 1 - share, 1, share))
        figure = Figure(figsize=(width, height + below), layout=layout)
        axes = figure.subplots(
            *((count, 1) if data.stacked else (1, count)), squeeze=False, sharex=data.stacked
        ).ravel()
        for one, panel in zip(axes, data.panels, strict=True):
            _panel(one, panel, data)
        if data.stacked:
            for one in axes[:-1]:
                one.set_xlabel("")
        figure.text(
            0.1 / width,
            (below - 0.5 * _LINE_IN) / (height + below),
            "\n".join(lines),
            ha="left",
            va="top",
            fontsize=_CAPTION_POINTS,
            linespacing=1.15,
            color="0.2",
        )
        return figure


def png(data: FigureData) -> bytes:
    """PNG of the drawing; its metadata carry title and caption."""
    file = io.BytesIO()
    metadata = {"Title": data.title, "Description": data.caption}
    with matplotlib.rc_context(_STYLE):
        draw(data).savefig(file, format="png", dpi=_DPI, metadata=metadata)
    return file.getvalue()


def _panel(axes: Axes, panel: Panel, data: FigureData) -> None:
    for curve in panel.curves:
        if curve.error:
            axes.errorbar(
                data.columns[curve.x],
                data.columns[curve.y],
                data.columns[curve.error],
                fmt=curve.style,
                color=curve.color,
                ms=4,
                capsize=2,
                zorder=4,
            )
            continue
        axes.plot(
            data.columns[curve.x],
            data.columns[curve.y],
            curve.style,
            color=curve.color,
            lw=curve.width,
            zorder=2 + curve.width / 10,  # thin lines under thick ones
            label=curve.label or None,
        )
    labelled = set()
    for mark in panel.marks:
        axes.plot(
            mark.x, mark.y, mark.shape, ms=6, mfc="white" if mark.shape == "o" else mark.color,
            mec=mark.color, mew=1.4 if mark.shape == "o" else 0.6, clip_on=False, zorder=4,
        )  # fmt: skip
        if mark.label not in labelled:
            labelled.add(mark.label)
            face = "white" if mark.shape == "o" else "0.3"
            axes.plot([], [], mark.shape, ms=6, mfc=face, mec="0.3", mew=1.2, label=mark.label)
    axes.set(xlabel=panel.x_label, ylabel=panel.y_label, xscale=panel.x_scale, yscale=panel.y_scale)
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_minor_formatter(NullFormatter())
    if panel.x_range is not None:
        axes.set_xlim(*panel.x_range)
    if panel.y_range is not None:
        axes.set_ylim(*panel.y_range)
    if panel.has_legend:
        axes.legend(
            loc="upper left",
            bbox_to_anchor=(1.01, 1.02),  # beside the axes, where it hides nothing
            title=panel.legend_title or None,
            frameon=False,
            alignment="left",
            handlelength=1.8,
        )
