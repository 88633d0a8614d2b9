"""Windows of live touches rendered again: against the stream that is rendered once."""

import numpy as np
import pytest

from firmware_io import Device, MockDriver, MockLink, Playback
from haptix import Layout, LiveRenderer, Texture
from haptix.base.native import ffi, library
from haptix.feel.materials import Transient
from haptix.play.render import LiveSettings
from haptix.play.render.fingers import PredictedFingers
from haptix.play.render.live import RenderSource
from haptix.play.render.master import Master
from haptix.play.render.samples import RenderCore
from haptix.play.touch import TouchEvent

STEP_S = 1 / 12_000
STRIPES = Texture(
    np.tile(0.5 + 0.4 * np.sin(np.arange(200) / 3), (2, 1)), width_mm=60.0, beyond="hold"
)


@pytest.fixture
def core(surface):
    return RenderCore(surface, STRIPES, Device(MockLink(MockDriver())))


def sliding(settings=None, reports=20, vx=100.0):
    """A finger that slides at a constant speed, reported each 10 ms up to 0.19 s."""
    fingers = PredictedFingers(settings or LiveSettings())
    for k in range(reports):
        report(fingers, 0.01 * k, 5.0 + vx * 0.01 * k)
    return fingers


def report(fingers, t_s, x_mm, kind="move"):
    fingers.take(TouchEvent(t_s, 0, x_mm, 8.0, kind, 0.5), t_s)


def test_windows_do_not_depend_on_how_they_are_cut():
    fingers = sliding()
    fingers.update(0.2)
    whole = fingers.motion(0.2, STEP_S, 240, 0.2)
    for count in (24, 60, 120):
        at_s = 0.2 + 24 * STEP_S
        part = fingers.motion(at_s, STEP_S, count, 0.202)
        for name in ("x_mm", "y_mm", "normal_force_n"):
            a, b = getattr(whole.motion, name)[24 : 24 + count], getattr(part.motion, name)
            # Lines between predictions 4 ms apart: some 0.02 mm at most.
            assert np.abs(a - b).max() < 0.02
        assert whole.gain[24 : 24 + count] == pytest.approx(part.gain, abs=1e-9)
    again = fingers.motion(0.2, STEP_S, 240, 0.2)
    assert np.array_equal(whole.motion.x_mm, again.motion.x_mm)


def test_only_an_update_lets_reports_count():
    fingers = sliding()
    fingers.update(0.2)
    before = fingers.motion(0.22, STEP_S, 120, 0.0).motion.x_mm
    report(fingers, 0.2, 30.0)
    assert np.array_equal(fingers.motion(0.22, STEP_S, 120, 0.0).motion.x_mm, before)
    fingers.update(0.21)
    assert not np.array_equal(fingers.motion(0.22, STEP_S, 120, 0.0).motion.x_mm, before)


def test_a_correction_is_blended_from_where_the_finger_was_played():
    fingers = sliding()
    fingers.update(0.2)
    old = fingers.motion(0.2, STEP_S, 240, 0.0).motion.x_mm
    report(fingers, 0.2, 5.0 + 20.0 + 2.0)  # 2 mm from where it was expected
    fingers.update(0.21)
    new = fingers.motion(0.21, STEP_S, 240, 0.0).motion.x_mm
    assert abs(new[0] - old[120]) < 0.1
    [track] = fingers.tracks.values()
    expected = ffi.new("double[4]")
    library.hx_finger_place(fingers._following, track.row, 0.21 + 0.02, expected)
    assert new[-1] == pytest.approx(expected[0], abs=0.01)  # after seven time constants


def test_gains_fade_in_and_out_at_the_rate_of_the_settings():
    fingers = sliding()
    fade_s = LiveSettings().sliding.fade_s
    fingers.update(0.2)
    gain = fingers.motion(0.2, STEP_S, 1200, 0.0).gain
    times = 0.2 + STEP_S * np.arange(1, 1201)
    # In over the fade, and out where two reports, each 10 ms after the one before, did not come.
    [track] = fingers.tracks.values()
    assert track.row.rests_s == pytest.approx(0.2 + 2.2 * 0.01, abs=2e-4)
    rising = np.minimum((times - 0.2) / fade_s, 1.0)
    falling = np.clip(1.0 - (times - track.row.rests_s) / fade_s, 0.0, 1.0)
    assert gain == pytest.approx(np.minimum(rising, falling), abs=1e-9)
    report(fingers, 0.205, 0.0, "up")
    fingers.update(0.21)
    gain = fingers.motion(0.21, STEP_S, 120, 0.0).gain
    falling = np.clip(1.0 - np.arange(1, 121) * STEP_S / fade_s, 0.0, 1.0)
    assert gain == pytest.approx(falling, abs=1e-9)
    assert fingers.is_live
    fingers.update(0.23)
    fingers.motion(0.23, STEP_S, 120, 0.0)
    assert fingers.is_live  # what was made until 0.3 s has drive, and may still be queued
    fingers.update(0.301)
    assert not fingers.is_live
    assert fingers.motion(0.23, STEP_S, 12, 0.0).motion.fingers == 0


