"""What is made for the clients has every message, and is made anew when one changes."""

import json
import re
import runpy
import subprocess
import sys
import tarfile
import zipfile

import pytest

from haptix.service import messages as m
from haptix.version import __version__
from tests.made_clients import CSHARP, ROOT, TYPESCRIPT, make_clients

SIDES = ("ClientMessage", "ServerMessage")
SCRIPT = ROOT / "scripts" / "make-clients.py"


@pytest.fixture(scope="module", autouse=True)
def _made():
    make_clients()


def fields_of_the_schema():
    return {
        name: set(part["properties"])
        for name, part in m.schema()["$defs"].items()
        if "properties" in part
    }


def test_typescript_has_every_message_and_field():
    text = (TYPESCRIPT / "types" / "messages.d.ts").read_text()
    bodies = re.findall(r"^export interface (\w+) \{\n(.*?)^\}", text, re.MULTILINE | re.DOTALL)
    made = {name: set(re.findall(r"^  (\w+)\??:", body, re.MULTILINE)) for name, body in bodies}
    assert made == fields_of_the_schema()


def test_csharp_has_every_message_and_field():
    text = (CSHARP / "Messages.cs").read_text()
    bodies = re.findall(r"public partial class (\w+)\n(.*?)^    \}", text, re.MULTILINE | re.DOTALL)
    made = {name: set(re.findall(r'JsonProperty\("(\w+)"', body)) for name, body in bodies}
    expected = fields_of_the_schema()
    assert made == {name: expected[name] for name in made}
    definitions = m.schema()["$defs"]
    sides = (definitions[side]["discriminator"]["mapping"] for side in SIDES)
    messages = {path.rpartition("/")[2] for side in sides for path in side.values()}
    assert messages - made.keys() == {"LayoutSet", "LayoutChange"}  # programs give them as JSON


def test_the_description_of_the_session_is_todays():
    assert json.loads((ROOT / "clients" / "asyncapi.json").read_text()) == m.asyncapi()


def test_another_schema_is_another_source():
    script = runpy.run_path(str(SCRIPT))
    before = script["hash_of_sources"]()
    changed = m.schema()
    changed["$defs"]["Hello"]["properties"]["mood"] = {"type": "string"}
    script["hash_of_sources"].__globals__["schema"] = lambda: changed
    assert script["hash_of_sources"]() != before


def test_a_release_has_the_clients_with_what_was_made(tmp_path):
    command = [sys.executable, SCRIPT, "--pack", tmp_path]
    subprocess.run(command, check=True, capture_output=True)
    names = {path.name for path in tmp_path.iterdir()}
    packed, zipped = f"haptix-client-{__version__}.tgz", f"haptix-client-csharp-{__version__}.zip"
    assert names == {packed, zipped, f"haptix-asyncapi-{__version__}.json"}
    with tarfile.open(tmp_path / packed) as file:
        assert {"package/src/haptix.js", "package/types/messages.d.ts"} <= set(file.getnames())
        assert not [name for name in file.getnames() if "test" in name or "node_modules" in name]
    with zipfile.ZipFile(tmp_path / zipped) as file:
        assert {"Haptix/Messages.cs", "Haptix/link.xml"} <= set(file.namelist())
        assert not [name for name in file.namelist() if "Test" in name]
