"""The session's messages as a JSON Schema, and as an AsyncAPI 3 document."""

from __future__ import annotations

import json
import re
from typing import Any

from pydantic.json_schema import models_json_schema

from haptix.service.messages.base import PROTOCOL
from haptix.service.messages.from_client import TouchMessage
from haptix.service.messages.reading import CLIENT, SERVER


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
    **dict.fromkeys(("arm", "disarm", "intensity", "mute", "pause"), "output"),
    **dict.fromkeys(("layout_set", "layout_change"), "layout"),
    "play": "playing",
    "subscribe": "subscribed",
    "watch": "job",
    "inventory": "inventory",
    **dict.fromkeys(("release", "stop", "geometry", "cancel", "touch"), "done"),
}
"""What answers each message of a client, where it is not refused by `error`; others have none."""

_BYTES = {
    "touches": "A batch of touches, see docs/clients.md, Bytes.",
    "telemetry": "A frame of telemetry, see docs/clients.md, Bytes.",
}
_CHANNEL = {"$ref": "#/channels/session"}


def asyncapi() -> dict[str, Any]:
    """Return the AsyncAPI document; what the service receives are the client's messages."""
    definitions = json.loads(
        json.dumps(schema()["$defs"]).replace("#/$defs/", "#/components/schemas/")
    )
    both = {side: definitions.pop(side) for side in ("ClientMessage", "ServerMessage")}
    types = {side: union["discriminator"]["mapping"] for side, union in both.items()}
    messages: dict[str, Any] = {}
    operations: dict[str, Any] = {}
    for side, action in (("ClientMessage", "receive"), ("ServerMessage", "send")):
        for kind, reference in types[side].items():
            name = f"{action}_{kind}"
            about = definitions[reference.rsplit("/", 1)[1]].get("description", "")
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
        operations[kind] = {
            "action": action,
            "channel": _CHANNEL,
            "messages": [_in_channel(kind)],
        }
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


def _in_channel(name: str) -> dict[str, str]:
    return {"$ref": f"#/channels/session/messages/{name}"}
