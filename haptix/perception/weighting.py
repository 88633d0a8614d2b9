"""An error of friction by frequency: weighed as the skin detects it, where thresholds are known.

At its detection threshold a sine drive of amplitude V changes the attraction by ``V^2 / 4`` at the
felt frequency, and friction changes with the attraction. So a change of friction counts by
``(V_least / V(f))^2``: 1 at the frequency of the least detection threshold, less at others. Beyond
the thresholds' data no weight is known: what lies there is told beside it, unweighted.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from haptix.checks import Array, positive
from haptix.perception.thresholds import Perception

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
    low = min(one.felt_hz[0] for one in known.channels)
    high = max(one.felt_hz[-1] for one in known.channels)
    guessed = any(one.is_placeholder for one in known.channels)
    if not starts.size:
        return WeightedError(np.nan, np.nan, np.nan, low, high, 0.0, guessed)
    taper, felt, weight = _window(size, sample_rate_hz, known)
    power = np.zeros(felt.size)
    for start in starts:
        spectrum = np.fft.rfft(error[start : start + size] * taper)
        power += spectrum.real**2 + spectrum.imag**2
    # One side of the spectrum stands for both.
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
    thresholds_db = np.min([one.thresholds(felt) for one in known.channels], axis=0)
    least_db = min(min(one.threshold_db) for one in known.channels)
    # 10^(-dB / 20) is the ratio of drives, whose square is that of attractions.
    return np.hanning(size + 2)[1:-1], felt, 10 ** ((least_db - thresholds_db) / 10)
