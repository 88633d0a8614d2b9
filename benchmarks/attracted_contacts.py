"""Boundary elements under local attraction, and what the theory "local" makes of them.

    python benchmarks/attracted_contacts.py solve FOLDER --seeds 8     # hours; goes on where it was
    python benchmarks/attracted_contacts.py solve FOLDER --device cuda --workers 6   # minutes
    python benchmarks/attracted_contacts.py table FOLDER [--out docs/mean-field.md]
    python benchmarks/attracted_contacts.py halve FOLDER               # minutes; reads no rows
    python benchmarks/attracted_contacts.py shown                      # seconds; reads no rows

`solve` follows surfaces of many cells (Hurst exponent, band, solid, load) under an attraction
``c/(u + h0)^2``, and the same surfaces without attraction at loads from p0 to 40 p0. Every surface
takes half a minute to some minutes on one core, a layer more. The shortest wave has 8 pixels or
more, and 1.3 h_rms/h0 at least: `halve` solves a third of the cells with twice the pixels too.

`shown` draws 20,000 states of each preset and counts those whose accuracy is stated, and those that
lie in the range of each quantity.

`table` writes the surfaces' rows to tests/data/boundary-elements-own/attracted.csv and two tables:
the theory's closure on the elements' own unattracted contacts, and the theory as a whole.
"""

from __future__ import annotations

import argparse
import csv
import sys
import traceback
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from math import inf, nan, pi, sqrt
from multiprocessing import get_context
from pathlib import Path
from time import perf_counter, time

import numpy as np
import torch
from numpy.typing import NDArray

from benchmarks.mean_field import _put
from haptix import ContactModel, Finger, Screen
from haptix.model.contact import (
    THEORIES,
    GapDistribution,
    HalfSpace,
    Layered,
    MeanField,
    RoughnessSpectrum,
    TheoryName,
)
from haptix.model.contact.accuracy import UNDER_VOLTAGE, YIELDED, of_states
from haptix.model.contact.boundary_elements import Surfaces
from haptix.model.contact.boundary_elements.bounded import BoundedProblem
from haptix.model.contact.boundary_elements.coupled import AttractedContacts
from haptix.model.contact.boundary_elements.elements import corrected_area
from haptix.model.contact.elasticity import ElasticSolid
from haptix.model.electro import Pull, drive_voltage
from haptix.model.electro.widening import edge_weight
from haptix.model.fidelity import Balance, Contact, Load, MeanFieldBalance
from haptix.model.presets import FINGERS as PRESETS

ROWS = Path(__file__).parents[1] / "tests/data/boundary-elements-own/attracted.csv"
PULLS = (1.0, 4.0, 10.0, 22.0)  # about: the attraction of the gaps over p0
# Of gaps and spots over p0, beside the thinnest insulators: the area grows before the gaps attract.
TOTALS = (0.5, 1.0, 2.0, 4.0, 8.0, 14.0, 24.0, 40.0)
THINNEST = 0.03  # h0/h_rms up to which these are taken
FINGERS = TOTALS[:3]  # at a finger's own load and insulator, where friction up to trebles
RANKS = np.geomspace(2e-6, 1, 400)  # of the open gaps, by size
LOADS = np.geomspace(1, 40, 9)
H_RMS_M, Q0, E_PA = 1e-6, 2e4, 4e7
LIGHT = 0.5  # A/A0: rows with more are in the file, and not in the tables
COLUMNS = (
    *("cell", "seed", "h_rms_m", "p0_pa", "area_off", "gap_off_m", "h0_over_h_rms", "spot_pa"),
    *("area", "gap_m", "gaps_pa", "converged"),
)
Array = NDArray[np.float64]


