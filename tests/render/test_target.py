"""Friction asked for by the numbers of a texture, and the voltages that give it."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import haptix
from haptix import InputError, Status
from haptix.render.target import Amplitudes, Target
from haptix.surface import Slice

MU, SHARE, CONTRAST = Target("mu"), Target("share"), Target("contrast")


@pytest.fixture(scope="module")
def fine(model):
    scene = {"normal_force_n": (0.2, 1.0), "frequency_hz": 4000.0}
    return haptix.FrictionSurface.build(model, scene, tolerance=2e-4)


@settings(max_examples=40, deadline=None)
@given(share=st.floats(0, 1), force=st.floats(0.2, 1.0))
def test_shares_and_contrasts_come_out(fine, share, force):
    column = Slice.of(fine.table).column(force)
    low, high = (float(mu) for mu in fine.reachable(force))
    for value, target in (
        (share, SHARE),
        (low + share * (high - low), MU),
        ((low + share * (high - low)) / low - 1, CONTRAST),
    ):
        (voltage,) = Amplitudes.of(column, target, np.array([value])).voltage_v
        reached = float(fine.mu(force, min(voltage, 200.0)))
        assert reached == pytest.approx(low + share * (high - low), rel=1e-9)


@pytest.mark.parametrize("target", [MU, SHARE, CONTRAST, Target("mu", (0.1, 0.9))])
def test_one_force_is_answered_as_a_force_at_each_point(fine, target):
    value = np.linspace(-0.2, 1.2, 57)
    for force in (0.1, 0.3, 0.77, 2.0):
        one = Amplitudes.of(Slice.of(fine.table).column(force), target, value)
        many = Amplitudes.of(Slice.of(fine.table).columns_at(np.full(57, force)), target, value)
        np.testing.assert_allclose(one.target_mu, many.target_mu, rtol=1e-12)
        np.testing.assert_array_equal(one.status, many.status)
        np.testing.assert_allclose(one.voltage_v, many.voltage_v, rtol=1e-9, atol=1e-5)


def test_compressing_keeps_order_and_reach(fine):
    column = Slice.of(fine.table).column(0.5)
    low, high = (float(mu) for mu in fine.reachable(0.5))
    value = np.linspace(0.1, 0.9, 41)  # far below and far above
    found = Amplitudes.of(column, Target("mu", (0.1, 0.9)), value)
    assert found.target_mu[0] == pytest.approx(low, rel=1e-12)
    assert found.target_mu[-1] == pytest.approx(high, rel=1e-12)
    assert (np.diff(found.voltage_v) > 0).all()
    assert set(found.status.tolist()) == {int(Status.OK)}
    # A range that can be given as it is, is left as it is.
    middle = np.linspace(low + 0.01, high - 0.01, 7)
    kept = Amplitudes.of(column, Target("mu", (low + 0.01, high - 0.01)), middle)
    np.testing.assert_allclose(kept.target_mu, middle, rtol=1e-12)


@pytest.mark.parametrize("bad", [(0.9, 0.1), (0.1, np.inf), (np.nan, 1.0)])
def test_what_is_no_span(bad):
    with pytest.raises(InputError, match="compress: expected finite low < high"):
        Target("mu", bad)
