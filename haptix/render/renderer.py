"""The renderer of recordings."""

from __future__ import annotations

import time

import numpy as np

from haptix.errors import InputError
from haptix.motion import Trajectory
from haptix.render.recorded_fingers import RecordedFingers
from haptix.render.session import VirtualTimeSession
from haptix.touch import ForceModel, TouchEvent, events_of
from haptix.touch.events import problem_of

_FORCE = ForceModel()
_LONG_S = 0.25  # a block of `play`: far longer than what numpy costs per call


class Renderer(VirtualTimeSession):
    """Renders a texture under recorded touches, which are joined by straight lines.

    Touches drive the clock. A touch that cannot be used raises `InputError`.

    Parameters
    ----------
    surface, texture, device, drive, settings
        As of `RenderCore`.
    """

    def _reset(self) -> None:
        super()._reset()
        self._fingers = RecordedFingers(self.settings.sliding)

    def event(self, event: TouchEvent, arrival_s: float | None = None) -> None:
        """Take a touch event and render up to it; see `touch`."""
        self._take(event)
        self._render_known(self.points)

    def play(self, path: Trajectory, touch_id: int = 0) -> None:
        """Render one finger's whole recorded path, in long blocks: the fastest way."""
        long = max(self.points, round(_LONG_S / self.step_s))
        for event in events_of(path, touch_id)[:-1]:  # without the lift: another path may follow
            self._take(event)
            self._render_known(long, least=long)
        self._render_known(long)

    def _take(self, event: TouchEvent) -> None:
        problem = problem_of(event)
        if problem is not None:
            raise InputError(problem)
        self._check_gap(event.t_s)
        if event.kind == "up":
            self._fingers.lift(event.touch_id, event.t_s)
            return
        found = _FORCE.estimate(event.normal_force_n, event.contact_area_m2)
        force = _FORCE.assumed if found is None else found
        self._fingers.touch(event.touch_id, event.t_s, event.x_mm, event.y_mm, force.normal_force_n)
        if self._start_s is None:
            self._start_s = event.t_s

    def _render_known(self, most: int, least: int = 1) -> None:
        """Render as far as all fingers' paths are known, in blocks of `least` to `most` points."""
        if self._start_s is None:
            return
        rate, step = self.sample_rate_hz, self.step
        # Clocks that count from 1970 resolve a few 1e-7 s: that must not cost a sample.
        end = int((self._fingers.known_until_s - self._start_s) * rate + 0.02)
        while (left := (end - self._next_sample) // step) >= least:
            began = time.perf_counter()
            ends = self._next_sample + step * np.arange(1, min(most, left) + 1)
            times = self._start_s + ends / rate
            self._send(self._fingers.motion(times, self.step_s), began)
