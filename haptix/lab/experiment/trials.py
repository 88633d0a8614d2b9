"""Runs trials: presents, asks, checks force and speed, logs, and updates the method."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from itertools import pairwise
from math import dist, inf
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from pydantic import NonNegativeFloat, ValidationError, model_validator

from haptix.base import checks
from haptix.base.checks import Array
from haptix.base.documents import Part
from haptix.base.errors import FileFormatError, InputError, LimitError
from haptix.base.files import digest
from haptix.lab.experiment.methods import Method, MethodsByCondition
from haptix.lab.experiment.observer import AnswerTo, Question, Source
from haptix.lab.experiment.psychometric import Estimate
from haptix.lab.experiment.session_plan import (
    SessionPlan,
    TrialSequence,
    accepted,
    check_plan,
    estimate_of,
    replay,
    summary,
    task_named,
)
from haptix.lab.experiment.trial_log import TouchLog, TrialLog, cell, program
from haptix.play.devices import Device
from haptix.play.render.intervals import TouchSample, code_of, name_of, on_log_time, play, reported

if TYPE_CHECKING:
    from haptix.play.render.lab_streams import LabOutlets


_GAP_S = 0.1  # between two reports of one touch
_CELLS = 24  # of a bar, whose range is its middle half
_UNITS = {"normal_force_n": ("force", "N"), "speed_mm_per_s": ("speed", "mm/s")}


@dataclass(frozen=True)
class Touch:
    """Mean force and speed of the finger."""

    normal_force_n: float | None
    speed_mm_per_s: float | None
    """None where the panel does not measure it."""

    @classmethod
    def of(cls, samples: Sequence[TouchSample]) -> Self | None:
        """Return that of a panel's reports; None where there are none."""
        if not samples:
            return None
        down = [at for at in samples if at.phase != "up"]
        steps = [
            (dist((first.x_mm, first.y_mm), (second.x_mm, second.y_mm)), second.t_s - first.t_s)
            for first, second in pairwise(sorted(down, key=lambda at: (at.contact, at.t_s)))
            if first.contact == second.contact and 0 < second.t_s - first.t_s < _GAP_S
        ]
        path_mm, time_s = (sum(parts) for parts in zip(*steps, strict=True)) if steps else (0, 0)
        return cls(_mean([at.normal_force_n for at in down]), path_mm / time_s if time_s else None)

    @classmethod
    def mean(cls, strokes: Sequence[Touch | None]) -> Self | None:
        """Return the mean of the strokes of a trial; None where none was touched."""
        felt = [stroke for stroke in strokes if stroke is not None]
        if not felt:
            return None
        return cls(
            _mean([at.normal_force_n for at in felt]), _mean([at.speed_mm_per_s for at in felt])
        )


