"""Draw a figure's data: axes, legends that hide no curve, and the caption below them."""

from __future__ import annotations

import io
import re
from textwrap import wrap
from typing import Any

from haptix.errors import from_extra
from haptix.figures.data import FigureData

with from_extra("figures"):
    import matplotlib
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.layout_engine import ConstrainedLayoutEngine
    from matplotlib.ticker import NullFormatter

_DPI = 200
# Width and height of the panels and their legend, by rows and columns of panels.
_SIZE_IN = {(1, 1): (6.9, 3.7), (1, 2): (10.4, 3.7), (2, 1): (7.2, 4.6)}
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
    "lines.linewidth": 1.8,
    "xtick.direction": "in",
    "ytick.direction": "in",
    "xtick.top": True,
    "ytick.right": True,
}


def mark(axes: Axes, x: float, y: float, shape: str, label: str, color: str) -> None:
    """Draw one point of note; points with one label share their line in the legend."""
    hollow = shape == "o"
    axes.plot(
        x, y, shape, ms=6, mfc="white" if hollow else color, mec=color,
        mew=1.4 if hollow else 0.6, clip_on=False, zorder=4,
    )  # fmt: skip
    if label not in axes.get_legend_handles_labels()[1]:
        face = "white" if hollow else "0.3"
        axes.plot([], [], shape, ms=6, mfc=face, mec="0.3", mew=1.2, label=label)


def draw(data: FigureData) -> Figure:
    """Return the drawing of a figure."""
    width, height = _SIZE_IN[data.grid]
    lines = wrap(
        _TOGETHER.sub("\N{NO-BREAK SPACE}", data.caption),
        round(width * _LETTERS_PER_IN),
        break_on_hyphens=False,
    )
    below = _LINE_IN * (len(lines) + 1)
    share = height / (height + below)
    with matplotlib.rc_context(_STYLE):
        layout = ConstrainedLayoutEngine(rect=(0, 1 - share, 1, share))
        figure = Figure(figsize=(width, height + below), layout=layout)
        axes = figure.subplots(*data.grid, squeeze=False, sharex="col").ravel()
        data.plot(*axes)
        for one in axes:
            one.xaxis.set_minor_formatter(NullFormatter())
            one.yaxis.set_minor_formatter(NullFormatter())
        axes[-1].legend(
            loc="upper left",
            bbox_to_anchor=(1.01, 1.02),  # beside the axes, where it hides nothing
            title=data.legend_title or None,
            frameon=False,
            alignment="left",
            handlelength=1.8,
        )
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
