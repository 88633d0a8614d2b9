"""The rule of two channels: which component of a pull is felt, and how strongly.

Skin feels the pull of the drive, not the drive: a sine of amplitude V at f pulls with ``V^2 / 4``
at ``2 f`` (in units of ``eps0 I``). Every component of a pull is therefore measured by the sine
drive that would make it alone, and set against the threshold of that drive. Within a channel
components add in energy; between channels they do not: the channel that is furthest above its
threshold mediates detection, and two stimuli are matched in perceived intensity when their
sensation levels there are equal (Vardar, Guclu, Basdogan, IEEE Trans. Haptics 10, 488 (2017);
Bolanowski et al., J. Acoust. Soc. Am. 84, 1680 (1988), for the independence of the channels).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import log10

import numpy as np
import numpy.typing as npt

from haptix.errors import InputError, check_positive
from haptix.perception.data import Perception


@dataclass(frozen=True)
class Component:
    """One component of a pull: its frequency, and the amplitude [V] of the sine drive alike."""

    felt_hz: float
    drive_v: float


@dataclass(frozen=True)
class Detection:
    """What is felt of a pull."""

    channel: str
    """Name of the channel that mediates."""
    sensation_db: float
    """Level above threshold of that channel [dB]; felt where above 0."""
    is_placeholder: bool
    """Whether that channel's thresholds stand in for measurements."""


def components_of_pull(
    drive_v: npt.ArrayLike, sample_rate_hz: float, least_v: float = 0.1
) -> list[Component]:
    """Components of the pull of a drive that repeats, such as whole periods of it.

    Parameters
    ----------
    drive_v : array_like, shape (samples,)
        Voltage; the insulators' dispersion is left out.
    sample_rate_hz : float
        Samples per second.
    least_v : float
        Components that smaller drives make are left out.
    """
    drive = np.asarray(drive_v, dtype=float)
    check_positive("sample_rate_hz", sample_rate_hz)
    if drive.ndim != 1 or len(drive) < 2:
        raise InputError(f"drive_v: expected 2 samples or more in a row, got shape {drive.shape}")
    # v^2 / 2 is the pull whose component at 2 f is V^2 / 4 for a sine of amplitude V.
    pull = np.abs(np.fft.rfft(drive**2 / 2)) * 2 / len(drive)
    frequency = np.fft.rfftfreq(len(drive), 1 / sample_rate_hz)
    alike = np.sqrt(4 * pull)
    kept = (alike >= least_v) & (frequency > 0)
    return [
        Component(float(f), float(v)) for f, v in zip(frequency[kept], alike[kept], strict=True)
    ]


def detection(components: Sequence[Component], perception: Perception | None = None) -> Detection:
    """Apply the rule to the components of a pull.

    Raises
    ------
    InputError
        If no component lies where a channel has data.
    """
    known = Perception.default() if perception is None else perception
    best: Detection | None = None
    for channel in known.channels:
        # Energy of a pull goes with the fourth power of the drive.
        energy = sum(
            (component.drive_v / 10 ** (threshold / 20)) ** 4
            for component in components
            if component.drive_v > 0
            and (threshold := channel.threshold(component.felt_hz)) < float("inf")
        )
        if energy <= 0:
            continue
        found = Detection(channel.name, 5 * log10(energy), channel.is_placeholder)
        if best is None or found.sensation_db > best.sensation_db:
            best = found
    if best is None:
        raise InputError(
            "no component of the pull lies where a threshold is known; "
            "load thresholds that cover it"
        )
    return best
