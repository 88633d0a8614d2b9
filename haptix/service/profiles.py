"""What is in use, for people: the profiles of screen and finger, and what they rest on."""

from __future__ import annotations

from datetime import UTC, date, datetime
from typing import TYPE_CHECKING, Any, Literal

from fastapi import APIRouter, Depends
from pydantic import BaseModel

from haptix.service.messages import Problem

if TYPE_CHECKING:
    from collections.abc import Awaitable, Callable

    from haptix.finger import Finger
    from haptix.screen import Screen
    from haptix.service.hub import Hub


class Profile(BaseModel):
    """A profile in use."""

    name: str
    source: str
    """Its file, or "preset"."""
    calibrated: date | None
    """When it was measured; None for what was not measured on this very screen."""
    age_days: int | None
    verdict: str
    rests_on: tuple[str, ...]
    """What was assumed and not measured."""
    spread: dict[str, float]
    """Standard deviation of the logarithm of each number that was found."""
    warnings: tuple[str, ...]
    """Reasons not to trust it."""
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
    made = screen.calibration
    guessed = [
        f"{name}: a placeholder, not measured"
        for name in ("roughness", "dielectric")
        if getattr(getattr(finger, name), "is_placeholder", False)
    ]
    screen_profile = Profile(
        name=screen.name,
        source=_source(sources["screen"], screen.name),
        calibrated=made.date if made else None,
        age_days=(datetime.now(UTC).date() - made.date).days if made else None,
        verdict=made.verdict if made else "",
        rests_on=made.rests_on if made else (),
        spread=made.spread if made else {},
        warnings=tuple(screen.warnings()),
        document=screen.model_dump(mode="json"),
    )
    finger_profile = Profile(
        name=finger.name,
        source=_source(sources["finger"], finger.name),
        calibrated=made.date if made and sources["finger"] != finger.name else None,
        age_days=None,
        verdict="",
        rests_on=(),
        spread={},
        warnings=tuple(guessed),
        document=finger.model_dump(mode="json"),
    )
    found = {"screen": screen_profile, "finger": finger_profile}
    return {kind: one.model_dump(mode="json") for kind, one in found.items()}


def _source(given: str, name: str) -> str:
    return "preset" if given == name else given


def profiles_router(hub: Hub, token: Callable[..., Awaitable[None]]) -> APIRouter:
    """Return the route ``/v1/profiles/{kind}``."""
    router = APIRouter(dependencies=[Depends(token)])

    @router.get("/v1/profiles/{kind}")
    async def profile(kind: Literal["screen", "finger"]) -> Profile:
        """The profile in use: what it rests on, how old it is, whether to trust it."""
        if kind not in hub.profiles:
            raise Problem("device", "the engine is not there yet; ask again")
        return Profile.model_validate(hub.profiles[kind])

    return router
