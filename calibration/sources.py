"""Where force and position come from while a stroke is played: the interface of instruments."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np
from scipy.interpolate import CubicSpline

from calibration.column_map import ColumnMap
from calibration.parameters import Array
from calibration.protocol import Stroke
from calibration.segmentation import sliding_speed
from haptix.errors import FileFormatError

_LIVE_S = 0.05  # over which force and speed are shown


@dataclass(frozen=True)
class StrokeDrive:
    """Drive of one recording: volts from its first instant on."""

    volts: Array
    sample_rate_hz: float

    @property
    def duration_s(self) -> float:
        """Length of the recording [s]."""
        return len(self.volts) / self.sample_rate_hz

    def at(self, t_s: Array) -> Array:
        """Voltage on the screen [V] at times from the start [s], smooth between samples."""
        own = np.arange(len(self.volts)) / self.sample_rate_hz
        inside = (t_s >= 0) & (t_s <= own[-1])
        return np.where(inside, CubicSpline(own, self.volts)(np.clip(t_s, 0.0, own[-1])), 0.0)


@dataclass(frozen=True)
class Live:
    """Forces and speed that the person sees while sliding."""

    normal_force_n: float
    speed_mm_per_s: float
    tangential_force_n: float

    @classmethod
    def at(cls, signals: Mapping[str, Array], t_s: float) -> Live | None:
        """Mean forces and speed of the last 50 ms before a time; None without samples."""
        t = signals["t_s"]
        inside = (t > t_s - _LIVE_S) & (t <= t_s)
        if inside.sum() < 4:
            return None
        speed = sliding_speed(t[inside], signals["x_mm"][inside])
        normal, tangential = (
            float(signals[name][inside].mean()) for name in ("normal_force_n", "tangential_force_n")
        )
        return cls(normal, float(np.abs(speed).mean()), tangential)


class ForceSource(Protocol):
    """An instrument, or a replacement of one."""

    @property
    def instruments(self) -> Mapping[str, str]:
        """Names and serial numbers."""

    is_live: bool
    """Whether it records in real time, so that playing must keep to the clock."""

    assumed: tuple[str, ...] = ()
    """Signals that no instrument measures; where it gives no drive_v, the played one is kept."""

    def start(self, stroke: Stroke, played: StrokeDrive) -> None:
        """Begin to record one stroke."""

    def live(self, t_s: float) -> Live | None:
        """Force and speed at a time since the start, if known already."""

    def finish(self) -> dict[str, Array]:
        """End the recording and return its signals, by the names of `SIGNALS`.

        Without a drive_v the voltage that was played takes its place.
        """


class CsvSource(ForceSource):
    """Replays recordings that another program has exported, one CSV file per stroke.

    The names of the files hold the stroke's number: ``stroke-007.csv`` or ``7.csv``.
    """

    is_live = False

    def __init__(self, folder: str | Path, columns: ColumnMap) -> None:
        self._folder, self._columns = Path(folder), columns
        self._number = 0
        self.assumed = columns.assumed
        if not self._folder.is_dir():
            raise FileFormatError(f"expected a folder of CSV files, got {self._folder}")

    @property
    def instruments(self) -> Mapping[str, str]:
        return {"CSV files": self._folder.name}

    def start(self, stroke: Stroke, played: StrokeDrive) -> None:
        self._number = stroke.number

    def live(self, t_s: float) -> None:
        return None  # the stroke is past

    def finish(self) -> dict[str, Array]:
        number = self._number
        names = (f"stroke-{number:03d}.csv", f"stroke-{number}.csv", f"{number}.csv")
        for name in names:
            if (self._folder / name).exists():
                return self._columns.signals(self._folder / name)
        raise FileFormatError(f"{self._folder}: expected a file {' or '.join(names)}")
