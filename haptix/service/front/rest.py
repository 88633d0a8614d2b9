"""Routes over REST that do work: documents of materials and layouts, kept layouts, and jobs.

Each route's body and answer is a model, so that the description of the service names all fields.
Routes of tasks are made from their declarations; what takes long goes to the pool of
workers or becomes a job.

A kept layout is a folder of its versions, `NAME/REVISION.json`: a write adds one and replaces none;
that of a removed layout is `REMOVED`. A write carries, as `If-Match`, the revision that it was made
from; without one it makes a new layout. So nobody overwrites what he has not seen.
"""

from __future__ import annotations

import base64
import json
import shutil
import threading
from collections.abc import Awaitable, Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, NamedTuple, Self, get_type_hints

from fastapi import APIRouter, Header, Request, Response
from fastapi import Path as PathParameter
from fastapi.responses import FileResponse
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from haptix.base.fields import FOLDER_NAME, JsonObject
from haptix.base.files import parse_json, write_whole
from haptix.base.task import Task, all_tasks, task_at
from haptix.feel.gallery import FOLDER, Preset, presets
from haptix.service.front.jobs import JobBoard
from haptix.service.front.pool import Pool
from haptix.service.protocol.messages import Error, JobMessage, LayoutDocument, Problem
from haptix.service.worker.document_work import EXPORT, FORCE_N

_MOST_COLUMNS_MOVING = 160
Size = Annotated[float, Field(gt=0, le=1e4, allow_inf_nan=False)]
Force = Annotated[float, Field(gt=0, le=100, allow_inf_nan=False)]


@dataclass(frozen=True)
class PresetMessage(Preset):
    """A preset of the gallery; see `haptix.feel.gallery.Preset`."""

    thumbnail: str
    """A picture of it, as a data URL."""


class PictureRequest(BaseModel):
    """What `POST /v1/pictures` takes."""

    model_config = ConfigDict(extra="forbid")
    material: JsonObject
    width_mm: Size
    height_mm: Size
    columns: Annotated[int, Field(ge=1, le=400)] = 160
    t_s: Annotated[float, Field(ge=0, le=3600)] = 0.0
    normal_force_n: Force = FORCE_N
    frames: Annotated[int, Field(ge=1, le=60)] = 1
    """Pictures, one after the other in time; of more than 1, at most 160 columns."""
    frame_s: Annotated[float, Field(gt=0, le=1)] = 0.05
    """Between two of them."""

    @model_validator(mode="after")
    def _is_not_much(self) -> Self:
        if self.frames > 1 and self.columns > _MOST_COLUMNS_MOVING:
            raise ValueError(f"columns: expected {_MOST_COLUMNS_MOVING} or fewer of several frames")
        return self


class Picture(BaseModel):
    """Wanted friction of a material on a grid, for a finger that goes right at 80 mm/s."""

    columns: int
    rows: int
    levels: str
    """A byte for each place, frame by frame and row by row, in base64: ``(share + 0.5) * 127.5``,
    with `share` that of the reachable friction."""
    below: float
    above: float
    """Shares of the places that ask for less, or more, than the screen can give."""
    lowest_mu: float
    highest_mu: float


class CheckRequest(BaseModel):
    """What `POST /v1/materials/check` takes."""

    model_config = ConfigDict(extra="forbid")
    material: JsonObject
    normal_force_n: Force = FORCE_N


class Checked(BaseModel):
    """A material with all its fields, and its range on this screen."""

    canonical: dict[str, Any]
    target: str
    depends_on: tuple[str, ...]
    lowest_mu: float
    highest_mu: float
    range_jnd: float
    """The reachable range in just-noticeable differences."""
    effects_jnd: dict[str, float]
    """By field: the effect of one step."""


Reach = Callable[[float], Awaitable[tuple[float, float]]]


