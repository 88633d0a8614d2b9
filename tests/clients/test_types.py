"""What is made for the clients has every message, and is made anew when one changes."""

import json
import os
import re
import runpy
import shutil
import subprocess
import sys
import tarfile
import zipfile
from pathlib import Path

import pytest

from haptix.base.version import __version__
from haptix.service.protocol import messages as m
from haptix.service.protocol.messages import reading
from tests.made_clients import CSHARP, ROOT, TYPESCRIPT, make_clients, node_tools

SIDES = ("ClientMessage", "ServerMessage")
SCRIPT = ROOT / "scripts" / "make-clients.py"


@pytest.fixture(scope="module", autouse=True)
def _made():
    make_clients()


def fields_of_the_schema():
    return {
        name: set(part["properties"])
        for name, part in reading.schema()["$defs"].items()
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
    definitions = reading.schema()["$defs"]
    sides = (definitions[side]["discriminator"]["mapping"] for side in SIDES)
    messages = {path.rpartition("/")[2] for side in sides for path in side.values()}
    assert messages <= made.keys()


def test_the_description_of_the_session_is_todays():
    assert json.loads((ROOT / "clients" / "asyncapi.json").read_text()) == reading.asyncapi()


def test_another_schema_is_another_source():
    script = runpy.run_path(str(SCRIPT))
    before = script["hash_of_sources"]()
    changed = reading.schema()
    changed["$defs"]["Hello"]["properties"]["mood"] = {"type": "string"}
    script["hash_of_sources"].__globals__["schema"] = lambda: changed
    assert script["hash_of_sources"]() != before


@pytest.mark.slow
def test_a_release_has_the_clients_with_what_was_made(tmp_path):
    command = [sys.executable, SCRIPT, "--pack", tmp_path]
    subprocess.run(command, check=True, capture_output=True)
    names = {path.name for path in tmp_path.iterdir()}
    version = __version__.replace(".dev", "-dev.")  # as npm writes it
    packed, unity = f"haptix-client-{version}.tgz", f"com.haptix.client-{version}.tgz"
    assert names == {packed, unity, f"haptix-asyncapi-{__version__}.json"}
    with tarfile.open(tmp_path / packed) as file:
        assert {"package/src/haptix.js", "package/types/messages.d.ts"} <= set(file.getnames())
        assert not [name for name in file.getnames() if "test" in name or "node_modules" in name]
    with tarfile.open(tmp_path / unity) as file:
        files = {name.removeprefix("package/") for name in file.getnames()}
    assert {"Messages.cs", "Haptix.asmdef", "Unity/LayoutUnderFinger.cs"} <= files
    assert "Samples~/Ribs/Ribs.unity" in files
    assert not [name for name in files if "Test" in name or name.endswith(".csproj")]
    # Unity passes over what has no id, in a package that it may not change.
    own = {name for name in files if not name.endswith(".meta")}
    assert files - own == {f"{name}.meta" for name in own | {"Unity", "Samples~/Ribs"}}


CPP = """
#include <iostream>
#include "session.hpp"
int main() {
    nlohmann::json text = nlohmann::json::parse(std::cin);
    std::cout << nlohmann::json(text.get<quicktype::Output>());
}
"""
RUST = """
mod session;
fn main() {
    let said: session::Output = serde_json::from_reader(std::io::stdin()).unwrap();
    print!("{}", serde_json::to_string(&said).unwrap());
}
"""
CARGO = """
[package]
name = "program"
version = "0.1.0"
edition = "2021"
[dependencies]
serde = { version = "1", features = ["derive"] }
serde_json = "1"
[profile.dev]
debug = false
"""
DEBIANS = Path("/usr/share/cargo/registry")
SOURCES = f"""
[source.crates-io]
replace-with = "debian"
[source.debian]
directory = "{DEBIANS}"
"""
JSON_OF_CPP = Path("/usr/include/nlohmann/json.hpp")
SAID = m.OutputMessage(
    state="armed", device="mock", intensity=0.5, muted=False, paused=True, reason="armed"
)


def made(path, language, *options):
    """Make the types of the schema as published."""
    source = path.with_suffix(".json")
    source.write_text(json.dumps(reading.schema()))
    command = [node_tools() / ".bin" / "quicktype", "-s", "schema", "-l", language, *options]
    subprocess.run([*command, f"{source}#/$defs/", "-o", path], check=True, capture_output=True)
    assert "EffectEnded" in path.read_text()


def needs(*programs, file=None):
    if any(shutil.which(one) is None for one in programs) or (file and not file.exists()):
        pytest.skip(f"needs {', '.join(programs)} of Debian: scripts/setup-devices.sh")


def passes_on(program):
    """Whether a message goes through the types and is the same."""
    told = subprocess.run([program], input=SAID.model_dump_json(), capture_output=True, text=True)
    return reading.read_server(told.stdout) == SAID


@pytest.mark.slow  # compilers
def test_types_of_cpp_compile_and_pass_a_message_on(tmp_path):
    needs("g++", file=JSON_OF_CPP)
    options = ("--no-boost", "--include-location", "global-include")
    made(tmp_path / "session.hpp", "cpp", *options)
    (tmp_path / "program.cpp").write_text(CPP)
    command = ["g++", "-std=c++17", "-O0", "-w", "program.cpp", "-o", "program"]
    subprocess.run(command, check=True, cwd=tmp_path)
    assert passes_on(tmp_path / "program")


@pytest.mark.slow
@pytest.mark.timeout(3600)  # compiles serde too: 90 s of a processor
def test_types_of_rust_compile_and_pass_a_message_on(tmp_path):
    """With Debian's crates and, where there are several, Debian's compiler, which is as old."""
    needs("cargo", "rustc", file=DEBIANS / "serde_json-1.0.87")
    (tmp_path / "src").mkdir()
    (tmp_path / ".cargo").mkdir()
    made(tmp_path / "src" / "session.rs", "rust")
    (tmp_path / "src" / "main.rs").write_text(RUST)
    (tmp_path / "Cargo.toml").write_text(CARGO)
    (tmp_path / ".cargo" / "config.toml").write_text(SOURCES)
    environment = os.environ | {"PATH": f"/usr/bin:{os.environ['PATH']}"}
    command = ["cargo", "build", "--offline", "--quiet"]
    subprocess.run(command, check=True, cwd=tmp_path, env=environment)
    assert passes_on(tmp_path / "target" / "debug" / "program")


@pytest.mark.slow  # compilers
def test_types_of_kotlin_compile(tmp_path):
    """Without a library of JSON: Debian has none for Kotlin."""
    needs("kotlinc")
    made(tmp_path / "session.kt", "kotlin", "--framework", "just-types")
    command = ["kotlinc", "session.kt", "-nowarn", "-d", "session.jar"]
    subprocess.run(command, check=True, cwd=tmp_path)
    with zipfile.ZipFile(tmp_path / "session.jar") as file:
        assert "quicktype/EffectEnded.class" in file.namelist()


def test_types_of_swift_are_made(tmp_path):
    """Made only: neither Debian 12 nor a registry of packages has Swift's compiler."""
    made(tmp_path / "session.swift", "swift")
