"""The engine of programs of a touch against the renderer of the host, on the same motions."""

import re
import shutil
import subprocess
import zlib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.ndimage import correlate1d

import haptix
from haptix.base import native
from haptix.feel.gallery import presets
from haptix.feel.materials import (
    Button,
    ByForce,
    BySpeed,
    Dial,
    Envelope,
    Grating,
    Moving,
    Noise,
    Relief,
    Slider,
    Spectral,
    Texture,
    Toggle,
    Transient,
    WebEffect,
)
from haptix.feel.materials.pyramid import Pyramid
from haptix.feel.materials.relief import Slopes
from haptix.feel.motion import Motion
from haptix.play import Fingers, LiveSettings, RenderCore, SineCarrier, compile_touch
from haptix.play.render.fingers import PredictedFingers
from haptix.play.touch import OneEuroFilter, TouchEvent, TouchSettings
from tests.play.render.conftest import CARRIER_HZ
from tests.play.render.engines import Engine, Refused
from tests.play.render.test_program import everything

CODE_V = 200.0 / 2**15
"""A step of the driver's output of 16 bits."""

SINGLE = 1e-6  # of the friction: what the rounding of a map to single precision may change

RANDOM = np.random.default_rng(5)
# Numbers that single precision holds, so that both sides have the same map.
LEVEL = RANDOM.random((12, 20)).astype(np.float32).astype(float)
SHAPES = ("rectangle", "ellipse", ((1.0, 0.5), (9.0, 2.0), (4.0, 3.0), (6.0, 8.0)))


COIN = next(preset.document["heights"] for preset in presets() if preset.name == "coin")
SLOPES = Slopes(
    Pyramid((RANDOM.normal(0, 0.6, (2, 9, 12)).astype(np.float32).T @ [1, 1j]).T, 1.0, 0.0),
    12.0,
    9.0,
)
KINDS_BESIDE_PLACES = {
    "slider", "toggle", "dial", "relief", "by-speed", "by-force", "envelope", "moving",
}  # fmt: skip


@pytest.fixture(scope="module")
def device():
    with haptix.open_device("mock:") as opened:
        yield opened


def targets(draw):
    """A target with its ends."""
    return draw(st.sampled_from([("share", 0.0, 1.0), ("mu", 0.2, 0.45), ("contrast", 0.0, 0.5)]))


def material(draw):
    target, low, high = targets(draw)
    if draw(st.booleans()):
        beyond = draw(st.sampled_from(["outside", "hold"]))
        # A range other than 0 to 1 would round each number of the map.
        return Texture(LEVEL, draw(st.sampled_from([2.0, 10.0, 19.0])), beyond=beyond)
    if draw(st.booleans()):
        return other_kind(draw)
    return Grating(
        period_mm=draw(st.floats(0.3, 12.0)),
        wave=draw(st.sampled_from(["sine", "square", "sawtooth"])),
        orientation_deg=draw(st.sampled_from([0.0, 33.0, 90.0, -120.0])),
        duty=draw(st.floats(0.1, 0.9)),
        phase=draw(st.floats(-3.0, 3.0)),
        target=target,
        low=low,
        high=high,
    )


def curve(draw):
    return {
        "kind": "points",
        "t_s": [0.0, *sorted(draw(st.sets(st.floats(1e-3, 0.2), min_size=3, max_size=3)))],
        "values_at": draw(st.lists(st.floats(0.0, 1.0), min_size=4, max_size=4)),
    }


def corners(draw, most):
    return tuple(sorted(draw(st.sets(st.floats(0.0, most), min_size=2, max_size=5))))


