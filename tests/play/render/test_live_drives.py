"""Targets, waves and limits of live rendering."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import haptix
from haptix import Texture
from haptix.play.render import DirectWave, RenderSettings
from haptix.play.touch import TouchEvent
from tests.live_strokes import (
    ALWAYS,
    CARRIER_HZ,
    HALF,
    RATE,
    Ruler,
    amplitude,
    render,
    row_times,
    stroke,
    target_mu,
    times,
)


def test_a_texture_out_of_reach_is_compressed_if_asked_for(surface):
    class Steep(Ruler):
        LOW, PER_MM = 0.1, 0.01  # from 0.15 at 5 mm to 0.6 at 50 mm; reachable is 0.26 to 0.33

    options = {"sliding": ALWAYS}
    _, clipped = render(surface, Steep(), stroke(0.45), **options)
    _, squeezed = render(surface, Steep(), stroke(0.45), compress=(0.1, 0.6), **options)
    assert clipped.stats.below > 0
    assert clipped.stats.above > 0
    inside = times(squeezed) < 0.4
    t, volts = times(squeezed)[inside], amplitude(squeezed)[inside]
    # From 0 V up to the limit, with a difference at every place; the filter wiggles at first.
    assert (np.diff(volts[(t > 0.1)]) > 0).all()
    flat = np.diff(amplitude(clipped)[inside][t > 0.1]) == 0
    assert flat.mean() > 0.5
    lowest, highest = (float(surface.mu(0.5, v, CARRIER_HZ)) for v in (0.0, 200.0))
    middle = float(np.interp(0.2, row_times(squeezed), target_mu(squeezed)))
    # At 0.2 s the finger is at 25 mm, where 0.35 is wanted: the middle of the span.
    assert middle == pytest.approx((lowest + highest) / 2, abs=0.01 * (highest - lowest))


@pytest.fixture(scope="module")
def direct_surface(model):
    scene = {"normal_force_n": (0.2, 1.0), "frequency_hz": 125.0}
    return haptix.FrictionSurface.build(model, scene, tolerance=5e-3)


@pytest.mark.parametrize("waveform", ["sine", "square", (0.0, 1.0, 0.0, -1.0)])
def test_direct_drive(direct_surface, waveform):
    wave = DirectWave(125.0, waveform)
    device, renderer = render(direct_surface, HALF, stroke(0.5), drive=wave)
    settled = device.mock.played_v[12_000 : 12_000 + 384 * 20]
    # The same in each of its periods of 384 samples, but for half a code; without a mean.
    periods = settled.reshape(20, 384)
    assert np.abs(periods - periods[0]).max() <= 250 / 32767 * 1.01
    assert abs(settled.mean()) <= 250 / 32767
    # An amplitude is that of the sine which pulls as much: the mean square is the sine's.
    volts = amplitude(renderer)[(times(renderer) > 0.25) & (times(renderer) < 0.4)]
    assert np.ptp(volts) < 1e-3  # the speed that is estimated settles, and ripple counts by it
    assert np.sqrt(2 * np.mean(settled**2)) == pytest.approx(volts[0], rel=3e-3)
    assert np.abs(settled).max() == pytest.approx(volts[0] * wave.peak_per_sine, rel=2e-3)


def test_a_quarter_of_a_direct_period_asks_for_the_mean_over_its_way(model):
    frequency_hz = 130.0  # quarters of 92.3 samples
    scene = {"normal_force_n": (0.2, 1.0), "frequency_hz": frequency_hz}
    surface = haptix.FrictionSurface.build(model, scene, tolerance=5e-3)
    device, ruler = haptix.open_device("mock:"), Ruler()
    path = haptix.Trajectory(
        np.array([0.0, 0.5]), np.array([5.0, 55.0]), np.full(2, 10.0), np.full(2, 0.5)
    )
    keep = RenderSettings(keep_blocks=True)
    with haptix.Renderer(surface, ruler, device, DirectWave(frequency_hz), keep) as renderer:
        renderer.play(path)
    t = np.concatenate([block.sample for block in renderer.blocks]) / RATE
    mu = np.concatenate([block.target_mu for block in renderer.blocks])
    middle_s = (np.ceil(4 * frequency_hz * t - 1e-9) - 0.5) / (4 * frequency_hz)
    inside = (t > 0.1) & (t < 0.4)
    # The mean of a line is its middle. Friction is inverted and read back to 1e-9.
    place = (mu[inside] - ruler.LOW) / ruler.PER_MM
    np.testing.assert_allclose(place, 5 + 100 * middle_s[inside], rtol=0, atol=1e-6)


def test_the_ripple_is_followed_at_the_response_of_the_surfaces_finger(direct_surface):
    def highest(surface, speed_mm_per_s):
        device = haptix.open_device("mock:")
        renderer = haptix.Renderer(surface, HALF, device, DirectWave(125.0))
        _, high = renderer.reachable(np.array([0.5]), np.array([speed_mm_per_s]))
        return float(high[0])

    own = direct_surface.response_hz_per_mm_per_s
    info = {**direct_surface.info, "response_hz_per_mm_per_s": own / 2}
    slow = dataclasses.replace(direct_surface, info=info)
    # A cut-off is a product: half the response is half the speed.
    assert highest(slow, 20.0) == pytest.approx(highest(direct_surface, 10.0), rel=1e-12)
    assert highest(slow, 20.0) < highest(direct_surface, 20.0) - 1e-4


def zero_mean(samples):
    samples = np.array(samples) - np.mean(samples)
    return tuple(samples / np.abs(samples).max()) if np.abs(samples).max() > 1e-3 else (1.0, -1.0)


WAVES = st.one_of(
    st.none(),
    st.just("sine"),
    st.just("square"),
    st.lists(st.floats(-1, 1), min_size=2, max_size=6).map(zero_mean),
)


@given(
    WAVES,
    st.lists(st.floats(0, 1), min_size=2, max_size=12),
    st.sampled_from([("share", 0.0, 1.0), ("mu", 0.01, 5.0), ("mu", 0.25, 0.4)]),
    st.lists(
        st.tuples(st.floats(-10, 80), st.floats(0.01, 8.0), st.floats(0.002, 0.05)),
        min_size=3,
        max_size=15,
    ),
    st.sampled_from(["strongest", "mean"]),
    st.booleans(),
)
@settings(max_examples=25, deadline=None)
def test_no_sample_is_ever_above_the_limit(fragile, wave, levels, ends, path, combination, two):
    waves = None if wave is None else DirectWave(125.0, wave)
    target, low, high = ends
    texture = Texture(np.array([levels]), 70.0, target, low, high, "hold")
    t, events = 0.0, []
    for i, (x, force, dt) in enumerate(path):
        t += dt
        events.append(TouchEvent(t, i % 2 if two else 0, x, 1.0, "move", force))
    device, _ = render(
        fragile[wave is None], texture, events, drive=waves, combination=combination, sliding=ALWAYS
    )
    assert np.abs(device.mock.output_v).max() <= 120.0


@pytest.fixture(scope="module")
def fragile(model):
    """Surfaces of a screen for 120 V: at 125 Hz, and at the carrier."""
    screen = model.screen.replace(name="fragile", max_voltage_v=120.0)
    thin = haptix.ContactModel(model.finger, screen)
    return [
        haptix.FrictionSurface.build(
            thin, {"normal_force_n": (0.2, 1.0), "frequency_hz": hz}, tolerance=5e-3
        )
        for hz in (125.0, CARRIER_HZ)
    ]
