"""Live rendering in virtual time: what plays knows only the touches that had come by then."""

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from firmware_io import DeviceFaultError
from haptix import Texture
from haptix.play.render import LiveSettings, Sliding
from haptix.play.touch import TouchEvent
from tests.live_strokes import (
    ALWAYS,
    FULL,
    HALF,
    RATE,
    REACTION_S,
    Ruler,
    SteppedRenderer,
    amplitude,
    of_model,
    render,
    row_times,
    still,
    stroke,
    times,
)

# Causality and prediction


@given(
    st.integers(1, 29),
    st.lists(st.tuples(st.floats(0, 80), st.floats(0, 40), st.floats(0.2, 1)), max_size=8),
    st.sampled_from([0.0, 0.017, 0.03]),
    st.sampled_from([0.003, 0.02]),
)
@example(29, [(40.0, 20.0, 0.5)] * 3, 0.0, 0.003)  # the other stroke is the longer one
@settings(max_examples=25, deadline=None)
def test_what_plays_within_the_reaction_knows_nothing_of_a_touch(
    surface, first, tail, latency_s, reaction_s
):
    events = stroke(0.3)
    other = events[:first] + [
        TouchEvent(events[first].t_s + i / 100, 0, x, y, "move", force)
        for i, (x, y, force) in enumerate(tail)
    ]
    options = {"latency_s": latency_s, "reaction_s": reaction_s}
    a, renderer = render(surface, Ruler(), events, **options)
    b, _ = render(surface, Ruler(), other, **options)
    # A revision begins with a step of the control points.
    alike = int((events[first].t_s + latency_s + reaction_s) * RATE) - renderer.step
    # A session ends with its last touch, and the driver's ramp begins with the next sample.
    ends_s = min(events[-1].t_s, other[-1].t_s) + latency_s
    alike = min(alike, int(ends_s * RATE) - 1)
    alike = max(alike, 0)
    np.testing.assert_array_equal(a.mock.played_codes[:alike], b.mock.played_codes[:alike])


def test_what_plays_after_the_reaction_does_know(surface):
    events = stroke(0.3)
    other = [*events[:20], *(e._replace(x_mm=e.x_mm - 3) for e in events[20:])]
    a, renderer = render(surface, Ruler(), events, latency_s=0.02)
    b, _ = render(surface, Ruler(), other, latency_s=0.02)
    known_s = events[20].t_s + 0.02 + REACTION_S
    differ = a.mock.played_codes[:13_000] != b.mock.played_codes[:13_000]
    first = np.flatnonzero(differ)[0] / RATE
    # In steps of control points, and shown by the carrier's next crest.
    assert known_s - renderer.step_s <= first <= known_s + 0.001


DELAY_S = 0.03  # from a touch to the first sample that can know of it


def held_mm(events, true_mm):
    """How far a finger is from where it was reported last, for 95 % of the time."""
    t = np.arange(0.25, events[-1].t_s, 1e-3)
    reported = np.array([event.t_s for event in events])
    last = reported[np.searchsorted(reported, t - DELAY_S, side="right") - 1]
    return np.percentile(np.abs(true_mm(last) - true_mm(t)), 95)


def worst_place_mm(surface, events, true_mm):
    _, renderer = render(surface, Ruler(), events, latency_s=DELAY_S - REACTION_S)
    t = row_times(renderer)
    felt = np.interp(t, times(renderer), amplitude(renderer)) > 0
    judged = felt & (t > 0.25) & (t < events[-1].t_s)
    assert judged.mean() > 0.4
    return np.percentile(np.abs(Ruler().place_mm(renderer) - true_mm(t))[judged], 95)


def test_prediction_beats_holding_on_a_steady_stroke(surface):
    # 30 ms from the touch to the sample, at 100 mm/s: 3 mm behind, and up to 1 mm until the next.
    def true_mm(t):
        return 5 + 100 * t

    events = stroke(0.6)
    held = held_mm(events, true_mm)
    assert held > 3.0
    assert worst_place_mm(surface, events, true_mm) < held / 20


def test_prediction_beats_holding_on_a_finger_that_turns(surface):
    def true_mm(t):  # at most 100 mm/s and 630 mm/s^2
        return 30 + 16 * np.sin(2 * np.pi * t)

    t = np.arange(0, 1.5, 0.01)
    events = [TouchEvent(a, 0, b, 10.0, "move", 0.5) for a, b in zip(t, true_mm(t), strict=True)]
    held = held_mm(events, true_mm)
    assert worst_place_mm(surface, events, true_mm) < held / 3


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
    for begin_s, goal in ((0.0, most), (0.3, 0.0), (0.6, most)):
        begin_s += REACTION_S
        begin = (t > begin_s - 1e-9) & (t < begin_s + 0.2)
        there = t[begin][np.flatnonzero(np.abs(volts[1:][begin] - goal) < 1e-6 * most)[0]]
        assert fade_s - 1e-3 <= there - begin_s <= fade_s + 0.0101
    assert np.abs(device.mock.played_v).max() <= most * (1 + 1e-9) + 250 / 65534


def test_a_session_that_ends_while_a_finger_slides_ramps_down(surface):
    device, _ = render(surface, FULL, stroke(0.3))
    ramp = device.mock.played_v[-240:]
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
    assert len(renderer.played.rows) == 2


def test_a_resting_finger_takes_nothing_from_a_sliding_one(surface):
    slides = stroke(0.5)
    both = sorted([*still(0.5, touch_id=1), *slides], key=lambda event: event.t_s)
    for combination in ("strongest", "first", "mean"):
        alone, together = (
            amplitude(render(surface, HALF, events, combination=combination)[1])
            for events in (slides, both)
        )
        np.testing.assert_array_equal(alone, together, combination)


# Change and failure on the way


def test_a_new_texture_counts_from_the_reaction_on(surface):
    events = still(0.4)
    with SteppedRenderer(surface, HALF, settings=LiveSettings(sliding=ALWAYS)) as renderer:
        for event in events[:20]:
            renderer.event(event)
        assert renderer.texture is HALF
        renderer.texture = FULL
        known_s = renderer.now_s() + REACTION_S
        for event in events[20:]:
            renderer.event(event)
    t, volts = times(renderer), amplitude(renderer)
    half = of_model(surface, 0.5, 0.5)
    np.testing.assert_allclose(volts[(t > 0.1) & (t <= known_s)], half, rtol=2e-6)
    # The amplitude may change by 4e5 V/s.
    assert volts[t > known_s + renderer.step_s][0] > half
    np.testing.assert_allclose(volts[t > known_s + 0.001], 200.0, rtol=1e-6)


def test_a_device_that_fails_in_mid_stroke(surface):
    renderer = SteppedRenderer(surface, Ruler())
    device, events = renderer.device, stroke(0.4)
    raised = 0
    with pytest.raises(DeviceFaultError), renderer:
        for i, event in enumerate(events):
            if i == 20:
                assert np.abs(device.mock.played_v[-48:]).max() > 0
                device.clock.sleep(1.0)  # a host that falls silent, by its watchdog
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
        begin_s = renderer.now_s()
        for event in events:
            renderer.event(event._replace(t_s=begin_s + event.t_s))
    assert np.abs(device.mock.played_v[before:]).max() > 100.0
    assert device.mock.played_codes[-1] == 0
