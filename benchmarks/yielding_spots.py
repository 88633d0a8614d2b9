"""Boundary elements of the dry finger, whose contact spots yield, and what "local" makes of them.

    python benchmarks/yielding_spots.py solve FOLDER     # an hour of a core; goes on where it was
    python benchmarks/yielding_spots.py table [FOLDER] [--out docs/mean-field.md]
    python benchmarks/yielding_spots.py attract [--out docs/mean-field.md]   # minutes

`solve` presses surfaces with the dry preset's modulus, layer, roughness and hardness at a finger's
pressures, without voltage. Where all spots yield, the load alone decides their area: mu(V)/mu(0) is
1 + c I(h0)/p0 with c = eps0 V^2/4 and I(h0) the mean of 1/(u + h0)^2 over the gaps, which small
attractions leave as they are. So one solution serves all insulators and voltages. `attract` solves
some surfaces under voltage. `table` writes the surfaces' rows to
tests/data/boundary-elements-own/yielding.csv and compares the theory of the preset, with all waves
of its roughness.
"""

from __future__ import annotations

import argparse
import csv
import json
import sys
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass
from math import inf, pi
from pathlib import Path
from time import perf_counter, time

import numpy as np
import torch

from benchmarks.mean_field import _put
from haptix.model.contact import THEORIES, Accuracy, Layered, RoughnessSpectrum
from haptix.model.contact.accuracy import of_states
from haptix.model.contact.boundary_elements import Surfaces
from haptix.model.contact.boundary_elements.bounded import BoundedProblem, wavenumbers
from haptix.model.contact.boundary_elements.elements import corrected_area
from haptix.model.electro import Pull
from haptix.model.electro.dielectric import VACUUM_PERMITTIVITY
from haptix.model.fidelity import Contact, Load, MeanFieldBalance
from haptix.model.finger import Roughness

ROWS = Path(__file__).parents[1] / "tests/data/boundary-elements-own/yielding.csv"
DRY = Roughness()  # of the presets
SKIN = Layered(1e9, 0.3, 200e-6, 10e3, 0.5)  # of the dry preset
HARDNESS_PA = 50e6
LOADS_PA = (25e3, 10e3, 5e3, 2.5e3)  # of 0.1 to 1 N: 3 to 22 kPa
OUTER_PA = (60e3, 1.5e3)  # of 0.05 and 3 N
# h0/h_rms of the preset on the 3M screen, and on a quarter of its insulator: 0.003 to 0.0145.
INSULATORS = (0.003, 0.0045, 0.0065, 0.01, 0.015)
H_RMS_M, Q_ROLLOFF, WIDEST = float(DRY.h_rms_m), DRY.q_rolloff_per_m, 256
TOLERANCE = 1e-5
MOST_ROUNDS = 12
WEAK_V = 30.0  # of the sine whose attraction counts as small
NARROWEST = 64  # q1/q_r from which spots yield as the finger's
LEAST_SURFACES = 8
FITTED_H, HELD_OUT_PA = 0.86, 10e3  # the interval was chosen on this H, without this load
COLUMNS = (
    *("cell", "seed", "p0_pa", "area", "plastic_share", "gap_m"),
    *(f"per_m2_{h0:g}" for h0 in INSULATORS),
)


