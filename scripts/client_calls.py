"""The calls of the clients in Python, JavaScript and C#, written from the session's description.

    .venv/bin/python scripts/client_calls.py    # writes the three files; needs no Node

Each message of `asyncapi()` that is answered is one call: its name, its fields in their order, with
their defaults, and the type of its answer. Each change of a layout (`ops`) is a call of a region.
git keeps the files, since the package and the studio's pages need them; a test compares.
"""

from __future__ import annotations

import json
import subprocess
import sys
import textwrap
from collections.abc import Iterable
from pathlib import Path
from typing import Any, NamedTuple

from haptix.service.protocol import messages as m
from haptix.service.protocol.messages import reading

ROOT = Path(__file__).parents[1]
BANNER = "Made by scripts/client_calls.py from the description of the session; do not edit."
OWN = ("hello", "touch", "bye")  # those of the connection and of touches, written by hand


class Field(NamedTuple):
    """A field of a message: its schema, without null, and its default; None where it has none."""

    name: str
    schema: dict[str, Any]
    is_required: bool
    default: Any


class Call(NamedTuple):
    """A call: what it sends, what that is, and the type of the answer."""

    kind: str
    name: str
    about: str
    fields: tuple[Field, ...]
    message: str
    answer: str


def calls(description: dict[str, Any]) -> list[Call]:
    """Return the calls of a session, in the order of their names."""
    messages = description["components"]["messages"]
    found = []
    for name, operation in description["operations"].items():
        message = messages[name]
        if "reply" in operation and message["name"] not in OWN:
            reply = _end(operation["reply"]["messages"][0])
            type_ = _end(message["payload"])
            fields = _fields(description, type_, ("type", "id"))
            answer = _end(messages[reply]["payload"])
            kind = message["name"]
            found.append(Call(kind, kind, message["summary"], fields, type_, answer))
    return found


def changes(description: dict[str, Any]) -> list[Call]:
    """Return the calls of a region; the first adds one."""
    schemas = description["components"]["schemas"]
    found = []
    for ref in _ops(schemas)["oneOf"]:
        type_ = _end(ref)
        op = schemas[type_]["properties"]["op"]["const"]
        name = "set_value" if type_ == "SetValue" else op
        fields = _fields(description, type_, ("op", "name"))
        found.append(Call(op, name, schemas[type_]["description"], fields, type_, "LayoutReply"))
    return sorted(found, key=lambda call: call.name != "add")


def _ops(schemas: dict[str, Any]) -> dict[str, Any]:
    ops: dict[str, Any] = schemas["LayoutChange"]["properties"]["ops"]["items"]
    return ops


def _end(part: dict[str, str]) -> str:
    return part["$ref"].rpartition("/")[2]


def _fields(description: dict[str, Any], type_: str, without: Iterable[str]) -> tuple[Field, ...]:
    schema = description["components"]["schemas"][type_]
    found = []
    for name, part in schema["properties"].items():
        if name not in without:
            some = [each for each in part.get("anyOf", [part]) if each.get("type") != "null"]
            inner = some[0] if len(some) == 1 else {"anyOf": some}
            is_required = name in schema["required"]
            found.append(Field(name, inner, is_required, part.get("default")))
    return tuple(sorted(found, key=lambda field: not field.is_required))


def python_type(part: dict[str, Any]) -> str:
    """Return the annotation of a schema."""
    if "anyOf" in part:
        return " | ".join(python_type(each) for each in part["anyOf"])
    if "enum" in part:
        return f"Literal[{', '.join(json.dumps(word) for word in part['enum'])}]"
    if "$ref" in part:
        return "Document"
    if "prefixItems" in part:
        return f"tuple[{', '.join(python_type(each) for each in part['prefixItems'])}]"
    if part["type"] == "array":
        inner = part["items"]
        return f"Sequence[{'Document' if 'oneOf' in inner else python_type(inner)}]"
    if part["type"] == "object":
        if part["additionalProperties"] is True:
            return "Document"
        key, value = part["propertyNames"], part["additionalProperties"]
        return f"Mapping[{python_type(key)}, {python_type(value)}]"
    return {"boolean": "bool", "number": "float", "integer": "int", "string": "str"}[part["type"]]


def python_parameters(fields: Iterable[Field]) -> str:
    """Return parameters of a method."""
    text = ""
    for field in fields:
        hint, default = python_type(field.schema), field.default
        if not field.is_required:
            default = tuple(default) if isinstance(default, list) else default
            hint += f" | None = {default!r}" if default is None else f" = {default!r}"
        text += f", {field.name}: {hint}"
    return text


