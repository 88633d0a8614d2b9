"""Make what the clients have from the schema of the session's messages.

    make clients                        # all below, where it is not that of today's messages
    make clients ARGS='--pack FOLDER'   # and what a release attaches

- `clients/typescript/types`: `messages.d.ts` and `materials.d.ts` by json-schema-to-typescript, the
  others by tsc from the JavaScript, whose types it checks meanwhile.
- `clients/csharp/Messages.cs` and `Materials.cs` by quicktype, and the `.meta` that Unity wants
  beside each file: scenes name files by the ids in them.
- `clients/asyncapi.json`: the session, for the generators of other languages; git does not keep it.
- `clients/made-from`: a hash of the messages, their fields and types.

git keeps the others, so that the packages of a checkout have types; a test compares the hash. Needs
Node 20 or newer. The Python client and the pages of the studio need none of this.
"""

from __future__ import annotations

import argparse
import json
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from copy import deepcopy
from hashlib import sha256
from pathlib import Path
from typing import Any

from filelock import FileLock

from haptix.base.version import __version__
from haptix.feel.materials import schema as kinds
from haptix.service.protocol.messages.reading import asyncapi, schema

ROOT = Path(__file__).parents[1]
CLIENTS = ROOT / "clients"
TYPESCRIPT, CSHARP = CLIENTS / "typescript", CLIENTS / "csharp"
TOOLS = TYPESCRIPT / "node_modules"
LOCKED = TYPESCRIPT / "package-lock.json"
ASYNCAPI = CLIENTS / "asyncapi.json"
TYPES = TYPESCRIPT / "types"
MADE = {
    "messages": (TYPES / "messages.d.ts", CSHARP / "Messages.cs"),
    "materials": (TYPES / "materials.d.ts", CSHARP / "Materials.cs"),
}
MADE_FROM = ROOT / "build" / "clients-made-from"
SHAPES = CLIENTS / "made-from"
BANNER = "Made by `make clients` from the schema of the messages; do not edit."


