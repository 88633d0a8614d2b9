"""The service's front: the HTTP server and its application, without torch and without pixels.

Every request passes `Guard`, which refuses foreign hosts and origins. Routes are here and in `rest`
and `in_use`, sessions in `session_socket`. At the end are the pages of the studio and ``/docs``.
"""

from __future__ import annotations

import asyncio
import base64
import logging
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator, MutableMapping
from contextlib import asynccontextmanager, suppress
from hashlib import sha256
from html import escape
from math import inf
from pathlib import Path
from typing import Annotated, Any

from fastapi import APIRouter, Depends, FastAPI, Header, Request, WebSocket
from fastapi.exceptions import RequestValidationError
from fastapi.responses import FileResponse, HTMLResponse, JSONResponse, RedirectResponse, Response
from pydantic import BaseModel, ConfigDict, Field
from starlette.exceptions import HTTPException

from haptix.base.errors import HaptixError
from haptix.base.files import is_full_disk, write_failure
from haptix.base.version import __version__
from haptix.service.front.access import Access
from haptix.service.front.assets import AssetStore
from haptix.service.front.hub import TICK_S, Hub
from haptix.service.front.in_use import profiles_router
from haptix.service.front.rest import jobs_router
from haptix.service.front.session_socket import serve_session
from haptix.service.protocol import messages as m
from haptix.service.protocol.limiter import Limiter
from haptix.service.protocol.messages import Problem, reading

_LOG = logging.getLogger("haptix.service")

SUBPROTOCOL = "haptix.v1"
_HTTP_STATUS: dict[str, int] = {
    "message": 422,
    "document": 422,
    "limit": 429,
    "access": 403,
    "unknown": 404,
    "order": 409,
    "stale": 412,
    "lease": 409,
    "device": 503,
    "internal": 500,
}
MOST_BODY_BYTES = 2 * 2**20
"""Of a request; a recorded stroke of 20,000 touches has less."""
BODY_S, FILE_S = 30.0, 300.0
"""For the body of a request to come, and for a file of an app."""

Scope = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[MutableMapping[str, Any]]]
Send = Callable[[MutableMapping[str, Any]], Awaitable[None]]


class Guard:
    """Refuses foreign hosts and origins before anything else sees the request."""

    def __init__(self, app: Any, access: Access) -> None:
        self._app, self._access = app, access

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer, refuse, or pass the request on."""
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        headers = {
            key.decode("latin-1"): value.decode("latin-1") for key, value in scope["headers"]
        }
        origin = headers.get("origin")
        pairs = scope["path"] == "/v1/pair"
        if not self._access.is_own_host(headers.get("host")):
            await _refuse(scope, receive, send, 421, "this is no name of the service")
        elif not (self._access.is_known_origin(origin) or (pairs and origin != "null")):
            await _refuse(scope, receive, send, 403, "pages of this origin are not paired")
        elif scope["type"] == "http" and int(headers.get("content-length", 0)) > _most(scope):
            why = f"expected a body of at most {MOST_BODY_BYTES} bytes"
            await _refuse(scope, receive, send, 413, why, "limit")
        elif scope["type"] == "http" and scope["method"] == "OPTIONS" and origin is not None:
            await Response(status_code=204, headers=_cors(origin))(scope, receive, send)
        else:
            if scope["type"] == "http":
                is_file = _most(scope) == inf
                receive = _in_time(receive if is_file else _bounded(receive), is_file)
            try:
                await self._app(scope, receive, _with_headers(send, origin, self._access))
            except Exception as error:  # it was answered by `fail`
                where = scope.get("method", "session"), scope["path"][:80]
                _LOG.warning("%s %s: %s: %s", *where, type(error).__name__, error)
                _LOG.debug("where it went wrong", exc_info=True)


def _most(scope: Scope) -> float:
    """Return the size limit of a request's body [bytes]; files of apps have other limits."""
    return inf if scope["path"].startswith("/v1/assets/") else MOST_BODY_BYTES


