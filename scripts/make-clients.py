"""Make what the clients have from the schema of the session's messages; git keeps none of it.

    make clients                        # all below, where it is not that of today's messages
    make clients ARGS='--pack FOLDER'   # and what a release attaches

- `clients/typescript/types`: `messages.d.ts` by json-schema-to-typescript, the others by tsc from
  the JavaScript, whose types it checks meanwhile.
- `clients/csharp/Messages.cs` by quicktype.
- `clients/asyncapi.json`: the session, for the generators of other languages.

Needs Node 20 or newer. The Python client and the pages of the studio need none of this.
"""

from __future__ import annotations

import argparse
import json
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from hashlib import sha256
from pathlib import Path
from typing import Any
from zipfile import ZIP_DEFLATED, ZipFile

from filelock import FileLock

from haptix.service.messages import asyncapi, schema
from haptix.version import __version__

ROOT = Path(__file__).parents[1]
CLIENTS = ROOT / "clients"
TYPESCRIPT, CSHARP = CLIENTS / "typescript", CLIENTS / "csharp"
TOOLS = TYPESCRIPT / "node_modules"
LOCKED = TYPESCRIPT / "package-lock.json"
ASYNCAPI = CLIENTS / "asyncapi.json"
MADE = (TYPESCRIPT / "types" / "messages.d.ts", CSHARP / "Messages.cs", ASYNCAPI)
MADE_FROM = ROOT / "build" / "clients-made-from"
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
        if known != made_from or not all(path.exists() for path in MADE):
            make()
            MADE_FROM.write_text(made_from)
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
    digest = sha256(json.dumps([schema(), asyncapi()], sort_keys=True).encode())
    for path in (*sorted((TYPESCRIPT / "src").iterdir()), LOCKED, Path(__file__)):
        digest.update(path.read_bytes())
    return digest.hexdigest()


def make() -> None:
    """Write the files of all clients."""
    definitions = prepared()
    types, messages, _ = MADE
    shutil.rmtree(types.parent, ignore_errors=True)  # of sources that are gone, too
    with tempfile.TemporaryDirectory() as temporary:
        source = Path(temporary) / "Messages.json"
        source.write_text(json.dumps({"$ref": "#/$defs/Message", "$defs": definitions}))
        options = ["--no-additionalProperties", "--unknownAny"]
        options += ["--bannerComment", f"/* {BANNER} */"]
        run_tool("json2ts", "--input", str(source), "--output", str(types), *options)
        run_tool("tsc", "-p", str(TYPESCRIPT))

        source.write_text(json.dumps(for_csharp(definitions)))
        options = ["--namespace", "Haptix.Messages", "--csharp-version", "6", "--array-type"]
        options += ["array", "--framework", "NewtonSoft", "--features", "attributes-only"]
        options += ["-s", "schema", "-l", "csharp", f"{source}#/$defs/", "-o", str(messages)]
        run_tool("quicktype", *options)
    messages.write_text(f"// {BANNER}\n{messages.read_text()}")
    ASYNCAPI.write_text(json.dumps(asyncapi(), indent=1) + "\n")


def pack(folder: Path) -> None:
    """Write each client with what was made as one file, and the session's description."""
    folder.mkdir(parents=True, exist_ok=True)
    run("npm", "pack", str(TYPESCRIPT), "--pack-destination", str(folder.resolve()))
    shutil.copy(ASYNCAPI, folder / f"haptix-asyncapi-{__version__}.json")
    with ZipFile(folder / f"haptix-client-csharp-{__version__}.zip", "w", ZIP_DEFLATED) as file:
        for path in sorted([*CSHARP.glob("*.*"), *CSHARP.glob("Example/*.cs")]):
            file.write(path, Path("Haptix") / path.relative_to(CSHARP))


def prepared() -> dict[str, Any]:
    """Return the definitions as both generators understand them."""
    definitions: dict[str, Any] = schema()["$defs"]
    for part in parts(definitions):
        # A title would become a type of its own. The service checks limits and names the field.
        for key in ("title", "minItems", "maxItems", "minimum", "maximum", "exclusiveMinimum"):
            part.pop(key, None)
        for key in ("minLength", "maxLength", "pattern"):
            part.pop(key, None)
        if "prefixItems" in part:  # pairs of numbers; the generators know no draft 2020-12
            part["items"] = part.pop("prefixItems")[0]
    # The server leaves no field out, also where the model has a default.
    for name in reached("ServerMessage", definitions):
        if "properties" in definitions[name]:
            definitions[name]["required"] = list(definitions[name]["properties"])
    definitions["Message"] = {
        "oneOf": [{"$ref": "#/$defs/ClientMessage"}, {"$ref": "#/$defs/ServerMessage"}]
    }
    return definitions


def for_csharp(definitions: dict[str, Any]) -> dict[str, Any]:
    """Return the messages alone: quicktype merges the members of a union.

    A choice of words is a string: enums would need converters, which Unity's stripping removes.
    Layouts are given as JSON.
    """
    layouts = reached("LayoutSet", definitions) | reached("LayoutChange", definitions)
    for part in parts(definitions):
        for key in ("enum", "const", "default"):
            part.pop(key, None)
    kept = {name: part for name, part in definitions.items() if name not in layouts}
    return {"$defs": {name: part for name, part in kept.items() if "properties" in part}}


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
