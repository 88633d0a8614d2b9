"""The mean field against boundary elements, term by term: the table of docs/mean-field.md.

    python benchmarks/mean_field.py [--out docs/mean-field.md]

The reference is tests/data/boundary-elements: solutions by tamaas of several random surfaces each,
pure contact and with voltage, the attraction acting on every point. Rows at x = p/(E* slope) below
2e-4 are left out: a few spots, which scatter by a sixth to a third. Ends of the light contact,
other surfaces and layers are our own boundary elements', from benchmarks/mean_field_cases.py.
"""

from __future__ import annotations

import argparse
import csv
import sys
from collections.abc import Iterator
from dataclasses import dataclass, fields
from functools import cache
from pathlib import Path

import numpy as np
import torch

from haptix.model.contact import THEORIES, AreaLaw, HalfSpace, MeanField, RoughnessSpectrum, Theory
from haptix.model.electro import VACUUM_PERMITTIVITY, drive_strength

sys.path.insert(0, str(Path(__file__).parent))
import few_spots
from mean_field_cases import FOLDER as OWN
from mean_field_cases import Case, box_gap, end_of_light_contact, mean_gap, pull_in_voltage

REFERENCE = Path(__file__).parents[1] / "tests" / "data" / "boundary-elements"
SURFACE_OF_BASE = {"A": "S1", "C": "S6"}
LEAST_X = 2e-4

