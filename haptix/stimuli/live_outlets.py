"""Lab Streaming Layer from a live renderer: touches, commanded friction and volts, markers."""

from __future__ import annotations

from math import nan
from typing import Any, Self

import numpy as np

from haptix.errors import InputError
from haptix.render import LiveRenderer
from haptix.render.played import COLUMNS, PlayedRecord
from haptix.stimuli.outlets import LabOutlets
from haptix.touch import TouchEvent

_PHASES = {"up": 0, "down": 1, "move": 2}
_TARGET = COLUMNS.index("wanted")
_FINAL_S = 0.02  # no revision comes as long after a sample was played


class LiveOutlets:
    """Streams of a live renderer, as `LabOutlets` has them; follow them some ten times a second.

    Touches are those that the renderer took, by the times that they were stamped with. The drive
    has a row each millisecond: the amplitude that was sent [V], and the friction that the texture
    asked for under the finger that came down last; NaN without one. Its times are those of the
    samples, by the driver's clock. Markers are the marks of `LiveRenderer.mark`, by the same clock.

    Use it inside the renderer's context; on leaving, what was played is sent to its end.

    Parameters
    ----------
    renderer : LiveRenderer
        Entered, on a driver that takes marks and can revise. Its `record` and `taken` are used.
    name : str
        Beginning of the streams' names.

    Raises
    ------
    InputError
        If somebody else takes the renderer's record.
    MissingExtraError
        Without the extra ``lab``.
    """

    def __init__(self, renderer: LiveRenderer, name: str = "haptix") -> None:
        if renderer.record is not None or renderer.taken is not None:
            raise InputError("LiveOutlets: somebody takes what this renderer plays; end that first")
        self._renderer, self._record = renderer, PlayedRecord(renderer)
        drive_hz = 1 / self._record.row_s
        self._outlets = LabOutlets(renderer.device, name, drive_hz=drive_hz)
        renderer.record, renderer.taken = self._record, self._touch
        self.marks_sent = 0
        """Marks that the driver has told of."""

    def _touch(self, event: TouchEvent) -> None:
        is_up = event.kind == "up"
        at = (nan, nan) if is_up else (event.x_mm, event.y_mm)
        force = nan if event.normal_force_n is None else event.normal_force_n
        self._outlets.touch(event.t_s, *at, force, event.touch_id, _PHASES[event.kind])

    def follow(self) -> None:
        """Send the marks that the driver has told of, and what it has played."""
        self._send_marks()
        self._send(self._renderer.now_s() - _FINAL_S)

    def _send_marks(self) -> None:
        marked = self._renderer.device.marked()
        self._outlets.marks(marked)
        self.marks_sent += len(marked)

    def _send(self, until_s: float) -> None:
        while (part := self._record.take(until_s)) is not None:
            volts = part.amplitude_v[:: self._record.per_row]
            friction = np.full(len(volts), nan)
            if part.rows:
                friction = part.rows[max(part.rows)][:, _TARGET]
            self._outlets.rows(part.t0_s, volts, friction)

    def has_recorders(self) -> bool:
        """Whether somebody records all three streams."""
        return self._outlets.has_recorders()

    def close(self) -> None:
        """Send what is left, and close the streams."""
        renderer = self._renderer
        renderer.record = renderer.taken = None
        self._send_marks()
        self._send(renderer.now_s())
        self._outlets.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: Any) -> None:
        self.close()
