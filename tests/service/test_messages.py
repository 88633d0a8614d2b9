"""Every message is read or refused by name; nothing else comes out."""

import json
import re
import string
from contextlib import suppress
from math import inf, nan

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from haptix.base.files import parse_json
from haptix.play.render.master import MOST_EFFECTS
from haptix.service.protocol.messages import Limits, Problem, reading
from haptix.service.protocol.messages.reading import REPLIES
from tests.clients.golden import GOLDEN

SCALARS = st.sampled_from([None, True, -1, 0, 7, 2**60, 1.5, nan, inf, "", "1", "up", [], {}])
JSON_VALUES = SCALARS | st.lists(
    st.dictionaries(
        st.sampled_from(["t_s", "x_mm", "kind", "op", "region", "fields", "volts"]),
        SCALARS,
        max_size=4,
    ),
    max_size=2,
)
TYPES = [
    *("hello", "acquire", "release", "arm", "stop", "inventory", "bye", "geometry"),
    *("touch", "layout_set", "layout_change", "play", "cancel", "intensity", "mute", "pause"),
    *("subscribe", "pong"),
]


@given(
    st.sampled_from(TYPES),
    st.dictionaries(
        st.sampled_from(
            ["id", "touches", "value", "on", "n", "clock_s", "ops", "document", "effect"]
        ),
        JSON_VALUES,
    ),
)
def test_any_object_is_read_or_refused(kind, fields):
    text = json.dumps({"type": kind, **fields})
    try:
        message = reading.read_client(text)
    except Problem as problem:
        assert problem.code in ("message", "limit") and str(problem)
        assert problem.path == "" or problem.path.startswith("/")
    else:
        # What was read says the same when written: no field was dropped or turned into another.
        assert reading.read_client(message.model_dump_json()) == message


#: What JSON can say, and the reader of the engine and of the workers refuses.
HOSTILE = ["NaN", "Infinity", "-Infinity", "1e400", str(2**70), r'"a\u0000b"', r'"\ud800"']


def leaves(value, path=()):
    """The way to each value that has no values, and to each key."""
    if isinstance(value, dict):
        for key, inner in value.items():
            yield from leaves(inner, (*path, key))
    elif isinstance(value, list):
        for number, inner in enumerate(value):
            yield from leaves(inner, (*path, number))
    else:
        yield path


def with_leaf(value, path, mark):
    """A copy in which a mark takes the place of a leaf."""
    if not path:
        return mark
    copy = dict(value) if isinstance(value, dict) else list(value)
    copy[path[0]] = with_leaf(copy[path[0]], path[1:], mark)
    return copy


DOCUMENT = {
    "regions": [
        {
            "name": "a", "x_mm": 1.0, "y_mm": 1.0, "width_mm": 9.0, "height_mm": 9.0,
            "material": {"kind": "grating", "wavelength_mm": 1.0, "signal": {"kind": "sine"}},
        }
    ],
}  # fmt: skip
SENT = [
    {"type": "layout_set", "id": 1, "document": DOCUMENT},
    {"type": "play", "id": 1, "effect": {"kind": "transient", "width_s": 0.01}},
    {
        "type": "layout_change",
        "id": 1,
        "ops": [
            {"op": "change", "name": "a", "material": {"kind": "uniform", "level": 0.1}},
            {"op": "add", **DOCUMENT["regions"][0]},
        ],
    },
    {"type": "intensity", "id": 1, "value": 0.5},
]


@pytest.mark.parametrize("sent", SENT, ids=lambda sent: sent["type"])
@pytest.mark.parametrize("hostile", HOSTILE)
def test_what_is_read_is_what_the_engine_reads_too(sent, hostile):
    """One message that its reader refuses would end the engine that all clients share."""
    reading.read_client(json.dumps(sent))
    for path in leaves(sent):
        text = json.dumps(with_leaf(sent, path, "@")).replace('"@"', hostile)
        with suppress(Problem):
            parse_json(json.dumps(reading.read_client(text).model_dump(mode="json")))


@given(st.text(alphabet=string.printable, max_size=60))
def test_any_text_is_refused(text):
    with pytest.raises(Problem):
        reading.read_client(text)


CHANGE = '{"type": "layout_change", "id": 1, "ops": [%s]}'
MATERIAL = "/ops/0/add/material"


@pytest.mark.parametrize(
    ("text", "path", "words"),
    [
        ('{"type": "arm", "id": 1, "voltage_v": 200}', "/voltage_v", "unknown key"),
        ('{"type": "intensity", "id": 1, "value": 1.5}', "/value", "less than or equal to 1"),
        ('{"type": "intensity", "id": 1, "value": NaN}', "/value", "value"),
        ('{"type": "touch", "touches": [{"t_s": "now"}]}', "/touches/0/t_s", '"now"'),
        ('{"type": "arm", "id": "1"}', "/id", "valid integer"),
        ('{"type": "arm", "id": 0}', "/id", "greater than"),
        ('{"type": "arm"}', "/id", "required"),
        ('{"type": "fly", "id": 1}', "/type", "'hello'"),
        ('{"id": 1}', "/type", "key type"),
        ('["arm"]', "/type", "an object"),
        ("{", "", "JSON"),
        (CHANGE % '{"op": "fly"}', "/ops/0/op", "unknown op: expected one of 'add'"),
        (CHANGE % '{"name": "a"}', "/ops/0/op", "the key op"),
        (CHANGE % '"add"', "/ops/0", "should be a.* object"),
        (CHANGE % '{"op": "add", "name": "a", "material": "noise"}', MATERIAL, "object"),
        ('{"type": "play", "id": 1, "effect": "tick"}', "/effect", 'object, got "tick"'),
        ('{"type": "subscribe", "id": 1, "streams": ["friction"]}', "/streams", "object"),
    ],
)
def test_the_field_is_named(text, path, words):
    with pytest.raises(Problem, match=words) as caught:
        reading.read_client(text)
    assert caught.value.path == path


