"""Kinds of materials: their closed forms, as the virtual finger feels them on a recorded path.

The finger goes forward at 100 mm/s, rests, goes on, turns round and comes back.
"""

import numpy as np
import pytest
from skimage.io import imsave

import haptix
from haptix.base.kinds import in_folder
from haptix.feel.materials import KINDS, material_of
from haptix.feel.motion import Trajectory
from haptix.play.simulation import Setting, simulate

JND_FELT = 0.05
"""The surface's tolerance is 0.03 JND; modulation and 16 bits add little."""
JND_ASKED = 0.25  # the figure for relief and detents at 100 mm/s

T = np.arange(0, 0.7, 0.005)
X = np.interp(T, [0, 0.15, 0.2, 0.35, 0.37, 0.7], [1, 16, 16, 31, 31, 1])


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Heights: a sine of 10 mm along x, and their normals."""
    folder = tmp_path_factory.mktemp("heights")
    x = (np.arange(400) + 0.5) * 0.1
    wave = 0.5 + 0.4 * np.cos(2 * np.pi * x / 10)
    heights = np.tile(wave * 65535, (200, 1)).astype(np.uint16)
    imsave(folder / "waves.png", heights, check_contrast=False)
    slope = np.tile(-np.sin(2 * np.pi * x / 10), (200, 1))
    n = np.stack([-slope, 0 * slope, 1 + 0 * slope], -1) / np.hypot(1, slope)[..., None]
    imsave(folder / "normals.png", ((n + 1) / 2 * 255).round().astype(np.uint8),
           check_contrast=False)  # fmt: skip
    return folder


@pytest.fixture(scope="module")
def surface(model):
    scene = {"normal_force_n": (0.2, 1.2), "frequency_hz": 4000.0}
    return haptix.FrictionSurface.build(model, scene, tolerance=1e-3)


def tick(edge):
    """Level that rises from 0 to 1 with the distance behind an edge."""
    return np.clip(edge, 0.0, 1.0)


def relief(x, y, t, vx, force):
    u = vx / np.hypot(vx, 2)
    bias = 0.5 * np.clip(np.minimum(x, 10) / 5, 0, 1)
    return bias - 0.5 * u * np.sin(2 * np.pi * x / 10)


def slider(x, y, t, vx, force):
    d = (x - 2.5) % 5  # ridges at 2.5, 7.5, ...
    d = np.minimum(d, 5 - d)
    return 0.5 + 0.5 * np.cos(2 * np.pi * np.minimum(d / 1.5, 0.5))


def toggle(x, y, t, vx, force):
    right = tick(1 + (x - 15) / 5) * tick(1 - (x - 15) / 0.3)
    left = tick(1 - (x - 15) / 5) * tick(1 + (x - 15) / 0.3)
    u = vx / np.hypot(vx, 2)
    return np.where(u > 0, right * u, -left * u)


def dial(x, y, t, vx, force):
    # The path is the chord y = 20 mm; the ridges of 12 detents are at 15, 45, ... degrees.
    angle, radius = np.degrees(np.arctan2(y, x)), np.hypot(x, y)
    away = np.radians((angle - 15 + 15) % 30 - 15) * radius
    away = np.abs(away)
    inside = tick(0.5 + np.minimum(radius - 10, 30 - radius) / 1.5)
    return inside * (0.5 + 0.5 * np.cos(2 * np.pi * np.minimum(away / 1.5, 0.5)))


WAVE = {"kind": "grating", "period_mm": 6.0}


def moving(x, y, t, vx, force):
    return 0.5 + 0.5 * np.sin(2 * np.pi * (x - 30 * t) / 6)


def envelope(x, y, t, vx, force):
    return (0.6 + 0.4 * np.cos(2 * np.pi * 20 * t)) * (0.5 + 0.5 * np.sin(2 * np.pi * x / 6))


def button(x, y, t, vx, force):
    depth = np.minimum(np.minimum(x, 30 - x), 10)
    inside, face = (tick(0.5 + (depth - at) / 0.3) for at in (0, 2))
    pressing = tick((force - 0.24) / 0.56)  # it is never pressed: that takes 0.8 N
    slides = np.abs(vx) / np.hypot(vx, 2)
    return np.maximum((inside - face) * slides, face * pressing)


def transient(x, y, t, vx, force):
    return np.where(t > 0.001, 0.4 - 0.4 * np.cos(2 * np.pi * 20 * (t - 0.001)), 0.0)


def effect(x, y, t, vx, force):
    # Late by a millisecond; what rises and falls takes two, low-passed at 1 kHz.
    level = np.where((t > 0.002) & (t < 0.080), 0.8 * 0.165, np.where(t > 0.082, 0.0, np.nan))
    return level


def wave(x, y, t, vx, force):
    return 0.5 + 0.5 * np.sin(2 * np.pi * x / 6)


def layout(x, y, t, vx, force):
    level = np.where(x < 20, slider(x, y, t, vx, force), wave(x - 20, y, t, vx, force))
    return np.where(np.abs(x - 20) < 0.2, np.nan, level)  # an edge is a ramp


def photograph(x, y, t, vx, force):
    # Grey from the 1st to the 99th percentile of a sine, 0.03 % from its ends.
    return 0.5 + 0.5 * np.cos(2 * np.pi * x / 10)


def on_a_background(x, y, t, vx, force):
    level = np.where((x > 10) & (x < 20), wave(x - 10, y, t, vx, force), 0.3)
    return np.where((np.abs(x - 10) < 0.2) | (np.abs(x - 20) < 0.2), np.nan, level)


CASES = {
    "button": ({"kind": "button", "width_mm": 30, "height_mm": 20}, button),
    "transient": (
        {"kind": "transient", "begins": "down",
         "curve": {"kind": "sine", "amplitude": 0.4, "offset": 0.4, "frequency_hz": 20.0,
                   "phase_rad": -np.pi / 2, "length_s": 0.7}},
        transient,
    ),
    "effect": ({"kind": "effect", "name": "edge", "intensity": 0.8}, effect),
    "layout": (
        {"kind": "layout", "regions": [
            {"material": {"kind": "slider", "travel_mm": 40}, "width_mm": 20, "height_mm": 20},
            {"material": {"kind": "grating", "period_mm": 6}, "x_mm": 20, "width_mm": 20,
             "height_mm": 20}]},
        layout,
    ),
    "grating": ({"kind": "grating", "period_mm": 6}, wave),
    "photograph": ({"kind": "photograph", "file": "waves.png", "width_mm": 40}, photograph),
    "background": (
        {"kind": "layout", "background": 0.3, "regions": [
            {"material": {"kind": "grating", "period_mm": 6}, "x_mm": 10, "width_mm": 10,
             "height_mm": 20}]},
        on_a_background,
    ),
    "relief": ({"kind": "relief", "heights": "waves.png", "width_mm": 40}, relief),
    "normals": ({"kind": "relief", "normals": "normals.png", "width_mm": 40}, relief),
    "slider": ({"kind": "slider", "travel_mm": 40, "detents": 9}, slider),
    "toggle": ({"kind": "toggle", "width_mm": 30}, toggle),
    "dial": ({"kind": "dial", "outer_mm": 30}, dial),
    "by-speed": (
        {"kind": "by-speed", "speed_mm_s": [0, 50, 200], "share": [0.1, 0.4, 1.0]},
        lambda x, y, t, vx, force: np.interp(np.abs(vx), [0, 50, 200], [0.1, 0.4, 1.0]),
    ),
    "by-force": (
        {"kind": "by-force", "normal_force_n": [0.4, 0.8], "share": [0.0, 1.0], "of": WAVE},
        lambda x, y, t, vx, force: (force - 0.4) / 0.4 * (0.5 + 0.5 * np.sin(2 * np.pi * x / 6)),
    ),
    "moving": ({"kind": "moving", "velocity_mm_s": [30, 0], "of": WAVE}, moving),
    "envelope": (
        {"kind": "envelope", "of": WAVE, "loop": True,
         "curve": {"kind": "sine", "amplitude": 0.4, "offset": 0.6, "frequency_hz": 20.0,
                   "phase_rad": np.pi / 2, "length_s": 0.05}},
        envelope,
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", CASES)
def test_a_kind_is_felt_there_back_at_rest_and_turning_as_its_closed_form(
    name, folder, model, surface
):
    table, closed_form = CASES[name]
    with in_folder(folder):
        material = material_of(table)
    force = 0.6 + 0.15 * np.sin(9 * T)
    path = Trajectory(T, X, np.full_like(T, 20.0 if name == "dial" else 10.0), force)
    found = simulate(Setting(model, material, path), surface)
    felt = found.felt
    vx = path.velocity_mm_per_s(felt.t_s)[0]
    share = (found.target_mu - found.lowest_mu) / (found.highest_mu - found.lowest_mu)
    asked = closed_form(felt.x_mm, felt.y_mm, felt.t_s, vx, felt.normal_force_n)
    if material.evaluator.target == "contrast":
        asked = asked * found.lowest_mu / (found.highest_mu - found.lowest_mu)
    known = ~np.isnan(asked)
    assert known.mean() > 0.95
    # The pyramid smooths a hundredth of a wave, the pictures have 8 or 16 bits.
    np.testing.assert_allclose(share[known], asked[known], rtol=0, atol=0.03)
    assert found.evaluation.evaluated > 0.6 * found.evaluation.samples
    # Each direction by itself, against the closed form, where the drive is not fading.
    mu = found.lowest_mu + asked * (found.highest_mu - found.lowest_mu)
    for goes in (1, -1):
        sliding = (np.sign(vx) == goes) & (np.abs(vx) > 90) & found.is_reachable & known
        error = np.abs(felt.mu - mu)[sliding] / (0.11 * mu[sliding])
        assert np.percentile(error, 95) < JND_ASKED
    assert found.evaluation.error_p95_jnd < JND_FELT


def test_every_kind_is_felt_here_or_is_one_of_these_fields():
    """Heights, noise, recordings, spectra and models of the Penn toolkit answer as their fields."""
    felt = {table["kind"] for table, _ in CASES.values()}
    # test_documents.py, test_spectral_models.py
    as_fields = {"heights", "noise", "recording", "penn", "spectral"}
    own = {kind for kind, of in KINDS.items() if of.__module__.startswith("haptix.")}
    assert felt | as_fields == own
