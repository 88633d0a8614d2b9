"""Wrong arguments: one sentence at the call, and right ones in the forms that people give."""

from typing import Any

import numpy as np
import pytest
import torch

import haptix
from haptix import ContactModel, Finger, FrictionSurface, InputError, Screen, Texture, Trajectory
from haptix.feel.materials import Slider
from haptix.feel.motion import Motion
from haptix.play.render import (
    LiveRenderer,
    LiveSettings,
    Renderer,
    RenderSettings,
    SineCarrier,
    Sliding,
)
from haptix.play.touch import (
    ForceModel,
    SingerKalman,
    Touches,
    TouchEvent,
    TouchSettings,
    events_of,
    paced,
    read_events,
)

PEBBLES = Texture([[0, 1], [1, 0]], width_mm=10)  # lists and whole numbers will do
PATH = Trajectory.of([0, 1], [0, 50], 5, 0.5)
TUPLES: Any = [(0, 1, 2)]


class Given:
    def __init__(self, surface):
        self.surface = surface

    @property
    def device(self):
        return haptix.open_device("mock:")

    def renderer(self, **how):
        return Renderer(self.surface, PEBBLES, self.device, **how)

    def texture(self, texture):
        self.renderer().texture = texture

    def entered(self, method, *arguments):
        with self.renderer() as renderer:
            renderer.touch(0.0, 1.0, 1.0)
            getattr(renderer, method)(*arguments)


