"""Blocks of motion: what is lazy is right, and frames are rigid motions."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptix.base.errors import InputError
from haptix.feel.motion import VELOCITY_OVER_S, Facts, LocalFrame, Motion, Trajectory
from haptix.play.render.fingers import PredictedFingers, RecordedFingers
from haptix.play.render.settings import LiveSettings, Sliding
from haptix.play.touch import TouchEvent

STEP_S = 1 / 12_000
ROUNDING = 1e-9
A_FEW = st.floats(-50, 50)


def test_a_live_finger_has_the_velocity_of_the_prediction():
    fingers = PredictedFingers(LiveSettings())
    for i in range(40):
        fingers.take(TouchEvent(0.01 * i, 0, 0.8 * i, 20 - 0.3 * i, "move", None))
        fingers.take(TouchEvent(0.01 * i, 1, 5.0, 6.0, "move", 0.7))
    fingers.update(0.38)  # fades in until then
    motion = fingers.motion(0.39, STEP_S, 12, 2.5).motion
    assert motion.fingers == 1  # the other one rests
    np.testing.assert_allclose(motion.vx_mm_s, 80.0, rtol=1e-3)
    np.testing.assert_allclose(motion.vy_mm_s, -30.0, rtol=1e-3)
    np.testing.assert_allclose(motion.ux, 80 / np.sqrt(80**2 + 30**2 + 2**2), rtol=1e-3)
    np.testing.assert_allclose(motion.t_s, 2.5 + STEP_S * np.arange(1, 13))
    assert motion.force_known == (False,)


def recorded() -> RecordedFingers:
    """Two fingers whose paths turn, known up to 0.2 s."""
    fingers = RecordedFingers(Sliding())
    for i in range(21):
        t = 0.01 * i
        fingers.touch(0, t, 30 * np.sin(20 * t), 4.0, 0.5)
        fingers.touch(1, t, 90 * t, 30 * t, 0.5, force_known=False)
    return fingers


def test_a_row_of_touches_is_what_each_of_them_is_and_lies_on_lines_between_them():
    rng = np.random.default_rng(3)
    t = np.cumsum(rng.uniform(0.001, 0.03, 60))
    # Steps of 0 and of 3 mm: the finger often stops and starts, in the midst of fades too.
    x = np.cumsum(rng.choice([0.0, 0.001, 3.0], 60))
    y, force = rng.uniform(0, 9, 60).round(), rng.uniform(0.2, 0.8, 60)
    y[20:30] = 4.0
    whole, each = RecordedFingers(Sliding()), RecordedFingers(Sliding())
    reports: tuple[list[float], list[float]] = ([], [])

    def reacting(heard):
        def react(facts, before, now):
            heard.append(now.t_s)
            return facts

        return react

    whole.touch(0, t, x, y, force, react=reacting(reports[0]), start_s=t[0])
    for row in zip(t, x, y, force, strict=True):
        each.touch(0, *row, react=reacting(reports[1]), start_s=t[0])
    points = int((t[-1] - t[0]) / STEP_S)
    one, other = (f.motion(t[0], STEP_S, points, 0.0) for f in (whole, each))
    at = t[0] + STEP_S * np.arange(1, points + 1)
    for name, line in (("x_mm", x), ("y_mm", y), ("normal_force_n", force)):
        expected = np.interp(at, t, line)
        np.testing.assert_allclose(getattr(one.motion, name), expected, rtol=0, atol=ROUNDING)
        np.testing.assert_array_equal(getattr(other.motion, name), getattr(one.motion, name))
    np.testing.assert_array_equal(other.gain, one.gain)
    assert reports[0] == reports[1] == pytest.approx(t - t[0])


def test_recorded_velocity_is_the_mean_over_the_last_10_ms_however_blocks_are_cut():
    t = STEP_S * np.arange(1, 2401)
    whole = recorded().motion(0.0, STEP_S, 2400, 0.0).motion
    fingers, parts = recorded(), []
    for first in range(0, 2400, 300):
        parts.append(fingers.motion(first * STEP_S, STEP_S, 300, first * STEP_S).motion)
    for name in ("t_s", "vx_mm_s", "vy_mm_s"):
        cut = np.concatenate([getattr(part, name).reshape(2, -1) for part in parts], axis=1)
        expected = getattr(whole, name).reshape(2, -1)
        np.testing.assert_allclose(cut, expected, rtol=0, atol=ROUNDING)
    path = 0.01 * np.arange(21), 30 * np.sin(0.2 * np.arange(21))
    slid = np.interp(t, *path) - np.interp(t - VELOCITY_OVER_S, *path)
    turning, straight = whole.vx_mm_s.reshape(2, -1)
    np.testing.assert_allclose(turning, slid / VELOCITY_OVER_S, rtol=0, atol=1e-6)
    np.testing.assert_allclose(straight[t > VELOCITY_OVER_S], 90.0, rtol=1e-9)
    assert whole.force_known == (True, False)


def test_a_path_has_the_velocity_of_its_mean_around_each_time():
    t = np.arange(0, 1, 0.001)
    path = Trajectory.of(t, 20 * np.sin(5 * t), -7 * t, 0.5)
    vx, vy = path.velocity_mm_per_s(t[10:-10])
    # The mean of a sine over a window w is lower by (5 w)^2 / 24.
    np.testing.assert_allclose(vx, 100 * np.cos(5 * t[10:-10]), atol=100 * (5 * 0.01) ** 2 / 20)
    np.testing.assert_allclose(vy, -7.0, rtol=1e-9)


@given(A_FEW, A_FEW, st.floats(-3, 3), st.floats(0.2, 5), A_FEW, A_FEW, st.floats(-4, 4))
def test_seen_from_a_frame_that_moves_velocities_are_those_of_the_places(
    x0, y0, angle, scale, vx, vy, turn
):
    t = STEP_S * np.arange(600)
    x, y = 10 + 80 * t + 200 * t**2, 3 - 60 * t
    frame = LocalFrame(x0 + vx * t, y0 + vy * t, angle + turn * t, scale, vx, vy, turn)
    local = Motion.of(x, y, t, 80 + 400 * t, -60.0, footprint_mm=0.01).seen_from(frame)
    for place, velocity in ((local.x_mm, local.vx_mm_s), (local.y_mm, local.vy_mm_s)):
        # Second differences at the ends and curvature within: 1e-4 of the speed.
        np.testing.assert_allclose(
            np.gradient(place, t)[1:-1], velocity[1:-1], rtol=0, atol=1e-3 / scale
        )
    distance = np.hypot(x - x0 - vx * t, y - y0 - vy * t) / scale
    np.testing.assert_allclose(np.hypot(local.x_mm, local.y_mm), distance, atol=1e-9)
    assert Motion.of(x, y, t).seen_from(frame).footprint_mm == 0
    if not frame.is_still:
        np.testing.assert_allclose(local.footprint_mm, local.speed_mm_s.max() * STEP_S, rtol=1e-6)


def test_at_rest_there_is_no_direction_and_a_reversal_is_smooth():
    v = np.linspace(-100, 100, 2001)
    motion = Motion.of(0.0, 0.0, 0.0, v, 0.0)
    assert motion.ux[1000] == 0
    assert np.abs(np.diff(motion.ux)).max() <= 0.1 / 2 + ROUNDING  # slope 1 / (2 mm/s) at most
    assert motion.ux[-1] == pytest.approx(1.0, abs=2e-4)
    assert not Motion(1, 3, np.ones(3), np.ones(3), np.ones(3), 0.0, STEP_S).speed_mm_s.any()


def test_facts_hold_from_their_time_on_for_each_finger():
    pressed, released = Facts(0.0, press_s=0.1), Facts(0.0, press_s=0.1, release_s=0.3)
    motion = Motion(2, 4, np.zeros(8), np.zeros(8), np.zeros(8), 0.0, 0.1).with_history(
        (((0.15, pressed), (0.35, released)), ())
    )
    np.testing.assert_array_equal(motion.facts.press_s[:4], [np.nan, 0.1, 0.1, 0.1])
    np.testing.assert_array_equal(motion.facts.release_s[:4], [np.nan, np.nan, np.nan, 0.3])
    assert np.isnan(motion.facts.press_s[4:]).all()


def test_copies_ahead_are_on_the_path():
    t = 1e-3 * np.arange(50)
    motion = Motion.of(90 * t, 4.0, t, 90.0, 0.0)
    there = motion.ahead(np.array([-0.5, 0.0, 2.0]), 0.2)
    each = motion.ahead(np.linspace(-1.0, 1.0, 100).reshape(2, 50), 0.2)
    np.testing.assert_allclose(each.x_mm, 90 * each.t_s, atol=1e-12)
    assert np.ptp(each.t_s.reshape(2, 50) - t) > 1.9e-3
    for part, name in ((90 * there.t_s, "x_mm"), (90.0, "vx_mm_s"), (90.0, "speed_mm_s")):
        np.testing.assert_allclose(getattr(there, name), part, atol=1e-12)
    assert there.footprint_mm == 0.2
    assert np.isnan(there.facts.down_s).sum() == there.x_mm.size


def test_reach_is_unknown_without_a_renderer():
    with pytest.raises(InputError, match="renderer"):
        _ = Motion.of(0.0, 0.0).reach
    with pytest.raises(InputError, match="one length"):
        Motion.of([1, 2], [1, 2, 3])
