"""Pages over HTTP: the studio's, and ``/docs`` with all routes and messages."""

from __future__ import annotations

import base64
from collections.abc import Iterator
from contextlib import suppress
from hashlib import sha256
from html import escape
from pathlib import Path
from typing import Any

from fastapi import APIRouter, Request
from fastapi.responses import FileResponse, RedirectResponse, Response

from haptix.service.access import Access
from haptix.service.messages import Problem

_STUDIO = Path(__file__).parents[1] / "studio"
_COPY = _STUDIO / "client"  # of the client for pages, in a wheel
_CHECKOUT = _STUDIO.parents[1] / "clients" / "typescript" / "src"
FOLDERS = {"studio": _STUDIO / "static", "client": _COPY if _COPY.is_dir() else _CHECKOUT}
"""Folders whose files anyone of this machine may read, by the first part of the address."""
_ANY_PAGE = (
    "default-src 'none'; script-src 'self'; style-src 'self'; form-action 'self'; base-uri 'none'"
)


def pages(access: Access) -> APIRouter:
    """Return the routes of the pages: the first one at ``/``, STOP at ``/stop``."""
    router = APIRouter(include_in_schema=False)

    @router.get("/")
    async def first(request: Request) -> Response:
        return _page(request, "studio", "index.html")

    @router.get("/stop")
    async def button() -> Response:
        headers = {"content-security-policy": _stop_policy(access.origins)}
        return FileResponse(_file("studio", "stop.html"), headers=headers)

    @router.get("/studio/{path:path}")
    async def studio(request: Request, path: str) -> Response:
        return _page(request, "studio", path)

    @router.get("/client/{path:path}")
    async def client(request: Request, path: str) -> Response:
        return _page(request, "client", path)

    @router.post("/v1/pair/code", status_code=204)
    async def code() -> None:
        access.show_code()

    return router


def _page(request: Request, folder: str, path: str) -> Response:
    host = request.headers["host"]
    name, _, port = host.rpartition(":")
    # STOP stands on localhost. The pages must not: both would share a process, and hang together.
    if name == "localhost" and not path.startswith("stop"):
        return RedirectResponse(f"http://127.0.0.1:{port}{request.url.path}")
    return FileResponse(_file(folder, path), headers={"content-security-policy": _policy(host)})


def _file(folder: str, path: str) -> str:
    root = FOLDERS[folder].resolve()
    with suppress(OSError, ValueError):  # a name that no file can have
        file = (root / path).resolve()
        if file.is_relative_to(root) and file.is_file():
            return str(file)
    raise Problem("unknown", f"expected a file of the studio, got {path!r:.80}")


def _policy(host: str) -> str:
    """Content-Security-Policy of the pages: nothing from elsewhere, no script within a page.

    The STOP button's frame must be another site than the page, so that a browser gives it a process
    of its own: then it works while the page's script hangs. ``localhost`` is one for pages on
    ``127.0.0.1``.
    """
    name, _, port = host.rpartition(":")
    stop_origin = f"http://localhost:{port}" if name == "127.0.0.1" else "'self'"
    return (
        f"{_ANY_PAGE}; worker-src 'self'; img-src 'self' blob: data:; connect-src 'self' "
        f"ws://{host} wss://{host}; frame-src {stop_origin}; frame-ancestors 'none'"
    )


def _stop_policy(origins: frozenset[str]) -> str:
    """Content-Security-Policy of the STOP button, which the service's own pages frame."""
    frames = " ".join(sorted(origin for origin in origins if "[" not in origin))
    return f"{_ANY_PAGE}; connect-src 'self'; frame-ancestors {frames}"


_STYLE = """body{font:16px/1.5 system-ui,sans-serif;max-width:60rem;margin:2rem auto;padding:0 1rem}
table{border-collapse:collapse;width:100%}td,th{text-align:left;vertical-align:top;padding:.3rem
.6rem;border-bottom:1px solid #999}code{font-family:ui-monospace,monospace}
@media(prefers-color-scheme:dark){body{background:#111;color:#eee}a{color:#9cf}}"""
POLICY = (
    "default-src 'none'; base-uri 'none'; frame-ancestors 'none'; "
    f"style-src 'sha256-{base64.b64encode(sha256(_STYLE.encode()).digest()).decode()}'"
)
"""Content-Security-Policy of ``/docs``, which needs no script and nothing of another server."""


def docs_page(openapi: dict[str, Any], asyncapi: dict[str, Any]) -> str:
    """Return the page ``/docs`` of two descriptions."""
    routes = (
        (f"<code>{method.upper()} {escape(path)}</code>", _about(operation), _body(operation))
        for path, methods in openapi["paths"].items()
        for method, operation in methods.items()
    )
    messages, schemas = asyncapi["components"]["messages"], asyncapi["components"]["schemas"]
    rows = (
        (
            f"<code>{escape(message['name'])}</code>",
            "to the service" if operation["action"] == "receive" else "from the service",
            escape(message["summary"]) + _fields(message, schemas),
        )
        for name, operation in asyncapi["operations"].items()
        for message in (messages[name],)
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
            *_table(("type", "goes", "says"), rows),
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
    names = [field["name"] for field in operation.get("parameters", ()) if field["in"] != "header"]
    for content in operation.get("requestBody", {}).get("content", {}).values():
        names.append(content["schema"].get("$ref", "document").rsplit("/", 1)[-1])
    return escape(", ".join(names))


def _fields(message: dict[str, Any], schemas: dict[str, Any]) -> str:
    if "payload" not in message:
        return ""
    properties = schemas[message["payload"]["$ref"].rsplit("/", 1)[1]].get("properties", {})
    names = (name for name in properties if name not in ("type", "id"))
    return "".join(f" <code>{escape(name)}</code>" for name in names)
