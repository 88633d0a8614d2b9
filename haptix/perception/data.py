"""Thresholds as data: read from a file that names its sources, and replaceable."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from math import inf, isfinite, log
from pathlib import Path
from typing import Any, Self

from haptix.errors import FileFormatError, InputError

DEFAULT_FILE = Path(__file__).parent / "thresholds.toml"
"""The data that ship."""


@dataclass(frozen=True)
class Channel:
    """One channel of touch and its detection threshold.

    Parameters
    ----------
    name : str
        What to call it.
    felt_hz, threshold_db : tuple of float
        Frequencies of the pull [Hz], increasing, and the amplitude of a sine drive that is just
        felt there [dB re 1 V]; linear in between over the logarithm of frequency, no value beyond.
    source : str
        Where the numbers come from.
    is_placeholder : bool
        Whether they stand in for measurements.
    """

    name: str
    felt_hz: tuple[float, ...]
    threshold_db: tuple[float, ...]
    source: str = ""
    is_placeholder: bool = False

    def __post_init__(self) -> None:
        if len(self.felt_hz) != len(self.threshold_db) or len(self.felt_hz) < 2:
            raise InputError(
                f"channel {self.name!r}: expected as many felt_hz as threshold_db, 2 or more, got "
                f"{len(self.felt_hz)} and {len(self.threshold_db)}"
            )
        if self.felt_hz[0] <= 0 or any(b <= a for a, b in pairwise(self.felt_hz)):
            raise InputError(f"channel {self.name!r}: felt_hz must be above 0 and increase")
        if not all(isfinite(v) for v in (*self.felt_hz, *self.threshold_db)):
            raise InputError(f"channel {self.name!r}: expected finite numbers")

    def threshold(self, felt_hz: float) -> float:
        """Threshold [dB re 1 V] at a felt frequency; infinite outside the channel's data."""
        x, y = self.felt_hz, self.threshold_db
        if not x[0] <= felt_hz <= x[-1]:
            return inf
        for k in range(len(x) - 1):
            if felt_hz <= x[k + 1]:
                part = log(felt_hz / x[k]) / log(x[k + 1] / x[k])
                return y[k] + part * (y[k + 1] - y[k])
        return y[-1]


@dataclass(frozen=True)
class Audibility:
    """When a drive may be heard: frequencies [Hz] and the least current [A rms] that counts."""

    low_hz: float
    high_hz: float
    current_a: float
    source: str = ""

    def __post_init__(self) -> None:
        if not (0 < self.low_hz < self.high_hz < inf and 0 < self.current_a < inf):
            raise InputError("audibility: expected 0 < low_hz < high_hz and a current_a above 0")

    def __call__(self, frequency_hz: float, current_a: float) -> bool:
        """Whether a component of this frequency at this current [A rms] counts as audible."""
        return self.low_hz <= frequency_hz <= self.high_hz and current_a >= self.current_a


@dataclass(frozen=True)
class Perception:
    """Everything that is taken to be known of a finger's sense.

    Parameters
    ----------
    weber_fraction : float
        Smallest relative change of friction that is felt.
    amplitude_step_db : float
        Smallest change of a sine drive's amplitude that is felt [dB].
    channels : tuple of Channel
        Detection thresholds.
    audibility : Audibility
        When a drive may be heard.
    sources : mapping of str to str
        Of the two numbers above.
    """

    weber_fraction: float
    amplitude_step_db: float
    channels: tuple[Channel, ...]
    audibility: Audibility
    sources: Mapping[str, str]

    def __post_init__(self) -> None:
        for name in ("weber_fraction", "amplitude_step_db"):
            value = getattr(self, name)
            if not (isfinite(value) and value > 0):
                raise InputError(f"{name}: expected a finite number above 0, got {value!r}")
        if not self.channels:
            raise InputError("channels: expected at least one")

    @classmethod
    @cache
    def default(cls) -> Self:
        """Return the data that ship."""
        return cls.load(DEFAULT_FILE)

    @classmethod
    def load(cls, path: str | Path) -> Self:
        """Read a file of the form of ``thresholds.toml``.

        Raises
        ------
        FileFormatError
            If the file is missing, no TOML, or not of that form.
        InputError
            If a number is outside its range.
        """
        path = Path(path)
        try:
            table = tomllib.loads(path.read_text(encoding="utf-8"))
        except OSError as error:
            raise FileFormatError(f"cannot read {path}: {error.strerror}") from None
        except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
            raise FileFormatError(f"{path}: expected a TOML file, got: {error}") from None
        try:
            return cls._of(table)
        except InputError as error:
            raise InputError(f"{path}: {error}") from None
        except (KeyError, TypeError, ValueError) as error:
            raise FileFormatError(
                f"{path}: expected tables difference, amplitude, audibility and channels as in "
                f"haptix/perception/thresholds.toml; wrong or missing: {error}"
            ) from None

    @classmethod
    def _of(cls, table: Mapping[str, Any]) -> Self:
        channels = tuple(
            Channel(
                str(row["name"]),
                tuple(float(v) for v in row["felt_hz"]),
                tuple(float(v) for v in row["threshold_db"]),
                str(row.get("source", "")),
                bool(row.get("is_placeholder", False)),
            )
            for row in table["channels"]
        )
        difference, amplitude = table["difference"], table["amplitude"]
        heard = table["audibility"]
        return cls(
            float(difference["weber_fraction"]),
            float(amplitude["step_db"]),
            channels,
            Audibility(
                float(heard["low_hz"]),
                float(heard["high_hz"]),
                float(heard["current_a"]),
                str(heard.get("source", "")),
            ),
            {
                "difference": str(difference.get("source", "")),
                "amplitude": str(amplitude.get("source", "")),
            },
        )

    def channel_at(self, felt_hz: float) -> Channel:
        """Return the most sensitive channel at a felt frequency.

        Raises
        ------
        InputError
            If no channel has data there.
        """
        best = min(self.channels, key=lambda channel: channel.threshold(felt_hz))
        if best.threshold(felt_hz) == inf:
            spans = ", ".join(
                f"{c.name} {c.felt_hz[0]:g} to {c.felt_hz[-1]:g} Hz" for c in self.channels
            )
            raise InputError(
                f"felt frequency {felt_hz:g} Hz: no threshold is known there (data: {spans}); "
                "choose another frequency or load your own thresholds"
            )
        return best

    def threshold_db(self, felt_hz: float) -> float:
        """Detection threshold [dB re 1 V] of a sine drive that is felt at this frequency."""
        return self.channel_at(felt_hz).threshold(felt_hz)

    def threshold_v(self, felt_hz: float) -> float:
        """Detection threshold as an amplitude [V] of a sine drive."""
        return float(10 ** (self.threshold_db(felt_hz) / 20))

    def difference_mu(self, mu: float) -> float:
        """Difference threshold of friction at a friction coefficient."""
        return self.weber_fraction * mu