@dataclass(frozen=True)
class Cell:
    """Surfaces of one kind."""

    hurst: float
    waves: int  # of the roll-off along the box
    band: int  # q1/q_r
    points: int
    loads_pa: tuple[float, ...] = LOADS_PA

    @property
    def name(self) -> str:
        """All of it in a word."""
        outer = "" if self.loads_pa == LOADS_PA else "_outer"
        return f"{100 * self.hurst:.0f}_{self.waves}_{self.band}_{self.points}{outer}"

    @property
    def side_m(self) -> float:
        """Side of the box."""
        return 2 * pi * self.waves / Q_ROLLOFF

    def path(self, folder: Path, seed: int) -> Path:
        """File of a surface."""
        return folder / f"{self.name}__{seed}.json"

    def spectrum(self, band: float) -> RoughnessSpectrum:
        """C(q) with waves up to `band` times the roll-off."""
        low, end = Q_ROLLOFF / self.waves, band * Q_ROLLOFF
        return RoughnessSpectrum.self_affine(H_RMS_M, self.hurst, low, Q_ROLLOFF, end)

    def heights(self, seed: int) -> torch.Tensor:
        """One surface, shape (1, n, n); every band has the same long waves."""
        points = max(self.points, 2 * self.waves * WIDEST)
        widest = Surfaces.random(self.spectrum(WIDEST), points, self.side_m, 1, seed)
        waves = torch.fft.rfft2(widest.height_m * (H_RMS_M / widest.h_rms_m))
        waves[:, wavenumbers(points, self.side_m) > 1.000001 * self.band * Q_ROLLOFF] = 0
        step = points // self.points
        kept: torch.Tensor = torch.fft.irfft2(waves, s=(points, points))[:, ::step, ::step]
        return kept.contiguous()

    def problem(self, hardness_pa: float) -> BoundedProblem:
        """The dry preset's layer on this box."""
        return BoundedProblem.on_grid(SKIN, self.points, self.side_m, hardness_pa)


CELLS = (
    *(Cell(0.86, 2, band, points) for band, points in ((16, 1024), (64, 1024), (256, 2048))),
    *(Cell(0.86, 4, band, 1024) for band in (16, 64)),
    *(Cell(0.75, waves, 64, 1024) for waves in (2, 4)),
    *(Cell(h, waves, 64, 1024, OUTER_PA) for h, waves in ((0.86, 2), (0.86, 4), (0.75, 4))),
    # Halves the pixels of three surfaces.
    *(Cell(0.86, 2, band, points) for band, points in ((16, 2048), (64, 2048), (256, 4096))),
    Cell(0.86, 4, 64, 2048),
)
ATTRACTED = (
    *((Cell(0.86, 2, 256, 2048), load, 0.0075, 200.0) for load in (3e3, 25e3)),
    *((Cell(0.86, 2, 64, points), 10e3, 0.0045, 200.0) for points in (1024, 2048)),
)


def solve(cell: Cell, seed: int) -> list[list[float]]:
    """Rows of one surface at all loads: p0, A/A0, share of it that yields, mean gap, I(h0)."""
    height, problem = cell.heights(seed), cell.problem(HARDNESS_PA)
    scale, start, rows = torch.tensor([H_RMS_M], dtype=torch.float64), None, []
    for load in cell.loads_pa:
        solved = problem.solve(height, torch.full_like(scale, load), scale, TOLERANCE, start)
        if not bool(solved.converged):
            raise RuntimeError(f"{cell.name}, seed {seed}, {load:g} Pa: not solved")
        start, spots = solved.pressure_pa, solved.pressure_pa > 0
        gap = solved.gap_m.clamp(min=0).masked_fill(spots, 0.0)
        yields = (solved.pressure_pa >= HARDNESS_PA).sum() / spots.sum()
        found = [load, float(corrected_area(spots)), float(yields), float(gap.mean())]
        for relative in INSULATORS:
            pulled = (gap + relative * H_RMS_M).pow(-2).masked_fill(spots, 0.0)
            found.append(float(pulled.mean()))
        rows.append(found)
    return rows


def solve_missing(folder: Path, cells: list[Cell], seeds: int, last: float) -> None:
    """Solve the surfaces that are not in the folder, while there is time to start."""
    folder.mkdir(parents=True, exist_ok=True)
    for seed in range(seeds):
        for cell in cells:
            path = cell.path(folder, seed)
            if path.exists() or time() > last:
                continue
            began = perf_counter()
            rows = solve(cell, seed)
            path.write_text(json.dumps(rows))
            sys.stderr.write(f"{path.stem}: {perf_counter() - began:.0f} s\n")


def write_rows(folder: Path) -> None:
    """Write the rows of every surface of the folder; those of other surfaces are kept."""
    lines = {(row[0], int(row[1]), row[2]): row for row in kept()}
    for cell in CELLS:
        for path in folder.glob(f"{cell.name}__*.json"):
            seed = int(path.stem.split("__")[1])
            for row in json.loads(path.read_text()):
                line = [cell.name, str(seed), *(f"{value:.6g}" for value in row)]
                lines[cell.name, seed, line[2]] = line
    with ROWS.open("w", newline="") as file:
        csv.writer(file, lineterminator="\n").writerows([COLUMNS, *lines.values()])


