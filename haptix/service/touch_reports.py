"""Touches of a client as the engine takes them: by the service's clock, in millimetres."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from haptix.service.batches import ClientTouch
from haptix.service.messages import Geometry, Problem, TouchMessage
from haptix.service.session import ServiceSession
from haptix.touch.events import TouchEvent


class Taken(NamedTuple):
    """The touches of a message that can be used."""

    reports: list[TouchEvent]
    left_out: int
    problem: Problem | None
    """What is wrong with the first that cannot."""


def reports_of(
    session: ServiceSession,
    touches: Sequence[TouchMessage | ClientTouch | Problem | None],
    now_s: float,
    late_s: float,
) -> Taken:
    """Return a session's touches by the service's clock, and what is wrong with the others.

    Touches that are too old by `late_s` [s] at most, the service's own delay, are taken as if they
    just were in time.
    """
    reports: list[TouchEvent] = []
    left_out = 0
    wrong: Problem | None = None
    clock, geometry = session.clock, session.geometry
    oldest_s, newest_s = clock.window(now_s)
    service_s = clock.service_s
    for index, touch in enumerate(touches):
        if touch is None:
            continue
        try:
            if isinstance(touch, Problem):
                raise touch
            t_s = touch.t_s
            if oldest_s - late_s <= t_s < oldest_s:
                t_s = oldest_s
            elif not oldest_s <= t_s <= newest_s:
                if wrong is not None:
                    left_out += 1
                    continue  # who is late is late with all, and is not to be held up by it
                clock.stamp(t_s, now_s)
            x_mm, y_mm = touch.x_mm, touch.y_mm
            if x_mm is None or y_mm is None or touch.x_px is not None:
                x_mm, y_mm = _place(geometry, touch)
        except Problem as problem:
            path = problem.path if problem is touch else f"/touches/{index}{problem.path}"
            left_out += 1
            wrong = wrong or Problem(problem.code, problem.sentence, path)
            continue
        force_n, area_m2 = touch.normal_force_n, touch.contact_area_m2
        reports.append(
            TouchEvent(service_s(t_s), touch.touch_id, x_mm, y_mm, touch.kind, force_n, area_m2)
        )
    return Taken(reports, left_out, wrong)


def _place(geometry: Geometry | None, touch: TouchMessage | ClientTouch) -> tuple[float, float]:
    if touch.x_px is not None and touch.y_px is not None and touch.x_mm is None:
        if geometry is None:
            raise Problem("order", "x_px: send geometry first, or millimetres", "/x_px")
        return geometry.mm(touch.x_px, touch.y_px)
    if touch.kind == "up" and touch.x_mm is None and touch.x_px is None:
        return 0.0, 0.0
    raise Problem("message", "expected x_mm and y_mm, or x_px and y_px")