def other_kind(draw):
    """A control, a relief, or a material that changes another one."""
    target, low, high = targets(draw)
    levels = {"target": target, "low": low, "high": high}
    turn = draw(st.sampled_from([0.0, 33.0, -120.0]))
    kind = draw(st.sampled_from(sorted(KINDS_BESIDE_PLACES)))
    if kind == "slider":
        detents = draw(st.sampled_from([2, 5, (0.0, 4.0, 7.5, 19.0)]))
        return Slider(travel_mm=18.0, detents=detents, orientation_deg=turn, start_mm=1.0, **levels)
    if kind == "toggle":
        return Toggle(width_mm=draw(st.floats(4.0, 20.0)), throw_mm=2.0, **levels)
    if kind == "dial":
        centre = (draw(st.floats(0.0, 12.0)), 5.0)
        return Dial(detents=6, inner_mm=3.0, outer_mm=9.0, centre_mm=centre, **levels)
    if kind == "relief":
        felt = Relief(width_mm=12.0, heights=COIN, edge_mm=draw(st.sampled_from([0, 2])), **levels)
        felt.__dict__["slopes"] = SLOPES  # numbers that single precision holds
        return felt
    if kind in ("by-speed", "by-force"):
        at = corners(draw, 300.0 if kind == "by-speed" else 1.2)
        value = tuple(draw(st.lists(st.floats(0, 1), min_size=len(at), max_size=len(at))))
        of = {"of": material(draw)} if draw(st.booleans()) else {}
        if kind == "by-speed":
            return BySpeed(speed_mm_s=at, share=value, **of)
        return ByForce(normal_force_n=at, share=value, **of)
    if kind == "envelope":
        return Envelope(of=material(draw), curve=curve(draw), loop=draw(st.booleans()))
    path = {
        "t_s": [0.0, 0.004, 0.01], "x_mm": [0.0, 3.0, 1.0], "y_mm": [0.0, 0.0, -2.0],
        "angle_deg": [0.0, 30.0, 10.0], "loop": draw(st.booleans()),
    }  # fmt: skip
    return Moving(
        of=material(draw),
        velocity_mm_s=(draw(st.floats(-50.0, 50.0)), draw(st.floats(-50.0, 50.0))),
        turn_deg_s=draw(st.sampled_from([0.0, 40.0])),
        about_mm=(draw(st.sampled_from([0.0, 6.0])), 3.0),
        path=draw(st.sampled_from([None, path])),
    )


@st.composite
def layouts(draw):
    target = draw(st.sampled_from(["share", "mu", "contrast"]))
    below = material(draw) if draw(st.booleans()) else draw(st.floats(0.0, 0.5))
    layout = haptix.Layout(below, target)
    for _ in range(draw(st.integers(0, 4))):
        felt = material(draw)
        blends = ["over", "add", "max", "min"]
        if felt.evaluator.target == "share":
            blends.append("multiply")
        mask = Texture(LEVEL, 10.0) if draw(st.booleans()) else None
        layout.add(
            felt,
            draw(st.floats(-3.0, 12.0)),
            draw(st.floats(-3.0, 12.0)),
            draw(st.floats(1.0, 15.0)),
            draw(st.floats(1.0, 15.0)),
            rotation_deg=draw(st.sampled_from([0.0, 20.0, -75.0])),
            scale=draw(st.sampled_from([1.0, 0.5, 2.5])),
            shape=draw(st.sampled_from(SHAPES)),
            z=draw(st.sampled_from([0.0, 1.0, -1.0])),
            blend=draw(st.sampled_from(blends)),
            opacity=draw(st.sampled_from([1.0, 0.4])),
            priority=draw(st.sampled_from([0, 0, 2])),
            mask=mask,
        )
    return layout


def strokes(random, fingers, points, footprint_mm, start_s=0.0):
    """Straight strokes at a footprint, with forces inside and outside of the surface.

    A footprint of 0 stands for all detail, at any speed.
    """
    start = random.uniform(-4, 18, (fingers, 2))
    turn = random.uniform(0, 2 * np.pi, fingers)
    way = footprint_mm * np.arange(1, points + 1)
    x = start[:, :1] + np.cos(turn)[:, None] * way
    y = start[:, 1:] + np.sin(turn)[:, None] * way
    force = np.exp(random.uniform(np.log(0.15), np.log(1.3), (fingers, points)))
    speed = 12_000 * footprint_mm if footprint_mm else random.uniform(0.0, 250.0)
    vx, vy = (np.repeat(speed * part(turn), points) for part in (np.cos, np.sin))
    return Motion(
        fingers, points, x.ravel(), y.ravel(), force.ravel(), footprint_mm, 1 / 12_000, start_s,
        lambda: (vx, vy),
    )  # fmt: skip


