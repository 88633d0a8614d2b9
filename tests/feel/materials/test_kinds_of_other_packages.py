"""Kinds that other packages bring are found in Python and on the command line."""

import json
import subprocess
import sys
from importlib.metadata import EntryPoint

import pytest

from haptix.base.errors import InputError
from haptix.base.kinds import Kinds
from tests.feel.materials.strangers_kind import installed


@pytest.fixture(scope="module")
def environment(tmp_path_factory):
    return installed(tmp_path_factory.mktemp("stranger"))


def run(environment, *command):
    return subprocess.run(
        [sys.executable, *command], capture_output=True, text=True, check=True, env=environment
    )


def test_a_kind_of_another_package_is_found_in_python(environment, tmp_path):
    (tmp_path / "wool.toml").write_text('kind = "wool"\nloop_mm = "0.8 cm"\n')
    program = f"""
from haptix.feel import materials
from haptix.feel.motion import Motion
one = materials.load({str(tmp_path / "wool.toml")!r})
print(type(one).__module__, one.loop_mm, one.wanted(Motion.of([0.0, 4.0], 0.0)).tolist())
print("wool" in materials.KINDS, materials.schema()["$defs"]["Wool"]["properties"]["loop_mm"])
"""
    first, second = run(environment, "-c", program).stdout.splitlines()
    assert first == "wool 8.0 [0.0, 1.0]"
    assert second.startswith("True")
    assert "Distance from one loop to the next." in second


@pytest.mark.slow  # a process with torch
def test_a_class_may_have_the_name_of_one_of_ours(environment):
    program = """
from typing import Literal
from haptix.feel import materials

class Button(materials.Material):
    kind: Literal["plain-button"] = "plain-button"
    warmth: float = 1.0
    def wanted(self, motion): return 0 * motion.x_mm

definitions = materials.schema()["$defs"]
for kind in ("button", "plain-button"):
    name = definitions["material"]["discriminator"]["mapping"][kind].rpartition("/")[2]
    print(kind, sorted({"press_n", "warmth"} & set(definitions[name]["properties"])))
"""
    lines = run(environment, "-c", program).stdout.splitlines()
    assert lines == ["button ['press_n']", "plain-button ['warmth']"]


@pytest.mark.slow  # a process with torch
def test_a_signal_of_another_package_is_found_in_materials_and_recipes(environment):
    program = """
from haptix.feel.materials import material_of
from haptix.feel import signal_from
one = signal_from({"kind": "fall", "value": 8, "half_s": 0.1}) + 1
print(type(one.parts[0]).__module__, one.values(0, 3, 10.0).tolist())
print(signal_from(one.describe()) == one, one.parts[0] == type(one.parts[0])(8, 0.1))
transient = material_of({"kind": "transient", "curve": {"kind": "fall", "value": 1, "half_s": 1}})
print(transient.describe()["curve"])
"""
    assert run(environment, "-c", program).stdout.splitlines() == [
        "wool [9.0, 5.0, 3.0]",
        "True True",
        "{'kind': 'fall', 'value': 1.0, 'half_s': 1.0, 'length_s': 1.0}",
    ]


@pytest.mark.slow
def test_a_kind_of_another_package_is_found_on_the_command_line(environment):
    found = run(environment, "-m", "haptix.tasks.cli", "material", "kinds", "--json").stdout
    rows = {row["kind"]: row for row in json.loads(found)}
    assert rows["wool"]["fields"]["loop_mm"] == "4.0"
    assert rows["wool"]["what"] == "Loops of a thread across the stroke."


@pytest.mark.parametrize(
    ("value", "message"),
    [
        ("not_installed:Wool", "kind wool: cannot be imported"),
        ("json:loads", "json:loads .* defines no such kind"),
    ],
)
def test_an_entry_point_that_brings_no_kind_is_named(monkeypatch, value, message):
    entry = EntryPoint("wool", value, "haptix.feel.materials")
    monkeypatch.setattr("haptix.base.kinds.entry_points", lambda group: [entry])
    kinds = Kinds("haptix.feel.materials", {})
    assert list(kinds) == ["wool"]
    with pytest.raises(InputError, match=message):
        kinds["wool"]
