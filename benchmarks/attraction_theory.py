"""The theory "local" against what is known: its weights, Maxwell's relation, and single shapes.

    python benchmarks/attraction_theory.py weights                     # minutes
    python benchmarks/attraction_theory.py shapes [--out docs/mean-field.md]   # minutes

`weights` measures the weights v and g on rough contacts without attraction, how far Maxwell's
relation is missed, and where light contact ends.

`shapes` solves a wave, crossed waves and a lattice of spheres under attraction, and puts the
theory's closure on their own contacts without attraction, with the weight g of strips (the
theory's) and with that of a circle. The last lines have the whole theory with a circle's weight.
"""

from __future__ import annotations

import argparse
import csv
import sys
from collections.abc import Iterator
from functools import partial
from itertools import pairwise
from math import nan, pi, sqrt
from pathlib import Path
from timeit import repeat
from unittest.mock import patch

import numpy as np
import torch
from scipy.integrate import cumulative_trapezoid
from scipy.ndimage import map_coordinates

import haptix.model.electro.widening as widening
from benchmarks.attracted_contacts import (
    CELLS,
    E_PA,
    H_RMS_M,
    LAYER,
    Q0,
    ROWS,
    Array,
    Cell,
    EdgeWeight,
    Solved,
    attracted,
    closed,
    falling,
    tables,
    unattracted,
)
from benchmarks.mean_field import _put
from haptix import ContactModel, Finger, Screen
from haptix.model.contact import THEORIES, HalfSpace, Layered, MeanField, RoughnessSpectrum
from haptix.model.contact.boundary_elements import Surfaces
from haptix.model.contact.boundary_elements.bounded import BoundedProblem
from haptix.model.contact.boundary_elements.coupled import AttractedContacts
from haptix.model.contact.boundary_elements.elements import corrected_area
from haptix.model.contact.elasticity import ElasticSolid
from haptix.model.contact.persson import LATTICE_STEP
from haptix.model.electro import AttractionTable, Pull, drive_voltage
from haptix.model.electro.widening import edge_weight
from haptix.model.fidelity import Balance, Contact, Load, MeanFieldBalance

SIDE_M, MODULUS_PA = 1e-3, E_PA / (1 - 0.5**2)
# Shapes, and their loads p0 as p0 side/(E* h_rms): spots of 4 %, and of 1 and 4 % of the area.
SHAPES = {"wave": (0.018,), "spheres": (0.0045, 0.037), "crossed waves": (0.0093, 0.073)}
THICKNESSES = (0.03, 0.1, 0.3, 1.0)  # h0/h_rms
ATTRACTIONS = (1.0, 4.0, 10.0, 20.0)  # of gaps and spots, over p0
SHOWN = slice(1, None, 2)  # of them
ZONE_PIXELS = 4  # least width of the cohesive zone beside a spot


def shape_heights(shape: str, points: int) -> torch.Tensor:
    """One period of a shape, of h_rms `H_RMS_M`, with its peak off the pixels.

    A peak on a pixel or between two makes edges cross several pixels at a time.
    """
    place = (torch.arange(points, dtype=torch.float64) + 0.25) / points - 0.5
    across = place[:, None] + 0.125 / points
    if shape == "spheres":
        height = -(place**2) - across**2
    else:
        height = torch.cos(2 * pi * place) + (shape != "wave") * torch.cos(2 * pi * across)
    height = height - height.mean()
    return H_RMS_M * height / height.square().mean().sqrt()


def circle_weight(area: torch.Tensor, open_share: torch.Tensor) -> torch.Tensor:
    """``int (g - 1) dn`` from A to ``A + open_share`` beside one circular spot.

    ``g = (2/pi)(arccos(a/r) + 1/sqrt(r^2/a^2 - 1))`` with ``r^2/a^2 = n/A``: an axisymmetric
    traction outside a circle of radius a, at its edge (Maugis, J. Colloid Interface Sci. 150,
    243 (1992)). The integral is A only where the gaps reach infinitely far.
    """
    beyond = torch.minimum(open_share, 1 - area) / area
    root = beyond.sqrt()
    angle = torch.atan2(torch.ones_like(root), root)
    return area * (1 + 2 / pi * (root - (1 + beyond) * angle))