def compare(core, engine, random, fingers, footprints, most=1e-9):
    """Play some blocks by both; the samples continue."""
    sample, before_v = 0, 0.0
    for footprint_mm in footprints:
        points = int(random.integers(1, 60))
        start_s = sample / core.sample_rate_hz
        motion = strokes(random, fingers, points, footprint_mm, start_s)
        gain = random.uniform(0, 1, fingers * points)
        host = core.block(Fingers(motion, gain), sample, before_v)
        ours = engine.play(motion, gain)
        assert ours.first_sample == sample
        np.testing.assert_allclose(ours.wanted_mu, host.target_mu, rtol=0, atol=most)
        felt = core.friction(
            motion.normal_force_n, 0.0 * motion.x_mm, np.tile(host.amplitude_v, fingers)
        )
        np.testing.assert_allclose(ours.felt_mu, felt, rtol=0, atol=most)
        np.testing.assert_allclose(ours.drive_v, host.drive_v, rtol=0, atol=CODE_V)
        if most == 1e-9:
            np.testing.assert_allclose(ours.drive_v, host.drive_v, rtol=0, atol=1e-6)
        sample += points * core.step
        before_v = float(host.amplitude_v[-1])


footprints = st.lists(
    st.one_of(st.just(0.0), st.floats(1e-4, 0.3), st.floats(0.3, 6.0)), min_size=1, max_size=4
)


anything = given(
    layout=layouts(),
    seed=st.integers(0, 10**6),
    fingers=st.integers(0, 4),
    footprints=footprints,
    combination=st.sampled_from(["strongest", "first", "mean"]),
    compress=st.sampled_from([None, (0.1, 0.6)]),
)


@settings(max_examples=50)
@anything
def test_the_engine_plays_what_the_renderer_plays(
    surface, device, layout, seed, fingers, footprints, combination, compress
):
    check_both(surface, device, layout, seed, fingers, footprints, combination, compress)


@pytest.mark.slow
@settings(max_examples=1000)
@anything
def test_a_thousand_layouts_are_played_the_same(
    surface, device, layout, seed, fingers, footprints, combination, compress
):
    check_both(surface, device, layout, seed, fingers, footprints, combination, compress)


def check_both(surface, device, layout, seed, fingers, footprints, combination, compress):
    how = LiveSettings(combination=combination, compress=compress)
    carrier = SineCarrier(CARRIER_HZ)
    core = RenderCore(surface, layout, device, carrier, how)
    engine = Engine(compile_touch(surface, layout, device, carrier, how))
    compare(core, engine, np.random.default_rng(seed), fingers, footprints)


@pytest.mark.parametrize("footprint_mm", [0.0, 0.01, 0.2])
@pytest.mark.parametrize(
    "felt",
    [
        Noise(pixels=64, tile_mm=16.0, seed=3, mean=0.4, deviation=0.1),
        Noise(pixels=64, tile_mm=16.0, grain="ribbed", orientation_deg=25.0, seed=3),
        Spectral(seed=2, orientation_deg=-40.0),
        Texture(LEVEL, 10.0, "mu", 0.2, 0.4),
        Texture(LEVEL, 40.0),  # whose pixels are split
    ],
    ids=["noise", "ribs", "spectral", "mu", "coarse"],
)
def test_maps_are_the_same_to_single_precision(surface, device, felt, footprint_mm):
    carrier = SineCarrier(CARRIER_HZ)
    core = RenderCore(surface, felt, device, carrier)
    engine = Engine(compile_touch(surface, felt, device, carrier))
    compare(core, engine, np.random.default_rng(1), 3, [footprint_mm] * 3, SINGLE)


