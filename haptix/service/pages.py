"""The studio's pages over HTTP."""

from __future__ import annotations

from fastapi import APIRouter, Request
from fastapi.responses import FileResponse, RedirectResponse, Response

from haptix.service.access import Access
from haptix.service.messages import Problem
from haptix.studio.pages import page_file, policy, stop_policy


def pages(access: Access) -> APIRouter:
    """Return the routes of the pages: the first one at ``/``, STOP at ``/stop``."""
    router = APIRouter(include_in_schema=False)

    @router.get("/")
    async def first(request: Request) -> Response:
        return _page(request, "studio", "index.html")

    @router.get("/stop")
    async def button() -> Response:
        headers = {"content-security-policy": stop_policy(access.origins)}
        return FileResponse(_found("studio", "stop.html"), headers=headers)

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
    return FileResponse(_found(folder, path), headers={"content-security-policy": policy(host)})


def _found(folder: str, path: str) -> str:
    found = page_file(folder, path)
    if found is None:
        raise Problem("unknown", f"expected a file of the studio, got {path}")
    return str(found)
