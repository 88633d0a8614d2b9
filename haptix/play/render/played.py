"""The record of amplitudes and places that a renderer keeps."""

from __future__ import annotations

import threading
from collections import deque
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from haptix.base.checks import Array
from haptix.play.render.samples import Fingers, RenderCore, RenderedBlock

ROW_S = 0.001
"""Time between rows, as nearly as the control points allow; friction is felt up to 1 kHz."""


COLUMNS = ("x_mm", "y_mm", "normal_force_n", "wanted", "reached", "low", "high", "voltage_share")
"""Columns of a finger's rows: place, force, wanted friction, friction at the amplitude that was
sent, its reachable range, and that amplitude over the highest one that the renderer sends."""


_MOST_WINDOWS = 4000  # that wait to be taken: some seconds


class PlayedPart(NamedTuple):
    """A part of the output that was played."""

    t0_s: float
    """Time of the first point, by the renderer's clock."""
    step_s: float
    """Time between points."""
    amplitude_v: Array
    """Amplitude at each point, shape (points,); linear in between."""
    row_s: float
    """Time between rows; the first row is at the first point."""
    rows: dict[int, Array]
    """Rows of each finger that got drive, shape (rows, 8), see `COLUMNS`; NaN where it got none."""


@dataclass(frozen=True, slots=True)
class _Window:
    first: int  # index of the first point; each point is at the end of a step
    at_s: float  # time of the first point
    block: RenderedBlock
    fingers: Fingers

    @property
    def end(self) -> int:
        return self.first + len(self.block.amplitude_v)


class PlayedRecord:
    """Records the windows of a stream, and returns the amplitudes once they are final.

    Where windows cover the same time, the last one was played, unless the driver refused it.

    Parameters
    ----------
    core : RenderCore
        Renders them.
    """

    def __init__(self, core: RenderCore) -> None:
        self._core = core
        self._lock = threading.Lock()
        self._windows: deque[_Window] = deque(maxlen=_MOST_WINDOWS)
        self._under_way: deque[_Window] = deque()
        self._next: int | None = None
        self.per_row = max(1, round(ROW_S / core.step_s))
        """Points from one row to the next."""
        self.row_s = self.per_row * core.step_s
        """The same as a time [s]."""

    def add(
        self, block: RenderedBlock, fingers: Fingers, at_s: float, is_revision: bool = False
    ) -> None:
        """Take a window whose first sample is played at `at_s`."""
        step_s = self._core.step_s
        first = block.first_sample // block.step + 1
        window = _Window(first, at_s + step_s, block, fingers)
        with self._lock:
            self._windows.append(window)
            if is_revision:
                self._under_way.append(window)

    def settle(self, obeyed: int, undone: bool) -> None:
        """Record that the oldest `obeyed` revisions were played, and with `undone` no other was."""
        with self._lock:
            for _ in range(min(obeyed, len(self._under_way))):
                self._under_way.popleft()
            if undone:
                lost = {id(window) for window in self._under_way}
                self._under_way.clear()
                kept = [window for window in self._windows if id(window) not in lost]
                self._windows = deque(kept, maxlen=_MOST_WINDOWS)

    def take(self, until_s: float) -> PlayedPart | None:
        """Return the part that was played until a time and was not taken before, or None.

        The part ends with a whole row.
        """
        with self._lock:
            windows = [window for window in self._windows if window.at_s <= until_s]
            if not windows:
                return None
            last = windows[-1]
            points = int((until_s - last.at_s) / self._core.step_s) + 1
            end = min(last.first + points, max(window.end for window in windows))
            if self._next is None or self._next < min(window.first for window in windows):
                self._next = max(last.first, end - self.per_row)
            first = self._next
            count = (end - first) // self.per_row * self.per_row
            if count <= 0:
                return None
            self._next = first + count
            while self._windows and self._windows[0].end <= self._next:
                self._windows.popleft()
        return self._part(windows, first, count)

    def _part(self, windows: list[_Window], first: int, count: int) -> PlayedPart:
        core, per_row = self._core, self.per_row
        amplitude = np.zeros(count)
        owner = np.full(count, -1)
        for number, window in enumerate(windows):
            low, high = max(window.first, first), min(window.end, first + count)
            if low < high:
                played = window.block.amplitude_v[low - window.first : high - window.first]
                amplitude[low - first : high - first] = played
                owner[low - first : high - first] = number
        rows: dict[int, Array] = {}
        shown = owner[::per_row]
        for number in np.unique(shown[shown >= 0]).tolist():
            window = windows[number]
            fingers = window.fingers
            if fingers.motion.fingers:
                at = np.flatnonzero(shown == number)
                self._fill(rows, window, at, first + per_row * at - window.first, len(shown))
        if rows:
            self._derive(rows, amplitude[::per_row])
        origin = windows[int(owner[0])] if owner[0] >= 0 else windows[0]
        t0_s = origin.at_s + (first - origin.first) * core.step_s
        return PlayedPart(t0_s, core.step_s, amplitude, per_row * core.step_s, rows)

    @staticmethod
    def _fill(rows: dict[int, Array], window: _Window, at: Any, points: Any, count: int) -> None:
        motion = window.fingers.motion
        shape = (motion.fingers, motion.points)
        columns = (motion.x_mm, motion.y_mm, motion.normal_force_n, window.block.target_mu)
        filled = [column.reshape(shape)[:, points] for column in columns]
        driven = window.fingers.gain.reshape(shape)[:, points] > 0
        speed = motion.footprint_mm / motion.step_s
        for finger, touch_id in enumerate(window.fingers.touch_ids):
            here = driven[finger]
            if not here.any():
                continue
            row = rows.get(touch_id)
            if row is None:
                row = rows[touch_id] = np.full((count, len(COLUMNS)), np.nan)
            for column, values in enumerate(filled):
                row[at[here], column] = values[finger, here]
            row[at[here], 4] = speed  # `_derive` replaces it by the reached friction

    def _derive(self, rows: dict[int, Array], amplitude_v: Array) -> None:
        """Fill the columns of reached and reachable friction, of all fingers at once."""
        table = np.stack(list(rows.values()))
        present = ~np.isnan(table[..., 2])
        force, speed = table[present][:, 2], table[present][:, 4]
        amplitude = np.broadcast_to(amplitude_v, present.shape)[present]
        low, high = self._core.reachable(force, speed)
        reached = self._core.friction(force, speed, amplitude)
        derived = np.column_stack([reached, low, high, amplitude / self._core.highest_v])
        parts = np.split(derived, np.cumsum(present.sum(axis=1))[:-1])
        for row, is_there, part in zip(rows.values(), present, parts, strict=True):
            row[is_there, 4:] = part