def _python_about(call: Call) -> str:
    """Docstring of a call: its fields, too, where there are several; their names have the units."""
    lines = [call.about]
    if len(call.fields) > 1:
        names = (f"{field.name} : {python_type(field.schema)}" for field in call.fields)
        lines += ["", "Parameters", "----------", *names, ""]
    return textwrap.indent('"""' + "\n".join(lines) + '"""', " " * 8).strip()


def _passed(call: Call) -> str:
    return "".join(f", {field.name}={field.name}" for field in call.fields)


def python() -> str:
    """Return the module of the Python client's calls, with and without ``await``."""
    description = reading.asyncapi()
    face = _python_face(description)
    plain = face.replace("async def", "def").replace("await ", "")
    plain = plain.replace("Async", "Plain").replace("Client", "Plain")
    about = f'"""The requests of a session, with and without ``await``.\n\n{BANNER}\n"""\n'
    formatter = [sys.executable, "-m", "ruff", "format", "--stdin-filename", "made.py", "-"]
    return subprocess.run(
        formatter,
        input=about + _PYTHON + _python_fields(description) + face + plain,
        text=True,
        check=True,
        capture_output=True,
    ).stdout


def _python_face(description: dict[str, Any]) -> str:
    text = _PYTHON_CALLS
    for call in calls(description):
        answer = call.answer if hasattr(m, call.answer) else f"{call.answer}Message"
        text += f"""
    async def {call.name}(self{python_parameters(call.fields)}) -> m.{answer}:
        {_python_about(call)}
        return await self.ask("{call.kind}"{_passed(call)})
"""
    adding, *others = changes(description)
    text += _PYTHON_LAYOUT.replace("ABOUT", adding.about)
    for call in others:
        if call.kind in ("change", "move"):
            parameters, passed = f", **fields: Unpack[{call.message}Fields]", ", **fields"
        else:
            parameters, passed = python_parameters(call.fields), _passed(call)
        text += f"""
    async def {call.name}(self{parameters}) -> m.LayoutReply:
        \"""{call.about}\"""
        change = given(op="{call.kind}", name=self.name{passed})
        return await self.session.layout_change([change])
"""
    return text


def _python_fields(description: dict[str, Any]) -> str:
    """Return the optional fields of the changes of a region, as types of ``**fields``."""
    text, base, known = "", "TypedDict, total=False", set[str]()
    by_kind = {call.kind: call for call in changes(description)}
    for call in (by_kind["move"], by_kind["add"], by_kind["change"]):
        if call.kind == "change":
            base, known = (
                "AddRegionFields, total=False",
                {each.name for each in by_kind["add"].fields},
            )
            known -= {"material"}
        text += f"""

class {call.message}Fields({base}):
    \"""Fields of `{call.kind}`; `haptix.feel.layout.region.RegionFields` describes them.\"""

"""
        for field in call.fields:
            if not field.is_required and field.name not in known:
                none = " | None" if field.default is None else ""
                text += f"    {field.name}: {python_type(field.schema)}{none}\n"
    return text


def camel(name: str) -> str:
    """Return a name as JavaScript writes it."""
    first, *others = name.split("_")
    return first + "".join(part.title() for part in others)


def javascript() -> str:
    """Return the module of the calls for pages and Node; its types are in JSDoc."""
    description = reading.asyncapi()
    text = f"/** The requests of a session. {BANNER} */\n{_JAVASCRIPT}"
    for call in calls(description):
        text += _javascript(call, "m." + call.answer, f'this.ask("{call.kind}"', '"type" | "id"')
    adding, *others = changes(description)
    text += _JAVASCRIPT_LAYOUT.replace("ABOUT", adding.about)
    for call in others:
        sent = f'this.session.layoutChange([{{ op: "{call.kind}", name: this.name'
        text += _javascript(call, "m.LayoutReply", sent, '"op" | "name"')
    return text + "}\n"


