"""From JSON texts to messages, which field of a text is wrong, and the schema of all messages."""

from __future__ import annotations

import json
import re
from typing import Any, get_args

from pydantic import ConfigDict, TypeAdapter, ValidationError
from pydantic.json_schema import models_json_schema

from haptix.service.protocol.messages import (
    MOST_DEPTH,
    MOST_KEYS,
    MOST_LISTS,
    MOST_TEXT_BYTES,
    MOST_VALUES,
    PROTOCOL,
    ClientMessage,
    Problem,
    ServerMessage,
    TouchMessage,
)

_LATER = ConfigDict(defer_build=True)
CLIENT: TypeAdapter[Any] = TypeAdapter(ClientMessage, config=_LATER)
SERVER: TypeAdapter[Any] = TypeAdapter(ServerMessage, config=_LATER)
_STRINGS = re.compile(r'"(?:[^"\\]++|\\.)*+"?', re.DOTALL)  # possessive: no way back is kept
_ID = re.compile(r'\s*\{\s*(?:"type"\s*:\s*"\w*"\s*,\s*)?"id"\s*:\s*(\d{1,15})\b')
_BRACKETS = re.compile(r"[\[\]{}]")


def build() -> None:
    """Build the front's readers and writers, for which a first client would wait otherwise."""
    CLIENT.rebuild()
    for kind in get_args(get_args(ServerMessage)[0]):
        kind.model_rebuild()


def read_client(text: str, most_bytes: int = MOST_TEXT_BYTES) -> Any:
    """Return the client's message of a JSON text.

    Raises `Problem` with the field that is wrong.
    """
    if len(text) > most_bytes or len(text.encode()) > most_bytes:
        raise Problem("limit", f"expected at most {most_bytes} bytes of text")
    if counts := too_many(text.encode()):
        raise Problem("limit", counts)
    if _depth(text) > MOST_DEPTH:
        raise Problem("limit", f"expected a text of at most {MOST_DEPTH} nested brackets")
    try:
        return CLIENT.validate_json(text)
    except ValidationError as error:
        raise problem_of(error) from None


def too_many(text: bytes | bytearray) -> str:
    """Name the part of which a JSON text has too many, by its separators; empty where none."""
    keys, values = text.count(b":"), text.count(b",")
    brackets, quotes = text.count(b"[") + text.count(b"{"), text.count(b'"')
    if keys > MOST_KEYS or values > MOST_VALUES or brackets > MOST_LISTS or quotes > 4 * MOST_KEYS:
        return f"expected at most {MOST_KEYS} keys, {MOST_LISTS} lists and {MOST_VALUES} values"
    return ""


def read_server(text: str) -> Any:
    """Return the server's message of a JSON text, as a client in Python reads it."""
    return SERVER.validate_json(text)


def id_of(text: str) -> int:
    """Return the id of a message that was refused, 0 where it has none."""
    if len(text) > MOST_TEXT_BYTES or too_many(text.encode()):  # too costly to parse
        first = _ID.match(text)
        return int(first[1]) if first else 0
    try:
        value = json.loads(text)
    except (ValueError, RecursionError):
        return 0
    number = value.get("id") if isinstance(value, dict) else None
    return number if type(number) is int and 1 <= number <= 2**53 else 0


def _depth(text: str) -> int:
    """Return how deep brackets nest, outside of strings; more than is allowed is not counted."""
    deepest = depth = 0
    for bracket in _BRACKETS.finditer(_STRINGS.sub("", text)):
        depth += 1 if bracket[0] in "[{" else -1
        deepest = max(deepest, depth)
        if deepest > MOST_DEPTH:
            break
    return deepest


def problem_of(error: ValidationError, *where: Any) -> Problem:
    """Return the first of pydantic's complaints, with a pointer into the client's message.

    Without `where`, it is of a whole message, else of a part that stands there.
    """
    first = error.errors(include_url=False)[0]
    kind, place = first["type"], list(first["loc"])
    if kind == "json_invalid":
        return Problem("message", f"expected a JSON text: {first['ctx']['error']}")
    # The first of a whole message is the type.
    path = "".join(f"/{_pointer(part)}" for part in ([*where, *place] if where else place[1:]))
    if kind.startswith("union_tag"):
        tag = first["ctx"]["discriminator"].strip("'")
        what = f"unknown {tag}: expected one of {first['ctx'].get('expected_tags')}"
        if kind == "union_tag_not_found":
            what = f"expected an object with the key {tag}"
        return Problem("message", what, f"{path}/{tag}")
    if not (place or where):
        return Problem("message", "expected an object with the key type", "/type")
    if kind == "extra_forbidden":
        return Problem("message", f"unknown key {place[-1]!r}", path)
    got = json.dumps(first["input"], default=str) if kind != "missing" else "nothing"
    got = got if len(got) <= 80 else got[:77] + "..."
    what = f"{place[-1]}: {first['msg'].lower()}, got {got}"
    if place[-1] in ("normal_force_n", "contact_area_m2") and "touches" in (*where, *place):
        what += "; leave it out where nothing measures it"
    return Problem("message", what, path)


def _pointer(part: Any) -> str:
    return str(part).replace("~", "~0").replace("/", "~1")


