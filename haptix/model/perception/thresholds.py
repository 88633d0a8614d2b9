"""Perception: detection thresholds and JND with their sources, and how far a stimulus is above.

The rule of two channels: skin feels the attraction, not the drive. A sine of amplitude V at f
attracts with ``V^2 / 4`` at ``2 f`` (in units of ``eps0 I``). Each component of the attraction is
expressed as the sine drive that would cause it alone, and compared with the detection threshold of
that drive. Energies add within a channel, and not between channels. The channel furthest above its
detection threshold mediates detection. Two stimuli have equal intensity when their sensation levels
there are equal (Vardar, Guclu, Basdogan, IEEE Trans. Haptics 10, 488 (2017)). For the independence
of the channels see Bolanowski et al., J. Acoust. Soc. Am. 84, 1680 (1988).

The same thresholds give the weights of an error of friction by frequency. Friction changes with the
attraction, so that a change of friction has the weight ``(V_least / V(f))^2``: 1 at the frequency
of the least detection threshold, and less at others. Outside the thresholds' data the weight is not
known; errors there are reported separately, without a weight.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache, lru_cache
from itertools import pairwise
from math import inf, log10
from pathlib import Path
from typing import Annotated, Any, Literal, Self

import numpy as np
import numpy.typing as npt
from pydantic import Field, PositiveFloat, model_validator

from haptix.base import checks
from haptix.base.checks import Array, positive
from haptix.base.documents import Document, Part
from haptix.base.errors import InputError

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

    @property
    def summation_time_s(self) -> float:
        """Time constant [s]; without summation, one period of the lowest frequency."""
        return self.summation_s or 1 / self.felt_hz[0]

    def threshold(self, felt_hz: float) -> float:
        """Threshold [dB re 1 V] at a felt frequency; infinite outside the channel's data.

        Examples
        --------
        >>> best = Perception.default().channel_at(250.0)
        >>> best.threshold(250.0) < best.threshold(20.0)  # it has no data there
        True
        """
        return float(self.thresholds(np.array([felt_hz]))[0])

    def thresholds(self, felt_hz: Array) -> Array:
        """Thresholds [dB re 1 V] at felt frequencies [Hz]; infinite outside the channel's data."""
        at = np.log(np.maximum(felt_hz, 1e-9))
        nodes = np.log(self.felt_hz)
        threshold_db = np.interp(at, nodes, self.threshold_db)
        # Compare the frequencies themselves, since their logarithms are rounded.
        inside = (felt_hz >= self.felt_hz[0]) & (felt_hz <= self.felt_hz[-1])
        return np.where(inside, threshold_db, inf)


