"""The finger's first-order response: memory of a slid distance.

Friction follows electrovibration like a first-order system whose cut-off frequency is proportional
to the sliding speed (`Finger.response_hz_per_mm_per_s`). That is a fixed length: at 13.8 Hz per
mm/s, 1/e of an old state is left after 1/(2 pi 13.8) mm = 11.5 um of sliding, at any speed. In slid
distance the equation has constant coefficients, and a step of it is exact.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

_BLOCK = 128  # steps of the recurrence that are made for all blocks at once


def response_depth(distance_mm: Array, cutoff_hz_per_mm_per_s: float) -> Array:
    """``Int 2 pi f_c dt``: how often an old state has fallen to 1/e after these slid distances."""
    return 2 * np.pi * cutoff_hz_per_mm_per_s * distance_mm


def first_order(drive: Array, depth: Array, before: Array) -> Array:
    """Solve ``dy/d(depth) = drive - y`` exactly for a drive that is linear between samples.

    Parameters
    ----------
    drive : ndarray, shape (rows, samples)
        What is followed.
    depth : ndarray, shape (samples,)
        Rising without end; it may stand still (`response_depth`).
    before : ndarray, shape (rows,)
        y at the first sample.

    Returns
    -------
    ndarray, shape (rows, samples)
    """
    step = np.diff(depth)
    decay = np.exp(-step)
    # (1 - exp(-d))/d, by expm1 without cancellation; 1 - d/2 where the finger hardly moves.
    moving = np.where(step > 1e-9, step, 1.0)
    share = np.where(step > 1e-9, -np.expm1(-step) / moving, 1 - step / 2)
    gain = (share - decay) * drive[:, :-1] + (1 - share) * drive[:, 1:]
    return np.concatenate([before[:, None], _recurrence(decay, gain, before)], axis=1)


def _recurrence(decay: Array, gain: Array, before: Array) -> Array:
    """``y_k = decay_k y_(k-1) + gain_k`` from y_(-1) = `before`, shape of `gain`.

    All blocks are run at once as if each began at 0. What a block then lacks is its predecessor's
    end times the decay so far; the ends obey a recurrence of their own, a block's length shorter.
    """
    rows, count = gain.shape
    blocks = -(-count // _BLOCK)
    spare = blocks * _BLOCK - count
    # Steps first, so that each of them works on contiguous memory.
    factor = np.pad(decay, (0, spare), constant_values=1.0).reshape(blocks, _BLOCK).T.copy()
    y = np.pad(gain, ((0, 0), (0, spare))).reshape(rows, blocks, _BLOCK).transpose(2, 0, 1).copy()
    for k in range(1, _BLOCK):
        y[k] += factor[k] * y[k - 1]
        factor[k] *= factor[k - 1]
    if blocks == 1:
        carried = before[:, None]
    else:
        ends = _recurrence(factor[-1, :-1], y[-1, :, :-1], before)
        carried = np.concatenate([before[:, None], ends], axis=1)
    y += factor[:, None, :] * carried
    return y.transpose(1, 2, 0).reshape(rows, -1)[:, :count]
