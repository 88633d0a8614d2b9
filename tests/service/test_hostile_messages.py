"""No message of any kind ends the engine that all apps share, whatever its fields hold."""

import io
import json

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from haptix.base.files import parse_json
from haptix.service.engine.process import EngineServer
from haptix.service.protocol.messages import Problem, reading
from haptix.service.protocol.wire import HEADER, json_frame
from tests.service.test_messages import HOSTILE

SCHEMA = reading.CLIENT.json_schema()
KINDS = SCHEMA["discriminator"]["mapping"]
MATERIALS = [
    {"kind": "grating", "period_mm": 2.0},
    {"kind": "noise", "seed": 1, "pixels": 64},
    {"kind": "transient", "width_s": 0.01},
]


def values_of(schema, depth=0):
    """Strategy of values that a JSON Schema of our messages allows, or nearly."""
    if "$ref" in schema:
        return values_of(SCHEMA["$defs"][schema["$ref"].rpartition("/")[2]], depth)
    for union in ("anyOf", "oneOf"):
        if union in schema:
            return st.one_of([values_of(one, depth) for one in schema[union]])
    if "const" in schema:
        return st.just(schema["const"])
    if "enum" in schema:
        return st.sampled_from(schema["enum"])
    if schema["type"] == "object":
        return objects_of(schema, depth)
    if schema["type"] == "array":
        least = schema.get("minItems", 0)
        items = schema["prefixItems"][0] if "prefixItems" in schema else schema["items"]
        return st.lists(
            values_of(items, depth + 1),
            min_size=least,
            max_size=min(schema.get("maxItems", 3), least + 2),
        )
    low = schema.get("minimum", schema.get("exclusiveMinimum"))
    high = schema.get("maximum", schema.get("exclusiveMaximum"))
    return {
        "integer": st.integers(low, high),
        "number": st.floats(low, high, exclude_min="exclusiveMinimum" in schema, allow_nan=False),
        "boolean": st.booleans(),
        "string": st.just("1.0") if "pattern" in schema else st.sampled_from(["a", "b", "job"]),
        "null": st.none(),
    }[schema["type"]]


def objects_of(schema, depth):
    """Strategy of the objects of a schema; those without fields are documents of materials."""
    fields = schema.get("properties")
    if fields is None:
        named = schema.get("propertyNames", {}).get("enum")
        if named:
            inner = values_of(schema["additionalProperties"], depth + 1)
            return st.dictionaries(st.sampled_from(named), inner)
        return st.sampled_from(MATERIALS)
    required = schema.get("required", [])
    made = {name: values_of(inner, depth + 1) for name, inner in fields.items()}
    return st.fixed_dictionaries(
        {name: made[name] for name in fields if name in required},
        optional={name: made[name] for name in fields if name not in required},
    )


def leaves(value, path=()):
    """The way to each value that has no values."""
    inner = value.items() if isinstance(value, dict) else enumerate(value)
    for name, one in inner:
        if isinstance(one, (dict, list)):
            yield from leaves(one, (*path, name))
        else:
            yield (*path, name)


@st.composite
def hostile_texts(draw, kind):
    """The text of a message of a kind, in which a value or a key may be one that hurts."""
    message = draw(values_of({"$ref": KINDS[kind]}))
    if kind in ("mute", "pause", "sense", "release", "arm", "stop", "inventory", "bye"):
        message["type"] = kind
    message = json.loads(json.dumps(message))
    path = draw(st.sampled_from([(), *leaves(message)]))
    if not path:
        return json.dumps(message)
    place = message
    for part in path[:-1]:
        place = place[part]
    if isinstance(place, dict) and draw(st.booleans()):
        place["@"] = place.pop(path[-1])
    else:
        place[path[-1]] = "@"
    return json.dumps(message).replace('"@"', draw(st.sampled_from(HOSTILE)))


ASKED = {
    "layout_set": lambda fields: {"session": 1, "document": fields["document"]},
    "layout_change": lambda fields: {"session": 1, "ops": fields["ops"]},
    "play": lambda fields: {"effect": fields["effect"]},
    "cancel": lambda fields: {"effect_id": fields["effect_id"]},
    "intensity": lambda fields: {"value": fields["value"]},
}
PLACE = {"x_mm": 1.0, "y_mm": 1.0, "width_mm": 9.0, "height_mm": 9.0}
UNCHANGED = {"regions": [{"name": "other app", "material": MATERIALS[0], **PLACE}]}


@pytest.fixture(scope="module")
def engine(tmp_path_factory):
    """An engine in this process that holds the layout of another app."""
    server = EngineServer(io.BytesIO())
    server._assets = tmp_path_factory.mktemp("assets")
    asked = {"do": "layout_set", "session": 2, "document": UNCHANGED}
    assert server._answer(asked) == {"revision": 1}
    return server


@pytest.mark.parametrize("kind", sorted(KINDS))
@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(data=st.data())
def test_the_engine_answers_all_that_the_front_reads(engine, kind, data):
    text = data.draw(hostile_texts(kind))
    try:
        message = reading.read_client(text)
    except Problem as problem:
        assert problem.code in ("message", "limit") and str(problem)
        return
    fields = message.model_dump(mode="json", exclude_none=True)
    sent = parse_json(json_frame(fields)[HEADER.size :])  # as the engine reads it
    assert sent == fields
    if kind in ASKED:
        answer = engine._answer({"do": kind, **ASKED[kind](sent)})
        assert answer.get("problem", {}).get("code") != "internal", answer
    assert [*engine._layouts[2].regions] == ["other app"]
    assert engine._layouts[2].revision == 1
