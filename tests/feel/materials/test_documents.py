"""Documents of materials: read, written and refused, and what they answer."""

import json
import re
from hashlib import sha256
from pathlib import Path
from typing import Any, Literal

import jsonschema
import numpy as np
import pytest
from skimage.io import imsave

from haptix import Layout
from haptix.base.errors import FileFormatError, InputError
from haptix.base.kinds import in_folder
from haptix.feel import materials
from haptix.feel.materials import (
    KINDS,
    Grating,
    Material,
    Noise,
    PennModel,
    RecordedProfile,
    Texture,
    material_of,
    power_law,
)
from haptix.feel.materials.material import table_of
from haptix.feel.motion import Depends, Motion
from haptix.feel.signals.signal import KINDS as SIGNALS

MODEL = Path(materials.__file__).parents[3] / "examples" / "materials" / "made-up.xml"
GRATING = {"kind": "grating", "period_mm": 2.0, "wave": "square", "low": 0.1, "high": 0.9}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder with a photograph and a recording."""
    folder = tmp_path_factory.mktemp("materials")
    pixels = np.random.default_rng(1).integers(0, 255, (40, 60), dtype=np.uint8)
    imsave(folder / "stone.png", pixels, check_contrast=False)
    (folder / "felt.csv").write_text("position_mm,mu\n0,0.2\n1,0.4\n2,0.3\n")
    return folder


def still(folder):
    """Documents of kinds that stand still, and the field that each is."""
    stone, grating = folder / "stone.png", Grating(period_mm=2.0, wave="square", low=0.1, high=0.9)
    photograph = {"kind": "photograph", "file": "stone.png", "width_mm": 30.0}
    return {
        "photograph": (photograph, Texture.from_image(stone, 30.0)),
        "heights": (
            {"kind": "heights", "file": "stone.png", "width_mm": 30.0, "rule": "slope-magnitude",
             "target": "mu", "low": 0.2, "high": 0.4},
            Texture.from_heights(stone, 30.0, "slope-magnitude", target="mu", low=0.2, high=0.4),
        ),
        "grating": (GRATING, grating),
        "noise": (
            {"kind": "noise", "pixels": 64, "seed": 3},
            Noise(spectrum=power_law(2.0, 0.5, 10.0), pixels=64, seed=3),
        ),
        "recording": (
            {"kind": "recording", "file": "felt.csv", "beyond": "hold"},
            RecordedProfile.from_csv(folder / "felt.csv", beyond="hold"),
        ),
        "penn": (
            {"kind": "penn", "file": str(MODEL), "speed_mm_per_s": 80.0},
            PennModel.load(MODEL).texture(speed_mm_per_s=80.0, normal_force_n=0.5),
        ),
        "layout": (
            {"kind": "layout", "background": photograph, "regions": [
                {"material": GRATING, "x_mm": 3.0, "width_mm": 9.0, "height_mm": 9.0}]},
            _on_stone(grating, stone),
        ),
    }  # fmt: skip


def _on_stone(grating, stone):
    layout = Layout(Texture.from_image(stone, 30.0))
    layout.add(grating, 3.0, 0.0, 9.0, 9.0)
    return layout


def written(folder, table, name="one.json"):
    with in_folder(folder):
        materials.material_of(table).save(folder / name)
    return folder / name


@pytest.mark.parametrize("kind", ["photograph", "heights", "grating", "noise", "recording",
                                  "penn", "layout"])  # fmt: skip
@pytest.mark.parametrize("ending", ["toml", "json"])
def test_a_still_kind_is_read_back_and_answers_as_its_field(folder, kind, ending):
    table, field = still(folder)[kind]
    path = written(folder, table, f"{kind}.{ending}")
    read = materials.load(path)
    assert materials.load(written(folder, table, f"again.{ending}")) == read
    x = np.linspace(-2, 32, 500)
    motion = Motion.of(x, 4.0, footprint_mm=0.05)
    assert read.evaluator.target == field.target
    assert read.evaluator.depends_on == Depends.PLACE
    np.testing.assert_array_equal(read.wanted(motion), field.wanted(motion))


def test_documents_of_one_photograph_share_its_levels(folder):
    table = {"kind": "photograph", "file": "stone.png", "width_mm": 30.0}
    here, there = written(folder, table), written(folder, table, "deeper.toml")
    digest = sha256((folder / "stone.png").read_bytes()).hexdigest()
    (folder / "assets").mkdir()
    (folder / "stone.png").rename(folder / "assets" / f"{digest}.png")
    try:
        by_hash = written(folder, {**table, "file": f"sha256:{digest}"}, "hash.json")
        one = materials.load(by_hash).evaluator
        with pytest.raises(InputError, match="no file at"):
            _ = materials.load(here).evaluator
    finally:
        (folder / "assets" / f"{digest}.png").rename(folder / "stone.png")
    assert materials.load(here).evaluator is one
    assert materials.load(there).evaluator is one
    assert materials.load(there).replace(width_mm=20.0).evaluator is not one
    (folder / f"{digest}.png").write_bytes(b"other")
    with pytest.raises(FileFormatError, match="its name"):
        _ = materials.load(by_hash).evaluator


def test_units_are_read_and_a_file_may_name_another(folder):
    (folder / "ribs.toml").write_text('kind = "grating"\nperiod_mm = "0.2 cm"\n')
    (folder / "all.toml").write_text('kind = "layout"\nbackground = "ribs.toml"\n')
    assert dict(materials.load(folder / "all.toml"))["background"].period_mm == 2.0


def test_what_was_asked_does_not_change_what_is_equal():
    path = {"t_s": [0, 1], "x_mm": [0, 3], "y_mm": [0, 0]}
    table = {"kind": "moving", "path": path, "of": {"kind": "by-speed", "speed_mm_s": [0, 9],
             "share": [0, 1], "of": {"kind": "slider"}}}  # fmt: skip
    asked, other = (materials.material_of(table) for _ in range(2))
    for one in (asked, other):
        one.wanted(Motion.of([1.0, 2.0], 3.0, 0.5))
    assert asked == other == materials.material_of(table)
    assert hash(asked) == hash(other)
    assert asked != asked.replace(turn_deg_s=1.0)


class Stripes(Material):
    """Stripes that are felt to the right only."""

    kind: Literal["test-stripes"] = "test-stripes"
    period_mm: float = 2.0
    depends_on = Depends.PLACE | Depends.DIRECTION

    def wanted(self, motion):
        """Friction where the finger goes right."""
        wave = np.sin(2 * np.pi * motion.x_mm / self.period_mm)
        return (0.5 + 0.5 * wave) * np.clip(motion.ux, 0, 1)


def test_a_kind_of_ones_own_is_a_document_like_all_others(folder):
    read = materials.load(written(folder, {"kind": "test-stripes", "period_mm": 3.0}))
    assert read == Stripes(period_mm=3.0)
    there, back = (read.wanted(Motion.of(0.75, 0.0, 0.0, v)) for v in (80.0, -80.0))
    assert there == pytest.approx(1.0, abs=1e-3)
    assert back == 0.0
    assert read.evaluator.depends_on == Depends.PLACE | Depends.DIRECTION
    with pytest.raises(TypeError, match="is that of"):

        class Other(Material):
            kind: Literal["grating"] = "grating"

            def wanted(self, motion):
                return motion.x_mm

    with pytest.raises(TypeError, match="expected a method"):

        class Mute(Material):
            kind: Literal["test-mute"] = "test-mute"


BAD = {
    "expected one of .*grating.*, got 'gratin'": {"kind": "gratin"},
    "expected one of .*, got None": {"period_mm": 3},
    "grating.period_mm: field required": {"kind": "grating"},
    "grating.period_mm: .*greater than 0, got -1": {"kind": "grating", "period_mm": -1},
    "grating.width: grating has no such field": {"kind": "grating", "period_mm": 1, "width": 2},
    "low, high: expected finite 0 <= low < high": {"kind": "grating", "period_mm": 1, "low": 1},
    "expected low and high for a target of mu": {"kind": "grating", "period_mm": 1, "target": "mu"},
    "expected 64 hex": {"kind": "photograph", "file": "sha256:12", "width_mm": 3},
    "layout.background: .*period_mm": {
        "kind": "layout", "background": {"kind": "grating", "period_mm": 0}
    },
}  # fmt: skip


@pytest.mark.parametrize("message", BAD)
def test_a_wrong_document_is_one_sentence_naming_the_field(folder, message):
    with pytest.raises(InputError) as error:
        materials.material_of(BAD[message])
    assert re.search(message, str(error.value)), error.value
    assert "\n" not in str(error.value)


def test_the_schema_accepts_and_refuses_what_the_models_do(folder):
    schema = materials.schema()
    jsonschema.Draft202012Validator.check_schema(schema)
    check = jsonschema.Draft202012Validator(schema)
    for table, _ in still(folder).values():
        with in_folder(folder):
            check.validate({"schema_version": 1, **table_of(material_of(table))})
    nested = {"kind": "layout", "background": {"kind": "grating", "period_mm": 0}}
    for bad in ({"kind": "gratin"}, {"kind": "grating"}, {**GRATING, "width": 2}, nested):
        assert not check.is_valid(bad)
    assert set(schema["$defs"]["material"]["discriminator"]["mapping"]) == set(KINDS)


def test_signals_stand_in_the_schema_like_materials():
    schema = materials.schema()
    assert set(schema["$defs"]["signal"]["discriminator"]["mapping"]) == set(SIGNALS)
    json.dumps(schema, allow_nan=False)  # a signal without end is "forever"
    check = jsonschema.Draft202012Validator(schema)
    sine = {"kind": "sine", "amplitude": 0.1, "frequency_hz": 50, "length_s": 1}
    for curve in (sine, {"kind": "sum", "parts": [0.2, {**sine, "length_s": "forever"}]}):
        check.validate({"kind": "transient", "curve": curve})
    for wrong in ({"kind": "sin"}, {"kind": "sine"}, {**sine, "wide": 2}, "sine"):
        assert not check.is_valid({"kind": "transient", "curve": wrong})


@pytest.mark.parametrize("name", ["bricks.png", "../bricks.png", "/etc/passwd"])
def test_a_sealed_folder_gives_no_file_by_its_path(tmp_path, name):
    fields = {"kind": "photograph", "file": name, "width_mm": 60.0}
    with in_folder(tmp_path, is_sealed=True):
        with pytest.raises(InputError, match="sha256"):
            material_of(fields)
        with pytest.raises(InputError, match="expected a table"):
            material_of(f"{name}.toml")


@pytest.mark.parametrize(
    ("table", "away", "shift"),
    [
        ({"kind": "dial"}, {"centre_mm": [7.0, -3.0]}, (7.0, -3.0)),
        ({"kind": "slider", "detents": [0, 4, 10]}, {"start_mm": 6.0}, (6.0, 0.0)),
    ],
)
def test_a_control_that_begins_elsewhere_is_the_same_control_moved(table, away, shift):
    here, there = material_of(table), material_of(table | away)
    x, y = np.random.default_rng(1).uniform(-20, 20, (2, 500))
    moved = Motion.of(x + shift[0], y + shift[1])
    np.testing.assert_allclose(there.wanted(moved), here.wanted(Motion.of(x, y)), atol=1e-9)
    assert np.ptp(here.wanted(Motion.of(x, y))) > 0.5
    assert np.subtract(there.extent_mm, here.extent_mm)[0] == pytest.approx(shift[0])


def test_a_table_may_have_units_as_a_file_may():
    rows = {
        "kind": "moving",
        "velocity_mm_s": ["2 cm/s", 0],
        "of": {"kind": "grating", "period_mm": "3 mm"},
    }
    material: Any = material_of(rows)
    assert (material.velocity_mm_s, material.of.period_mm) == ((20.0, 0.0), 3.0)
