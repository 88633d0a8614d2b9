"""Make the clients' types from the JSON Schema of the session's messages.

    python scripts/make-client-types.py [FOLDER]

writes into `clients/typescript/types`: `messages.d.ts` by json-schema-to-typescript, the others by
tsc from the JavaScript; and `clients/csharp/Messages.cs` by quicktype. With FOLDER, all into that.
Without it also `clients/asyncapi.json`, which describes the session, and `clients/types-made-from`,
by which a test sees in no time that the types are those of today's messages.
Needs node and, once, `npm ci --prefix clients/typescript`.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from hashlib import sha256
from pathlib import Path
from typing import Any

from haptix.service.messages import asyncapi, schema

ROOT = Path(__file__).parents[1]
CLIENTS = ROOT / "clients"
TOOLS = CLIENTS / "typescript" / "node_modules" / ".bin"
BANNER = "Made by scripts/make-client-types.py from the schema of the messages; do not edit."


def main(folder: Path | None = None) -> None:
    """Write the types of both languages."""
    if folder is None:
        (CLIENTS / "asyncapi.json").write_text(json.dumps(asyncapi(), indent=1) + "\n")
        (CLIENTS / "types-made-from").write_text(f"{made_from()}\n")
    definitions = prepared()
    typescript = folder or CLIENTS / "typescript" / "types"
    csharp = folder or CLIENTS / "csharp"
    with tempfile.TemporaryDirectory() as temporary:
        source = Path(temporary) / "Messages.json"
        source.write_text(json.dumps({"$ref": "#/$defs/Message", "$defs": definitions}))
        target = typescript / "messages.d.ts"
        options = ["--no-additionalProperties", "--unknownAny"]
        options += ["--bannerComment", f"/* {BANNER} */"]
        run("json2ts", "--input", str(source), "--output", str(target), *options)
        run("tsc", "-p", str(CLIENTS / "typescript"), "--outDir", str(typescript))

        source.write_text(json.dumps(for_csharp(definitions)))
        target = csharp / "Messages.cs"
        options = ["--namespace", "Haptix.Messages", "--csharp-version", "6", "--array-type"]
        options += ["array", "--framework", "NewtonSoft", "--features", "attributes-only"]
        options += ["-s", "schema", "-l", "csharp", f"{source}#/$defs/", "-o", str(target)]
        run("quicktype", *options)
        target.write_text(f"// {BANNER}\n{target.read_text()}")


def made_from() -> str:
    """Return the hash of all that types are made from."""
    found = sha256(json.dumps(schema(), sort_keys=True).encode())
    for path in sorted((CLIENTS / "typescript" / "src").iterdir()):
        found.update(path.read_bytes())
    found.update(Path(__file__).read_bytes())
    return found.hexdigest()


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


def run(tool: str, *arguments: str) -> None:
    """Run a generator; its own complaint ends this one."""
    done = subprocess.run([TOOLS / tool, *arguments], capture_output=True, text=True, cwd=ROOT)
    if done.returncode:
        sys.exit(f"{tool}: {(done.stderr or done.stdout).strip()}")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else None)
