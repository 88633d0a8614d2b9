"""Solve the boundary elements that docs/mean-field.md compares the mean field with, beside tamaas'.

    python benchmarks/mean_field_cases.py

Voltages up to the end of light contact, on surfaces of the reference and on others, and layered
solids without voltage. Writes tests/data/boundary-elements-own/; some 15 minutes on two cores.
A run that is interrupted resumes from the files beside its results.
"""

from __future__ import annotations

import csv
import sys
from dataclasses import asdict, dataclass
from functools import cache
from math import pi, sqrt
from pathlib import Path

import torch

from haptix.model.contact import THEORIES, HalfSpace, Layered, MeanField, RoughnessSpectrum
from haptix.model.contact.boundary_elements import BoundaryElements, Surfaces
from haptix.model.contact.elasticity import ElasticSolid
from haptix.model.electro import VACUUM_PERMITTIVITY, Pull
from haptix.model.fidelity import Balance, Contact, Load, MeanFieldBalance
from haptix.model.fidelity.balance import LIGHT_CONTACT_LIMIT

FOLDER = Path(__file__).parents[1] / "tests" / "data" / "boundary-elements-own"
SURFACES, SEED = 4, 7
SHARES = (0.0, 0.5, 0.75, 0.9)  # of the voltage at which the corrected mean field ends
LOADS = (1e-3, 1e-2, 1e-1)


@dataclass(frozen=True)
class Case:
    """A surface on a solid; with pressure, insulator and voltage, or at loads without."""

    name: str
    h_rms_m: float
    hurst: float
    q0: float
    q_rolloff: float
    q1: float
    youngs_modulus_pa: float
    poisson_ratio: float
    bulk_modulus_pa: float = 0.0  # 0 is a half-space
    layer_m: float = 0.0
    pressure_pa: float = 0.0  # 0 is LOADS
    h0_m: float = 0.0
    in_reference: bool = False
    points: int = 512

    def solid(self) -> ElasticSolid:
        """Half-space or layer."""
        if not self.layer_m:
            return HalfSpace(self.youngs_modulus_pa, self.poisson_ratio)
        return Layered(
            self.youngs_modulus_pa, self.poisson_ratio, self.layer_m, self.bulk_modulus_pa, 0.5
        )

    def spectrum(self, h_rms_m: float) -> RoughnessSpectrum:
        """C(q) with this roughness."""
        return RoughnessSpectrum.self_affine(h_rms_m, self.hurst, self.q0, self.q_rolloff, self.q1)

    def mean_field(self, theory: str, h_rms_m: float) -> MeanField:
        """The mean field of the surfaces that were drawn, by their roughness."""
        return THEORIES[theory].mean_field(self.spectrum(h_rms_m), self.solid())


_S1 = (1e-6, 0.8, 22525.449219252594, 90101.79677701038, 1441628.750032166, 4e7, 0.5)
_S2 = (1e-6, 0.86, 12106.426861732734, 48425.70744693094, 774811.319150895, 1e9, 0.3)
_S6 = (2e-6, 0.8, 8794.964804049363, 70359.7184323949, 281438.8737295796, 4e7, 0.5)
_S8 = (1e-6, 0.8, 8794.964804049363, 70359.7184323949, 281438.8737295796, 1e9, 0.3)
_H05 = (0.5e-6, 0.5, 22525.449219252594, 90101.79677701038, 1441628.750032166, 1e7, 0.5)

UNDER_VOLTAGE = (
    Case("S1", *_S1, pressure_pa=3e3, h0_m=2e-7, in_reference=True),
    Case("S1", *_S1, pressure_pa=1e4, h0_m=2e-7, in_reference=True),
    Case("S1", *_S1, pressure_pa=3e4, h0_m=2e-7, in_reference=True),
    Case("S1", *_S1, pressure_pa=1e4, h0_m=1e-6, in_reference=True),
    Case("S2", *_S2, pressure_pa=1e4, h0_m=2e-7, in_reference=True),
    Case("S2", *_S2, pressure_pa=1e5, h0_m=2e-7, in_reference=True),
    Case("S6", *_S6, pressure_pa=1e4, h0_m=1e-6, points=256),
    Case("S6", *_S6, pressure_pa=3e4, h0_m=2e-6, points=256),
    Case("S8", *_S8, pressure_pa=1e5, h0_m=3e-7, points=256),
    Case("H = 0.5, 10 MPa", *_H05, pressure_pa=5e3, h0_m=5e-7),
    Case("S1, 20 um on E/4000", *_S1, 1e4, 20e-6, 3e3, 5e-7),
)
LAYERED = (
    Case("S1, 20 um on E/10", *_S1, 4e6, 20e-6),
    Case("S1, 20 um on E/4000", *_S1, 1e4, 20e-6),
    Case("S1, 5 um on E/4000", *_S1, 1e4, 5e-6),
)


@cache
def _solver(contact: MeanField, applied_pa: float, spots_load: bool) -> MeanFieldBalance:
    return MeanFieldBalance(
        Contact(contact, "included" if spots_load else "excluded", None, applied_pa)
    )


def box_gap(contact: MeanField) -> torch.Tensor | None:
    """Largest mean gap [m] in a box of the longest wave, where the theory has it by default."""
    if contact.size == "capped":
        return None
    side = 2 * pi / contact.spectrum.q0
    return contact.highest_asperity(torch.tensor([side**2], dtype=torch.float64))


