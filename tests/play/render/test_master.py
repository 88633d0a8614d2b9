"""Intensity, mute, pause, effects and callbacks, in virtual time."""

import numpy as np
import pytest

import haptix
from haptix import InputError, Layout, Renderer
from haptix.feel.layout import LayoutEvent
from haptix.feel.materials import Button, Grating, Slider, Transient
from haptix.play.render import LiveRenderer, LiveSettings, Sliding
from haptix.play.touch import TouchEvent
from tests.live_strokes import SteppedRenderer, row_times, target_mu

RATE = 48_000
LEVEL = Grating(period_mm=1e6, low=0.6, high=0.6000001)
CURVE = {"kind": "pulse", "width_s": 0.02, "height": 0.3, "at_s": 0.005, "length_s": 0.03}
BUMP = Transient(curve=CURVE)
ALWAYS = LiveSettings(sliding=Sliding(is_needed=False))


def playing(surface, texture, settings=ALWAYS):
    return SteppedRenderer(surface, texture, settings=settings)


def slide(renderer, until_s, from_s=0.0, force_n=0.5, y=5.0):
    t_s = from_s
    while t_s < until_s - 1e-9:
        renderer.touch(t_s, 5 + 100 * t_s, y, force_n)
        t_s = round(t_s + 0.005, 6)


def target(renderer):
    """Times and friction asked for, a millisecond apart."""
    known = ~np.isnan(target_mu(renderer))
    return row_times(renderer)[known], target_mu(renderer)[known]


def at(renderer, t_s):
    return np.interp(t_s, *target(renderer))


@pytest.fixture
def reach(surface):
    with playing(surface, LEVEL) as renderer:
        low, high = renderer.reachable([0.5], [0.0])
    return float(low[0]), float(high[0])


def test_intensity_scales_friction_above_the_lowest(surface, reach):
    low, high = reach
    full = low + 0.6 * (high - low)
    with playing(surface, LEVEL) as renderer:
        renderer.person_intensity(0.5)
        slide(renderer, 0.1)
        renderer.intensity(0.4)
        slide(renderer, 0.3, 0.1)
    assert at(renderer, 0.09) == pytest.approx(low + 0.5 * (full - low), rel=1e-3)
    assert at(renderer, 0.25) == pytest.approx(low + 0.2 * (full - low), rel=1e-3)
    # A line of 50 ms from the next sample on.
    half_way = 0.5 * (0.5 + 0.2)
    assert at(renderer, 0.1 + 0.025) == pytest.approx(low + half_way * (full - low), rel=0.02)
    for wrong in (2, -1, "loud", np.nan):
        with pytest.raises(InputError, match="intensity"):
            renderer.intensity(wrong)


def test_nothing_raises_a_voltage_beyond_what_friction_asks(surface):
    def highest(*effects):
        with playing(surface, LEVEL) as renderer:
            slide(renderer, 0.05)
            for effect in effects:
                renderer.play(effect)
            slide(renderer, 0.15, 0.05)
        assert renderer.stats.above == 0
        return renderer, renderer.played.amplitude_v.max()

    one, _ = highest(BUMP)
    three, loudest = highest(BUMP, BUMP, BUMP)
    assert target(three)[1].max() > target(one)[1].max()
    full = Grating(period_mm=1e6, low=0.9999999, high=1.0)
    with playing(surface, full) as renderer:
        slide(renderer, 0.1)
    # The texture asks for 1e-7 less than the highest friction.
    most = renderer.played.amplitude_v.max()
    assert loudest <= most * (1 + 1e-6)


