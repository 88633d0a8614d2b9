"""The mean field against boundary elements, term by term: the table of docs/mean-field.md.

    python benchmarks/mean_field.py [--out docs/mean-field.md]

The reference is tests/data/boundary-elements: solutions by tamaas of several random surfaces each,
pure contact and with voltage, the attraction acting on every point. Rows at x = p/(E* slope) below
2e-4 are left out: a few spots, which scatter by a sixth to a third.
"""

from __future__ import annotations

import argparse
import csv
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch

from haptix.contact import THEORIES, AreaLaw, HalfSpace, MeanField, RoughnessSpectrum, Theory
from haptix.contact.gaps import bin_inverse_square
from haptix.electro import Attraction, AttractionTable, drive_strength
from haptix.equilibrium import lowest_branch

REFERENCE = Path(__file__).parents[1] / "tests" / "data" / "boundary-elements"
SURFACE_OF_BASE = {"A": "S1", "C": "S6"}
LEAST_X = 2e-4

PUBLISHED, CORRECTED = THEORIES["open-gaps"], THEORIES["corrected"]
STEPS = {
    "as published": THEORIES["as-published"],
    "without the spots' pull": PUBLISHED,
    "and the area corrected": Theory(CORRECTED.area, 0.45, "plain", "excluded", ""),
    "and gamma": Theory(CORRECTED.area, CORRECTED.gamma, "plain", "excluded", ""),
    "and combined gaps: `corrected`": CORRECTED,
    "only combined gaps": Theory(AreaLaw(), 0.45, "combined", "excluded", ""),
}


def rows(name: str) -> list[dict[str, str]]:
    """Read one of the reference's tables."""
    with (REFERENCE / f"{name}.csv").open(newline="") as file:
        return list(csv.DictReader(file))


@dataclass(frozen=True)
class Reference:
    """The mean field of one of the reference's surfaces, by one theory."""

    contact: MeanField
    effective_modulus_pa: float
    h_rms_m: float
    spots_load: bool

    @classmethod
    def of(cls, name: str, theory: Theory) -> Reference:
        """Take the spectrum at the roughness that the surfaces have."""
        row = next(row for row in rows("sets") if row["set"] == name)
        h_rms = float(row["hrms"])
        spectrum = RoughnessSpectrum.self_affine(
            h_rms, *(float(row[key]) for key in ("H", "q0", "qr", "q1"))
        )
        contact = MeanField(
            spectrum,
            HalfSpace(float(row["E"]), float(row["nu"])),
            theory.gamma,
            theory.gap_distribution,
            area=theory.area,
        )
        return cls(contact, float(row["Estar"]), h_rms, theory.contact_spots == "included")

    def scale_pa(self) -> float:
        """``E* slope`` [Pa]."""
        return self.effective_modulus_pa * float(self.contact.spectrum.slope_rms)

    def coupled(self, applied_pa: float, voltage_v: float, h0_m: float) -> torch.Tensor:
        """Pressure of the contact under a voltage."""
        table = AttractionTable.solve(self.contact, applied_pa, 40 * applied_pa)
        h0 = torch.tensor([h0_m], dtype=torch.float64)
        spots = self.contact.area_fraction if self.spots_load else None
        kernel = bin_inverse_square(self.contact.gap_edges_m, h0)
        pull = Attraction(table.log_pull(kernel), torch.zeros(1, dtype=torch.long), h0**-2, spots)
        applied = torch.tensor([applied_pa], dtype=torch.float64)
        strength = drive_strength(torch.tensor([voltage_v], dtype=torch.float64))
        return lowest_branch(applied, strength, pull).pressure_pa


def pure_contact(theory: Theory) -> dict[str, np.ndarray]:
    """x, and A/A0 and mean gap over those of the reference."""
    found: dict[str, list[float]] = {"x": [], "area": [], "gap": []}
    for base, surface in SURFACE_OF_BASE.items():
        ours = Reference.of(surface, theory)
        for row in rows("pure_contact"):
            x = float(row["x=p/(E*slope)"])
            if row["base"] != base or x < LEAST_X:
                continue
            pressure = x * ours.scale_pa()
            gap = float(ours.contact.mean_gap(pressure)) / ours.h_rms_m
            found["x"].append(x)
            found["area"].append(float(ours.contact.area_fraction(pressure)) / float(row["A_corr"]))
            found["gap"].append(gap / float(row["ubar/h"]))
    return {name: np.array(values) for name, values in found.items()}


