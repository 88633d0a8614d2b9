"""The renderer's inverse against the surface's own, and against the model over a period."""

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

import haptix
from haptix import InputError, Status
from haptix.electro.waveform import Waveform
from haptix.render import DirectWave, SliceInverse, Wishes

RATE = 48_000.0
MU, SHARE, CONTRAST = Wishes("mu"), Wishes("share"), Wishes("contrast")


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


def cases(surface, seed):
    """Forces on and off the axis, and frictions below, within and above what can be given."""
    random = np.random.default_rng(seed)
    axis = surface.normal_force_n
    force = np.exp(random.uniform(np.log(axis.low) - 0.1, np.log(axis.high) + 0.1, 3000))
    low, high = (m.numpy() for m in surface.reachable(torch.from_numpy(force)))
    return force, low + random.uniform(-0.3, 1.5, 3000) * (high - low)


@pytest.mark.parametrize("name", ["fine", "ends_everywhere"])
def test_it_says_what_the_surface_says(name, request):
    surface = request.getfixturevalue(name)
    force, mu = cases(surface, 1)
    ours, truth = SliceInverse(surface)(force, mu, MU), surface.voltage(mu, force)
    np.testing.assert_array_equal(ours.status, truth.status.numpy())
    # Rounding: V = sqrt of a difference of numbers of order 1, where it is 1e-3 V or more.
    np.testing.assert_allclose(ours.voltage_v, truth.voltage_v.numpy(), rtol=1e-9, atol=1e-5)
    assert len(set(ours.status.tolist())) >= 4


@pytest.mark.parametrize("name", ["fine", "ends_everywhere"])
@pytest.mark.parametrize("wishes", [MU, SHARE, CONTRAST, Wishes("mu", (0.1, 0.9))])
def test_a_row_is_the_surface_at_one_force(name, wishes, request):
    surface = request.getfixturevalue(name)
    inverse = SliceInverse(surface)
    for force in (0.5 * surface.normal_force_n.low, 0.3, 0.77, 2.0):
        wish = np.linspace(-0.2, 1.2, 57)
        row = inverse.row(force)(wish, wishes)
        batch = inverse(np.full(57, force), wish, wishes)
        np.testing.assert_allclose(row.wanted_mu, batch.wanted_mu, rtol=1e-12)
        np.testing.assert_array_equal(row.status, batch.status)
        np.testing.assert_allclose(row.voltage_v, batch.voltage_v, rtol=1e-9, atol=1e-5)
        low, high = inverse.reachable(np.array([force]))
        assert inverse.row(force).lowest_mu == pytest.approx(float(low[0]), rel=1e-12)
        assert inverse.row(force).highest_mu == pytest.approx(float(high[0]), rel=1e-12)


@settings(max_examples=40, deadline=None)
@given(share=st.floats(0, 1), force=st.floats(0.2, 1.0))
def test_shares_and_contrasts_come_out(fine, share, force):
    inverse = SliceInverse(fine)
    low, high = (float(mu) for mu in fine.reachable(force))
    for wish, wishes in (
        (share, SHARE),
        (low + share * (high - low), MU),
        ((low + share * (high - low)) / low - 1, CONTRAST),
    ):
        (voltage,) = inverse.row(force)(np.array([wish]), wishes).voltage_v
        reached = float(fine.mu(force, min(voltage, 200.0)))
        assert reached == pytest.approx(low + share * (high - low), rel=1e-9)


def test_compressing_keeps_order_and_reach(fine):
    inverse = SliceInverse(fine)
    low, high = (float(mu) for mu in fine.reachable(0.5))
    wish = np.linspace(0.1, 0.9, 41)  # far below and far above
    found = inverse(np.full(41, 0.5), wish, Wishes("mu", (0.1, 0.9)))
    assert found.wanted_mu[0] == pytest.approx(low, rel=1e-12)
    assert found.wanted_mu[-1] == pytest.approx(high, rel=1e-12)
    assert (np.diff(found.voltage_v) > 0).all()
    assert set(found.status.tolist()) == {int(Status.OK)}
    # What could be given as it is, is left as it is.
    middle = np.linspace(low + 0.01, high - 0.01, 7)
    kept = inverse(np.full(7, 0.5), middle, Wishes("mu", (low + 0.01, high - 0.01)))
    np.testing.assert_allclose(kept.wanted_mu, middle, rtol=1e-12)


@pytest.mark.parametrize("bad", [(0.9, 0.1), (0.1, np.inf), (np.nan, 1.0)])
def test_what_is_no_span(bad):
    with pytest.raises(InputError, match="compress: expected finite low < high"):
        Wishes("mu", bad)


def test_a_surface_that_was_not_sliced(model):
    scene = {"normal_force_n": 0.5, "frequency_hz": (100.0, 4000.0)}
    wide = haptix.FrictionSurface.build(model, scene, tolerance=0.05)
    with pytest.raises(InputError, match=r"slice it with surface.at"):
        SliceInverse(wide)


@pytest.mark.parametrize("force", [0.3, 1.0])
@pytest.mark.parametrize("frequency_hz", [125.0, 500.0])
def test_friction_is_averaged_over_the_period_of_a_direct_drive(model, force, frequency_hz):
    """Against the model solved through the period, which knows no surface and no average."""
    scene = {"normal_force_n": (0.2, 1.0), "frequency_hz": frequency_hz}
    surface = haptix.FrictionSurface.build(model, scene, tolerance=2e-4)
    drive = DirectWave(frequency_hz)
    row = SliceInverse(surface, drive.pulls, drive.peak_per_sine).row(force)
    naive = SliceInverse(surface).row(force)
    for share in (0.25, 0.5, 0.75):
        wanted = row.lowest_mu + share * (row.highest_mu - row.lowest_mu)
        felt = []
        for one in (row, naive):
            (voltage,) = one(np.array([wanted]), MU).voltage_v
            period = model.over_period(force, min(voltage, 200.0), frequency_hz, Waveform.sine())
            felt.append(float(period.mu.mean()))
        # A twentieth of what can be felt: beyond the surface's end the column is a straight line.
        assert felt[0] == pytest.approx(wanted, rel=0.05 * 0.11)
        assert abs(felt[0] - wanted) < 0.3 * abs(felt[1] - wanted)


def test_a_square_wave_has_no_ripple():
    assert DirectWave(125.0, "square").pulls is None
    pulls = DirectWave(125.0).pulls
    assert pulls.mean() == pytest.approx(1.0, rel=1e-12)
    assert pulls.max() == pytest.approx(2.0, rel=2e-3)  # of 64 places none is just at the peak
