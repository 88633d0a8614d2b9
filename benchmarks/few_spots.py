"""Boundary elements of contacts with few spots: boxes of 4 to 64 roll-off waves, growing bands.

    PYTHONPATH=benchmarks haptix campaign benchmarks/campaigns/few-spots.toml --out few-spots
    python benchmarks/few_spots.py few-spots

Each cell of the grid is a solid, a box and a band; its surfaces of one seed have the same long
waves in every band. Loads are x_long = p/(E* slope) of the waves up to 16 q_r, each wave with its
own modulus. Each surface is a task of a campaign, the most wanted cells first. The second command
writes the means over surfaces to tests/data/few-spots.csv, with "fit" for rows that the theory
"corrected" was fitted to and "test" for others.
"""

from __future__ import annotations

import argparse
import csv
import warnings
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from math import pi, sqrt
from pathlib import Path
from typing import Any

import numpy as np
import torch

from haptix.base.files import csv_text, write_whole
from haptix.base.task import Context, Result, Task
from haptix.model.contact import HalfSpace, Layered, MeanField, RoughnessSpectrum, Theory
from haptix.model.contact.boundary_elements import BoundaryElements, Surfaces, estimated_bytes
from haptix.model.contact.boundary_elements.elements import corrected_area
from haptix.model.contact.boundary_elements.rough_surfaces import _on_grid
from haptix.model.contact.elasticity import ElasticSolid
from haptix.tasks.campaign import Campaign, CampaignTask

FILE = Path(__file__).parents[1] / "tests" / "data" / "few-spots.csv"
SEED = 16
Q_ROLLOFF, H_RMS = 2 * pi / 0.25e-3, 5e-6
LOADS = (2e-5, 5e-5, 1e-4, 3e-4, 1e-3, 3e-3, 1e-2)
H0 = (0.005, 0.01, 0.02, 0.05, 0.1, 0.3)  # over h_rms
QUANTILES = (0.001, 0.01, 0.03, 0.1, 0.2, 0.3, 0.5, 0.7, 0.9, 0.97)
LONG = 16  # q/q_r up to which waves count in x_long
PIXELS = 4  # in the shortest wave
WIDEST_BAND = 128
# Solids by name: thickness over the roll-off's 1/q, and E/E_bulk; the layer is of 40 MPa.
SOLIDS = {
    "half-space": (0.0, 1.0),
    "layer 0.3": (0.3, 4000.0),
    "layer 0.8": (0.8, 4000.0),
    "layer 3": (3.0, 4000.0),
    "layer 0.8 on E/100": (0.8, 100.0),
}
# Solid, waves, band: rows that were in view when the numbers of the theory were chosen.
FIT = {
    *(("half-space", 2, 16), ("half-space", 4, 16), ("half-space", 8, 16), ("half-space", 4, 64)),
    *(("layer 0.8", 4, 16), ("layer 0.8", 8, 16), ("layer 0.3", 4, 16)),
}
FIT_HURST = 0.86