@dataclass(frozen=True)
class Cell:
    """Surfaces of one kind at one load."""

    hurst: float
    band: int  # q1/q0
    rolloff: int  # q_r/q0
    solid_name: str  # "hs", or "l0.9on4000": a layer of q_r d = 0.9 on E/4000
    x: float  # p0/(E* slope)
    pixels: int  # in the shortest wave
    h0: tuple[float, ...]  # over h_rms
    is_fingers: bool = False  # `FINGERS`, and without attraction at p0 alone

    @property
    def name(self) -> str:
        """All of it in a word."""
        x = f"{self.x:.0e}".replace("e-0", "e-")
        shape = f"{100 * self.hurst:.0f}_{self.band}_{self.rolloff}"
        return f"{shape}_{self.solid_name}_{x}_{self.pixels}"

    def path(self, folder: Path, seed: int) -> Path:
        """File of a surface."""
        return folder / f"{self.name}__{seed}.npz"

    @property
    def side_m(self) -> float:
        """Side of the box."""
        return 2 * pi / Q0

    def solid(self) -> ElasticSolid:
        """Half-space or layer."""
        if self.solid_name == "hs":
            return HalfSpace(E_PA, 0.5)
        thickness, ratio = map(float, self.solid_name[1:].split("on"))
        return Layered(E_PA, 0.5, thickness / (self.rolloff * Q0), E_PA / ratio, 0.5)

    def spectrum(self, h_rms_m: float) -> RoughnessSpectrum:
        """C(q) with this roughness."""
        return RoughnessSpectrum.self_affine(
            h_rms_m, self.hurst, Q0, self.rolloff * Q0, self.band * Q0
        )

    def field(self, h_rms_m: float) -> MeanField:
        """The mean field of surfaces that have this roughness."""
        return THEORIES["local"].mean_field(self.spectrum(h_rms_m), self.solid())


LAYER = "l0.9on4000"
SKIN = "l0.8on4000"  # of the presets
CELLS = (
    *(Cell(0.8, 64, 4, "hs", x, 8, (0.2, 0.5, 1.0)) for x in (1e-3, 1e-2)),
    *(Cell(0.5, 64, 4, "hs", x, 8, (0.2, 0.5, 1.0)) for x in (1e-3, 1e-2)),
    *(Cell(h, 32, 4, "hs", x, 16, (0.1, 0.3, 1.0)) for h in (0.8, 0.5, 0.65) for x in (1e-3, 1e-2)),
    *(Cell(0.9, 32, 4, "hs", x, 16, (0.2, 0.5)) for x in (1e-3, 1e-2)),
    *(Cell(0.8, 16, 4, "hs", x, 32, (0.05, 0.1, 0.2)) for x in (1e-3, 1e-2)),
    *(Cell(0.8, 16, 2, "hs", x, 32, (0.05, 0.2)) for x in (1e-3, 1e-2)),
    Cell(0.65, 64, 4, "hs", 3e-3, 8, (0.3, 1.0)),
    Cell(0.8, 64, 4, "hs", 3e-4, 8, (0.3, 1.0)),
    Cell(0.8, 64, 4, "hs", 5e-2, 8, (0.3,)),
    Cell(0.6, 16, 2, "hs", 3e-3, 32, (0.1, 0.5)),
    Cell(0.8, 8, 1, "hs", 3e-3, 64, (0.02,)),
    Cell(0.86, 64, 1, "hs", 1e-3, 8, (0.5,)),
    *(Cell(0.8, 64, 4, LAYER, x, 8, (0.2, 0.5, 1.0)) for x in (1e-3, 1e-2)),
    Cell(0.8, 32, 4, "l0.3on4000", 1e-3, 16, (0.2, 0.5)),
    Cell(0.7, 32, 4, "l0.8on100", 3e-3, 16, (0.2, 0.5)),
    Cell(0.5, 32, 2, LAYER, 3e-3, 16, (0.2,)),
    # A graphics card's: insulators as thin as a finger's, and 16 waves of the roll-off in the box.
    *(Cell(h, 16, 4, "hs", x, 128, (0.01, 0.02)) for h in (0.8, 0.5) for x in (1e-3, 1e-2)),
    *(Cell(h, 128, 16, "hs", x, 16, (0.1, 0.3, 1.0)) for h in (0.8, 0.5) for x in (1e-3, 1e-2)),
    *(Cell(0.8, 16, 4, "hs", x, 256, (0.01, 0.02)) for x in (1e-3, 1e-2)),  # halves the pixels
    # Layers, thick and thin insulators; and a load as light as a finger's.
    Cell(0.65, 64, 4, LAYER, 1e-3, 8, (0.2, 0.5, 1.0)),
    Cell(0.8, 32, 4, "l3on4000", 1e-2, 16, (0.1, 0.3, 1.0)),
    Cell(0.8, 16, 4, LAYER, 1e-3, 64, (0.02,)),
    *(Cell(h, 64, 8, "hs", 1e-4, 16, (0.1, 0.3, 1.0)) for h in (0.8, 0.5)),
    # A finger's layer, load and insulators, and the same with the pixels halved.
    *(Cell(0.86, 16, 4, SKIN, x, n, (0.01, 0.02), True) for n in (32, 64) for x in (1e-3, 3e-4)),
    # Its thinnest insulators, resolved.
    *(Cell(0.86, 8, 2, SKIN, x, 128, (0.006, 0.012), True) for x in (1e-3, 3e-4)),
)