def _javascript(call: Call, answer: str, sent: str, without: str) -> str:
    is_change = sent.endswith("name")
    parameters = hints = ""
    if len(call.fields) == 1:
        (field,) = call.fields
        parameters, given = camel(field.name), camel(field.name)
        given = f"{field.name}: {given}" if given != field.name else given
        hints = f'   * @param {{m.{call.message}["{field.name}"]}} {parameters}\n'
        if not field.is_required:
            hints = hints.replace(f" {parameters}\n", f" [{parameters}]\n")
            parameters += f" = {json.dumps(field.default)}"
        sent += f", {given}" if is_change else f", {{ {given} }}"
    elif call.fields:
        is_required = call.fields[0].is_required
        parameters = "fields" if is_required else "fields = {}"
        hints = f"   * @param {{Omit<m.{call.message}, {without}>}} "
        hints += "fields\n" if is_required else "[fields]\n"
        sent += ", ...fields" if is_change else ", fields"
    sent += " }])" if is_change else ")"
    return f"""
  /** {call.about}
{hints}   * @returns {{Promise<{answer}>}} */
  {camel(call.name)}({parameters}) {{
    return {sent};
  }}
"""


_KEEP = "\0"  # a space at which no line breaks


def csharp_type(field: Field) -> str:
    """Return the type of a parameter in C#."""
    kind, part = field.schema.get("type"), field.schema
    if part.get("additionalProperties") is True:
        return "Material"
    if "$ref" in part:
        return "LayoutDocument"
    if kind == "object":
        return "IDictionary<string, double>"
    if kind == "array":
        return "double[]" if "prefixItems" in part else "IList<object>"
    types = {"boolean": "bool", "number": "double", "integer": "long", "string": "string"}
    name = types.get(str(kind), "object")
    is_value = name in ("bool", "double", "long")
    return name + ("?" if is_value and not field.is_required and field.default is None else "")


def csharp() -> str:
    """Return the calls of the client for Unity, Mono and .NET."""
    description = reading.asyncapi()
    text = f"// The requests of a session. {BANNER}\n{_CSHARP}"
    for call in calls(description):
        sent = f'Ask<{call.answer}>("{call.kind}", {_csharp_given(call.fields)})'
        text += _csharp(call, f"Task<{call.answer}>", call.fields, f"return {sent};")
    text += "    }\n" + _CSHARP_LAYOUT
    adding, *others = changes(description)
    name = Field("name", {"type": "string"}, False, "")
    body = _CSHARP_ADD.replace("GIVEN", _csharp_given(adding.fields))
    text += _csharp(adding, "async Task<Region>", (*adding.fields, name), body)
    text += "    }\n" + _CSHARP_REGION
    for call in others:
        body = f'return Send("{call.kind}", {_csharp_given(call.fields)});'
        text += _csharp(call, "Task<LayoutReply>", call.fields, body)
    return text + "    }\n}\n"


def _csharp_given(fields: Iterable[Field]) -> str:
    pairs = []
    for field in fields:
        value = camel(field.name)
        is_value = csharp_type(field).rstrip("?") in ("bool", "double", "long", "string")
        value = value if is_value else f"Json({value})"
        pairs.append(f'{{{_KEEP}"{field.name}",{_KEEP}{value}{_KEEP}}}')
    return f"new JObject {{ {', '.join(pairs)} }}" if pairs else "new JObject()"


def _csharp(call: Call, answer: str, fields: Iterable[Field], body: str) -> str:
    parameters = []
    for field in fields:
        default = field.default if not isinstance(field.default, list) else None
        default = "" if field.is_required else f" = {json.dumps(default)}"
        parameter = f"{csharp_type(field)} {camel(field.name)}{default}"
        parameters.append(parameter.replace(" ", _KEEP))
    name = camel(call.name)
    text = f"""
/// <summary>{call.about}</summary>
public {answer} {name[0].upper() + name[1:]}({", ".join(parameters)})
{{
    {body}
}}
"""
    lines = []
    for line in text.splitlines():
        indent = line[: len(line) - len(line.lstrip())] + "    "
        if "///" in line:
            lines.append(line)
            continue
        lines += textwrap.wrap(line, 108, subsequent_indent=indent, break_on_hyphens=False) or [""]
    return textwrap.indent("\n".join(lines) + "\n", " " * 8).replace(_KEEP, " ")


