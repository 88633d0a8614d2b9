"""Synthetic fingers: paths like those of people on a screen, and a touchscreen's reports of them.

For studies and tests that have to know where the finger truly is. Strokes follow the minimum-jerk
law (Flash and Hogan, J. Neurosci. 5, 1688, 1985). All carry a physiological tremor of 8 to 12 Hz.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.interpolate import make_interp_spline

from haptix.base.checks import choice, positive
from haptix.play.touch.events import TouchEvent

Array = npt.NDArray[np.float64]
Place = Callable[[Array], Array]
"""Times of shape (n,) to places [mm] of shape (n, 2)."""

TREMOR_MM = 0.05
_PEAK_OVER_MEAN = 1.875  # speed of a minimum-jerk stroke


@dataclass(frozen=True)
class FingerPath:
    """A path that is known exactly.

    Parameters
    ----------
    kind : str
        Which of `KINDS`.
    duration_s : float
        It is defined from 0 to here.
    place : callable
        From times of shape (n,) to x and y [mm], shape (n, 2).
    """

    kind: str
    duration_s: float
    place: Place

    @classmethod
    def make(
        cls, kind: str, seed: int, duration_s: float = 20.0, speed_mm_s: float = 100.0
    ) -> FingerPath:
        """Make a path of a kind.

        Parameters
        ----------
        kind : str
            "strokes": straight minimum-jerk strokes of 20 to 60 mm with rests between;
            "scribble": a smooth curve through random places a quarter of a second apart;
            "zigzag": to and fro at 1 to 2 Hz, drifting sideways; "circles": rounds of 8 to 20 mm
            radius.
        seed : int
            Seed of all randomness in the path.
        duration_s : float
            Length [s].
        speed_mm_s : float
            Mean speed over the path; of strokes the mean of the highest speeds.
        """
        choice("kind", kind, KINDS)
        positive("duration_s", duration_s)
        positive("speed_mm_s", speed_mm_s)
        random = np.random.default_rng(seed)
        made = KINDS[kind](random, duration_s, speed_mm_s)
        tremor = _tremor(random)
        return cls(kind, duration_s, lambda t: made(t) + tremor(t))

    def reports(
        self,
        seed: int,
        rate_hz: float = 100.0,
        latency_s: float = 0.0,
        noise_mm: float = 0.1,
        jitter_s: float = 0.0005,
        missing: float = 0.0,
    ) -> list[TouchEvent]:
        """Reports of a touchscreen, in order: one touch, from "down" to "up".

        Parameters
        ----------
        seed : int
            Seed of noise, jitter and lost reports.
        rate_hz : float
            Reports per second.
        latency_s : float
            From the finger being at a place to the time stamp of the report.
        noise_mm : float
            Standard deviation of each coordinate.
        jitter_s : float
            Reports come up to this far from their regular times; their time stamps are right.
        missing : float
            Share of the reports that are lost.
        """
        random = np.random.default_rng(seed)
        t = np.arange(0.0, self.duration_s, 1 / rate_hz)
        t[1:] += random.uniform(-jitter_s, jitter_s, len(t) - 1)
        places = self.place(t) + random.normal(0.0, noise_mm, (len(t), 2))
        kept = random.uniform(size=len(t)) >= missing
        kept[[0, -1]] = True
        found = np.column_stack([t + latency_s, places])[kept].tolist()
        last = len(found) - 1
        return [
            TouchEvent(t_s, 0, x, y, "down" if i == 0 else "up" if i == last else "move")
            for i, (t_s, x, y) in enumerate(found)
        ]


def _strokes(random: np.random.Generator, duration_s: float, speed_mm_s: float) -> Place:
    starts, lengths, places = [], [], [np.array([30.0, 20.0])]
    t = 0.0
    while t < duration_s:
        t += random.uniform(0.05, 0.3)
        length = random.uniform(20.0, 60.0)
        angle = random.uniform(0, 2 * np.pi)
        takes = _PEAK_OVER_MEAN * length / (speed_mm_s * random.uniform(0.7, 1.3))
        starts.append(t)
        lengths.append(takes)
        places.append(places[-1] + length * np.array([np.cos(angle), np.sin(angle)]))
        t += takes
    begin, takes_s, corners = np.array(starts), np.array(lengths), np.array(places)

    def place(t: Array) -> Array:
        i = np.clip(np.searchsorted(begin, t, side="right") - 1, 0, len(begin) - 1)
        s = np.clip((t - begin[i]) / takes_s[i], 0.0, 1.0)
        part = s**3 * (10 + s * (6 * s - 15))
        return np.asarray(corners[i] + part[:, None] * (corners[i + 1] - corners[i]))

    return place


def _scribble(random: np.random.Generator, duration_s: float, speed_mm_s: float) -> Place:
    t = np.arange(-0.5, duration_s + 0.5, 0.25)
    steps = random.uniform(0, 2 * np.pi) + np.cumsum(random.normal(0.0, 0.9, len(t)))
    long = 0.25 * random.uniform(0.5, 1.5, len(t))
    through = np.cumsum(long[:, None] * np.column_stack([np.cos(steps), np.sin(steps)]), axis=0)
    curve = make_interp_spline(t, through, k=5)
    dense = np.arange(0.0, duration_s, 1e-3)
    mean = float(np.hypot(*curve(dense, 1).T).mean())

    def place(t: Array) -> Array:
        return np.asarray(curve(t) * (speed_mm_s / mean))

    return place


def _zigzag(random: np.random.Generator, duration_s: float, speed_mm_s: float) -> Place:
    frequency = random.uniform(1.0, 2.0)
    half_width = speed_mm_s / (4 * frequency)  # twice there and back in a period
    angle = random.uniform(0, 2 * np.pi)
    along = np.array([np.cos(angle), np.sin(angle)])
    across = np.array([-np.sin(angle), np.cos(angle)])

    def place(t: Array) -> Array:
        swing = half_width * np.sin(2 * np.pi * frequency * t)
        return np.asarray(swing[:, None] * along + (2.0 * t)[:, None] * across)

    return place


def _circles(random: np.random.Generator, duration_s: float, speed_mm_s: float) -> Place:
    radius = random.uniform(8.0, 20.0)
    turn = random.choice([-1.0, 1.0]) * speed_mm_s / radius

    def place(t: Array) -> Array:
        return np.column_stack([radius * np.cos(turn * t), radius * np.sin(turn * t)])

    return place


def _rest(random: np.random.Generator, duration_s: float, speed_mm_s: float) -> Place:
    return lambda t: np.zeros((len(t), 2))


def _tremor(random: np.random.Generator) -> Place:
    frequency = random.uniform(8.0, 12.0, (3, 2))
    phase = random.uniform(0, 2 * np.pi, (3, 2))

    def place(t: Array) -> Array:
        waves = np.sin(2 * np.pi * frequency * t[:, None, None] + phase)
        # Three waves of one power: TREMOR_MM is the standard deviation along each axis.
        return np.asarray(TREMOR_MM * np.sqrt(2 / 3) * waves.sum(axis=1))

    return place


KINDS: Mapping[str, Callable[[np.random.Generator, float, float], Place]] = {
    "strokes": _strokes,
    "scribble": _scribble,
    "zigzag": _zigzag,
    "circles": _circles,
    "rest": _rest,
}
"""Kinds of path, and how each is made."""