def falling(gap_m: torch.Tensor, h0_m: float) -> torch.Tensor:
    """Attraction against the gap, 1 in a spot."""
    return (h0_m / (gap_m + h0_m)) ** 2


def solve(cell: Cell, seeds: Sequence[int], folder: Path, device: torch.device) -> None:
    """Solve surfaces of a cell together, on all its insulators, and keep what came of them."""
    began, points = perf_counter(), cell.band * cell.pixels
    spectrum = cell.spectrum(H_RMS_M)
    drawn = [Surfaces.random(spectrum, points, cell.side_m, 1, seed).height_m for seed in seeds]
    height = torch.cat(drawn).to(device)
    h_rms = height.square().mean((-2, -1)).sqrt()
    p0 = torch.tensor(
        [cell.x * float(cell.field(float(h)).stress_rms_pa) * sqrt(2) for h in h_rms]
    ).to(h_rms)
    problem = BoundedProblem.on_grid(cell.solid(), points, cell.side_m, None, device)
    off, profiles = unattracted(problem, height, p0, LOADS[:1] if cell.is_fingers else LOADS)
    relative = torch.tensor(cell.h0, dtype=torch.float64, device=device)
    h0 = (h_rms[:, None] * relative).flatten()[:, None, None]
    each = len(cell.h0)
    loads = p0.repeat_interleave(each)
    contacts = AttractedContacts(
        problem, height.repeat_interleave(each, 0), loads, partial(falling, h0_m=h0), 1e-5
    )
    rows, total, good = [], torch.zeros_like(loads), torch.ones_like(loads, dtype=torch.bool)
    thin = cell.h0[0] <= THINNEST
    for pull in FINGERS if cell.is_fingers else TOTALS if thin else PULLS:
        wanted = pull * loads / (1 if thin else contacts.gaps_share.clamp(min=0.02))
        wanted = torch.minimum(wanted, torch.where(total > 0, 6 * total, wanted))
        # A state that did not converge ends its surface's rows: no infinite attraction is solved.
        total = torch.where(good, wanted, inf)
        row, _ = attracted(contacts, total)
        good = good & (row[:, -1] > 0)
        row[:, -1] = good
        rows.append(row)
    states = torch.stack(rows, 1).unflatten(0, (len(seeds), each)).cpu().numpy()
    for number, seed in enumerate(seeds):
        np.savez(
            cell.path(folder, seed),
            h_rms=float(h_rms[number]), off=off[number], prof=profiles[number],
            seconds=(perf_counter() - began) / len(seeds),
            rows=np.array(
                [
                    (h, *state)
                    for h, of_h in zip(cell.h0, states[number], strict=True)
                    for state in of_h
                    if np.isfinite(state[0])
                ]
            ),
        )  # fmt: skip


def unattracted(
    problem: BoundedProblem, height_m: torch.Tensor, p0_pa: torch.Tensor, factors: Array
) -> tuple[Array, Array]:
    """p, A/A0, mean gap, and open gaps, at multiples of p0; shape (surfaces, loads, 3 or ranks)."""
    scale, start = height_m.square().mean((-2, -1)).sqrt(), None
    states, profiles = [], []
    for factor in factors:
        solved = problem.solve(height_m, factor * p0_pa, scale, 1e-5, start)
        start, spots = solved.pressure_pa, solved.pressure_pa > 0
        gap = solved.gap_m.clamp(min=0).masked_fill(spots, 0.0)
        states.append(torch.stack([factor * p0_pa, corrected_area(spots), gap.mean((-2, -1))], 1))
        profiles.append([profile(g[~closed_]) for g, closed_ in zip(gap, spots, strict=True)])
    return torch.stack(states, 1).cpu().numpy(), np.array(profiles).swapaxes(0, 1)