class Audibility(Part):
    """When a drive may be heard: frequencies [Hz] and the least current [A rms] that counts.

    Parameters
    ----------
    low_hz, high_hz : float
        Frequencies [Hz] between which a drive may be heard.
    current_a : float
        Least current [A rms] that counts.
    source : str
        Where the numbers come from.
    """

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

    Examples
    --------
    >>> Perception.default().difference_mu(0.5) > 0
    True
    """

    difference: Difference
    alternatives: tuple[Difference, ...] = ()
    amplitude: AmplitudeStep
    audibility: Audibility
    channels: Annotated[tuple[Channel, ...], Field(min_length=1)]

    @classmethod
    @cache
    def default(cls) -> Self:
        """Return the data in force: the package's default, or the data that `CHOICE` names.

        Raises `HaptixError` if it names no alternative and no file.
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

        Examples
        --------
        >>> Perception.default().jnd().of(0.5) == Perception.default().difference_mu(0.5)
        True
        """
        known = {jnd.name: jnd for jnd in (*self.alternatives, self.difference)}
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

        Examples
        --------
        >>> Perception.default().channel_at(250.0).name
        'pacinian'
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
        """Just-noticeable difference of friction at a friction coefficient.

        Examples
        --------
        >>> perception = Perception.default()
        >>> perception.difference_mu(0.4) == 2 * perception.difference_mu(0.2)
        True
        """
        return self.weber_fraction * mu


WEBER_FRACTION: float = Perception.default().weber_fraction
"""Just-noticeable difference of friction over the friction, by `Perception.default`."""


@dataclass(frozen=True)
class Component:
    """One component of the attraction: its frequency, and the sine drive [V] that makes it.

    Parameters
    ----------
    felt_hz : float
        Frequency of the attraction [Hz].
    drive_v : float
        Amplitude [V] of the sine drive that makes it.
    """

    felt_hz: float
    drive_v: float


@dataclass(frozen=True, eq=False)
class Components:
    """Components of an attraction, as arrays of shape (components,).

    Parameters
    ----------
    felt_hz : array, shape (components,)
        Frequencies of the attraction [Hz].
    drive_v : array, shape (components,)
        Amplitudes [V] of the sine drives that make them.
    """

    felt_hz: Array
    drive_v: Array

    def __len__(self) -> int:
        return len(self.felt_hz)

    def __iter__(self) -> Iterator[Component]:
        return map(Component, self.felt_hz.tolist(), self.drive_v.tolist())


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
) -> Components:
    """Components of the attraction of a periodic drive, given whole periods of it.

    Parameters
    ----------
    drive_v : array_like, shape (samples,)
        Voltage; the dispersion of the insulators is left out.
    sample_rate_hz : float
        Samples per second.
    least_v : float
        Components of smaller drives are left out.

    Examples
    --------
    >>> t_s = np.arange(48_000) / 48_000
    >>> found = components_of_pull(100 * np.sin(2 * np.pi * 125 * t_s), sample_rate_hz=48_000)
    >>> round(float(found.felt_hz[found.drive_v.argmax()]))  # felt at twice the frequency
    250
    """
    drive = np.asarray(drive_v, dtype=float)
    checks.positive("sample_rate_hz", sample_rate_hz)
    if drive.ndim != 1 or len(drive) < 2:
        raise InputError(f"drive_v: expected 2 samples or more in a row, got shape {drive.shape}")
    # v^2 / 2 is the attraction whose component at 2 f is V^2 / 4 for a sine of amplitude V.
    attraction = np.abs(np.fft.rfft(drive**2 / 2)) * 2 / len(drive)
    frequency: Array = np.fft.rfftfreq(len(drive), 1 / sample_rate_hz).astype(np.float64)
    sine_v: Array = np.sqrt(4 * attraction).astype(np.float64)
    is_large = (sine_v >= least_v) & (frequency > 0)
    return Components(frequency[is_large], sine_v[is_large])


def detection(
    components: Components | Sequence[Component], perception: Perception | None = None
) -> Detection:
    """Apply the rule to the components of an attraction.

    Parameters
    ----------
    components : Components or sequence of Component
        Parts of the attraction.
    perception : Perception, optional
        The thresholds; the package's own if not given.

    Raises
    ------
    InputError
        If no component lies where a channel has data.

    Examples
    --------
    >>> weak, strong = (detection([Component(250.0, volts)]) for volts in (50.0, 100.0))
    >>> strong.sensation_db > weak.sensation_db
    True
    """
    known = Perception.default() if perception is None else perception
    parts = components
    if not isinstance(parts, Components):
        parts = Components(
            np.array([part.felt_hz for part in parts]), np.array([part.drive_v for part in parts])
        )
    # The energy of an attraction is proportional to the fourth power of the drive.
    energies = [
        float(np.sum((parts.drive_v / 10 ** (channel.thresholds(parts.felt_hz) / 20)) ** 4))
        for channel in known.channels
    ]
    energy, channel = max(zip(energies, known.channels, strict=True), key=lambda pair: pair[0])
    if energy == 0:
        raise InputError(
            "no component of the attraction lies within the thresholds' data; "
            "load thresholds that cover it"
        )
    return Detection(channel.name, 5 * log10(energy), channel.is_placeholder)


_SEGMENT_S = 0.1  # resolves 20 Hz in a Hann window


@dataclass(frozen=True)
class WeightedError:
    """Root mean square of an error in JND, by felt frequency; NaN where no segment was whole.

    Attributes
    ----------
    rms_jnd : float
        Of what lies within the thresholds' data, weighted: as of a change at the frequency of the
        least detection threshold.
    below_rms_jnd, above_rms_jnd : float
        Of what lies below and above the data, unweighted: no weight is known there. The mean of
        the error is below.
    low_hz, high_hz : float
        Ends of the data.
    share : float
        Samples in segments of 0.1 s that could be evaluated, over all that could.
    is_placeholder : bool
        Whether a detection threshold was not measured.
    """

    rms_jnd: float
    below_rms_jnd: float
    above_rms_jnd: float
    low_hz: float
    high_hz: float
    share: float
    is_placeholder: bool


def weighted_error(
    error_jnd: npt.ArrayLike,
    usable: npt.ArrayLike,
    sample_rate_hz: float,
    perception: Perception | None = None,
) -> WeightedError:
    """Return the error of friction by frequency.

    Power spectra of half-overlapping segments in Hann windows are averaged, of stretches in which
    every sample is usable (Welch, IEEE Trans. Audio Electroacoust. 15, 70 (1967)).

    Parameters
    ----------
    error_jnd : array_like, shape (samples,)
        Felt friction minus target, over the JND there.
    usable : array_like of bool, shape (samples,)
        Where the error is known.
    sample_rate_hz : float
        Samples per second.
    perception : Perception, optional
        Detection thresholds; default: those in force.
    """
    known = Perception.default() if perception is None else perception
    positive("sample_rate_hz", sample_rate_hz)
    where = np.asarray(usable, dtype=bool)
    error = np.where(where, np.asarray(error_jnd, dtype=float), 0.0)
    size = max(2, round(_SEGMENT_S * sample_rate_hz))
    starts = np.arange(0, max(error.size - size + 1, 0), max(1, size // 2))
    counted = np.concatenate([[0], np.cumsum(where)])
    starts = starts[counted[starts + size] - counted[starts] == size]
    low = min(channel.felt_hz[0] for channel in known.channels)
    high = max(channel.felt_hz[-1] for channel in known.channels)
    guessed = any(channel.is_placeholder for channel in known.channels)
    if not starts.size:
        return WeightedError(np.nan, np.nan, np.nan, low, high, 0.0, guessed)
    taper, felt, weight = _window(size, sample_rate_hz, known)
    power = np.zeros(felt.size)
    for start in starts:
        spectrum = np.fft.rfft(error[start : start + size] * taper)
        power += spectrum.real**2 + spectrum.imag**2
    # Double the lines that stand for a positive and a negative frequency.
    power[1 : (size + 1) // 2] *= 2
    power /= starts.size * size * float(np.sum(taper**2))
    inside = weight > 0
    bands = power[inside] * weight[inside] ** 2, power[felt < low], power[felt > high]
    covered = np.zeros(error.size + 1, np.int64)
    np.add.at(covered, starts, 1)
    np.add.at(covered, starts + size, -1)
    share = np.count_nonzero(np.cumsum(covered)[:-1]) / np.count_nonzero(where)
    rms = [float(np.sqrt(np.sum(band))) for band in bands]
    return WeightedError(rms[0], rms[1], rms[2], low, high, float(share), guessed)


@lru_cache(maxsize=4)
def _window(size: int, rate_hz: float, known: Perception) -> tuple[Array, Array, Array]:
    """Hann window, the frequencies of its spectrum, and the weight of a change at each."""
    felt: Array = np.fft.rfftfreq(size, 1 / rate_hz).astype(np.float64)
    thresholds_db = np.min([channel.thresholds(felt) for channel in known.channels], axis=0)
    least_db = min(min(channel.threshold_db) for channel in known.channels)
    # 10^(-dB / 20) is the ratio of drives; its square is the ratio of attractions.
    return np.hanning(size + 2)[1:-1], felt, 10 ** ((least_db - thresholds_db) / 10)