def documents_router(pool: Pool, layouts: Path, reach: Reach) -> APIRouter:
    """Return the routes.

    Parameters
    ----------
    pool : Pool
        Draws, checks and exports.
    layouts : Path
        Folder of kept layouts.
    reach : callable
        Returns the lowest and highest friction coefficient of the screen at a force [N].
    """
    router = APIRouter(prefix="/v1")
    router.include_router(layouts_router(layouts))

    @router.get("/gallery")
    async def gallery() -> tuple[PresetMessage, ...]:
        """Presets of materials by family."""
        return tuple(
            PresetMessage(
                **vars(preset), thumbnail=_data_url(FOLDER / "thumbnails" / f"{preset.name}.png")
            )
            for preset in presets()
        )

    async def asks(request: Request, do: str, body: BaseModel) -> dict[str, Any]:
        fields = body.model_dump()
        reachable_mu = await reach(fields.pop("normal_force_n"))
        return await pool.ask(request.state.owner, do, reachable_mu=reachable_mu, **fields)

    @router.post("/pictures")
    async def picture(request: Request, body: PictureRequest) -> Picture:
        """Draw the wanted friction of a material."""
        return Picture(**await asks(request, "picture", body))

    @router.post("/materials/check")
    async def check(request: Request, body: CheckRequest) -> Checked:
        """Check a material: its fields, its dependences, the effect of a step of each field."""
        return Checked(**await asks(request, "check", body))

    async def export(request: Request, body: BaseModel) -> Response:
        fields = body.model_dump()
        layout = read_layout(fields["document"]).model_dump(mode="json", exclude_none=True)
        fields["document"] = {"kind": "layout", **layout}
        fields["reachable_mu"] = await reach(FORCE_N)
        answer = await pool.ask(request.state.owner, "export", **fields)
        return Response(base64.b64decode(answer["content"]), media_type="application/zip")

    router.post("/exports", response_class=Response)(_takes(task_at(EXPORT), export))
    return router


def _data_url(path: Path) -> str:
    return f"data:image/png;base64,{base64.b64encode(path.read_bytes()).decode()}"


JobName = Annotated[str, PathParameter(pattern=r"^[0-9a-f]{1,32}$")]


class Answer(BaseModel):
    """What `POST /v1/jobs/{job}/answer` takes."""

    model_config = ConfigDict(extra="forbid")
    text: Annotated[str, Field(max_length=1000)]


def jobs_router(board: JobBoard) -> APIRouter:
    """Return the routes of a board of jobs, whose requests know their `state.owner`."""
    router = APIRouter(prefix="/v1", responses={409: {"model": Error}})

    for task in all_tasks():
        if task.route:
            about = {"x-task": task.kind}  # so that a page can offer a form for it
            begins = _begins(board, task)
            router.post(f"/{task.route}", status_code=202, openapi_extra=about)(begins)

    @router.get("/surfaces")
    async def surfaces(request: Request) -> tuple[JobMessage, ...]:
        """Surfaces that were asked for, with their progress."""
        return tuple(job for job in board.all(request.state.owner) if job.kind == "surface")

    @router.get("/calibrations/{name}/report", response_class=FileResponse)
    async def report(name: Annotated[str, PathParameter(pattern=FOLDER_NAME)]) -> FileResponse:
        """The report of a calibration: a page to keep, with its pictures inside."""
        folder = board.context.get("calibrations")  # none before the engine is there
        path = Path(folder or "") / name / "report.html"
        if folder is None or not path.is_file():
            raise Problem("unknown", f"no calibration called {name!r} has a report", "/name")
        return FileResponse(path, filename=f"{name}.html")

    @router.get("/jobs")
    async def jobs(request: Request) -> tuple[JobMessage, ...]:
        """Your jobs, the oldest first: a page's, or those of all programs of this user."""
        return board.all(request.state.owner)

    @router.get("/jobs/{job}")
    async def job(request: Request, job: JobName) -> JobMessage:
        """Progress, question and result of a job."""
        return board.get(job, request.state.owner).message

    @router.get("/jobs/{job}/files")
    async def files(request: Request, job: JobName) -> tuple[str, ...]:
        """Names of the files that a job has written."""
        return tuple(board.files(job, request.state.owner))

    @router.get("/jobs/{job}/files/{name:path}", response_class=FileResponse)
    async def file(request: Request, job: JobName, name: str) -> FileResponse:
        """A file that a job has written."""
        path = board.files(job, request.state.owner).get(name)
        if path is None:
            raise Problem("unknown", f"this job has no file {name!r:.80}", "/name")
        return FileResponse(path, filename=path.name)

    @router.delete("/jobs/{job}", status_code=204)
    async def cancel(request: Request, job: JobName) -> Response:
        """End a job."""
        board.cancel(board.get(job, request.state.owner))
        return Response(status_code=204)

    @router.post("/jobs/{job}/answer", status_code=204)
    async def answer(request: Request, job: JobName, body: Answer) -> Response:
        """Answer the question of a job."""
        board.get(job, request.state.owner).answer(body.text)
        return Response(status_code=204)

    return router


