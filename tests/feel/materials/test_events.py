"""Materials that react to what a finger does: facts from reports, and what they ask for then."""

from itertools import pairwise

import numpy as np
import pytest
import soundfile
from hypothesis import given
from hypothesis import strategies as st

import haptix
from haptix.base.errors import InputError
from haptix.feel.materials import Button, Dial, Slider, Toggle, Transient, WebEffect, material_of
from haptix.feel.motion import Facts, Motion, Report, Trajectory
from haptix.feel.motion.block import Reactions, facts_on
from haptix.play.simulation import Setting, simulate

STEP_S = 1 / 12_000
ROUNDING = 1e-9


def path_of(t, x, y, force):
    return Trajectory(
        t, *(np.full_like(t, one) if np.isscalar(one) else one for one in (x, y, force))
    )


PRESS = path_of(
    T := np.arange(0, 1.0, 0.01),
    8.0, 6.0, np.interp(T, [0, 0.2, 0.4, 0.6, 0.7, 1.0], [0.1, 0.1, 1.1, 1.1, 0.1, 0.1]),
)  # fmt: skip


def test_a_button_is_pressed_and_let_go_where_the_force_crosses():
    (down_s, down), (press_s, press), (release_s, release) = facts_on(PRESS, Button().react, 0.0)
    assert down_s == down.down_s == 0.0
    assert press_s == press.press_s == pytest.approx(0.2 + 0.2 * 0.7)
    assert release_s == release.release_s == pytest.approx(0.6 + 0.1 * 0.6)


def asked(material, path, at_s):
    """Values along a path at times."""
    evaluator = material.evaluator
    x, y, force = path.at(at_s)
    vx, vy = path.velocity_mm_per_s(at_s)
    history = facts_on(path, evaluator.react, 0.0)
    return evaluator.wanted(Motion.of(x, y, at_s, vx, vy, force, history=history))


def test_a_press_raises_friction_with_force_and_drops_it_at_press_and_release():
    t = np.array([0.1, 0.3, 0.3398, 0.3415, 0.36, 0.42, 0.48, 0.58, 0.6595, 0.662, 0.68, 0.95])
    found = asked(Button(), PRESS, t)
    force = PRESS.at(t)[2]
    rising = np.clip((force - 0.24) / 0.56, 0, 1)
    expected = [0, rising[1], rising[2], 0, 0, 0.5, 1, 1, 1, 0, 0, 0]
    np.testing.assert_allclose(found, expected, atol=2e-3)


@pytest.mark.parametrize("why", ["light", "on the rim", "assumed", "slid in", "no face"])
def test_nothing_else_presses_a_button(why):
    force = {"light": 0.79}.get(why, 1.0)
    place = {"on the rim": (1.0, 6.0), "no face": (80.0, 6.0)}.get(why, (8.0, 6.0))
    known = None if why == "assumed" else force
    reports = [Report(0.0, *place, None if why == "assumed" else 0.1), Report(0.1, *place, known)]
    if why == "slid in":
        reports = [Report(0.0, -5.0, 6.0, 1.0), Report(0.1, 8.0, 6.0, 1.0)]
    reactions = Reactions()
    for report in reports:
        reactions.report(report, Button().react)
    assert np.isnan(reactions.history[-1][1].press_s)


@pytest.mark.parametrize("forces", [(None, 2.5, 2.5), (0.3, None, 2.5), (None, 0.3, None, 2.5)])
def test_a_force_that_was_not_known_before_presses_from_its_report_on(forces):
    reactions = Reactions()
    for number, force in enumerate(forces):
        reactions.report(Report(number / 100, 8.0, 6.0, force), Button().react)
    first = next(number for number, force in enumerate(forces) if force == 2.5)
    assert reactions.history[-1][1].press_s == first / 100
    assert np.isnan(reactions.history[-1][1].release_s)


def test_leaving_or_lifting_releases():
    for last in (Report(0.2, 40.0, 6.0, 1.0), Report(0.2, 8.0, 6.0, None, is_down=False)):
        reactions = Reactions()
        for report in (Report(0.0, 8.0, 6.0, 0.2), Report(0.1, 8.0, 6.0, 1.0), last):
            reactions.report(report, Button().react)
        assert reactions.history[-1][1].release_s == 0.2


def test_a_live_fact_holds_from_the_first_sample_that_can_be_rendered():
    reactions = Reactions()
    for report in (Report(0.0, 8.0, 6.0, 0.2), Report(0.1, 8.0, 6.0, 1.0)):
        reactions.report(report, Button().react, from_s=report.t_s + 0.004)
    since_s, facts = reactions.history[-1]
    assert since_s == facts.press_s == pytest.approx(0.104)


