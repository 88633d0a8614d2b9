"""A person slides on a screen for some seconds, and an observer learns the finger."""

from __future__ import annotations

from collections.abc import Callable

from firmware_io.protocol import TouchPhase, TouchReport
from haptix.render.live import LiveRenderer
from haptix.sensing import FingerObserver, Knowledge
from haptix.virtual_finger import LiveCurrent, VirtualCurrent

WAITS_S = 60.0
"""Longest time for a slide."""

WIDTH_MM = 60.0
_SPEED_MM_PER_S = 50.0  # of a virtual finger, which slides to and fro over the width
_STEP_S = 0.01
_UNTOUCHED_S = 0.5  # for the panel's own current


def sensed_slide(
    renderer: LiveRenderer,
    observer: FingerObserver,
    seconds: float,
    normal_force_n: float,
    virtual: VirtualCurrent | None,
    tell: Callable[[float], None],
) -> float:
    """Pass touches of the driver's panel until the observer has learned for so long.

    Parameters
    ----------
    renderer : LiveRenderer
        Entered; it senses by the observer.
    observer : FingerObserver
        Learns.
    seconds : float
        Time of sliding that counts [s].
    normal_force_n : float
        Force of the person by a scale [N].
    virtual : VirtualCurrent or None
        Of a virtual finger that slides on a mock driver.
    tell : callable
        Takes the share that is done.

    Returns
    -------
    float
        Time of sliding that counted [s]; less than `seconds` if that took over `WAITS_S`.
    """
    device, slid_s = renderer.device, 0.0
    live = None if virtual is None else LiveCurrent.on(device, virtual)
    device.touches()  # of the time before
    began_s = at_s = renderer.now_s()
    while slid_s < seconds and at_s - began_s < WAITS_S:
        at_s += _STEP_S
        renderer.run_until(at_s)
        if live is not None and at_s - began_s > _UNTOUCHED_S:
            turns = (at_s - began_s - _UNTOUCHED_S) * _SPEED_MM_PER_S / WIDTH_MM % 2
            x_mm = WIDTH_MM * min(turns, 2 - turns)
            live.touch(at_s, x_mm, 10.0, normal_force_n)
            renderer.touch(at_s, x_mm, 10.0, normal_force_n)
        for report in device.touches():
            _pass(renderer, report, normal_force_n)
        if observer.estimate(renderer.now_s()).state is Knowledge.LEARNS:
            slid_s += _STEP_S
        tell(min(slid_s / seconds, 1.0))
    return slid_s


def _pass(renderer: LiveRenderer, report: TouchReport, normal_force_n: float) -> None:
    at_s = renderer.device.host_time_s(report.clock_ticks)
    if report.phase is TouchPhase.UP:
        renderer.lift(at_s, report.contact)
    else:
        place_mm = report.x_um / 1e3, report.y_um / 1e3
        renderer.touch(at_s, *place_mm, normal_force_n, report.contact)
