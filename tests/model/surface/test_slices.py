"""A slice of a surface against the surface itself, and against the model over a period."""

import math

import numpy as np
import pytest
import torch

import haptix
from haptix import InputError, Status
from haptix.model.surface import Slice
from haptix.play.render import DirectWave


@pytest.fixture(scope="module")
def fine(model):
    scene = {"normal_force_n": (0.2, 1.0), "frequency_hz": 4000.0}
    return haptix.FrictionSurface.build(model, scene, tolerance=2e-4)


@pytest.fixture(scope="module")
def ends_everywhere():
    """A surface that ends at its limit, at breakdown and at pull-in, depending on the force."""
    screen = haptix.Screen(max_voltage_v=600.0, insulator_strength_v_per_m=2e9)
    finger = haptix.Finger.preset("semi-wet")
    model = haptix.ContactModel(finger, screen, terms={"breakdown": True})
    scene = {"normal_force_n": (0.01, 1.0), "voltage_v": (0.0, 500.0), "frequency_hz": 125.0}
    return haptix.FrictionSurface.build(model, scene, tolerance=5e-3)


def ends(surface, force):
    """Lowest and highest friction, and the amplitude there: outside, those of the nearest force."""
    places = {"normal_force_n": torch.as_tensor(force), "frequency_hz": None, "h0_m": None}
    volts = torch.tensor([[0.0], [math.inf]], dtype=torch.float64)
    low, high = surface.table.evaluate(volts, places)[0].reshape(2, -1).numpy()
    return low, high, surface.table.end(places).numpy()


def cases(surface, seed):
    """Forces on and off the axis, and frictions below, within and above what can be given."""
    random = np.random.default_rng(seed)
    axis = surface.normal_force_n
    force = np.exp(random.uniform(np.log(axis.low) - 0.1, np.log(axis.high) + 0.1, 3000))
    low, high, _ = ends(surface, force)
    return force, low + random.uniform(-0.3, 1.5, 3000) * (high - low)


@pytest.mark.parametrize("name", ["fine", "ends_everywhere"])
def test_a_slice_answers_as_its_surface(name, request):
    surface = request.getfixturevalue(name)
    force, _ = cases(surface, 1)
    slice_ = Slice.of(surface.table)
    low, high, end_v = ends(surface, force)
    lowest, highest = slice_.reach(force)
    np.testing.assert_allclose(lowest, low, rtol=1e-12)
    np.testing.assert_allclose(highest, high, rtol=1e-12)
    within = np.linspace(0, 1, len(force)) * end_v
    expected = surface.evaluate(force, within).mu
    np.testing.assert_allclose(slice_.mu(force, within), expected, rtol=1e-12)
    np.testing.assert_allclose(slice_.mu(force, 2 * end_v), high, rtol=1e-12)


@pytest.mark.parametrize("name", ["fine", "ends_everywhere"])
def test_a_column_answers_as_its_surface(name, request):
    surface = request.getfixturevalue(name)
    slice_ = Slice.of(surface.table)
    seen = set()
    for force, mu in zip(*(column[:40] for column in cases(surface, 1)), strict=True):
        column = slice_.column(float(force))
        wanted = np.append(np.linspace(0.05, 1.2, 57), mu)
        voltage, status = column.voltage(wanted)
        truth = surface.voltage(wanted, force)
        np.testing.assert_array_equal(status, truth.status.numpy())
        # Rounding: V = sqrt of a difference of numbers of order 1, where it is 1e-3 V or more.
        np.testing.assert_allclose(voltage, truth.voltage_v.numpy(), rtol=1e-9, atol=1e-5)
        low, high, end_v = (end.item() for end in ends(surface, force))
        assert column.end_v == pytest.approx(end_v, rel=1e-12)
        assert (column.lowest_mu, column.highest_mu) == pytest.approx((low, high), rel=1e-12)
        seen |= set(status.tolist())
    assert len(seen) >= 4


def test_a_slice_of_a_single_force(model):
    surface = haptix.FrictionSurface.build(model, {"normal_force_n": 0.5}, tolerance=0.01)
    column = Slice.of(surface.table).column(0.5)
    mu = np.linspace(float(column.lowest_mu), float(column.highest_mu), 9)
    voltage, status = column.voltage(mu)
    np.testing.assert_allclose(surface.mu(0.5, voltage), mu, rtol=1e-9)
    assert set(status.tolist()) == {Status.OK}
    assert set(Slice.of(surface.table).column(0.6).voltage(mu)[1].tolist()) == {Status.OUT_OF_RANGE}


def test_a_surface_that_was_not_sliced(model):
    scene = {"normal_force_n": 0.5, "frequency_hz": (100.0, 4000.0)}
    wide = haptix.FrictionSurface.build(model, scene, tolerance=0.05)
    with pytest.raises(InputError, match=r"surface\.at"):
        Slice.of(wide.table)


@pytest.mark.parametrize("force", [0.3, 1.0])
@pytest.mark.parametrize("frequency_hz", [60.0, 500.0])
def test_friction_is_averaged_over_the_period_of_a_direct_drive(model, force, frequency_hz):
    """Against the model solved through the period, which knows no surface and no average."""
    scene = {"normal_force_n": (0.2, 1.0), "frequency_hz": frequency_hz}
    surface = haptix.FrictionSurface.build(model, scene, tolerance=2e-4)
    drive = DirectWave(frequency_hz)
    column = Slice.of(surface.table).averaged(drive.attraction).column(force)
    naive = Slice.of(surface.table).column(force)
    for share in (0.25, 0.5, 0.75, 1.0):
        target = column.lowest_mu + share * (column.highest_mu - column.lowest_mu)
        felt = []
        for one in (column, naive):
            ((voltage,), _) = one.voltage(np.array([target]))
            period = model.over_period(force, min(voltage, 200.0), frequency_hz)
            felt.append(float(period.mu.mean()))
        # A twentieth of what can be felt. All gaps are taken to pull at the same time of a period,
        # which is worth up to 0.04 of it where the insulators are thinnest.
        assert felt[0] == pytest.approx(target, rel=0.05 * 0.11)
        if share < 1.0:  # both end at the screen's limit
            assert abs(felt[0] - target) < 0.3 * abs(felt[1] - target)


def test_a_square_wave_has_no_ripple():
    assert DirectWave(125.0, "square").attraction is None
    pulls = DirectWave(125.0).attraction
    assert pulls.mean() == pytest.approx(1.0, rel=1e-12)
    assert pulls.max() == pytest.approx(2.0, rel=2e-3)  # of 64 places none is just at the peak
