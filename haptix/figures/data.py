"""A figure: columns of numbers, a caption, and a function that draws the columns."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from torch import Tensor

from haptix.electro.breakdown import NARROW_GAP_FIELD_V_PER_M
from haptix.friction import ContactModel
from haptix.status import Status

Array = npt.NDArray[np.float64]

H0_M = 0.2e-6
"""d1/eps1 + d2/eps2 of the paper at 125 Hz, for figures at one frequency."""
AT_H0 = {"skin-dielectric": False, "breakdown": True}
"""Terms that differ from the usual ones where h0 is given: the skin is in it."""
AS_QUERIED = (
    "`haptix query --h0-m 2e-7 --with breakdown` gives the same friction at the mean attraction."
)

COLD_TO_HOT = ("#4477aa", "#66a9c9", "#228833", "#ccaa22", "#ee6677", "#882255")
"""Colours of a family of curves, distinct for the colour-blind too (after P. Tol)."""

NARROW_GAPS_BEAR = f"the {NARROW_GAP_FIELD_V_PER_M / 1e6:g} V/µm that narrow gaps withstand"
"""For captions: the field above which sparks are expected."""


@dataclass(frozen=True)
class FigureData:
    """A figure: its numbers, caption and drawing function."""

    name: str
    """Stem of its files."""
    title: str
    caption: str
    """Content, set-up, and what the numbers rest on."""
    columns: Mapping[str, Array]
    """Numbers by name with unit, each of shape (rows,). A state past the light contact has NaN, and
    says so in a column of `haptix.Status`."""
    plot: Callable[..., None]
    """Draws on the matplotlib axes of the panels, which are its arguments."""
    grid: tuple[int, int] = (1, 1)
    """Rows and columns of panels. Rows share their x axis."""
    legend_title: str = ""
    """Title of the legend, which stands beside the last panel."""


def numbers(values: Tensor) -> Array:
    """Values of a tensor as a column."""
    return np.asarray(values.cpu(), dtype=float)


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
    """Return sentences for a caption: the assumptions behind a model's numbers.

    `also_on` names terms that are on for some of the curves only, and for which.
    """
    on = ", ".join(filter(None, [*sorted(model.terms), also_on]))
    return (
        f"{placeholders(model)} Terms on: {on}. Contact spots in the attraction: "
        f"{model.contact_spots}; gap distribution {model.contact.gap_distribution}, gamma "
        f"{model.contact.gamma:g}."
    )
