"""A session's layout: documents and changes, all of them or none."""

from hashlib import sha256

import numpy as np
import pytest
from PIL import Image

from haptix.feel.materials.pyramid import Pyramid
from haptix.feel.motion import Motion
from haptix.service.engine.session_layout import RegionError, SessionLayout

PLAIN = {"kind": "grating", "period_mm": 2.0, "low": 0.5, "high": 0.5 + 1e-6}


def region(name, x_mm=0.0, level=0.5, **fields):
    material = PLAIN | {"low": level, "high": level + 1e-6}
    return {
        "name": name, "material": material, "x_mm": x_mm, "width_mm": 10.0, "height_mm": 10.0,
    } | fields  # fmt: skip


def felt(layout, x_mm, y_mm=5.0):
    """Friction at a place at rest there, without a renderer: changes are there at once."""
    at = np.array([x_mm])
    motion = Motion(1, 1, at, np.array([y_mm]), np.array([0.5]), 0.01, 1e-3)
    return round(float(layout.layout.wanted(motion)[0]), 5)


@pytest.fixture
def layout(tmp_path):
    layout = SessionLayout(tmp_path)
    layout.set({"regions": [region("left"), region("right", 20.0, 0.8)]})
    return layout


def test_a_document_is_felt_where_its_regions_are(layout):
    assert [felt(layout, x) for x in (5.0, 15.0, 25.0)] == [0.5, 0.0, 0.8]
    assert layout.revision == 1


def test_a_second_document_replaces_the_first(layout):
    layout.set({"regions": [region("other", 40.0, 0.3)]})
    assert [felt(layout, x) for x in (5.0, 45.0)] == [0.0, 0.3]
    assert set(layout.regions) == {"other"}


def test_a_photograph_is_made_ready_once_and_before_it_is_felt(tmp_path, monkeypatch):
    """24 megapixels take seconds each time; also where another material moves them."""
    made, begin = [], Pyramid.__init__
    monkeypatch.setattr(Pyramid, "__init__", lambda *of: [made.append(1), begin(*of)][1])
    pixels = np.arange(256, dtype=np.uint8).reshape(16, 16)
    Image.fromarray(pixels).save(tmp_path / "a.png")
    digest = sha256((tmp_path / "a.png").read_bytes()).hexdigest()
    (tmp_path / "a.png").rename(tmp_path / f"{digest}.png")
    photograph = {"kind": "photograph", "file": f"sha256:{digest}", "width_mm": 10}
    moving = {"kind": "moving", "of": photograph | {"width_mm": 9}, "velocity_mm_s": [1, 0]}
    layout = SessionLayout(tmp_path)
    for name, material in (("still", photograph), ("moves", moving)):
        made.clear()
        add = {"op": "add", "name": name, "material": material, "width_mm": 10, "height_mm": 10}
        layout.change([add])
        assert len(made) == 1
    felt(layout, 5.0)
    assert len(made) == 1


def test_changes_of_each_kind(layout):
    layout.change(
        [
            {"op": "remove", "name": "left"},
            {"op": "move", "name": "right", "x_mm": 60.0, "over_s": 0.0},
            {"op": "add", **region("left", 0.0, 0.2)},
            {"op": "change", "name": "right", "material": PLAIN | {"low": 0.9, "high": 0.9 + 1e-6}},
        ]
    )
    assert [felt(layout, x) for x in (5.0, 25.0, 65.0)] == [0.2, 0.0, 0.9]


@pytest.mark.parametrize(
    ("bad", "words"),
    [
        ({"op": "remove", "name": "nobody"}, "name of a region"),
        ({"op": "add", **region("right")}, "name that no region has"),
        ({"op": "add", **region("new", material={"kind": "lava"})}, "material.kind"),
        ({"op": "add", **region("new", material={"kind": "photograph", "file": "/etc/passwd",
                                                 "width_mm": 10.0})}, "sha256"),
        ({"op": "change", "name": "right", "opacity": 2.0}, "opacity"),
    ],
)  # fmt: skip
def test_one_bad_change_changes_nothing(layout, bad, words):
    with pytest.raises(RegionError, match=words) as caught:
        layout.change([{"op": "remove", "name": "left"}, bad])
    assert caught.value.path == "/ops/1"
    assert [felt(layout, x) for x in (5.0, 25.0)] == [0.5, 0.8]
    assert set(layout.regions) == {"left", "right"} and layout.revision == 1
    with pytest.raises(RegionError) as caught:
        layout.set({"regions": [region("a"), region("a")]})
    assert caught.value.path == "/document/regions/1"
    assert [felt(layout, x) for x in (5.0, 25.0)] == [0.5, 0.8]
