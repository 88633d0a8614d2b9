"""Materials as stimuli: any document under a finger on the recipe's path."""

import json
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest

import haptix
from haptix.base.errors import InputError
from haptix.feel import MaterialSignal, SteadySpeed, Strokes
from haptix.feel.materials import KINDS, Slider, Transient, load
from haptix.feel.materials.timeline import Timeline
from haptix.feel.signals.shapes import Pulse
from haptix.lab.stimuli import Rendering
from haptix.lab.stimuli.recipe import Recipe
from haptix.lab.stimuli.stimulus import stimulus_from

RATE = 12_000.0
EXAMPLES = Path(haptix.__file__).parents[1] / "examples" / "materials"
OWN = sorted(kind for kind, of in KINDS.items() if of.__module__.startswith("haptix."))


def of(kind):
    return MaterialSignal(load(EXAMPLES / f"{kind}.toml"), Strokes(60.0, 0.5), y_mm=9.0)


@pytest.mark.parametrize("kind", OWN)
def test_every_kind_is_a_signal_whose_blocks_do_not_matter(kind):
    signal = of(kind)
    whole = signal.values(0, 6000, RATE)
    parts = [signal.values(first, 1500, RATE) for first in (4500, 0, 3000, 1500)]
    parts = [parts[i] for i in (1, 3, 2, 0)]
    # A wave that is sampled block by block differs by the rounding of sums.
    np.testing.assert_allclose(np.concatenate(parts), whole, rtol=0, atol=1e-9)
    assert np.ptp(whole) > 0.01 or kind in ("transient", "effect")  # by events
    json.dumps(signal.describe())


def test_relief_is_the_other_way_round_on_the_way_back():
    """A stroke there and back over a slope: friction above its flat level, then below."""
    strokes = Strokes(40.0, 0.5)
    relief = load(EXAMPLES / "relief.toml").replace(bias=0.5, edge_mm=0.0, high=1.0, low=0.0)
    values = MaterialSignal(relief, strokes, y_mm=20.0).values(0, 12_000, RATE)
    there, back = values[:6000], values[6000:][::-1]
    moving = slice(1200, 4800)  # nearer the ends the direction fades
    np.testing.assert_allclose(there[moving] + back[moving], 1.0, atol=0.01)
    assert np.ptp(there[moving]) > 0.3


def test_a_transient_begins_where_a_detent_is_crossed():
    """Detents of 10 mm at 50 mm/s: the first ridge is passed at 0.1 s, heard 5 % later."""
    tick = Transient(begins="detent", curve=Pulse(0.5, 0.03, length_s=0.03))
    both = haptix.feel.materials.material_of(
        {"kind": "layout", "regions": [
            {"material": Slider(travel_mm=40.0, detents=5, high=0.4), "width_mm": 50,
             "height_mm": 20},
            {"material": tick, "width_mm": 50, "height_mm": 20, "z": 1, "blend": "add"},
        ]}
    )  # fmt: skip
    values = MaterialSignal(both, 50.0, y_mm=5.0).values(0, 2400, RATE)
    # Each region has facts of its own: the tick hears nothing of the slider.
    t = np.arange(2400) / RATE
    wave = 0.2 + 0.2 * np.cos(2 * np.pi * np.clip((50 * t - 5) / 1.5, -0.5, 0.5))
    np.testing.assert_allclose(values, wave, atol=1e-6)


def test_a_material_that_crosses_detents_tells_what_is_within_it():
    class Ticking(Slider):
        """A slider that ticks."""

        kind: Literal["test-ticking"] = "test-ticking"  # type: ignore[assignment]
        depends_on = (
            Slider.depends_on | haptix.feel.motion.Depends.FACTS | haptix.feel.motion.Depends.TIME
        )

        def wanted(self, motion):
            return Timeline.of(Pulse(0.5, 0.03, length_s=0.03), "rest").at(
                motion.t_s - motion.facts.detent_s
            )

    signal = MaterialSignal(Ticking(travel_mm=40.0, detents=5), 50.0)
    values = signal.values(0, 2400, RATE)
    begins = np.flatnonzero(values > 0.25)[0] / RATE
    # Passed at 0.1 s, crossed 5 % of 10 mm later, 1 ms to the next report, 1 ms of filter.
    assert begins == pytest.approx(0.1 + 0.01 + 0.001, abs=0.0015)
    np.testing.assert_array_equal(values[1200:], signal.values(1200, 1200, RATE))


def test_the_target_is_the_quantity_and_shares_are_of_the_reach(response):
    signal = {"kind": "material", "of": {"kind": "grating", "period_mm": 6.0}}
    table = {"speed": 60.0, "length_s": 0.1, "normal_force_n": 0.5, "signal": signal}
    found = stimulus_from("waves", table)
    assert found.quantity == "share"
    assert found.speed == SteadySpeed(60.0)
    block = Rendering(found, response, 48_000.0).block(0, 4800)
    t = np.arange(4800) / 48_000.0
    low, high = response.lowest_mu, response.highest_mu
    asked = low + (0.5 + 0.5 * np.sin(2 * np.pi * 10 * t)) * (high - low)
    np.testing.assert_allclose(response.mu(block.amplitude_v), asked, rtol=1e-6)
    assert block.above == block.below == 0


SLIDER: dict[str, Any] = {"kind": "material", "of": {"kind": "slider"}}
WRONG: dict[str, dict[str, Any]] = {
    "quantity: the material is in share": {"quantity": "mu"},
    "material.speed: expected the finger's speed": {"speed": None},
    "normal_force_n: expected that of the material": {"signal": {**SLIDER, "normal_force_n": 0.4}},
    "expected a material": {"signal": {"kind": "material", "of": 3}},
    "period_mm: field required": {"signal": {"kind": "material", "of": {"kind": "grating"}}},
    "material has no such field": {"signal": {**SLIDER, "x": 1}},
}  # fmt: skip


