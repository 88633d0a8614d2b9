"""Live fingers at the points of a block, against the predictions of their trackers."""

from math import exp, expm1

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from haptix.play.render import LiveSettings
from haptix.play.render.fingers import PredictedFingers
from haptix.play.touch import (
    ConstantVelocityKalman,
    InteractingSinger,
    OneEuroFilter,
    SingerKalman,
    TouchEvent,
    TouchSettings,
)

STEP_S = 1 / 12_000
FILTERS = (ConstantVelocityKalman(), OneEuroFilter(), SingerKalman(), InteractingSinger())


class Track:
    """What the row of a finger predicts, by the formulas of docs/touch.md and rendering.md."""

    def __init__(self, row, settings):
        self.row, self.settings = row, settings
        self.offset = np.array([row.dx_mm, row.dy_mm, row.df_n])

    def ahead(self, t_s):
        """Place, force, velocity without the offset."""
        row, touch = self.row, self.settings.touch
        rested_s = t_s - row.rests_s
        age_s = min(t_s, row.rests_s) - row.reported_s
        h = max(min(age_s, touch.lost_after_s) + touch.latency_s, -touch.lost_after_s)
        place, speed, more = np.array([
            [row.x_mm, row.y_mm], [row.vx_mm_s, row.vy_mm_s], [row.ax_mm_s2, row.ay_mm_s2],
        ])  # fmt: skip
        part = h / row.lasting_s
        place = place + speed * h + more * row.lasting_s**2 * (expm1(-part) + part)
        speed = speed - more * row.lasting_s * expm1(-part)
        if rested_s > 0:
            rest = np.array([row.rest_x_mm, row.rest_y_mm])
            place, speed = rest + exp(-rested_s / touch.blend_s) * (place - rest), np.zeros(2)
        return np.array([*place, row.normal_force_n]), speed

    def place(self, t_s):
        left = exp(-max(t_s - self.row.start_s, 0.0) / self.settings.touch.blend_s)
        return self.ahead(t_s)[0] + left * self.offset

    def gain_at(self, t_s, at_rest):
        row, fade_s = self.row, self.settings.sliding.fade_s
        last_s = row.start_s
        if row.is_down and (row.is_sliding or at_rest):
            lost_s = row.reported_s + self.settings.touch.lost_after_s
            last_s = max(lost_s if at_rest else row.rests_s, row.start_s)
        risen = row.gain + max(min(t_s, last_s) - row.start_s, 0.0) / fade_s
        return max(min(risen, 1.0) - max(t_s - last_s, 0.0) / fade_s, 0.0)


def tracks_of(fingers, settings):
    return [Track(track.row, settings) for track in fingers.tracks.values()]


def expected(track, settings, at_rest, t0_s, points):
    """Place, force and gain of a finger: a parabola through predictions, and what decays."""
    t_s = t0_s + STEP_S * np.arange(1, points + 1)
    length_s = min(max(track.row.rests_s - t0_s, 0.0), STEP_S * points)  # then it rests
    ahead = [track.ahead(t0_s + part * length_s) for part in (0.0, 0.5, 1.0)]
    rests = np.array([track.ahead(t)[0] for t in t_s]).T
    decays = np.array([exp(-(t - track.row.start_s) / settings.touch.blend_s) for t in t_s])
    through = np.polyfit([0.0, 0.5, 1.0], [place for place, _ in ahead], 2)
    u = (t_s - t0_s) / max(length_s, 1e-12)
    moving = through[0][:, None] * u**2 + through[1][:, None] * u + through[2][:, None]
    rows = np.where(t_s <= t0_s + length_s, moving, rests) + track.offset[:, None] * decays
    return [*rows, np.array([track.gain_at(t, at_rest) for t in t_s])], ahead[1][1]


