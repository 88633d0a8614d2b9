"""What can be said of a drive's sound without the panel's emission, which is not known here.

Ranges, shares and levels of a stimulus against itself; no sound level. Two stimuli on one panel may
be compared by them as far as its emission is alike at their frequencies.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from math import log10, sqrt
from typing import Any

import numpy as np

from haptix.checks import Array
from haptix.perception import Audibility
from haptix.stimuli.rendering import Block

#: A ripple of the attraction below this share of its mean is not counted as an envelope.
_LEAST_RIPPLE = 0.01
#: Poles of A-weighting [Hz] and its gain at 1 kHz [dB] (IEC 61672-1, annex E).
_A_POLES = (20.598997, 107.65265, 737.86223, 12194.217)
_A_GAIN_DB = 1.9997


def a_weighting_db(frequency_hz: Array) -> Array:
    """A-weighting [dB] at frequencies above 0: how loud a tone is beside one of 1 kHz."""
    square = np.square(frequency_hz)
    one, two, three, four = (pole**2 for pole in _A_POLES)
    top = four * square**2
    bottom = (square + one) * np.sqrt((square + two) * (square + three)) * (square + four)
    return np.asarray(20 * np.log10(top / bottom) + _A_GAIN_DB)


@dataclass(frozen=True, eq=False)
class _Lines:
    """Of spectra of a length: the Hann window without its zeros, and the lines that are heard."""

    taper: Array
    total: float
    first: int
    end: int
    frequency_hz: Array
    a_power: Array


@lru_cache(maxsize=4)
def _lines(size: int, rate_hz: float, low_hz: float, high_hz: float) -> _Lines:
    taper = np.hanning(size + 2)[1:-1]
    frequency: Array = np.fft.rfftfreq(size, 1 / rate_hz).astype(np.float64)
    first, end = np.searchsorted(frequency, low_hz), np.searchsorted(frequency, high_hz, "right")
    heard = frequency[first:end]
    a_power = 10 ** (a_weighting_db(heard) / 10)
    return _Lines(taper, float(taper.sum()), int(first), int(end), heard, a_power)


def _power(values: Array, lines: _Lines) -> Array:
    spectrum = np.fft.rfft(values * lines.taper)
    return np.asarray(spectrum.real**2 + spectrum.imag**2)


def _shares(power: Array, lines: _Lines) -> tuple[float, float | None]:
    """Share of a power in the audible range, and its A-weighted level [dB] below the whole."""
    whole = float(power.sum())
    if not whole:
        return 0.0, None
    part = power[lines.first : lines.end]
    weighted = float(part @ lines.a_power) / whole
    return float(part.sum()) / whole, 10 * log10(weighted) if weighted else None


def heard(
    middle: Block,
    rate_hz: float,
    capacitance_f: float,
    known: Audibility,
    changes: Array | None = None,
) -> dict[str, Any]:
    """Flag a carrier or an envelope in the audible range, at the current that the finger draws.

    The strongest component of the drive and that of its envelope are checked. The current of a
    component of amplitude V at f is ``2 pi f C V / sqrt(2)``. An envelope is checked at the current
    of the whole drive.

    Parameters
    ----------
    middle : Block
        The samples to look at.
    rate_hz : float
        Samples per second.
    capacitance_f : float
        Of the finger's contact.
    known : Audibility
        Range and current.
    changes : ndarray, optional
        Power spectrum of the changes of ``instant_v**2 / 4`` in a Hann window, where it is known.
    """
    drive = middle.drive_v
    lines = _lines(len(drive), rate_hz, known.low_hz, known.high_hz)
    square = np.square(middle.instant_v)
    mean = float(square.mean())
    attraction = _power(square - mean, lines) if changes is None else 16 * changes
    of_drive = _power(drive, lines)
    # f V is largest where its square is.
    strength = of_drive[lines.first : lines.end] * lines.frequency_hz**2
    moving = attraction[lines.first : lines.end]
    carrier_hz, current_a, envelope_hz = 0.0, 0.0, None
    if strength.size:
        strongest = int(strength.argmax())
        carrier_hz = float(lines.frequency_hz[strongest])
        largest = 2 * sqrt(float(strength[strongest])) / lines.total
        current_a = 2 * np.pi * capacitance_f * largest / sqrt(2)
        rippling = int(moving.argmax())
        if 2 * sqrt(float(moving[rippling])) / lines.total > _LEAST_RIPPLE * mean:
            envelope_hz = float(lines.frequency_hz[rippling])
    total_a = capacitance_f * rate_hz * _rms_slope(drive)
    drive_flag = known(carrier_hz, current_a)
    envelope_flag = envelope_hz is not None and known(envelope_hz, total_a)
    drive_share, drive_db = _shares(of_drive, lines)
    envelope_share, envelope_db = _shares(attraction, lines)
    return {
        "audible": drive_flag or envelope_flag,
        "drive_is_audible": drive_flag,
        "envelope_is_audible": envelope_flag,
        "drive_hz": carrier_hz,
        "drive_current_a_rms": current_a,
        "envelope_hz": envelope_hz,
        "current_a_rms": total_a,
        "drive_share_in_range": drive_share,
        "drive_a_weighted_db": drive_db,
        "envelope_share_in_range": envelope_share,
        "envelope_a_weighted_db": envelope_db,
        "emission": "not known: no sound level is given; measure the panel's at the ear",
        "advice": _advice(
            carrier_hz if drive_flag else None, envelope_hz if envelope_flag else None
        ),
        "rule": (
            f"flagged where the drive's or the envelope's strongest component lies within "
            f"{known.low_hz:g} to {known.high_hz:g} Hz at a current of {known.current_a:g} A rms "
            f"or more, through at most {capacitance_f:.3g} F ({known.source}); shares are of the "
            "energy of the drive and of the attraction's changes, levels their A-weighted energy "
            "(IEC 61672-1) over the whole"
        ),
    }


def _rms_slope(drive: Array) -> float:
    """Rms of the central differences, one-sided at the ends."""
    if len(drive) < 2:
        return 0.0
    inner = drive[2:] - drive[:-2]
    ends = (drive[1] - drive[0]) ** 2 + (drive[-1] - drive[-2]) ** 2
    return sqrt((float(np.sum(inner * inner)) / 4 + float(ends)) / len(drive))


def _advice(drive_hz: float | None, envelope_hz: float | None) -> str:
    """What to do about a drive and an envelope that are flagged."""
    if drive_hz is None and envelope_hz is None:
        return "not flagged, and yet a panel may be heard: listen before the session"
    said = []
    if drive_hz is not None:
        said.append(
            f"the drive may be heard at {drive_hz:.0f} Hz, and its attraction at {2 * drive_hz:.0f}"
        )
    if envelope_hz is not None:
        said.append(
            f"the envelope may be heard at {envelope_hz:.0f} Hz, so that stimuli may be told apart "
            "by ear"
        )
    ceiling = max(filter(None, (2 * drive_hz if drive_hz else None, envelope_hz)))
    return (
        f"{'; '.join(said)}: mask it by noise up to {ceiling:.0f} Hz over closed headphones, and "
        "ask a listener without touch to tell the stimuli apart"
    )