def test_the_rim_is_felt_sliding_and_not_at_rest():
    button = Button()
    rim = button.wanted(Motion.of([1.0, 1.0], 6.0, 0.0, [100.0, 0.0], 0.0, 0.1))
    np.testing.assert_allclose(rim, [1.0, 0.0], atol=1e-3)
    assert button.wanted(Motion.of([-1.0, 8.0, 17.0], 6.0, 0.0, 100.0, 0.0, 0.1)).max() < ROUNDING


def test_a_press_is_played_to_a_finger_that_rests(model):
    surface = haptix.FrictionSurface.build(
        model, {"normal_force_n": (0.05, 1.2), "frequency_hz": 4000.0}, tolerance=1e-3
    )
    device = haptix.open_device("mock:")
    with haptix.Renderer(surface, Button(), device) as renderer:
        renderer.play(PRESS)
    device.close()
    volts = np.abs(device.mock.played_v)
    at = lambda t_s: volts[int((t_s - 0.005) * 48e3) : int((t_s + 0.005) * 48e3)].max()  # noqa: E731
    assert at(0.33) > 150 > 20 > at(0.355)
    assert at(0.5) > 150 > 20 > at(0.675)
    assert at(0.1) == 0


@given(st.lists(st.floats(-5, 45), min_size=2, max_size=30))
def test_detents_are_those_that_the_path_passes(stops):
    """Property: after any path the detent is the nearest, but for the hysteresis at a ridge."""
    slider = Slider(travel_mm=40.0, detents=9)
    reactions = Reactions()
    for i, x in enumerate(stops):
        reactions.report(Report(0.01 * i, x, 0.0, None), slider.react)
    facts = reactions.history[-1][1]
    assert abs(facts.detent - min(max(stops[-1] / 5, 0), 8)) <= 0.55 + ROUNDING
    crossed = [f.detent for _, f in reactions.history]
    assert all(a != b for a, b in pairwise(crossed))
    assert all(0 <= detent <= 8 for detent in crossed)


def test_a_detent_is_crossed_when_the_finger_passes_the_ridge():
    t = np.arange(0, 0.4, 0.01)
    ((_, first), *crossed) = facts_on(
        path_of(t, 100 * t, 0.0, 0.5), Slider(travel_mm=40.0).react, 0.0
    )
    assert first.detent == 0
    assert [facts.detent for _, facts in crossed] == [1, 2, 3, 4, 5, 6, 7, 8]
    np.testing.assert_allclose(
        [facts.detent_s for _, facts in crossed], np.arange(8) * 0.05 + 0.025
    )


def test_a_dial_counts_round_and_a_toggle_has_two_sides():
    t = np.arange(0, 1.0, 0.005)
    angle = 4 * np.pi * t  # two turns
    turned = path_of(t, 20 * np.cos(angle), 20 * np.sin(angle), 0.5)
    numbers = [facts.detent for _, facts in facts_on(turned, Dial().evaluator.react, 0.0)]
    assert numbers == [float(n % 12) for n in range(len(numbers))]
    assert len(numbers) == 25  # the first, and two turns
    to_and_fro = path_of(t, 10 + 8 * np.sin(4 * np.pi * t - 1), 0.0, 0.5)
    sides = [facts.detent for _, facts in facts_on(to_and_fro, Toggle().evaluator.react, 0.0)]
    assert sides == [0.0, 1.0, 0.0, 1.0, 0.0]


def test_a_value_is_snapped_to_the_nearest_detent():
    assert Slider(travel_mm=40.0, detents=5).value(12.0) == 0.25
    assert Slider(travel_mm=40.0, detents=5, snap=False).value(12.0) == pytest.approx(0.3)
    assert Slider(travel_mm=40.0, detents=(0.0, 4.0, 40.0)).value(9.0) == pytest.approx(0.1)


def test_a_transient_begins_at_its_event_and_ends():
    pulse = {"kind": "pulse", "height": 0.7, "width_s": 0.02, "length_s": 0.02}
    transient = Transient(begins="down", curve=pulse)
    t = STEP_S * np.arange(1200)
    values = transient.wanted(Motion.of(0.0, 0.0, t, history=((0.03, Facts(down_s=0.03)),)))
    assert not values[t < 0.03].any()
    assert not values[t > 0.03 + transient.length_s + STEP_S].any()
    # Late by a millisecond; within the flat part as high as asked.
    np.testing.assert_allclose(values[(t > 0.0325) & (t < 0.0495)], 0.7, atol=0.01)
    assert np.trapezoid(values, t) == pytest.approx(0.7 * 0.02, rel=1e-3)
    assert transient.length_s == pytest.approx(0.022, abs=2 * STEP_S)


