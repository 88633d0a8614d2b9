"""The window of the oracle: energy and mean of the output over the last second."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from firmware_io.protocol import FULL_SCALE_CODE, FaultCode

_Integers = npt.NDArray[np.int64]

MAX_RMS_MV = 142_835
MEAN_DIVISOR = 20
WINDOW_BLOCKS = 128
ENERGY_SHIFT = 12


class Window:
    """Bounds the energy and the mean of the output, and of a safety ramp behind it.

    The energy counts `WINDOW_BLOCKS` blocks of output samples, together a second, and the block
    under way. The mean counts every stretch of the output that ends now and lies in them.

    Parameters
    ----------
    output_rate_hz : int
        Output samples per second.
    full_scale_mv : int
        The voltage of code 32767.
    top_code : int
        Highest code under the ceiling.
    ramp_ticks : int
        Length of the safety ramp.
    """

    def __init__(
        self, output_rate_hz: int, full_scale_mv: int, top_code: int, ramp_ticks: int
    ) -> None:
        rms = min(MAX_RMS_MV * FULL_SCALE_CODE * 256 // full_scale_mv, FULL_SCALE_CODE * 256)
        self._block_ticks = -(-output_rate_hz // WINDOW_BLOCKS)
        self._max_energy = (rms * rms >> 16) * (output_rate_hz + 2 * self._block_ticks)
        self._max_sum = top_code * output_rate_hz // MEAN_DIVISOR
        self._ramp_ticks = ramp_ticks
        #: Whole blocks, newest last: sum, highest and lowest sum up to the end, energy.
        self._blocks: list[tuple[int, int, int, int]] = []
        self._high_before = self._low_before = self._energy_before = 0
        self._codes = np.empty(0, np.int64)  # of the block under way

    def admit(
        self, codes: _Integers, levels: _Integers, phase_step: int | None
    ) -> tuple[int, FaultCode]:
        """Return how many of these output samples keep to the limits, and the fault of the next.

        Parameters
        ----------
        codes, levels : ndarray of int64, shape (n,)
            Output samples to come, and the level from which a ramp would begin at each.
        phase_step : int, optional
            Of the carrier; None in waveform mode.
        """
        count = min(codes.size, self._block_ticks - self._codes.size)
        codes, levels = codes[:count], levels[:count]
        block = np.concatenate([self._codes, codes])
        sums = np.cumsum(block)
        begins = np.concatenate([[0], sums])
        high = np.maximum(sums - np.minimum.accumulate(begins)[1:], sums + self._high_before)
        low = np.minimum(sums - np.maximum.accumulate(begins)[1:], sums + self._low_before)
        energy = self._energy_before * 2**ENERGY_SHIFT + np.cumsum(block * block)
        high, low, energy = high[-count:], low[-count:], energy[-count:]

        sizes = np.abs(levels)
        if phase_step is None:
            ramp = sizes * (self._ramp_ticks - 1) // 2
            high, low = high + ramp * (levels > 0), low - ramp * (levels <= 0)
        else:
            half_turn = sizes * (2**31 // phase_step + 2)
            high, low = high + half_turn, low - half_turn
        too_strong = energy + sizes * sizes * (self._ramp_ticks // 3 + 1) > self._max_energy
        too_high = (high > self._max_sum) | (-low > self._max_sum)
        broken = too_strong | too_high
        if not broken.any():
            return count, FaultCode.NONE
        first = int(broken.argmax())
        return first, FaultCode.ENERGY if too_strong[first] else FaultCode.MEAN

    def take(self, codes: _Integers) -> None:
        """Count output samples."""
        while codes.size:
            count = self._block_ticks - self._codes.size
            self._codes = np.concatenate([self._codes, codes[:count]])
            codes = codes[count:]
            if self._codes.size == self._block_ticks:
                self._close_block()

    def _close_block(self) -> None:
        behind = np.cumsum(self._codes[::-1])
        energy = int((self._codes * self._codes).sum())
        self._blocks.append(
            (
                int(behind[-1]),
                max(0, int(behind.max())),
                min(0, int(behind.min())),
                -(-energy // 2**ENERGY_SHIFT),
            )
        )
        del self._blocks[:-WINDOW_BLOCKS]
        self._codes = np.empty(0, np.int64)
        sums, highs, lows, energies = np.array(self._blocks, np.int64)[::-1].T
        later = np.cumsum(sums) - sums
        self._high_before = max(0, int((later + highs).max()))
        self._low_before = min(0, int((later + lows).min()))
        self._energy_before = int(energies.sum())