def coupled_contact(theory: Theory) -> dict[str, np.ndarray]:
    """A/A0, pull of the gaps, mean gap and mu_on/mu_off over those of the reference."""
    found: dict[str, list[float]] = {"voltage": [], "area": [], "pull": [], "gap": [], "ratio": []}
    pure = rows("pure_contact")
    for row in rows("coupled"):
        ours = Reference.of(row["set"], theory)
        applied, voltage = float(row["p0_Pa"]), float(row["V0_V"])
        x = applied / ours.scale_pa()
        if x < LEAST_X or row["n"] != "512":
            continue
        pressure = ours.coupled(applied, voltage, float(row["h0_m"]))
        area = float(ours.contact.area_fraction(pressure))
        gaps = float(row["pa_Pa"]) - float(row["pa_contact_Pa"])
        own_pull = float(pressure) - applied
        if ours.spots_load:  # of which the spots' own share is not the gaps'
            strength = float(drive_strength(torch.tensor(voltage, dtype=torch.float64)))
            own_pull -= strength * area / float(row["h0_m"]) ** 2
        base = [r for r in pure if r["base"] == ("C" if row["set"] in ("S6", "S8") else "A")]
        at = np.log([float(r["x=p/(E*slope)"]) for r in base])
        off = float(np.exp(np.interp(np.log(x), at, np.log([float(r["A_corr"]) for r in base]))))
        own_off = float(ours.contact.area_fraction(applied))
        found["voltage"].append(voltage)
        found["area"].append(area / float(row["A_corr"]))
        found["pull"].append(own_pull / gaps)
        found["gap"].append(float(ours.contact.mean_gap(pressure)) / float(row["ubar_m"]))
        found["ratio"].append(area / own_off / (float(row["A_corr"]) / off))
    return {name: np.array(values) for name, values in found.items()}


def _error(ratios: np.ndarray) -> str:
    wrong = np.abs(ratios - 1)
    return f"{100 * np.median(wrong):.0f} / {100 * wrong.max():.0f}"


def table() -> str:
    """Errors of every step, median / largest, in per cent."""
    lines = [
        "| theory | A/A0 | mean gap | A/A0 under voltage | pull of the gaps | mean gap under "
        "voltage | mu_on/mu_off |",
        "|---|---|---|---|---|---|---|",
    ]
    for name, theory in STEPS.items():
        pure, coupled = pure_contact(theory), coupled_contact(theory)
        usual = pure["x"] > 9e-4
        lines.append(
            f"| {name} | {_error(pure['area'][usual])} | {_error(pure['gap'][usual])} | "
            + " | ".join(_error(coupled[key]) for key in ("area", "pull", "gap", "ratio"))
            + " |"
        )
    return "\n".join(lines)


def by_load() -> str:
    """A/A0 and mean gap over the reference's, against the load."""
    lines = ["| x = p/(E* slope) | A/A0 published | corrected | mean gap published | corrected |"]
    lines.append("|---|---|---|---|---|")
    published, corrected = pure_contact(PUBLISHED), pure_contact(CORRECTED)
    for x in np.unique(published["x"]):
        here = published["x"] == x
        cells = [
            " ".join(f"{ratio:.2f}" for ratio in values[here])
            for values in (
                published["area"],
                corrected["area"],
                published["gap"],
                corrected["gap"],
            )
        ]
        lines.append(f"| {x:.0e} | {' | '.join(cells)} |")
    return "\n".join(lines)


def main() -> None:
    """Print the tables, or put them into the page between its marks."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, help="page to renew, such as docs/mean-field.md")
    arguments = parser.parse_args()
    tables = f"{table()}\n\n{by_load()}\n"
    if arguments.out is None:
        sys.stdout.write(tables)
        return
    page = arguments.out.read_text(encoding="utf-8")
    start, end = "<!-- tables -->\n", "<!-- end of tables -->\n"
    before, _, rest = page.partition(start)
    _, _, after = rest.partition(end)
    arguments.out.write_text(f"{before}{start}\n{tables}\n{end}{after}", encoding="utf-8")


if __name__ == "__main__":
    main()