@pytest.mark.parametrize("text", ['{"a":' * 17 + "1" + "}" * 17, "[" * 60_000, " " * (2**20 + 1)])
def test_depth_and_length_are_bounded(text):
    with pytest.raises(Problem) as caught:
        reading.read_client(text)
    assert caught.value.code == "limit"


@pytest.mark.parametrize(
    "inner",
    [
        '"document": {"regions": [' + "0," * 400_000 + "0]}",
        ", ".join(f'"{number}": 0' for number in range(60_000)),
        '"a": ' + "[]" * 300_000,
        '"a": ' + '"' * 900_000,
    ],
    ids=["values", "keys", "brackets", "quotes"],
)
def test_what_would_take_long_to_refuse_is_not_parsed(inner, monkeypatch):
    """Seconds in which nobody's stop would be read."""
    text = '{"type": "layout_set", "id": 7, ' + inner + "}"
    monkeypatch.setattr(reading, "CLIENT", None)
    monkeypatch.setattr(reading, "_depth", None)
    monkeypatch.setattr("haptix.service.protocol.messages.reading.json.loads", None)
    with pytest.raises(Problem, match="16384 keys, 32768 lists and 100000 values") as caught:
        reading.read_client(text)
    assert (caught.value.code, reading.id_of(text)) == ("limit", 7)


@pytest.mark.parametrize(
    ("kind", "field"), [("layout_set", "regions"), ("layout_change", "ops"), ("touch", "touches")]
)
def test_the_first_wrong_part_of_many_is_told_and_no_other_one_looked_at(kind, field):
    parts = {field: [0] * 90_000}
    fields = {"document": parts} if kind == "layout_set" else parts
    with pytest.raises(ValidationError) as caught:
        reading.CLIENT.validate_json(json.dumps({"type": kind, "id": 1, **fields}))
    assert caught.value.error_count() <= 2  # and, without it, that there are too few


def test_the_largest_layout_that_there_may_be_is_read():
    waves = {"kind": "sum", "parts": [{"kind": "sine", "period_mm": 2.0, "phase": 0.1}] * 4}
    place = {"x_mm": 0.0, "y_mm": 0.0, "width_mm": 9.0, "height_mm": 9.0, "opacity": 1.0}
    regions = [{"name": f"{number}", "material": waves, **place} for number in range(256)]
    text = json.dumps({"type": "layout_set", "id": 1, "document": {"regions": regions}})
    assert len(reading.read_client(text).document.regions) == 256


def test_brackets_in_strings_do_not_nest():
    text = json.dumps({"type": "hello", "id": 1, "protocol": "1.0", "client": '"[{' * 20})
    assert reading.read_client(text).client == '"[{' * 20


@pytest.mark.parametrize("text", ["", "{", "[]", '{"id": true}', '{"id": -3}', '{"id": 1e3}'])
def test_a_broken_message_has_the_id_zero(text):
    assert reading.id_of(text) == 0


@settings(max_examples=20)
@given(st.integers(1, 2**53))
def test_a_refused_message_keeps_its_id(number):
    assert reading.id_of(json.dumps({"type": "fly", "id": number})) == number


def test_no_message_speaks_of_volts():
    """No volts over the network: neither asked nor told."""
    names = {
        name
        for part in reading.schema()["$defs"].values()
        for name in part.get("properties", {})
        if name.endswith("_v") or "volt" in name
    }
    assert names == set()


def test_the_docs_have_each_state_of_the_output():
    states = reading.schema()["$defs"]["Output"]["properties"]["state"]["enum"]
    page = (GOLDEN.parents[1] / "docs" / "service.md").read_text()
    assert re.findall(r"^\| `(\w+)` \| .* \| (?:yes|no) \|", page, re.MULTILINE) == states


def test_asyncapi_names_every_message_and_every_reference_leads_somewhere():
    document = reading.asyncapi()
    sides = {"ClientMessage": "receive", "ServerMessage": "send"}
    for side, action in sides.items():
        for kind in reading.schema()["$defs"][side]["discriminator"]["mapping"]:
            assert document["operations"][f"{action}_{kind}"]["action"] == action
    for reference in re.findall(r'"#/([^"]+)"', json.dumps(document)):
        found = document
        for part in reference.split("/"):
            found = found[part]


def test_replies_are_those_of_the_page_for_writers_of_clients():
    page = (GOLDEN.parents[1] / "docs" / "clients.md").read_text()
    rows = re.findall(r"^\| (`[a-z_`, ]+?)(?: with `id`)? \| `([a-z_]+)` \|$", page, re.MULTILINE)
    told = {kind: reply for kinds, reply in rows for kind in re.findall(r"`([a-z_]+)`", kinds)}
    assert told == REPLIES


def test_discriminators_of_asyncapi_are_names():
    """As its schema has them, version 3.0: `discriminator` is a string."""
    found = []

    def look(part):
        if isinstance(part, dict):
            found.extend([part["discriminator"]] if "discriminator" in part else [])
            part = [*part.values()]
        for item in part if isinstance(part, list) else []:
            look(item)

    look(reading.asyncapi())
    assert set(found) == {"op"}


def test_the_limit_of_effects_is_that_of_the_renderer():
    assert Limits().effects == MOST_EFFECTS
