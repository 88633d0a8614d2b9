"""Layouts: what is felt where, and how it comes, moves and goes."""

import threading
from math import cos, nan, radians, sin
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptix import InputError, Layout, Screen, Texture
from haptix.feel.layout import ScreenGeometry, region_state, regions
from haptix.feel.layout.regions import FADE_S, GLIDE_S
from haptix.feel.materials import Button, Grating, Toggle, load, material_of
from haptix.feel.materials.field import Evaluator
from haptix.feel.materials.pyramid import Pyramid
from haptix.feel.motion import Depends, Facts, Motion, Report
from tests.hand_clock import HandClock

STRIPES = Grating(period_mm=4.0, low=0.2, high=0.8)
HALF = Texture(np.full((4, 4), 0.5), width_mm=20.0)


class Level:
    """A material that answers one number, of a kind."""

    drives_at_rest = False
    depends_on = Depends.PLACE
    outside = 0.0

    def __init__(self, level, target="share"):
        self.level, self.target = level, target
        self.asked = []

    @property
    def evaluator(self) -> Evaluator:
        return self

    def wanted(self, motion):
        self.asked.append(motion)
        return np.full(motion.x_mm.shape, self.level)

    def react(self, facts, before, now):
        if now.normal_force_n and now.normal_force_n > 1:
            return facts._replace(press_s=now.t_s)
        return facts


def at(layout, x, y=5.0, t_s=100.0, footprint_mm=0.0):
    x = np.atleast_1d(np.asarray(x, dtype=float))
    return layout.wanted(Motion.of(x, np.full(x.shape, y), t_s, footprint_mm=footprint_mm))


def test_a_changed_region_stays_below_those_that_came_after_it():
    layout = Layout()
    low, high = (layout.add(Level(level), 0, 0, 20, 10) for level in (0.2, 0.8))
    assert at(layout, 5.0)[0] == 0.8
    low.change(material=Level(0.3))
    assert at(layout, 5.0)[0] == 0.8
    high.remove()
    assert at(layout, 5.0)[0] == 0.3
    low.change(z=1.0)
    layout.add(Level(0.9), 0, 0, 20, 10)
    assert at(layout, 5.0)[0] == 0.3


@given(st.floats(-180, 180), st.floats(0.3, 3), st.floats(-20, 60), st.floats(-20, 60))
def test_a_turned_and_scaled_region(angle_deg, scale, x, y):
    layout = Layout()
    layout.add(Level(1.0), 10, 5, 20, 10, rotation_deg=angle_deg, scale=scale)
    # Turned back about the middle, it is a rectangle.
    c, s = cos(radians(angle_deg)), sin(radians(angle_deg))
    dx, dy = x - 10 - 10 * scale, y - 5 - 5 * scale
    right, down = dx * c + dy * s, dy * c - dx * s
    depth = min(10 * scale - abs(right), 5 * scale - abs(down))
    if abs(depth) > 1e-6:
        assert at(layout, x, y)[0] == (depth > 0)


def test_a_polygon_with_a_dent():
    layout = Layout()
    layout.add(Level(1.0), 0, 0, 10, 10, shape=[(0, 0), (10, 0), (10, 10), (5, 4), (0, 10)])
    np.testing.assert_array_equal(at(layout, [1, 5, 9, 11], 8.0), [1, 0, 1, 0])
    np.testing.assert_array_equal(at(layout, [1, 5, 9], 3.0), [1, 1, 1])


def test_a_mask_is_opacity():
    ramp = Texture(np.linspace(0, 1, 101)[None, :], width_mm=101.0)
    layout = Layout(0.25)
    layout.add(Level(1.0), 0, 0, 101, 20, mask=ramp)
    np.testing.assert_allclose(at(layout, [0.5, 50.5, 100.5]), [0.25, 0.625, 1.0], atol=1e-9)


