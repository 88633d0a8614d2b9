"""Contacts with few spots, layers and a finite size, by the corrected theory."""

from __future__ import annotations

import csv
import math
from pathlib import Path

import numpy as np
import pytest
import torch
from scipy.special import erf

from haptix.model.contact import THEORIES, AreaLaw, HalfSpace, Layered, MeanField, RoughnessSpectrum
from haptix.model.contact.accuracy import SHOWN_ERRORS, VALIDATED_X
from haptix.model.contact.boundary_elements import Surfaces
from haptix.model.contact.finite_size import Touching, highest_peak, once_for_equals, peaks_per_area

ROWS = Path(__file__).parents[2] / "data" / "few-spots.csv"
CORRECTED = THEORIES["corrected"]
ROLLOFF = 2 * math.pi / 0.25e-3
SPECTRUM = RoughnessSpectrum.self_affine(5e-6, 0.86, ROLLOFF / 4, ROLLOFF, 32 * ROLLOFF)
SKIN = Layered(4e7, 0.5, 0.8 / ROLLOFF, 1e4, 0.5)


def tensor(*values: float) -> torch.Tensor:
    return torch.tensor(values, dtype=torch.float64)


def waves(skin: Layered) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """q, T(q), dT and 2 dT/(q E*) on 40,000 cells, by the midpoint rule."""
    q = np.geomspace(SPECTRUM.q0, SPECTRUM.q1, 40001)
    middle = np.sqrt(q[1:] * q[:-1])
    modulus = skin.effective_modulus(torch.from_numpy(middle)).numpy()
    density = SPECTRUM(torch.from_numpy(middle)).numpy()
    added = math.pi * middle**4 * density * modulus**2 * np.diff(np.log(q))
    return middle, added.cumsum() - added / 2, added, 2 * added / (middle * modulus)


def test_area_by_plain_sums() -> None:
    q, _, added, _ = waves(SKIN)
    contact = CORRECTED.mean_field(SPECTRUM, SKIN)
    second, fourth = (added * q**-2.0).sum(), (added * q**-4.0).sum()
    for share in (1e-6, 1e-4, 1e-2):
        pressure = share * math.sqrt(added.sum())
        curve = 0.022 * second / fourth * (pressure**2 * fourth / second**2) ** (-1 / 3)
        spread = math.sqrt((added / (1 + curve / q**2)).sum())
        area = 0.0
        for _ in range(200):
            area = erf(pressure / (spread * math.sqrt(0.48 + 0.52 * area)))
        # The table of the share is right to 1e-5.
        assert float(contact.area_fraction(pressure)) == pytest.approx(area, rel=2e-5)


@pytest.mark.slow
def test_mean_gap_by_plain_sums() -> None:
    q, total, added, opening = waves(SKIN)
    contact = CORRECTED.mean_field(SPECTRUM, SKIN)
    reached = np.interp(np.log(q * 1.3), np.log(q), total, right=added.sum())
    law = AreaLaw(0.48)
    # dU/dp = sum q-energy dW/dp, W = gamma A + (1 - gamma) A^2, and du = -dU/p.
    pressure = np.geomspace(1e-4, 60, 3001) * math.sqrt(added.sum())
    worth = []
    for p in pressure:
        at = torch.erf(law.argument(torch.from_numpy(p / np.sqrt(reached[::40])))).numpy()
        shares = CORRECTED.gamma * at + (1 - CORRECTED.gamma) * at**2
        worth.append(np.interp(np.arange(len(q)), np.arange(len(q))[::40], shares) @ opening / 4)
    gap = np.cumsum((np.diff(worth) / np.sqrt(pressure[1:] * pressure[:-1]))[::-1])[::-1]
    for i in (0, 800, 1200):
        # The rules of both sums: 1e-3.
        found = float(contact.mean_gap(float(pressure[i])))
        assert found == pytest.approx(gap[i], rel=3e-3)


def test_the_lightest_area_is_that_of_smooth_tips() -> None:
    contact = CORRECTED.mean_field(SPECTRUM, HalfSpace(4e7, 0.5))
    pressure = contact.stress_rms_pa * torch.logspace(-16, -15, 2, dtype=torch.float64)
    area = contact.area_fraction(pressure)
    # A band has a shortest wave, so that in the end every spot is a Hertzian tip: p^(2/3).
    assert float(torch.log10(area[1] / area[0])) == pytest.approx(2 / 3, abs=1e-3)
    heavy = contact.stress_rms_pa * tensor(1.0, 3.0)
    plain = MeanField(SPECTRUM, HalfSpace(4e7, 0.5), area=AreaLaw(0.48))
    # Heavy contact has the whole stress: q_s is 0.15 q_c.
    torch.testing.assert_close(
        contact.area_fraction(heavy), plain.area_fraction(heavy), rtol=2e-3, atol=0
    )


@pytest.mark.parametrize("waves_a_side", [2, 4, 8])
def test_the_highest_peak_of_drawn_surfaces(waves_a_side: int) -> None:
    spectrum = RoughnessSpectrum.self_affine(
        1.0, 0.86, ROLLOFF / waves_a_side, ROLLOFF, 16 * ROLLOFF
    )
    side = 2 * math.pi * waves_a_side / ROLLOFF
    with pytest.warns(UserWarning):  # of the pixels, which do not matter to heights
        drawn = Surfaces.random(spectrum, 64 * waves_a_side, side, surfaces=24, seed=3)
    peaks = drawn.height_m.amax((-2, -1)) / drawn.h_rms_m
    expected = float(highest_peak(spectrum.h_rms_m, peaks_per_area(spectrum), tensor(side**2)))
    # Three standard deviations of the mean of 24, which scatter by 10 %.
    assert float(peaks.mean()) == pytest.approx(expected, rel=0.06)