def _begins(board: JobBoard, task: type[Task]) -> Callable[..., Any]:
    """Return the handler that begins a task's job."""

    async def begin(request: Request, body: BaseModel) -> JobMessage:
        fields = body.model_dump(exclude_unset=True)
        return board.begin(task.kind, request.state.owner, **fields)

    begin.__name__ = task.kind
    return _takes(task, begin)


def _takes(task: type[Task], handler: Callable[..., Any]) -> Callable[..., Any]:
    """Give a handler a task's parameters and description."""
    handler.__annotations__ = {**get_type_hints(handler), "body": task.body()}
    handler.__doc__ = task.__doc__
    return handler


MOST_LAYOUTS, MOST_VERSIONS = 1000, 50
MOST_DRAFTS, MOST_REMOVED = 100, 100
_NAME = r"^[A-Za-z0-9][A-Za-z0-9 _.-]{0,79}$"
Name = Annotated[str, PathParameter(pattern=_NAME)]
IfMatch = Annotated[str | None, Header()]


class Version(BaseModel):
    """A version of a kept layout, or a draft: its revision, and when it was written."""

    name: str
    revision: int
    unix_s: float


class Draft(BaseModel):
    """A layout that is being edited, and the revision that it is based on."""

    model_config = ConfigDict(extra="forbid")
    name: Annotated[str, Field(pattern=_NAME)]
    made_from: Annotated[int, Field(ge=1)] | None = None
    """Revision of the kept layout; none where none is kept."""
    document: JsonObject
    """As the page has it: a draft that is wrong is kept, too."""


class Rename(BaseModel):
    """What `POST /v1/layouts/{name}/rename` takes."""

    model_config = ConfigDict(extra="forbid")
    to: Annotated[str, Field(pattern=_NAME)]


class _Kept(NamedTuple):
    revision: int
    path: Path


REMOVED = b'{"removed":true}'


def _is_removed(version: _Kept) -> bool:
    is_as_long = version.path.stat().st_size == len(REMOVED)
    return is_as_long and version.path.read_bytes() == REMOVED


