"""Jobs over REST."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from fastapi import APIRouter, Request, Response
from fastapi import Path as PathParameter
from fastapi.responses import FileResponse
from pydantic import BaseModel, ConfigDict, Field

from haptix.service.jobs import JobBoard
from haptix.service.messages import Error, JobMessage, Problem

MOST_TOUCHES = 20_000
JobName = Annotated[str, PathParameter(pattern=r"^[0-9a-f]{1,32}$")]
ProfileName = Annotated[str, Field(min_length=1, max_length=200)]
_FOLDER = r"^[A-Za-z0-9][A-Za-z0-9_-]{0,79}$"
FolderName = Annotated[str, Field(pattern=_FOLDER)]
Size = Annotated[float, Field(gt=0, le=1e4, allow_inf_nan=False)]
Finite = Annotated[float, Field(allow_inf_nan=False, ge=-1e6, le=1e6)]
Force = Annotated[float, Field(gt=0, le=100, allow_inf_nan=False)]


class Asked(BaseModel):
    """What all jobs take: a finger and a screen, by default those in use."""

    model_config = ConfigDict(extra="forbid")
    finger: ProfileName | None = None
    """Preset, or the one in use."""
    screen: ProfileName | None = None
    """Preset, or the one in use."""


class SurfaceAsked(Asked):
    """What `POST /v1/surfaces` takes."""

    tolerance_jnd: Annotated[float, Field(ge=0.01, le=1)] = 0.05


class HeadroomAsked(Asked):
    """What `POST /v1/headroom` takes."""

    material: dict[str, Any]
    width_mm: Size
    height_mm: Size
    normal_force_n: Force = 0.5
    columns: Annotated[int, Field(ge=1, le=1000)] = 300


class RenderingAsked(Asked):
    """What `POST /v1/renderings` takes: a recorded stroke through a material."""

    material: dict[str, Any]
    t_s: Annotated[tuple[Finite, ...], Field(min_length=2, max_length=MOST_TOUCHES)]
    x_mm: Annotated[tuple[Finite, ...], Field(min_length=2, max_length=MOST_TOUCHES)]
    y_mm: Annotated[tuple[Finite, ...], Field(min_length=2, max_length=MOST_TOUCHES)]
    normal_force_n: Annotated[tuple[Force, ...], Field(min_length=2, max_length=MOST_TOUCHES)]
    touch_hz: Annotated[float, Field(ge=10, le=1000)] = 100.0
    touch_latency_s: Annotated[float, Field(ge=0, le=0.5)] = 0.02
    reaction_s: Annotated[float, Field(ge=0.001, le=0.1)] = 0.003


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

    @router.post("/surfaces", status_code=202)
    async def surface(request: Request, asked: SurfaceAsked) -> JobMessage:
        """Build a surface and keep it; one that is kept is found."""
        return board.begin("surface", request.state.owner, **asked.model_dump())

    @router.get("/surfaces")
    async def surfaces(request: Request) -> tuple[JobMessage, ...]:
        """Surfaces that were asked for, with their progress."""
        return tuple(one for one in board.all(request.state.owner) if one.kind == "surface")

    @router.post("/headroom", status_code=202)
    async def headroom(request: Request, asked: HeadroomAsked) -> JobMessage:
        """Count where a material asks for more, or less, than a screen can give."""
        return board.begin("headroom", request.state.owner, **asked.model_dump())

    @router.post("/renderings", status_code=202)
    async def rendering(request: Request, asked: RenderingAsked) -> JobMessage:
        """Feel a recorded stroke through a material: the numbers of `haptix render`."""
        return board.begin("rendering", request.state.owner, **asked.model_dump())

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