def test_mute_takes_5_ms_and_time_goes_on_while_in_a_pause_it_stands(surface, reach):
    low, _ = reach
    texture = Layout(0.1)
    region = texture.add(LEVEL, 0, 0, 500, 50)
    with playing(surface, texture) as renderer:
        slide(renderer, 0.1)
        renderer.mute()
        slide(renderer, 0.2, 0.1)
        renderer.mute(False)
        slide(renderer, 0.3, 0.2)
        region.move(x_mm=400, over_s=0.8)  # at 500 mm/s, the finger at 100
        slide(renderer, 0.31, 0.3)
        renderer.pause()
        slide(renderer, 0.5, 0.31)
        scene_s = renderer.next_sample_s
        renderer.pause(False)
        slide(renderer, 0.7, 0.5)
    assert at(renderer, 0.15) == pytest.approx(low, rel=1e-6)
    assert at(renderer, 0.115) == pytest.approx(low, rel=1e-6)
    assert at(renderer, 0.25) == pytest.approx(at(renderer, 0.09), rel=1e-6)
    assert at(renderer, 0.4) == pytest.approx(low, rel=1e-6)
    # The last touch before was at 0.305 s, and the reaction is 3 ms.
    assert scene_s == pytest.approx(0.308, abs=1e-6)
    # The move goes on where it stood, with its edge at 5 mm and the finger at 55: 0.125 s are left.
    assert at(renderer, 0.6) > at(renderer, 0.65) > low


def test_an_effect_is_felt_and_its_end_is_told(surface, reach):
    low, high = reach
    told = []
    with playing(surface, LEVEL) as renderer:
        slide(renderer, 0.1)
        renderer.play(BUMP, done=told.append)
        began_s = renderer.next_sample_s
        slide(renderer, 0.2, 0.1)
        assert renderer.poll() == []  # it was told by a touch
    assert [one.outcome for one in told] == ["played"]
    assert told[0].effect is BUMP
    assert told[0].sample == round((began_s + BUMP.length_s) * RATE)
    assert told[0].felt_share == 1.0
    t_s, mu = target(renderer)
    felt = np.interp(began_s + 0.01, t_s, mu) - low
    assert felt == pytest.approx((0.6 + 0.3) * (high - low), rel=0.05)
    assert at(renderer, began_s - 0.002) == pytest.approx(at(renderer, 0.18), rel=1e-6)


def test_of_an_effect_it_is_told_how_much_was_felt(surface):
    """A finger that is lifted feels a part, one that rests nothing."""
    told = []
    settings = LiveSettings(sliding=Sliding(fade_s=0.001))
    with playing(surface, LEVEL, settings) as renderer:
        slide(renderer, 0.1)
        renderer.play(BUMP, done=told.append)
        began_s = renderer.next_sample_s
        slide(renderer, 0.11, 0.1)
        renderer.lift(0.11)
        renderer.touch(0.3, 30, 5, 0.5)  # it rests
        renderer.play(BUMP, done=told.append)
        for i in range(20):
            renderer.touch(0.3 + 0.005 * (i + 1), 30, 5, 0.5)
    assert [one.outcome for one in told] == ["played", "played"]
    # Reports count 3 ms after they came; the drive fades for 1 ms, to a half in 0.5.
    felt_s = 0.11 + 0.0035 - began_s
    assert told[0].felt_share == pytest.approx(felt_s / BUMP.length_s, abs=0.002 / BUMP.length_s)
    assert told[1].felt_share == 0.0


def test_of_nine_effects_the_oldest_of_the_lowest_priority_is_dropped(surface):
    told = []
    with playing(surface, LEVEL) as renderer:
        slide(renderer, 0.1)
        first = renderer.play(BUMP, priority=1, done=told.append)
        second = renderer.play(BUMP, done=told.append)
        for _ in range(7):
            renderer.play(BUMP, done=told.append)
        assert second.outcome == "dropped" and first.outcome == "played"
        first.stop()
        slide(renderer, 0.12, 0.1)
    # Leaving cuts what still plays, and tells it.
    outcomes = [one.outcome for one in told]
    assert sorted(set(outcomes)) == ["cut", "dropped"]
    assert outcomes.count("dropped") == 1 and len(outcomes) == 9
    for wrong in ("tick.wav", LEVEL, Transient):
        with pytest.raises(InputError, match="effect"):
            renderer.play(wrong)


