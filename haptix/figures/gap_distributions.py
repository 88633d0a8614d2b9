"""Distributions of the gap between finger and screen, in both forms of the theory."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import torch

from haptix.contact import GapDistribution
from haptix.figures.data import COLD_TO_HOT, FigureData, numbers, placeholders
from haptix.finger import Finger
from haptix.friction import ContactModel
from haptix.screen import Screen

if TYPE_CHECKING:
    from matplotlib.axes import Axes

PRESSURES_PA = (3e3, 20e3, 200e3)
"""The paper's range of nominal pressure, and what an attraction near pull-in makes of it."""

_FORMS: dict[GapDistribution, str] = {"plain": "-", "combined": "--"}
_COLORS = (COLD_TO_HOT[0], COLD_TO_HOT[2], COLD_TO_HOT[4])
_GAP_M = np.geomspace(1e-10, 3e-4, 400)


def gap_distributions(finger: Finger | None = None) -> FigureData:
    """P(u) of the open gaps, "plain" and "combined", at a few effective pressures.

    The finger is the semi-wet one unless another is given.
    """
    finger = finger or Finger.preset("semi-wet")
    screen = Screen.preset("3m-sct3250")
    terms = {"skin-dielectric": False, "apparent-area": False}  # pressure is given, not force
    pressure = torch.tensor(PRESSURES_PA, dtype=torch.float64)[:, None]
    columns = {"gap_um": _GAP_M * 1e6}
    densities = []
    for form in _FORMS:
        model = ContactModel(finger, screen, gap_distribution=form, terms=terms)
        density = numbers(model.contact.gap_density(pressure, torch.from_numpy(_GAP_M))) * 1e-6
        densities.append(density)
        for row, pressure_pa in zip(density, PRESSURES_PA, strict=True):
            columns[f"density_{form}_{pressure_pa / 1e3:g}kpa_per_um"] = row

    def plot(axes: Axes) -> None:
        for (form, style), density in zip(_FORMS.items(), densities, strict=True):
            for row, pressure_pa, color in zip(density, PRESSURES_PA, _COLORS, strict=True):
                label = f"{pressure_pa / 1e3:g} kPa, {form}"
                axes.plot(columns["gap_um"], row, style, color=color, label=label)
        axes.set(xlabel="gap $u$ (µm)", xscale="log", xlim=(1e-4, 300))
        axes.set(ylabel="$P(u)$ (1/µm)", yscale="log", ylim=(1e-5, 10))

    between = (_GAP_M >= 1e-9) & (_GAP_M <= 1e-5)
    plain, combined = (density[:, between] for density in densities)
    apart = float(np.abs(combined / plain - 1).max())
    caption = (
        "Probability density of the gap u between finger and screen at effective pressures of "
        f"{', '.join(f'{p / 1e3:g}' for p in PRESSURES_PA)} kPa, contact spots excluded: each "
        "curve integrates to 1 - A/A0. Solid: plain, each strip of area has the variance of the "
        "shorter waves (Almqvist et al. 2011); dashed: combined with the strip's own mean gap "
        "(later papers). Nothing is drawn below 0.1 nm, less than an atom, where a gap has no "
        f"sense. From 1 nm to 10 µm they differ by at most {apart:.0%}. Below 1e-5 per "
        "µm the far tail shows the single strips into which the contact is divided. "
        f"{placeholders(model)} Terms on: {', '.join(sorted(model.terms))}; gamma "
        f"{model.contact.gamma:g}."
    )
    title, legend = "Distribution of the gap between finger and screen", "pressure, form"
    return FigureData("gaps", title, caption, columns, plot, legend_title=legend)
