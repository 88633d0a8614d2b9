"""The gallery: every preset is a document that is felt, and is what it says."""

from hashlib import sha256

import jsonschema
import numpy as np
import pytest
from PIL import Image

import haptix
from haptix.base.errors import InputError
from haptix.feel import materials
from haptix.feel.gallery import ASSETS, FAMILIES, FOLDER, load, preset, presets
from haptix.feel.materials.picture import picture
from haptix.feel.motion import Trajectory
from haptix.play.simulation import Setting, simulate
from tests import programs

NAMES = [one.name for one in presets()]
SCHEMA = jsonschema.Draft202012Validator(materials.schema())
T = np.arange(0, 0.25, 0.005)


@pytest.fixture(scope="module")
def surface(model):
    scene = {"normal_force_n": (0.2, 1.2), "frequency_hz": 4000.0}
    return haptix.FrictionSurface.build(model, scene, tolerance=1e-3)


def test_there_is_a_preset_or_more_of_each_family_and_every_asset_is_used():
    assert len(NAMES) >= 30
    assert {one.family for one in presets()} == set(FAMILIES)
    assert all(one.title and one.help.endswith(".") for one in presets())
    assert len({one.title for one in presets()}) == len(NAMES)
    texts = "".join(path.read_text() for path in FOLDER.glob("*.json"))
    for path in ASSETS.iterdir():
        assert sha256(path.read_bytes()).hexdigest() == path.stem
        assert path.stem in texts
    with pytest.raises(InputError, match="corduroy"):
        load("gallery:velvet")


@pytest.mark.parametrize("name", NAMES)
def test_a_preset_is_a_document_that_asks_for_what_a_screen_can_give(name):
    one = preset(name)
    SCHEMA.validate(one.document)
    # An effect asks for a change over the friction without voltage, the others for a share.
    target = one.material.evaluator.target
    assert target == ("contrast" if one.document["kind"] == "effect" else "share")
    wanted = picture(one.material, one.width_mm, one.height_mm, 120, sweeps=True)
    # 0.005 beyond: a tenth of a JND at most where the whole range has 20.
    share = float((np.abs(wanted - 0.5) <= 0.505).mean())
    assert share == pytest.approx(one.reachable, abs=0.005)
    assert share > 0.95
    # A share of a range of 2 JND, or a JND: something is felt. The closer look is for what is finer
    # than a pixel.
    least = 0.2 if target == "share" else 0.11
    looks = [(one.width_mm, one.height_mm), (8.0, 6.0)]
    assert (
        max(np.ptp(picture(one.material, *size, 40, 0.06, sweeps=True)) for size in looks) > least
    )


def felt(name, model, surface):
    """The simulation of a stroke of a quarter of a second across a preset."""
    one = preset(name)
    x = np.linspace(0.02, 0.98, len(T)) * min(one.width_mm, 40.0)
    # Off the middle, where a dial has its hub and the islands their gap; the force presses.
    path = Trajectory(T, x, np.full_like(T, 0.3 * one.height_mm), np.linspace(0.4, 1.0, len(T)))
    return simulate(Setting(model, one.material, path), surface)


@pytest.mark.parametrize(
    "name",
    [
        name if name in ("brick", "button") else pytest.param(name, marks=pytest.mark.slow)
        for name in NAMES
    ],
)
def test_a_preset_is_felt_by_the_virtual_finger_as_it_asks(name, model, surface):
    found = felt(name, model, surface)
    above = (found.felt.mu - found.lowest_mu)[found.felt.is_sliding]
    assert np.percentile(above / (0.11 * found.lowest_mu[found.felt.is_sliding]), 99) > 0.5
    assert found.evaluation.error_p95_jnd < 0.05  # as for all kinds, see test_kinds
    assert found.evaluation.evaluated > 0.9 * found.evaluation.samples


def test_thumbnails_are_those_of_the_documents():
    script = programs.load("scripts/gallery_thumbnails.py")
    assert {path.stem for path in (FOLDER / "thumbnails").iterdir()} == set(NAMES)
    for name in ("comb", "coin", "honey", "islands"):
        drawn = Image.open(FOLDER / "thumbnails" / f"{name}.png").convert("RGB")
        again = script.thumbnail(preset(name)).convert("RGB")
        assert drawn.size == again.size
        away = np.abs(np.asarray(drawn, float) - np.asarray(again, float))
        assert away.mean() < 1  # of 255: readers of photographs differ in the last bit