@dataclass(frozen=True)
class Cell:
    """A solid, the roll-off waves along a side of the box, the band, and how many surfaces."""

    solid: str
    waves: int
    band: int
    surfaces: int = 12
    hurst: float = 0.86

    @property
    def use(self) -> str:
        """Whether the theory was fitted to its rows."""
        fit = (self.solid, self.waves, self.band) in FIT and self.hurst == FIT_HURST
        return "fit" if fit else "test"

    @property
    def modulus(self) -> ElasticSolid:
        """The solid."""
        thickness, contrast = SOLIDS[self.solid]
        if not thickness:
            return HalfSpace(4e7, 0.5)
        return Layered(4e7, 0.5, thickness / Q_ROLLOFF, 4e7 / contrast, 0.5)

    def spectrum(self, band: float | None = None) -> RoughnessSpectrum:
        """C(q) from the box's wave to the end of a band, with the same long waves in each."""
        q0 = Q_ROLLOFF / self.waves
        long = RoughnessSpectrum.self_affine(H_RMS, self.hurst, q0, Q_ROLLOFF, LONG * Q_ROLLOFF)
        q1 = (band or self.band) * Q_ROLLOFF
        q = torch.tensor([q0, Q_ROLLOFF, q1], dtype=torch.float64)
        low = float(long.density[0])
        falling = (q[2] / Q_ROLLOFF) ** (-2 * (1 + self.hurst))
        return RoughnessSpectrum(q, low * torch.stack([q[0] * 0 + 1, q[1] * 0 + 1, falling]))

    def contact(self, theory: Theory, h_rms: float) -> MeanField:
        """Mean field of surfaces whose h_rms, over `H_RMS`, is as drawn."""
        drawn = self.spectrum()
        density = drawn.density * (h_rms * H_RMS / float(drawn.h_rms_m)) ** 2
        return theory.mean_field(RoughnessSpectrum(drawn.wavenumber, density), self.modulus)

    def scale_pa(self) -> float:
        """``E* slope`` [Pa] of the waves up to `LONG` q_r, each with its own modulus."""
        spectrum = self.spectrum(LONG)
        edges = torch.logspace(0, 1, 4001, dtype=torch.float64)
        q = spectrum.q0 * edges ** np.log10(spectrum.q1 / spectrum.q0)
        q = q.clamp(spectrum.q0, spectrum.q1)
        density = 2 * pi * q**4 * spectrum(q) * self.modulus.effective_modulus(q) ** 2
        return sqrt(float(torch.trapezoid(density, torch.log(q))))

    def surface(self, number: int) -> Surfaces:
        """Draw the widest band, and take the waves of this one."""
        points = PIXELS * self.waves * self.band
        finest = 2 * self.waves * WIDEST_BAND
        side = 2 * pi * self.waves / Q_ROLLOFF
        drawn = Surfaces.random(self.spectrum(WIDEST_BAND), finest, side, 1, SEED + number)
        if points == 2 * finest:  # the widest band: all waves, on twice the points
            height = _on_grid(torch.fft.rfft2(drawn.height_m[0]) / finest**2, points)
        else:
            waves = torch.fft.rfft2(drawn.height_m[0]) / finest**2
            j = torch.fft.fftfreq(finest, 1 / finest, dtype=torch.float64)[:, None]
            i = torch.arange(finest // 2 + 1, dtype=torch.float64)
            waves = torch.where(torch.hypot(i, j) <= self.waves * self.band + 1e-6, waves, 0)
            height = _on_grid(waves, points)
        return Surfaces(height[None], side, drawn.q_low, self.band * Q_ROLLOFF, self.waves)


def grid() -> list[Cell]:
    """All cells, the most wanted first."""
    main, thin, thick, soft = "layer 0.8", "layer 0.3", "layer 3", "layer 0.8 on E/100"
    half = "half-space"
    cells = [Cell(half, 4, 16, 16), Cell(main, 4, 16), Cell(half, 2, 16), Cell(half, 8, 16, 6)]
    cells += [Cell(main, 8, 16, 4)]
    cells += [Cell(half, 4, 64, 6), Cell(thick, 4, 16, 6), Cell(thin, 4, 16, 6)]
    cells += [Cell(main, 4, 64, 4), Cell(main, 2, 16)]
    cells += [Cell(half, 4, 32, 6), Cell(main, 4, 32, 4), Cell(half, 4, 16, 6, 0.7)]
    cells += [Cell(soft, 4, 16, 6), Cell(main, 4, 16, 6, 0.7), Cell(half, 4, 128, 4)]
    cells += [Cell(thick, 8, 16, 4), Cell(thick, 4, 32, 4), Cell(half, 8, 32, 4)]
    # Not run: an hour each on one core, or several.
    cells += [Cell(thin, 8, 16, 4), Cell(thin, 4, 32, 4), Cell(main, 2, 64, 4), Cell(half, 2, 64)]
    cells += [Cell(main, 4, 128, 4), Cell(main, 8, 32, 8)]
    cells += [Cell(s, 8, 64, 8) for s in (main, half)]
    cells += [Cell(s, 8, 128, 8) for s in (main, half)]
    return cells


def measured(gap: torch.Tensor, pressure: torch.Tensor) -> dict[str, float]:
    """Area, mean gap, pull of the open gaps and quantiles of the gap, of one solved surface."""
    contact = pressure > 0
    gap = gap.clamp(min=0.0).masked_fill(contact, 0.0) / H_RMS
    rising = gap.flatten().sort().values
    row = {
        "area": float(corrected_area(contact)),
        "area_raw": float(contact.to(torch.float64).mean()),
        "gap": float(gap.mean()),
    }
    for h0 in H0:
        row[f"pull_{h0:g}"] = float((~contact / (gap + h0) ** 2).mean())
    for share in QUANTILES:
        row[f"gap_at_{share:g}"] = float(rising[int(share * len(rising))])
    return row


def solve(cell: Cell, number: int) -> list[dict[str, object]]:
    """One surface of a cell at all loads."""
    surface = cell.surface(number)
    solver = BoundaryElements(surface, cell.modulus)
    scale = cell.scale_pa()
    rows: list[dict[str, object]] = []
    for x in LOADS:
        found = solver.fields(x * scale)
        rows.append(
            {
                **key(cell),
                "surface": number,
                "x_long": x,
                "pressure_pa": x * scale,
                "h_rms": float(surface.h_rms_m) / H_RMS,
                "peak": float(surface.height_m.max()) / H_RMS,
                "converged": int(found.converged.all()),
                **measured(found.gap_m[0], found.pressure_pa[0]),
            }
        )
    return rows


def key(cell: Cell) -> dict[str, Any]:
    """What identifies a cell in a table."""
    return {name: getattr(cell, name) for name in ("solid", "waves", "band", "hurst")}


def summary(rows: list[dict[str, str]]) -> list[dict[str, object]]:
    """Means over surfaces, and standard deviations of one surface."""
    found = []
    for cell in grid():
        own = {name: str(value) for name, value in key(cell).items()}
        here = [row for row in rows if all(row[name] == own[name] for name in own)]
        for x in LOADS:
            at = [row for row in here if float(row["x_long"]) == x]
            if len(at) < 4:
                continue
            line: dict[str, object] = {**own, "use": cell.use, "x_long": x}
            line["surfaces"] = len(at)
            line["converged"] = sum(int(row["converged"]) for row in at)
            for name in list(at[0])[list(at[0]).index("pressure_pa") :]:
                if name in ("converged", "area_raw"):
                    continue
                values = np.array([float(row[name]) for row in at])
                line[name] = f"{values.mean():.5g}"
                if name in ("area", "gap", "pull_0.005", "pull_0.02", "pull_0.1"):
                    line[f"{name}_std"] = f"{values.std(ddof=1):.3g}"
            found.append(line)
    return found


def joined(before: list[dict[str, str]], now: list[dict[str, object]]) -> list[dict[str, object]]:
    """Means of now, and those of before whose cells were not solved now, in the grid's order."""
    names = list(key(grid()[0]))

    def of(row: Mapping[str, object]) -> tuple[str, ...]:
        return tuple(str(row[name]) for name in names)

    solved = {of(line) for line in now}
    every = [*now, *(row for row in before if of(row) not in solved)]
    rank = [of(key(cell)) for cell in grid()]
    return sorted(every, key=lambda row: (rank.index(of(row)), float(str(row["x_long"]))))


class SolveSurface(Task):
    """One surface of a cell at all loads."""

    solid: str
    waves: int
    band: int
    hurst: float
    surface: int

    def run(self, context: Context) -> Result:
        """Solve it."""
        fields = dict(self)
        number = fields.pop("surface")
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # the box and its pixels are what is studied
            rows = solve(Cell(**fields), number)
        table = csv_text(rows[0], (row.values() for row in rows), 6)
        converged = sum(int(str(row["converged"])) for row in rows)
        return Result({"surface": number, "converged": converged}, files={"rows.csv": table})

    @property
    def needed_bytes(self) -> int:
        """Memory of the surface."""
        return estimated_bytes(PIXELS * self.waves * self.band, 1)


class FewSpots(Campaign):
    """A task for each surface of each cell.

    Parameters
    ----------
    solids : tuple of str
        Names of `SOLIDS`; by default all.
    largest_points : int
        Cells with more points along a side are left out: an hour for a surface, or several.
    """

    solids: tuple[str, ...] = tuple(SOLIDS)
    largest_points: int = 2048

    def tasks(self) -> Iterator[CampaignTask]:
        """Yield the surfaces, the most wanted cells first."""
        for cell in grid():
            if cell.solid in self.solids and PIXELS * cell.waves * cell.band <= self.largest_points:
                for number in range(cell.surfaces):
                    yield CampaignTask(SolveSurface(**key(cell), surface=number), key(cell))


def main() -> None:
    """Write the means over the surfaces that a campaign has solved."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("campaign", type=Path, help="its folder")
    parser.add_argument("--out", type=Path, default=FILE)
    chosen = parser.parse_args()
    rows = [row for file in chosen.campaign.glob("results/*/*/rows.csv") for row in read(file)]
    rows.sort(key=lambda row: int(row["surface"]))  # sums in one order
    lines = joined(read(FILE), summary(rows))
    table = csv_text(lines[0], (line.values() for line in lines))
    write_whole(chosen.out, table)


def cells(path: Path = FILE) -> dict[Cell, list[dict[str, str]]]:
    """Rows of a table of means by cell, in its order."""
    found: dict[Cell, list[dict[str, str]]] = {}
    for row in read(path):
        waves, band, surfaces = (int(row[name]) for name in ("waves", "band", "surfaces"))
        cell = Cell(row["solid"], waves, band, surfaces, float(row["hurst"]))
        found.setdefault(cell, []).append(row)
    return found


def read(path: Path) -> list[dict[str, str]]:
    """Rows of a table, none where it does not exist yet."""
    if not path.exists():
        return []
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


if __name__ == "__main__":
    main()