def attracted(
    contacts: AttractedContacts, attraction_pa: torch.Tensor
) -> tuple[torch.Tensor, torch.Tensor]:
    """Rows t0, A/A0, mean gap, pull of the gaps, converged; and the gaps, NaN in spots."""
    spot = contacts.strength(attraction_pa)
    spots = contacts.contact.pressure_pa > 0
    gap = contacts.contact.gap_m.clamp(min=0)
    pulled = (contacts.traction * ~spots).mean((-2, -1)) * spot
    mean = (gap * ~spots).mean((-2, -1))
    row = [spot, corrected_area(spots), mean, pulled, contacts.converged.to(spot)]
    return torch.stack(row, 1), gap.masked_fill(spots, nan)


def profile(gap_m: torch.Tensor) -> Array:
    """Open gaps at `RANKS`."""
    gaps = gap_m.sort().values.cpu().numpy()
    found: Array = np.interp(RANKS * len(gaps) - 0.5, np.arange(len(gaps)), gaps)
    return found


def solve_in_time(
    cell: Cell, seeds: Sequence[int], folder: Path, device: torch.device, last: float
) -> None:
    """Solve the surfaces that are not in the folder, in a worker, if there is time to start."""
    torch.set_num_threads(1)
    missing = [seed for seed in seeds if not cell.path(folder, seed).exists()]
    if not missing or time() > last:
        return
    try:
        solve(cell, missing, folder, device)
    except Exception:
        traceback.print_exc()
    else:
        taken = float(np.load(cell.path(folder, missing[0]))["seconds"])
        sys.stderr.write(f"{cell.name}: {len(missing)} surfaces of {taken:.1f} s\n")


@dataclass(frozen=True)
class Solved:
    """One surface's solutions."""

    h_rms_m: float
    off: Array  # p, A/A0 and mean gap, shape (loads, 3)
    profile_m: Array  # gaps by rank, shape (loads, ranks)
    rows: Array  # h0/h_rms, t0, A/A0, mean gap, pull of the gaps, converged

    @property
    def p0_pa(self) -> float:
        """Applied pressure."""
        return float(self.off[0, 0])


@dataclass(frozen=True)
class SolvedCell(Solved):
    """Those of a surface of a cell."""

    cell: Cell
    seed: int


def solutions(folder: Path) -> Iterator[SolvedCell]:
    """Read all surfaces of a folder."""
    for cell in CELLS:
        for path in sorted(folder.glob(f"{cell.name}__*.npz")):
            kept = np.load(path)
            off = kept["off"]
            rows = kept["rows"][np.isin(kept["rows"][:, 0], cell.h0)]
            seed = int(path.stem.split("__")[1])
            yield SolvedCell(float(kept["h_rms"]), off, kept["prof"], rows, cell, seed)


def by_theory(
    surface: SolvedCell, name: TheoryName, gaps: GapDistribution | None = None
) -> Balance:
    """The theory's contact at p0 alone, and then in each of a surface's rows."""
    theory, spectrum = THEORIES[name], surface.cell.spectrum(surface.h_rms_m)
    field = theory.mean_field(spectrum, surface.cell.solid(), gap_distribution=gaps)
    h0 = surface.rows[:, 0] * surface.h_rms_m
    strength = np.concatenate([[1e-30], surface.rows[:, 1] * h0**2])
    thickness, column = torch.tensor(np.concatenate([h0[:1], h0])).unique(return_inverse=True)
    pull = Pull.of_sine(field.gap_edges_m, drive_voltage(torch.tensor(strength)), thickness, column)
    p0 = torch.full((len(strength),), surface.p0_pa, dtype=torch.float64)
    box = torch.full_like(p0, surface.cell.side_m**2)
    contact = Contact(field, theory.contact_spots, None, surface.p0_pa)
    return MeanFieldBalance(contact).solve(Load(p0, pull, field.highest_asperity(box)))


EdgeWeight = Callable[[torch.Tensor, torch.Tensor], torch.Tensor]