@pytest.mark.parametrize("preset", presets(), ids=lambda preset: preset.name)
def test_the_gallery_is_the_same(surface, device, preset):
    carrier = SineCarrier(CARRIER_HZ)
    program = compile_touch(surface, preset.material, device, carrier)
    core = RenderCore(surface, preset.material, device, carrier)
    compare(core, Engine(program), np.random.default_rng(2), 2, [0.0, 0.004, 0.02, 0.2], SINGLE)


@pytest.mark.parametrize(
    ("x_mm", "y_mm"), [(np.nan, 1.0), (1.0, np.inf), (-2e6, 3.0), (1e300, -1e300)]
)
def test_a_place_that_is_none_is_outside(surface, device, x_mm, y_mm):
    layout = haptix.Layout(0.25)
    layout.add(Grating(period_mm=2.0), 0.0, 0.0, 30.0, 30.0)
    motion = Motion.of([5.0, x_mm, 6.0], [5.0, y_mm, 6.0], footprint_mm=0.01)
    core = RenderCore(surface, layout, device)
    played = Engine(compile_touch(surface, layout, device)).play(motion, np.ones(3))
    np.testing.assert_allclose(
        played.wanted_mu, core.block(Fingers(motion, np.ones(3)), 0).target_mu, atol=1e-12
    )
    assert np.isfinite(played.drive_v).all()


def weights(places_px, pixels, beyond, level):
    """Weight of each pixel of a line at places, by the definition of a level."""
    far = 700
    at = np.arange(-far, far)
    inside = (at >= 0) & (at < pixels) | (beyond != "outside")
    pixel = at % pixels if beyond == "repeat" else np.clip(at, 0, pixels - 1)
    line = np.eye(pixels)[pixel] * inside[:, None]
    step = 1
    for number in range(level):
        if number:
            line, at, step = line[at % 2 == 0], at[at % 2 == 0] // 2, 2 * step
        line = correlate1d(line, np.array([1, 8, 28, 56, 70, 56, 28, 8, 1]) / 256, axis=0)
    at_places = (places_px - 0.5) / step
    return np.array([np.interp(at_places, at, column) for column in line.T]).T


@settings(max_examples=12, deadline=None)
@given(
    rows=st.integers(1, 40),
    columns=st.integers(1, 40),
    beyond_x=st.sampled_from(["outside", "hold", "repeat"]),
    beyond_y=st.sampled_from(["outside", "hold", "repeat"]),
    seed=st.integers(0, 99),
)
def test_a_map_has_the_levels_that_are_described(rows, columns, beyond_x, beyond_y, seed):
    if beyond_x == "repeat":
        columns = 1 << (columns.bit_length() - 1)
    if beyond_y == "repeat":
        rows = 1 << (rows.bit_length() - 1)
    first, second = np.random.default_rng(seed).random((2, rows, columns))
    one = Pyramid(first, 0.5, 0.25, beyond_x, beyond_y)
    two = Pyramid(first + 1j * second, 0.5, 0.25, beyond_x, beyond_y)
    np.testing.assert_array_equal(one.values, first)
    x, y = np.random.default_rng(seed).uniform(-10, 30, (2, 20))
    count = one._map.fields["count"]

    def expected(values, outside, level):
        down, across = (
            weights(2 * y, rows, beyond_y, level),
            weights(2 * x, columns, beyond_x, level),
        )
        return outside + np.einsum("pi,ij,pj->p", down, values - outside, across)

    for depth in np.arange(0, count + 0.5, 0.5):
        footprint_mm = 0.5 * 2**depth if depth >= 1 else 0.5 * 2 ** (depth - 1)
        low, part = min(int(depth), count - 1), depth % 1
        high = min(low + 1, count - 1)
        wanted = [
            (1 - part) * expected(*of, low) + part * expected(*of, high)
            for of in ((first, 0.25), (second, 0.0))
        ]
        both = two.sample(x, y, footprint_mm)
        np.testing.assert_allclose(one.sample(x, y, footprint_mm), wanted[0], atol=1e-12)
        np.testing.assert_allclose([both.real, both.imag], wanted, atol=1e-12)


# Touches.


