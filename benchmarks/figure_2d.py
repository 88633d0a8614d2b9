"""Solve the boundary elements of figure 2D, the marks that examples/paper_figures.py draws.

    python benchmarks/figure_2d.py

Writes examples/paper_figures_2d.csv; minutes on two cores. The roughness is that of
set S1 of the reference: what a grid of 512 x 512 can hold, not a whole finger.
"""

from __future__ import annotations

import csv
import sys
from pathlib import Path

import torch

from haptix.model.contact.boundary_elements import BoundaryElements, Surfaces
from haptix.model.electro import VACUUM_PERMITTIVITY
from haptix.model.status import Status

sys.path.insert(0, str(Path(__file__).parents[1] / "examples"))
from paper_figures import (
    BOUNDARY_ELEMENTS,
    H0_M,
    PRESSURES_PA,
    SKIN,
    SPECTRUM,
    VOLTAGES_V,
)

POINTS, SURFACES, SEED = 512, 6, 2


def main() -> None:
    """Solve all surfaces, and write the CSV."""
    surfaces = Surfaces.random(SPECTRUM, POINTS, surfaces=SURFACES, seed=SEED)
    model = BoundaryElements(surfaces, SKIN)
    strengths = torch.tensor(VOLTAGES_V, dtype=torch.float64) ** 2
    solved = model.solve_attracted(
        PRESSURES_PA,
        lambda gap_m: VACUUM_PERMITTIVITY / 4 / (gap_m + H0_M) ** 2,
        strengths,
        progress=_report,
    )
    with BOUNDARY_ELEMENTS.open("w", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["pressure_pa", "voltage_v", "surfaces", "area_fraction", "scatter"])
        for i, pressure in enumerate(PRESSURES_PA):
            for j, voltage in enumerate(VOLTAGES_V):
                light = (solved.status[i, j] == int(Status.OK)) & solved.converged[i, j]
                area = solved.area_fraction[i, j][light]
                if len(area) >= 2:
                    values = (float(area.mean()), float(area.std()))
                    writer.writerow([pressure, voltage, len(area), *(f"{v:.6g}" for v in values)])


def _report(done: int, total: int) -> None:
    sys.stderr.write(f"{done} of {total} surfaces\n")


if __name__ == "__main__":
    main()