def main() -> None:
    """Make the files, and with `--pack` the archives of a release."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--pack", type=Path, metavar="FOLDER", help="write archives there")
    folder = parser.parse_args().pack
    MADE_FROM.parent.mkdir(exist_ok=True)
    with FileLock(MADE_FROM.with_suffix(".lock")):
        install_tools()
        made_from = hash_of_sources()
        known = MADE_FROM.read_text() if MADE_FROM.exists() else ""
        if known != made_from or not all(path.exists() for pair in MADE.values() for path in pair):
            make()
            SHAPES.write_text(hash_of_shapes() + "\n")
            MADE_FROM.write_text(made_from)
        write_metas()
        if folder is not None:
            pack(folder)


def install_tools() -> None:
    """Install the generators, where they are not those of the lock file."""
    installed = TOOLS / ".package-lock.json"
    if not installed.exists() or installed.stat().st_mtime < LOCKED.stat().st_mtime:
        quiet = ("--no-audit", "--no-fund", "--loglevel", "error")
        run("npm", "ci", "--prefix", str(TYPESCRIPT), *quiet)
        installed.touch()


def hash_of_sources() -> str:
    """Return the hash of all that the files are made from."""
    digest = sha256(json.dumps([schema(), asyncapi(), kinds()], sort_keys=True).encode())
    for path in (*sorted((TYPESCRIPT / "src").iterdir()), LOCKED, Path(__file__)):
        digest.update(path.read_bytes())
    return digest.hexdigest()


def hash_of_shapes() -> str:
    """Return the hash of names, fields and types: of the schemas without their words."""
    whole = json.dumps([schema(), kinds()], sort_keys=True)
    return sha256(json.dumps(json.loads(whole, object_hook=_shape)).encode()).hexdigest()


def _shape(part: dict[str, Any]) -> dict[str, Any]:
    words = ("description", "title", "help", "examples")
    return {
        key: value for key, value in part.items() if not isinstance(value, str) or key not in words
    }


def make() -> None:
    """Write the files of all clients."""
    shutil.rmtree(TYPES, ignore_errors=True)  # of sources that are gone, too
    definitions = {"messages": prepared(), "materials": prepared_kinds()}
    for name, (types, csharp) in MADE.items():
        root = {"messages": "Message", "materials": "Material"}[name]
        with tempfile.TemporaryDirectory() as temporary:
            source = Path(temporary) / f"{root}.json"
            source.write_text(json.dumps({"$ref": f"#/$defs/{root}", "$defs": definitions[name]}))
            options = ["--no-additionalProperties", "--unknownAny"]
            options += ["--bannerComment", f"/* {BANNER} */"]
            run_tool("json2ts", "--input", str(source), "--output", str(types), *options)
            types.write_text(re.sub(r"/\*\*\n +\* (.*)\n +\*/", r"/** \1 */", types.read_text()))

            source.write_text(json.dumps(for_csharp(definitions[name])))
            options = ["--namespace", f"Haptix.{name.title()}", "--csharp-version", "6"]
            options += ["--array-type", "array", "--framework", "NewtonSoft"]
            options += ["--features", "attributes-only", "-s", "schema", "-l", "csharp"]
            run_tool("quicktype", *options, f"{source}#/$defs/", "-o", str(csharp))
        text = csharp.read_text()
        # Else Unity's stripping removes what Newtonsoft.Json finds by reflection alone.
        text = text.replace("public partial class", "[Preserve] public partial class")
        text = text.replace("[JsonProperty(", "[Preserve, JsonProperty(")
        # A line for each property.
        text = re.sub(r"<summary>\n +/// (.*)\n +/// </summary>", r"<summary>\1</summary>", text)
        text = re.sub(r"(\[Preserve, JsonProperty\(.*\)\])\n +", r"\1 ", text)
        text = text.replace("set; }\n\n", "set; }\n")
        if name == "materials":
            text += bases(definitions[name])
        csharp.write_text(f"// {BANNER}\n{text}")
    run_tool("tsc", "-p", str(TYPESCRIPT))
    ASYNCAPI.write_text(json.dumps(asyncapi(), indent=1) + "\n")


def write_metas() -> None:
    """Write what Unity keeps beside each file and folder of a package."""
    for path in [*CSHARP.glob("*"), *CSHARP.glob("Unity/*"), *CSHARP.glob("Samples~/**/*")]:
        if path.suffix not in (".meta", ".csproj") and not path.name.endswith("~"):
            text = f"fileFormatVersion: 2\nguid: {unity_id(path)}\n"
            text += "folderAsset: yes\n" if path.is_dir() else ""
            path.with_name(path.name + ".meta").write_text(text)


def unity_id(path: Path) -> str:
    """Return the id of a file, by which scenes name it; the same in each release."""
    name = f"com.haptix.client/{path.relative_to(CSHARP).as_posix()}"
    return sha256(name.encode()).hexdigest()[:32]


def pack(folder: Path) -> None:
    """Write each client with what was made as one file, and the session's description."""
    folder.mkdir(parents=True, exist_ok=True)
    for client in (TYPESCRIPT, CSHARP):
        run("npm", "pack", str(client), "--pack-destination", str(folder.resolve()))
    shutil.copy(ASYNCAPI, folder / f"haptix-asyncapi-{__version__}.json")


def prepared() -> dict[str, Any]:
    """Return the definitions as both generators understand them."""
    definitions: dict[str, Any] = schema()["$defs"]
    without_limits(definitions)
    # The server leaves no field out, also where the model has a default.
    for name in reached("ServerMessage", definitions):
        if "properties" in definitions[name]:
            definitions[name]["required"] = list(definitions[name]["properties"])
    for part in parts(definitions):
        if part.get("additionalProperties") is True:  # a material; what a job found is any object
            part["tsType"] = 'import("./materials.js").Material'
    definitions["Job"]["properties"]["result"]["anyOf"][0].pop("tsType")
    definitions["Message"] = {
        "oneOf": [{"$ref": "#/$defs/ClientMessage"}, {"$ref": "#/$defs/ServerMessage"}]
    }
    return definitions


