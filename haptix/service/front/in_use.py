"""The profiles in use of screen and finger, and the volts of full drive, for people.

Clients can read the volts and not set them: a client that wants less asks for less friction or a
lower intensity.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, Literal

from fastapi import APIRouter, Depends, Request
from pydantic import BaseModel, Field, ValidationError

from haptix.base.errors import HaptixError
from haptix.base.files import read_json, set_aside, write_whole
from haptix.service.protocol.messages import Error, Problem
from haptix.service.worker.document_work import Profile

if TYPE_CHECKING:
    from collections.abc import Awaitable, Callable

    from haptix.service.front.hub import Hub
    from haptix.service.front.pool import Pool


def profiles_router(hub: Hub, token: Callable[..., Awaitable[None]]) -> APIRouter:
    """Return the routes ``/v1/profiles/{kind}`` and ``/v1/person``."""
    router = APIRouter(dependencies=[Depends(token)])

    @router.get("/v1/profiles/{kind}")
    async def profile(kind: Literal["screen", "finger"]) -> Profile:
        """The profile in use: its source, its age, whether to trust it."""
        if kind not in hub.profiles:
            raise Problem("device", "the engine is not there yet; ask again")
        return Profile.model_validate(hub.profiles[kind])

    path = hub.access.folder / "person.json"
    if path.exists():
        try:
            of_person = PersonSettings.model_validate(read_json(path))
        except (HaptixError, ValidationError) as error:
            set_aside(path, error)
        else:
            hub.control.follow(**of_person.model_dump())

    @router.get("/v1/person")
    async def person() -> PersonSettings:
        """The person's own strength and mute."""
        return PersonSettings.model_validate(hub.control.output, from_attributes=True)

    @router.put("/v1/person", status_code=204)
    async def set_person(body: PersonSettings) -> None:
        """Set the person's own strength and mute; they stay, whichever app is felt."""
        hub.control.follow(**body.model_dump())
        write_whole(path, body.model_dump_json())

    return router


class PersonSettings(BaseModel, extra="forbid"):
    """The person's settings for all apps, applied on top of an app's own."""

    person_intensity: Annotated[float, Field(ge=0, le=1)]
    """Share of what apps ask for."""
    person_muted: bool


class FullDrive(BaseModel):
    """The highest amplitude of the carrier, and the current it drives through one finger.

    Less drives less, nearly in proportion: at half the voltage some 7 % less than half, since the
    gaps are wider.
    """

    carrier_hz: float
    highest_v: float
    """Amplitude; `voltage_share` of the stream `friction` is a share of it."""
    normal_force_n: tuple[float, ...]
    current_a: tuple[float, ...]
    """Amplitude at each of the forces, by the contact model."""


def drive_router(hub: Hub, pool: Pool) -> APIRouter:
    """Return the route ``/v1/drive``."""
    router = APIRouter(prefix="/v1")
    known: list[FullDrive] = []  # the last answer: a worker takes seconds to find it

    @router.get("/drive", responses={409: {"model": Error}})
    async def drive(request: Request) -> FullDrive:
        """What full drive means: 409 before anybody has armed, when it is not known yet."""
        full_drive: dict[str, Any] | None = hub.full_drive
        if full_drive is None:
            raise Problem("order", "expected an output that was armed once; arm it first")
        if not known or any(getattr(known[0], name) != full_drive[name] for name in full_drive):
            currents = await pool.ask(request.state.owner, "currents", **full_drive)
            known[:] = [FullDrive(**full_drive, **currents)]
        return known[0]

    return router