def schema() -> dict[str, Any]:
    """Return the JSON Schema of all messages, from which the clients' types are made."""
    client = CLIENT.json_schema(ref_template="#/$defs/{model}")
    server = SERVER.json_schema(ref_template="#/$defs/{model}", mode="serialization")
    extra = models_json_schema([(TouchMessage, "validation")], ref_template="#/$defs/{model}")[1]
    parts = client.pop("$defs") | server.pop("$defs") | extra["$defs"]
    text = json.dumps({name: parts[name] for name in sorted(parts)})
    # Clients call a HelloMessage a Hello; here the name is that of another class.
    named = json.loads(re.sub(r'(?<=[A-Za-z])Message"', '"', text))
    both = {"ClientMessage": client, "ServerMessage": server}
    both = json.loads(re.sub(r'(?<=/)([A-Za-z]+)Message"', r'\1"', json.dumps(both)))
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": f"haptix session {PROTOCOL[0]}.{PROTOCOL[1]}",
        "$defs": named | both,
    }


REPLIES = {
    "hello": "welcome",
    "acquire": "lease",
    **dict.fromkeys(("arm", "intensity", "mute", "pause", "sense"), "output"),
    **dict.fromkeys(("layout_set", "layout_change"), "layout"),
    "play": "playing",
    "subscribe": "subscribed",
    "watch": "job",
    "inventory": "inventory",
    **dict.fromkeys(("release", "stop", "geometry", "cancel", "touch"), "done"),
}
"""What answers each message of a client, where it is not refused by `error`; others have none."""

_ABOUT = {
    "release": "Give the lease back; 0 V first.",
    "arm": "Let touches be felt.",
    "stop": "End at 0 V, whoever holds the output; the holder keeps the lease.",
    "inventory": "Ask which devices and profiles there are.",
    "bye": "Leave: 0 V first, and the lease is free.",
    "mute": "Hold 0 V while time runs, until the lease ends.",
    "pause": "Hold 0 V while time stands, until the lease ends.",
    "sense": "Learn the finger by the current that it draws, from the next `arm` on.",
}
"""Of messages that share a class."""

_BYTES = {
    "touches": "A batch of touches, see docs/clients.md, Bytes.",
    "telemetry": "A frame of telemetry, see docs/clients.md, Bytes.",
}
_CHANNEL = {"$ref": "#/channels/session"}


def asyncapi() -> dict[str, Any]:
    """Return the AsyncAPI document; the service receives the client's messages."""
    types = {
        side: schema()["$defs"][side]["discriminator"]["mapping"]
        for side in ("ClientMessage", "ServerMessage")
    }
    definitions = json.loads(
        json.dumps(schema()["$defs"]).replace("#/$defs/", "#/components/schemas/"),
        object_hook=_with_named_discriminator,
    )
    for side in types:
        del definitions[side]
    messages: dict[str, Any] = {}
    operations: dict[str, Any] = {}
    for side, action in (("ClientMessage", "receive"), ("ServerMessage", "send")):
        for kind, reference in types[side].items():
            name = f"{action}_{kind}"
            reference = reference.replace("#/$defs/", "#/components/schemas/")
            about = definitions[reference.rsplit("/", 1)[1]]["description"]
            about = _ABOUT.get(kind, about) if action == "receive" else about
            messages[name] = {"name": kind, "summary": about, "payload": {"$ref": reference}}
            operations[name] = {
                "action": action,
                "channel": _CHANNEL,
                "messages": [_in_channel(name)],
            }
            if action == "receive" and kind in REPLIES:
                answers = [_in_channel(f"send_{reply}") for reply in (REPLIES[kind], "error")]
                operations[name]["reply"] = {"channel": _CHANNEL, "messages": answers}
    for kind, action in (("touches", "receive"), ("telemetry", "send")):
        messages[kind] = {
            "name": kind,
            "summary": _BYTES[kind],
            "contentType": "application/octet-stream",
        }
        operations[kind] = {"action": action, "channel": _CHANNEL, "messages": [_in_channel(kind)]}
    version = "{}.{}".format(*PROTOCOL)
    return {
        "asyncapi": "3.0.0",
        "info": {"title": "haptix session", "version": version},
        "defaultContentType": "application/json",
        "servers": {"local": {"host": "127.0.0.1:7421", "protocol": "ws"}},
        "channels": {
            "session": {
                "address": "/v1/session",
                "description": "A WebSocket of the subprotocol haptix.v1.",
                "messages": {name: {"$ref": f"#/components/messages/{name}"} for name in messages},
            }
        },
        "operations": operations,
        "components": {"messages": messages, "schemas": definitions},
    }


def _with_named_discriminator(part: dict[str, Any]) -> dict[str, Any]:
    """Name the property alone, as AsyncAPI has it; OpenAPI has an object."""
    discriminator = part.get("discriminator")
    if not isinstance(discriminator, dict) or "propertyName" not in discriminator:
        return part
    return {**part, "discriminator": discriminator["propertyName"]}


def _in_channel(name: str) -> dict[str, str]:
    return {"$ref": f"#/channels/session/messages/{name}"}
