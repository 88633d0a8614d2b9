"""Live rendering in virtual time: every block knows only the touches that had come by then."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import haptix
from firmware_io import DeviceFaultError
from haptix import InputError, Texture
from haptix.render import DirectWave, LiveSettings, PredictingRenderer, Sliding
from haptix.texture import FrictionField
from haptix.touch import ForceModel, SingerKalman, TouchEvent, TouchSettings

RATE = 48_000.0
CARRIER_HZ = 3000.0
LEAD_S = 0.025
ALWAYS = Sliding(is_needed=False)
KEEP = LiveSettings(keep_blocks=True)
FULL = Texture(np.ones((2, 2)), width_mm=100.0, beyond="hold")
HALF = Texture(np.full((2, 2), 0.5), width_mm=100.0, beyond="hold")


class Ruler(FrictionField):
    """Friction that tells the place: blocks keep it, and `place_mm` reads it."""

    LOW, PER_MM = 0.27, 5e-4  # within reach up to 80 mm

    target = "mu"
    outside = LOW

    def _sample(self, x_mm, y_mm, footprint_mm):
        return self.LOW + self.PER_MM * x_mm

    def place_mm(self, renderer):
        nowhere = np.full(len(renderer.blocks[0].amplitude_v), np.nan)
        wanted = [block.target_mu if block.fingers else nowhere for block in renderer.blocks]
        return (np.concatenate(wanted) - self.LOW) / self.PER_MM


def stroke(
    end_s=0.5, speed_mm_s=100.0, start_mm=5.0, rate_hz=100.0, force=0.5, touch_id=0, begin_s=0.0
):
    """Touches of a finger that slides to the right at a constant speed, from the start on."""
    t = np.arange(begin_s, end_s, 1 / rate_hz)
    x = start_mm + speed_mm_s * (t - begin_s)
    return [TouchEvent(a, touch_id, b, 10.0, "move", force) for a, b in zip(t, x, strict=True)]


def still(end_s=0.5, x_mm=20.0, **options):
    return stroke(end_s, 0.0, x_mm, **options)


def render(surface, texture, events, latency_s=0.0, address="mock:", drive=None, **options):
    device = haptix.open_device(address)
    settings = LiveSettings(**{"lead_s": LEAD_S, "keep_blocks": True, **options})
    renderer = PredictingRenderer(surface, texture, device, drive, settings)
    with renderer:
        for event in events:
            renderer.event(event, event.t_s + latency_s)
    assert device.mock.played_codes[-1] == 0
    assert not device.is_armed
    return device, renderer


def amplitude(renderer):
    return np.concatenate([block.amplitude_v for block in renderer.blocks])


def times(renderer):
    return np.concatenate([block.sample for block in renderer.blocks]) / RATE


def of_model(surface, level, force):
    """Amplitude of a share of what is reachable, by the surface itself."""
    low, high = (float(surface.mu(force, v, CARRIER_HZ)) for v in (0.0, 200.0))
    return float(surface.voltage(low + level * (high - low), force, CARRIER_HZ).voltage_v)


# Causality and prediction


@given(
    st.integers(1, 29),
    st.lists(st.tuples(st.floats(0, 80), st.floats(0, 40), st.floats(0.2, 1)), max_size=8),
    st.sampled_from([0.0, 0.017, 0.03]),
    st.sampled_from([0.005, 0.025]),
    st.sampled_from([0.001, 0.005]),
)
@settings(max_examples=25, deadline=None)
def test_what_plays_within_the_lead_knows_nothing_of_a_touch(
    surface, first, tail, latency_s, lead_s, block_s
):
    events = stroke(0.3)
    other = events[:first] + [
        TouchEvent(events[first].t_s + i / 100, 0, x, y, "move", force)
        for i, (x, y, force) in enumerate(tail)
    ]
    options = {"latency_s": latency_s, "lead_s": lead_s, "block_s": block_s}
    a, _ = render(surface, Ruler(), events, **options)
    b, _ = render(surface, Ruler(), other, **options)
    alike = int((events[first].t_s + latency_s + lead_s) * RATE)
    # Without a tail the session ends one touch and a lead earlier.
    if not tail:
        alike = int((events[first - 1].t_s + latency_s) * RATE)
    np.testing.assert_array_equal(a.mock.played_codes[:alike], b.mock.played_codes[:alike])


def test_what_plays_after_the_lead_does_know(surface):
    events = stroke(0.3)
    other = [*events[:20], *(e._replace(x_mm=e.x_mm - 3) for e in events[20:])]
    a, renderer = render(surface, Ruler(), events, latency_s=0.02)
    b, _ = render(surface, Ruler(), other, latency_s=0.02)
    known_s = events[20].t_s + 0.02 + LEAD_S
    block_s = len(renderer.blocks[0].drive_v) / RATE
    differ = a.mock.played_codes[:13_000] != b.mock.played_codes[:13_000]
    first = np.flatnonzero(differ)[0] / RATE
    # The next block takes it up, and shows it at its first control point.
    assert known_s <= first <= known_s + block_s + 0.001


class Held(SingerKalman):
    """No prediction: the finger stays where it was reported."""

    def ahead(self, state, ahead_s):
        return state[1], state[2], state[3], state[4]


def worst_place_mm(surface, events, true_mm, **settings):
    _, renderer = render(
        surface, Ruler(), events, latency_s=0.03 - LEAD_S, touch=TouchSettings(**settings)
    )
    t = times(renderer)
    felt = amplitude(renderer) > 0
    judged = felt & (t > 0.25) & (t < events[-1].t_s)
    assert judged.mean() > 0.4
    return np.percentile(np.abs(Ruler().place_mm(renderer) - true_mm(t))[judged], 95)


def test_prediction_beats_holding_on_a_steady_stroke(surface):
    # 30 ms from the touch to the sample, at 100 mm/s: 3 mm behind, and up to 1 mm until the next.
    def true_mm(t):
        return 5 + 100 * t

    events = stroke(0.6)
    held = worst_place_mm(surface, events, true_mm, filter=Held())
    assert held > 3.0
    assert worst_place_mm(surface, events, true_mm) < held / 20


def test_prediction_beats_holding_on_a_finger_that_turns(surface):
    def true_mm(t):  # at most 100 mm/s and 630 mm/s^2
        return 30 + 16 * np.sin(2 * np.pi * t)

    t = np.arange(0, 1.5, 0.01)
    events = [TouchEvent(a, 0, b, 10.0, "move", 0.5) for a, b in zip(t, true_mm(t), strict=True)]
    held = worst_place_mm(surface, events, true_mm, filter=Held())
    assert worst_place_mm(surface, events, true_mm) < held / 3


@pytest.mark.parametrize("block_s", [0.001, 0.002, 0.008])
def test_the_length_of_blocks_does_not_matter(surface, block_s):
    one, other = (
        render(surface, Ruler(), stroke(0.5), latency_s=0.02, block_s=s)[1]
        for s in (block_s, 0.005)
    )
    places = []
    for renderer in (one, other):
        found = np.interp(np.arange(0.25, 0.5, 1e-3), times(renderer), Ruler().place_mm(renderer))
        places.append(found)
    # A block takes up a touch when it begins: 8 ms late at most, while the filter, settled on a
    # steady stroke, mends its prediction by some 10 um per touch.
    assert np.abs(places[0] - places[1]).max() < 0.03


# Sliding, rest, fades


def test_a_finger_at_rest_gets_no_voltage(surface):
    device, _ = render(surface, FULL, still())
    assert np.abs(device.mock.played_v).max() == 0.0


def test_a_finger_at_rest_gets_voltage_if_asked_for(surface):
    _, renderer = render(surface, FULL, still(), sliding=ALWAYS)
    np.testing.assert_allclose(amplitude(renderer)[times(renderer) > 0.1], 200.0, rtol=1e-6)


def test_voltage_comes_with_sliding_and_goes_with_rest(surface):
    moves = [*still(0.3, 5.0), *stroke(0.7, 100.0, 5.0, begin_s=0.3)]
    stays = still(1.2, 45.0, begin_s=0.7)
    _, renderer = render(surface, FULL, moves + stays)
    t, volts = times(renderer), amplitude(renderer)
    assert volts[t < 0.3].max() == 0.0
    assert volts[(t > 0.45) & (t < 0.7)].min() > 199.0
    # Speed is averaged over 50 ms: from 100 to 4 mm/s takes ln 25 of these, 0.16 s.
    assert volts[t > 0.7 + 0.25].max() == 0.0


@pytest.mark.parametrize("fade_s", [0.004, 0.02, 0.1])
def test_fades_take_their_time(surface, fade_s):
    events = [
        *still(0.3),
        TouchEvent(0.3, 0, 0.0, 0.0, "up"),
        *still(0.9, 20.0, touch_id=1, begin_s=0.6),
    ]
    sliding = Sliding(is_needed=False, fade_s=fade_s)
    device, renderer = render(surface, HALF, events, sliding=sliding)
    t, volts = times(renderer), np.append(0.0, amplitude(renderer))
    most = of_model(surface, 0.5, 0.5)
    np.testing.assert_allclose(volts.max(), most, rtol=1e-6)
    steepest = np.abs(np.diff(volts)).max() / (t[1] - t[0])
    assert steepest <= most / fade_s * (1 + 1e-6)
    # Up, down after the lift, and up again: a fade and a block, no more.
    for begin_s, goal in ((0.0, most), (0.3 + LEAD_S, 0.0), (0.6 + LEAD_S, most)):
        begin = (t > begin_s - 1e-9) & (t < begin_s + 0.2)
        there = t[begin][np.flatnonzero(np.abs(volts[1:][begin] - goal) < 1e-6 * most)[0]]
        assert fade_s - 1e-3 <= there - begin_s <= fade_s + 0.0101
    assert np.abs(device.mock.played_v).max() <= most * (1 + 1e-9) + 250 / 65534


def test_a_session_that_ends_while_a_finger_slides_ramps_down(surface):
    device, renderer = render(surface, FULL, stroke(0.3))
    ramp = device.mock.played_v[renderer.stats.samples :]
    assert len(ramp) > 0
    assert np.abs(np.diff(np.abs(ramp))).max() < 2.0  # 200 V in 5 ms are 0.8 V a sample
    assert ramp[-1] == 0.0


# Several fingers


@pytest.mark.parametrize("order", [(0, 1), (1, 0)])
@pytest.mark.parametrize("combination", ["strongest", "first", "mean"])
def test_several_fingers_share_one_electrode(surface, combination, order):
    levels = Texture(np.array([[0.2, 0.2, 0.8, 0.8]]), width_mm=100.0, beyond="hold")
    where, force = (10.0, 90.0), (0.4, 0.7)
    fingers = [
        still(0.3, where[i], force=force[i], touch_id=i, begin_s=0.001 * order.index(i))
        for i in (0, 1)
    ]
    events = sorted(fingers[0] + fingers[1], key=lambda event: event.t_s)
    _, renderer = render(surface, levels, events, sliding=ALWAYS, combination=combination)
    alone = [of_model(surface, (0.2, 0.8)[i], force[i]) for i in (0, 1)]
    expected = {"strongest": max(alone), "first": alone[order[0]], "mean": sum(alone) / 2}
    # Touches arrive at 0 and 1 ms, and both fingers have faded in after 5 ms.
    settled = amplitude(renderer)[times(renderer) > 0.1]
    np.testing.assert_allclose(settled, expected[combination], rtol=2e-6)
    assert renderer.blocks[-1].fingers == 2


def test_a_resting_finger_takes_nothing_from_a_sliding_one(surface):
    slides = stroke(0.5)
    both = sorted([*still(0.5, touch_id=1), *slides], key=lambda event: event.t_s)
    for combination in ("strongest", "first", "mean"):
        alone, together = (
            amplitude(render(surface, HALF, events, combination=combination)[1])
            for events in (slides, both)
        )
        np.testing.assert_array_equal(alone, together, combination)


# Touches that are not as they should be


def test_touches_out_of_order_are_put_in_order(surface):
    events = stroke(0.3)
    mixed = list(events)
    mixed[10], mixed[11] = mixed[11], mixed[10]
    device = haptix.open_device("mock:")
    with PredictingRenderer(surface, Ruler(), device, settings=KEEP) as renderer:
        for event, arrival in zip(mixed, (e.t_s + 0.01 for e in events), strict=True):
            renderer.event(event, arrival)
    assert renderer.touch_counts.reordered == 1
    assert renderer.touch_counts.taken == len(events)
    _, straight = render(surface, Ruler(), events, latency_s=0.01)
    late = np.interp(0.28, times(renderer), Ruler().place_mm(renderer))
    assert late == pytest.approx(
        np.interp(0.28, times(straight), Ruler().place_mm(straight)), abs=1e-3
    )


BAD = {
    "NaN place": TouchEvent(0.2, 0, np.nan, 10.0, "move", 0.5),
    "huge place": TouchEvent(0.2, 0, 1e9, 10.0, "move", 0.5),
    "infinite place": TouchEvent(0.2, 0, 1.0, np.inf, "move", 0.5),
    "NaN time": TouchEvent(np.nan, 0, 1.0, 10.0, "move", 0.5),
    "infinite time": TouchEvent(np.inf, 0, 1.0, 10.0, "move", 0.5),
    "backwards": TouchEvent(0.05, 0, 1.0, 10.0, "move", 0.5),
}
BAD_FORCE = {
    "negative force": TouchEvent(0.2, 0, 25.0, 10.0, "move", -0.5),
    "NaN force": TouchEvent(0.2, 0, 25.0, 10.0, "move", np.nan),
    "no force at all": TouchEvent(0.2, 0, 25.0, 10.0, "move", 0.0),
    "infinite force": TouchEvent(0.2, 0, 25.0, 10.0, "move", np.inf),
}


@pytest.mark.parametrize("name", [*BAD, *BAD_FORCE])
def test_a_bad_touch_raises_once_and_the_stroke_goes_on(surface, name):
    events, bad = stroke(0.4), {**BAD, **BAD_FORCE}[name]
    device = haptix.open_device("mock:")
    with PredictingRenderer(surface, Ruler(), device, settings=KEEP) as renderer:
        for event in events[:20]:
            renderer.event(event)
        with pytest.raises(InputError, match="touch") as caught:
            renderer.event(bad)
        assert "\n" not in str(caught.value)
        for event in events[20:]:
            renderer.event(event)
    clean, _ = render(surface, Ruler(), events)
    np.testing.assert_array_equal(device.mock.played_codes, clean.mock.played_codes)


@pytest.mark.parametrize("name", BAD)
def test_a_bad_touch_is_dropped_and_counted_if_not_strict(surface, name):
    events = stroke(0.4)
    device, renderer = render(
        surface, Ruler(), [*events[:20], BAD[name], *events[20:]], strict=False
    )
    counts = renderer.touch_counts
    assert (counts.invalid, counts.late) == ((0, 1) if name == "backwards" else (1, 0))
    clean, _ = render(surface, Ruler(), events)
    np.testing.assert_array_equal(device.mock.played_codes, clean.mock.played_codes)


@pytest.mark.parametrize("name", BAD_FORCE)
def test_a_bad_force_is_not_used_if_not_strict_but_its_place_is(surface, name):
    events = stroke(0.4)
    mixed = [*events[:20], BAD_FORCE[name], *events[21:]]
    device, renderer = render(surface, Ruler(), mixed, strict=False)
    assert renderer.touch_counts.bad_force == 1
    assert renderer.touch_counts.taken == len(events)
    # The touch says 25 mm at 0.2 s, as the stroke does, and the force before holds on.
    clean, _ = render(surface, Ruler(), events)
    np.testing.assert_array_equal(device.mock.played_codes, clean.mock.played_codes)


@pytest.mark.parametrize("strict", [True, False])
def test_a_clock_that_was_set_back(surface, strict):
    events = stroke(0.4)
    back = [event._replace(t_s=event.t_s - 100.0) for event in events[20:]]
    device = haptix.open_device("mock:")
    raised = 0
    with PredictingRenderer(
        surface, FULL, device, settings=LiveSettings(strict=strict)
    ) as renderer:
        for event in events[:20] + back:
            try:
                renderer.event(event)
            except InputError:
                raised += 1
    counts = renderer.touch_counts
    # Three in a row, and it is the clock; virtual time does not go back.
    assert (raised, counts.late, counts.clock_jumps) == (2 if strict else 0, 2, 1)
    assert device.mock.played_codes[-1] == 0
    assert renderer.stats.samples < 0.5 * RATE


def test_a_flood_of_touches(surface):
    # 10 kHz: reports closer than least_interval_s replace each other, and none is lost.
    events = stroke(0.3, rate_hz=10_000.0)
    _, renderer = render(surface, Ruler(), events)
    counts = renderer.touch_counts
    assert counts.taken == len(events)
    assert counts.coalesced > 0.8 * len(events)
    t = times(renderer)
    judged = (t > 0.2) & (t < 0.3)
    error = np.abs(Ruler().place_mm(renderer) - 5 - 100 * t)[judged]
    assert error.max() < 0.1


@pytest.mark.parametrize("assumed_n", [0.3, 0.5])
def test_a_force_that_is_not_measured_is_the_assumed_one(surface, assumed_n):
    assumed = TouchSettings(force=ForceModel(assumed_n=assumed_n))
    untold, _ = render(surface, HALF, stroke(force=None), touch=assumed)
    told, _ = render(surface, HALF, stroke(force=assumed_n), touch=assumed)
    np.testing.assert_array_equal(untold.mock.played_codes, told.mock.played_codes)
    assert np.abs(told.mock.played_v).max() > 100


# Targets, waves, limits


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
    middle = float(
        np.interp(0.2, t, np.concatenate([b.target_mu for b in squeezed.blocks])[inside])
    )
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
    with haptix.Renderer(surface, ruler, device, DirectWave(frequency_hz), KEEP) as renderer:
        renderer.play(path)
    t = times(renderer)
    middle_s = (np.ceil(4 * frequency_hz * t - 1e-9) - 0.5) / (4 * frequency_hz)
    inside = (t > 0.1) & (t < 0.4)
    # The mean of a line is its middle. Friction is inverted and read back to 1e-9.
    place = ruler.place_mm(renderer)[inside]
    np.testing.assert_allclose(place, 5 + 100 * middle_s[inside], rtol=0, atol=1e-6)


def test_the_ripple_is_followed_at_the_response_of_the_surfaces_finger(direct_surface):
    def highest(surface, speed_mm_per_s):
        device = haptix.open_device("mock:")
        renderer = PredictingRenderer(surface, HALF, device, DirectWave(125.0))
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
    st.sampled_from([None, (0.01, 5.0), (0.25, 0.4)]),
    st.lists(
        st.tuples(st.floats(-10, 80), st.floats(0.01, 8.0), st.floats(0.002, 0.05)),
        min_size=3,
        max_size=15,
    ),
    st.sampled_from(["strongest", "mean"]),
    st.booleans(),
)
@settings(max_examples=60, deadline=None)
def test_no_sample_is_ever_above_the_limit(fragile, wave, levels, mu_range, path, combination, two):
    waves = None if wave is None else DirectWave(125.0, wave)
    texture = Texture(np.array([levels]), width_mm=70.0, mu_range=mu_range, beyond="hold")
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


# Change and failure on the way


def test_a_new_texture_counts_from_the_next_block(surface):
    device = haptix.open_device("mock:")
    events = still(0.4)
    settings = LiveSettings(keep_blocks=True, sliding=ALWAYS)
    with PredictingRenderer(surface, HALF, device, settings=settings) as renderer:
        for event in events[:20]:
            renderer.event(event)
        assert renderer.texture is HALF
        renderer.texture = FULL
        changed_s = (renderer.blocks[-1].sample[-1]) / RATE
        for event in events[20:]:
            renderer.event(event)
    t, volts = times(renderer), amplitude(renderer)
    half = of_model(surface, 0.5, 0.5)
    np.testing.assert_allclose(volts[(t > 0.1) & (t <= changed_s)], half, rtol=2e-6)
    # The amplitude may change by 4e5 V/s.
    assert volts[t > changed_s][0] > half
    np.testing.assert_allclose(volts[t > changed_s + 0.001], 200.0, rtol=1e-6)


def test_a_device_that_fails_in_mid_stroke(surface):
    device = haptix.open_device("mock:")
    events = stroke(0.4)
    renderer = PredictingRenderer(surface, Ruler(), device)
    raised = 0
    with pytest.raises(DeviceFaultError), renderer:
        for i, event in enumerate(events):
            if i == 20:
                assert device.last_v != 0 or np.abs(device.mock.played_v[-48:]).max() > 0
                device.mock.advance(1.0)  # a host that falls silent, by its watchdog
            try:
                renderer.event(event)
            except DeviceFaultError:
                raised += 1
                raise
    assert raised == 1
    assert device.mock.played_codes[-1] == 0
    assert not device.is_armed
    assert not device.mock.is_armed

    before = device.mock.samples_played
    with renderer:
        for event in events:
            renderer.event(event)
    fresh, _ = render(surface, Ruler(), events)
    np.testing.assert_array_equal(device.mock.played_codes[before:], fresh.mock.played_codes)