async def _read_on(chunks: AsyncIterator[bytes]) -> None:
    """Read the rest of a file: who still sends would be cut off, and would not hear the answer."""
    left = m.Limits().asset_bytes
    async for chunk in chunks:
        left -= len(chunk)
        if left < 0:
            break


def _bounded(receive: Receive) -> Receive:
    """Refuse a body of unknown length once it is too long or has too many values."""
    body = bytearray()

    async def receives() -> MutableMapping[str, Any]:
        message = await receive()
        body.extend(message.get("body", b""))
        if len(body) > MOST_BODY_BYTES:
            raise HTTPException(413, f"expected a body of at most {MOST_BODY_BYTES} bytes")
        if not message.get("more_body") and (why := reading.too_many(body)):
            raise HTTPException(413, why)
        return message

    return receives


def _in_time(receive: Receive, is_file: bool) -> Receive:
    """Refuse a body that comes too slowly: nobody holds a connection for ever by one."""
    longest_s = FILE_S if is_file else BODY_S
    end_s: float | None = asyncio.get_running_loop().time() + longest_s

    async def receives() -> MutableMapping[str, Any]:
        nonlocal end_s
        try:
            async with asyncio.timeout_at(end_s):
                message = await receive()
        except TimeoutError:
            why, closes = f"expected the whole body within {longest_s:g} s", {"connection": "close"}
            raise HTTPException(408, why, closes) from None
        if not message.get("more_body"):
            end_s = None  # from now on it waits for the client to leave
        return message

    return receives


async def _refuse(
    scope: Scope, receive: Receive, send: Send, status: int, why: str, code: str = "access"
) -> None:
    if scope["type"] == "websocket":
        await receive()
        await send({"type": "websocket.close", "code": 4403, "reason": why})
        return
    content = {"id": 0, "code": code, "sentence": why, "path": ""}
    await JSONResponse(content, status)(scope, receive, send)


def _cors(origin: str) -> dict[str, str]:
    return {
        "access-control-allow-origin": origin,
        "access-control-allow-methods": "GET, POST, PUT, DELETE",
        "access-control-allow-headers": "authorization, content-type, if-match",
        "access-control-expose-headers": "etag",
        "access-control-max-age": "600",
        "vary": "origin",
    }


def _with_headers(send: Send, origin: str | None, access: Access) -> Send:
    """Add the headers that isolate pages to every answer."""
    is_own = origin is None or origin in access.origins

    async def sends(message: MutableMapping[str, Any]) -> None:
        if message["type"] == "http.response.start":
            headers = {
                "x-content-type-options": "nosniff",
                "cross-origin-resource-policy": "same-site" if is_own else "cross-origin",
                "referrer-policy": "no-referrer",
                "cache-control": "no-store",
            } | ({} if is_own or origin is None else _cors(origin))
            message["headers"] = [
                *message.get("headers", []),
                *((key.encode(), value.encode()) for key, value in headers.items()),
            ]
        await send(message)

    return sends


class Server(BaseModel):
    """Name and version of the service."""

    name: str
    version: str
    protocol: str


class Pairing(BaseModel):
    """A page's request for a token."""

    model_config = ConfigDict(extra="forbid")
    code: Annotated[str, Field(max_length=20)]
    name: Annotated[str, Field(min_length=1, max_length=100)]


class Code(BaseModel):
    """The code that pairs a page."""

    code: str


class Token(BaseModel):
    """The token of a paired page for its `hello`."""

    token: str


_REFUSED: dict[int | str, dict[str, Any]] = {
    status: {"model": m.Error} for status in (403, 404, 413, 421, 422, 429, 503)
}


