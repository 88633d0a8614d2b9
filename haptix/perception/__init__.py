"""Perception: detection thresholds and JND with their sources, and the rule of two channels.

Skin feels the attraction, not the drive. A sine of amplitude V at f attracts with ``V^2 / 4`` at
``2 f`` (in units of ``eps0 I``). Each component of the attraction is measured by the sine drive
that alone would cause it, and compared with the detection threshold of that drive. Energies add
within a channel, and not between channels. The channel furthest above its detection threshold
mediates detection. Two stimuli have equal intensity when their sensation levels there are equal
(Vardar, Guclu, Basdogan, IEEE Trans. Haptics 10, 488 (2017)). For the independence of the channels
see Bolanowski et al., J. Acoust. Soc. Am. 84, 1680 (1988).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from math import inf, log, log10
from pathlib import Path
from typing import Annotated, Self

import numpy as np
import numpy.typing as npt
from pydantic import Field, PositiveFloat, model_validator

from haptix import checks
from haptix.documents import Document, Part
from haptix.errors import InputError

DEFAULT_FILE = Path(__file__).with_name("thresholds.toml")
"""Default file of detection thresholds and JND."""


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
    """Detection thresholds and JND of touch, as the tables of ``thresholds.toml``.

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
        """Return the package's own data."""
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
                f"felt frequency {felt_hz:g} Hz: no detection threshold there (data: {spans}); "
                "choose another frequency or load your own thresholds"
            )
        return best

    def difference_mu(self, mu: float) -> float:
        """Just-noticeable difference of friction at a friction coefficient."""
        return self.weber_fraction * mu


@dataclass(frozen=True)
class Component:
    """One component of the attraction: its frequency, and the sine drive [V] that makes it."""

    felt_hz: float
    drive_v: float


@dataclass(frozen=True)
class Detection:
    """Channel that detects an attraction, and the sensation level there."""

    channel: str
    """Name of the channel that mediates detection."""
    sensation_db: float
    """Level above the detection threshold of that channel [dB]; felt where above 0."""
    is_placeholder: bool
    """Whether that channel's thresholds were not measured."""


def components_of_pull(
    drive_v: npt.ArrayLike, sample_rate_hz: float, least_v: float = 0.1
) -> list[Component]:
    """Components of the attraction of a periodic drive, given whole periods of it.

    Parameters
    ----------
    drive_v : array_like, shape (samples,)
        Voltage; the dispersion of the insulators is left out.
    sample_rate_hz : float
        Samples per second.
    least_v : float
        Components of smaller drives are left out.
    """
    drive = np.asarray(drive_v, dtype=float)
    checks.positive("sample_rate_hz", sample_rate_hz)
    if drive.ndim != 1 or len(drive) < 2:
        raise InputError(f"drive_v: expected 2 samples or more in a row, got shape {drive.shape}")
    # v^2 / 2 is the attraction whose component at 2 f is V^2 / 4 for a sine of amplitude V.
    attraction = np.abs(np.fft.rfft(drive**2 / 2)) * 2 / len(drive)
    frequency = np.fft.rfftfreq(len(drive), 1 / sample_rate_hz)
    alike = np.sqrt(4 * attraction)
    kept = (alike >= least_v) & (frequency > 0)
    return [
        Component(float(f), float(v)) for f, v in zip(frequency[kept], alike[kept], strict=True)
    ]


def detection(components: Sequence[Component], perception: Perception | None = None) -> Detection:
    """Apply the rule to the components of an attraction.

    Raises
    ------
    InputError
        If no component lies where a channel has data.
    """
    known = Perception.default() if perception is None else perception
    # The energy of an attraction is proportional to the fourth power of the drive.
    energies = [
        sum((c.drive_v / 10 ** (channel.threshold(c.felt_hz) / 20)) ** 4 for c in components)
        for channel in known.channels
    ]
    energy, channel = max(zip(energies, known.channels, strict=True), key=lambda pair: pair[0])
    if energy == 0:
        raise InputError(
            "no component of the attraction lies within the thresholds' data; "
            "load thresholds that cover it"
        )
    return Detection(channel.name, 5 * log10(energy), channel.is_placeholder)


WEBER_FRACTION: float = Perception.default().weber_fraction
"""Just-noticeable difference of friction over the friction, by the default file."""
