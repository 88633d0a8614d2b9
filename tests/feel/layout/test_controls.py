"""Values of controls that an app sets while a finger is on them."""

from math import cos, pi, sin

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptix import InputError, Layout
from haptix.feel.layout import Listeners
from haptix.feel.materials import Dial, Grating, Slider, Toggle
from haptix.feel.motion import Motion, Report
from tests.hand_clock import HandClock


class Finger:
    """One finger on a layout, its reports 10 ms apart, and what callbacks were told."""

    def __init__(self, layout):
        self.clock, self.layout, self.listeners, self.told = HandClock(1.0), layout, Listeners(), []
        layout.attach(self.clock)
        for kind in ("enter", "leave", "detent"):
            self.listeners.on(kind, lambda event: self.told.append((event.kind, event.detent)))

    def at(self, x, y=5.0, is_down=True):
        self.clock.now_s += 0.01
        now = Report(self.clock.now_s, x, y, 0.5, is_down)
        self.layout.report(7, now)
        self.listeners.report(self.layout, 7, now.t_s, now)

    def asked(self, x, y=5.0):
        """Friction after the cross-fade."""
        return self.layout.wanted(Motion.of(x, y, self.clock.now_s + 0.1))

    @property
    def detents(self):
        return [number for kind, number in self.told if kind == "detent"]


def placed(material, x=10.0, size=(80.0, 60.0)):
    layout = Layout()
    region = layout.add(material, x, 0.0, *size)
    return region, Finger(layout)


def ridges(finger, lo, hi, y=5.0):
    """Places of the maxima of friction."""
    x = np.linspace(lo, hi, 4001)
    level = finger.asked(x, y)
    inner = (level[1:-1] > level[:-2]) & (level[1:-1] >= level[2:]) & (level[1:-1] > 0.99)
    return x[1:-1][inner]


def test_detents_follow_a_value_that_the_app_sets_and_none_is_crossed():
    region, finger = placed(Slider(travel_mm=40.0, detents=5))  # ridges at 5, 15, ... from 10
    finger.at(21.0)
    assert region.value == 0.25
    np.testing.assert_allclose(ridges(finger, 10, 50), [15, 25, 35, 45], atol=0.02)
    region.set_value(0.75)  # detent 3, where the finger is, at 21
    assert region.value == 0.75
    np.testing.assert_allclose(ridges(finger, 0, 31), [16, 26], atol=0.02)
    finger.at(21.0)
    finger.at(22.0)
    assert region.value == 0.75
    assert finger.detents == []
    finger.at(27.0)  # past the ridge at 26, by the finger
    assert finger.detents == [4.0]
    assert region.value == 1.0
    finger.at(27.0, is_down=False)
    assert finger.told[-1][0] == "leave"
    np.testing.assert_allclose(ridges(finger, 10, 50), [15, 25, 35, 45], atol=0.02)
    assert region.value == 1.0
    region.set_value(0.0)  # nobody is on it
    assert region.value == 0.0
    np.testing.assert_allclose(ridges(finger, 10, 50), [15, 25, 35, 45], atol=0.02)


@given(st.floats(0, 1), st.floats(0, 360), st.floats(20, 45))
def test_a_finger_anywhere_on_a_slider_is_at_the_value_that_was_set(value, angle, x):
    material = Slider(travel_mm=30.0, detents=4, orientation_deg=angle, snap=False)
    region, finger = placed(material)
    finger.at(x, 20.0)
    region.set_value(value)
    finger.at(x, 20.0)
    assert region.value == pytest.approx(value, abs=1e-9)
    assert finger.detents == []


def test_a_dial_turns_and_a_toggle_goes_over():
    dial, finger = placed(Dial(detents=12, centre_mm=(30.0, 30.0)), x=0.0, size=(60.0, 60.0))
    at = lambda turn: (30 + 20 * cos(2 * pi * turn), 30 + 20 * sin(2 * pi * turn))  # noqa: E731
    finger.at(*at(0.0))
    dial.set_value(0.25)
    finger.at(*at(0.01))
    assert dial.value == 0.25
    assert finger.detents == []
    finger.at(*at(1 / 12))
    assert dial.value == pytest.approx(4 / 12)
    assert finger.detents == [4.0]

    toggle, finger = placed(Toggle(width_mm=20.0), size=(20.0, 10.0))
    finger.at(13.0)
    assert toggle.value == 0.0
    toggle.set_value(1.0)
    finger.at(13.0)
    assert (toggle.value, finger.detents) == (1.0, [])
    finger.at(13.5)
    assert (toggle.value, finger.detents) == (1.0, [])
    toggle.set_value(0.0)
    finger.at(13.5)
    assert (toggle.value, finger.detents) == (0.0, [])
    finger.at(26.0)  # over the middle, to the right
    assert (toggle.value, finger.detents) == (1.0, [1.0])


def test_changes_in_a_pause_do_not_pile_up():
    region, finger = placed(Slider(travel_mm=40.0, detents=5))
    finger.at(21.0)
    shown = finger.layout.store
    for i in range(50):  # the clock stands
        region.set_value((i % 10) / 10)
        region.change(opacity=1.0)
    assert len(shown.shown.regions) == 2  # the one that is felt, and the one that comes
    np.testing.assert_allclose(ridges(finger, 0, 20), [10], atol=0.02)  # 0.9 is at 21
    finger.clock.now_s += 0.02
    region.set_value(0.5)
    assert len(shown.shown.regions) == 2


def test_a_control_that_was_moved_still_follows_the_finger():
    region, finger = placed(Slider(travel_mm=40.0, detents=5))
    finger.at(20.0)
    region.move(x_mm=50.0, over_s=0.0)
    finger.at(80.0)
    assert region.value == pytest.approx(0.75)  # 30 of 40 mm


def test_what_has_no_value_says_so():
    region, _ = placed(Grating(period_mm=3.0))
    with pytest.raises(InputError, match="expected a control"):
        region.set_value(0.3)
    with pytest.raises(InputError, match="expected a control"):
        _ = region.value
    region, _ = placed(Slider())
    for wrong in (2, -0.1, "half", float("nan")):
        with pytest.raises(InputError, match="value"):
            region.set_value(wrong)