def application(
    hub: Hub,
    assets: AssetStore,
    start: Callable[[], Awaitable[None]] | None = None,
    end: Callable[[], Awaitable[None]] | None = None,
    documents: APIRouter | None = None,
) -> Any:
    """Return the ASGI application around a hub and the files that apps send."""

    @asynccontextmanager
    async def life(_: FastAPI) -> AsyncIterator[None]:
        if start is not None:
            await start()
        ticking = asyncio.create_task(_ticks(hub))
        try:
            yield
        finally:
            ticking.cancel()
            hub.stop("the service ends")
            await hub.jobs.stop()
            if end is not None:
                await end()

    app = FastAPI(
        title="haptix",
        version=__version__,
        lifespan=life,
        docs_url=None,  # its pages come from another server
        redoc_url=None,
        openapi_url="/v1/openapi.json",
        responses=_REFUSED,
    )

    limiters: dict[str, Limiter] = {}  # by owner

    async def token(
        request: Request, authorization: Annotated[str | None, Header()] = None
    ) -> None:
        bearer = (authorization or "").removeprefix("Bearer ")
        if not hub.access.lets_in(bearer, request.headers.get("origin")):
            raise Problem("access", "expected the header Authorization: Bearer TOKEN")
        request.state.owner = owner = hub.access.owner_of(bearer)
        if owner not in limiters:
            limiters[owner] = Limiter(m.Limits().messages_per_s, hub.now_s)
        await asyncio.sleep(limiters[owner].wait_s())

    @app.exception_handler(Problem)
    async def refuse(_: Request, problem: Problem) -> Response:
        error = m.Error(id=0, code=problem.code, sentence=problem.sentence, path=problem.path)
        return JSONResponse(error.model_dump(), _HTTP_STATUS[problem.code])

    @app.exception_handler(HTTPException)
    async def refuse_request(request: Request, error: HTTPException) -> Response:
        """Answer the framework's refusals like all others: no route, no JSON, a body too long."""
        codes: dict[int, Any] = {404: "unknown", 405: "unknown", 408: "limit", 413: "limit"}
        sentence = error.detail
        if error.status_code in (404, 405):
            sentence = f"no route {request.method} {request.url.path[:80]!r}; /docs has them all"
        wrong = m.Error(id=0, code=codes.get(error.status_code, "message"), sentence=sentence)
        status = 422 if error.status_code == 400 else error.status_code
        return JSONResponse(wrong.model_dump(), status, error.headers)

    @app.exception_handler(RequestValidationError)
    async def refuse_body(_: Request, error: RequestValidationError) -> Response:
        first = error.errors()[0]
        path = "".join(f"/{part}" for part in first["loc"][1:])
        why = first["msg"].removeprefix("Value error, ")
        sentence = f"{path[1:]}: {why}"
        if not path:  # the body was not read as JSON, or is no object
            sentence = "expected an object of JSON, with the header content-type: application/json"
        content = m.Error(id=0, code="message", sentence=sentence, path=path)
        return JSONResponse(content.model_dump(), 422)

    @app.exception_handler(Exception)
    async def fail(_: Request, error: Exception) -> Response:
        """Answer unforeseen errors and a full disk by a sentence, too."""
        sentence = f"a fault of the service: {type(error).__name__}; see its log"
        status = 507 if is_full_disk(error) else 500
        if isinstance(error, OSError):
            sentence = f"cannot be kept: {write_failure(error, hub.access.folder)}"
        elif isinstance(error, HaptixError):
            sentence = str(error)
        wrong = m.Error(id=0, code="internal", sentence=sentence)
        return JSONResponse(wrong.model_dump(), status)

    @app.get("/v1/server", dependencies=[Depends(token)])
    async def server() -> Server:
        """Name, version and protocol of the service."""
        return Server(name="haptix", version=__version__, protocol="{}.{}".format(*m.PROTOCOL))

    @app.post("/v1/pair")
    async def pair(request: Request, body: Pairing) -> Token:
        """Give a page a token for the code that the terminal shows."""
        return Token(token=hub.access.pair(body.code, request.headers.get("origin"), body.name))

    @app.delete("/v1/pair", status_code=204, dependencies=[Depends(token)])
    async def forget(authorization: Annotated[str, Header()]) -> None:
        """Take the token back."""
        hub.access.forget(authorization.removeprefix("Bearer "))

    @app.get("/v1/pair/code", dependencies=[Depends(token)])
    async def code(request: Request) -> Code:
        """The code for a page, for programs of this user: a service at log-in has no terminal."""
        if request.state.owner != "programs":
            raise Problem("access", "only programs of this user may read the code")
        return Code(code=hub.access.code())

    @app.get("/v1/devices", dependencies=[Depends(token)])
    async def devices() -> m.Inventory:
        """Devices and installed profiles."""
        return hub.inventory

    @app.get("/v1/kinds", dependencies=[Depends(token)])
    async def kinds() -> dict[str, Any]:
        """JSON Schema of all kinds of material, and of the signals within them."""
        if not hub.schema:
            raise Problem("device", "the engine is not there yet; ask again")
        return hub.schema

    @app.put("/v1/assets/{digest}", status_code=201, dependencies=[Depends(token)])
    async def put_asset(digest: str, suffix: str, request: Request, response: Response) -> None:
        """Keep a file under its SHA-256: 201, or 200 if it is kept already."""
        chunks = request.stream()
        try:
            if not await assets.put(digest, suffix, chunks):
                response.status_code = 200
        except Exception:
            await _read_on(chunks)
            raise
        await _read_on(chunks)

    @app.get("/v1/assets/{digest}", dependencies=[Depends(token)])
    async def get_asset(digest: str) -> Response:
        """A file by its SHA-256."""
        return FileResponse(assets.path(digest), media_type="application/octet-stream")

    @app.get("/v1/schemas/session", dependencies=[Depends(token)])
    async def schema() -> dict[str, Any]:
        """JSON Schema of the session's messages."""
        return reading.schema()

    @app.get("/v1/asyncapi.json", include_in_schema=False)
    async def session_description() -> dict[str, Any]:
        return reading.asyncapi()

    @app.get("/docs", include_in_schema=False)
    async def docs() -> Response:
        content = docs_page(app.openapi(), reading.asyncapi())
        headers = {"content-security-policy": POLICY}
        return Response(content, media_type="text/html; charset=utf-8", headers=headers)

    @app.post("/stop", status_code=204)
    async def stop(request: Request) -> None:
        """End at 0 V. A form can ask for it, so that it works while a page's script hangs."""
        if request.headers.get("sec-fetch-site") == "cross-site":
            raise Problem("access", "pages of other sites cannot stop the output")
        hub.stop("stopped by the button")

    app.include_router(profiles_router(hub, token))
    app.include_router(jobs_router(hub.jobs), dependencies=[Depends(token)])
    app.include_router(pages(hub.access))
    if documents is not None:
        app.include_router(documents, dependencies=[Depends(token)])

    @app.websocket("/v1/session")
    async def session(socket: WebSocket) -> None:
        if SUBPROTOCOL not in socket.scope["subprotocols"]:
            await socket.close(4400, f"expected the subprotocol {SUBPROTOCOL}")
            return
        try:
            client = hub.open(socket.headers.get("origin"))
        except Problem as problem:
            await socket.accept(SUBPROTOCOL)  # a socket that is not accepted gives no reason
            await socket.close(4429, problem.sentence)
            return
        socket.scope["state"]["session"] = client  # for `Connection.rank`
        await socket.accept(SUBPROTOCOL)
        await serve_session(hub, socket, client)

    return Guard(app, hub.access)


async def _ticks(hub: Hub) -> None:
    while True:
        hub.tick()
        await asyncio.sleep(TICK_S)


_STUDIO = Path(__file__).parents[2] / "studio"
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
    async def button(request: Request) -> Response:
        name, _, port = request.headers["host"].rpartition(":")
        is_here = name in ("localhost", "127.0.0.1") and access.stop_port != int(port)
        own = f"http://{name}:{access.stop_port}/stop" if is_here else ""
        headers = {"content-security-policy": _stop_policy(access.origins, own)}
        page = Path(_file("studio", "stop.html")).read_text("utf-8")
        return HTMLResponse(page.replace('data-own=""', f'data-own="{own}"'), headers=headers)

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


def _stop_policy(origins: frozenset[str], own: str) -> str:
    """Content-Security-Policy of the STOP button, which the service's own pages frame."""
    frames = " ".join(sorted(origin for origin in origins if "[" not in origin))
    return f"{_ANY_PAGE}; connect-src 'self' {own}; frame-ancestors {frames}"


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
