"""A tracker: order, gaps, clocks, floods and prediction."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from haptix import InputError
from haptix.play.touch import (
    ConstantVelocityKalman,
    ForceModel,
    InteractingSinger,
    OneEuroFilter,
    SingerKalman,
    TouchSettings,
    TouchTracker,
)

FILTERS = (ConstantVelocityKalman(), OneEuroFilter(), SingerKalman(), InteractingSinger())


def follow(reports, settings=None):
    first, *rest = reports
    tracker = TouchTracker(settings or TouchSettings(), *first)
    for report in rest:
        tracker.push(*report)
    return tracker


def line(count=60, dt=0.01, vx=80.0, vy=-60.0):
    return [(dt * i, 10 + vx * dt * i, 20 + vy * dt * i) for i in range(count)]


@pytest.mark.parametrize("latency", [0.0, 0.03])
def test_a_steady_finger_is_predicted_over_age_and_latency(latency):
    tracker = follow(line(), TouchSettings(latency_s=latency))
    t = 0.59 + 0.007
    state = tracker.at(t)
    # The filter has forgotten the start to 1e-4 of the speed.
    ahead = t + latency
    np.testing.assert_allclose((state.x_mm, state.y_mm), (10 + 80 * ahead, 20 - 60 * ahead), 1e-4)
    np.testing.assert_allclose((state.vx_mm_s, state.vy_mm_s), (80, -60), rtol=1e-3)
    assert state.speed_mm_s == pytest.approx(math.hypot(state.vx_mm_s, state.vy_mm_s))
    assert state.age_s == pytest.approx(0.007)
    assert state.is_sliding and state.is_down and not state.is_lost


def test_a_touch_without_reports_rests_where_it_was_reported_last():
    # Reports each 10 ms: the panel is silent about a finger that stands.
    tracker = follow(line(), TouchSettings(latency_s=0.03, lost_after_s=0.05, blend_s=0.002))
    before = tracker.at(0.59 + 0.0199)
    assert before.is_sliding and before.speed_mm_s > 90
    for age in (0.04, 0.1, 10.0, 1e6):
        rests = tracker.at(0.59 + age)
        assert rests.is_lost == (age > 0.05) and not rests.is_sliding and rests.is_down
        assert rests.speed_mm_s == rests.vx_mm_s == rests.vy_mm_s == 0
        # The prediction was 5 mm ahead; 18 ms are nine times blend_s.
        np.testing.assert_allclose(rests[1:3], (10 + 80 * 0.59, 20 - 60 * 0.59), atol=1e-3)


def test_a_finger_that_moves_on_after_it_rested_starts_from_there():
    reports = line()
    t, x, y = reports[-1]
    tracker = follow([*reports, (t + 0.06, x + 0.1, y)])
    assert tracker.at(t + 0.06).speed_mm_s < 25  # of 100 before
    np.testing.assert_allclose(tracker.at(t + 0.06)[1:3], (x + 0.1, y), atol=0.3)


def test_one_report_that_is_missing_is_no_rest():
    reports = line()
    tracker = follow([*reports[:-2], reports[-1]])
    state = tracker.at(reports[-2][0])
    assert state.is_sliding
    assert state.speed_mm_s == pytest.approx(100, rel=1e-3)


@pytest.mark.parametrize("place_filter", FILTERS, ids=lambda f: type(f).__name__)
def test_a_jump_that_no_finger_makes_is_rejected_and_counted(place_filter):
    reports = line()
    wrong = (0.305, reports[30][1] + 30, reports[30][2])
    tracker = follow([*reports[:31], wrong, *reports[31:]], TouchSettings(filter=place_filter))
    assert tracker.counts.jumps == 1
    assert tracker.at(0.6) == follow(reports, TouchSettings(filter=place_filter)).at(0.6)


def test_a_finger_that_truly_is_elsewhere_is_followed_with_the_next_report():
    reports = line()
    there = [(t, x + 60, y) for t, x, y in reports[30:]]
    tracker = follow([*reports[:30], *there[:2]])
    assert tracker.counts.jumps == 1
    np.testing.assert_allclose(tracker.at(there[1][0])[1:3], there[1][1:], atol=0.3)
    assert tracker.at(there[1][0]).is_sliding


def test_places_that_never_agree_are_followed_at_last():
    tracker = follow([(0.01 * i, 100.0 * (i % 7), 50.0 * (i % 5)) for i in range(40)])
    assert tracker.last_t_s > 0.39 - 0.04


def test_a_lost_touch_is_taken_up_anew():
    tracker = follow(line())
    assert tracker.push(5.0, 90.0, 90.0)
    state = tracker.at(5.0)
    assert state[1:5] == (90.0, 90.0, 0.0, 0.0)
    assert not state.is_lost and not state.is_sliding


@settings(deadline=None, max_examples=60)
@given(st.data())
@pytest.mark.parametrize("spread_mm", [0.5, 9.0])  # of places; the second has jumps, and silences
@pytest.mark.parametrize("place_filter", FILTERS, ids=lambda f: type(f).__name__)
def test_events_out_of_order_end_as_if_in_order(place_filter, spread_mm, data):
    # Each report comes up to 18 ms late: within the window of 20.
    random = np.random.default_rng(data.draw(st.integers(0, 2**32 - 1)))
    t = np.cumsum(random.uniform(0.0015, 0.012 if spread_mm < 1 else 0.03, 25))
    places = random.normal(0, spread_mm, (25, 2))
    reports = [tuple(row) for row in np.column_stack([t, places]).tolist()]
    arrivals = t + random.uniform(0, 0.018, 25)
    arrivals[0] = 0.0
    shuffled = [reports[i] for i in np.argsort(arrivals)]
    how = TouchSettings(filter=place_filter)
    found, wanted = follow(shuffled, how), follow(reports, how)
    assert found.at(t[-1] + 0.01) == wanted.at(t[-1] + 0.01)
    assert found.counts.late == 0
    swaps = sum(b < max(shuffled[: i + 1])[0] for i, (b, _, _) in enumerate(shuffled))
    assert found.counts.reordered == swaps
    assert found.counts.taken + found.counts.jumps == 25
    assert spread_mm > 1 or not found.counts.jumps


def test_a_report_before_the_first_is_put_there_too():
    how = TouchSettings()
    found = follow([(0.010, 1.0, 0.0), (0.002, 0.0, 0.0), (0.020, 2.0, 0.0)], how)
    wanted = follow([(0.002, 0.0, 0.0), (0.010, 1.0, 0.0), (0.020, 2.0, 0.0)], how)
    assert found.at(0.02) == wanted.at(0.02)


def test_what_is_too_late_is_dropped_and_counted():
    tracker = follow(line())
    before = tracker.at(0.6)
    assert not tracker.push(0.59 - 0.021, 500.0, 500.0)
    assert tracker.counts.late == 1
    assert tracker.at(0.6) == before


def test_one_late_report_now_and_then_is_no_jump_of_the_clock():
    tracker = follow(line(10))
    for i in range(10, 30):
        tracker.push(0.01 * i - 0.05, 500.0, 500.0)
        tracker.push(0.01 * i, 10 + 0.8 * i, 20 - 0.6 * i)
    assert tracker.counts.late == 20
    assert tracker.counts.clock_jumps == 0
    assert tracker.at(0.29).x_mm == pytest.approx(10 + 80 * 0.29, abs=0.01)


def test_a_clock_that_runs_backwards_is_followed_with_the_third_report():
    tracker = follow(line())
    taken = [tracker.push(0.1 + 0.01 * i, 50.0 + i, 20.0) for i in range(50)]
    assert taken == [False, False] + [True] * 48
    assert tracker.counts.clock_jumps == 1
    state = tracker.at(0.1 + 0.49)
    np.testing.assert_allclose(state[1:3], (99, 20), atol=0.01)
    np.testing.assert_allclose(state[3:5], (100, 0), atol=0.2)


def test_a_clock_that_leaps_ahead_once_is_recovered_from():
    tracker = follow([*line(), (4000.0, 60.0, -20.0)])
    for i in range(61, 130):
        tracker.push(0.01 * i, 10 + 0.8 * i, 20 - 0.6 * i)
    assert tracker.counts.clock_jumps == 1
    assert tracker.at(1.29).x_mm == pytest.approx(10 + 80 * 1.29, abs=0.01)


def test_of_two_reports_at_one_time_the_later_counts():
    reports = line()
    wrong = [(t, 0.0, 0.0) for t, _, _ in reports]
    doubled = [r for pair in zip(wrong, reports, strict=True) for r in pair]
    found = follow(doubled)
    assert found.at(0.6) == follow(reports).at(0.6)
    assert found.counts.coalesced == len(reports)


def test_a_flood_is_coalesced():
    # 10 kHz of one finger at 100 mm/s with noise: filtered at 1 kHz at most.
    random = np.random.default_rng(3)
    t = np.arange(0, 1, 1e-4)
    x = 100 * t + random.normal(0, 0.1, len(t))
    reports = [(a, b, 0.0) for a, b in zip(t.tolist(), x.tolist(), strict=True)]
    tracker = follow(reports)
    kept = len(t) - tracker.counts.coalesced
    assert 900 <= kept <= 1000
    assert tracker.counts.taken == len(t)
    state = tracker.at(1.0)
    # Many reports make the place better than one is: 0.1 mm; velocity to some per cent.
    assert state.x_mm == pytest.approx(100, abs=0.1)
    assert state.vx_mm_s == pytest.approx(100, abs=15)
    assert state.is_sliding


def test_sliding_has_hysteresis():
    # Speed rises slowly from 0 to 20 mm/s and falls again.
    speeds = np.concatenate([np.arange(0, 20, 0.05), np.arange(20, 0, -0.05)])
    x = np.cumsum(speeds * 0.01)
    tracker = TouchTracker(TouchSettings(), 0.0, 0.0, 0.0)
    states = []
    for i, place in enumerate(x, 1):
        tracker.push(0.01 * i, float(place), 0.0)
        states.append(tracker.at(0.01 * i).is_sliding)
    changes = [i for i in range(1, len(states)) if states[i] != states[i - 1]]
    assert len(changes) == 2
    # Velocity is known with a lag of some 0.1 s, in which speed changes by 0.5 mm/s.
    assert speeds[changes[0]] == pytest.approx(8.0, abs=1.0)
    assert speeds[changes[1]] == pytest.approx(4.0, abs=1.0)


@pytest.mark.parametrize("place_filter", FILTERS, ids=lambda f: type(f).__name__)
@pytest.mark.parametrize("rate", [60, 100, 240])
def test_a_noisy_resting_finger_does_not_slide_and_a_slow_one_does(place_filter, rate):
    random = np.random.default_rng(4)
    how = TouchSettings(filter=place_filter)
    for speed, wanted in ((0.0, False), (20.0, True)):
        tracker = TouchTracker(how, 0.0, 0.0, 0.0)
        seen = set()
        for i in range(1, 20 * rate):
            t = i / rate
            e, f = random.normal(0, 0.1, 2)
            tracker.push(t, speed * t + float(e), float(f))
            if t > 0.5:
                seen.add(tracker.at(t).is_sliding)
        assert seen == {wanted}


def test_a_lifted_touch_does_not_slide():
    tracker = follow(line())
    before = tracker.at(0.59)
    tracker.lift()
    state = tracker.at(0.591)
    assert before.is_sliding and before.is_down
    assert not state.is_sliding and not state.is_down
    assert state.vx_mm_s == pytest.approx(80, rel=1e-2)  # where it goes is still predicted


def test_force_is_kept():
    tracker = TouchTracker(TouchSettings(), 0.0, 0.0, 0.0)
    state = tracker.at(0.0)
    assert (state.normal_force_n, state.force_sigma_n, state.force_source) == (0.5, 0.25, "assumed")
    tracker.push(0.001, 0.0, 0.0, 0.9)
    # A report that says nothing of force leaves it; one that came late does not bring an old one.
    tracker.push(0.010, 0.0, 0.0)
    tracker.push(0.005, 0.0, 0.0, 0.1)
    state = tracker.at(0.01)
    assert (state.normal_force_n, state.force_source) == (0.9, "axis")
    assert state.force_sigma_n == pytest.approx(0.9 * ForceModel().axis_sigma)


@pytest.mark.parametrize("force", [0.0, -1.0, math.nan, math.inf, 1e9, "firm"])
def test_a_force_that_cannot_be_is_counted_and_the_touch_goes_on(force):
    tracker = follow([(0.0, 0.0, 0.0, 0.7)])
    assert tracker.push(0.01, 1.0, 0.0, force)
    assert tracker.counts.bad_force == 1
    assert tracker.at(0.01).normal_force_n == 0.7
    assert tracker.last_t_s == 0.01


@pytest.mark.parametrize(
    ("field", "value"),
    [
        *itertools.product(
            ("lost_after_s", "blend_s", "slide_smoothing_s", "least_interval_s"),
            (0.0, -1.0, math.nan, math.inf),
        ),
        ("latency_s", -0.01),
        ("latency_s", math.nan),
        ("latency_s", 30.0),
        ("reorder_s", -1.0),
        ("rest_below_mm_s", -1.0),
        ("slide_above_mm_s", 1.0),
        ("slide_above_mm_s", math.inf),
    ],
)
def test_settings_that_cannot_be(field, value):
    with pytest.raises(InputError, match=field):
        TouchSettings(**{field: value})


@pytest.mark.parametrize("place_filter", FILTERS, ids=lambda f: type(f).__name__)
@pytest.mark.parametrize("rate", [60, 100, 240])
@pytest.mark.parametrize("length_mm, stroke_s", [(10, 0.2), (20, 0.4), (40, 0.4), (60, 0.6)])
def test_a_finger_that_scrubs_slides_while_it_turns(place_filter, rate, length_mm, stroke_s):
    # Minimum-jerk strokes to and fro, which before had a gap of 50 ms at each turn.
    random = np.random.default_rng(5)
    t = np.arange(1, 10 * stroke_s * rate) / rate
    u = t / stroke_s % 1
    x = length_mm * (10 * u**3 - 15 * u**4 + 6 * u**5)
    x = np.where(t / stroke_s % 2 < 1, x, length_mm - x) + random.normal(0, 0.1, t.size)
    tracker = TouchTracker(TouchSettings(filter=place_filter), 0.0, 0.0, 0.0)
    slides = []
    for at, place in zip(t.tolist(), x.tolist(), strict=True):
        tracker.push(at, place, 0.0)
        slides.append(tracker.at(at).is_sliding)
    assert all(slides[slides.index(True) :])


@pytest.mark.parametrize("place_filter", FILTERS, ids=lambda f: type(f).__name__)
def test_a_finger_that_stops_comes_to_rest_on_a_noisy_panel_too(place_filter):
    # 0.3 mm at 240 Hz: the speed of the noise alone is 9 to 31 mm/s (measured), by filter.
    random = np.random.default_rng(6)
    settings = TouchSettings(filter=place_filter, slide_above_mm_s=40.0, rest_below_mm_s=30.0)
    tracker = TouchTracker(settings, 0.0, 0.0, 0.0)
    for i in range(1, 480):
        t = i / 240
        tracker.push(t, 100 * min(t, 1.0) + float(random.normal(0, 0.3)), 0.0)
        if 0.3 < t < 1:
            assert tracker.at(t).is_sliding
        # The velocity averages out within 4 of its 50 ms, and a turn lasts 100 ms at most.
        if t > 1.4:
            assert not tracker.at(t).is_sliding