def followed(engine, points, reports, seconds):
    """Play a time in blocks of `points`, with the reports that have come before each block."""
    step_s = 1 / 12_000
    blocks, at, reports = [], 0.0, list(reports)
    while at < seconds:
        while reports and reports[0][1] <= at:
            assert engine.touch(*reports.pop(0)) == 1
        blocks.append(engine.block(points))
        at += points * step_s
    return blocks


def straight(t_s, speed_mm_s=80.0):
    return 5.0 + speed_mm_s * t_s, 8.0 + 0.5 * speed_mm_s * t_s


@pytest.fixture(scope="module")
def ribs(surface, device):
    return compile_touch(surface, Grating(period_mm=2.0), device, SineCarrier(CARRIER_HZ))


def reports_of(random, seconds, presses=False):
    """Reports of fingers on a panel: noise, silence, late, repeated and jumping ones, lifts.

    Each is its arrival, and the arguments of `Engine.touch`.
    """
    reports = []
    for finger in range(int(random.integers(1, 4))):
        rate_hz = random.choice([60.0, 125.0, 250.0, 1000.0])
        phase, turns, mm = random.uniform(0, 6, 2), random.uniform(1, 9, 2), random.uniform(0, 9, 2)
        noise_mm = random.choice([0.0, 0.05, 0.3])
        is_down, silent_until = True, 0.0
        for t_s in np.arange(random.uniform(0, 0.05), seconds, 1 / rate_hz):
            t_s += random.uniform(0, 2e-4)
            x, y = 12 + mm * np.sin(turns * t_s + phase) + random.normal(0, noise_mm, 2)
            chance = random.random()
            if t_s < silent_until or chance < 0.02:
                continue
            if chance < 0.03:
                silent_until = t_s + random.uniform(0, 0.15)
            if chance > 0.98:
                x += random.choice([-1, 1]) * random.uniform(4, 40)
            is_down = chance < 0.94 or chance > 0.955
            force_n = random.choice([0.0, random.uniform(0.2, 0.9)])
            if presses and random.random() < 0.95:
                force_n = 0.65 + 0.6 * np.sin(9 * t_s)
            late_s = random.choice([0.0, 0.0, 0.002, 0.012, 0.033])
            reports.append((t_s + late_s, (finger, t_s, x, y, force_n, is_down)))
            if chance > 0.97:
                reports.append(reports[-1])
    return sorted(reports, key=lambda report: report[0])


def compare_live(core, engine, random, seconds, presses=False):
    """Play the same reports by both, in blocks of many lengths; return how many had fingers."""
    fingers = PredictedFingers(core.settings)
    reports, sample, before_v, played = reports_of(random, seconds, presses), 0, 0.0, 0
    react = core.texture.evaluator.react
    while sample < seconds * core.sample_rate_hz:
        t0_s = sample / core.sample_rate_hz
        while reports and reports[0][0] <= t0_s:
            _, (touch_id, t_s, x, y, force_n, is_down) = reports.pop(0)
            event = TouchEvent(t_s, touch_id, x, y, "move" if is_down else "up", force_n or None)
            if is_down or touch_id in fingers.touches:
                # What it changes holds from the next sample on.
                arrival_s = t0_s - core.settings.reaction_s
                fingers.take(event, arrival_s if sample else None, react)
            engine.touch(touch_id, t_s, x, y, force_n, is_down)
        points = int(random.choice([12, 12, 30, 240]))
        fingers.update(t0_s)
        moved = fingers.motion(t0_s, core.step_s, points, t0_s, core.drives_at_rest)
        host = core.block(moved, sample, before_v)
        ours = engine.block(points)
        assert ours.fingers == moved.motion.fingers
        np.testing.assert_allclose(ours.x_mm, moved.motion.x_mm, rtol=0, atol=1e-8)
        np.testing.assert_allclose(ours.y_mm, moved.motion.y_mm, rtol=0, atol=1e-8)
        np.testing.assert_allclose(ours.force_n, moved.motion.normal_force_n, rtol=0, atol=1e-9)
        np.testing.assert_allclose(ours.wanted_mu, host.target_mu, rtol=0, atol=1e-8)
        np.testing.assert_allclose(ours.drive_v, host.drive_v, rtol=0, atol=CODE_V)
        sample, before_v = sample + points * core.step, float(host.amplitude_v[-1])
        played += ours.fingers > 0
    return played


