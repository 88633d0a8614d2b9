"""The page ``/docs``: all routes and messages. It needs no script and nothing of another server."""

from __future__ import annotations

import base64
from collections.abc import Iterator
from hashlib import sha256
from html import escape
from typing import Any

_STYLE = """body{font:16px/1.5 system-ui,sans-serif;max-width:60rem;margin:2rem auto;padding:0 1rem}
table{border-collapse:collapse;width:100%}td,th{text-align:left;vertical-align:top;padding:.3rem
.6rem;border-bottom:1px solid #999}code{font-family:ui-monospace,monospace}
@media(prefers-color-scheme:dark){body{background:#111;color:#eee}a{color:#9cf}}"""
POLICY = (
    "default-src 'none'; base-uri 'none'; frame-ancestors 'none'; "
    f"style-src 'sha256-{base64.b64encode(sha256(_STYLE.encode()).digest()).decode()}'"
)
"""Its Content-Security-Policy."""


def docs_page(openapi: dict[str, Any], asyncapi: dict[str, Any]) -> str:
    """Return the page of two descriptions."""
    routes = (
        (f"<code>{method.upper()} {escape(path)}</code>", _about(one), _body(one))
        for path, methods in openapi["paths"].items()
        for method, one in methods.items()
    )
    messages, schemas = asyncapi["components"]["messages"], asyncapi["components"]["schemas"]
    said = (
        (
            f"<code>{escape(one['name'])}</code>",
            "to the service" if operation["action"] == "receive" else "from the service",
            escape(one["summary"]) + _fields(one, schemas),
        )
        for name, operation in asyncapi["operations"].items()
        for one in (messages[name],)
    )
    return "".join(
        (
            "<!doctype html><html lang=en><meta charset=utf-8><title>haptix service</title>",
            f"<style>{_STYLE}</style><h1>haptix service {escape(openapi['info']['version'])}</h1>",
            "<p>All but pages, pairing and STOP need <code>Authorization: Bearer TOKEN</code>. ",
            "For programs: <a href=/v1/openapi.json>OpenAPI</a>, ",
            "<a href=/v1/asyncapi.json>AsyncAPI</a>.<h2>Routes</h2>",
            *_table(("route", "does", "takes"), routes),
            "<h2>Messages of a session</h2>",
            *_table(("type", "goes", "says"), said),
        )
    )


def _table(heads: tuple[str, ...], rows: Any) -> Iterator[str]:
    yield f"<table><tr>{''.join(f'<th scope=col>{head}' for head in heads)}"
    for row in rows:
        yield f"<tr>{''.join(f'<td>{cell}' for cell in row)}"
    yield "</table>"


def _about(operation: dict[str, Any]) -> str:
    return escape(operation.get("description") or operation.get("summary", ""))


def _body(operation: dict[str, Any]) -> str:
    names = [one["name"] for one in operation.get("parameters", ()) if one["in"] != "header"]
    for content in operation.get("requestBody", {}).get("content", {}).values():
        names.append(content["schema"].get("$ref", "document").rsplit("/", 1)[-1])
    return escape(", ".join(names))


def _fields(message: dict[str, Any], schemas: dict[str, Any]) -> str:
    if "payload" not in message:
        return ""
    found = schemas[message["payload"]["$ref"].rsplit("/", 1)[1]].get("properties", {})
    names = (name for name in found if name not in ("type", "id"))
    return "".join(f" <code>{escape(name)}</code>" for name in names)
