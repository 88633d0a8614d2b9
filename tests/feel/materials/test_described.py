"""What a panel gets of each field: enough to draw it, and never a value that the kind refuses."""

import pytest

from haptix.base.errors import InputError
from haptix.feel.materials import KINDS, material_of, schema

SCHEMA = schema()
DEFINITIONS = {kind: SCHEMA["$defs"][model.__name__] for kind, model in KINDS.items()
               if model.__module__.startswith("haptix.")}  # fmt: skip
NEEDED: dict[str, dict[str, str | float]] = {
    "photograph": {"file": "a.png", "width_mm": 40.0},
    "heights": {"file": "a.png", "width_mm": 40.0},
    "recording": {"file": "a.csv"},
    "penn": {"file": "a.xml"},
    "relief": {"heights": "a.png", "width_mm": 40.0},
    "grating": {"period_mm": 2.0},
    "effect": {"name": "tick"},
}


def fields(kind):
    named = DEFINITIONS[kind]["properties"].items()
    return {name: field for name, field in named if name not in ("kind", "schema_version")}


@pytest.mark.parametrize("kind", DEFINITIONS)
def test_every_field_has_a_title_and_help_and_numbers_a_step_within_a_range(kind):
    assert DEFINITIONS[kind]["description"].endswith(".")
    for name, field in fields(kind).items():
        assert field["title"]
        assert len(field["description"]) > 8, name
        if "x-range" in field:
            low, high = field["x-range"]
            assert 0 < field["x-step"] <= (high - low) / 4, name
            default = field.get("default")
            assert default is None or low <= default <= high, name
        for end, unit in (("_mm", "mm"), ("_n", "N"), ("_deg", "°"), ("_mm_s", "mm/s")):
            if name.endswith(end):
                assert field["x-unit"] == unit


@pytest.mark.parametrize(
    ("kind", "name"),
    [(kind, name) for kind in DEFINITIONS for name, field in fields(kind).items()
     if "x-range" in field],
)  # fmt: skip
def test_both_ends_of_a_range_are_taken_or_refused_for_another_field(kind, name):
    """A slider at its end may break a rule between two fields, but never that of its own."""
    for value in fields(kind)[name]["x-range"]:
        try:
            material_of({"kind": kind, **NEEDED.get(kind, {}), name: value})
        except InputError as error:
            assert "should be" not in str(error), error  # a limit of the field itself


def test_units_and_steps_of_one_kind_as_a_person_would_give_them():
    period = fields("grating")["period_mm"]
    assert (period["title"], period["x-unit"], period["x-step"]) == ("Period", "mm", 0.1)
    assert fields("slider")["detents"]["x-step"] == 1
    assert fields("grating")["low"]["x-range"] == [0.0, 1.0]