@pytest.mark.parametrize("message", WRONG)
def test_what_is_wrong_is_one_sentence(message):
    table = {"speed": 60.0, "length_s": 0.1, "signal": SLIDER, **WRONG[message]}
    with pytest.raises(InputError) as error:
        stimulus_from("one", table)
    assert message in str(error.value).replace("a table with a", "a material")
    assert "\n" not in str(error.value)


FINE = {"kind": "grating", "period_mm": 0.005}
CURVE = {"speed_mm_s": [10.0, 200.0], "share": [0.2, 0.8]}
PASSED_TOO_OFTEN: dict[str, dict[str, Any]] = {
    "itself": FINE,
    "within": {"kind": "moving", "of": {"kind": "by-speed", **CURVE, "of": FINE}},
    "region": {"kind": "layout", "regions": [{"material": FINE, "width_mm": 9, "height_mm": 9}]},
    "noise": {"kind": "noise", "tile_mm": 0.05, "shortest_mm": 0.001, "longest_mm": 0.005},
}


@pytest.mark.parametrize("place", PASSED_TOO_OFTEN)
def test_a_period_that_the_rate_cannot_carry_is_refused(place):
    """At 100 mm/s a period of 0.005 mm is 20 kHz, more than half of 12 and less than of 48 kHz."""
    signal = MaterialSignal(PASSED_TOO_OFTEN[place], 100.0)
    with pytest.raises(InputError, match=r"0\.005 mm at 100 mm/s is 20000 Hz.*half of the 12000"):
        signal.values(0, 600, RATE)
    assert np.ptp(signal.values(0, 600, 48_000.0)) > 0


def test_a_wave_of_a_spectrum_is_a_period():
    """A wave of 0.2 mm at 1300 mm/s is 6.5 kHz."""
    signal = MaterialSignal({"kind": "spectral", "waves": [[0.2, 0.1]]}, 1300.0)
    with pytest.raises(InputError, match=r"waves: .* is 6500 Hz, expected less than 6000 Hz"):
        signal.values(0, 600, RATE)


def test_ribs_along_the_path_are_no_period_of_it():
    along = {**FINE, "orientation_deg": 90.0}
    noise = {**PASSED_TOO_OFTEN["noise"], "grain": "ribbed", "orientation_deg": 90.0}
    turned = {"material": FINE, "width_mm": 9, "height_mm": 9, "rotation_deg": 90}
    for material in (along, noise, {"kind": "layout", "regions": [turned]}):
        MaterialSignal(material, 100.0).values(0, 600, RATE)


RECIPE = """
schema_version = 1
name = "coins"
[trials]
in_order = true
[[designs]]
kind = "factorial"
name = "drag"
base = { length_s = 0.1, speed = 80, signal = { kind = "material", of = "deeper/belt.toml" } }
factors = { "signal.y_mm" = [4.0, 8.0] }
[stimuli.coin]
length_s = 0.2
speed = { kind = "strokes", stroke_mm = 30, stroke_s = 0.1 }
signal = { kind = "material", of = "deeper/coin.toml", y_mm = 10 }
"""


@pytest.mark.usefixtures("own_cache")
def test_a_recipe_names_documents_and_is_the_same_from_anywhere(tmp_path, monkeypatch):
    deeper = tmp_path / "recipes" / "deeper"
    deeper.mkdir(parents=True)
    for name in ("coin.png", "relief.toml"):
        (deeper / name).write_bytes((EXAMPLES / name).read_bytes())
    (deeper / "relief.toml").rename(deeper / "coin.toml")
    (deeper / "belt.toml").write_text(
        'kind = "moving"\nvelocity_mm_s = [20, 0]\nof = {kind = "grating", period_mm = 4}\n'
    )
    recipe = deeper.parent / "coins.toml"
    recipe.write_text(RECIPE)
    parts = Recipe.load(recipe).stimulus_set()
    assert [one.name for one in parts.stimuli] == ["coin", "drag-01", "drag-02"]
    result = parts.make(tmp_path / "set")
    table = json.loads((tmp_path / "set" / "coin.json").read_text())
    of = table["stimulus"]["signal"]["of"]["of"]
    assert of["heights"].startswith("sha256:") and of["kind"] == "relief"
    monkeypatch.chdir(tmp_path / "recipes")
    again = Recipe.load("coins.toml").stimulus_set().make(tmp_path / "set")
    assert again.reused == 3
    assert again.manifest == result.manifest
    (deeper / "coin.png").write_bytes((EXAMPLES / "coin.png").read_bytes() + b"more")
    changed = Recipe.load("coins.toml").stimulus_set().make(tmp_path / "set")
    assert changed.reused == 2


def test_the_example_is_a_set_of_materials():
    made = Recipe.load(EXAMPLES.parent / "stimuli" / "materials.toml").stimulus_set()
    stimuli = {one.name: one for one in made.stimuli}
    assert sorted(stimuli) == ["coin", "detents-01", "detents-02"]
    # On the way over a detent, the second asks for twice the friction of the first.
    low, high = (stimuli[f"detents-0{i}"].signal.values(0, 6000, RATE) for i in (1, 2))
    np.testing.assert_allclose(high, 2 * low, atol=1e-9)
    assert high.max() == pytest.approx(0.8, abs=1e-3)