@pytest.mark.parametrize("seed", range(6))
def test_reports_are_followed_as_the_host_follows_them(surface, device, seed):
    carrier = SineCarrier(CARRIER_HZ)
    touch = [TouchSettings(), TouchSettings(latency_s=0.02, turn_s=0.0, blend_s=0.01)][seed % 2]
    how = LiveSettings(touch=touch, strict=False)
    felt = Grating(period_mm=2.0)
    core = RenderCore(surface, felt, device, carrier, how)
    engine = Engine(compile_touch(surface, felt, device, carrier, how))
    assert compare_live(core, engine, np.random.default_rng(seed), 2.0) > 50


def events_of(random):
    """A layout of controls, buttons and effects that begin by what a finger did."""
    ribs = Grating(period_mm=2.0)
    pulse = {"kind": "pulse", "height": 1.0, "width_s": 0.02, "length_s": 0.03}
    layout = haptix.Layout(
        random.choice([0.1, WebEffect(name="tick", begins="detent"), Slider(), ribs]),
        random.choice(["share", "mu", "contrast"]),
    )
    for _ in range(int(random.integers(1, 5))):
        begins = random.choice(["start", "down", "press", "release", "detent"])
        of = random.choice([
            Button(press_n=0.6), Slider(travel_mm=18.0, detents=4), Toggle(width_mm=14.0),
            Dial(detents=6, inner_mm=3.0, outer_mm=9.0, centre_mm=(6.0, 5.0)), ribs,
        ])  # fmt: skip
        felt = random.choice([
            of, of, Envelope(of=of, curve=pulse, begins=begins),
            Transient(curve=pulse, begins=begins), WebEffect(name="edge", begins=begins),
            Moving(of=of, velocity_mm_s=(2.0, 1.0)), ByForce(normal_force_n=(0, 1), mu=(0.2, 0.4)),
        ])  # fmt: skip
        layout.add(
            felt, *random.uniform(-2, 12, 2), *random.uniform(5, 15, 2), opacity=0.8,
            shape=random.choice(["rectangle", "ellipse"]), rotation_deg=random.choice([0, 30]),
        )  # fmt: skip
    return random.choice([layout, layout, layout, felt])


def check_events(surface, device, seed, seconds):
    carrier, random = SineCarrier(CARRIER_HZ), np.random.default_rng(seed)
    how = LiveSettings(strict=False, reaction_s=1e-12)
    felt = events_of(random)
    core = RenderCore(surface, felt, device, carrier, how)
    engine = Engine(compile_touch(surface, felt, device, carrier, how))
    return compare_live(core, engine, random, seconds, presses=True)


def test_events_of_fingers_are_felt_as_the_host_plays_them(surface, device):
    assert sum(check_events(surface, device, seed, 1.0) for seed in range(10)) > 120


@pytest.mark.slow
def test_more_layouts_of_events_are_the_same_for_longer(surface, device):
    assert sum(check_events(surface, device, seed, 2.0) for seed in range(100, 140)) > 1000


def test_another_filter_is_named(surface, device):
    how = LiveSettings(touch=TouchSettings(filter=OneEuroFilter()))
    with pytest.raises(haptix.InputError, match="expected the filter InteractingSinger"):
        compile_touch(surface, Grating(period_mm=2.0), device, SineCarrier(CARRIER_HZ), how)


def test_a_finger_that_rests_or_lifts_gets_no_drive(ribs):
    moving = [(3, t, *straight(t), 0.6) for t in np.arange(0.0, 0.2, 0.01)]
    for last in ([], [(3, 0.2, *straight(0.2), 0.6, False)]):
        blocks = followed(Engine(ribs), 12, [*moving, *last], 0.4)
        volts = np.array([np.abs(block.drive_v).max() for block in blocks])
        assert volts[100:190].min() > 5.0
        # Some two intervals after the last report, and 5 ms in which the drive fades out.
        end = 200 + 5 + 2 if last else 190 + 38 + 5 + 2
        assert (volts[end:] == 0.0).all()
        assert blocks[-1].fingers == 0


