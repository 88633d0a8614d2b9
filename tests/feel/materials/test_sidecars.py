"""The JSON beside a photograph: there and back, and what is refused."""

import json

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from skimage.io import imsave

from haptix import HaptixError, InputError, Texture
from haptix.base.errors import FileFormatError
from haptix.feel.materials import Sidecar

GREY = np.random.default_rng(5).integers(0, 256, (24, 32)).astype(np.uint8)
MINIMAL = {"width_mm": 40, "polarity": "dark-high"}


@pytest.fixture
def photograph(tmp_path):
    imsave(tmp_path / "brick.png", GREY, check_contrast=False)
    return tmp_path / "brick.png"


def beside(photograph, fields):
    text = fields if isinstance(fields, str) else json.dumps(fields)
    photograph.with_suffix(".json").write_text(text)
    return photograph


ranges = st.one_of(
    st.tuples(st.just("share"), st.floats(0, 0.4), st.floats(0.5, 1)),
    st.tuples(st.just("mu"), st.floats(0, 0.4), st.floats(0.5, 9)),
    st.tuples(st.just("contrast"), st.floats(-1, 0.4), st.floats(0.5, 9)),
)


@settings(deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.floats(0.1, 1e4), st.sampled_from(["bright-high", "dark-high"]), ranges)
def test_there_and_back(tmp_path, width_mm, polarity, ends):
    target, low, high = ends
    told = Sidecar(width_mm=width_mm, polarity=polarity, target=target, low=low, high=high)
    told.save(tmp_path / "one.json")
    assert Sidecar.load(tmp_path / "one.json") == told
    assert json.loads((tmp_path / "one.json").read_text())["schema_version"] == 1


def test_a_photograph_is_felt_as_its_sidecar_says(photograph):
    beside(photograph, MINIMAL)
    share = Texture.load(photograph)
    expected = Texture.from_image(photograph, 40, "dark-high")
    assert (share.width_mm, share.target, share.low, share.high) == (40, "share", 0, 1)
    np.testing.assert_array_equal(share.level, expected.level)

    beside(photograph, {**MINIMAL, "target": "mu", "low": 0.2, "high": 0.5, "width_mm": "6 cm"})
    absolute = Texture.load(str(photograph))
    assert (absolute.width_mm, absolute.target) == (60, "mu")
    assert (absolute.target, absolute.low, absolute.high) == ("mu", 0.2, 0.5)

    beside(photograph, {**MINIMAL, "target": "contrast", "low": -0.1, "high": 0.2})
    contrast = Texture.load(photograph)
    assert contrast.target == "contrast"
    # At a pixel's centre: 40 mm over 32 pixels.
    assert contrast.friction(2.5 * 1.25, 4.5 * 1.25) == pytest.approx(
        -0.1 + 0.3 * expected.level[4, 2], abs=1e-12
    )


@pytest.mark.parametrize(
    ("fields", "complaint"),
    [
        ({**MINIMAL, "wdith": 3}, "wdith"),
        ({"width_mm": 40}, "polarity"),
        ({"polarity": "bright-high"}, "width_mm"),
        ({**MINIMAL, "width_mm": -1}, "width_mm"),
        ({**MINIMAL, "width_mm": True}, "width_mm"),
        ({**MINIMAL, "width_mm": "40 V"}, "width_mm"),
        ({**MINIMAL, "polarity": "up"}, "polarity"),
        ({**MINIMAL, "target": "force"}, "target"),
        ({**MINIMAL, "target": "mu"}, "low and high"),
        ({**MINIMAL, "target": "mu", "low": 0.2}, "low and high"),
        ({**MINIMAL, "low": 0.8, "high": 0.2}, "low, high"),
        ({**MINIMAL, "low": "0.8"}, "low"),
        ({**MINIMAL, "schema_version": 2}, "schema_version"),
        ("[1, 2]", "JSON object"),
        ("{", "JSON"),
        ('{"width_mm": NaN, "polarity": "bright-high"}', "NaN"),
        ("[" * 100_000, "JSON"),
    ],
)
def test_bad_sidecars(photograph, fields, complaint):
    with pytest.raises(HaptixError, match=complaint) as caught:
        Texture.load(beside(photograph, fields))
    message = str(caught.value)
    assert "brick.json" in message
    assert "\n" not in message


def test_missing_files(photograph, tmp_path):
    with pytest.raises(FileFormatError, match=r"brick\.json.*width_mm"):
        Texture.load(photograph)
    beside(photograph, MINIMAL)
    photograph.unlink()
    with pytest.raises(InputError, match=r"brick\.png"):
        Texture.load(photograph)
    with pytest.raises(FileFormatError, match="cannot write"):
        Sidecar(**MINIMAL).save("/dev/null/such.json")