@pytest.mark.parametrize(("frequency_hz", "kept"), [(100, 0.99), (250, 0.96), (3000, 0.01)])
def test_transients_hold_what_skin_feels(frequency_hz, kept):
    curve = {"kind": "sine", "amplitude": 0.5, "frequency_hz": frequency_hz, "length_s": 0.2}
    transient = material_of({"kind": "transient", "begins": "start", "curve": curve})
    t = STEP_S * np.arange(600, 1800)
    found = transient.wanted(Motion.of(0.0, 0.0, t))
    amplitude = np.sqrt(2 * np.mean(found**2)) / 0.5
    assert amplitude > kept if kept > 0.5 else amplitude < kept


def test_an_audio_clip_is_felt_below_a_kilohertz(tmp_path):
    t = np.arange(4800) / 48_000
    clip = 0.4 * np.sin(2 * np.pi * 200 * t) + 0.4 * np.sin(2 * np.pi * 5000 * t)
    soundfile.write(tmp_path / "click.wav", clip, 48_000)
    (tmp_path / "click.toml").write_text(
        'kind = "transient"\nbegins = "start"\ncurve = {kind = "recorded", file = "click.wav"}\n'
    )
    felt = haptix.feel.materials.load(tmp_path / "click.toml")
    at = np.arange(240, 1000) / 12_000
    values = felt.wanted(Motion.of(0.0, 0.0, at))
    delayed = 0.4 * np.sin(2 * np.pi * 200 * (at - 0.001))
    np.testing.assert_allclose(values, delayed, atol=0.03)
    felt.save(tmp_path / "again.toml")
    assert "click.wav" in (tmp_path / "again.toml").read_text()
    assert str(tmp_path) not in (tmp_path / "again.toml").read_text()


def test_effects_have_an_intensity_and_an_order():
    t = STEP_S * np.arange(6000)
    whole = {n: WebEffect(name=n, begins="start").wanted(Motion.of(0.0, 0.0, t))
             for n in ("hint", "edge", "tick", "align", "success", "error")}  # fmt: skip
    half = WebEffect(name="tick", begins="start", intensity=0.5).wanted(Motion.of(0.0, 0.0, t))
    np.testing.assert_allclose(half, 0.5 * whole["tick"])
    assert whole["hint"].max() < whole["tick"].max() < whole["edge"].max()
    assert whole["align"].min() < -0.25 * whole["edge"].max()
    rises = {n: np.sum(np.diff(values > 0.02) & (values[1:] > 0.02)) for n, values in whole.items()}
    assert rises == {"hint": 1, "edge": 1, "tick": 1, "align": 1, "success": 2, "error": 3}
    lengths = {"success": 0.135, "error": 0.403}
    assert all(not values[t > lengths.get(n, 0.1)].any() for n, values in whole.items())


@pytest.mark.parametrize("thickness", [0.6, 1.5])
@pytest.mark.parametrize("finger", ["semi-wet", "wet"])
def test_an_effect_is_as_strong_on_other_fingers_and_screens(finger, thickness):
    """`benchmarks/effects.py` has more of both; half a JND is what the effects are held to."""
    screen = haptix.Screen.preset("3m-sct3250")
    screen = screen.replace(insulator_thickness_m=thickness * screen.insulator_thickness_m)
    model = haptix.ContactModel(haptix.Finger.preset(finger), screen)
    axes = {"normal_force_n": 0.5, "frequency_hz": 4000.0}
    surface = haptix.FrictionSurface.build(model, axes, tolerance=1e-3)
    t = np.arange(0, 0.3, 0.01)
    effect = WebEffect(name="tick")
    found = simulate(Setting(model, effect, path_of(t, 80 * t, 5.0, 0.5)), surface)
    change = found.felt.mu / found.lowest_mu - 1
    asked = effect.timeline.value.max()
    assert abs(np.nanmax(change) - asked) < 0.5 * 0.11  # of a JND of 0.11
    assert np.nanmax(np.abs(change[(found.felt.t_s > 0.03) & (found.felt.t_s < 0.28)])) < 0.011


@pytest.mark.parametrize(
    ("message", "make"),
    [
        ("at most 60 s, got no end", lambda: Transient(curve={"kind": "sine", "amplitude": 1,
                                                               "frequency_hz": 9})),
        ("release_n below", lambda: Button(press_n=0.3)),
        ("3 mm apart", lambda: Slider(travel_mm=20.0, detents=20)),
        ("3 mm apart", lambda: Dial(detents=40)),
        ("at most half", lambda: Toggle(width_mm=5.0)),
        ("hint", lambda: WebEffect(name="buzz")),
    ],
)  # fmt: skip
def test_what_cannot_be_is_refused_when_it_is_made(message, make):
    with pytest.raises(InputError, match=message):
        make()
