"""Jobs over REST."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

from fastapi import APIRouter, Request, Response
from fastapi import Path as PathParameter
from fastapi.responses import FileResponse
from pydantic import BaseModel, ConfigDict, Field

from haptix.desk import Task, all_tasks
from haptix.service.jobs import JobBoard
from haptix.service.messages import Error, JobMessage, Problem

JobName = Annotated[str, PathParameter(pattern=r"^[0-9a-f]{1,32}$")]
_FOLDER = r"^[A-Za-z0-9][A-Za-z0-9_-]{0,79}$"
FolderName = Annotated[str, Field(pattern=_FOLDER)]


class ExperimentAsked(BaseModel):
    """What `POST /v1/experiments` takes."""

    model_config = ConfigDict(extra="forbid")
    recipe: dict[str, Any]
    """As the file of `haptix stimuli run`; without volts."""
    log: FolderName
    """Name of the table of trials. One that exists is continued."""
    participant: Annotated[int, Field(ge=1, le=10_000)] = 1
    """Number from 1, which decides the order of a recipe's blocks."""


class CalibrationAsked(BaseModel):
    """What `POST /v1/calibrations` takes."""

    model_config = ConfigDict(extra="forbid")
    name: FolderName
    """Of its folder: one that was planned on this machine is continued, another is a practice."""
    minutes: Annotated[float, Field(ge=2, le=60)] = 3.0
    """Of a practice's strokes."""


class Answer(BaseModel):
    """What `POST /v1/jobs/{job}/answer` takes."""

    model_config = ConfigDict(extra="forbid")
    text: Annotated[str, Field(max_length=1000)]


def jobs_router(board: JobBoard) -> APIRouter:
    """Return the routes of a board of jobs, whose requests know their `state.owner`."""
    router = APIRouter(prefix="/v1", responses={409: {"model": Error}})

    for task in all_tasks():
        if task.route:
            router.post(f"/{task.route}", status_code=202)(_begins(board, task))

    @router.get("/surfaces")
    async def surfaces(request: Request) -> tuple[JobMessage, ...]:
        """Surfaces that were asked for, with their progress."""
        return tuple(one for one in board.all(request.state.owner) if one.kind == "surface")

    @router.post("/experiments", status_code=202)
    async def experiment(request: Request, asked: ExperimentAsked) -> JobMessage:
        """Run an adaptive experiment on the device; each trial asks."""
        return board.begin("experiment", request.state.owner, **asked.model_dump())

    @router.post("/calibrations", status_code=202)
    async def calibration(request: Request, asked: CalibrationAsked) -> JobMessage:
        """Measure a screen stroke by stroke, and verify; each stroke asks."""
        return board.begin("calibration", request.state.owner, **asked.model_dump())

    @router.get("/calibrations/{name}/report", response_class=FileResponse)
    async def report(name: Annotated[str, PathParameter(pattern=_FOLDER)]) -> FileResponse:
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

    @router.delete("/jobs/{job}", status_code=204)
    async def cancel(request: Request, job: JobName) -> Response:
        """End a job."""
        board.cancel(board.get(job, request.state.owner))
        return Response(status_code=204)

    @router.post("/jobs/{job}/answer", status_code=204)
    async def answer(request: Request, job: JobName, asked: Answer) -> Response:
        """Answer what a job asks."""
        board.get(job, request.state.owner).answer(asked.text)
        return Response(status_code=204)

    return router


def _begins(board: JobBoard, task: type[Task]) -> Callable[..., Any]:
    """Return the handler that begins a task's job."""

    async def begin(request: Request, asked: BaseModel) -> JobMessage:
        fields = asked.model_dump(exclude_unset=True)
        return board.begin(task.kind, request.state.owner, **fields)

    begin.__annotations__ |= {"request": Request, "asked": task.body(), "return": JobMessage}
    begin.__name__, begin.__doc__ = task.kind, task.__doc__
    return begin
