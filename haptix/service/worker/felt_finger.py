"""A virtual finger on the engine's output, live, at most a tenth of a second later.

It takes touches and amplitudes as frames, in a worker of its own with a lower priority than the
engine's, so that the engine keeps its time.
"""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable

import numpy as np

from haptix.base.checks import Array
from haptix.base.errors import HaptixError
from haptix.feel.motion import Trajectory
from haptix.model.finger import Finger
from haptix.model.friction import ContactModel
from haptix.model.screen import Screen
from haptix.play.touch.events import ForceModel, TouchEvent
from haptix.play.virtual_finger import VirtualFinger
from haptix.play.virtual_finger.finger import LiveVirtualFinger
from haptix.service.protocol.batches import TelemetryFrame, write_frame
from haptix.service.protocol.wire import (
    AMPLITUDE,
    TELEMETRY,
    TOUCHES,
    amplitude_of,
    frame,
    touches_of,
)

_FORCES_N = (0.02, 5.0)
_ROW_S = 0.001
_FINER = 2  # instants felt in a row: edges of a texture are followed to 0.003 JND, not 0.02
_PART_S = 0.05  # felt at a time: a solution costs the same for 1 and 100 instants
_RESTS_AFTER_S = 0.06  # without a report for so long, a finger is taken to rest
_HISTORY_S = 1.0
_JUMP_S = 0.005  # between the end of a part and the next: a break in the output


class FingerPath:
    """Reports of one finger, until they have been felt."""

    def __init__(self) -> None:
        self.reports: list[tuple[float, float, float, float]] = []
        self.up_s: float | None = None

    def between(self, from_s: float, to_s: float) -> tuple[float, Trajectory] | None:
        """Return the path between two times and the time at which it begins, in whole rows."""
        t_s, x_mm, y_mm, force_n = np.array(self.reports).T
        end_s = to_s if self.up_s is None else min(to_s, self.up_s)
        first = max(0, int(np.ceil((t_s[0] - from_s) / _ROW_S - 1e-6)))
        rows = int((end_s - from_s) / _ROW_S + 1e-6) - first
        if rows < 1:
            return None
        begin_s = from_s + first * _ROW_S
        end_s = begin_s + rows * _ROW_S
        inner = t_s[(t_s > begin_s + 1e-9) & (t_s < end_s - 1e-9)]
        times = np.concatenate([[begin_s], inner, [end_s]])
        places = (np.interp(times, t_s, column) for column in (x_mm, y_mm, force_n))
        return begin_s, Trajectory(times, *places)

    def forget_before(self, t_s: float) -> bool:
        """Keep the report before a time and those after it; return whether the finger is there."""
        while len(self.reports) > 1 and self.reports[1][0] <= t_s:
            self.reports.pop(0)
        return self.up_s is None or self.up_s > t_s