@given(st.floats(0, 0.04), st.floats(-50, 50), st.floats(0.001, 0.05))
def test_a_move_is_a_line_in_time(t_s, by_mm, over_s):
    clock = HandClock(1.0)
    layout = Layout()
    layout.attach(clock)
    material = Level(0.5)
    region = layout.add(material, 0, 0, 1000, 1000)
    clock.now_s = 2.0
    region.move(x_mm=by_mm, over_s=over_s)
    assert region.x_mm == by_mm
    motion = Motion.of([500.0, 500.0], 500.0, [2 + t_s, 2 + t_s + 1e-9], 10.0, 0.0)
    layout.wanted(motion)
    on = material.asked[-1]
    part = min(t_s / over_s, 1.0)
    assert on.x_mm[0] == pytest.approx(500 - part * by_mm, abs=1e-5)
    if part < 0.999 and t_s > 1e-6:
        assert on.vx_mm_s[0] == pytest.approx(10 - by_mm / over_s, rel=1e-6)


def test_a_scale_glides_as_the_places_it_gives():
    """Velocities in the region's axes are the rates of the places there."""
    clock = HandClock(1.0)
    layout = Layout()
    layout.attach(clock)
    material = Level(0.5)
    region = layout.add(material, 5, 7, 500, 500, rotation_deg=10)
    clock.now_s = 2.0
    region.move(x_mm=9, rotation_deg=40, scale=1.5, over_s=0.02)
    assert (region.scale, region.width_mm) == (1.5, 750)
    t = 2.0 + np.linspace(0.001, 0.019, 2001)
    layout.wanted(Motion.of(300 + 80 * (t - 2), 200 - 30 * (t - 2), t, 80.0, -30.0))
    on = material.asked[-1]
    for place, rate in ((on.x_mm, on.vx_mm_s), (on.y_mm, on.vy_mm_s)):
        np.testing.assert_allclose(np.gradient(place, t)[1:-1], rate[1:-1], rtol=1e-4, atol=0.02)
    at(layout, 300, 200, 2.1)
    there = material.asked[-1]
    half = 750 / 2  # turned about the middle
    right, down = 300 - 9 - half, 200 - 7 - half
    c, s = cos(radians(40)), sin(radians(40))
    assert there.x_mm[0] == pytest.approx((half + right * c + down * s) / 1.5)
    assert there.y_mm[0] == pytest.approx((half + down * c - right * s) / 1.5)


def test_a_change_is_told_once_when_it_is_whole():
    told = []
    layout = Layout()
    layout.attach(HandClock(1.0), lambda: told.append(len(layout.store.shown.regions)))
    with layout.change():
        one = layout.add(Level(1.0), 0, 0, 10, 10)
        layout.add(Level(1.0), 0, 0, 10, 10)
        one.move(x_mm=3)
    one.move(x_mm=5)
    assert told == [2, 2]
    with pytest.raises(InputError):
        one.move(x_mm="3 px")
    assert told == [2, 2]


def test_a_new_move_begins_where_the_old_one_is():
    clock = HandClock(1.0)
    layout = Layout()
    layout.attach(clock)
    material = Level(0.5)
    region = layout.add(material, 0, 0, 1000, 1000)
    clock.now_s = 2.0
    region.move(x_mm=10)
    clock.now_s += GLIDE_S / 2
    region.move(x_mm=-10)
    at(layout, 500, 500, clock.now_s)
    assert material.asked[-1].x_mm[0] == pytest.approx(495)
    at(layout, 500, 500, clock.now_s + GLIDE_S)
    assert material.asked[-1].x_mm[0] == pytest.approx(510)


