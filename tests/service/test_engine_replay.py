"""A new engine is told what the one before knew: the same is felt, and nothing is armed by it."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from haptix.base.errors import InputError
from haptix.service.engine.session_layout import RegionError, SessionLayout
from haptix.service.front.engine_process import EngineReplay
from tests.service.test_layouts import felt, region

NAMES = st.sampled_from(["a", "b", "c"])
PLACES = st.sampled_from([0.0, 7.0, 30.0])
SLIDER = {"material": {"kind": "slider"}, "x_mm": 60.0, "width_mm": 70.0, "height_mm": 10.0}
OTHER = region("x", level=0.7)["material"]
FIELDS = st.one_of(
    st.builds(lambda x: {"op": "add", **region("", x, 0.3)}, PLACES),
    st.just({"op": "add", **SLIDER}),
    st.builds(lambda x: {"op": "move", "x_mm": x, "over_s": 0.0}, PLACES),
    st.builds(lambda z: {"op": "change", "z": z}, PLACES),
    st.just({"op": "change", "material": OTHER}),
    st.builds(lambda value: {"op": "value", "value": value}, st.floats(0, 1)),
    st.just({"op": "remove"}),
)
CHANGES = st.builds(lambda name, fields: {**fields, "name": name}, NAMES, FIELDS)


def values(layout):
    """Value of each control."""
    found = {}
    for name, placed in layout.regions.items():
        try:
            found[name] = placed.value
        except InputError:
            found[name] = None
    return found


@settings(max_examples=50)
@given(st.lists(st.lists(CHANGES, min_size=1, max_size=3), max_size=8))
def test_the_layout_of_a_new_engine_is_the_old_one_s(tmp_path_factory, changes):
    folder = tmp_path_factory.getbasetemp()
    replay, layout = EngineReplay(), SessionLayout(folder)
    document = {"regions": [region("a"), region("b", 5.0, 0.8)]}
    layout.set(document)
    replay.record("layout_set", {"session": 3, "document": document})
    for ops in changes:
        try:
            layout.change(ops)
        except InputError:
            continue  # it was refused, so nobody took note
        replay.record("layout_change", {"session": 3, "ops": ops})
    ((do, message),) = replay.messages()
    assert (do, message["session"], message["revision"]) == ("layout_restore", 3, layout.revision)
    new = SessionLayout(folder)
    new.set(message["document"])
    new.change(
        [{"op": "value", "name": name, "value": one} for name, one in message["values"].items()]
    )
    assert set(new.regions) == set(layout.regions)
    assert values(new) == values(layout)
    for x_mm in (3.0, 8.0, 33.0):
        assert felt(new, x_mm) == felt(layout, x_mm)


def test_settings_and_layouts_are_kept_and_others_forgotten():
    replay = EngineReplay()
    for session in (1, 2):
        replay.record("layout_set", {"session": session, "document": {"regions": []}})
    for do, fields in [
        ("forget", {"session": 2}),
        ("intensity", {"value": 0.4}),
        ("intensity", {"value": 0.5}),
        ("mute", {"on": True}),
        ("sense", {"on": True}),
        ("arm", {"session": 1}),
        ("stop", {"reason": "x"}),
    ]:
        replay.record(do, fields)
    (first, layout), *settings = replay.messages()
    assert (first, layout["session"]) == ("layout_restore", 1)
    on = {"on": True}
    assert settings == [("intensity", {"value": 0.5}), ("mute", on), ("sense", on)]


def test_a_value_is_set_once_all_other_changes_hold(tmp_path):
    layout = SessionLayout(tmp_path)
    layout.set({"regions": [{"name": "volume", **SLIDER}, region("plain", 50.0)]})
    layout.change([{"op": "value", "name": "volume", "value": 0.25}])
    assert layout.regions["volume"].value == 0.25
    bad = {"op": "value", "name": "plain", "value": 0.5}
    with pytest.raises(RegionError, match="expected a control") as caught:
        layout.change([{"op": "value", "name": "volume", "value": 0.75}, bad])
    assert caught.value.path == "/ops/1"
    assert layout.regions["volume"].value == 0.25