def closed(
    surface: Solved, row: Array, edge: EdgeWeight = edge_weight
) -> tuple[float, float, float] | None:
    """Area, mean gap and pull of the gaps by the closure on the surface's own unattracted states.

    Written out once more, by fixed-point iteration on ranks, as docs/mean-field.md states it. None
    where it takes loads beyond those that were solved. `edge` is ``int (g - 1) dn``.
    """
    if len(surface.off) < 2:
        return None
    h0, spot_pa = row[0] * surface.h_rms_m, row[1]
    log_p, area_at, gap_at = np.log(surface.off[:, 0]), surface.off[:, 1], surface.off[:, 2]
    rank = np.geomspace(1e-6, 1, 1000)
    profiles = list(zip(area_at, surface.profile_m, strict=True))
    gaps = np.array([np.interp(rank, a + RANKS * (1 - a), gap, left=0.0) for a, gap in profiles])
    beyond = np.array([np.interp(rank, RANKS * (1 - a), gap, left=0.0) for a, gap in profiles])
    falls = np.gradient(gaps, axis=0) / np.gradient(gap_at)[:, None]
    log_area, log_gap, lift = log_p[0], log_p[0], 0.0

    def at(values: Array, log_pressure: float) -> Array:
        place = np.interp(log_pressure, log_p, np.arange(len(log_p)))
        low = min(int(place), len(log_p) - 2)
        mixed: Array = values[low] + (place - low) * (values[low + 1] - values[low])
        return mixed

    step = np.diff(rank, prepend=0.0)
    for _ in range(600):
        area = float(at(area_at, log_area))
        inside = rank < 1 - area  # by the share of the area in smaller gaps
        gap = at(beyond, log_area)  # edges stay edges from load to load
        fall = np.maximum(np.interp(area + rank, rank, at(falls, log_area)), 0.0) * inside
        fall = fall / (fall * step).sum()
        lifted = spot_pa * (h0 / (h0 + gap + 0.5 * lift * fall)) ** 2 * inside
        weight = edge(
            torch.tensor(area, dtype=torch.float64), torch.tensor(np.minimum(rank, 1 - area))
        ).numpy()
        edges = np.diff(weight, prepend=0.0) * inside
        beside = float((spot_pa * (h0 / (h0 + gap)) ** 2 * edges).sum())
        z = sqrt(max(beside / float((lifted * edges).sum()), 1.0)) - 1
        beside /= (1 + z**2 / (1 + z)) ** 2
        pull = float((lifted * step).sum())
        new_area = np.log(surface.p0_pa + pull + beside)
        left = min((surface.p0_pa + (lifted * fall * step).sum()) / np.exp(new_area), 1.0)
        new_gap = new_area - (1 - left - np.log(left)) / 2
        change = abs(new_area - log_area) + abs(new_gap - log_gap)
        log_area += (new_area - log_area) / 4
        log_gap += (new_gap - log_gap) / 4
        if log_area > log_p[-1]:
            return None
        lift = max(float(at(gap_at, log_gap) - at(gap_at, log_area)), 0.0)
        if change < 1e-5:
            break
    return area, float(at(gap_at, log_gap)), pull


def kept() -> Iterator[SolvedCell]:
    """Surfaces of the rows that are kept, which have no gap distributions."""
    surfaces: dict[tuple[str, int], list[list[float]]] = defaultdict(list)
    with ROWS.open() as file:
        for row in csv.DictReader(file):
            numbers = [float(row[name]) for name in COLUMNS[2:]]
            surfaces[row["cell"], int(row["seed"])].append(numbers)
    cells = {cell.name: cell for cell in CELLS}
    for (name, seed), rows in surfaces.items():
        values = np.array(rows)
        yield SolvedCell(
            rows[0][0], values[:1, 1:4], np.empty((0, 0)), values[:, 4:], cells[name], seed
        )


Errors = dict[str, dict[tuple[str, float, int], list[tuple[float, ...]]]]


