"""Runs trials: presents, asks, checks the touch, logs, and updates the method."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Literal

import numpy as np
import numpy.typing as npt

from firmware_io import Device
from firmware_io.clock import HOST_CLOCK
from haptix import checks
from haptix.errors import FileFormatError, InputError, LimitError
from haptix.stimuli.adaptive.log import TrialLog, program
from haptix.stimuli.adaptive.method import Method
from haptix.stimuli.adaptive.observer import AnswerTo, Question
from haptix.stimuli.adaptive.presentation import Presentation, Touch

Array = npt.NDArray[np.float64]
Task = Literal["2ifc", "2afc"]

CHOICES: dict[str, tuple[str, str]] = {"2ifc": ("1", "2"), "2afc": ("l", "r")}
"""Keys of the answers: first or second interval, left or right side."""

_CLOSE = 1e-9
_MOST_ATTEMPTS = 20  # at one trial


@dataclass(eq=False)
class Experiment:
    """A run of one method, on a device.

    In "2ifc" target and reference come one after the other with a pause between; in "2afc" they
    are the left and the right half of one stroke, without one. Which is which is drawn from the
    seed and the trial's number. A trial whose force or speed was off by more than 15 % is logged as
    not accepted and presented again at the same level. The voltage never exceeds the ceiling: a
    level above it is lowered, and the log and the method get the lowered level.

    Parameters
    ----------
    method : Method
        Chooses the levels.
    presentation : Presentation
        Makes drive signals of the levels.
    device : Device
        Plays them; used as a context manager, once per interval.
    answer : callable
        `Keys`, `SimulatedObserver` or any function of a `Question`.
    log_file : path
        Table of the trials; an unfinished run continues from it.
    task : {"2ifc", "2afc"}
        How the two alternatives are presented.
    seed : int
        Seed of the order of the alternatives.
    ceiling_v : float, optional
        Highest voltage; by default the device's, and never above that.
    pause_s : float
        Pause between the intervals of "2ifc".
    touch : callable, optional
        Returns the `Touch` of the trial that was just played. None, for no touch, counts as a wrong
        one.
    normal_force_n, speed_mm_per_s : float, optional
        Force and speed that `touch` is checked against.
    tolerance : float
        Relative tolerance of `touch`.
    clock, wait : callable
        Time [s] for the log, and a function that waits [s].
    another_program : bool
        Continue a log that another version of haptix began; its rows say which wrote them.

    Raises
    ------
    InputError
        If another process writes the log.
    FileFormatError
        If the log is of another stimulus, finger, screen, method or setting, is none, or was begun
        by another version of haptix and is not over.
    """

    method: Method
    presentation: Presentation
    device: Device
    answer: AnswerTo
    log_file: str | Path
    task: Task = "2ifc"
    seed: int = 0
    ceiling_v: float | None = None
    pause_s: float = 0.5
    touch: Callable[[], Touch | None] | None = None
    normal_force_n: float | None = None
    speed_mm_per_s: float | None = None
    tolerance: float = 0.15
    clock: Callable[[], float] = time.monotonic
    wait: Callable[[float], None] = time.sleep
    another_program: bool = False

    def __post_init__(self) -> None:
        checks.choice("task", self.task, CHOICES)
        checks.number("pause_s", self.pause_s, 0.0)
        checks.positive("tolerance", self.tolerance)
        is_checked = self.normal_force_n is not None or self.speed_mm_per_s is not None
        if self.touch is not None and not is_checked:
            raise InputError("touch: expected a normal_force_n or speed_mm_per_s to check it by")
        if self.device.mode != "waveform":
            raise InputError(
                "device: expected one that takes samples of the wave, got one in "
                f"{self.device.mode} mode; open it in waveform mode"
            )
        allowed = self.device.limits.ceiling_v
        self._ceiling_v = allowed if self.ceiling_v is None else float(self.ceiling_v)
        if not 0 < self._ceiling_v <= allowed:
            raise LimitError(
                f"ceiling_v: expected above 0 and at most the device's {allowed:g} V, got "
                f"{self._ceiling_v:g} V"
            )
        names = ("task", "seed", "pause_s", "normal_force_n", "speed_mm_per_s", "tolerance")
        settings = {
            "method": self.method.describe(),
            "ceiling_v": self._ceiling_v,
            **{name: getattr(self, name) for name in names},
            "hashes": self.presentation.hashes(self.allowed(self.method.level)),
        }
        self.log = TrialLog(self.log_file, settings)
        self.trials = 0
        """Accepted trials, those of an earlier run included."""
        self._attempt = 0
        for row in self.log.rows:
            if row["accepted"] == "true":
                self._accept(row["is_right"] == "true", float(row["level"]))
            else:
                self._attempt += 1
        self._session, self._start = _resumed(self.log.rows, self.clock())
        if not self.method.is_done and self.log.version != program():
            if not self.another_program:
                self.log.close()
                raise FileFormatError(
                    f"{self.log.path}: was begun by haptix {self.log.version}, and this is "
                    f"{program()}: trials of two programs would be mixed. Finish it with that one, "
                    "or ask for another_program (--another-program)"
                )
            self.log.go_on()

    def run(self) -> None:
        """Present trials until the method is done; then others can write the log."""
        for _ in self:
            pass

    def __iter__(self) -> Iterator[dict[str, str]]:
        """Present trials one by one; yields the log's line of each attempt."""
        self.log.open()
        try:
            while not self.method.is_done:
                yield self._present()
        finally:
            self.log.close()

    def _present(self) -> dict[str, str]:
        asked = float(self.method.level)
        level = self.allowed(asked)
        draw = np.random.default_rng([self.seed, self.trials, self._attempt])
        choices = CHOICES[self.task]
        right = int(draw.integers(2))
        target = np.asarray(self.presentation.target(level), dtype=float)
        highest = max(float(np.abs(one).max()) for one in (target, self.presentation.reference))
        if highest > self._ceiling_v * (1 + _CLOSE):
            raise LimitError(
                f"the drive at level {level:g} reaches {highest:g} V, above the ceiling of "
                f"{self._ceiling_v:g} V, though peak_v gives less; correct the presentation"
            )
        parts = [target, self.presentation.reference]
        if right:
            parts.reverse()
        if self.task == "2afc":
            onset = self._play(np.concatenate(parts))
        else:
            onset = self._play(parts[0])
            self.wait(self.pause_s)
            self._play(parts[1])
        felt = None if self.touch is None else self.touch()
        why = self._objection(felt)
        asked_s = self.clock()
        given = self.answer(Question(self.trials, choices, level, choices[right]))
        answered_s = self.clock()
        is_right = checks.choice("answer", given, choices) == choices[right]
        self.log.append(
            {
                "trial": self.trials,
                "attempt": self._attempt,
                "time_s": round(answered_s - self._start, 3),
                "level_asked": asked,
                "level": level,
                "lowered_to_ceiling": level < asked,
                "right": choices[right],
                "answer": given,
                "is_right": is_right,
                "normal_force_n": None if felt is None else felt.normal_force_n,
                "speed_mm_per_s": None if felt is None else felt.speed_mm_per_s,
                "accepted": not why,
                "why": why,
                "session": self._session,
                "onset_s": round(onset - self._start, 4),
                "reaction_s": round(answered_s - asked_s, 4),
                "date": datetime.now(UTC).isoformat(timespec="milliseconds"),
                "version": program(),
                "device": _name(self.device),
                "profile": self.presentation.profile,
            }
        )
        if why:
            self._attempt += 1
            if self._attempt >= _MOST_ATTEMPTS:
                raise InputError(
                    f"trial {self.trials}: {self._attempt} attempts were off, the last since "
                    f"{why}; practise the stroke, or correct the sensor"
                )
        else:
            self._accept(is_right, level)
        return self.log.rows[-1]

    def _accept(self, is_right: bool, level: float) -> None:
        self.method.update(is_right, level)
        self.trials, self._attempt = self.trials + 1, 0

    def allowed(self, level: float) -> float:
        """Return the level, lowered to the highest whose voltage is within the ceiling."""
        peak = self.presentation.peak_v
        if peak(level) <= self._ceiling_v:
            return level
        low, high, span = level, level, 1.0
        while peak(low) > self._ceiling_v:
            low, span = low - span, 2 * span
            if span > 1e6:
                raise LimitError("no level keeps the target within the ceiling")
        while (middle := 0.5 * (low + high)) not in (low, high):
            low, high = (middle, high) if peak(middle) <= self._ceiling_v else (low, middle)
        return low

    def _play(self, drive_v: Array) -> float:
        """Play to the end, and return when the output began, by `clock`.

        Afterwards the device is at 0 V and disarmed, whatever happens.
        """
        with self.device as device:
            began, host_s = self.clock(), HOST_CLOCK()
            device.write(drive_v)
            delay = 0.0
            if hasattr(device, "progress"):  # a stand-in for a device has none
                found = device.progress(is_fresh=True)
                if found.is_playing and found.samples_played:
                    rate = device.capabilities.sample_rate_hz
                    delay = found.reported_s - found.samples_played / rate - host_s
            return began + max(0.0, delay)

    def _objection(self, felt: Touch | None) -> str:
        """Why a touch does not count; empty if it does."""
        if self.touch is None:
            return ""
        if felt is None:
            return "no touch"
        for name in ("normal_force_n", "speed_mm_per_s"):
            asked, was = getattr(self, name), getattr(felt, name)
            if asked is not None and not abs(was - asked) <= self.tolerance * asked * (1 + _CLOSE):
                return f"{name} was {was:g}, not {asked:g} within {self.tolerance:.0%}"
        return ""


def _resumed(rows: Sequence[Mapping[str, str]], now_s: float) -> tuple[int, float]:
    """Number of this session, and the time by the clock that is 0 s in the log.

    A resumed log goes on after its last trial, by as much as has passed since.
    """
    if not rows:
        return 1, now_s
    last, past = rows[-1], 0.0
    if last["date"] != "n/a":
        past = (datetime.now(UTC) - datetime.fromisoformat(last["date"])).total_seconds()
    session = 1 if last["session"] == "n/a" else int(last["session"])
    return session + 1, now_s - float(last["time_s"]) - max(0.0, past)


def _name(device: Device) -> str:
    """Address of a device, and the serial number of its driver."""
    serial = getattr(getattr(device, "capabilities", None), "serial", "")
    return " ".join(filter(None, (getattr(device, "name", ""), serial)))