def _mean(values: Sequence[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return sum(known) / len(known) if known else None


class StrokeRanges(Part):
    """Ranges of force and speed of a valid stroke."""

    normal_force_n: tuple[NonNegativeFloat, NonNegativeFloat] | None = None
    speed_mm_per_s: tuple[NonNegativeFloat, NonNegativeFloat] | None = None
    """Least and most; None is not checked."""

    @model_validator(mode="after")
    def _rises(self) -> Self:
        for name, (low, high) in self.given().items():
            if not low < high:
                raise ValueError(f"{name}: expected [least, most], got [{low:g}, {high:g}]")
        return self

    def given(self) -> dict[str, tuple[float, float]]:
        """Return the ranges that are given, by name."""
        return {name: getattr(self, name) for name in _UNITS if getattr(self, name) is not None}

    def objection(self, felt: Touch | None) -> str:
        """Return the reason why a stroke is not valid; empty if it is."""
        if felt is None:
            return "no touch"
        for name, (low, high) in self.given().items():
            was = getattr(felt, name)
            if was is None:
                return f"{name} was not measured"
            if not low <= was <= high:
                return f"{name} was {was:g}, not {low:g} to {high:g}"
        return ""

    def is_measured(self, felt: Touch | None) -> bool:
        """Whether a stroke has a value in each range, be it within or not."""
        return felt is not None and all(getattr(felt, name) is not None for name in self.given())

    def bars(self, felt: Touch | None) -> str:
        """Draw force and speed of a stroke in their ranges, for a terminal."""
        lines = []
        for name, (low, high) in self.given().items():
            (word, unit), was = _UNITS[name], None if felt is None else getattr(felt, name)
            cells = [*"-" * _CELLS]
            cells[_CELLS // 4] = cells[3 * _CELLS // 4] = "|"
            if was is not None:
                place = _CELLS // 4 + (was - low) / (high - low) * (_CELLS // 2)
                cells[round(min(max(place, 0), _CELLS - 1))] = "#"
            value = "not measured" if was is None else f"{was:.3g} {unit}"
            lines.append(f"{word} [{''.join(cells)}] {value}, of {low:g} to {high:g} {unit}\n")
        return "".join(lines)


_STEP_V = 0.01  # far below a threshold, far above the rounding of a sum


@dataclass(frozen=True)
class Presentation:
    """Drive signals of a trial, for a level.

    Parameters
    ----------
    target : callable
        Drive [V], shape (samples,), for a level.
    reference : ndarray
        Drive [V] of the other alternative.
    peak_v : callable
        Highest voltage of the target at a level; must rise with it.
    identity : mapping of str to str
        What the drive rests on, such as ``{"stimulus": ..., "finger": ...}``, each as a hash. A log
        is continued only by a presentation of the same identity.
    profile : str
        Finger and screen, for the log.
    """

    target: Callable[[float], Array]
    reference: Array
    peak_v: Callable[[float], float]
    identity: Mapping[str, str] = field(default_factory=dict)
    profile: str = ""
    items: Sequence[str] = ()
    """Names of the items of a set, if the levels are their numbers."""
    warnings: Sequence[str] = ()
    """How its contacts lie beyond what was measured."""

    def allowed(self, level: float, ceiling_v: float) -> float:
        """Return the level, lowered to the highest whose voltage is within a ceiling.

        Parameters
        ----------
        level : float
            The level that is asked for.
        ceiling_v : float
            Highest voltage [V].
        """
        if self.peak_v(level) <= ceiling_v:
            return level
        if self.items:
            raise LimitError(
                f"{self.items[int(level)]}: reaches {self.peak_v(level):.3g} V, above the ceiling "
                f"of {ceiling_v:g} V; lower its contrast"
            )
        low, high, span = level, level, 1.0
        while self.peak_v(low) > ceiling_v:
            low, span = low - span, 2 * span
            if span > 1e6:
                raise LimitError("no level keeps the target within the ceiling")
        while (middle := 0.5 * (low + high)) not in (low, high):
            low, high = (middle, high) if self.peak_v(middle) <= ceiling_v else (low, middle)
        return low

    def hashes(self, level: float) -> dict[str, str]:
        """Return `identity`, and where it names no finger the drive itself, at a level."""
        if "finger" in self.identity:
            return dict(self.identity)
        # Adding 0.0 makes a negative zero a zero.
        drives = (
            np.round(stimulus / _STEP_V) + 0.0 for stimulus in (self.target(level), self.reference)
        )
        return {**self.identity, "drive": digest({"drive": [drive.tolist() for drive in drives]})}


_LOG = logging.getLogger("haptix.lab.stimuli")

_CLOSE = 1e-9
_MOST_ATTEMPTS = 20  # at one trial
_COUNTS_AFTER = 5  # attempts, where a person's own stroke is out of the range


@dataclass(eq=False)
class Experiment:
    """A run of one method, on a device.

    In "2ifc" target and reference come one after the other with a pause between; in "2afc" they
    are the left and the right half of one stroke, without one; `TASKS` has all. Which is which is
    drawn from the seed and the trial's number. A trial whose force or speed was off is logged as
    not accepted and presented again: by a method of a fixed order at its end, by others at once, at
    the same level. The fifth attempt in a row that is out of the ranges counts, and its row keeps
    the reason: a person may be unable to move faster. The voltage never exceeds the ceiling: a
    level above it is lowered, and the log
    and the method get the lowered level.

    Parameters
    ----------
    method : Method
        Chooses the levels; `MethodsByCondition` has one for each of several conditions.
    presentation : Presentation or mapping of str to Presentation
        Makes drive signals of the levels; several by the names of the conditions.
    device : Device
        Plays them; used as a context manager, once per interval.
    answer : callable
        `Keys`, `SimulatedObserver` or any function of a `Question`.
    log_file : path
        Table of the trials; an unfinished run continues from it.
    task : str
        Presentation of the alternatives and the question: a name of `TASKS`.
    seed : int
        Seed of the order of the alternatives.
    ceiling_v : float, optional
        Highest voltage; by default the device's, and never above that.
    pause_s : float
        Pause between the intervals of "2ifc".
    touch : callable, optional
        Returns the `Touch` of the trial that was just played. None, for no touch, counts as a wrong
        one. By default it is that of each interval, by the reports of the device's panel.
    normal_force_n, speed_mm_per_s : float or tuple of float, optional
        Force and speed that the touch is checked against: least and most, or a middle. A simulated
        observer touches nothing, and is checked by `touch` alone.
    tolerance : float
        Relative tolerance about a middle.
    clock, wait : callable
        Time [s] for the log, and a function that waits [s].
    plan : SessionPlan
        Practice, catch trials, breaks, when to stop.
    rest : callable, optional
        Called at a break with the number of trials so far; returns when the participant goes on.
    show : callable, optional
        Called after each interval with a text that shows force and speed in their ranges.
    tell : callable, optional
        Called with whether an answer was right, where the plan gives feedback.
    source : Source, optional
        Where the answers come from, if `answer` does not know; a log has one source.
    outlets : LabOutlets, optional
        Streams that get each interval's mark, drive and touches once it was played.
    another_program : bool
        Continue a log that another version of haptix began; its rows say which wrote them.
    participant : str, optional
        Pseudonym, which the log keeps.

    Raises
    ------
    InputError
        If another process writes the log.
    FileFormatError
        If the log is of another stimulus, finger, screen, method, setting or source, is none, was
        changed, has other trials than the plan, or was begun by another version of haptix and is
        not over.
    """

    method: Method
    presentation: Presentation | Mapping[str, Presentation]
    device: Device
    answer: AnswerTo
    log_file: str | Path
    task: str = "2ifc"
    seed: int = 0
    ceiling_v: float | None = None
    pause_s: float = 0.5
    touch: Callable[[], Touch | None] | None = None
    normal_force_n: float | tuple[float, float] | None = None
    speed_mm_per_s: float | tuple[float, float] | None = None
    tolerance: float = 0.15
    clock: Callable[[], float] = time.monotonic
    wait: Callable[[float], None] = time.sleep
    another_program: bool = False
    plan: SessionPlan = field(default_factory=SessionPlan)
    rest: Callable[[int], None] | None = None
    tell: Callable[[bool], None] | None = None
    show: Callable[[str], None] | None = None
    source: Source | None = None
    outlets: LabOutlets | None = None
    participant: str | None = None

    def __post_init__(self) -> None:
        self._task = task_named(self.task)
        check_plan(self.plan, self._task, self.task)
        checks.number("pause_s", self.pause_s, 0.0)
        checks.positive("tolerance", self.tolerance)
        wanted = {"normal_force_n": self.normal_force_n, "speed_mm_per_s": self.speed_mm_per_s}
        most = self.tolerance * (1 + _CLOSE)
        try:
            self._ranges = StrokeRanges(
                **{
                    name: (max(0.0, value * (1 - most)), value * (1 + most))
                    if isinstance(value, float | int)
                    else value
                    for name, value in wanted.items()
                }
            )
        except ValidationError as error:
            raise InputError(checks.first_error("touch", error)) from None
        if self.touch is not None and not self._ranges.given():
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
        if self.source is None:
            self.source = getattr(self.answer, "answers_are", "program")
        settings = {
            "method": self.method.describe(),
            "ceiling_v": self._ceiling_v,
            **{name: getattr(self, name) for name in names},
            "hashes": self._hashes(),
            "source": self.source,
        }
        if self.participant is not None:
            settings["participant"] = self.participant
        if self.plan != SessionPlan():
            settings["plan"] = self.plan.model_dump(mode="json", exclude_defaults=True)
        self._sequence = TrialSequence(self.method, self._task, self.plan, self.seed)
        self.log = TrialLog(self.log_file, settings)
        self.touches = TouchLog(self.log.path)
        """Path and force of the finger in each trial, where the panel reports them."""
        self._began = self.clock()
        self._session, self._start = self.log.resumed(self.clock())
        try:
            self._resume()
        except BaseException:
            self.log.close()
            raise

    def _resume(self) -> None:
        """Replay the rows of the log, and check that the session may continue."""
        differences = [*replay(self._sequence, self.log.rows, self.log.path)]
        if self.is_over:
            return
        if differences:
            raise FileFormatError(
                f"{differences[0]}; this version of haptix cannot continue it: finish it with "
                f"{self.log.version}"
            )
        if self.log.version != program():
            if not self.another_program:
                raise FileFormatError(
                    f"{self.log.path}: was begun by haptix {self.log.version}, and this is "
                    f"{program()}: trials of two programs would be mixed. Finish it with that one, "
                    "or ask for another_program (--another-program)"
                )
            self.log.go_on()

    @property
    def contact_warnings(self) -> list[str]:
        """How contacts of its stimuli lie beyond what was measured; each way once."""
        made = self.presentation
        several = [made] if isinstance(made, Presentation) else made.values()
        return [*dict.fromkeys(line for each in several for line in each.warnings)]

    @property
    def trials(self) -> int:
        """Accepted trials, including practice, catch trials and those of an earlier run."""
        return self._sequence.trials

    @property
    def counted(self) -> int:
        """Those trials that the method was updated with."""
        return self._sequence.counted

    @property
    def rested_s(self) -> float:
        """Time since the last trial of a log that is to be continued; otherwise 0."""
        return 0.0 if self.is_over else self.log.rested_s

    def run(self) -> None:
        """Present trials until the method is done; then others can write the log."""
        for _ in self:
            pass

    def __iter__(self) -> Iterator[dict[str, str]]:
        """Present trials one by one; yields the log's line of each attempt."""
        self.log.open()
        try:
            while not self.is_over:
                yield self._present()
            self.log.finish()
        finally:
            self.log.close()

    @property
    def is_over(self) -> bool:
        """Whether the log is closed, the method is done, or the plan ends the session."""
        stop = self.plan.stop
        if self.log.finished or self.method.is_done or self.counted >= (stop.most_trials or inf):
            return True
        if self.clock() - self._began > 60 * (stop.most_minutes or inf):
            return True
        if stop.spread is None or self.counted < stop.least_trials:
            return False
        return all(part.width / 4 <= stop.spread for part in self.estimates().values())

    def estimates(self) -> dict[str, Estimate]:
        """Return what each condition's method states, by its name; one alone has an empty name."""
        several = (
            self.method.methods
            if isinstance(self.method, MethodsByCondition)
            else {"": self.method}
        )
        return {
            name: estimate_of(method, self.log.rows, self.task, name)
            for name, method in several.items()
        }

    def summary(self, condition: str = "") -> dict[str, Any]:
        """Return catch trials, hits, false alarms, d' and exclusion, as plain values.

        Those of a condition, by default of the session; see `session_plan.summary`.
        """
        return summary(self.log.rows, self.task, self.plan.exclude, condition)

    def records(self) -> dict[str, dict[str, Any]]:
        """Return accepted trials, estimate and summary of each condition, as plain values."""
        return {
            name: {
                "trials": len(accepted(self.log.rows, name)),
                **estimate.record(),
                **self.summary(name),
            }
            for name, estimate in self.estimates().items()
        }

    def _made(self, condition: str) -> Presentation:
        if isinstance(self.presentation, Presentation):
            return self.presentation
        return self.presentation[condition]

    def _hashes(self) -> dict[str, Any]:
        if isinstance(self.presentation, Presentation):
            return self.presentation.hashes(self.allowed(self.method.level))
        if not isinstance(self.method, MethodsByCondition) or (
            set(self.method.methods) != set(self.presentation)
        ):
            raise InputError(
                "presentation: expected one for each condition, and MethodsByCondition as method"
            )
        levels = {name: method.level for name, method in self.method.methods.items()}
        return {
            name: presentation.hashes(self.allowed(levels[name], presentation))
            for name, presentation in self.presentation.items()
        }

    def _present(self) -> dict[str, str]:
        planned, attempt = self._sequence.next(), self._sequence.attempt
        made = self._made(planned.condition)
        level = self.allowed(planned.level, made)
        others = tuple(self.allowed(other, made) for other in planned.other_levels)
        if others:
            parts = [self._drive(made, one) for one in (level, *others)]
            if not planned.has_target[0]:  # a catch trial, whose order is drawn
                parts.reverse()
        else:
            target = self._drive(made, level)
            self._check(made.reference, level)
            parts = [target if has else made.reference for has in planned.has_target]
        if self._task.in_one_stroke:
            parts = [np.concatenate(parts)]
        onsets, samples, strokes = [], list[TouchSample](), list[Touch | None]()
        by_panel = self.touch is None and self.source != "simulated"
        for number, part in enumerate(parts):
            if number:
                self.wait(self.pause_s)
            _LOG.info("an interval of %d samples begins", part.size)
            played = play(self.device, part, self.clock, code_of(self.trials, number))
            onsets.append(played.onset_s)
            reports = reported(self.device)
            reported_now = on_log_time(reports, self.device, self.clock)
            samples += reported_now
            if by_panel:
                strokes.append(Touch.of(reported_now))
                if self.show is not None and self._ranges.given():
                    self.show(self._ranges.bars(strokes[-1]))
            if self.outlets is not None:
                self.outlets.marks(played.marked)  # first: they say when the samples were played
                self.outlets.drive(0, part)
                self.outlets.reports(reports)
        felt = Touch.mean(strokes)
        if self.touch is not None:
            felt = self.touch()
            strokes.append(felt)
        why = ""
        if self._ranges.given():
            why = next(filter(None, map(self._ranges.objection, strokes)), "")
        is_own = all(map(self._ranges.is_measured, strokes)) and attempt + 1 >= _COUNTS_AFTER
        is_accepted = not why or is_own
        asked_s = self.clock()
        choices = self._task.choices
        is_empty = not any(planned.has_target)
        question = Question(
            self.trials, choices, level, planned.right, others, is_empty,
            self._task.asks, self._task.takes_whole_numbers,
        )  # fmt: skip
        answer = self.answer(question)
        answered_s = self.clock()
        is_right: bool | None = None
        if choices:
            checks.choice("answer", answer, choices)
            is_right = answer == planned.right if planned.right else None
        elif objection := question.objection(answer):
            raise InputError(f"answer: {objection}, got {answer!r:.80}")
        samples = [replace(at, t_s=round(at.t_s - self._start, 5)) for at in samples]
        self.touches.append(self._session, self.trials, attempt, samples)
        self.log.append(
            {
                "trial": self.trials,
                "attempt": attempt,
                "time_s": round(answered_s - self._start, 3),
                "level_asked": planned.level,
                "level": level,
                "lowered_to_ceiling": level < planned.level,
                "right": planned.right,
                "answer": answer,
                "is_right": is_right,
                "normal_force_n": None if felt is None else felt.normal_force_n,
                "speed_mm_per_s": None if felt is None else felt.speed_mm_per_s,
                "accepted": is_accepted,
                "why": why,
                "session": self._session,
                "onset_s": round(onsets[0] - self._start, 4),
                "reaction_s": round(answered_s - asked_s, 4),
                "date": datetime.now(UTC).isoformat(timespec="milliseconds"),
                "version": program(),
                "device": name_of(self.device),
                "profile": made.profile,
                "kind": planned.kind,
                "condition": planned.condition,
                "other_level": " ".join(map(cell, others)),
                "source": self.source,
            }
        )
        self._sequence.hear(self.log.rows[-1])
        if why and self.show is not None:
            verdict = f"counted: {why}" if is_own else f"not counted: {why}; the trial comes again"
            self.show(f"{verdict}\n")
        if is_accepted:
            self._after(planned.kind, is_right)
        elif attempt + 1 >= _MOST_ATTEMPTS:
            raise InputError(
                f"trial {self.trials}: {attempt + 1} attempts were off, the last since {why}; "
                "practise the stroke, or correct the sensor"
            )
        return self.log.rows[-1]

    def _after(self, kind: str, is_right: bool | None) -> None:
        """Give feedback and a rest, by the plan."""
        practice, every = self.plan.practice, self.plan.break_every
        is_answered = practice.feedback if practice and kind == "practice" else self.plan.feedback
        if is_answered and self.tell is not None and is_right is not None:
            self.tell(is_right)
        before = 0 if practice is None else practice.trials
        is_break = (
            every is not None and self.trials > before and (self.trials - before) % every == 0
        )
        if is_break and self.rest is not None and not self.is_over:
            self.rest(self.trials)

    def _drive(self, made: Presentation, level: float) -> Array:
        drive = np.asarray(made.target(level), dtype=float)
        self._check(drive, level)
        return drive

    def _check(self, drive: Array, level: float) -> None:
        highest = float(np.abs(drive).max())
        if highest > self._ceiling_v * (1 + _CLOSE):
            raise LimitError(
                f"the drive at level {level:g} reaches {highest:g} V, above the ceiling of "
                f"{self._ceiling_v:g} V, though peak_v gives less; correct the presentation"
            )

    def allowed(self, level: float, presentation: Presentation | None = None) -> float:
        """Return the level, lowered to the highest whose voltage is within the ceiling.

        Parameters
        ----------
        level : float
            The level that is asked for.
        presentation : Presentation, optional
            By default that of the next trial's condition.
        """
        condition = self.method.condition if isinstance(self.method, MethodsByCondition) else ""
        return (presentation or self._made(condition)).allowed(level, self._ceiling_v)