@settings(max_examples=60, deadline=None)
@given(data=st.data())
@pytest.mark.parametrize("place_filter", FILTERS, ids=lambda one: type(one).__name__)
def test_fingers_are_where_their_trackers_predict_them(place_filter, data):
    random = np.random.default_rng(data.draw(st.integers(0, 10**6)))
    touch = TouchSettings(filter=place_filter, latency_s=data.draw(st.floats(0, 0.05)))
    options = LiveSettings(touch=touch)
    fingers, count = PredictedFingers(options), data.draw(st.integers(1, 5))
    at_rest, t_s = data.draw(st.booleans()), 0.0
    for _ in range(data.draw(st.integers(1, 30))):
        t_s += float(random.uniform(0.002, 0.02))
        finger = int(random.integers(count))
        x, y, force = random.uniform([0, 0, 0.1], [50, 50, 1]).tolist()
        kind = "up" if random.uniform() < 0.1 else "move"
        if kind == "move" or finger in fingers.touches:
            fingers.take(TouchEvent(t_s, finger, x, y, kind, force))
        if random.uniform() < 0.7:
            fingers.update(t_s + 0.001)
    t0_s = t_s + data.draw(st.floats(0.002, 2 * touch.lost_after_s))
    points = data.draw(st.integers(1, 120))
    found = fingers.motion(t0_s, STEP_S, points, 0.0, at_rest)
    lines, middles = [], []
    for track in tracks_of(fingers, options):
        rows, middle = expected(track, options, at_rest, t0_s, points)
        if rows[3].any():
            lines.append(rows)
            middles.append(middle)
    assert found.motion.fingers == len(lines)
    if not lines:
        return
    motion = found.motion
    together = [np.concatenate(rows) for rows in zip(*lines, strict=True)]
    given_ = (motion.x_mm, motion.y_mm, motion.normal_force_n, found.gain)
    for mine, theirs in zip(given_, together, strict=True):
        # The oracle solves for its parabola: rounding of places of 1e3 mm.
        np.testing.assert_allclose(mine, theirs, rtol=1e-9, atol=1e-9)
    speeds = [np.hypot(*one) for one in middles]
    assert motion.footprint_mm == pytest.approx(max(speeds) * STEP_S, rel=1e-12)
    for axis, mine in enumerate((motion.vx_mm_s, motion.vy_mm_s)):
        each = np.repeat([one[axis] for one in middles], points)
        np.testing.assert_allclose(mine, each, rtol=1e-12, atol=1e-12)
    assert len(motion.history) == len(found.touch_ids) == len(lines)


def played(fingers, t_s):
    """Place and force of the one finger that is played at a time; None without one."""
    motion = fingers.motion(t_s - STEP_S, STEP_S, 1, 0.0, at_rest=True).motion
    if not motion.fingers:
        return None
    return [motion.x_mm.item(), motion.y_mm.item(), motion.normal_force_n.item()]


@pytest.mark.parametrize("place_filter", FILTERS, ids=lambda one: type(one).__name__)
@settings(deadline=None, max_examples=50)
@given(
    st.lists(
        st.tuples(st.floats(-0.05, 0.2), st.floats(-1e4, 1e4), st.floats(-1e4, 1e4)),
        min_size=1,
        max_size=30,
    ),
    st.floats(5e-4, 8e-3),
)
def test_what_is_played_never_jumps_at_a_report_and_stays_finite(place_filter, steps, length_s):
    # Events at any times, backwards too; each counts from the end of what was played.
    touch = TouchSettings(filter=place_filter, latency_s=0.03)
    options, t_s, now_s = LiveSettings(touch=touch, strict=False), 0.0, 0.0
    fingers = PredictedFingers(options)
    fingers.take(TouchEvent(0.0, 0, 0.0, 0.0, "down"))
    fingers.update(0.0)
    for dt, x, y in steps:
        t_s += dt
        now_s += length_s
        before = played(fingers, now_s)
        fingers.take(TouchEvent(t_s, 0, x, y, "move", 0.7))
        fingers.update(now_s)
        [track] = tracks_of(fingers, options)
        after = track.place(now_s)
        assert np.isfinite(after).all()
        if before is not None:
            # The offset is a difference of rounded places.
            assert after == pytest.approx(before, rel=1e-9, abs=1e-7)


def test_a_correction_is_taken_up_exponentially():
    # A finger believed at rest; then a report says 1 mm to the right and 0.9 N, with a filter that
    # believes reports entirely and no velocity.
    touch = TouchSettings(filter=OneEuroFilter(1e6, 0.0, 1e-9), blend_s=0.004)
    fingers = PredictedFingers(LiveSettings(touch=touch))
    fingers.take(TouchEvent(0.0, 0, 0.0, 0.0, "down"))
    fingers.update(0.0)
    fingers.take(TouchEvent(0.001, 0, 1.0, 0.0, "move", 0.9))
    fingers.update(0.001)
    motion = fingers.motion(0.001, STEP_S, 240, 0.0, at_rest=True).motion
    left = np.exp(-STEP_S * np.arange(1, 241) / 0.004)
    # The filter itself is 1e-4 short of the report.
    np.testing.assert_allclose(motion.x_mm, 1 - left, atol=1e-3)
    np.testing.assert_allclose(motion.normal_force_n, 0.9 - 0.4 * left, rtol=1e-9)


def test_a_lost_finger_that_is_back_while_its_drive_fades_does_not_jump():
    options = LiveSettings()
    fingers = PredictedFingers(options)
    for i in range(30):
        fingers.take(TouchEvent(0.01 * i, 0, 1.0 * i, 0.0, "move"))
        fingers.update(0.01 * i)
    back_s = 0.29 + options.touch.lost_after_s + options.sliding.fade_s / 2
    before = played(fingers, back_s)
    fingers.take(TouchEvent(back_s, 0, 50.0, 0.0, "move"))
    fingers.update(back_s)
    [track] = tracks_of(fingers, options)
    assert track.place(back_s) == pytest.approx(before, rel=1e-9)