def errors(folder: Path) -> Errors:
    """Of the closure and of two theories: pull over p0 and theory over elements, by row."""
    names = ("closure", "local", "combined", "corrected")
    found: Errors = {name: defaultdict(list) for name in names}
    distributions = {(each.cell.name, each.seed): each for each in solutions(folder)}
    for surface in kept():
        solved = distributions.get((surface.cell.name, surface.seed))
        theories = {
            "local": by_theory(surface, "local"),
            "combined": by_theory(surface, "local", "combined"),
            "corrected": by_theory(surface, "corrected"),
        }
        seen: dict[float, int] = defaultdict(int)
        for number, row in enumerate(surface.rows, 1):
            key = (surface.cell.name, float(row[0]), seen[row[0]])
            seen[row[0]] += 1
            _, _, area, gap, pull, converged = row
            if not converged or area > LIGHT:
                continue
            ratio = area / surface.off[0, 1]
            total = (pull + row[1] * area) / surface.p0_pa
            by_closure = closed(solved, row) if solved else None
            if by_closure is not None:
                new, wide, pulled = by_closure
                found["closure"][key].append(
                    (pull / surface.p0_pa, new, area, pulled, pull, wide, gap, new, area, total)
                )
            for name, balance in theories.items():
                areas = balance.area_fraction
                found[name][key].append(
                    (
                        *(pull / surface.p0_pa, float(areas[number]), area),
                        *(float(balance.gap_attraction_pa[number]), pull),
                        *(float(balance.mean_gap_m[number]), gap),
                        *(float(areas[number] / areas[0]), ratio, total),
                    )
                )
    return found


def of_few(cell: Cell, h0: float) -> bool:
    """Rows of half-spaces with few waves in the box."""
    return cell.rolloff <= 4 and h0 >= 0.1 and cell.solid_name == "hs"


def of_layer(cell: Cell, h0: float) -> bool:
    """Rows of layers, not the thinnest insulators."""
    return h0 >= 0.1 and cell.solid_name != "hs"


# Rows of a table: cell, h0/h_rms, pull of the gaps over p0, that of gaps and spots, and surfaces.
GROUPS: tuple[tuple[str, Callable[[Cell, float, float, float, int], bool]], ...] = (
    ("16 waves, pull to 5 p0", lambda c, h, p, t, n: c.rolloff == 16 and p <= 5),
    ("16 waves, beyond", lambda c, h, p, t, n: c.rolloff == 16 and p > 5),
    ("16 waves, h0/h_rms from 0.3", lambda c, h, p, t, n: c.rolloff == 16 and h > 0.2),
    ("4 waves and less, pull to 5 p0", lambda c, h, p, t, n: of_few(c, h) and p <= 5),
    ("4 waves and less, beyond", lambda c, h, p, t, n: of_few(c, h) and p > 5),
    ("layers, pull to 5 p0", lambda c, h, p, t, n: of_layer(c, h) and p <= 5),
    ("layers, beyond", lambda c, h, p, t, n: of_layer(c, h) and p > 5),
    ("x = 1e-4, 8 waves", lambda c, h, p, t, n: c.x < 2e-4),
    ("h0/h_rms below 0.1, spots' and gaps' to 15 p0", lambda c, h, p, t, n: h < 0.1 and t <= 15),
    ("h0/h_rms below 0.1, beyond", lambda c, h, p, t, n: h < 0.1 and t > 15),
    (
        "below 0.03, 5 surfaces or more",
        lambda c, h, p, t, n: h < 0.03 and n >= 5 and c.rolloff == 4,
    ),
)


def tables(folder: Path, least_surfaces: int = 2) -> str:
    """Median and largest error of the means over the surfaces of each row."""
    lines = [
        "| | rows | area | pull of the gaps | mean gap | mu_on/mu_off |",
        "|---|---|---|---|---|---|",
    ]
    titles = {
        "closure": "closure on the elements' own contacts",
        "local": "`local`",
        "combined": "the same with `combined` gaps",
        "corrected": "`corrected`",
    }
    found = errors(folder)
    by_name = {cell.name: cell for cell in CELLS}
    for name, title in titles.items():
        means = {
            key: np.mean(np.array(states), 0)
            for key, states in found[name].items()
            if len(states) >= least_surfaces
        }
        for label, chosen_rows in GROUPS:
            chosen = np.array(
                [
                    [m[1] / m[2] - 1, m[3] / m[4] - 1, m[5] / m[6] - 1, m[7] / m[8] - 1]
                    for key, m in means.items()
                    if chosen_rows(by_name[key[0]], key[1], m[0], m[9], len(found[name][key]))
                ]
            )
            if not len(chosen):
                continue
            cells = [
                f"{100 * np.median(np.abs(column)):.1f} / {100 * np.abs(column).max():.0f}"
                for column in chosen.T
            ]
            if name == "closure":
                cells[3] = "-"
            lines.append(f"| {title}, {label} | {len(chosen)} | {' | '.join(cells)} |")
    return "\n".join([*lines, "", *coverage(found, least_surfaces)])


