"""Observers: a person at the keys, prepared answers, or a simulation."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from math import inf
from typing import ClassVar, Literal, TextIO

import numpy as np

from haptix.base.errors import InputError
from haptix.lab.experiment.psychometric import function_named

AnswerTo = Callable[["Question"], str]
"""Takes a question, returns one of its choices."""

Source = Literal["terminal", "page", "simulated", "imported", "program"]
"""Where answers come from: a person at a terminal or at a page, a simulated observer, a file or
another program that is piped in, or any other function."""


@dataclass(frozen=True)
class Question:
    """One trial: the choices, and for simulations the level and the right answer."""

    trial: int
    choices: tuple[str, ...]
    level: float
    """Level of the target."""
    right: str
    """The choice that is right."""
    other_levels: tuple[float, ...] = ()
    """Levels that it is compared with; none for the reference."""
    is_empty: bool = False
    """Whether no interval has the target."""
    asks: str = "Which one?"
    """The question in words."""
    takes_whole_numbers: bool = False
    """Whether a number that is the answer must be a whole one."""

    def objection(self, answer: str) -> str:
        """Return why a number cannot be the answer; empty if it can."""
        with suppress(ValueError):
            number = float(answer)
            if 0 < number < inf and (number.is_integer() or not self.takes_whole_numbers):
                return ""
        return f"expected a {'whole ' * self.takes_whole_numbers}number above 0"


@dataclass(frozen=True)
class SimulatedObserver:
    """Answers right with the probability of a psychometric function.

    An answer depends on the seed and the trial's number alone. It compares two levels by a
    cumulative normal of their distance, and of three calls that one least alike whose level is
    furthest from the other two. Magnitudes follow a power of 0.6 with a scatter of a tenth. Groups
    are ranges of levels. Of items it takes the numbers as levels [dB].
    """

    threshold: float
    slope: float = 3.5
    """Level [dB] and steepness of the function."""
    guess: float = 0.5
    """Probability with which it reports a target where there is none."""
    lapse: float = 0.02
    """Share of wrong answers far above the threshold."""
    function: str = "weibull"
    """Name of the psychometric function."""
    seed: int = 0
    """Equal seeds give equal answers."""

    answers_are: ClassVar[Source] = "simulated"

    def __call__(self, question: Question) -> str:
        """Answer."""
        draw = np.random.default_rng([self.seed, question.trial])
        shape = function_named(self.function)
        level = np.array(question.level)
        noise_db = 20 / self.slope / np.sqrt(2)
        if question.takes_whole_numbers:
            felt = question.level + noise_db * draw.standard_normal()
            return f"{1 + max(0, int(felt // (4 * noise_db)))}"
        if not question.choices:
            power = 10 ** (0.6 * (question.level - self.threshold) / 20)
            return f"{10 * power * np.exp(0.1 * draw.standard_normal()):.3g}"
        if question.is_empty:
            mistaken = next(choice for choice in question.choices if choice != question.right)
            return mistaken if draw.random() < self.guess else question.right
        if len(question.other_levels) > 1:
            levels = np.array([question.level, *question.other_levels])
            felt = levels + noise_db * draw.standard_normal(len(levels))
            return question.choices[int(np.argmax(np.abs(felt - np.median(felt))))]
        if question.other_levels:
            apart = (question.level - question.other_levels[0]) * self.slope / 20
            is_more = draw.standard_normal() < apart
            return question.choices[question.choices.index(question.right) ^ (not is_more)]
        if draw.random() < shape(level, self.threshold, self.slope, self.guess, self.lapse):
            return question.right
        wrong = [choice for choice in question.choices if choice != question.right]
        return wrong[int(draw.integers(len(wrong)))]


@dataclass(frozen=True)
class Keys:
    """Waits for a key that is one of the choices."""

    prompt: str = "{asks} {choices} "
    """Shown before, with ``{asks}`` and ``{choices}`` filled in."""
    source: TextIO | None = None
    sink: TextIO | None = None
    """Where keys come from, and where the prompt goes; by default the terminal."""

    @property
    def answers_are(self) -> Source:
        """Typed at a terminal, or imported from a file or another program."""
        is_terminal = (sys.stdin if self.source is None else self.source).isatty()
        return "terminal" if is_terminal else "imported"

    def __call__(self, question: Question) -> str:
        """Answer."""
        source = sys.stdin if self.source is None else self.source
        sink = sys.stderr if self.sink is None else self.sink
        sink.write(self.prompt.format(asks=question.asks, choices="/".join(question.choices)))
        sink.flush()
        if not question.choices:
            return _number(source, sink, question)
        while True:
            key = _one_key(source)
            if not key:
                raise InputError("the keys ended before the experiment; it continues from its log")
            if key in question.choices:
                sink.write(key + "\n")
                return key

    def tell(self, is_right: bool) -> None:
        """Tell whether the answer was right."""
        self.show("right\n" if is_right else "wrong\n")

    def show(self, text: str) -> None:
        """Show lines of text."""
        (sys.stderr if self.sink is None else self.sink).write(text)

    def rest(self, trials: int) -> None:
        """Wait for a key after a number of trials."""
        sink = sys.stderr if self.sink is None else self.sink
        sink.write(f"{trials} trials are done: rest, then press any key\n")
        sink.flush()
        if not _one_key(sys.stdin if self.source is None else self.source):
            raise InputError("the keys ended before the experiment; it continues from its log")


def _number(source: TextIO, sink: TextIO, question: Question) -> str:
    """Read a line until it is a number that can be the answer."""
    while line := source.readline():
        if not (objection := question.objection(line)):
            return line.strip()
        sink.write(f"{objection}: ")
        sink.flush()
    raise InputError("the keys ended before the experiment; it continues from its log")


def _one_key(source: TextIO) -> str:
    """Read one key of a terminal, or one character of another source."""
    if not source.isatty():
        return source.read(1)
    import termios
    import tty

    descriptor = source.fileno()
    before = termios.tcgetattr(descriptor)
    try:
        tty.setcbreak(descriptor)  # which forgets what was pressed before
        # Past the stream's own buffer, in which a second key press would wait for the next trial.
        return os.read(descriptor, 1).decode(errors="replace")
    finally:
        termios.tcsetattr(descriptor, termios.TCSADRAIN, before)