class FeltFinger:
    """Computes the felt friction along the paths of the touching fingers.

    Parameters
    ----------
    finger, screen : str
        Names or files, as `Finger.named` and `Screen.named` take them.
    carrier_hz : float
        Frequency of the carrier.
    """

    def __init__(self, finger: str, screen: str, carrier_hz: float) -> None:
        model = ContactModel(Finger.named(finger), Screen.named(screen))
        # The contact's tables for all forces at once: each extension would take a second.
        model.solve(normal_force_n=list(_FORCES_N), voltage_v=0.0)
        self._finger = LiveVirtualFinger(VirtualFinger(model), carrier_hz, _FINER / _ROW_S)
        self._force = ForceModel()
        self._paths: dict[int, FingerPath] = {}
        self._amplitude: Array = np.empty(0)
        self._start_s = self._felt_s = self._step_s = 0.0
        self._lock = threading.Lock()

    def touch(self, reports: list[TouchEvent]) -> None:
        """Take reports of fingers."""
        with self._lock:
            for t_s, touch_id, x_mm, y_mm, kind, force_n, area_m2 in reports:
                path = self._paths.get(touch_id)
                if kind == "up":
                    if path is not None:
                        path.up_s = t_s
                    continue
                if path is None or path.up_s is not None:
                    path = self._paths[touch_id] = FingerPath()
                known = self._force.estimate(force_n, area_m2) or self._force.assumed
                if not path.reports or path.reports[-1][0] < t_s:
                    path.reports.append((t_s, x_mm, y_mm, known.normal_force_n))

    def play(self, t0_s: float, step_s: float, amplitude_v: Array) -> None:
        """Take amplitudes that were played."""
        with self._lock:
            end_s = self._start_s + len(self._amplitude) * self._step_s
            if self._step_s != step_s or abs(t0_s - end_s) > _JUMP_S:
                self._amplitude, self._step_s = np.empty(0), step_s
                self._felt_s = t0_s
            self._amplitude = np.concatenate([self._amplitude, amplitude_v])
            # The newest part knows its time best.
            self._start_s = t0_s - (len(self._amplitude) - len(amplitude_v)) * step_s
            surplus = len(self._amplitude) - round(_HISTORY_S / step_s)
            if surplus > 0:
                self._amplitude = self._amplitude[surplus:]
                self._start_s += surplus * step_s
                self._felt_s = max(self._felt_s, self._start_s)

    def feel(self, now_s: float) -> list[TelemetryFrame]:
        """Return the felt friction since the last call."""
        with self._lock:
            until_s = self._start_s + (len(self._amplitude) - 1) * self._step_s
            for path in self._paths.values():
                newest_s = path.reports[-1][0]
                if path.up_s is None and now_s - newest_s < _RESTS_AFTER_S:
                    until_s = min(until_s, newest_s)
            rows = int((until_s - self._felt_s) / _ROW_S)
            if rows < 1:
                return []
            from_s, to_s = self._felt_s, self._felt_s + rows * _ROW_S
            parts = {number: path.between(from_s, to_s) for number, path in self._paths.items()}
            paths = {number: part for number, part in parts.items() if part is not None}
            amplitude, start_s = self._amplitude, self._start_s
            self._felt_s = to_s
            self._paths = {
                number: path
                for number, path in self._paths.items()
                if path.forget_before(to_s) and path.reports[-1][0] > now_s - _HISTORY_S
            }
        felt = self._finger.feel(
            amplitude, 1 / self._step_s, start_s, {n: path for n, (_, path) in paths.items()}
        )
        return [
            TelemetryFrame(
                "felt", number, 0, 0, paths[number][0], _ROW_S,
                np.column_stack([finger.mu, finger.friction_force_n])[::_FINER],
            )
            for number, finger in felt.items()
        ]  # fmt: skip


class FeltFingerThread:
    """Runs the virtual finger in a thread of its own while frames arrive.

    Parameters
    ----------
    finger : FeltFinger
        What feels.
    tell : callable
        Takes frames of telemetry.
    """

    def __init__(self, finger: FeltFinger, tell: Callable[[bytes], None]) -> None:
        self._finger, self._tell, self._ends = finger, tell, threading.Event()
        self._thread = threading.Thread(target=self._feels, name="haptix felt finger", daemon=True)
        self._thread.start()

    def take(self, kind: int, data: bytes) -> None:
        """Take a frame of touches or amplitudes."""
        if kind == TOUCHES:
            self._finger.touch(touches_of(data))
        elif kind == AMPLITUDE:
            self._finger.play(*amplitude_of(data))

    def close(self) -> None:
        """Stop feeling."""
        self._ends.set()
        self._thread.join()  # ending the process inside torch's code would abort it

    def _feels(self) -> None:
        while not self._ends.wait(_PART_S):
            try:
                for telemetry in self._finger.feel(time.monotonic()):
                    self._tell(frame(TELEMETRY, write_frame(telemetry)))
            except HaptixError as error:  # such as a path that no finger slides: the next may do
                sys.stderr.write(f"haptix felt finger: {error}\n")
