"""Contact area against pressure at several voltages, against boundary elements (paper, Fig. 2D)."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import torch

from haptix.contact import THEORIES, HalfSpace, RoughnessSpectrum, Theory
from haptix.electro import Pull
from haptix.fidelity import Contact, Load, MeanFieldBalance
from haptix.figures.data import COLD_TO_HOT, Array, FigureData

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# What 512 x 512 points can hold with eight of them per shortest wavelength: 1 um of roughness on
# skin of 40 MPa, not a whole finger.
SPECTRUM = RoughnessSpectrum.self_affine(1e-6, 0.8, 22.5e3, 90e3, 1.44e6)
SKIN = HalfSpace(40e6, 0.5)
H0_M = 0.2e-6
PRESSURES_PA = (3e3, 1e4, 3e4, 1e5, 3e5, 1e6)
VOLTAGES_V = (0.0, 50.0, 100.0, 150.0, 200.0)

_BOUNDARY_ELEMENTS = Path(__file__).with_name("fig2d_boundary_elements.csv")
_LINES = {"as-published": "--", "corrected": "-"}
_PRESSURE_PA = np.geomspace(2e3, 1.5e6, 121)


def area_against_pressure() -> FigureData:
    """A/A0 against p0 from 2 kPa to 1.5 MPa at 0 to 200 V: two theories, boundary elements."""
    table = np.loadtxt(_BOUNDARY_ELEMENTS, delimiter=",", skiprows=1)
    solved = {(p, voltage): (area, scatter) for p, voltage, _, area, scatter in table}
    columns: dict[str, Array] = {"pressure_pa": np.concatenate([_PRESSURE_PA, PRESSURES_PA])}
    no_line = np.full_like(_PRESSURE_PA, np.nan)
    no_points = np.full(len(PRESSURES_PA), np.nan)
    for voltage in VOLTAGES_V:
        for name in _LINES:
            area = _area(THEORIES[name], voltage)
            columns[f"area_fraction_{name}_{voltage:g}v"] = np.concatenate([area, no_points])
        points = np.array([solved.get((p, voltage), (np.nan, np.nan)) for p in PRESSURES_PA])
        column = f"area_fraction_boundary_elements_{voltage:g}v"
        columns[column] = np.concatenate([no_line, points[:, 0]])
        columns[f"{column}_scatter"] = np.concatenate([no_line, points[:, 1]])

    def plot(axes: Axes) -> None:
        pressure = columns["pressure_pa"]
        for voltage, color in zip(VOLTAGES_V, COLD_TO_HOT, strict=False):
            for name, style in _LINES.items():
                area = columns[f"area_fraction_{name}_{voltage:g}v"]
                label = f"{voltage:g} V" if name == "corrected" else None
                axes.plot(pressure, area, style, color=color, label=label)
            column = f"area_fraction_boundary_elements_{voltage:g}v"
            axes.errorbar(
                pressure, columns[column], columns[f"{column}_scatter"], fmt="o", color=color,
                ms=4, elinewidth=1.5, capsize=2, zorder=4,
            )  # fmt: skip
        for name, style in _LINES.items():
            axes.plot([], [], style, color="0.35", label=name.replace("-", " "))
        axes.errorbar([], [], [], fmt="o", color="0.35", ms=4, label="boundary\nelements")
        axes.set(xlabel="applied pressure $p_\\mathrm{0}$ (Pa)", ylabel="$A/A_\\mathrm{0}$")
        axes.set(xscale="log", yscale="log", xlim=(2e3, 1.5e6))

    return FigureData(
        name="fig2d",
        title="Contact area against pressure, by theory and by boundary elements",
        caption=(
            "Real over apparent contact area against applied pressure p0 at voltages of 0 to 200 V "
            f"and h0 = {H0_M * 1e6:g} µm. Circles: boundary elements, the attraction acting on "
            "every point, mean and standard deviation over random surfaces "
            "(benchmarks/figure_2d.py). Dashed: the mean field as published, whose contact spots "
            "attract too; solid: corrected, as all else uses it (docs/mean-field.md). A line ends "
            f"where its light contact does. Placeholder of a finger: half-space of "
            f"40 MPa, {SPECTRUM.statement()}, which is what the grid can hold."
        ),
        columns=columns,
        plot=plot,
    )


def _area(theory: Theory, voltage_v: float) -> Array:
    contact = theory.mean_field(SPECTRUM, SKIN)
    applied = torch.from_numpy(_PRESSURE_PA)
    solver = MeanFieldBalance(Contact(contact, theory.contact_spots, None, float(applied[0])))
    pull = Pull.of_sine(
        contact.gap_edges_m,
        torch.full_like(applied, voltage_v),
        torch.tensor([H0_M], dtype=torch.float64),
        torch.zeros(len(applied), dtype=torch.long),
    )
    found = solver.solve(Load(applied, pull))
    return np.where(found.is_stable.numpy(), found.area_fraction.numpy(), np.nan)
