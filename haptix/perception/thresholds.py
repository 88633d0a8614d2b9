"""Detection thresholds and just-noticeable differences as data, each with its source."""

from __future__ import annotations

import os
from functools import cache
from itertools import pairwise
from math import inf
from pathlib import Path
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import Field, PositiveFloat, model_validator

from haptix.checks import Array
from haptix.documents import Document, Part
from haptix.errors import InputError

DEFAULT_FILE = Path(__file__).with_name("thresholds.toml")
"""Default file of detection thresholds and JND."""

CHOICE = "HAPTIX_PERCEPTION"
"""Variable of the environment with the name of a JND in `DEFAULT_FILE`, or the path of a file:
tolerances, plans, evaluations, verdicts and calibrations of the process then count in it."""

Direction = Literal["rising", "falling", "either"]


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
    condition, insulator : str
        How they were measured, and on what.
    read_from : str
        Page, table or figure of the source that they were read from.
    reading_error_db, between_people_db : float, optional
        How surely they were read, and the standard deviation between people; None is not known.
    percent_correct : float, optional
        Of the answers at the detection threshold.
    summation_s : float, optional
        Time constant over which the channel sums energy; without it, none.
    summation_source : str
        Where that comes from.
    summation_is_placeholder, is_placeholder : bool
        Whether the numbers were not measured.
    """

    name: str
    felt_hz: Annotated[tuple[PositiveFloat, ...], Field(min_length=2)]
    threshold_db: tuple[float, ...]
    source: str = ""
    condition: str = ""
    insulator: str = ""
    read_from: str = ""
    reading_error_db: PositiveFloat | None = None
    between_people_db: PositiveFloat | None = None
    percent_correct: PositiveFloat | None = None
    summation_s: PositiveFloat | None = None
    summation_source: str = ""
    summation_is_placeholder: bool = False
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
        return float(self.thresholds(np.array([felt_hz]))[0])

    def thresholds(self, felt_hz: Array) -> Array:
        """Thresholds [dB re 1 V] at felt frequencies [Hz]; infinite outside the channel's data."""
        at = np.log(np.maximum(felt_hz, 1e-9))
        nodes = np.log(self.felt_hz)
        found = np.interp(at, nodes, self.threshold_db)
        # The same numbers decide what is inside, whose logarithms may round.
        inside = (felt_hz >= self.felt_hz[0]) & (felt_hz <= self.felt_hz[-1])
        return np.where(inside, found, inf)


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
    """Just-noticeable difference (JND) of friction, relative to the friction.

    Parameters
    ----------
    name : str
        By which it is chosen, as in a tolerance of ``"0.05 JND of samur-2009"``.
    weber_fraction : float
        JND over the friction.
    direction : {"rising", "falling", "either"}
        Of the change that was noticed.
    condition, source, read_from : str
        How it was measured, where it was published, and what of that was read.
    reading_error : float, optional
        How surely it was read; None is not known.
    """

    name: str = "own"
    weber_fraction: PositiveFloat
    direction: Direction = "either"
    condition: str = ""
    source: str = ""
    read_from: str = ""
    reading_error: PositiveFloat | None = None

    def of(self, mu: Any) -> Any:
        """JND in friction coefficient at a friction coefficient: a number, array or tensor."""
        return self.weber_fraction * mu


class AmplitudeStep(Part):
    """Just-noticeable difference of a sine drive's amplitude [dB]."""

    step_db: PositiveFloat
    source: str = ""


class Perception(Document):
    """Detection thresholds and JND of touch, as the tables of ``thresholds.toml``.

    Parameters
    ----------
    difference : Difference
        Just-noticeable difference of friction.
    alternatives : tuple of Difference
        Others, to choose by their names.
    amplitude : AmplitudeStep
        Just-noticeable difference of a drive's amplitude.
    audibility : Audibility
        When a drive may be heard.
    channels : tuple of Channel
        Detection thresholds.
    """

    difference: Difference
    alternatives: tuple[Difference, ...] = ()
    amplitude: AmplitudeStep
    audibility: Audibility
    channels: Annotated[tuple[Channel, ...], Field(min_length=1)]

    @classmethod
    @cache
    def default(cls) -> Self:
        """Return the data in force: the package's own, or what `CHOICE` names.

        Raises
        ------
        HaptixError
            If it names no alternative and no file.
        """
        chosen = os.environ.get(CHOICE, "")
        if chosen.endswith((".toml", ".json")):
            return cls.load(chosen)
        known = cls.load(DEFAULT_FILE)
        try:
            return known.replace(difference=known.jnd(chosen)) if chosen else known
        except InputError as error:
            raise InputError(f"{CHOICE}: {error}, or the path of a .toml file") from None

    def jnd(self, name: str | None = None) -> Difference:
        """Return the JND of friction, or the alternative of a name.

        Raises
        ------
        InputError
            If there is none of that name.
        """
        known = {one.name: one for one in (*self.alternatives, self.difference)}
        if name is None:
            return self.difference
        if name not in known:
            raise InputError(f"JND: expected one of {', '.join(known)}, got {name!r:.40}")
        return known[name]

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
                f"felt frequency {felt_hz:g} Hz: no detection threshold there (data: {spans}); "
                "choose another frequency or load your own thresholds"
            )
        return best

    def difference_mu(self, mu: float) -> float:
        """Just-noticeable difference of friction at a friction coefficient."""
        return self.weber_fraction * mu


WEBER_FRACTION: float = Perception.default().weber_fraction
"""Just-noticeable difference of friction over the friction, by `Perception.default`."""