def test_all_that_changes_fades():
    clock = HandClock(1.0)
    layout = Layout(0.2)
    layout.attach(clock)
    t = 1.0 + np.linspace(0, 2 * FADE_S, 101)
    part = np.clip((t - 1.0) / FADE_S, 0, 1)

    def felt():
        return layout.wanted(Motion.of(np.full(t.shape, 5.0), 5.0, clock.now_s - 1 + t))

    region = layout.add(Level(0.8), 0, 0, 10, 10)
    np.testing.assert_allclose(felt(), 0.2 + 0.6 * part, atol=1e-9)
    clock.now_s = 2.0
    region.change(material=Level(0.4))
    np.testing.assert_allclose(felt(), 0.8 - 0.4 * part, atol=1e-9)
    clock.now_s = 3.0
    region.change(opacity=0.5)
    np.testing.assert_allclose(felt()[[0, -1]], [0.4, 0.3], atol=1e-9)
    assert np.abs(np.diff(felt())).max() < 0.05
    clock.now_s = 4.0
    region.remove()
    assert not region.is_there
    np.testing.assert_allclose(felt(), 0.3 - 0.1 * part, atol=1e-9)
    clock.now_s = 5.0
    layout.add(Level(0.8), 50, 50, 10, 10)
    assert len(layout.store.shown.regions) == 1  # what has gone is forgotten
    region.remove()
    with pytest.raises(InputError, match="removed"):
        region.move(x_mm=3)


def test_targets_are_mixed_by_what_can_be_reached():
    def reach(force, speed):
        return np.full(force.shape, 0.3), np.full(force.shape, 0.7)

    asked = Motion.of([5.0], 5.0, 9.0, reachable=reach)
    for target, own in (("share", 0.25), ("mu", 0.4), ("contrast", 1 / 3)):
        for kind, level in (("share", 0.25), ("mu", 0.4), ("contrast", 1 / 3)):
            layout = Layout(target=target)
            layout.add(Level(level, kind), 0, 0, 10, 10)
            assert layout.wanted(asked)[0] == pytest.approx(own)


def test_changes_together_come_together_or_not_at_all():
    layout = Layout()
    one = layout.add(Level(1.0), 0, 0, 10, 10)
    with layout.change():
        one.move(x_mm=20)
        layout.add(Level(0.5), 0, 0, 10, 10)
        assert at(layout, 5.0)[0] == 1.0
    np.testing.assert_array_equal(at(layout, [5.0, 25.0]), [0.5, 1.0])
    with pytest.raises(InputError, match="blend"), layout.change():
        one.move(x_mm=70)
        layout.add(Level(0.5), 0, 0, 10, 10, blend="under")
    assert one.x_mm == 20
    np.testing.assert_array_equal(at(layout, [5.0, 25.0]), [0.5, 1.0])


def test_any_thread_may_change_it_while_another_asks():
    layout = Layout()
    pair = [layout.add(Level(1.0), 0, 0, 10, 10), layout.add(Level(1.0), 20, 0, 10, 10)]
    stop, wrong = threading.Event(), []

    def ask():
        while not stop.is_set():
            left, right = at(layout, [5.0, 25.0])
            if left + right != 2.0:
                wrong.append((left, right))

    thread = threading.Thread(target=ask)
    thread.start()
    for i in range(300):
        with layout.change():  # they change places
            for k, region in enumerate(pair):
                region.move(x_mm=20 * ((i + k) % 2), over_s=0)
    stop.set()
    thread.join()
    assert not wrong


@pytest.mark.parametrize("seed", range(3))
def test_many_regions_answer_as_if_each_were_asked(monkeypatch, seed):
    def made():
        rng, clock = np.random.default_rng(seed), HandClock(0.0)
        layout = Layout(0.1)
        layout.attach(clock)
        regions = [
            layout.add(
                Level(rng.random()), *rng.uniform(0, 100, 2), *rng.uniform(5, 20, 2),
                rotation_deg=rng.choice([0.0, 30.0]), z=int(rng.integers(3)),
                blend=rng.choice(["over", "over", "max", "multiply"]), opacity=rng.uniform(0.3, 1),
                shape=rng.choice(["rectangle", "ellipse"]), priority=int(rng.integers(3)),
            )
            for _ in range(25)
        ]  # fmt: skip
        clock.now_s = 1.0
        for region in regions[:15]:
            x, y = rng.uniform(0, 100, 2)
            region.move(x, y, over_s=0.05)
        regions[3].remove()
        regions[4].change(material=Level(0.9))
        regions[4].move(x_mm=50)
        with layout.change():
            regions[5].move(x_mm=20)
            regions[6].remove()
            regions[7].move(y_mm=20)
        return layout

    def answers(layout):
        rng, facts = np.random.default_rng(seed + 10), Facts()
        for k in range(20):
            x, y = rng.uniform(0, 110, 2)
            t_s = 1.0 + 0.006 * k
            path = x + 0.05 * np.arange(12.0)
            motion = Motion.of(path, y, t_s + 1e-4 * np.arange(12), 50.0, footprint_mm=0.05)
            yield layout.wanted(motion), layout.priorities(motion)
            now = Report(t_s, x, y, 2.0)
            facts = layout.react(facts, None, now)
            yield layout.under(now), facts, facts.of

    many = list(answers(made()))
    monkeypatch.setattr(regions, "LOOPED", 100)
    for found, wanted in zip(many, answers(made()), strict=True):
        for a, b in zip(found, wanted, strict=True):
            np.testing.assert_equal(a, b)


