"""What a figure is: columns of numbers, a caption, and how the columns are drawn."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt
from torch import Tensor

from haptix.errors import InputError
from haptix.friction import ContactModel
from haptix.status import Status

Array = npt.NDArray[np.float64]
Scale = Literal["linear", "log"]

COLD_TO_HOT = ("#4477aa", "#66a9c9", "#228833", "#ccaa22", "#ee6677", "#882255")
"""Colours of a family of curves, told apart by the colour-blind too (after P. Tol)."""


@dataclass(frozen=True)
class Curve:
    """One line: a column against another; cells without a number leave a gap.

    With `error`, a column of standard deviations, they are points with error bars.
    """

    x: str
    y: str
    label: str = ""
    color: str = "black"
    style: str = "-"
    width: float = 1.8
    error: str = ""


@dataclass(frozen=True)
class Mark:
    """One point of note; marks with one label share their line in the legend."""

    x: float
    y: float
    shape: str
    label: str
    color: str = "black"


@dataclass(frozen=True)
class Panel:
    """Axes with their curves and marks.

    Parameters
    ----------
    x_label, y_label : str
        What the axes show, with unit.
    curves : tuple of Curve
        Lines.
    marks : tuple of Mark
        Points on top of them.
    x_scale, y_scale : {"linear", "log"}
        Scales of the axes.
    x_range, y_range : (float, float), optional
        Ends of the axes; without, those of the data.
    has_legend : bool
        Whether the curves' labels stand beside the axes.
    legend_title : str
        What the labels are values of.
    """

    x_label: str
    y_label: str
    curves: tuple[Curve, ...]
    marks: tuple[Mark, ...] = ()
    x_scale: Scale = "linear"
    y_scale: Scale = "linear"
    x_range: tuple[float, float] | None = None
    y_range: tuple[float, float] | None = None
    has_legend: bool = True
    legend_title: str = ""


@dataclass(frozen=True)
class FigureData:
    """One figure.

    Parameters
    ----------
    name : str
        Stem of its files.
    title : str
        One line.
    caption : str
        What is shown, for which set-up, and what the numbers rest on.
    columns : mapping of str to array, shape (rows,)
        Numbers by name with unit. A state past the light contact has NaN, and says so in a column
        of `haptix.Status`.
    panels : tuple of Panel
        How to draw them, side by side.
    stacked : bool
        Draw the panels one above the other, with a common x axis.

    Raises
    ------
    InputError
        If columns differ in length, or a curve names one that does not exist.
    """

    name: str
    title: str
    caption: str
    columns: Mapping[str, Array]
    panels: tuple[Panel, ...]
    stacked: bool = False

    def __post_init__(self) -> None:
        shapes = {column.shape for column in self.columns.values()}
        if len(shapes) != 1 or any(len(shape) != 1 for shape in shapes):
            raise InputError(f"{self.name}: expected columns of one length, got shapes {shapes}")
        named = {
            name for panel in self.panels for c in panel.curves for name in (c.x, c.y, c.error)
        } - {""}
        if missing := named - set(self.columns):
            raise InputError(f"{self.name}: no column {', '.join(sorted(missing))}")


def numbers(values: Tensor) -> Array:
    """Values of a tensor as a column."""
    return np.asarray(values.detach().cpu().numpy(), dtype=float)


def light_contact(values: Tensor, status: Tensor) -> Array:
    """Values as a column, NaN where the contact has snapped in and no light one exists."""
    return np.where(numbers(status) == Status.PULL_IN, np.nan, numbers(values))


def sentence_list(words: list[str]) -> str:
    """Join words as in a sentence: "a, b and c"."""
    return " and ".join(filter(None, [", ".join(words[:-1]), *words[-1:]]))


def placeholders(model: ContactModel) -> str:
    """Sentence for a caption: the unmeasured values."""
    found = model.placeholders()
    if not found:
        return "No placeholders: all values are measured."
    return f"Placeholders, not measured: {sentence_list(found)}."


def basis(model: ContactModel, also_on: str = "") -> str:
    """Sentences for a caption: what a model's numbers rest on.

    Parameters
    ----------
    model : ContactModel
        The model.
    also_on : str
        Terms that are on for some of the curves only, and for which.
    """
    on = ", ".join(filter(None, [*sorted(model.terms), also_on]))
    spots = {
        "excluded": "Contact spots are excluded from the attraction: only open gaps attract",
        "included": "Contact spots are included in the attraction",
    }[model.contact_spots]
    return (
        f"{placeholders(model)} Terms on: {on}. {spots}; gap distribution "
        f"{model.contact.gap_distribution}, gamma {model.contact.gamma:g}."
    )