def follow_shape(
    shape: str, load: float, thicknesses: tuple[float, ...], points: int
) -> tuple[Solved, list[Array]]:
    """A shape's contacts without attraction and with it, and the open gaps of the latter."""
    solid = HalfSpace(E_PA, 0.5)
    problem = BoundedProblem.on_grid(solid, points, SIDE_M, None, torch.device("cpu"))
    height = shape_heights(shape, points)[None]
    p0 = torch.tensor([load * MODULUS_PA * H_RMS_M / SIDE_M], dtype=torch.float64)
    off, profiles = unattracted(problem, height, p0, np.geomspace(1, 40, 17))
    relative = torch.tensor(thicknesses, dtype=torch.float64)
    each = len(relative)
    contacts = AttractedContacts(
        problem, height.repeat(each, 1, 1), p0.repeat(each),
        partial(falling, h0_m=H_RMS_M * relative[:, None, None]), 1e-5,
    )  # fmt: skip
    rows, gaps = [], []
    for total in ATTRACTIONS:
        row, gap = attracted(contacts, total * p0.repeat(each))
        rows.append(torch.cat([relative[:, None], row], 1).numpy())
        gaps += [of_one[~of_one.isnan()].sort().values.numpy() for of_one in gap]
    return Solved(H_RMS_M, off[0], profiles[0], np.concatenate(rows)), gaps


def shape_errors(surface: Solved, row: Array, gaps_m: Array, edge: EdgeWeight) -> Array:
    """Closure over elements less 1: p_A by their own gaps, then area, pull of the gaps, mean gap.

    The elements' p_A is the pressure that has their area without attraction.
    """
    h0_m, spot_pa, area, gap_m, pull_pa, _ = row
    h0_m *= surface.h_rms_m
    rank = torch.linspace(0, 1 - area, len(gaps_m) + 1, dtype=torch.float64)
    beside = edge(torch.tensor(area, dtype=torch.float64), rank).diff().numpy()
    by_gaps = surface.p0_pa + pull_pa + (spot_pa * (h0_m / (h0_m + gaps_m)) ** 2 * beside).sum()
    log_p = np.interp(np.log(area), np.log(surface.off[:, 1]), np.log(surface.off[:, 0]))
    found = closed(surface, row, edge) or (nan, nan, nan)
    ratios = by_gaps / np.exp(log_p), found[0] / area, found[2] / pull_pa, found[1] / gap_m
    return np.array(ratios) - 1


def shapes(points: int = 512) -> Iterator[str]:
    """Errors of the closure on single shapes, in per cent, under 4 and 20 p0."""
    yield (
        "| shape, A/A0 without voltage | h0/h_rms | A/A0 | p_A by the elements' own gaps, strip "
        "| circle | A/A0, strip | circle | pull of the gaps, strip | circle | mean gap, strip |"
    )
    yield "|---|---|---|---|---|---|---|---|---|---|"
    for shape, load in ((shape, load) for shape, loads in SHAPES.items() for load in loads):
        surface, gaps = follow_shape(shape, load, THICKNESSES, points)
        states = list(zip(surface.rows, gaps, strict=True))
        for number, thickness in enumerate(THICKNESSES):
            columns = []
            for row, gap in states[number :: len(THICKNESSES)][SHOWN]:
                zone_m = pi / 4 * MODULUS_PA * thickness * H_RMS_M / row[1]
                if not row[-1] or zone_m < ZONE_PIXELS * SIDE_M / points:
                    columns.append(["-"] * 8)
                    continue
                strip, circle = (
                    shape_errors(surface, row, gap, edge) for edge in (edge_weight, circle_weight)
                )
                both = np.stack([strip, circle], 1).flatten()[:-1]
                columns.append([f"{row[2]:.3f}", *(f"{100 * error:+.1f}" for error in both)])
            cells = (" ".join(pair) for pair in zip(*columns, strict=True))
            yield f"| {shape}, {surface.off[0, 1]:.3f} | {thickness:g} | {' | '.join(cells)} |"


def rows_with_circles() -> Iterator[str]:
    """The table of the whole theory's errors on rough surfaces, were all spots circles."""
    with patch.object(widening, "edge_weight", circle_weight):
        head, rule, *lines = tables(Path()).splitlines()
    yield from (head, rule, *(line for line in lines if line.startswith("| `local`,")))