PUBLISHED, CORRECTED = THEORIES["open-gaps"], THEORIES["corrected"]
STEPS = {
    "as published": THEORIES["as-published"],
    "spots excluded": PUBLISHED,
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
    @cache
    def of(cls, name: str, theory: Theory) -> Reference:
        """Take the spectrum at the roughness that the surfaces have."""
        row = next(row for row in rows("sets") if row["set"] == name)
        h_rms = float(row["hrms"])
        spectrum = RoughnessSpectrum.self_affine(
            h_rms, *(float(row[key]) for key in ("H", "q0", "qr", "q1"))
        )
        skin = HalfSpace(float(row["E"]), float(row["nu"]))
        contact = theory.mean_field(spectrum, skin)
        return cls(contact, float(row["Estar"]), h_rms, theory.contact_spots == "included")

    def scale_pa(self) -> float:
        """``E* slope`` [Pa]."""
        return self.effective_modulus_pa * float(self.contact.spectrum.slope_rms)

    def coupled(self, applied_pa: float, voltage_v: float, h0_m: float) -> torch.Tensor:
        """Pressure of the contact under a voltage."""
        return end_of_light_contact(
            self.contact, applied_pa, voltage_v, h0_m, self.spots_load
        ).pressure_pa


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
            gap = float(mean_gap(ours.contact, pressure)) / ours.h_rms_m
            found["x"].append(x)
            found["area"].append(float(ours.contact.area_fraction(pressure)) / float(row["A_corr"]))
            found["gap"].append(gap / float(row["ubar/h"]))
    return {name: np.array(values) for name, values in found.items()}


def coupled_contact(theory: Theory) -> dict[str, np.ndarray]:
    """A/A0, attraction of the gaps, mean gap and mu_on/mu_off over those of the reference."""
    found: dict[str, list[float]] = {}
    for key in ("voltage", "area", "attraction", "gap", "ratio"):
        found[key] = []
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
        own_attraction = float(pressure) - applied
        if ours.spots_load:  # of which the spots' own share is not the gaps'
            strength = float(drive_strength(torch.tensor(voltage, dtype=torch.float64)))
            own_attraction -= strength * area / float(row["h0_m"]) ** 2
        base = [r for r in pure if r["base"] == ("C" if row["set"] in ("S6", "S8") else "A")]
        at = np.log([float(r["x=p/(E*slope)"]) for r in base])
        off = float(np.exp(np.interp(np.log(x), at, np.log([float(r["A_corr"]) for r in base]))))
        own_off = float(ours.contact.area_fraction(applied))
        found["voltage"].append(voltage)
        found["area"].append(area / float(row["A_corr"]))
        found["attraction"].append(own_attraction / gaps)
        found["gap"].append(float(mean_gap(ours.contact, pressure)) / float(row["ubar_m"]))
        found["ratio"].append(area / own_off / (float(row["A_corr"]) / off))
    return {name: np.array(values) for name, values in found.items()}


def _error(ratios: np.ndarray) -> str:
    wrong = np.abs(ratios - 1)
    return f"{100 * np.median(wrong):.0f} / {100 * wrong.max():.0f}"


def table() -> str:
    """Errors of every step, median / largest, in per cent."""
    lines = [
        "| theory | A/A0 | mean gap | A/A0 under voltage | attraction of the gaps | mean gap under "
        "voltage | mu_on/mu_off |",
        "|---|---|---|---|---|---|---|",
    ]
    for name, theory in STEPS.items():
        pure, coupled = pure_contact(theory), coupled_contact(theory)
        usual = pure["x"] > 9e-4
        lines.append(
            f"| {name} | {_error(pure['area'][usual])} | {_error(pure['gap'][usual])} | "
            + " | ".join(_error(coupled[key]) for key in ("area", "attraction", "gap", "ratio"))
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


def own_cases(name: str) -> Iterator[tuple[Case, dict[str, str]]]:
    """Rows that benchmarks/mean_field_cases.py solved, each with its case."""
    with (OWN / f"{name}.csv").open(newline="") as file:
        for row in csv.DictReader(file):
            given = {
                item.name: row[item.name]
                if item.type == "str"
                else row[item.name] == "True"
                if item.type == "bool"
                else float(row[item.name])
                for item in fields(Case)
            }
            yield Case(**given), row


@dataclass(frozen=True)
class Ending:
    """One case under voltage: the mean field over boundary elements."""

    case: Case
    pull_in_v: float
    """By boundary elements: the mean over surfaces; NaN where a surface does not end."""
    relative_scatter: float
    ratio: float
    """Voltage at which the light contact ends, over that by boundary elements."""
    applied_x: float
    """p0/(E* slope), each wave with its own modulus."""
    attractions: tuple[float, ...]
    """Attraction of the gaps over p0, by boundary elements, at each voltage."""
    area: tuple[float, ...]
    gap: tuple[float, ...]
    area_at_load: tuple[float, ...]
    """Area at p0 and the attraction by boundary elements, over theirs."""
    pull_at_load: tuple[float, ...]
    """Attraction of the gaps there, over theirs."""


def endings(theory: str, most_cases: int | None = None) -> list[Ending]:
    """Cases of our own under voltage, by a theory."""
    spots = THEORIES[theory].contact_spots == "included"
    of_case: dict[Case, list[dict[str, str]]] = {}
    for case, row in own_cases("voltage"):
        of_case.setdefault(case, []).append(row)
    found = []
    for case, given in list(of_case.items())[:most_cases]:
        contact = case.mean_field(theory, case.h_rms_m)
        attractions, areas, gaps, areas_at, pulls_at = [], [], [], [], []
        for row in given:
            voltage = float(row["voltage_v"])
            state = end_of_light_contact(contact, case.pressure_pa, voltage, case.h0_m, spots)
            if voltage == 0 or row["light"] != row["surfaces"] or not bool(state.is_stable):
                continue  # past an end, of ours or of theirs: ends are compared by themselves
            attractions.append(float(row["gaps_pa"]) / case.pressure_pa)
            areas.append(float(contact.area_fraction(state.pressure_pa)) / float(row["area"]))
            gaps.append(float(mean_gap(contact, state.pressure_pa)) / float(row["gap_m"]))
            theirs = float(row["gaps_pa"])
            load = torch.tensor([case.pressure_pa + theirs], dtype=torch.float64)
            widest = box_gap(contact)
            at = load
            if widest is not None:
                at = torch.exp(contact.touching(widest).of_pull(torch.log(load))[0])
            pull = contact.inverse_square_gap(at, case.h0_m, contact_spots="excluded")
            areas_at.append(float(contact.area_fraction(load)) / float(row["area"]))
            pulls_at.append(float(pull) * VACUUM_PERMITTIVITY / 4 * voltage**2 / theirs)
        end = float(given[0]["pull_in_v"])
        own = pull_in_voltage(end_of_light_contact(contact, case.pressure_pa, 0, case.h0_m, spots))
        scatter = float(given[0]["pull_in_v_std"]) / end
        found.append(
            Ending(
                *(case, end, scatter, own / end),
                case.pressure_pa / (2**0.5 * float(contact.stress_rms_pa)),
                *(tuple(attractions), tuple(areas), tuple(gaps)),
                *(tuple(areas_at), tuple(pulls_at)),
            )
        )
    return found


def by_voltage() -> str:
    """Tabulate the end of light contact, and states before it, case by case."""
    lines = [
        "| case | p0 [kPa] | h0 [um] | ends at [V] | as published | spots excluded | "
        "corrected | gaps' attraction / p0 | A/A0 | mean gap | A/A0 at their load | pull there |",
        "|---|---|---|---|---|---|---|---|---|---|---|---|",
    ]
    of_theory = [endings(name) for name in ("as-published", "open-gaps", "corrected")]
    for published, plain, corrected in zip(*of_theory, strict=True):
        case = corrected.case
        ends = "none"
        if corrected.pull_in_v == corrected.pull_in_v:
            ends = f"{corrected.pull_in_v:.0f} +- {100 * corrected.relative_scatter:.1f} %"
        ratios = [
            f"{e.ratio:.2f}" if e.ratio == e.ratio else "-" for e in (published, plain, corrected)
        ]
        lines.append(
            f"| {case.name}{'' if case.in_reference else ' *'} | {case.pressure_pa / 1e3:g} | "
            f"{case.h0_m * 1e6:g} | {ends} | {' | '.join(ratios)} | "
            f"{' '.join(f'{one:.1f}' for one in corrected.attractions)} | "
            f"{' '.join(f'{area:.2f}' for area in corrected.area)} | "
            f"{' '.join(f'{gap:.2f}' for gap in corrected.gap)} | "
            f"{' '.join(f'{area:.2f}' for area in corrected.area_at_load)} | "
            f"{' '.join(f'{pull:.2f}' for pull in corrected.pull_at_load)} |"
        )
    errors = []
    for ends_of in of_theory:
        ratios_of = np.array([ending.ratio for ending in ends_of])
        errors.append(_error(ratios_of[~np.isnan(ratios_of)]))
    lines.append(f"| median / largest error [%] | | | | {' | '.join(errors)} | | | | | |")
    return "\n".join(lines)


def by_layer() -> str:
    """A/A0 and mean gap over boundary elements' for layered solids without voltage."""
    lines = [
        "| case | x = p/(E* slope) | A/A0 published | corrected | mean gap published | corrected |",
        "|---|---|---|---|---|---|",
    ]
    for case, row in own_cases("layered"):
        if int(row["converged"]) < 3:
            continue
        pressure = float(row["pressure_pa"])
        fields_of = [case.mean_field(name, case.h_rms_m) for name in ("open-gaps", "corrected")]
        cells = [float(c.area_fraction(pressure)) / float(row["area"]) for c in fields_of]
        cells += [float(mean_gap(c, pressure)) / float(row["gap_m"]) for c in fields_of]
        lines.append(
            f"| {case.name} | {float(row['x']):.0e} | "
            + " | ".join(f"{cell:.2f}" for cell in cells)
            + " |"
        )
    return "\n".join(lines)


def by_cell(use: str) -> str:
    """Corrected theory over boundary elements in rows that were fitted to, or not ("test")."""
    lines = [
        "| solid | waves, q1/q_r, H | surfaces | x_long | 5e-5 | 1e-4 | 3e-4 | 1e-3 | 3e-3 "
        "| 1e-2 |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    errors: dict[str, list[np.ndarray]] = {"A/A0": [], "mean gap": []}
    for cell, rows_of in few_spots.cells().items():
        given = [row for row in rows_of if float(row["x_long"]) > 3e-5]
        if cell.use != use:
            continue
        contact = cell.contact(CORRECTED, float(given[0]["h_rms"]))
        pressure = torch.tensor([float(row["pressure_pa"]) for row in given], dtype=torch.float64)
        touching = contact.touching(box_gap(contact))
        at_pull = torch.exp(touching.of_pull(torch.log(pressure))[0])
        unit = few_spots.H_RMS
        whole = np.array([int(row["converged"]) == int(row["surfaces"]) for row in given])
        ours = {
            "A/A0": contact.area_fraction(pressure),
            "mean gap": mean_gap(contact, pressure) / unit,
            "pull 0.02": contact.inverse_square_gap(at_pull, 0.02 * unit, "excluded") * unit**2,
            "pull 0.1": contact.inverse_square_gap(at_pull, 0.1 * unit, "excluded") * unit**2,
        }
        columns = {
            "A/A0": "area",
            "mean gap": "gap",
            "pull 0.02": "pull_0.02",
            "pull 0.1": "pull_0.1",
        }
        for name, values in ours.items():
            ratio = values.numpy() / np.array([float(row[columns[name]]) for row in given])
            if name in errors:
                errors[name].append(np.where(whole, ratio, np.nan))
            shown = " | ".join(
                f"{one:.2f}" if ok else "-" for one, ok in zip(ratio, whole, strict=True)
            )
            head = f"{cell.solid} | {cell.waves}, {cell.band}, {cell.hurst} | {cell.surfaces}"
            lines.append(f"| {head if name == 'A/A0' else ' | | '} | {name} | {shown} |")
    for name, found in errors.items():
        wrong = np.abs(np.stack(found) - 1)
        light, usual = wrong[:, :3], wrong[:, 3:]
        lines.append(
            f"| median / largest error [%] | | | {name} | {_spread(light)} | | | "
            f"{_spread(usual)} | | |"
        )
    return "\n".join(lines)


def _spread(wrong: np.ndarray) -> str:
    return f"{100 * np.nanmedian(wrong):.0f} / {100 * np.nanmax(wrong):.0f}"


def _put(page: str, mark: str, tables: str) -> str:
    start, end = f"<!-- {mark} -->\n", f"<!-- end of {mark} -->\n"
    before, _, rest = page.partition(start)
    _, _, after = rest.partition(end)
    if not after:
        raise SystemExit(f"expected the marks {start.strip()} and {end.strip()} in the page")
    return f"{before}{start}\n{tables}\n\n{end}{after}"


def main() -> None:
    """Print the tables, or put them into the page between its marks."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, help="page to renew, such as docs/mean-field.md")
    arguments = parser.parse_args()
    parts = {
        "tables": f"{table()}\n\n{by_load()}",
        "voltage": by_voltage(),
        "layers": by_layer(),
        "fit": by_cell("fit"),
        "test": by_cell("test"),
    }
    if arguments.out is None:
        sys.stdout.write("\n\n".join(parts.values()) + "\n")
        return
    page = arguments.out.read_text(encoding="utf-8")
    for mark, tables in parts.items():
        page = _put(page, mark, tables)
    arguments.out.write_text(page, encoding="utf-8")


if __name__ == "__main__":
    main()