def mean_gap(contact: MeanField, pressure_pa: float | torch.Tensor) -> torch.Tensor:
    """The mean field's mean gap [m] in such a box."""
    pressure = torch.as_tensor(pressure_pa, dtype=torch.float64)
    widest = box_gap(contact)
    if widest is not None:
        touching = contact.touching(widest)
        pressure = torch.exp(touching.of_gap(torch.log(pressure)))
    return contact.mean_gap(pressure)


def end_of_light_contact(
    contact: MeanField, applied_pa: float, voltage_v: float, h0_m: float, spots_load: bool
) -> Balance:
    """The mean field's equilibrium, and where it ends."""
    applied, voltage, h0 = (
        torch.tensor([value], dtype=torch.float64) for value in (applied_pa, voltage_v, h0_m)
    )
    column = torch.zeros(1, dtype=torch.long)
    pull = Pull.of_sine(contact.gap_edges_m, voltage, h0, column)
    return _solver(contact, applied_pa, spots_load).solve(Load(applied, pull, box_gap(contact)))


def pull_in_voltage(found: Balance) -> float:
    """Voltage [V] at which the mean field's light contact ends."""
    return sqrt(float(found.strength_at_end) * 4 / VACUUM_PERMITTIVITY)


def _drawn(case: Case) -> Surfaces:
    """Surfaces; their h_rms is not quite the spectrum's, as a box has discrete wavenumbers."""
    spectrum = case.spectrum(case.h_rms_m)
    return Surfaces.random(spectrum, case.points, 2 * pi / case.q0, SURFACES, SEED)


def _solve_voltages(case: Case, number: int) -> list[dict[str, object]]:
    surfaces = _drawn(case)
    h_rms = float(surfaces.h_rms_m.mean())
    contact = case.mean_field("corrected", h_rms)
    expected = pull_in_voltage(
        end_of_light_contact(contact, case.pressure_pa, 0.0, case.h0_m, False)
    )
    # To a volt: the rows are what the files say they are.
    voltages = [float(round(share * expected)) for share in SHARES] + [float(round(2 * expected))]
    h0 = case.h0_m
    solved = BoundaryElements(surfaces, case.solid()).solve_attracted(
        case.pressure_pa,
        lambda gap: VACUUM_PERMITTIVITY / 4 / (gap + h0) ** 2,
        [voltage**2 for voltage in voltages],
        checkpoint=FOLDER / f"voltage-{number}.partial.npz",
        light_limit=LIGHT_CONTACT_LIMIT,
    )
    ends = solved.snap_in_strength[0, -1].mean(-1).sqrt()
    rows: list[dict[str, object]] = []
    for j, voltage in enumerate(voltages[:-1]):
        light = solved.status[0, j] == 0
        rows.append(
            {
                **asdict(case),
                "h_rms_m": h_rms,
                "surfaces": SURFACES,
                "voltage_v": voltage,
                "light": int(light.sum()),
                "converged": int(solved.converged[0, j].sum()),
                **_mean("area", solved.area_fraction[0, j]),
                **_mean("gap_m", solved.mean_gap_m[0, j]),
                **_mean("gaps_pa", solved.attraction_gaps_pa[0, j]),
                **_mean("pull_in_v", ends),
                # At the end: 30 where light contact ends by that measure, less at a fold.
                "gaps_over_p0_at_end": float(
                    (solved.attraction_gaps_pa[0, -1] / case.pressure_pa).mean()
                ),
            }
        )
    return rows


def _solve_layered(case: Case, number: int) -> list[dict[str, object]]:
    surfaces = _drawn(case)
    h_rms = float(surfaces.h_rms_m.mean())
    # E* slope of the waves, each with its own modulus: sqrt(2) times the rms stress.
    scale = sqrt(2) * float(case.mean_field("corrected", h_rms).stress_rms_pa)
    solved = BoundaryElements(surfaces, case.solid()).solve(
        [x * scale for x in LOADS], checkpoint=FOLDER / f"layered-{number}.partial.npz"
    )
    return [
        {
            **asdict(case),
            "h_rms_m": h_rms,
            "surfaces": SURFACES,
            "x": x,
            "pressure_pa": x * scale,
            "converged": int(solved.converged[i].sum()),
            **_mean("area", solved.area_fraction[i]),
            **_mean("gap_m", solved.mean_gap_m[i]),
        }
        for i, x in enumerate(LOADS)
    ]


def _mean(name: str, values: torch.Tensor) -> dict[str, float]:
    return {name: float(values.mean()), f"{name}_std": float(values.std())}


def _write(name: str, rows: list[dict[str, object]]) -> None:
    with (FOLDER / f"{name}.csv").open("w", newline="") as file:
        writer = csv.DictWriter(file, list(rows[0]), lineterminator="\n")
        writer.writeheader()
        for row in rows:
            writer.writerow({k: f"{v:.6g}" if isinstance(v, float) else v for k, v in row.items()})


def main() -> None:
    """Solve all cases, and write their files."""
    FOLDER.mkdir(exist_ok=True)
    for name, cases, solve in (
        ("layered", LAYERED, _solve_layered),
        ("voltage", UNDER_VOLTAGE, _solve_voltages),
    ):
        rows = []
        for number, case in enumerate(cases):
            rows += solve(case, number)
            sys.stderr.write(f"{name}: {number + 1} of {len(cases)}\n")
            _write(name, rows)
    for kept in FOLDER.glob("*.partial.npz"):
        kept.unlink()


if __name__ == "__main__":
    main()
