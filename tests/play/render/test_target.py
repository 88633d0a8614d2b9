"""Friction asked for by the numbers of a texture, and the voltages that give it."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import haptix
from firmware_io import open_device
from haptix import InputError, Status
from haptix.feel.motion import Motion
from haptix.play.render import RenderCore, RenderSettings, SineCarrier
from haptix.play.render.samples import Fingers
from tests.play.render.block_oracle import Given


@pytest.fixture(scope="module")
def fine(model):
    scene = {"normal_force_n": (0.2, 1.0), "frequency_hz": 4000.0}
    return haptix.FrictionSurface.build(model, scene, tolerance=2e-4)


def reach(surface, force):
    """Reachable friction up to the amplitude whose slew at 4 kHz the device allows."""
    most = RenderCore(
        surface, Given("mu", None), open_device("mock:"), SineCarrier(4000.0)
    ).highest_v
    volts = min(float(surface.highest_voltage(force)), most)
    return float(surface.mu(force, 0.0)), float(surface.mu(force, volts))


def rendered(surface, target, value, force, compress=None):
    """Render values, each at a point of its own, with the amplitude of the last one reached."""
    drive, how = SineCarrier(4000.0), RenderSettings(compress=compress)
    core = RenderCore(surface, Given(target, value), open_device("mock:"), drive, how)
    points = len(value)
    zero = np.zeros(points)
    motion = Motion(1, points, zero, zero, np.full(points, force), 0.0, core.step_s)
    return core.block(Fingers(motion, np.ones(points)), 0)


@settings(max_examples=40, deadline=None)
@given(share=st.floats(0, 1), force=st.floats(0.2, 1.0))
def test_shares_and_contrasts_come_out(fine, share, force):
    low, high = reach(fine, force)
    for value, target in (
        (share, "share"),
        (low + share * (high - low), "mu"),
        ((low + share * (high - low)) / low - 1, "contrast"),
    ):
        # For longer than the slope of the amplitude needs.
        found = rendered(fine, target, np.full(20, value), force)
        reached = float(fine.mu(force, found.amplitude_v[-1]))
        assert reached == pytest.approx(low + share * (high - low), rel=1e-9)
        assert found.target_mu[-1] == pytest.approx(reached, rel=1e-9)


def test_compressing_keeps_order_and_reach(fine):
    low, high = reach(fine, 0.5)
    value = np.linspace(0.1, 0.9, 41)  # far below and far above
    found = rendered(fine, "mu", value, 0.5, (0.1, 0.9))
    assert found.target_mu[0] == pytest.approx(low, rel=1e-12)
    assert found.target_mu[-1] == pytest.approx(high, rel=1e-12)
    assert (np.diff(found.target_mu) > 0).all()
    assert set(found.status.tolist()) == {int(Status.OK)}
    # A range that can be given as it is, is left as it is.
    middle = np.linspace(low + 0.01, high - 0.01, 7)
    kept = rendered(fine, "mu", middle, 0.5, (low + 0.01, high - 0.01))
    np.testing.assert_allclose(kept.target_mu, middle, rtol=1e-12)


@pytest.mark.parametrize("bad", [(0.9, 0.1), (0.1, np.inf), (np.nan, 1.0)])
def test_what_is_no_span(bad):
    with pytest.raises(InputError, match="compress"):
        RenderSettings(compress=bad)