def without_limits(definitions: dict[str, Any]) -> None:
    """Leave out what the service checks itself, and names the field."""
    for part in parts(definitions):
        # A title would become a type of its own.
        for key in ("title", "minItems", "maxItems", "minimum", "maximum", "exclusiveMinimum"):
            part.pop(key, None)
        for key in ("minLength", "maxLength", "pattern"):
            part.pop(key, None)
        if "prefixItems" in part:  # pairs of numbers; the generators know no draft 2020-12
            part["items"] = part.pop("prefixItems")[0]


def prepared_kinds() -> dict[str, Any]:
    """Return the definitions of the materials, as both generators understand them."""
    definitions: dict[str, Any] = kinds()["$defs"]
    without_limits(definitions)
    for part in parts(definitions):
        for key in [key for key in part if key.startswith("x-") or key == "default"]:
            del part[key]
        if part.get("$ref") == "#/$defs/material":  # else all materials would stand at each place
            part["tsType"] = "Material"
    text = json.dumps(definitions)
    for family in ("material", "signal"):
        text = text.replace(f'"#/$defs/{family}"', f'"#/$defs/{family.title()}"')
    named: dict[str, Any] = json.loads(text)
    return named | {family.title(): named.pop(family) for family in ("material", "signal")}


def bases(definitions: dict[str, Any]) -> str:
    """Return, in C#, the kinds as materials that know their kind."""
    text = "namespace Haptix.Materials\n{\n"
    for kind, ref in definitions["Material"]["discriminator"]["mapping"].items():
        name = ref.rpartition("/")[2]
        made = f'public {name}() {{ Kind = "{kind}"; }}'
        text += f"    public partial class {name} : Haptix.Material {{ {made} }}\n"
    return text + "}\n"


def for_csharp(definitions: dict[str, Any]) -> dict[str, Any]:
    """Return the classes alone: quicktype merges the members of a union, so that one is an object.

    A choice of words is a string: enums would need converters, which Unity's stripping removes.
    """
    definitions = deepcopy(definitions)
    for part in parts(definitions):
        words = part.get("enum", [part.get("const")])
        if words[0] is not None:
            part["type"] = "string" if isinstance(words[0], str) else "integer"
        for key in ("enum", "const", "default", "propertyNames"):
            part.pop(key, None)
        some = [each for each in part.get("anyOf", ()) if each.get("type") != "null"]
        is_union = "oneOf" in part or len(some) > 1
        if is_union or part.get("additionalProperties") is True or _names_union(part, definitions):
            for key in ("oneOf", "anyOf", "discriminator", "type", "$ref", "additionalProperties"):
                part.pop(key, None)
    return {"$defs": {name: part for name, part in definitions.items() if "properties" in part}}


def _names_union(part: dict[str, Any], definitions: dict[str, Any]) -> bool:
    name = str(part.get("$ref", "")).rpartition("/")[2]
    return name in definitions and "properties" not in definitions[name]


def parts(value: Any) -> Iterator[dict[str, Any]]:
    """Return all schemas within one; a property named `title` is none of theirs."""
    if isinstance(value, list):
        for each in value:
            yield from parts(each)
    elif isinstance(value, dict):
        if not isinstance(value.get("title"), dict):
            yield value
        for each in list(value.values()):
            yield from parts(each)


def reached(name: str, definitions: dict[str, Any]) -> set[str]:
    """Return the names that a definition refers to, by others too."""
    found: set[str] = set()
    waiting = [name]
    while waiting:
        here = waiting.pop()
        if here not in found:
            found.add(here)
            refs = (part.get("$ref") for part in parts(definitions[here]))
            waiting += [str(ref).rpartition("/")[2] for ref in refs if isinstance(ref, str)]
    return found


def run_tool(name: str, *arguments: str) -> None:
    """Run a generator."""
    run(str(TOOLS / ".bin" / name), *arguments)


def run(*command: str) -> None:
    """Run a program; its own complaint ends this one."""
    try:
        done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT)
    except FileNotFoundError:
        sys.exit(f"{command[0]} is missing: install Node 20 or newer, from nodejs.org")
    if done.returncode:
        sys.exit(f"{command[0]}: {(done.stderr or done.stdout).strip()}")


if __name__ == "__main__":
    main()