def kept() -> Iterator[list[str]]:
    """Rows of the file, if there is one."""
    if ROWS.exists():
        with ROWS.open() as file:
            yield from list(csv.reader(file))[1:]


def by_theory(
    cell: Cell, load_pa: float, insulators: tuple[float, ...] = INSULATORS, volts_v: float = WEAK_V
) -> tuple[torch.Tensor, torch.Tensor, Accuracy]:
    """Strength c [N], and ln mu(V)/mu(0) of "local" with its accuracy, on each insulator."""
    low, end = Q_ROLLOFF / cell.waves, DRY.q1_per_m
    spectrum = RoughnessSpectrum.self_affine(H_RMS_M, cell.hurst, low, Q_ROLLOFF, end)
    theory, relative = THEORIES["local"], torch.tensor(insulators, dtype=torch.float64)
    contact = Contact(theory.mean_field(spectrum, SKIN), theory.contact_spots, HARDNESS_PA, load_pa)
    volts = torch.full_like(relative, volts_v)
    load, box = torch.full_like(volts, load_pa), torch.full_like(volts, cell.side_m**2)
    pull = Pull.of_sine(
        contact.field.gap_edges_m, volts, relative * H_RMS_M, torch.arange(len(volts))
    )
    size = contact.field.highest_asperity(box)
    state = MeanFieldBalance(contact).solve(Load(load, pull, size))
    ratio = state.area_fraction / contact.area_fraction(load)
    x = load / (contact.field.stress_rms_pa * 2**0.5)
    pulled = state.gap_attraction_pa / load
    accuracy = of_states("local", x, relative, pulled, ratio, contact.yielded_area(load))
    return pull.strength, torch.log(ratio), accuracy


@dataclass(frozen=True)
class Row:
    """Means over the surfaces of a cell at one load, and the theory there."""

    cell: Cell
    load_pa: float
    surfaces: int
    area: float
    yields: float  # share of the area
    gap_m: float
    elements: torch.Tensor  # ln mu(V)/mu(0) on each insulator
    theory: torch.Tensor
    accuracy: Accuracy

    @property
    def group(self) -> str | None:
        """Rows that the interval was chosen on, and those kept out; None for neither."""
        if self.cell.band < NARROWEST or self.surfaces < LEAST_SURFACES:
            return None
        if self.cell.hurst != FITTED_H:
            return f"H = {self.cell.hurst} (kept out)"
        if self.load_pa == HELD_OUT_PA:
            return f"{HELD_OUT_PA / 1e3:g} kPa (kept out)"
        return "the others"

    @property
    def inside(self) -> list[bool]:
        """Whether each insulator's ratio lies in the theory's interval."""
        width = self.accuracy.ratio
        inside = ((self.theory - self.elements).abs() <= width) & (width < inf)
        return [bool(each) for each in inside]


def compared() -> Iterator[Row]:
    """Rows of the file against the theory."""
    rows: dict[tuple[str, float], list[list[float]]] = defaultdict(list)
    for name, _, pressure, *values in kept():
        rows[name, float(pressure)].append([float(value) for value in values])
    cells = {cell.name: cell for cell in CELLS}
    for (name, load), found in rows.items():
        area, yields, gap, *sums = np.mean(found, 0).tolist()
        strength, theory, accuracy = by_theory(cells[name], load)
        elements = strength * torch.tensor(sums) / load
        yield Row(cells[name], load, len(found), area, yields, gap, elements, theory, accuracy)


def tables() -> str:
    """Rows against the theory, and how many lie inside the interval."""
    lines = [
        "| box, q1/q_r, pixels, H | surfaces | p0 [kPa] | A hardness/p0 | of A yields "
        "| mean gap/h_rms | ln mu(V)/mu(0), theory over elements |",
        "|---|---|---|---|---|---|---|",
    ]
    inside: dict[str, list[bool]] = defaultdict(list)
    for row in compared():
        cell, over = row.cell, " ".join(f"{one:.2f}" for one in row.theory / row.elements)
        lines.append(
            f"| {cell.waves} waves, {cell.band}, {cell.points}, {cell.hurst} | {row.surfaces} "
            f"| {row.load_pa / 1e3:g} | {row.area * HARDNESS_PA / row.load_pa:.2f} "
            f"| {row.yields:.2f} | {row.gap_m / H_RMS_M:.2f} | {over} |"
        )
        if row.group:
            inside[row.group] += row.inside
    lines += ["", "| rows | inside the 90 % interval of mu(V)/mu(0) |", "|---|---|"]
    lines += [f"| {group} | {sum(of)} of {len(of)} |" for group, of in inside.items()]
    return "\n".join(lines)