@pytest.mark.parametrize("kind", [Renderer, LiveRenderer])
def test_callbacks_tell_what_fingers_do(surface, kind):
    layout = Layout()
    button = layout.add(Button(width_mm=16, height_mm=12), 10, 0)
    heard: list[LayoutEvent] = []
    device = haptix.open_device("mock:" if kind is Renderer else "mock:pace=stepped")
    with kind(surface, layout, device) as renderer:
        for what in ("enter", "leave", "press", "release", "detent"):
            renderer.on(what, heard.append)
        force = [0.5, 0.5, 0.9, 0.9, 0.4, 0.5, 0.9]
        for i, force_n in enumerate(force):
            renderer.touch(0.05 * (i + 1), 5.0 + 9 * min(i, 1), 6.0, force_n)
        renderer.touch(0.5, 40.0, 6.0, 0.9)
        renderer.touch(0.55, 15.0, 6.0, None)  # nobody measured how hard
        renderer.lift(0.6)
        with pytest.raises(InputError, match="on"):
            renderer.on("click", heard.append)
        with pytest.raises(InputError, match="function"):
            renderer.on("press", "beep")
    assert [one.kind for one in heard] == [
        "enter", "press", "release", "press", "release", "leave", "enter", "leave",
    ]  # fmt: skip
    assert {one.region for one in heard} == {button}
    assert heard[0].t_s == pytest.approx(0.1)


def test_a_touch_that_is_dropped_tells_nothing(surface):
    layout = Layout()
    layout.add(LEVEL, 0, 0, 100, 100)
    heard: list[LayoutEvent] = []
    settings = LiveSettings(strict=False)
    with playing(surface, layout, settings) as renderer:
        renderer.on("enter", heard.append)
        renderer.event(TouchEvent(0.0, 0, np.nan, 5.0))
        assert heard == []
        renderer.touch(0.0, 5.0, 5.0)
        renderer.touch(0.005, 5.1, 5.0)
    assert len(heard) == 1


def test_a_layout_by_another_renderer_starts_settled(surface):
    layout = Layout()
    region = layout.add(LEVEL, 0, 0, 500, 50)
    for _ in range(2):
        with playing(surface, layout) as renderer:
            slide(renderer, 0.05)
            region.move(x_mm=region.x_mm - 1, over_s=10.0)
            slide(renderer, 0.1, 0.05)
        assert at(renderer, 0.003) == pytest.approx(at(renderer, 0.09), rel=1e-6)


def test_the_finger_with_priority_gets_the_electrode(surface):
    layout = Layout()
    layout.add(Grating(period_mm=1e6, low=0.9, high=0.90001), 0, 0, 100, 10)
    layout.add(Grating(period_mm=1e6, low=0.2, high=0.20001), 0, 20, 100, 10, priority=1)
    volts = []
    for both in (False, True):
        with playing(surface, layout) as renderer:
            for i in range(20):
                renderer.touch(0.005 * i, 5 + i / 2, 25.0, 0.5, touch_id=1)
                if both:
                    renderer.touch(0.005 * i, 5 + i / 2, 5.0, 0.5, touch_id=0)
        volts.append(renderer.played.amplitude_v[-1])
    assert volts[0] == pytest.approx(volts[1], rel=1e-3)


def test_a_value_is_set_while_a_finger_is_on_its_control(surface):
    """What the finger crosses is told by its own way; what the app sets is not."""
    layout = Layout()
    region = layout.add(Slider(travel_mm=40.0, detents=5), 0.0, 0.0, 80.0, 20.0)
    told = []
    with playing(surface, layout, LiveSettings()) as renderer:
        renderer.on("detent", told.append)
        for i in range(20):
            renderer.touch(0.01 * i, 1 + i, 5.0, 0.5)
        assert [event.detent for event in told] == [1.0, 2.0]
        assert region.value == 0.5
        region.set_value(0.0)
        for i in range(20, 25):
            renderer.touch(0.01 * i, 1 + i, 5.0, 0.5)
        # Detent 0 was at 20 mm, so that the next ridge is at 25.
        assert [event.detent for event in told] == [1.0, 2.0]
        for i in range(25, 27):
            renderer.touch(0.01 * i, 1 + i, 5.0, 0.5)
        assert [event.detent for event in told] == [1.0, 2.0, 1.0]