def test_the_path_and_the_amplitude_do_not_jump(ribs):
    """A finger that turns is predicted wrongly; corrections are blended in."""
    times = np.arange(0.0, 0.6, 0.012)
    places = [(12 + 8 * np.sin(9 * t), 10 + 6 * np.cos(7 * t)) for t in times]
    reports = [(1, t, *place, 0.5) for t, place in zip(times, places, strict=True)]
    blocks = followed(Engine(ribs), 12, reports, 0.6)
    x = np.concatenate([block.x_mm for block in blocks if block.fingers == 1])
    assert np.abs(np.diff(x)).max() < 0.06  # 72 mm/s are 0.006 mm; a correction of 0.1 mm decays
    volts = np.concatenate([block.amplitude_v for block in blocks])
    assert np.abs(np.diff(volts)).max() <= 4e5 / 12_000 + 1e-9
    assert volts.max() > 20.0


def test_reports_that_cannot_be_are_dropped(ribs):
    engine = Engine(ribs)
    assert engine.touch(1, 0.0, 1.0, 1.0, 0.5) == 1
    for t_s, x_mm, y_mm in (
        (np.nan, 1.0, 1.0), (np.inf, 1.0, 1.0), (0.01, np.nan, 1.0), (0.01, 1.0, np.inf),
        (0.01, 2e4, 1.0), (-1.0, 1.0, 1.0),
    ):  # fmt: skip
        assert engine.touch(1, t_s, x_mm, y_mm, 0.5) == 0
    assert engine.touch(2, 0.01, 1.0, 1.0, 0.5, is_down=False) == 0  # it was never down
    fingers = [engine.touch(number, 0.01, 1.0, 1.0, 0.5) for number in range(2, 20)]
    assert fingers == [1] * 9 + [0] * 9  # ten at once
    for number, force_n in enumerate((np.nan, -1.0, 0.0, 1e9)):
        assert engine.touch(1, 0.02 + 0.001 * number, 2.0 + number, 1.0, force_n) == 1
    assert engine.block(24).force_n == pytest.approx(0.5)  # what is assumed


def test_two_fingers_share_the_electrode(surface, device):
    layout = haptix.Layout(0.0)
    layout.add(Grating(period_mm=2.0), 0.0, 0.0, 50.0, 10.0)
    layout.add(Grating(period_mm=3.0), 0.0, 20.0, 50.0, 10.0, priority=1)
    engine = Engine(compile_touch(surface, layout, device, SineCarrier(CARRIER_HZ)))
    times = np.arange(0.0, 0.3, 0.01)
    reports = [(k, t, 2 + 90 * t, 5 + 20 * k, 0.5) for t in times for k in (0, 1)]
    both = followed(engine, 12, reports, 0.3)[-40]
    assert both.fingers == 2
    alone = Engine(compile_touch(surface, layout, device, SineCarrier(CARRIER_HZ)))
    one = followed(alone, 12, [report for report in reports if report[0] == 1], 0.3)[-40]
    np.testing.assert_allclose(both.amplitude_v, one.amplitude_v, atol=1e-9)


# Damaged programs.


def test_damage_is_named(ribs):
    def refusal(program):
        with pytest.raises(Refused) as refused:
            Engine(program)
        return refused.value.args[0]

    assert refusal(b"") == refusal(b"PNG") == refusal(b"x" + ribs[1:]) == -1
    assert refusal(ribs[:-1]) == refusal(ribs + b"\0") == -1
    assert refusal(ribs[:8] + b"\1" + ribs[9:]) == -2
    assert refusal(ribs[:-1] + bytes([ribs[-1] ^ 1])) == -3
    assert refusal(with_bytes(ribs, 64, b"\xf8\xff\xff\xff")) == -4
    for number in (np.nan, np.inf, -1.0):
        assert refusal(with_bytes(ribs, 96, np.float64(number).tobytes())) == -4


