"""From JSON texts to messages, and which field of a text is wrong."""

from __future__ import annotations

import json
import re
from typing import Any, get_args

from pydantic import ConfigDict, TypeAdapter, ValidationError

from haptix.service.messages.base import MOST_DEPTH, MOST_TEXT_BYTES, Problem
from haptix.service.messages.from_client import ClientMessage
from haptix.service.messages.from_server import ServerMessage

_LATER = ConfigDict(defer_build=True)
CLIENT: TypeAdapter[Any] = TypeAdapter(ClientMessage, config=_LATER)
SERVER: TypeAdapter[Any] = TypeAdapter(ServerMessage, config=_LATER)
_STRINGS = re.compile(r'"(?:[^"\\]++|\\.)*+"?', re.DOTALL)  # possessive: no way back is kept
_BRACKETS = re.compile(r"[\[\]{}]")


def build() -> None:
    """Build what the front reads and says, which a first client would wait for otherwise."""
    CLIENT.rebuild()
    for kind in get_args(get_args(ServerMessage)[0]):
        kind.model_rebuild()


def read_client(text: str) -> Any:
    """Return the client's message of a JSON text.

    Raises
    ------
    Problem
        With the field that is wrong.
    """
    if len(text) > MOST_TEXT_BYTES or len(text.encode()) > MOST_TEXT_BYTES:
        raise Problem("limit", f"expected at most {MOST_TEXT_BYTES} bytes of text")
    if _depth(text) > MOST_DEPTH:
        raise Problem("limit", f"expected a text of at most {MOST_DEPTH} nested brackets")
    try:
        return CLIENT.validate_json(text)
    except ValidationError as error:
        raise _problem(error) from None


def read_server(text: str) -> Any:
    """Return the server's message of a JSON text: what a client in Python reads."""
    return SERVER.validate_json(text)


def id_of(text: str) -> int:
    """Return the id of a message that was refused, 0 where it has none."""
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


def _problem(error: ValidationError) -> Problem:
    """Return the first of pydantic's complaints, with a pointer into the client's text."""
    first = error.errors(include_url=False)[0]
    kind, place = first["type"], list(first["loc"])
    if kind == "json_invalid":
        return Problem("message", f"expected a JSON text: {first['ctx']['error']}")
    if kind in ("union_tag_not_found", "model_attributes_type", "dict_type"):
        return Problem("message", "expected an object with the key type", "/type")
    if kind == "union_tag_invalid":
        return Problem(
            "message", f"unknown type: expected one of {first['ctx']['expected_tags']}", "/type"
        )
    path = "".join(f"/{_pointer(part)}" for part in place[1:])  # the first is the type
    if kind == "extra_forbidden":
        return Problem("message", f"unknown key {place[-1]!r}", path)
    got = json.dumps(first["input"], default=str) if kind != "missing" else "nothing"
    got = got if len(got) <= 80 else got[:77] + "..."
    return Problem("message", f"{place[-1]}: {first['msg'].lower()}, got {got}", path)


def _pointer(part: Any) -> str:
    return str(part).replace("~", "~0").replace("/", "~1")
