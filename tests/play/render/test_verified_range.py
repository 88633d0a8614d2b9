"""A renderer says, once each, what leaves the range in which the screen was verified."""

from datetime import date

import pytest

import haptix
from haptix import LiveRenderer, Renderer, Texture
from haptix.model.screen import Calibration, VerifiedRange
from haptix.play.render.verified import VerifiedUse
from haptix.play.touch import TouchEvent

RANGE = VerifiedRange(
    normal_force_n=(0.2, 0.6),
    frequency_hz=(125.0, 4000.0),
    speed_mm_per_s=(25.0, 100.0),
    voltage_v=((125.0, 200.0), (4000.0, 90.0)),
    contact_s=2.0,
)


@pytest.fixture(scope="module")
def surface(model):
    """A surface of a screen whose calibration states a range."""
    made = Calibration(
        date=date.today(), operator="me", instruments=(), verdict="passed", spread={},
        rests_on=(), verified=RANGE,
    )  # fmt: skip
    screen = model.screen.replace(calibration=made)
    known = haptix.ContactModel(model.finger, screen, fidelity="closed-form")
    scene = {"normal_force_n": (0.2, 1.0), "frequency_hz": 3000.0}
    return haptix.FrictionSurface.build(known, scene, tolerance=2e-3)


def stroke(renderer, force_n, speed_mm_per_s, lasts_s):
    """Touches at 100 Hz; the finger turns every 0.2 s."""
    for step in range(round(lasts_s * 100) + 1):
        t_s = step / 100
        turned = abs((t_s + 0.2) % 0.4 - 0.2)
        renderer.touch(t_s, 5.0 + speed_mm_per_s * turned, 5.0, force_n)


@pytest.mark.parametrize(
    ("used", "said"),
    [
        ((0.5, 80.0, 1.0), []),
        ((0.9, 80.0, 1.0), ["force 0.9 N: verified 0.2 to 0.6"]),
        ((0.5, 150.0, 1.0), ["speed 150 mm/s: verified 25 to 100"]),
        ((0.5, 80.0, 2.5), ["contact 2.5 s: verified 0 to 2"]),
    ],
)
def test_a_renderer_says_what_leaves_the_range(surface, used, said):
    heard = []
    renderer = Renderer(surface, Texture([[0.1]], width_mm=60.0), haptix.open_device("mock:"))
    renderer.verified.on_warning = heard.append
    with renderer:
        stroke(renderer, *used)
    assert list(renderer.verified.sentences) == said
    # Each is told when it begins, once: the last of it is in `sentences`.
    assert len(heard) == len(said)
    assert all(one.startswith("beyond the range that the screen's calibration") for one in heard)


def test_amplitudes_count_too_and_the_live_renderer_says_the_same(surface):
    device = haptix.open_device("mock:pace=stepped")
    with LiveRenderer(surface, Texture([[1.0]], width_mm=60.0), device) as renderer:
        stroke(renderer, 0.9, 50.0, 0.5)
        renderer.run_until(0.6)
    first_words = [one.split()[0] for one in renderer.verified.sentences]
    # A texture that asks for the highest friction takes all of the 183 V that a body allows.
    assert first_words == ["force", "amplitude"]


def test_a_screen_without_a_range_says_nothing_and_a_new_touch_begins_anew():
    silent = VerifiedUse({"model": {"screen": {"calibration": None}}}, 4000.0)
    silent.touched(TouchEvent(0.0, 0, 0.0, 0.0, "move", 9.0), 9.0)
    silent.played(300.0)
    assert silent.range is None and silent.sentences == ()
    made = {"model": {"screen": {"calibration": {"verified": RANGE.model_dump(mode="json")}}}}
    use = VerifiedUse(made, 4000.0)
    for begin in (0.0, 10.0):  # lifted in between: two short contacts
        for step in range(3):
            use.touched(TouchEvent(begin + step / 2, 0, 25.0 * step, 0.0, "move", 0.5), 0.5)
        use.touched(TouchEvent(begin + 1.5, 0, 0.0, 0.0, "up"), None)
    assert use.sentences == ()
