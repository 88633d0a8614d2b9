"""The rule of two channels: how far an attraction is above its detection threshold.

Skin feels the attraction, not the drive. A sine of amplitude V at f attracts with ``V^2 / 4`` at
``2 f`` (in units of ``eps0 I``). Each component of the attraction is measured by the sine drive
that alone would cause it, and compared with the detection threshold of that drive. Energies add
within a channel, and not between channels. The channel furthest above its detection threshold
mediates detection. Two stimuli have equal intensity when their sensation levels there are equal
(Vardar, Guclu, Basdogan, IEEE Trans. Haptics 10, 488 (2017)). For the independence of the channels
see Bolanowski et al., J. Acoust. Soc. Am. 84, 1680 (1988).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import log10

import numpy as np
import numpy.typing as npt

from haptix import checks
from haptix.checks import Array
from haptix.errors import InputError
from haptix.perception.thresholds import Perception


@dataclass(frozen=True)
class Component:
    """One component of the attraction: its frequency, and the sine drive [V] that makes it."""

    felt_hz: float
    drive_v: float


@dataclass(frozen=True, eq=False)
class Components:
    """Components of an attraction, as arrays of shape (components,)."""

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
    """
    drive = np.asarray(drive_v, dtype=float)
    checks.positive("sample_rate_hz", sample_rate_hz)
    if drive.ndim != 1 or len(drive) < 2:
        raise InputError(f"drive_v: expected 2 samples or more in a row, got shape {drive.shape}")
    # v^2 / 2 is the attraction whose component at 2 f is V^2 / 4 for a sine of amplitude V.
    attraction = np.abs(np.fft.rfft(drive**2 / 2)) * 2 / len(drive)
    frequency: Array = np.fft.rfftfreq(len(drive), 1 / sample_rate_hz).astype(np.float64)
    alike: Array = np.sqrt(4 * attraction).astype(np.float64)
    kept = (alike >= least_v) & (frequency > 0)
    return Components(frequency[kept], alike[kept])


def detection(
    components: Components | Sequence[Component], perception: Perception | None = None
) -> Detection:
    """Apply the rule to the components of an attraction.

    Raises
    ------
    InputError
        If no component lies where a channel has data.
    """
    known = Perception.default() if perception is None else perception
    found = components
    if not isinstance(found, Components):
        found = Components(
            np.array([one.felt_hz for one in found]), np.array([one.drive_v for one in found])
        )
    # The energy of an attraction is proportional to the fourth power of the drive.
    energies = [
        float(np.sum((found.drive_v / 10 ** (channel.thresholds(found.felt_hz) / 20)) ** 4))
        for channel in known.channels
    ]
    energy, channel = max(zip(energies, known.channels, strict=True), key=lambda pair: pair[0])
    if energy == 0:
        raise InputError(
            "no component of the attraction lies within the thresholds' data; "
            "load thresholds that cover it"
        )
    return Detection(channel.name, 5 * log10(energy), channel.is_placeholder)