class KeptTexts:
    """Texts by name, each with its last versions; every write names the revision it is based on.

    Parameters
    ----------
    folder : Path
        Made if it does not exist. A file `NAME.json` in it becomes the newest version of its name.
    fields : mapping of type, optional
        What each text has at least, where it is an object of JSON.
    most_versions : int
        Older ones go.
    """

    def __init__(
        self,
        folder: Path,
        fields: Mapping[str, type] | None = None,
        most_versions: int = MOST_VERSIONS,
    ) -> None:
        self._folder, self._fields, self._most = folder, fields, most_versions
        self._lock = threading.RLock()
        folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        for path in folder.glob("*.json"):
            if path.is_file():
                (folder / path.stem).mkdir(exist_ok=True)
                path.replace(self._next(path.stem))

    def names(self, are_removed: bool = False) -> list[str]:
        """Return the names that are kept, or those of which only history is."""
        with self._lock:
            names = sorted(path.name for path in self._folder.iterdir() if path.is_dir())
            return [
                name
                for name in names
                if self._all(name) and (self._now(name) is None) == are_removed
            ]

    def versions(self, name: str) -> list[Version]:
        """Return the readable versions of a name, the newest first."""
        with self._lock:
            return [
                Version(name=name, revision=version.revision, unix_s=version.path.stat().st_mtime)
                for version in reversed(self._all(name))
                if not _is_removed(version)
            ]

    def read(self, name: str, revision: int | None = None) -> tuple[str, int]:
        """Return a text and its revision: the newest, or that of a version."""
        with self._lock:
            version = self._now(name)
            if revision is not None:
                version = next((v for v in self._all(name) if v.revision == revision), None)
            data = None if version is None else version.path.read_bytes()
        if version is None or data is None or data == REMOVED:
            what = f"no layout is called {name!r}"
            raise Problem("unknown", what if revision is None else f"{what}, {revision}")
        try:
            text = data.decode()
            self._check_fields(parse_json(text))
        except ValueError as error:
            raise Problem(
                "document",
                f"revision {version.revision} of {name!r} is damaged: {error}; read an earlier "
                f"one, and keep it over this one by If-Match {_etag(version.revision)}",
            ) from None
        return text, version.revision

    def _check_fields(self, value: Any) -> None:
        for field, kind in (self._fields or {}).items():
            if not isinstance(value, dict) or not isinstance(value.get(field), kind):
                raise ValueError(f"expected an object with {field}, got {value!r:.40}")

    def write(self, name: str, text: str, made_from: str | None) -> int:
        """Add a version and return its revision; an equal text is written once."""
        with self._lock:
            now = self._now(name)
            if now is not None and now.path.read_bytes() == text.encode():
                return now.revision
            self._check(name, now, made_from)
            path = self._next(name)
            write_whole(path, text)
            for old in self._all(name)[: -self._most]:
                old.path.unlink()
            return int(path.stem)

    def remove(self, name: str, made_from: str | None) -> None:
        """Remove a layout; its versions stay, and the last one can be written again."""
        with self._lock:
            now = self._now(name)
            if now is None:
                raise Problem("unknown", f"no layout is called {name!r}")
            self._check(name, now, made_from)
            write_whole(self._next(name), REMOVED)
            removed = self.names(are_removed=True)
            removed.sort(key=lambda name: self._all(name)[-1].path.stat().st_mtime)
            for old in removed[:-MOST_REMOVED]:
                shutil.rmtree(self._folder / old)

    def rename(self, name: str, to: str, made_from: str | None) -> None:
        """Give a layout, with its versions, a name that no other one has."""
        with self._lock:
            now = self._now(name)
            if now is None:
                raise Problem("unknown", f"no layout is called {name!r}")
            self._check(name, now, made_from)
            if self._now(to) is not None:
                raise Problem("order", f"a layout is called {to!r} already; choose another name")
            if (self._folder / to).exists():  # a removed one: it stays, beside
                numbers = range(2, len(list(self._folder.iterdir())) + 3)
                free = (f"{to[:70]} {n}" for n in numbers)
                aside = next(name for name in free if not (self._folder / name).exists())
                (self._folder / to).rename(self._folder / aside)
            (self._folder / name).rename(self._folder / to)

    def _check(self, name: str, now: _Kept | None, made_from: str | None) -> None:
        """Raise `Problem` unless a write is based on the kept revision."""
        if made_from is None and now is not None:
            why = f"{name!r} is kept already: read it first and send its ETag as If-Match, or keep "
            raise Problem("stale", f"{why}yours under another name")
        if made_from is not None and now is None:
            why = f"{name!r} was removed or renamed meanwhile; keep yours under another name"
            raise Problem("stale", why)
        if now is not None and made_from != _etag(now.revision):
            why = f"another page or app has kept {name!r} meanwhile (revision {now.revision}): read"
            raise Problem("stale", f"{why} that one, or keep yours under another name")

    def _all(self, name: str) -> list[_Kept]:
        """Return the versions of a name, the oldest first."""
        paths = (self._folder / name).glob("*.json")
        return sorted(_Kept(int(path.stem), path) for path in paths if path.stem.isdecimal())

    def _now(self, name: str) -> _Kept | None:
        """Return the newest version, or None where the layout is removed or was never there."""
        newest = self._all(name)[-1:]
        return newest[0] if newest and not _is_removed(newest[0]) else None

    def _next(self, name: str) -> Path:
        # A new name may be that of a layout until its rename, whose revisions apps still hold.
        known = self._all(name) or [
            one for of in self._folder.iterdir() for one in self._all(of.name)
        ]
        revision = 1 + max((version.revision for version in known), default=0)
        return self._folder / name / f"{revision}.json"


