"""Thresholds of touch, read from a file that names its sources and may be replaced."""

from __future__ import annotations

from functools import cache
from itertools import pairwise
from math import inf, log
from pathlib import Path
from typing import Annotated, Self

import numpy as np
from pydantic import Field, PositiveFloat, model_validator

from haptix.documents import Document, Part
from haptix.errors import InputError

DEFAULT_FILE = Path(__file__).parent / "thresholds.toml"
"""The data that ship."""


class Channel(Part):
    """One channel of touch and its detection threshold.

    Parameters
    ----------
    name : str
        Name of the channel.
    felt_hz, threshold_db : tuple of float
        Frequencies of the attraction [Hz], increasing, and the amplitude of a sine drive that is
        just felt there [dB re 1 V]. Linear in between over the logarithm of frequency; no value
        beyond.
    source : str
        Where the numbers come from.
    is_placeholder : bool
        Whether the numbers were not measured.
    """

    name: str
    felt_hz: Annotated[tuple[PositiveFloat, ...], Field(min_length=2)]
    threshold_db: tuple[float, ...]
    source: str = ""
    is_placeholder: bool = False

    @model_validator(mode="after")
    def _is_a_curve(self) -> Self:
        if len(self.felt_hz) != len(self.threshold_db):
            raise ValueError(
                f"channel {self.name!r}: expected as many felt_hz as threshold_db, got "
                f"{len(self.felt_hz)} and {len(self.threshold_db)}"
            )
        if any(b <= a for a, b in pairwise(self.felt_hz)):
            raise ValueError(f"channel {self.name!r}: felt_hz must increase")
        return self

    def threshold(self, felt_hz: float) -> float:
        """Threshold [dB re 1 V] at a felt frequency; infinite outside the channel's data."""
        if not self.felt_hz[0] <= felt_hz <= self.felt_hz[-1]:
            return inf
        return float(np.interp(log(felt_hz), np.log(self.felt_hz), self.threshold_db))


class Audibility(Part):
    """When a drive may be heard: frequencies [Hz] and the least current [A rms] that counts."""

    low_hz: PositiveFloat
    high_hz: PositiveFloat
    current_a: PositiveFloat
    source: str = ""

    @model_validator(mode="after")
    def _is_a_band(self) -> Self:
        if not self.low_hz < self.high_hz:
            raise ValueError("expected low_hz below high_hz")
        return self

    def __call__(self, frequency_hz: float, current_a: float) -> bool:
        """Whether a component of this frequency at this current [A rms] counts as audible."""
        return self.low_hz <= frequency_hz <= self.high_hz and current_a >= self.current_a


class Difference(Part):
    """Just-noticeable difference of friction, relative to the friction."""

    weber_fraction: PositiveFloat
    source: str = ""


class AmplitudeStep(Part):
    """Just-noticeable difference of a sine drive's amplitude [dB]."""

    step_db: PositiveFloat
    source: str = ""


class Perception(Document):
    """Thresholds of a finger's touch, as the tables of ``thresholds.toml``.

    Parameters
    ----------
    difference : Difference
        Just-noticeable difference of friction.
    amplitude : AmplitudeStep
        Just-noticeable difference of a drive's amplitude.
    audibility : Audibility
        When a drive may be heard.
    channels : tuple of Channel
        Detection thresholds.
    """

    difference: Difference
    amplitude: AmplitudeStep
    audibility: Audibility
    channels: Annotated[tuple[Channel, ...], Field(min_length=1)]

    @classmethod
    @cache
    def default(cls) -> Self:
        """Return the data that ship."""
        return cls.load(DEFAULT_FILE)

    @property
    def weber_fraction(self) -> float:
        """Just-noticeable difference of friction, relative to the friction."""
        return self.difference.weber_fraction

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

    def difference_mu(self, mu: float) -> float:
        """Just-noticeable difference of friction at a friction coefficient."""
        return self.weber_fraction * mu
