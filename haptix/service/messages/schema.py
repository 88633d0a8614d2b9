"""JSON Schema of all messages."""

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
