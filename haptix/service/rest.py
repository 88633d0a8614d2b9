"""Routes over REST that do work: documents of materials and layouts, and jobs.

Each route's body and answer is a model, so that the description of the service names all fields.
Routes of tasks are made from their declarations at the desk; what takes long goes to the pool of
workers or becomes a job.
"""

from __future__ import annotations

import asyncio
import base64
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, Self, get_type_hints

from fastapi import APIRouter, Request, Response
from fastapi import Path as PathParameter
from fastapi.responses import FileResponse
from pydantic import BaseModel, ConfigDict, Field, model_validator

from haptix.desk import Task, all_tasks, task_at
from haptix.fields import FOLDER_NAME, JsonObject
from haptix.gallery import FOLDER, presets
from haptix.service.document_work import EXPORT
from haptix.service.jobs import JobBoard
from haptix.service.kept_layouts import layouts_router, read_layout
from haptix.service.messages import Error, JobMessage, Problem
from haptix.service.pool import Pool

_MOST_COLUMNS_MOVING = 160
Size = Annotated[float, Field(gt=0, le=1e4, allow_inf_nan=False)]
Force = Annotated[float, Field(gt=0, le=100, allow_inf_nan=False)]


class PresetMessage(BaseModel):
    """A preset of the gallery; see `haptix.gallery.Preset`."""

    name: str
    title: str
    family: str
    help: str
    width_mm: float
    height_mm: float
    reachable: float
    document: dict[str, Any]
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
    normal_force_n: Force = 0.5
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
    """What a material asks for on a grid, for a finger that goes right at 80 mm/s."""

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
    normal_force_n: Force = 0.5


class Checked(BaseModel):
    """A material with all its fields, and what it can do on this screen."""

    canonical: dict[str, Any]
    target: str
    depends_on: tuple[str, ...]
    lowest_mu: float
    highest_mu: float
    range_jnd: float
    """The reachable range in just-noticeable differences."""
    effects_jnd: dict[str, float]
    """By field: what one step of it changes."""


def documents_router(pool: Pool, layouts: Path) -> APIRouter:
    """Return the routes.

    Parameters
    ----------
    pool : Pool
        Draws, checks and exports.
    layouts : Path
        Folder of kept layouts.
    """
    router = APIRouter(prefix="/v1")
    router.include_router(layouts_router(layouts))

    @router.get("/gallery")
    async def gallery() -> tuple[PresetMessage, ...]:
        """Presets of materials by family."""
        return tuple(
            PresetMessage(
                **{
                    key: getattr(preset, key)
                    for key in PresetMessage.model_fields
                    if hasattr(preset, key)
                },
                thumbnail=_data_url(FOLDER / "thumbnails" / f"{preset.name}.png"),
            )
            for preset in presets()
        )

    schema: asyncio.Future[dict[str, Any]] | None = None

    @router.get("/kinds")
    async def kinds(request: Request) -> dict[str, Any]:
        """JSON Schema of all kinds of material, and of the signals within them."""
        # It is the same for all, so it is asked for once; pictures that wait must not refuse it.
        nonlocal schema
        if schema is None or (schema.done() and (schema.cancelled() or schema.exception())):
            question = pool.ask(request.state.owner, "schema", is_limited=False)
            schema = asyncio.ensure_future(question)
        return await asyncio.shield(schema)

    @router.post("/pictures")
    async def picture(request: Request, body: PictureRequest) -> Picture:
        """Draw what a material asks for."""
        return Picture(**await pool.ask(request.state.owner, "picture", **body.model_dump()))

    @router.post("/materials/check")
    async def check(request: Request, body: CheckRequest) -> Checked:
        """Check a material: its fields, what it depends on, what a step of each field changes."""
        return Checked(**await pool.ask(request.state.owner, "check", **body.model_dump()))

    async def export(request: Request, body: BaseModel) -> Response:
        fields = body.model_dump()
        regions = read_layout(fields["document"]).model_dump(mode="json", exclude_none=True)[
            "regions"
        ]
        fields["document"] = {"kind": "layout", "regions": regions}
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
        """How far a job is, what it asks, and its result."""
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
        """Answer what a job asks."""
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
    """Let a handler take a task's parameters, and say what the task says."""
    handler.__annotations__ = {**get_type_hints(handler), "body": task.body()}
    handler.__doc__ = task.__doc__
    return handler