def test_the_size_of_a_contact_is_smooth() -> None:
    contact = CORRECTED.mean_field(SPECTRUM, SKIN)
    height = contact.highest_asperity(tensor(1e-6))
    touching = contact.touching(height)
    lightest = touching.log_pressure - 30
    at_rest = contact.mean_gap(torch.exp(touching.of_gap(lightest)))
    # e^(-20) is left, and the table of the mean gap is right to 1e-5.
    torch.testing.assert_close(at_rest, height, rtol=1e-4, atol=0)
    for law in ("capped", "smooth"):
        held = Touching(tensor(0.0), law)
        assert held.of_gap(tensor(60.0)).item() == pytest.approx(60.0, abs=1e-12)
        at = tensor(-3.0, -0.4, 0.4, 3.0)
        value, slope = held.of_pull(at)
        difference = (held.of_pull(at + 1e-6)[0] - held.of_pull(at - 1e-6)[0]) / 2e-6
        torch.testing.assert_close(slope, difference, rtol=1e-7, atol=1e-9)
        assert bool((held.of_gap(at) >= value - 1e-15).all() and (value >= at).all())


def test_no_contact_is_too_small_or_large_for_a_peak() -> None:
    area = torch.logspace(-30, 30, 61, dtype=torch.float64, requires_grad=True)
    height = highest_peak(SPECTRUM.h_rms_m, peaks_per_area(SPECTRUM), area)
    assert bool((height.diff() > 0).all() and (height > 0).all())
    (slope,) = torch.autograd.grad(height.sum(), area)
    assert bool((slope > 0).all() and slope.isfinite().all())


@pytest.fixture(scope="module")
def errors() -> dict[str, np.ndarray]:
    """Of theory over elements, minus 1, in the rows that the theory was not fitted to."""
    found: dict[str, list[float]] = {"x": [], "area": [], "gap": []}
    fields: dict[tuple[str, ...], tuple[MeanField, Touching]] = {}
    with ROWS.open(newline="") as file:
        rows = [row for row in csv.DictReader(file) if row["use"] == "test"]
    for row in rows:
        if int(row["converged"]) < int(row["surfaces"]):
            continue
        cell = tuple(row[name] for name in ("solid", "waves", "band", "hurst"))
        if cell not in fields:
            fields[cell] = _of_cell(row)
        contact, touching = fields[cell]
        pressure = tensor(float(row["pressure_pa"]))
        gap = contact.mean_gap(torch.exp(touching.of_gap(torch.log(pressure)))) / 5e-6
        found["x"].append(float(row["x_long"]))
        found["area"].append(float(contact.area_fraction(pressure)) / float(row["area"]) - 1)
        found["gap"].append(float(gap) / float(row["gap"]) - 1)
    return {name: np.array(values) for name, values in found.items()}


def _of_cell(row: dict[str, str]) -> tuple[MeanField, Touching]:
    thickness, contrast = {
        "half-space": (0.0, 1.0),
        "layer 0.3": (0.3, 4000.0),
        "layer 0.8": (0.8, 4000.0),
        "layer 3": (3.0, 4000.0),
        "layer 0.8 on E/100": (0.8, 100.0),
    }[row["solid"]]
    solid = (
        Layered(4e7, 0.5, thickness / ROLLOFF, 4e7 / contrast, 0.5)
        if thickness
        else HalfSpace(4e7, 0.5)
    )
    number, hurst = int(row["waves"]), float(row["hurst"])
    # The h_rms that the surfaces have, of the band that they have.
    spectrum = RoughnessSpectrum.self_affine(
        5e-6 * float(row["h_rms"]), hurst, ROLLOFF / number, ROLLOFF, int(row["band"]) * ROLLOFF
    )
    contact = CORRECTED.mean_field(spectrum, solid)
    side = tensor(2 * math.pi * number / ROLLOFF)
    return contact, contact.touching(contact.highest_asperity(side**2))


def test_rows_that_were_not_fitted(errors: dict[str, np.ndarray]) -> None:
    # What outputs say of the theory is what these rows show, in whole per cent.
    highest = math.inf
    for least, *said in SHOWN_ERRORS:
        here = (errors["x"] >= least) & (errors["x"] < highest)
        assert here.sum() >= 12
        area, gap = (100 * np.abs(errors[name][here]) for name in ("area", "gap"))
        assert said == [math.ceil(worst) for worst in (np.median(area), area.max(), gap.max())]
        highest = least
    assert highest == VALIDATED_X


def test_equal_neighbours_are_worked_out_once_and_keep_their_gradients() -> None:
    seen = []

    def cube(x: torch.Tensor) -> torch.Tensor:
        seen.append(len(x))
        return x**3

    x = tensor(2.0, 2.0, 2.0, 2.0, 3.0, 3.0, 2.0)
    assert (once_for_equals(cube, x) == x**3).all()
    assert seen == [3]
    # Each number has a gradient of its own, also where its neighbour is equal.
    leaf = x.clone().requires_grad_()
    (slope,) = torch.autograd.grad(once_for_equals(cube, leaf).sum(), leaf)
    assert (slope == 3 * x**2).all()