RENDERERS = {
    "a path for a texture": (lambda g: g.texture("pebbles.png"), "texture: .*pebbles.*from_image"),
    "no texture": (lambda g: g.texture(None), "texture: .*None"),
    "a class": (lambda g: g.texture(Texture), "texture: .*Texture"),
    "pixels": (lambda g: g.texture(np.ones((3, 3))), "texture: .*from_image"),
    "a number": (lambda g: g.texture(0.5), "texture: .*0.5"),
    "swapped": (lambda g: Renderer(PEBBLES, g.surface, g.device), "surface: .*the order is"),
    "texture last": (lambda g: Renderer(g.surface, g.device, PEBBLES), "texture: "),
    "device first": (lambda g: Renderer(g.device, g.surface, PEBBLES), "surface: .*the order is"),
    "an address": (lambda g: Renderer(g.surface, PEBBLES, "mock:"), "device: .*open_device"),
    "a file": (lambda g: Renderer("my.surface", PEBBLES, g.device), "surface: .*my.surface"),
    "a frequency": (lambda g: g.renderer(drive=4000), "drive: .*4000.*SineCarrier"),
    "settings as drive": (lambda g: g.renderer(drive=RenderSettings()), "drive: "),
    "a dict": (lambda g: g.renderer(settings={"block_s": 0.01}), "settings: .*RenderSettings"),
    "recorded": (
        lambda g: LiveRenderer(g.surface, PEBBLES, g.device, settings=RenderSettings()),
        "settings: .*LiveSettings",
    ),
    "a touch's settings": (lambda g: g.renderer(settings=TouchSettings()), "settings: "),
    "a tuple": (lambda g: g.entered("event", (0, 0, 1, 1, "down", None, None)), "TouchEvent"),
    "no event": (lambda g: g.entered("event", None), "TouchEvent"),
    "a word for a time": (lambda g: g.entered("touch", "now", 1, 1), "t_s: .*seconds"),
    "rows": (lambda g: g.entered("touch", 0.1, [1, 2], [1, 2]), "x_mm: .*millimetres"),
    "lifted some day": (lambda g: g.entered("lift", "now"), "t_s of a lift"),
    "lifted at no time": (lambda g: g.entered("lift", None), "t_s of a lift"),
    "a path's file": (lambda g: g.entered("play", "path.csv"), "path: .*from_csv"),
    "events for a path": (lambda g: g.entered("play", events_of(PATH)), "path: .*Trajectory"),
    "a path beyond the screen": (
        lambda g: g.entered("play", Trajectory.of([0, 1, 2], [0, 9e5, 0], 1, 0.5)),
        "x_mm: .*millimetres.*, in sample 2",
    ),
    "a path with a pause": (
        lambda g: g.entered("play", Trajectory.of([0, 1, 72], 1, 1, 0.5)),
        "within 60 s of .* 71 s later",
    ),
    "50 gram": (lambda g: g.entered("touch", 0.1, 1, 1, 500.0), "normal_force_n: .*100"),
    "a feather": (lambda g: g.entered("touch", 0.1, 1, 1, 1e-6), "normal_force_n: .*0.001"),
    "a metre of skin": (lambda g: g.entered("touch", 0.1, 1, 1, 0.5, 0, 1.0), "contact_area_m2"),
    "words to reach": (lambda g: g.renderer().reachable("a", 50), "reachable"),
}
OTHERS = {
    "a reaction in ms": (lambda: LiveSettings(reaction_s=3), "reaction_s: expected 0.1 s at most"),
    "a long horizon": (lambda: LiveSettings(horizon_s=1.0), "horizon_s: expected 0.11 s at most"),
    "fields without names": (lambda: Slider(60, 9), "Slider: .*by name, such as .*got 60"),  # type: ignore[call-arg]
    "no path": (lambda: haptix.feel.materials.load(3), "load: expected the path"),
    "reaction with a unit": (lambda: LiveSettings(reaction_s="3ms"), "reaction_s: .*3ms"),
    "reaction in ms": (lambda: LiveSettings(reaction_s=3), "reaction_s: .*in ms"),
    "a horizon of days": (lambda: LiveSettings(horizon_s=1e6), "horizon_s: .*1e"),
    "not strict": (lambda: LiveSettings(strict="no"), "strict: .*no"),
    "touch as a dict": (lambda: LiveSettings(touch={"latency_s": 0.03}), "touch: .*TouchSettings"),
    "sliding": (lambda: LiveSettings(sliding=True), "sliding: .*Sliding"),
    "fade with a unit": (lambda: Sliding(fade_s="5ms"), "fade_s"),
    "no fade": (lambda: Sliding(fade_s=0), "fade_s"),
    "slides backwards": (lambda: Sliding(from_mm_per_s=1, to_mm_per_s=2), "to_mm_per_s"),
    "block in ms": (lambda: RenderSettings(block_s=5), "block_s: .*in ms"),
    "compress all": (lambda: RenderSettings(compress="all"), "compress"),
    "compress one": (lambda: RenderSettings(compress=(0.2,)), "compress"),
    "compress swapped": (lambda: RenderSettings(compress=(0.9, 0.2)), "compress"),
    "keep": (lambda: RenderSettings(keep_blocks="yes"), "keep_blocks"),
    "a carrier's unit": (lambda: SineCarrier("4 kHz"), "frequency_hz"),
    "touches of a dict": (lambda: Touches({"latency_s": 1}), "settings: .*TouchSettings"),
    "touches, swapped": (lambda: Touches(True), "settings"),
    "half a touch": (lambda: Touches(max_touches=0.5), "max_touches"),
    "a filter's name": (lambda: TouchSettings(filter="kalman"), "filter: .*kalman"),
    "a filter's class": (lambda: TouchSettings(filter=SingerKalman), "filter"),
    "a force": (lambda: TouchSettings(force=0.5), "force: .*ForceModel"),
    "latency in ms": (lambda: TouchSettings(latency_s=30), "latency_s: .*in ms"),
    "a giant": (lambda: ForceModel(assumed_n=500), "assumed_n"),
    "a law as numbers": (lambda: ForceModel(area_proxy=(1e-4, 0.5)), "area_proxy: .*AreaProxy"),
    "a stroke of 500 N": (lambda: Trajectory.of([0, 1], 1, 1, [0.5, 500]), "normal_force_n.*500"),
    "a path of tuples": (lambda: events_of([(0, 1, 1, 0.5)]), "path: .*Trajectory"),
    "events of tuples": (lambda: list(paced(TUPLES)), "events: .*TouchEvent"),
    "no file": (lambda: read_events(None), "path: .*None"),
    "no surface": (lambda: FrictionSurface.load(3), "path: .*3"),
    "pixels of words": (lambda: Texture([["a"]], width_mm=10), "level: .*from_image"),
    "a photograph's path": (lambda: Texture("brick.png", width_mm=10), "level: .*from_image"),
    "ragged": (lambda: Texture([[0, 1], [1]], width_mm=10), "level"),
    "a finger's name": (lambda: ContactModel("semi-wet", "3m-sct3250"), "finger: .*preset"),
    "model, swapped": (
        lambda: ContactModel(Screen.preset("3m-sct3250"), Finger.preset("dry")),
        "finger: .*Finger",
    ),
    "build, swapped": (
        lambda: FrictionSurface.build({"normal_force_n": 0.5}, None),
        "model: .*the order is",
    ),
}


def check(call, words):
    with pytest.raises(InputError, match=words) as caught:
        call()
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", RENDERERS)
def test_a_renderer_says_what_it_was_given(surface, name):
    call, words = RENDERERS[name]
    check(lambda: call(Given(surface)), words)


@pytest.mark.parametrize("name", OTHERS)
def test_others_say_what_they_were_given(name):
    check(*OTHERS[name])


def test_lists_and_tensors_will_do():
    level = [[0.0, 0.5], [1.0, 0.25]]
    x, y = [1.0, 4.0, 9.0], [1.0, 4.0, 2.0]
    wanted = Texture(np.array(level), 10.0).friction(np.array(x), np.array(y))
    for given in (level, torch.tensor(level), tuple(map(tuple, level))):
        np.testing.assert_array_equal(Texture(given, 10).friction(x, y), wanted)
    np.testing.assert_array_equal(Motion.of(x, y).x_mm, x)
    assert Touches().push(TouchEvent(0, 0, 1, 2))