@pytest.mark.parametrize(
    ("button", "presses_at"),
    [
        (Button(), {(50.0, 10.0): True, (8.0, 18.5): False}),  # its rim is that of the region
        (Button(width_mm=20.0), {(50.0, 10.0): False, (10.0, 15.0): True}),
    ],
)
def test_a_button_without_a_size_of_its_own_fills_its_region(button, presses_at):
    layout = Layout()
    region = layout.add(button, x_mm=5.0, y_mm=5.0, width_mm=60.0, height_mm=20.0)
    for (x_mm, y_mm), is_pressed in presses_at.items():
        x_mm, y_mm = x_mm + 5.0, y_mm + 5.0
        facts = layout.react(Facts(down_s=0.0), None, Report(0.0, x_mm, y_mm, 0.1))
        facts = layout.react(facts, Report(0.0, x_mm, y_mm, 0.1), Report(0.1, x_mm, y_mm, 2.0))
        assert (not np.isnan(facts.press_s)) == is_pressed
    region.change(width_mm=30.0)
    report = Report(0.2, 33.0, 15.0, 2.0)  # 28 mm in the region, where its rim begins
    is_pressed = not np.isnan(layout.react(Facts(down_s=0.2), None, report).press_s)
    assert is_pressed == (button.width_mm == 16.0)


def test_a_toggle_goes_over_in_the_middle_of_its_region():
    layout = Layout()
    layout.add(Toggle(), x_mm=0.0, y_mm=0.0, width_mm=60.0, height_mm=20.0)
    layout.add(Toggle(), x_mm=0.0, y_mm=40.0, width_mm=8.0, height_mm=4.0)  # shorter than its throw
    x = np.array([24.0, 29.9, 30.4, 36.0])
    felt = layout.wanted(Motion.of(x, 10.0, vx_mm_s=50.0))
    assert felt.argmax() == 1 and felt[2] < 0.1