def attract(cell: Cell, seed: int, load_pa: float, h0: float, volts: float) -> str:
    """mu(V)/mu(0) by theory and of one surface, and to first order by its gaps without voltage.

    The hardness bounds the net stress on the skin, and in the last column the contact pressure.
    """
    height, scale = cell.heights(seed), torch.tensor([H_RMS_M], dtype=torch.float64)
    c, thickness = VACUUM_PERMITTIVITY * volts**2 / 4, h0 * H_RMS_M
    in_spots = c / thickness**2
    ratios = []
    for bound in (HARDNESS_PA + in_spots, HARDNESS_PA):
        alone = cell.problem(HARDNESS_PA).solve(
            height, torch.full_like(scale, load_pa), scale, TOLERANCE
        )
        problem, solved, area = cell.problem(bound), alone, inf
        for _ in range(MOST_ROUNDS):
            traction = c / (solved.gap_m.clamp(min=0) + thickness) ** 2
            lowered = height + problem.levels[0].displacement(traction)
            load = load_pa + traction.mean((-2, -1))
            solved = problem.solve(lowered, load, scale, TOLERANCE, solved.pressure_pa)
            before, area = area, float(corrected_area(solved.pressure_pa > 0))
            if abs(area - before) <= 1e-4 * area:
                break
        ratios.append(area / float(corrected_area(alone.pressure_pa > 0)))
    gap = alone.gap_m.clamp(min=0)
    gaps = float((c / (gap + thickness) ** 2 * (alone.pressure_pa <= 0)).mean())
    spots = in_spots * float(corrected_area(alone.pressure_pa > 0))
    theory = float(by_theory(cell, load_pa, (h0,), volts)[1].exp())
    figures = (theory, ratios[0], 1 + gaps / load_pa, ratios[1], 1 + (gaps + spots) / load_pa)
    return (
        f"| {cell.waves} waves, {cell.band}, {cell.points} | {load_pa / 1e3:g} | {h0:g} "
        f"| {volts:g} | {' | '.join(f'{figure:.4f}' for figure in figures)} |"
    )


def attracted() -> Iterator[str]:
    """Some surfaces under voltage."""
    yield (
        "| box, q1/q_r, pixels | p0 [kPa] | h0/h_rms | V | `local` "
        "| hardness bounds the net stress | 1 + gaps' pull/p0 "
        "| it bounds the contact pressure | 1 + gaps' and spots' pull/p0 |"
    )
    yield "|---|---|---|---|---|---|---|---|---|"
    for cell, load, h0, volts in ATTRACTED:
        yield attract(cell, 0, load, h0, volts)


def main() -> None:
    """Solve, or make the tables."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("what", choices=("solve", "table", "attract"))
    parser.add_argument("folder", type=Path, nargs="?", default=Path("yielding"))
    parser.add_argument("--seeds", type=int, default=8)
    parser.add_argument("--cells", nargs="*", help="names of cells; by default all")
    parser.add_argument("--seconds", type=float, default=inf, help="start no surface after these")
    parser.add_argument("--out", type=Path)
    chosen = parser.parse_args()
    torch.set_num_threads(1)
    if chosen.what == "solve":
        cells = [cell for cell in CELLS if not chosen.cells or cell.name in chosen.cells]
        solve_missing(chosen.folder, cells, chosen.seeds, time() + chosen.seconds)
        return
    if chosen.what == "attract":
        mark, text = "yielding-attracted", "\n".join(attracted())
    else:
        write_rows(chosen.folder)
        mark, text = "yielding", tables()
    sys.stdout.write(text + "\n")
    if chosen.out:
        chosen.out.write_text(_put(chosen.out.read_text(), mark, text))


if __name__ == "__main__":
    main()