class Stream:
    """What a driver holds, and a source that fills it."""

    def __init__(self, core, fingers):
        self.core, self.fingers = core, fingers
        self.source = RenderSource(core, fingers, Master(lambda: None), lambda *_: None)
        self.volts = np.empty(0)

    def append(self, count):
        first = len(self.volts)
        new = self.source.window(first, count, 0.2 + first / 48_000, False)
        self.volts = np.concatenate([self.volts, new])

    def revise(self, first, count):
        new = self.source.window(first, count, 0.2 + first / 48_000, True)
        self.volts[first : first + count] = new


@pytest.mark.parametrize("seed", range(3))
def test_no_revision_leaves_a_step(core, seed):
    """Amplitudes keep their slope over every seam, whatever is revised and taken back."""
    rng = np.random.default_rng(seed)
    fingers = sliding()
    stream = Stream(core, fingers)
    for _ in range(6):
        stream.append(960)
    amplitudes = stream.source.amplitudes
    most = core.most_step_v * (1 + 1e-9)
    for k in range(60):
        report(fingers, 0.2 + 0.001 * k, 25.0 + 0.1 * k + rng.normal(0, 2.0))
        first = 4 * int(rng.integers(1, 1000))
        stream.revise(first, 4 * int(rng.integers(24, 240)))
        if rng.random() < 0.2:
            stream.source.settle(0, True)
        assert np.abs(np.diff(amplitudes.values)).max() <= most
    assert np.ptp(amplitudes.values) > 50.0


def test_what_is_played_is_within_the_slew_of_the_device(core):
    """Over many random revisions the volts keep the limit that a device checks."""
    rng = np.random.default_rng(1)
    fingers = sliding()
    stream = Stream(core, fingers)
    for _ in range(6):
        stream.append(960)
    for k in range(40):
        report(fingers, 0.2 + 0.001 * k, 25.0 + rng.normal(0, 2.0))
        stream.revise(4 * int(rng.integers(1, 1000)), 4 * int(rng.integers(24, 240)))
    slew = np.abs(np.diff(stream.volts)).max() * 48_000
    assert 1e6 < slew <= Device(MockLink(MockDriver())).limits.max_slew_v_per_s


def test_a_revision_without_news_changes_nothing_that_is_felt(core):
    fingers = sliding()
    stream = Stream(core, fingers)
    fingers.update(0.2)
    for _ in range(3):
        stream.append(960)
    before = stream.source.amplitudes.values.copy()
    stream.revise(480, 960)
    # Other knots of the same path.
    assert np.abs(stream.source.amplitudes.values - before).max() < 2.0


def test_live_rendering_agrees_with_one_that_knows_the_touches_at_once(surface, core):
    """At constant speed there is nothing to correct: revised or not, the same is played."""
    fingers = sliding()
    stream = Stream(core, fingers)
    fingers.update(0.2)
    for _ in range(4):
        stream.append(960)
    for k in range(1, 6):
        report(fingers, 0.19 + 0.01 * k, 5.0 + 19.0 + k)
        stream.revise(480 * k, 960)
    x = 5.0 + 100.0 * (0.2 + np.arange(1, 961) / 12_000)
    share = STRIPES.friction(x, np.full(960, 8.0), 100.0 / 12_000)
    low, high = core.reachable(np.full(960, 0.5), np.full(960, 100.0))
    felt = stream.source.amplitudes.values[1:]
    column = core.slice.column(0.5)
    expected, _ = column.voltage(low + share * (high - low))
    # From where it has faded in to where the last revision meets what is queued behind it.
    assert np.abs(felt - np.minimum(expected, core.highest_v))[240:800].max() < 6.0


def test_a_renderer_that_revises_holds_its_reaction(surface):
    device = Device(MockLink(MockDriver(pace="real")))
    with LiveRenderer(surface, STRIPES, device) as renderer:
        assert renderer.stats.reaction_s == renderer.settings.reaction_s == 0.003
    assert renderer.stats.reaction_p50_s != renderer.stats.reaction_p50_s  # nothing was touched


def test_what_an_app_changes_is_rendered_again_at_once(surface, monkeypatch):
    """As a touch is; without a finger there is nothing to render."""
    told = []
    monkeypatch.setattr(Playback, "touch", lambda self, now_s: told.append(now_s))
    layout, bump = (
        Layout(),
        Transient(
            curve={"kind": "pulse", "width_s": 0.02, "height": 0.3, "at_s": 0.005, "length_s": 0.03}
        ),
    )
    region = layout.add(STRIPES, 0, 0, 20, 20)
    device = Device(MockLink(MockDriver(pace="real")))
    with LiveRenderer(surface, layout, device) as renderer:

        def changes():
            yield renderer.intensity(0.5)
            yield renderer.mute()
            yield renderer.pause()
            yield region.move(x_mm=3.0)
            effect = renderer.play(bump)
            yield
            yield effect.stop()
            with layout.change():
                region.change(opacity=0.5)
                region.remove()
            yield
            yield setattr(renderer, "texture", STRIPES)

        for _ in changes():
            assert not told
        region = layout.add(STRIPES, 0, 0, 20, 20)
        renderer.texture = layout
        renderer.mute(False)
        renderer.pause(False)
        renderer.touch(renderer.now_s(), 5.0, 5.0, 0.5)
        assert len(told) == 1
        before = 1
        for _ in changes():
            assert len(told) == before + 1
            before = len(told)
            assert 0.0 <= renderer.now_s() - told[-1] < 1.0
