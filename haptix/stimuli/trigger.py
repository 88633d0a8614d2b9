"""The trigger channel: coded pulses at onset and end, for other recorders."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from haptix.errors import InputError

END_CODE = 255
PULSE_S = 0.01
LEVELS = 256


@dataclass(frozen=True)
class Trigger:
    """A pulse of `PULSE_S` whose level, ``code / 256`` of full scale, marks an event.

    The channel has line level, for a recorder's input. It must never reach the amplifier that
    drives the screen.

    Parameters
    ----------
    onset_code : int
        1 to 254, at the first sample. `END_CODE` marks the end: its pulse ends with the file.
    samples : int
        Length of the file in samples.
    sample_rate_hz : float
        Samples per second.
    """

    onset_code: int
    samples: int
    sample_rate_hz: float

    def __post_init__(self) -> None:
        if not 1 <= self.onset_code < END_CODE:
            raise InputError(
                f"trigger: expected a code of 1 to {END_CODE - 1}, got {self.onset_code}"
            )

    def values(self, first: int, count: int) -> npt.NDArray[np.float32]:
        """Levels at samples, shape (count,)."""
        width = min(round(PULSE_S * self.sample_rate_hz), self.samples // 2)
        level = np.zeros(count, np.float32)
        level[max(0, -first) : max(0, width - first)] = self.onset_code / LEVELS
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
            "end_code": END_CODE,
        }