def with_bytes(program, at, changed):
    """A program with some bytes changed, and the right checksum."""
    program = bytearray(program)
    program[at : at + len(changed)] = changed
    program[12:16] = zlib.crc32(program[16:]).to_bytes(4, "little")
    return bytes(program)


def test_a_map_that_would_need_too_much_memory_is_refused(surface, device):
    """Many materials may share one place of the file."""
    noise = Noise(pixels=512)
    program = compile_touch(surface, noise, device)
    grown = program[:-128] + 300 * program[-128:]
    grown = with_bytes(grown, 16, len(grown).to_bytes(4, "little"))
    with pytest.raises(Refused, match="-5"):
        Engine(with_bytes(grown, 52, (300).to_bytes(4, "little")))


NATIVE = Path(native.__file__).parent


@pytest.fixture(scope="module")
def mutations(tmp_path_factory):
    if shutil.which("cc") is None:
        pytest.skip("cc is missing")
    binary = tmp_path_factory.mktemp("engine") / "mutated_programs"
    sources = [Path(__file__).parent / "mutated_programs.c", *sorted(NATIVE.glob("*.c"))]
    flags = ["-std=c99", "-O1", "-g", "-fno-sanitize-recover=all", f"-I{NATIVE}"]
    flags.append("-fsanitize=address,undefined,float-cast-overflow")
    made = subprocess.run(
        ["cc", *flags, *map(str, sources), "-lm", "-o", str(binary)], capture_output=True, text=True
    )
    if "cannot find" in made.stderr and "san" in made.stderr:
        pytest.skip("the compiler has no sanitizers (on Debian: apt install libasan8 libubsan1)")
    assert made.returncode == 0, made.stderr
    return binary


def mutated(binary, program, count, folder):
    path = folder / "touch.hxp"
    path.write_bytes(program)
    done = subprocess.run(
        [str(binary), str(path), str(count), "1"], capture_output=True, text=True, timeout=600
    )
    assert done.returncode == 0, done.stdout + done.stderr
    refused, played = map(int, re.findall(r"\d+", done.stdout))
    assert refused + played == count
    return refused, played


def beside_places():
    """A layout of all kinds that depend on more than the place."""
    ribs = Grating(period_mm=2.0)
    relief = Relief(width_mm=12.0, heights=COIN)
    relief.__dict__["slopes"] = SLOPES
    path = {"t_s": [0.0, 0.1, 0.3], "x_mm": [0, 1, 2], "y_mm": [0, 1, 0], "loop": True}
    layout = haptix.Layout(Moving(of=Moving(of=ribs, turn_deg_s=9.0), path=path))
    pulse = {"kind": "pulse", "height": 1.0, "width_s": 0.01, "length_s": 0.02}
    for number, felt in enumerate(
        [
            Button(), WebEffect(name="tick"), Slider(), Toggle(), Dial(), relief,
            Envelope(of=ribs, curve=pulse, loop=True),
            BySpeed(speed_mm_s=(0.0, 10.0, 90.0), share=(0.2, 0.9, 0.3)),
            ByForce(normal_force_n=(0.1, 1.0), share=(0.3, 0.8), of=Moving(of=relief)),
        ]
    ):  # fmt: skip
        layout.add(felt, -3.0 + number, -3.0, 12.0, 12.0, blend="max")
    return layout


@pytest.mark.slow  # the compiler's sanitizers; test_damage_is_named needs none
def test_ten_thousand_damaged_programs_are_refused_or_played(mutations, surface, device, tmp_path):
    plain = compile_touch(surface, Grating(period_mm=2.0), device)
    refused, played = np.sum(
        [
            mutated(mutations, program, count, tmp_path)
            for program, count in (
                (compile_touch(surface, everything(), device), 3000),
                (compile_touch(surface, beside_places(), device), 5000),
                (plain, 2000),
            )
        ],
        axis=0,
    )
    assert refused > 4000
    assert played > 1000