def coverage(found: Errors, least_surfaces: int) -> Iterator[str]:
    """How many rows lie inside the intervals that states have, by theory and kind of row."""
    kinds: tuple[tuple[str, Callable[[Cell], bool]], ...] = (
        ("H = 0.8 (fitted)", lambda cell: cell.hurst == 0.8),
        ("H 0.5 to 0.9, but for 0.8", lambda cell: cell.hurst != 0.8),
        ("x = 1e-4", lambda cell: cell.x < 2e-4),
        ("layers", lambda cell: cell.solid_name != "hs"),
        ("the presets' layer", lambda cell: cell.solid_name == SKIN),
    )
    cells = {cell.name: cell for cell in CELLS if cell.rolloff >= 4 or cell.solid_name == SKIN}
    yield "| theory | rows of | inside the 90 % interval of mu_on/mu_off |"
    yield "|---|---|---|"
    for theory in ("local", "corrected"):
        for title, is_of in kinds:
            inside = []
            for (name, h0, _), states in found[theory].items():
                if name not in cells or len(states) < least_surfaces or not is_of(cells[name]):
                    continue
                m = np.mean(np.array(states), 0)
                given = (cells[name].x, h0, m[0] * m[3] / m[4], m[7])
                width = of_states(
                    theory, *(torch.tensor([v], dtype=torch.float64) for v in given)
                ).ratio
                if bool(width.isfinite()):
                    inside.append(abs(np.log(m[7] / m[8])) <= float(width))
            yield f"| `{theory}` | {title} | {sum(inside)} of {len(inside)} |"


def refined(height_m: torch.Tensor, points: int) -> torch.Tensor:
    """The same waves on more points."""
    waves, half = torch.fft.fft2(height_m), len(height_m) // 2
    waves[half] = waves[:, half] = 0
    more = waves.new_zeros(points, points)
    for rows in (slice(None, half), slice(-half, None)):
        for columns in (slice(None, half), slice(-half, None)):
            more[rows, columns] = waves[rows, columns]
    fine: torch.Tensor = torch.fft.ifft2(more).real
    return fine * (points / len(height_m)) ** 2


def halve(cell: Cell) -> str:
    """Area gained, and pull of the gaps, with twice the pixels over those with the cell's own.

    Under the same attraction of gaps and spots together.
    """
    points = cell.band * cell.pixels
    height = Surfaces.random(cell.spectrum(H_RMS_M), points, cell.side_m, 1, 0).height_m[0]
    h_rms = float(height.std(unbiased=False))
    p0 = cell.x * float(cell.field(h_rms).stress_rms_pa) * sqrt(2)
    parts = []
    for relative in cell.h0:
        states: dict[int, list[tuple[float, float]]] = {1: [], 2: []}
        totals: list[torch.Tensor] = []
        for more, solved in states.items():
            fine = height if more == 1 else refined(height, more * points)
            problem = BoundedProblem.on_grid(
                cell.solid(), more * points, cell.side_m, None, torch.device("cpu")
            )
            h0, load = relative * h_rms, torch.tensor([p0], dtype=torch.float64)
            contact = AttractedContacts(problem, fine[None], load, partial(falling, h0_m=h0), 1e-5)
            alone = float(corrected_area(contact.contact.pressure_pa[0] > 0))
            for number, pull in enumerate(PULLS[:2]):
                if more == 1:
                    totals.append(pull * load / contact.gaps_share.clamp(min=0.02))
                _, area, _, gaps, _ = attracted(contact, totals[number])[0][0].tolist()
                solved.append((area / alone, gaps))
        changes = [
            f"{100 * (b[0] / a[0] - 1):+.1f} {100 * (b[1] / a[1] - 1):+.1f}"
            for a, b in zip(states[1], states[2], strict=True)
        ]
        parts.append(f"h0/h_rms {relative:g}: {', '.join(changes)}")
    return f"{cell.name}: mu_on/mu_off and pull of the gaps, % | {' | '.join(parts)}"


