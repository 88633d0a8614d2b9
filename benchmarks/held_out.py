"""The few-spots theory refitted without whole groups of its rows, and tested on what was left out.

    python benchmarks/held_out.py [--out docs/mean-field.md]

Each wave count, solid, band and Hurst exponent of tests/data/few-spots.csv is left out in turn.
The numbers of "corrected" that boundary elements decide are fitted to the rest: c to the areas,
gamma and reach to the mean gaps, by least squares of logarithms. The logarithms of theory over
elements are polynomials of the second degree in these numbers, tabulated around those in use.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
import torch
from scipy.optimize import least_squares

from haptix.model.contact import THEORIES, AreaLaw

sys.path.insert(0, str(Path(__file__).parent))
import few_spots
from mean_field import _put
from mean_field_cases import mean_gap

CORRECTED = THEORIES["corrected"]
LEAST_X = 3e-5
TIPS = np.log([0.011, 0.015, 0.022, 0.032, 0.045])
GAPS = np.array(list(product((0.275, 0.295, 0.315, 0.335, 0.355), np.log([1.1, 1.2, 1.3, 1.45]))))
MIDDLE = np.array([CORRECTED.gamma, np.log(CORRECTED.reach)])
GROUPS: dict[str, Callable[[few_spots.Cell], object]] = {
    "waves": lambda cell: cell.waves**2,
    "solid": lambda cell: cell.solid,
    "q1/q_r": lambda cell: cell.band,
    "H": lambda cell: cell.hurst,
}


def powers(at: np.ndarray) -> np.ndarray:
    """Monomials up to the second degree of points, shape (points, numbers)."""
    rest = [at[:, i] * at[:, j] for i in range(at.shape[1]) for j in range(i, at.shape[1])]
    return np.column_stack([np.ones(len(at)), at, *rest])


def polynomial(at: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Coefficients through values of shape (points, rows) at points, shape (monomials, rows)."""
    return np.linalg.lstsq(powers(at), values, rcond=None)[0]


def tabulate() -> tuple[list[few_spots.Cell], np.ndarray, np.ndarray, np.ndarray]:
    """Cell and x of each row, and the polynomials of its area and of its gap."""
    of_row, x, areas, gaps = [], [], [], []
    for cell, rows in few_spots.cells().items():
        used = [r for r in rows if r["converged"] == r["surfaces"] and float(r["x_long"]) > LEAST_X]
        pressure, area, gap = (
            torch.tensor([float(row[name]) for row in used], dtype=torch.float64)
            for name in ("pressure_pa", "area", "gap")
        )
        of_row += [cell] * len(used)
        x += [float(row["x_long"]) for row in used]
        contact = cell.contact(CORRECTED, float(rows[0]["h_rms"]))
        found = []
        for tips in np.exp(TIPS):
            contact = cell.contact(
                replace(CORRECTED, area=AreaLaw(CORRECTED.area.slowing, float(tips))),
                float(rows[0]["h_rms"]),
            )
            found.append(np.log(contact.area_fraction(pressure) / area))
        areas.append(polynomial(TIPS[:, None], np.stack(found)))
        found = []
        for gamma, reach in GAPS:
            theory = replace(CORRECTED, gamma=float(gamma), reach=float(np.exp(reach)))
            contact = cell.contact(theory, float(rows[0]["h_rms"]))
            found.append(np.log(mean_gap(contact, pressure) / few_spots.H_RMS / gap))
        gaps.append(polynomial(GAPS - MIDDLE, np.stack(found)))
        sys.stderr.write(f"{cell}\n")
    return of_row, np.array(x), np.concatenate(areas, 1), np.concatenate(gaps, 1)


def table() -> str:
    """Fits with each group left out, and the errors in it."""
    of_row, x, areas, gaps = tabulate()
    light = x < 5e-4

    def line(name: str, fit: np.ndarray, test: np.ndarray) -> str:
        tips = np.log([CORRECTED.area.tips])
        form = np.zeros(2)
        if fit.any():
            tips = least_squares(lambda c: (powers(c[None]) @ areas[:, fit])[0], tips).x
            form = least_squares(lambda g: (powers(g[None]) @ gaps[:, fit])[0], form).x
        gamma, reach = form + MIDDLE
        cells = [f"{np.exp(tips[0]):.3f}", f"{gamma:.3f}", f"{np.exp(reach):.2f}"]
        for found in ((powers(tips[None]) @ areas)[0], (powers(form[None]) @ gaps)[0]):
            for rows in (test & light, test & ~light):
                wrong = 100 * np.abs(np.expm1(found[rows]))
                cells.append(f"{np.median(wrong):.0f} / {wrong.max():.0f}")
        return f"| {name} | {test.sum()} | " + " | ".join(cells) + " |"

    every, none = np.ones(len(x), bool), np.zeros(len(x), bool)
    lines = [
        "| left out | rows | c | gamma | reach | A/A0, x_long < 5e-4 | above | mean gap, < 5e-4 "
        "| above |",
        "|---|---|---|---|---|---|---|---|---|",
        line("as in use", none, every),
        line("none: fitted to all", every, every),
    ]
    for name, of in GROUPS.items():
        for value in dict.fromkeys(of(cell) for cell in of_row):
            out = np.array([of(cell) == value for cell in of_row])
            lines.append(line(f"{name} {value}", ~out, out))
    return "\n".join(lines)


def main() -> None:
    """Print the table, or put it into the page between its marks."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, help="page to renew, such as docs/mean-field.md")
    page = parser.parse_args().out
    found = table()
    if page is None:
        sys.stdout.write(found + "\n")
    else:
        page.write_text(_put(page.read_text(encoding="utf-8"), "held-out", found), encoding="utf-8")


if __name__ == "__main__":
    main()
