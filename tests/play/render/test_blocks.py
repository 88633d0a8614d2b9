"""One block against the oracle in numpy, and what a material may not answer."""

from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import haptix
from firmware_io import open_device
from haptix import InputError, Status
from haptix.feel.motion import Motion
from haptix.play.render import RenderCore, RenderSettings, SineCarrier
from haptix.play.render.master import Mix
from haptix.play.render.samples import Fingers
from tests.play.render import block_oracle
from tests.play.render.block_oracle import Given

POINTS = 12


class Effect(NamedTuple):
    """Adds what is given."""

    share: np.ndarray

    def added(self, motion):
        return self.share


@pytest.fixture(scope="module")
def ends_everywhere():
    """A surface that ends at its limit, at breakdown and at pull-in, depending on the force."""
    screen = haptix.Screen(max_voltage_v=600.0, insulator_strength_v_per_m=2e9)
    model = haptix.ContactModel(haptix.Finger.preset("semi-wet"), screen, terms={"breakdown": True})
    scene = {"normal_force_n": (0.01, 1.0), "voltage_v": (0.0, 200.0), "frequency_hz": 3000.0}
    return haptix.FrictionSurface.build(model, scene, tolerance=5e-3)


def fingers_of(random, count, points, is_steady):
    force = np.exp(random.uniform(np.log(0.005), np.log(1.2), count * points))
    if is_steady:
        force = np.repeat(force[::points], points)
    x, y = random.uniform(0, 20, (2, count * points))
    motion = Motion(count, points, x, y, force, 0.01, 1 / 12_000)
    return Fingers(motion, random.uniform(0, 1, count * points))


@settings(max_examples=150, deadline=None)
@given(data=st.data())
@pytest.mark.parametrize("name", ["surface", "ends_everywhere"])
def test_a_block_is_that_of_the_oracle(request, name, data):
    surface = request.getfixturevalue(name)
    target = data.draw(st.sampled_from(["mu", "contrast", "share"]))
    span = data.draw(st.sampled_from([None, (0.1, 0.9), (0.3, 0.35)]))
    how = data.draw(st.sampled_from(["strongest", "first", "mean"]))
    random = np.random.default_rng(data.draw(st.integers(0, 10**6)))
    points, count = data.draw(st.integers(1, 40)), data.draw(st.integers(1, 4))
    fingers = fingers_of(random, count, points, data.draw(st.booleans()))
    value = random.uniform(-0.3, 1.5, count * points)
    settings_ = RenderSettings(compress=span, combination=how)
    material = Given(target, value)
    core = RenderCore(surface, material, open_device("mock:"), SineCarrier(3000.0), settings_)
    mix, added, intensity = Mix(), np.zeros(count * points), np.ones(points)
    if data.draw(st.booleans()):
        added = random.uniform(0, 1.2, count * points)
        mix = mix._replace(effects=(Effect(added),))
    if data.draw(st.booleans()):
        intensity = random.uniform(0, 1, points)
        mix = mix._replace(intensity=intensity)
    queued = None
    if data.draw(st.booleans()):
        queued = random.uniform(0, core.highest_v, data.draw(st.integers(1, points)))
    first, before_v = data.draw(st.integers(0, 10**12)), random.uniform(0, core.highest_v)
    found = core.block(fingers, first, before_v, queued, mix)
    expected = block_oracle.block(core, fingers, value, added, intensity, first, before_v, queued)
    np.testing.assert_array_equal(found.status, expected["status"])
    np.testing.assert_allclose(found.target_mu, expected["target_mu"], rtol=1e-12, atol=1e-14)
    # Of the highest voltage: the root of a drive near 0 enlarges its rounding.
    for volts in ("amplitude_v", "drive_v"):
        np.testing.assert_allclose(
            getattr(found, volts), expected[volts], rtol=1e-9, atol=1e-12 * core.highest_v
        )


def test_a_number_that_is_none_reaches_the_limits_and_stops_there(surface):
    """NaN is not taken for any friction: the device refuses it."""
    random = np.random.default_rng(1)
    for count in (1, 2):
        value = random.uniform(0, 1, count * POINTS)
        value[3] = np.nan
        device = open_device("mock:")
        core = RenderCore(surface, Given("share", value), device, SineCarrier(3000.0))
        found = core.block(fingers_of(random, count, POINTS, False), 0)
        assert np.isnan(found.drive_v).any()
        with device, pytest.raises(haptix.LimitError):
            device.arm()
            device.write(found.drive_v)


@pytest.mark.parametrize("answer", [np.zeros(POINTS - 1), np.zeros(2 * POINTS), np.float64(0.5)])
def test_an_answer_that_is_not_one_for_each_point(surface, answer):
    core = RenderCore(surface, Given("share", answer), open_device("mock:"), SineCarrier(3000.0))
    fingers = fingers_of(np.random.default_rng(1), 1, POINTS, False)
    with pytest.raises(InputError, match="12 points"):
        core.block(fingers, 0)


def test_answers_in_single_precision_and_in_steps(surface):
    value = np.linspace(0, 1, 2 * POINTS, dtype=np.float32)[::2]
    core = RenderCore(surface, Given("share", value), open_device("mock:"), SineCarrier(3000.0))
    fingers = fingers_of(np.random.default_rng(1), 1, POINTS, False)
    doubled = RenderCore(
        surface, Given("share", value.astype(float)), open_device("mock:"), SineCarrier(3000.0)
    )
    np.testing.assert_array_equal(core.block(fingers, 0).drive_v, doubled.block(fingers, 0).drive_v)
    assert Status.OK in core.block(fingers, 0).status
