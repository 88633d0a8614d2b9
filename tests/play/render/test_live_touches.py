"""Touches that are not as they should be, in live rendering."""

import numpy as np
import pytest

from haptix import InputError
from haptix.play.render import LiveSettings
from haptix.play.touch import ForceModel, TouchEvent, TouchSettings
from tests.live_strokes import FULL, HALF, RATE, Ruler, SteppedRenderer, render, row_times, stroke


def test_touches_out_of_order_are_put_in_order(surface):
    events = stroke(0.3)
    mixed = list(events)
    mixed[10], mixed[11] = mixed[11], mixed[10]
    with SteppedRenderer(surface, Ruler()) as renderer:
        for event, arrival in zip(mixed, (e.t_s + 0.01 for e in events), strict=True):
            renderer.event(event, arrival)
    assert renderer.touch_counts.reordered == 1
    assert renderer.touch_counts.taken == len(events)
    _, straight = render(surface, Ruler(), events, latency_s=0.01)
    late = np.interp(0.28, row_times(renderer), Ruler().place_mm(renderer))
    assert late == pytest.approx(
        np.interp(0.28, row_times(straight), Ruler().place_mm(straight)), abs=1e-3
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
    with SteppedRenderer(surface, Ruler()) as renderer:
        for event in events[:20]:
            renderer.event(event)
        with pytest.raises(InputError, match="touch") as caught:
            renderer.event(bad)
        assert "\n" not in str(caught.value)
        for event in events[20:]:
            renderer.event(event)
    clean, _ = render(surface, Ruler(), events)
    np.testing.assert_array_equal(renderer.device.mock.played_codes, clean.mock.played_codes)


@pytest.mark.parametrize("name", BAD)
def test_a_bad_touch_is_dropped_and_counted_if_not_strict(surface, name):
    events = stroke(0.4)
    _, renderer = render(surface, Ruler(), [*events[:20], BAD[name], *events[20:]], strict=False)
    count = {"infinite time": "from_the_future", "backwards": "stale"}.get(name, "invalid")
    assert getattr(renderer.touch_counts, count) == 1
    clean, _ = render(surface, Ruler(), events)
    np.testing.assert_array_equal(renderer.device.mock.played_codes, clean.mock.played_codes)


@pytest.mark.parametrize("name", BAD_FORCE)
def test_a_bad_force_is_not_used_if_not_strict_but_its_place_is(surface, name):
    events = stroke(0.4)
    mixed = [*events[:20], BAD_FORCE[name], *events[21:]]
    _, renderer = render(surface, Ruler(), mixed, strict=False)
    assert renderer.touch_counts.bad_force == 1
    assert renderer.touch_counts.taken == len(events)
    # The touch says 25 mm at 0.2 s, as the stroke does, and the force before holds on.
    clean, _ = render(surface, Ruler(), events)
    np.testing.assert_array_equal(renderer.device.mock.played_codes, clean.mock.played_codes)


@pytest.mark.parametrize("strict", [True, False])
def test_a_clock_that_was_set_back(surface, strict):
    events = stroke(0.4)
    back = [event._replace(t_s=event.t_s - 100.0) for event in events[20:]]
    raised = 0
    with SteppedRenderer(surface, FULL, settings=LiveSettings(strict=strict)) as renderer:
        for event in events[:20] + back:
            try:
                renderer.event(event)
            except InputError:
                raised += 1
    # The renderer's own clock says that they are old.
    assert (raised, renderer.touch_counts.stale) == (20 if strict else 0, 20)
    assert renderer.device.mock.played_codes[-1] == 0
    assert renderer.device.mock.samples_played < 0.5 * RATE


def test_a_flood_of_touches(surface):
    # 10 kHz: reports closer than least_interval_s replace each other, and none is lost.
    events = stroke(0.3, rate_hz=10_000.0)
    _, renderer = render(surface, Ruler(), events)
    counts = renderer.touch_counts
    assert counts.taken == len(events)
    assert counts.coalesced > 0.8 * len(events)
    t = row_times(renderer)
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
