"""What the engine tells of what is played: counts, friction, amplitude for the virtual finger."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from haptix.checks import Array
from haptix.service.batches import TelemetryFrame, write_frame
from haptix.service.messages import Stream
from haptix.service.wire import TELEMETRY, amplitude_frame, frame

_SETTLED_S = 0.015  # a driver tells within its status' period which revisions it refused
_MOST_STATS_HZ = 50.0
_LAST_REACTIONS = 500  # of which percentiles are told


class Telemetry:
    """Streams of one engine, at the rates that somebody asks for.

    Parameters
    ----------
    write : callable
        Takes frames of the link.
    look_s : float
        Between two calls of `tell`.
    """

    def __init__(self, write: Callable[[bytes], None], look_s: float) -> None:
        self._write, self._look_s = write, look_s
        self._rates: Mapping[Stream, float] = {}
        self._told_s = 0.0

    def ask(self, rates: Mapping[Stream, float]) -> None:
        """Set the rate of each stream; 0 or none ends it."""
        self._rates = rates

    def tell(self, renderer: Any, now_s: float) -> None:
        """Tell what is new of a renderer at a time of its clock."""
        self._tell_stats(renderer, now_s)
        wanted = [name for name in ("friction", "felt") if self._rates.get(name, 0.0) > 0]
        if not wanted:
            renderer.record = None
            return
        if renderer.record is None:
            from haptix.render.played import PlayedRecord

            renderer.record = PlayedRecord(renderer)
        part = renderer.record.take(now_s - _SETTLED_S)
        if part is None:
            return
        if "felt" in wanted:
            self._write(amplitude_frame(part.t0_s, part.step_s, part.amplitude_v))
        if "friction" in wanted:
            for touch_id, rows in part.rows.items():
                self._tell("friction", touch_id, part.t0_s, part.row_s, rows)

    def _tell_stats(self, renderer: Any, now_s: float) -> None:
        rate_hz = min(self._rates.get("stats", 0.0), _MOST_STATS_HZ)
        if not rate_hz or now_s - self._told_s < 1 / rate_hz - self._look_s / 2:
            return
        self._told_s = now_s
        last = [*renderer.stats.reactions_s][-_LAST_REACTIONS:]
        times = np.percentile(last or [np.nan], (50, 99))
        counts = renderer.stats.underruns, renderer.touch_counts.taken
        row = (*times, *counts, renderer.scene_s)
        self._tell("stats", 0, now_s, 1 / rate_hz, np.array([row]))

    def _tell(self, stream: Stream, touch_id: int, t0_s: float, step_s: float, rows: Array) -> None:
        found = TelemetryFrame(stream, touch_id, 0, 0, t0_s, step_s, rows)
        self._write(frame(TELEMETRY, write_frame(found)))