def weights(cell: Cell, surfaces: int = 3) -> str:
    """The weights v and g - 1 of gaps, measured on contacts without attraction, and the theory's s.

    v: the fall of gaps over the mean one where the load grows by a tenth, by what the smaller gaps
    take of the area. g: the gain of the area by a traction of a quarter of p0 on gaps of one size
    alone, over the gain by as much pressure.
    """
    ranks = (0, 0.25, 0.5, 1, 2, 4, 8)  # over the spots' area
    sizes = (0.03, 0.1, 0.2, 0.4)  # over h_rms
    problem = BoundedProblem.on_grid(
        cell.solid(), cell.band * cell.pixels, cell.side_m, None, torch.device("cpu")
    )
    falls, gains = [], []
    for seed in range(surfaces):
        drawn = Surfaces.random(
            cell.spectrum(H_RMS_M), cell.band * cell.pixels, cell.side_m, 1, seed
        )
        height = drawn.height_m
        h_rms = float(height.std(unbiased=False))
        field = cell.field(h_rms)
        p0 = cell.x * float(field.stress_rms_pa) * sqrt(2)

        scale = torch.tensor([h_rms], dtype=torch.float64)

        def solved(
            load: float, heights: torch.Tensor, scale: torch.Tensor = scale
        ) -> tuple[torch.Tensor, torch.Tensor]:
            mean = torch.tensor([load], dtype=torch.float64)
            found = problem.solve(heights, mean, scale, 1e-6)
            return found.pressure_pa[0] > 0, found.gap_m[0].clamp(min=0)

        spots, gap = solved(p0, height)
        area = float(corrected_area(spots))
        lower = (gap - solved(1.1 * p0, height)[1])[~spots][gap[~spots].argsort()]
        place = torch.arange(1, len(lower) + 1) / spots.numel() / area
        lower = lower / (lower.sum() / spots.numel())
        falls.append(
            [float(lower[(place > low) & (place <= high)].mean()) for low, high in pairwise(ranks)]
        )
        even = float(corrected_area(solved(1.25 * p0, height)[0])) - area
        gained = []
        for low, high in pairwise(sizes):
            shape = (((gap >= low * h_rms) & (gap < high * h_rms)) & ~spots).to(torch.float64)
            pressed = height + p0 / 4 * problem.levels[0].displacement((shape / shape.mean())[None])
            gained.append((float(corrected_area(solved(1.25 * p0, pressed)[0])) - area) / even)
        gains.append(gained)
    at = torch.tensor([p0 * 0.95, p0 / 0.95])
    mass, edges = field.gap_histogram(at).mass, field.gap_edges_m
    area_of = field.area_fraction(at)
    rank = area_of[:, None] + mass.cumsum(-1)
    fallen = (rank[1] - rank[0]) * edges.diff() / -field.mean_gap(at).diff()
    middle, centre = (mass[0] + mass[1]) / 2, (edges[:-1] * edges[1:]).sqrt()
    open_share = middle.cumsum(-1)
    area_mean = area_of.mean()
    v = [
        float(fallen[inside].sum() / middle[inside].sum())
        for low, high in pairwise(ranks)
        if (inside := (open_share > low * area_mean) & (open_share <= high * area_mean)).any()
    ]
    weight = edge_weight(area_mean, torch.cat([open_share.new_zeros(1), open_share])).diff()
    shares = [
        float((weight / (1 + centre / (relative * h_rms)) ** 2).sum() / area_mean)
        for relative in (0.1, 0.2, 0.5, 1.0)
    ]

    def listed(values: list[float]) -> str:
        return " ".join(f"{value:.2f}" for value in values)

    return (
        f"{cell.name}: v elements {listed(list(np.mean(falls, 0)))}, mean field {listed(v)}; "
        f"g elements {listed(list(np.mean(gains, 0)))}; s {listed(shares)}"
    )


def missed_by_maxwell(field: MeanField, p0_pa: float, h0_m: float) -> float:
    """Largest miss of ``dubar/dc = -dC/dp0`` up to A = 0.3, in mean gaps without voltage.

    Both sides are second derivatives of one energy. C is the capacitance per area over eps0,
    ``A/h0 + int dn/(u + h0)``, and c the strength of the attraction.
    """
    part = 0.03
    edges = field.gap_edges_m
    middle = torch.cat([edges[1:2] / 2, (edges[1:-1] * edges[2:]).sqrt()])

    def solved(load_pa: float, strength: Array) -> Balance:
        column = torch.zeros(len(strength), dtype=torch.long)
        thickness = torch.tensor([h0_m], dtype=torch.float64)
        pull = Pull.of_sine(edges, drive_voltage(torch.tensor(strength)), thickness, column)
        load = torch.full((len(strength),), load_pa, dtype=torch.float64)
        return MeanFieldBalance(Contact(field, "widened", None, load_pa)).solve(Load(load, pull))

    def capacitance(load_pa: float) -> Array:
        table = AttractionTable.solve(field, load_pa, 200 * load_pa, widened=True)
        assert table.lifted is not None
        balance = solved(load_pa, strength)
        log_p, gaps = torch.log(balance.pressure_pa), torch.exp(table.log_mean_gap.values)
        of_gap = np.interp(-balance.mean_gap_m, -gaps, table.log_pressure)
        lift, lifts = log_p.numpy() - of_gap, table.lifted.lifts.numpy()
        node = (log_p - table.log_pressure[0]).numpy() / LATTICE_STEP
        place = np.interp(lift, lifts, np.arange(len(lifts)))
        nearness = (table.lifted.mass[:, 0] / (middle + h0_m)).sum(-1).numpy()
        at = map_coordinates(nearness, [node, place], order=1)
        total: Array = balance.area_fraction.numpy() / h0_m + at
        return total

    strength = p0_pa * h0_m**2 * np.geomspace(1e-2, 1e4, 200)
    light = solved(p0_pa, strength)
    most = strength[(light.is_stable & (light.area_fraction < 0.3)).numpy()][-1]
    strength = np.concatenate([[1e-9 * most], np.geomspace(1e-4 * most, most, 80)])
    rising = capacitance((1 + part) * p0_pa) - capacitance((1 - part) * p0_pa)
    fallen = cumulative_trapezoid(rising / (2 * part * p0_pa), strength, initial=0)
    gap = solved(p0_pa, strength).mean_gap_m.numpy()
    return float(np.abs(gap - gap[0] + fallen).max() / field.mean_gap(p0_pa))