_PYTHON = """
from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any, Literal, TypedDict, Unpack

from pydantic import BaseModel

from haptix.service.protocol import messages as m

# mypy: disable-error-code="no-any-return"

Document = BaseModel | Mapping[str, object]
\"""A material, a layout or a change: an object of its class, or its document.\"""


def given(**fields: object) -> dict[str, object]:
    \"""Fields that are not None.\"""
    return {name: value for name, value in fields.items() if value is not None}

"""
_PYTHON_CALLS = '''

class AsyncCalls(ABC):
    """The messages of a session that are answered; each raises `Refused` or `Lost`."""

    @abstractmethod
    async def ask(self, kind: str, **fields: Any) -> Any:
        """Send a message and return its answer.

        Parameters
        ----------
        kind : str
            Its type.
        **fields
            Its content.
        """
'''
_PYTHON_LAYOUT = '''

class ClientLayout:
    """The layout of a session: its materials by place; `layout` of a client.

    Parameters
    ----------
    calls : AsyncCalls
        The client.
    """

    def __init__(self, calls: AsyncCalls) -> None:
        self._calls, self._count = calls, 0

    async def add(
        self, material: Document, *, name: str = "", **fields: Unpack[AddRegionFields]
    ) -> ClientRegion:
        """ABOUT

        Parameters
        ----------
        material : Material or dict
            One of `haptix.feel.materials` that names no files, or its document.
        name : str, optional
            For `contact` events; made where none is given.
        **fields
            Those of `haptix.feel.layout.region.RegionFields`.

        Raises
        ------
        Refused
            If the service refuses it.
        """
        self._count += 1
        name = name or f"region {self._count}"
        change = given(op="add", name=name, material=material, **fields)
        await self._calls.layout_change([change])
        return ClientRegion(self._calls, name)

    async def clear(self) -> m.LayoutReply:
        """Remove all regions."""
        return await self._calls.layout_set({"regions": []})


class ClientRegion:
    """A region of a session's layout, by its name; each call is one change.

    Parameters
    ----------
    calls : AsyncCalls
        The client, `session` from then on.
    name : str
        Its name.
    """

    def __init__(self, calls: AsyncCalls, name: str) -> None:
        self.session: Any = calls
        self.name = name
'''
_JAVASCRIPT = """
/** @import * as m from "../types/messages.js" */

/** The messages of a session that are answered; each rejects with `Refused` or `Lost`. */
export class Calls {
  /** The materials by place. */
  layout = new Layout(this);

  /**
   * Send a message and return its answer; undefined fields are left out.
   * @param {string} type
   * @param {object} [fields]
   * @returns {Promise<any>}
   */
  async ask(type, fields) {
    throw new Error(`${type} ${fields}: expected a connection`);
  }
"""
_JAVASCRIPT_LAYOUT = """}

/** The materials by place; the service keeps it for who connects again. */
export class Layout {
  #calls;
  #count = 0;

  /** @param {Calls} calls */
  constructor(calls) {
    this.#calls = calls;
  }

  /**
   * ABOUT Millimetres from the screen's corner; without a size it is as large as its material. The
   * name, for `contact.region`, is made where none is given.
   * @param {m.AddRegion["material"]} material
   * @param {Omit<m.AddRegion, "op" | "name" | "material"> & {name?: string}} [fields]
   * @returns {Promise<Region>}
   */
  async add(material, { name, ...fields } = {}) {
    this.#count += 1;
    const region = new Region(this.#calls, name || `region ${this.#count}`);
    await this.#calls.layoutChange([{ op: "add", name: region.name, material, ...fields }]);
    return region;
  }

  /** Remove all regions. */
  clear() {
    return this.#calls.layoutSet({ regions: [] });
  }
}

/**
 * A region of the layout, by its name; each call is one change.
 * @template {Calls} [S=Calls]
 */
export class Region {
  /** @param {S} session @param {string} name */
  constructor(session, name) {
    this.session = session;
    this.name = name;
  }
"""
_CSHARP = """namespace Haptix
{
    using System.Collections.Generic;
    using System.Threading.Tasks;
    using Haptix.Messages;
    using Newtonsoft.Json.Linq;

    public sealed partial class Session
    {"""
_CSHARP_ADD = """var region = new Region(_session, name != "" ? name : "region " + ++_count);
    await region.Send("add", GIVEN).ConfigureAwait(false);
    return region;"""
_CSHARP_LAYOUT = """
    public sealed partial class Layout
    {"""
_CSHARP_REGION = """
    public sealed partial class Region
    {"""

WRITTEN = {
    ROOT / "haptix" / "service" / "client" / "calls.py": python,
    ROOT / "clients" / "typescript" / "src" / "calls.js": javascript,
    ROOT / "clients" / "csharp" / "Calls.cs": csharp,
}


def main() -> None:
    """Write the three files."""
    for path, write in WRITTEN.items():
        path.write_text(write())


if __name__ == "__main__":
    main()
