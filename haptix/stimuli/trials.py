"""Trials: which stimulus when, as a table in the form of BIDS, and the trigger channel."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from haptix.checks import NotNegative, check_fields, whole
from haptix.errors import InputError
from haptix.stimuli.stimulus import Stimulus

END_CODE = 255
CODES = END_CODE - 1
"""Codes of a pulse at the onset: 1 to 254."""
PULSE_S = 0.01
LEVELS = 256


@dataclass(frozen=True)
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
    """

    repeats: int = 1
    gap_s: NotNegative = 1.0
    seed: int | None = 0

    def __post_init__(self) -> None:
        whole("repeats", self.repeats, 1)
        check_fields(self)

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
    names = sorted({name for one in stimuli for name in one.conditions})
    rows = [["onset", "duration", "trial_type", "stim_file", "trigger", *names]]
    onset = 0.0
    for index in plan.order(len(stimuli)):
        one = stimuli[index]
        values = [_cell(one.conditions.get(name)) for name in names]
        rows.append(
            [f"{onset:.6f}", f"{one.length_s:.6f}", one.name, files[index],
             str(index + 1), *values]
        )  # fmt: skip
        onset += one.length_s + plan.gap_s
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
    "onset, one after the other on the file's second channel",
}
"""What the codes of a set mean, by the pulses of an onset."""


def pulses(count: int) -> int:
    """Pulses that tell the stimuli of a set of `count` apart.

    Raises
    ------
    InputError
        If two pulses are too few.
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
    the number ``(a - 1) 254 + b``. `END_CODE` marks the end: its pulse ends with the file, which
    has a length of `samples`.
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

    def values(self, first: int, count: int) -> npt.NDArray[np.float32]:
        """Levels at samples, shape (count,)."""
        width = min(round(PULSE_S * self.sample_rate_hz), self.samples // (2 * self.pulses))
        level = np.zeros(count, np.float32)
        for place, code in enumerate(self.onset_codes):
            begin = place * width - first
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
            "pulse_s": PULSE_S,
            "onset_code": self.onset_code,
            **({"onset_codes": list(self.onset_codes)} if self.pulses > 1 else {}),
            "end_code": END_CODE,
        }