def test_fingers_far_apart_ask_no_regions_between_them(monkeypatch):
    """A box around all fingers meets most of a board, and each region asked costs time."""
    layout, asked = Layout(), []
    for i in range(256):
        place = {"x_mm": i % 16 * 12.0, "y_mm": i // 16 * 8.0}
        layout.add(Grating(period_mm=2.0), width_mm=11.0, height_mm=7.0, **place)
    cover = region_state.RegionState.cover

    def counted(region, *arguments):
        asked.append(region)
        return cover(region, *arguments)

    monkeypatch.setattr(region_state.RegionState, "cover", counted)
    path = np.linspace(0.0, 0.5, 8)
    places = [(5.0, 10.0), (180.0, 120.0), (90.0, 3.0), (20.0, 100.0)]
    x, y = (np.concatenate([one[axis] + path * (axis == 0) for one in places]) for axis in (0, 1))
    together = layout.wanted(Motion(4, 8, x, y, np.ones(32), 0.1, 1e-3))
    assert len(asked) == 4
    alone = [
        layout.wanted(Motion(1, 8, x[at : at + 8], y[at : at + 8], np.ones(8), 0.1, 1e-3))
        for at in range(0, 32, 8)
    ]
    np.testing.assert_array_equal(together, np.concatenate(alone))


def test_facts_are_those_of_the_region():
    layout = Layout()
    pad, field = Level(0.5), Level(0.4)
    for one in (pad, field):
        one.depends_on = Depends.PLACE | Depends.FACTS
    layout.add(field, 0, 0, 100, 100)
    layout.add(pad, 10, 10, 10, 10, opacity=0.5)
    reports = [Report(1.0, 5, 15, 0.5), Report(1.1, 15, 15, 0.5), Report(1.2, 16, 15, 2.0)]
    facts: Any = Facts(down_s=1.0)
    before, history = None, []
    for now in reports:
        facts = layout.react(facts, before, now)
        history.append((now.t_s, facts))
        before = now
    assert facts[:2] == (1.1, 1.2)
    motion = Motion.of([16.0], 15.0, 1.3, history=tuple(history))
    layout.wanted(motion)
    assert field.asked[-1].facts.down_s == 1.0 and pad.asked[-1].facts.down_s == 1.1
    assert pad.asked[-1].facts.press_s == 1.2
    later = facts._replace(press_s=1.25)  # the first time that could still be rendered
    assert {one.press_s for one in later.of.values()} == {1.25}
    gone: Any = layout.react(facts, before, Report(1.4, 50, 50, 0.5))
    assert len(gone.of) == 1 and gone.press_s == 1.2


def test_what_is_not_felt_at_rest_fades_there_beside_what_is():
    layout = Layout(background=0.3)
    layout.add(Level(0.8), 0, 0, 10, 10)
    button = Level(0.6)
    button.drives_at_rest = True
    assert not layout.drives_at_rest
    layout.add(button, 20, 0, 10, 10)
    assert layout.drives_at_rest
    np.testing.assert_array_equal(at(layout, [5.0, 25.0, 40.0]), [0.0, 0.6, 0.0])
    for vx, left in ((1.0, np.sqrt(2 / 5)), (2.0, 1.0), (8.0, 1.0), (-100.0, 1.0)):
        found = layout.wanted(Motion.of([5.0, 25.0, 40.0], 5.0, 0.0, vx))
        np.testing.assert_allclose(found, [left * 0.8, 0.6, left * 0.3])


def test_fingers_on_the_region_of_the_highest_priority():
    layout = Layout()
    layout.add(Level(0.8), 0, 0, 10, 10)
    motion = Motion.of([5.0, 25.0, 60.0], 5.0)
    assert layout.priorities(motion) is None
    layout.add(Level(0.8), 20, 0, 10, 10, priority=3)
    np.testing.assert_array_equal(layout.priorities(motion), [0, 3, 0])


def test_places_that_are_none():
    layout = Layout(0.3)
    layout.add(Level(1.0), 0, 0, 10, 10)
    np.testing.assert_array_equal(at(layout, [nan, 5, np.inf, 1e9]), [0.3, 1, 0.3, 0.3])
    assert at(layout, []).size == 0


def test_a_texture_that_is_added_again_is_not_made_again(monkeypatch):
    made = []
    begin = Pyramid.__init__
    monkeypatch.setattr(Pyramid, "__init__", lambda *of: [made.append(1), begin(*of)][1])
    layout = Layout()
    layout.add(Texture(np.full((4, 4), 0.5), width_mm=20.0))
    assert len(made) == 1  # held beyond its edges, and not the other one as well
    layout = Layout()
    regions = [layout.add(HALF) for _ in range(3)]
    assert len({id(one.evaluator) for one in layout.store.shown.regions}) == 1
    for region in regions:
        region.move(x_mm=3)
    assert len({id(one.evaluator) for one in layout.store.shown.regions}) == 1


@pytest.mark.parametrize("turn", [0, 90, 180, 270])
@given(st.floats(-100, 2000), st.floats(-100, 2000))
def test_pixels_there_and_back(turn, x, y):
    screen = ScreenGeometry(1920, 1080, 344.0, 194.0, 2.0, 3.0, turn)
    assert screen.pixels(*screen.mm(x, y)) == pytest.approx((x, y), abs=1e-6)
    corners = {0: (0, 0), 90: (1, 0), 180: (1, 1), 270: (0, 1)}  # of the picture's first pixel
    right, down = corners[turn]
    assert screen.mm(0, 0) == pytest.approx((2 + right * 344, 3 + down * 194))
    assert ScreenGeometry.of_dpi(254, 127, 254).mm(254, 127) == pytest.approx((25.4, 12.7))


def test_the_size_of_a_screen_is_in_its_profile(tmp_path):
    plain = Screen.preset("3m-sct3250")
    sized = plain.replace(width_mm=344.0, height_mm=194.0)
    sized.save(tmp_path / "screen.toml")
    screen = ScreenGeometry.on(Screen.load(tmp_path / "screen.toml"), 1920, 1080)
    assert screen.mm(960, 540) == pytest.approx((172, 97))
    assert "width_mm" not in plain.model_dump()  # so that hashes of earlier profiles hold
    with pytest.raises(InputError, match="width_mm"):
        ScreenGeometry.on(plain, 1920, 1080)


def test_a_region_s_group_is_kept_and_changes_nothing_that_is_felt(tmp_path):
    region = {"material": {"kind": "grating", "period_mm": 2.0}, "width_mm": 20, "height_mm": 9}
    layouts = [
        material_of({"kind": "layout", "regions": [region | more]}) for more in ({}, {"group": "g"})
    ]
    plain, grouped = layouts
    for layout in layouts:
        layout.save(tmp_path / "layout.json")
        assert load(tmp_path / "layout.json") == layout
        assert ("group" in (tmp_path / "layout.json").read_text()) == (layout is grouped)
    motion = Motion.of(np.linspace(0, 25, 100), 4.0)
    np.testing.assert_array_equal(plain.wanted(motion), grouped.wanted(motion))


BAD = {
    "a path": (lambda g: g.add("brick.png"), "material: .*brick.png"),
    "no size": (lambda g: g.add(STRIPES), "width_mm"),
    "no width": (lambda g: g.add(STRIPES, 0, 0, 0, 5), "width_mm"),
    "a place": (lambda g: g.add(HALF, "left"), "x_mm"),
    "a blend": (lambda g: g.add(HALF, blend="under"), "blend"),
    "a factor": (lambda g: g.add(Level(1.0, "mu"), 0, 0, 5, 5, blend="multiply"), "multiplies"),
    "opacity": (lambda g: g.add(HALF, opacity=2), "opacity"),
    "scale": (lambda g: g.add(HALF, scale=0), "scale"),
    "shape": (lambda g: g.add(HALF, shape="star"), "shape"),
    "corners": (lambda g: g.add(HALF, shape=[(0, 0), (1, 1)]), "3 corners"),
    "mask": (lambda g: g.add(HALF, mask=np.ones((3, 3))), "mask"),
    "priority": (lambda g: g.add(HALF, priority="high"), "priority"),
    "group": (lambda g: g.add(HALF, group=""), "group"),
    "a group that no file takes": (lambda g: g.add(HALF, group="\0"), "group"),
    "move": (lambda g: g.add(HALF).move(x_mm="5 mm"), "x_mm"),
    "over": (lambda g: g.add(HALF).move(x_mm=5, over_s=-1), "over_s"),
    "change": (lambda g: g.add(HALF).change(colour=3), "colour"),
    "target": (lambda g: Layout(target="friction"), "target"),
    "background": (lambda g: Layout(background="grey"), "background"),
    "dpi": (lambda g: ScreenGeometry.of_dpi(100, 100, 0), "dpi"),
    "turn": (lambda g: ScreenGeometry(100, 100, 10, 10, 0, 0, 45), "rotation_deg"),
}


@pytest.mark.parametrize("name", BAD)
def test_what_cannot_be(name):
    call, words = BAD[name]
    with pytest.raises(InputError, match=words):
        call(Layout())
