"""Methods of an experiment: they choose levels and take answers; those of a fixed order."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from math import isinf
from typing import Any, ClassVar

import numpy as np

from haptix.base.checks import row, whole
from haptix.base.errors import InputError
from haptix.lab.experiment.orders import shuffled
from haptix.lab.experiment.psychometric import Answers, Estimate, fit, function_named

DRAWN = ("seed", "stream", "order", "first_row", "square_seed")
"""Settings of a method that differ between the sessions of one experiment."""


@dataclass(eq=False)
class Method:
    """Chooses levels one at a time by the answers so far. A subclass has its settings as fields."""

    kind: ClassVar[str]
    """Name in recipes."""

    @property
    def level(self) -> float:
        """The level to be presented next."""
        raise NotImplementedError

    @property
    def is_done(self) -> bool:
        """Whether the method is finished."""
        raise NotImplementedError

    @property
    def other_levels(self) -> tuple[float, ...]:
        """Levels that the next presentation is compared with; none for the reference."""
        return ()

    def update(self, is_right: float, level: float | None = None) -> None:
        """Take an answer.

        Parameters
        ----------
        is_right : float
            True, or 1, where it is; the number, where that is the answer.
        level : float, optional
            The presented level, if it differs from the method's.
        """
        raise NotImplementedError

    def postpone(self) -> None:
        """Note that the presentation did not count; by default it is presented again."""

    def estimate(
        self, empty: tuple[int, int] = (0, 0), reaction_s: Sequence[float] | None = None
    ) -> Estimate:
        """Estimate from the answers so far.

        Parameters
        ----------
        empty : (int, int)
            Trials without a target in which one was found, and all of them; of tasks that detect.
        reaction_s : sequence of float, optional
            Reaction time of each answer [s], where they are known: see `fast_guesses`. None of
            them are needed where nobody guesses, as a simulated observer: then it is empty.
        """
        raise NotImplementedError

    def describe(self) -> dict[str, Any]:
        """Everything that determines what it does, as plain values; no limit is None."""
        settings = {field.name: getattr(self, field.name) for field in fields(self) if field.init}
        return {"method": self.kind} | {
            name: None if isinstance(value, float) and isinf(value) else value
            for name, value in settings.items()
        }


class ThresholdMethod(Method):
    """A method that measures a threshold; all methods estimate it from the same posterior."""

    answers: Answers
    """Level of each trial, and whether the answer was right."""
    function: str = "weibull"

    @property
    def guess_share(self) -> float:
        """Share right of an observer who guesses."""
        raise NotImplementedError

    def estimate(
        self, empty: tuple[int, int] = (0, 0), reaction_s: Sequence[float] | None = None
    ) -> Estimate:
        return fit(self.answers, self.function, self.guess_share, empty, reaction_s or ())


class FixedOrder(Method):
    """A method whose order of presentations is fixed before the first trial."""

    _order: list[tuple[float, ...]]
    """Level of each presentation, and of what it is compared with, if that is a level."""
    answers: Sequence[object]

    @property
    def _next(self) -> tuple[float, ...]:
        return self._order[min(len(self.answers), len(self._order) - 1)]

    @property
    def level(self) -> float:
        return self._next[0]

    @property
    def is_done(self) -> bool:
        return len(self.answers) >= len(self._order)

    def postpone(self) -> None:
        """Present it again at the end."""
        self._order.append(self._order.pop(len(self.answers)))


_CONDITION = 0x636F6E  # any number but 0, as which numpy's generators take one that is missing


@dataclass(eq=False)
class MethodsByCondition(Method):
    """A method for each condition.

    Parameters
    ----------
    methods : mapping of str to Method
        By the names of the conditions, in the order of their blocks.
    interleaved : bool
        Each trial's condition is drawn from those that are not done; otherwise one follows another.
    seed : int
        Seed of the draws.
    stream : int
        Keeps these draws apart from those of the intervals, which have the same seed. 0 where a log
        states none: its draws were not apart, and its practice was of one condition.
    """

    methods: Mapping[str, Method]
    interleaved: bool = True
    seed: int = 0
    stream: int = _CONDITION

    kind = "conditions"

    def __post_init__(self) -> None:
        if not self.methods:
            raise InputError("conditions: expected one or more")
        self._taken = 0
        self._drawn: str | None = None

    @property
    def condition(self) -> str:
        """Name of the condition of the next trial."""
        if self._drawn is None:
            left = [name for name, method in self.methods.items() if not method.is_done]
            left = left or list(self.methods)[-1:]
            draw = np.random.default_rng([self.seed, self._taken, self.stream])
            self._drawn = left[int(draw.integers(len(left)))] if self.interleaved else left[0]
        return self._drawn

    def practised(self, trial: int) -> str:
        """Return the condition of a practice trial: in turn those that are interleaved."""
        names = list(self.methods)
        return names[trial % len(names)] if self.interleaved and self.stream else self.condition

    @property
    def level(self) -> float:
        return self.methods[self.condition].level

    @property
    def other_levels(self) -> tuple[float, ...]:
        return self.methods[self.condition].other_levels

    @property
    def is_done(self) -> bool:
        return all(method.is_done for method in self.methods.values())

    def update(
        self, is_right: float, level: float | None = None, condition: str | None = None
    ) -> None:
        """Take an answer to a condition.

        Parameters
        ----------
        is_right, level : float
            As for `Method.update`.
        condition : str, optional
            By default that of the next trial.
        """
        self.methods[self.condition if condition is None else condition].update(is_right, level)
        self._taken, self._drawn = self._taken + 1, None

    def postpone(self) -> None:
        self.methods[self.condition].postpone()

    def estimate(
        self, empty: tuple[int, int] = (0, 0), reaction_s: Sequence[float] | None = None
    ) -> Estimate:
        """Return the estimate of the only condition; several have theirs in `methods`."""
        if len(self.methods) == 1:
            return next(iter(self.methods.values())).estimate(empty, reaction_s)
        return Estimate()

    def describe(self) -> dict[str, Any]:
        described = {name: method.describe() for name, method in self.methods.items()}
        return super().describe() | {"methods": described, "order": list(self.methods)}


@dataclass(eq=False)
class ConstantStimuli(FixedOrder, ThresholdMethod):
    """Every level equally often, in a random order.

    Parameters
    ----------
    levels : sequence of float
        Levels.
    repeats : int
        Presentations of each level.
    seed : int
        Seed of the order; every repetition has all levels once.
    function, guess
        Form of the fitted function and share right of one who guesses, see `fit`.
    """

    levels: Sequence[float]
    repeats: int = 20
    seed: int = 0
    function: str = "weibull"
    guess: float = 0.5

    kind = "constant-stimuli"

    def __post_init__(self) -> None:
        self.levels = row("levels", self.levels, 2).tolist()
        whole("repeats", self.repeats, 1)
        function_named(self.function)
        self._order = shuffled(self.levels, self.repeats, self.seed)
        self.answers: list[tuple[float, bool]] = []

    def update(self, is_right: float, level: float | None = None) -> None:
        self.answers.append((self.level if level is None else float(level), bool(is_right)))

    @property
    def guess_share(self) -> float:
        return self.guess
