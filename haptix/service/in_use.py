"""What is in use, for people: the profiles of screen and finger, and the volts of full drive.

Clients can read the volts and not set them: a client that wants less asks for less friction or a
lower intensity.
"""

from __future__ import annotations

from datetime import UTC, date, datetime
from typing import TYPE_CHECKING, Annotated, Any, Literal

from fastapi import APIRouter, Depends, Request
from pydantic import BaseModel, Field

from haptix.files import write_whole
from haptix.service.messages import Error, Problem

if TYPE_CHECKING:
    from collections.abc import Awaitable, Callable

    from haptix.finger import Finger
    from haptix.screen import Screen
    from haptix.service.hub import Hub
    from haptix.service.pool import Pool


class Profile(BaseModel):
    """A profile in use."""

    name: str
    source: str
    """Its file, or "preset"."""
    calibrated: date | None = None
    """When it was measured; None for what was not measured on this very screen."""
    age_days: int | None = None
    verdict: str = ""
    rests_on: tuple[str, ...] = ()
    """What was assumed and not measured."""
    spread: dict[str, float] = {}
    """Standard deviation of the logarithm of each number that was found."""
    warnings: tuple[str, ...]
    """Reasons not to trust it."""
    verified: str = ""
    """Range in which a calibration has verified it; empty where none has."""
    document: dict[str, Any]


def profiles_of(finger: Finger, screen: Screen, sources: dict[str, str]) -> dict[str, Any]:
    """Return the profiles as the service gives them out, by kind.

    Parameters
    ----------
    finger, screen : Finger, Screen
        What is in use.
    sources : dict of str
        Preset or file of each, by kind.
    """
    calibration = screen.calibration
    measured: dict[str, Any] = {}
    if calibration is not None:
        age = datetime.now(UTC).date() - calibration.date
        names = ("verdict", "rests_on", "spread")
        measured = {name: getattr(calibration, name) for name in names}
        measured |= {"calibrated": calibration.date, "age_days": age.days}
    of_screen = {"warnings": screen.warnings(), **measured}
    if screen.verified is not None:
        of_screen["verified"] = screen.verified.text
    of_finger: dict[str, Any] = {
        "warnings": [
            f"{name}: a placeholder, not measured"
            for name in ("roughness", "dielectric")
            if getattr(getattr(finger, name), "is_placeholder", False)
        ]
    }
    if sources["finger"] != finger.name:  # of the same calibration, if there was one
        of_finger["calibrated"] = measured.get("calibrated")
    profiles = {}
    for kind, used, facts in (("screen", screen, of_screen), ("finger", finger, of_finger)):
        source = "preset" if sources[kind] == used.name else sources[kind]
        document = used.model_dump(mode="json")
        profile = Profile(name=used.name, source=source, document=document, **facts)
        profiles[kind] = profile.model_dump(mode="json")
    return profiles


def profiles_router(hub: Hub, token: Callable[..., Awaitable[None]]) -> APIRouter:
    """Return the routes ``/v1/profiles/{kind}`` and ``/v1/person``."""
    router = APIRouter(dependencies=[Depends(token)])

    @router.get("/v1/profiles/{kind}")
    async def profile(kind: Literal["screen", "finger"]) -> Profile:
        """The profile in use: what it rests on, how old it is, whether to trust it."""
        if kind not in hub.profiles:
            raise Problem("device", "the engine is not there yet; ask again")
        return Profile.model_validate(hub.profiles[kind])

    path = hub.access.folder / "person.json"
    if path.exists():
        of_person = PersonSettings.model_validate_json(path.read_text())
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


class PersonSettings(BaseModel):
    """What the person at the screen wants of all apps; what an app wants comes beside it."""

    person_intensity: Annotated[float, Field(ge=0, le=1)] = 1.0
    """Share of what apps ask for."""
    person_muted: bool = False


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

    @router.get("/drive", responses={409: {"model": Error}})
    async def drive(request: Request) -> FullDrive:
        """What full drive means: 409 before anybody has armed, when it is not known yet."""
        full_drive: dict[str, Any] | None = hub.full_drive
        if full_drive is None:
            raise Problem("order", "expected an output that was armed once; arm it first")
        currents = await pool.ask(request.state.owner, "currents", **full_drive)
        return FullDrive(**full_drive, **currents)

    return router
