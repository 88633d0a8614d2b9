"""Accuracy and speed along the main path, as the README quotes them.

    .venv/bin/python benchmarks/main_path.py

Errors are against the slow reference solver's numbers in tests/data/meanfield.json. Times are the
median of five runs in one process.
"""

import json
import resource
import statistics
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import torch

from haptix import ContactModel, Finger, Screen
from haptix.model.contact import HalfSpace, Layered, MeanField, RoughnessSpectrum
from haptix.model.fidelity import FidelityName

REFERENCE = Path(__file__).parent.parent / "tests" / "data" / "meanfield.json"


def _solve(model: ContactModel, count: int) -> object:
    return model.solve(*states(count))


def _solve_anew(finger: Finger, screen: Screen, fidelity: FidelityName) -> object:
    return _solve(ContactModel(finger, screen, fidelity), 100_000)


def median_s(work: Callable[[], object]) -> float:
    times = []
    for _ in range(5):
        began = time.perf_counter()
        work()
        times.append(time.perf_counter() - began)
    return statistics.median(times)


def reference_errors() -> None:
    print("largest relative difference from the reference solver, spots included")
    for case in json.loads(REFERENCE.read_text())["cases"]:
        rough, solid = case["roughness"], case["solid"]
        spectrum = RoughnessSpectrum.self_affine(
            rough["h_rms"], rough["H"], rough["q0"], rough["qr"], rough["q1"]
        )
        modulus: HalfSpace | Layered = HalfSpace(solid["E"], solid["nu"])
        if "d" in solid:
            modulus = Layered(
                solid["E"], solid["nu"], solid["d"], solid["E_bulk"], solid["nu_bulk"]
            )
        contact = MeanField(spectrum, modulus, case["gamma"], case["gap_distribution"])
        pressure = torch.tensor([row["p"] for row in case["rows"]], dtype=torch.float64)

        def worst(ours: torch.Tensor, theirs: list[float]) -> float:
            return float((ours / torch.tensor(theirs, dtype=torch.float64) - 1).abs().max())

        area = worst(contact.area_fraction(pressure), [row["area"] for row in case["rows"]])
        gap = worst(contact.mean_gap(pressure), [row["ubar"] for row in case["rows"]])
        inverse = max(
            worst(
                contact.inverse_square_gap(pressure, complex(*h0) if isinstance(h0, list) else h0),
                [row["I"][number] for row in case["rows"]],
            )
            for number, h0 in enumerate(case["h0"])
        )
        print(f"  {case['name']:48} A/A0 {area:.0e}   mean gap {gap:.0e}   I {inverse:.0e}")


def states(count: int) -> tuple[torch.Tensor, ...]:
    """Force, voltage, frequency and h0 that broadcast to 50 x 200 x `count` / 10,000 states."""
    return (
        torch.logspace(-1, 0, 10)[:, None, None, None],
        torch.linspace(0, 200, count // 2000)[:, None, None],
        torch.logspace(1, 5, 20)[:, None],
        torch.logspace(-7, -6, 10),
    )


def peak_memory_mb() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def speeds() -> None:
    finger, screen = Finger.preset("semi-wet"), Screen.preset("3m-sct3250")
    before = peak_memory_mb()
    for fidelity in ("mean-field", "closed-form"):
        first = median_s(partial(_solve_anew, finger, screen, fidelity))
        print(f"100,000 states, {fidelity}: {first:.2f} s with the contact tables")
    model = ContactModel(finger, screen)
    model.solve(*states(10_000))
    for count in (10_000, 100_000, 1_000_000):
        each = median_s(partial(_solve, model, count)) / count
        print(f"{count:>9,} states on ready tables: {each * 1e6:.2f} us a state")
    print(f"memory: {before:.0f} MB with torch loaded, {peak_memory_mb():.0f} MB at the peak")


if __name__ == "__main__":
    reference_errors()
    speeds()
