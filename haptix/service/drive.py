"""What full drive means on this screen and finger, for people beside the device: volts and amperes.

It is told and never asked for: a client that wants less asks for less friction, or intensity.
"""

from __future__ import annotations

from typing import Any

from fastapi import APIRouter, Request
from pydantic import BaseModel

from haptix.service.hub import Hub
from haptix.service.messages import Error, Problem
from haptix.service.pool import Pool


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
        asked: dict[str, Any] | None = hub.full_drive
        if asked is None:
            raise Problem("order", "expected an output that was armed once; arm it first")
        return FullDrive(**asked, **await pool.ask(request.state.owner, "currents", **asked))

    return router
