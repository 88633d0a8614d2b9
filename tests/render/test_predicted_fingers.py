"""Live fingers at the points of a block, against the predictions of their trackers."""

from math import exp

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from haptix.render import LiveSettings
from haptix.render.fingers import PredictedFingers
from haptix.touch import (
    ConstantVelocityKalman,
    InteractingSinger,
    OneEuroFilter,
    SingerKalman,
    TouchEvent,
    TouchSettings,
)

STEP_S = 1 / 12_000
FILTERS = (ConstantVelocityKalman(), OneEuroFilter(), SingerKalman(), InteractingSinger())


def expected(track, settings, at_rest, t0_s, points):
    """Place, force and gain of a finger: a parabola through predictions, and what decays."""
    t_s = t0_s + STEP_S * np.arange(1, points + 1)
    length_s = STEP_S * points
    ahead = [track.ahead(t0_s + part * length_s) for part in (0.0, 0.5, 1.0)]
    decays = [exp(-(t - track.start_s) / settings.touch.blend_s) for t in t_s]
    rows = [
        np.polyval(np.polyfit([0.0, 0.5, 1.0], values, 2), (t_s - t0_s) / length_s)
        + np.array(decays) * offset
        for values, offset in zip(
            zip(*((one.x_mm, one.y_mm, one.normal_force_n) for one in ahead), strict=True),
            track.offset,
            strict=True,
        )
    ]
    return [*rows, np.array([track.gain_at(t, settings, at_rest) for t in t_s])], ahead[1]


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
    for track in fingers.tracks.values():
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
    speeds = [one.speed_mm_s for one in middles]
    assert motion.footprint_mm == pytest.approx(max(speeds) * STEP_S, rel=1e-12)
    for mine, name in ((motion.vx_mm_s, "vx_mm_s"), (motion.vy_mm_s, "vy_mm_s")):
        each = np.repeat([getattr(one, name) for one in middles], points)
        np.testing.assert_allclose(mine, each, rtol=1e-12, atol=1e-12)
    assert len(motion.history) == len(found.touch_ids) == len(lines)
