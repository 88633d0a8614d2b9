"""Touches of a client as the engine takes them: by the service's clock, in millimetres."""

from __future__ import annotations

from math import cos, radians, sin

from haptix.service.messages import Geometry, Problem, TouchMessage
from haptix.service.session import ServiceSession
from haptix.service.wire import TouchRecord


def reports_of(
    session: ServiceSession, touches: tuple[TouchMessage, ...], now_s: float
) -> list[TouchRecord]:
    """Return a session's touches by the service's clock.

    Raises
    ------
    Problem
        Naming the touch whose stamp or place cannot be used; none is taken then.
    """
    reports: list[TouchRecord] = []
    for index, touch in enumerate(touches):
        path = f"/touches/{index}"
        t_s = session.clock.stamp(touch.t_s, now_s, f"{path}/t_s")
        x_mm, y_mm = _place(session.geometry, touch, path)
        reports.append(
            TouchRecord(
                t_s,
                touch.touch_id,
                touch.kind,
                x_mm,
                y_mm,
                touch.normal_force_n,
                touch.contact_area_m2,
            )
        )
    return reports


def _place(geometry: Geometry | None, touch: TouchMessage, path: str) -> tuple[float, float]:
    if touch.x_mm is not None and touch.y_mm is not None and touch.x_px is None:
        return touch.x_mm, touch.y_mm
    if touch.x_px is not None and touch.y_px is not None and touch.x_mm is None:
        if geometry is None:
            raise Problem("order", "x_px: send geometry first, or millimetres", f"{path}/x_px")
        turn = radians(geometry.rotation_deg)
        x, y = touch.x_px / geometry.px_per_mm, touch.y_px / geometry.px_per_mm
        return (
            geometry.origin_mm[0] + x * cos(turn) - y * sin(turn),
            geometry.origin_mm[1] + x * sin(turn) + y * cos(turn),
        )
    if touch.kind == "up" and touch.x_mm is None and touch.x_px is None:
        return 0.0, 0.0
    raise Problem("message", "expected x_mm and y_mm, or x_px and y_px", path)
