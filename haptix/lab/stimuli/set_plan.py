"""Content of a set: its stimuli, who feels them, the form of its files, its trials and triggers."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Annotated, Any, Literal

import numpy as np
import numpy.typing as npt
from pydantic import Field

from haptix.base.checks import NotNegative, Number, Positive, checked
from haptix.base.errors import InputError, LimitError
from haptix.feel.signals.audio_files import Container, Encoding, check_format
from haptix.lab.population import Population
from haptix.lab.stimuli.rendering import Apparatus
from haptix.lab.stimuli.stimulus import Stimulus
from haptix.model.finger import Finger
from haptix.model.perception.thresholds import Perception
from haptix.model.screen import Screen
from haptix.play.devices import BODY_CAPACITANCE_F, DriveLimits

END_CODE = 255

CODES = END_CODE - 1
"""Codes of a pulse at the onset: 1 to 254."""

PULSE_S = 0.01
"""Length of a pulse, and of the pause between two; shorter where a file has no room for it."""

LEVELS = 256


@checked()
class TrialPlan:
    """Order and timing of the trials.

    Parameters
    ----------
    repeats : int
        How often each stimulus comes. Each repetition has all of them once, in its own order.
    gap_s : float
        Pause between two trials.
    seed : int or None
        Seed of the orders; with None stimuli come as listed.

    Examples
    --------
    >>> TrialPlan(repeats=3, gap_s=0.5).repeats
    3
    """

    repeats: Annotated[int, Field(ge=1)] = 1
    gap_s: NotNegative = 1.0
    seed: int | None = 0

    def order(self, count: int) -> list[int]:
        """Indices of the stimuli, trial by trial."""
        if self.seed is None:
            return [*range(count)] * self.repeats
        draw = np.random.default_rng(self.seed)
        return [int(i) for _ in range(self.repeats) for i in draw.permutation(count)]


def events(
    stimuli: Sequence[Stimulus], files: Sequence[str], plan: TrialPlan
) -> tuple[str, dict[str, Any]]:
    """Return the table (tab-separated) and the description of its columns.

    `files` are those of the stimuli, in the same order.
    """
    names = sorted({name for stimulus in stimuli for name in stimulus.conditions})
    rows = [["onset", "duration", "trial_type", "stim_file", "trigger", *names]]
    onset = 0.0
    for index in plan.order(len(stimuli)):
        stimulus = stimuli[index]
        values = [_cell(stimulus.conditions.get(name)) for name in names]
        rows.append(
            [f"{onset:.6f}", f"{stimulus.length_s:.6f}", stimulus.name, files[index],
             str(index + 1), *values]
        )  # fmt: skip
        onset += stimulus.length_s + plan.gap_s
    table = "\n".join("\t".join(row) for row in rows) + "\n"
    columns: dict[str, Any] = {
        "onset": {"Description": "Planned start of the stimulus", "Units": "s"},
        "duration": {"Description": "Length of the stimulus", "Units": "s"},
        "trial_type": {"Description": "Name of the stimulus"},
        "stim_file": {"Description": "Drive file; its sidecar has the same name"},
        "trigger": {"Description": TRIGGERS[pulses(len(stimuli))]},
    }
    for name in names:
        columns[name] = {"Description": f"Condition {name!r} of the set"}
    return table, columns


TRIGGERS = {
    1: "Code of the onset's pulse on the file's second channel",
    2: "Number of the stimulus: (a - 1) 254 + b, with the codes a and b of the two pulses of its "
    "onset on the file's second channel, with a pause of their length between them",
}
"""Meaning of the codes of a set, by the pulses of an onset."""


def pulses(count: int) -> int:
    """Pulses that tell the stimuli of a set of `count` apart.

    Raises `InputError` if two pulses are too few.
    """
    if count > CODES**2:
        raise InputError(
            f"stimuli: triggers tell {CODES**2} apart, got {count}; make several sets, or one "
            "without triggers"
        )
    return 1 if count <= CODES else 2


def _cell(value: Any) -> str:
    """Text of a cell; empty ones are ``n/a``."""
    text = "n/a" if value is None or value == "" else str(value)
    return " ".join(text.split())


@dataclass(frozen=True)
class Trigger:
    """A pulse of `PULSE_S` whose level, ``code / 256`` of full scale, marks an event.

    The channel has line level, for a recorder's input. It must never reach the amplifier that
    drives the screen.

    The onset has a code of 1 to 254, at the first sample; or two pulses, whose codes a and b make
    the number ``(a - 1) 254 + b``, and a pause between them, since the codes may be equal.
    `END_CODE` marks the end: its pulse ends with the file, which has a length of `samples`.
    """

    onset_code: int
    samples: int
    sample_rate_hz: float
    pulses: int = 1

    def __post_init__(self) -> None:
        if not 1 <= self.onset_code <= CODES**self.pulses:
            raise InputError(
                f"trigger: expected a code of 1 to {CODES**self.pulses}, got {self.onset_code}"
            )

    @property
    def onset_codes(self) -> tuple[int, ...]:
        """Code of each pulse of the onset."""
        high, low = divmod(self.onset_code - 1, CODES)
        return (low + 1,) if self.pulses == 1 else (high + 1, low + 1)

    @property
    def _width(self) -> int:
        """Samples of a pulse."""
        return min(round(PULSE_S * self.sample_rate_hz), self.samples // (2 * self.pulses))

    def values(self, first: int, count: int) -> npt.NDArray[np.float32]:
        """Levels at samples, shape (count,)."""
        width, level = self._width, np.zeros(count, np.float32)
        for place, code in enumerate(self.onset_codes):
            begin = 2 * place * width - first
            level[max(0, begin) : max(0, begin + width)] = code / LEVELS
        level[max(0, self.samples - width - first) : max(0, self.samples - first)] = (
            END_CODE / LEVELS
        )
        return level

    def describe(self) -> dict[str, object]:
        """Description for the sidecar."""
        return {
            "channel": 2,
            "level": "code / 256 of full scale",
            "pulse_s": self._width / self.sample_rate_hz,
            "onset_code": self.onset_code,
            **({"onset_codes": list(self.onset_codes)} if self.pulses > 1 else {}),
            "end_code": END_CODE,
        }


@checked()
class SetPlan:
    """Stimuli that belong together."""

    name: str
    """Name of the set."""
    stimuli: Annotated[tuple[Stimulus, ...], Field(strict=False)]
    """One or more, with different names."""
    finger: Finger | Population
    """Who feels them."""
    screens: Annotated[tuple[Screen, ...], Field(strict=False)]
    """Every stimulus is rendered for each screen, with the volts that give its friction there."""
    sample_rate_hz: Positive = 48_000.0
    """Samples per second."""
    container: Container = "wav"
    encoding: Encoding = "float32"
    """"wav" or "flac"; "float32" or "24-bit"."""
    full_scale_v: Positive = 250.0
    """Voltage of sample 1.0, above the ceiling."""
    ceiling_v: Number | None = None
    """Highest voltage of the set; by default the lowest of the screens' limits."""
    trigger: bool = True
    """Whether files have a trigger channel."""
    unreachable: Literal["reject", "nearest"] = "reject"
    """Whether friction outside the reachable range rejects the set, or becomes the nearest
    reachable."""
    trials: TrialPlan = field(default_factory=TrialPlan)
    """Order of the trials."""
    perception: Perception = field(default_factory=Perception.default)
    """Detection thresholds; by default those of the package."""

    def __post_init__(self) -> None:
        check_format(self.container, self.encoding)
        if self.sample_rate_hz != round(self.sample_rate_hz):
            raise InputError(
                f"sample_rate_hz: audio files need a whole number, got {self.sample_rate_hz:g}"
            )
        if not self.stimuli or not self.screens:
            raise InputError("stimuli and screens: expected at least one of each")
        names = [stimulus.name for stimulus in self.stimuli]
        twice = sorted(name for name, count in Counter(names).items() if count > 1)
        if twice:
            raise InputError(f"stimuli: two are called {twice[0]!r}; names are those of files")
        taken = sorted({"events", "manifest", "profiles", "sheet"} & set(names))
        if taken:
            raise InputError(f"stimuli: {taken[0]!r} is the name of a file of the set itself")
        screens = [screen.name for screen in self.screens]
        if len(set(screens)) < len(screens):
            raise InputError("screens: two have the same name, and so would their files")
        if self.full_scale_v <= self.limits.ceiling_v:
            raise InputError(
                f"full_scale_v: expected more than the ceiling of {self.limits.ceiling_v:g} V, "
                f"got {self.full_scale_v:g} V"
            )

    @cached_property
    def limits(self) -> DriveLimits:
        """Limits that every sample is checked against."""
        return drive_limits(self.screens, self.ceiling_v)

    def apparatus(self, screen: Screen) -> Apparatus:
        """Build the apparatus of the stimuli, on one screen."""
        return Apparatus.build(self.finger, screen, self.stimuli, self.limits.ceiling_v)

    def suffix(self, screen: Screen) -> str:
        """End of the names of a screen's files, where there are several screens."""
        return "" if len(self.screens) == 1 else f"_on_{screen.name.replace('/', '-')}"

    def file_name(self, stimulus: Stimulus, screen: Screen) -> str:
        """Name of a drive file.

        Parameters
        ----------
        stimulus : Stimulus
            Its content.
        screen : Screen
            For which screen.
        """
        return f"{stimulus.name}{self.suffix(screen)}.{self.container}"


def drive_limits(screens: Sequence[Screen], ceiling_v: float | None = None) -> DriveLimits:
    """Limits of a drive for several screens: those of the lowest, or a lower ceiling [V].

    Raises `LimitError` if the ceiling is above the limit of a screen.
    """
    lowest = min(screen.max_voltage_v for screen in screens)
    ceiling = lowest if ceiling_v is None else ceiling_v
    if ceiling > lowest:
        raise LimitError(
            f"ceiling_v: {ceiling:g} V is above the {lowest:g} V that the screens may carry"
        )
    bodies = [screen.body_capacitance_f for screen in screens]
    return DriveLimits(ceiling_v=ceiling, capacitance_f=max(BODY_CAPACITANCE_F, *bodies))