def shown(states: int = 20_000) -> Iterator[str]:
    """Share of each preset's states on the 3M screen whose accuracy is stated, by quantity too.

    Forces of 0.1 to 1 N and amplitudes to 200 V are drawn evenly, frequencies of 60 Hz to 10 kHz
    evenly in the logarithm; the insulator is the screen's own, and a quarter of it.
    """
    draw = torch.rand(3, states, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    force, voltage, frequency = 0.1 + 0.9 * draw[0], 200 * draw[1], 60 * (1e4 / 60) ** draw[2]
    screen = Screen.preset("3m-sct3250")
    yield "| finger | insulator | shown | half of these within | by x | by h0/h_rms | by the pull |"
    yield "|---|---|---|---|---|---|---|"
    for name in PRESETS:
        model = ContactModel(Finger.preset(name), screen)
        for h0_m, title in ((screen.h0_m, "its own"), (screen.h0_m / 4, "a quarter")):
            state = model.solve(force, voltage, frequency, h0_m)
            thickness = model.solver.terms.thickness(torch.as_tensor(h0_m), frequency).abs()
            applied = state.x * sqrt(2) * model.contact.stress_rms_pa
            quantities = {
                "x": state.x,
                "h0/h_rms": thickness / model.contact.spectrum.h_rms_m,
                "gaps' attraction/p0": state.gap_attraction_pa / applied,
            }
            yields = bool((state.find_yielded_area() > 0).all())
            ranges = YIELDED if yields else UNDER_VOLTAGE
            inside = [
                (ranges[quantity][0] <= value) & (value <= ranges[quantity][1])
                for quantity, value in quantities.items()
            ]
            width = state.accuracy.ratio
            half = torch.expm1(width[width < inf].median()) if bool((width < inf).any()) else None
            within = "-" if half is None else f"{100 * float(half):.2g} %"
            all_of, *of = (
                f"{100 * float(one.double().mean()):.0f} %" for one in (width < inf, *inside)
            )
            yield f"| {name} | {title} | {all_of} | {within} | {' | '.join(of)} |"


def write_rows(folder: Path) -> None:
    """Write the rows of every surface of the folder; those of other surfaces are kept."""
    surfaces = {(each.cell.name, each.seed): each for each in (*kept(), *solutions(folder))}
    with ROWS.open("w", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(COLUMNS)
        for surface in surfaces.values():
            start = (surface.cell.name, surface.seed, surface.h_rms_m, *surface.off[0])
            for row in surface.rows:
                values = (*start, *row[:5], int(row[5]))
                writer.writerow(f"{v:.6g}" if isinstance(v, float) else v for v in values)


def main() -> None:
    """Solve, or make the tables."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("what", choices=("solve", "table", "halve", "shown"))
    parser.add_argument("folder", type=Path, nargs="?", default=Path("attracted"))
    parser.add_argument("--seeds", type=int, default=8)
    parser.add_argument("--cells", nargs="*", help="names of cells; by default all")
    parser.add_argument("--device", type=torch.device, default=torch.device("cpu"))
    parser.add_argument("--workers", type=int, default=1, help="processes that solve")
    parser.add_argument("--seconds", type=float, default=inf, help="start no surface after these")
    parser.add_argument("--out", type=Path)
    chosen = parser.parse_args()
    if chosen.what == "shown":
        sys.stdout.write("\n".join(shown()) + "\n")
        return
    chosen.folder.mkdir(parents=True, exist_ok=True)
    if chosen.what == "solve":
        cells = [cell for cell in CELLS if not chosen.cells or cell.name in chosen.cells]
        last = time() + chosen.seconds
        with ProcessPoolExecutor(chosen.workers, get_context("spawn")) as workers:
            together = chosen.seeds if chosen.device.type == "cuda" else 1
            for first in range(0, chosen.seeds, together):
                for cell in cells:
                    seeds = range(first, first + together)
                    workers.submit(solve_in_time, cell, seeds, chosen.folder, chosen.device, last)
        return
    if chosen.what == "halve":
        torch.set_num_threads(1)
        for cell in CELLS[:24:2]:
            sys.stdout.write(halve(cell) + "\n")
            sys.stdout.flush()
        return
    write_rows(chosen.folder)
    text = tables(chosen.folder)
    sys.stdout.write(text + "\n")
    if chosen.out:
        chosen.out.write_text(_put(chosen.out.read_text(), "attracted", text))


if __name__ == "__main__":
    main()