def maxwell() -> Iterator[str]:
    """How far Maxwell's relation is missed, by the share of fixed spots in the lift."""
    spectrum = RoughnessSpectrum.self_affine(H_RMS_M, 0.8, Q0, 4 * Q0, 64 * Q0)
    field = THEORIES["local"].mean_field(spectrum, HalfSpace(E_PA, 0.5))
    p_pa = sqrt(2) * float(field.stress_rms_pa)
    cases = ((1e-3, 0.1), (1e-3, 0.3), (1e-2, 0.1), (1e-2, 1.0))
    for share in (0.0, 0.5, 1.0):
        with patch.object(widening, "_FIXED_SHARE", share):
            missed = [missed_by_maxwell(field, x * p_pa, h * H_RMS_M) for x, h in cases]
        yield f"Maxwell, share {share:g}: " + ", ".join(f"{miss:.2f}" for miss in missed)


def ends() -> str:
    """Where light contact ends, "local" over the elements of docs/mean-field.md, and its time."""
    lines = []
    with (ROWS.parent / "voltage.csv").open() as file:
        cases = [row for row in csv.DictReader(file) if float(row["voltage_v"]) == 0]
    for finite in (True, False):
        shares = []
        for row in cases:
            names = ("h_rms_m", "hurst", "q0", "q_rolloff", "q1", "youngs_modulus_pa")
            values = [float(row[name]) for name in (*names, "poisson_ratio", "layer_m")]
            solid: ElasticSolid = HalfSpace(values[5], values[6])
            if values[7]:
                base = float(row["bulk_modulus_pa"])
                solid = Layered(values[5], values[6], values[7], base, 0.5)
            field = THEORIES["local"].mean_field(RoughnessSpectrum.self_affine(*values[:5]), solid)
            p0, h0, side = float(row["pressure_pa"]), float(row["h0_m"]), 2 * pi / values[2]
            none, thickness = (torch.tensor([v], dtype=torch.float64) for v in (0.0, h0))
            pull = Pull.of_sine(field.gap_edges_m, none, thickness, none.long())
            box = field.highest_asperity(none + side**2) if finite else None
            solved = MeanFieldBalance(Contact(field, "widened", None, p0)).solve(
                Load(none + p0, pull, box)
            )
            shares.append(float(drive_voltage(solved.strength_at_end)) / float(row["pull_in_v"]))
        known = np.array([share for share in shares if np.isfinite(share)])
        lines.append(
            f"end of light contact, {'finite' if finite else 'infinite'} size: {known.min():.2f} "
            f"to {known.max():.2f} of the elements', {100 * np.median(np.abs(known - 1)):.0f} % off"
        )
    forces, volts = torch.rand(2, 100_000, dtype=torch.float64)
    times = {}
    for theory in ("corrected", "local"):
        model = ContactModel(Finger.preset("semi-wet"), Screen.preset("3m-sct3250"), theory=theory)
        each = partial(model.solve, 0.1 + forces, 200 * volts)
        each()  # its table
        times[theory] = min(repeat(each, number=1, repeat=5))
    return "\n".join([*lines, f"100,000 states: {times['local'] / times['corrected']:.1f} times"])


def main() -> None:
    """Measure, and print what came of it."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("what", choices=("weights", "shapes"))
    parser.add_argument("--out", type=Path, help="page to renew, such as docs/mean-field.md")
    parser.add_argument("--points", type=int, default=512, help="along a side of a shape")
    chosen = parser.parse_args()
    torch.set_num_threads(1)
    if chosen.what == "weights":
        for cell in CELLS:
            if cell.name in ("80_64_4_hs_1e-3_8", "80_64_4_hs_1e-2_8", f"80_64_4_{LAYER}_1e-2_8"):
                sys.stdout.write(weights(cell) + "\n")
        sys.stdout.write("\n".join([*maxwell(), ends()]) + "\n")
        return
    text = "\n".join([*shapes(chosen.points), "", *rows_with_circles()])
    sys.stdout.write(text + "\n")
    if chosen.out:
        chosen.out.write_text(_put(chosen.out.read_text(), "shapes", text))


if __name__ == "__main__":
    main()