def layouts_router(folder: Path) -> APIRouter:
    """Return the routes of kept layouts, and of drafts, which lie in `drafts` beside them.

    Their handlers run in threads: a disk that is slow keeps no touch waiting.
    """
    router = APIRouter(responses={412: {"model": Error}})
    layouts = KeptTexts(folder, {"regions": list})
    drafts = KeptTexts(folder.parent / "drafts", {"name": str, "document": dict}, most_versions=1)

    @router.get("/layouts")
    def names(removed: bool = False) -> tuple[str, ...]:
        """Names of the layouts that are kept, or of those that were removed and can be read."""
        return tuple(layouts.names(removed))

    @router.get("/layouts/{name}", response_model=LayoutDocument)
    def get_layout(name: Name) -> Response:
        """A layout; its `ETag`, the revision, is for `If-Match`."""
        return _answer(*layouts.read(name))

    @router.put("/layouts/{name}", status_code=204, response_model=None)
    def put_layout(name: Name, document: JsonObject, if_match: IfMatch = None) -> Response:
        """Keep a layout: a new one, or with `If-Match` over the one that has this `ETag`."""
        text = read_layout(document).model_dump_json(exclude_none=True)
        if if_match is None and len(layouts.names()) >= MOST_LAYOUTS:
            raise Problem("limit", f"expected at most {MOST_LAYOUTS} layouts; remove one")
        return _written(layouts.write(name, text, if_match))

    @router.delete("/layouts/{name}", status_code=204)
    def delete_layout(name: Name, if_match: IfMatch = None) -> None:
        """Remove a layout. Its versions stay; the last one can be kept again."""
        layouts.remove(name, if_match)

    @router.post("/layouts/{name}/rename", status_code=204)
    def rename_layout(name: Name, body: Rename, if_match: IfMatch = None) -> None:
        """Give a layout another name, with its versions."""
        layouts.rename(name, body.to, if_match)

    @router.get("/layouts/{name}/versions")
    def versions(name: Name) -> tuple[Version, ...]:
        """The last versions of a layout, the newest first, also of a removed one."""
        return tuple(layouts.versions(name))

    @router.get("/layouts/{name}/versions/{revision}", response_model=LayoutDocument)
    def get_version(name: Name, revision: int) -> Response:
        """A version of a layout."""
        return _answer(*layouts.read(name, revision))

    @router.get("/drafts")
    def all_drafts() -> tuple[Version, ...]:
        """Drafts, the newest first."""
        unsorted = (version for name in drafts.names() for version in drafts.versions(name))
        return tuple(sorted(unsorted, key=lambda version: -version.unix_s))

    @router.get("/drafts/{name}", response_model=Draft)
    def get_draft(name: Name) -> Response:
        """A draft; its `ETag` is for `If-Match`."""
        return _answer(*drafts.read(name))

    @router.put("/drafts/{name}", status_code=204, response_model=None)
    def put_draft(name: Name, body: Draft, if_match: IfMatch = None) -> Response:
        """Keep a draft, apart from the layouts; of more than 100 the oldest is removed."""
        revision = drafts.write(name, body.model_dump_json(), if_match)
        for old in all_drafts()[MOST_DRAFTS:]:
            drafts.remove(old.name, _etag(old.revision))
        return _written(revision)

    @router.delete("/drafts/{name}", status_code=204)
    def delete_draft(name: Name, if_match: IfMatch = None) -> None:
        """Remove a draft."""
        drafts.remove(name, if_match)

    return router


def read_layout(document: dict[str, Any]) -> LayoutDocument:
    """Read a layout as the session does: from JSON, which knows lists and no tuples."""
    try:
        return LayoutDocument.model_validate_json(json.dumps(document))
    except ValidationError as error:
        first = error.errors()[0]
        path = "".join(f"/{part}" for part in first["loc"])
        raise Problem("document", f"{path[1:]}: {first['msg']}", path) from None


def _etag(revision: int) -> str:
    return f'"{revision}"'


def _answer(text: str, revision: int) -> Response:
    """Answer with the kept text as it is."""
    return Response(text, media_type="application/json", headers={"etag": _etag(revision)})


def _written(revision: int) -> Response:
    return Response(status_code=204, headers={"etag": _etag(revision)})
