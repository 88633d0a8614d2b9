"""The last second that was driven: energy, mean and current over it."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from firmware_io.drive_sums import SumsOf, bounded_sums, compiled_sums, dot
from firmware_io.errors import LimitError
from firmware_io.limits import RAMP_S, DriveLimits

_Volts = npt.NDArray[np.float64]

#: A mean below this counts as none: a few codes of rounding at 250 V full scale.
_DC_FLOOR_V = 0.05
#: Bounds have this share of room, far more than sums of a second can be wrong by rounding.
_ROUNDING = 1.0 - 1e-9


class DriveWindow:
    """The last second or so that was driven: rejects too much energy, current, and a mean voltage.

    It takes what leaves the driver: samples, or the amplitude times the carrier. The driver checks
    energy and mean against its own clock, which also counts the time that a sample is held.

    Bounds on the sums tell for most blocks that no limit can be reached; only where they do not,
    each sample is looked at.

    Parameters
    ----------
    limits : DriveLimits
        What the window must keep to.
    sample_rate_hz : float
        Samples per second.
    """

    def __init__(self, limits: DriveLimits, sample_rate_hz: float) -> None:
        self.limits = limits
        self._ring = np.zeros(max(1, round(limits.window_s * sample_rate_hz)))
        self._sample_rate_hz = sample_rate_hz
        self._next = 0
        self._last_v = 0.0
        self._sum_v = 0.0
        self._sum_square = 0.0
        # At least what they are in the window: samples that have left it since the last count are
        # still in. The highest and the lowest sum of a stretch that ends with the latest sample;
        # the sum of squared steps; the largest magnitude.
        self._highest_sum = self._lowest_sum = 0.0
        self._sum_steps = 0.0
        self._left_v = 0.0  # the sample that left last
        self._largest_v = 0.0
        self._sums_of: SumsOf = bounded_sums

    def prefer_compiled(self) -> None:
        """Add up in C, if that can be had: for who checks long queues again and again."""
        self._sums_of = compiled_sums() or bounded_sums

    def check(self, volts: _Volts, each: int = 1, is_carried: bool = False) -> None:
        """Reject samples with which the window would hold too much energy or too high a mean.

        A sample of 0 V is never rejected: it is the remedy.

        Parameters
        ----------
        volts : ndarray, shape (n,)
            Voltages at the window's rate.
        each : int
            Of these are made of one sample, for the number in the message.
        is_carried : bool
            Whether a carrier alternates them, so that a ramp to 0 V has no mean of its own.

        Raises
        ------
        LimitError
            The message names the first such sample.
        """
        if volts.size == 0:
            return
        ramp_samples = 0.0 if is_carried else RAMP_S / 2 * self._sample_rate_hz
        leaving = self._leaving(volts)
        if self._is_far_from_limits(volts, leaving, ramp_samples):
            return
        steps = self._steps(volts)
        if self._is_within_limits(volts, leaving, steps, ramp_samples):
            return
        self._check_energy(volts, each, leaving)
        self._check_mean(volts, each, leaving)
        self._check_stretches(volts, each, ramp_samples)
        self._check_current(volts, each, steps)

    def take(self, volts: _Volts) -> None:
        """Take samples into the window, after they were sent."""
        if volts.size == 0:
            return
        size = self._ring.size
        leaving = self._leaving(volts)
        steps = self._steps(volts)
        sums = np.add.accumulate(volts)
        total = float(sums[-1])
        lowest, highest = float(np.minimum.reduce(sums)), float(np.maximum.reduce(sums))
        self._highest_sum = total - min(-self._highest_sum, lowest)
        self._lowest_sum = total - max(-self._lowest_sum, highest)
        self._sum_v += total - float(np.add.reduce(leaving))
        self._sum_square += dot(volts, volts) - dot(leaving, leaving)
        self._sum_steps += dot(steps, steps)
        if volts.size <= size:
            gone = leaving[1:] - leaving[:-1]
            first = float(leaving[0]) - self._left_v
            self._sum_steps -= dot(gone, gone) + first * first
            self._left_v = float(leaving[-1])
        self._largest_v = max(self._largest_v, float(np.maximum.reduce(np.abs(volts))))
        self._last_v = float(volts[-1])
        latest = volts[-size:]
        start = (self._next + volts.size - latest.size) % size
        first = min(latest.size, size - start)
        self._ring[start : start + first] = latest[:first]
        self._ring[: latest.size - first] = latest[first:]
        has_gone_round = self._next + volts.size >= size
        self._next = (self._next + volts.size) % size
        if has_gone_round:
            # So that rounding does not add up over hours.
            self._sum_v = float(self._ring.sum())
            self._sum_square = dot(self._ring, self._ring)
            self._largest_v = float(np.abs(self._ring).max())
            self._count_steps(np.diff(self._in_order()) ** 2)

    def rest(self, samples: int) -> None:
        """Take the time during which the output stood at 0 V, in samples."""
        if samples > 0:
            self.take(np.zeros(min(samples, self._ring.size)))
        self._last_v = 0.0

    def _is_far_from_limits(self, volts: _Volts, leaving: _Volts, ramp_samples: float) -> bool:
        """Whether no sample can break a limit, whatever leaves the window meanwhile."""
        size, limits = self._ring.size, self.limits
        sums = self._sums_of(volts, leaving, self._last_v, self._largest_v)
        peak = sums.peak
        if peak == 0.0:
            return True  # 0 V is the remedy, whatever came before
        room = _ROUNDING * size
        share_v = limits.max_dc_share
        if (
            self._sum_square + sums.squares > room * limits.max_rms_v**2
            or self._sum_steps + sums.steps > _ROUNDING * self._most_steps
        ):
            return False
        moved = max(sums.highest - sums.gone_lowest, sums.gone_highest - sums.lowest)
        stretch = max(
            sums.highest + self._highest_sum,
            -sums.lowest - self._lowest_sum,
            sums.highest - sums.lowest,
        )
        return bool(
            abs(self._sum_v) + moved <= room * max(share_v * peak, _DC_FLOOR_V)
            and stretch + peak * ramp_samples <= room * share_v * limits.ceiling_v
        )

    def _is_within_limits(
        self, volts: _Volts, leaving: _Volts, steps: _Volts, ramp_samples: float
    ) -> bool:
        """Whether no sample breaks a limit, from the sums up to each of them."""
        size, limits = self._ring.size, self.limits
        if volts.size > size:
            return False
        peak = float(np.maximum.reduce(np.abs(volts)))
        room = _ROUNDING * size
        squares = np.add.accumulate(volts * volts - leaving * leaving)
        if self._sum_square + float(squares.max()) > room * limits.max_rms_v**2:
            return False
        sums = self._sum_v + np.add.accumulate(volts - leaving)
        if float(np.abs(sums).max()) > room * max(limits.max_dc_share * peak, _DC_FLOOR_V):
            return False
        highest = float(self._stretches(volts, -self._highest_sum, np.minimum).max())
        lowest = float(self._stretches(volts, -self._lowest_sum, np.maximum).min())
        stretch = max(highest, -lowest) + peak * ramp_samples
        if stretch > room * limits.max_dc_share * limits.ceiling_v:
            return False
        # The step to the first that leaves left the window with the sample before it.
        gone = np.add.accumulate(np.square(leaving[1:] - leaving[:-1]))
        grown = np.add.accumulate(steps * steps)
        grown[1:] -= gone
        return bool(self._sum_steps + float(grown.max()) <= _ROUNDING * self._most_steps)

    @property
    def _most_steps(self) -> float:
        """Largest admissible sum of squared steps."""
        step_v = self.limits.max_rms_slew_v_per_s / self._sample_rate_hz
        return step_v**2 * self._ring.size

    def _check_energy(self, volts: _Volts, each: int, leaving: _Volts) -> None:
        square = (self._sum_square + np.cumsum(volts * volts - leaving * leaving)) / self._ring.size
        over = (square > self.limits.max_rms_v**2) & (volts != 0.0)
        if over.any():
            index = int(over.argmax())
            raise LimitError(
                f"With sample {index // each} the rms over {self.limits.window_s:g} s reaches "
                f"{math.sqrt(square[index]):g} V, above the limit of {self.limits.max_rms_v:g} V; "
                "lower the amplitude, or pause."
            )

    def _check_mean(self, volts: _Volts, each: int, leaving: _Volts) -> None:
        """Reject a mean of the window above its share of the largest magnitude there."""
        mean = (self._sum_v + np.cumsum(volts - leaving)) / self._ring.size
        largest = max(float(np.abs(volts).max()), float(np.abs(self._ring).max()))
        share = self.limits.max_dc_share
        over = (np.abs(mean) > max(share * largest, _DC_FLOOR_V)) & (volts * mean > 0.0)
        if over.any():
            index = int(over.argmax())
            raise LimitError(
                f"With sample {index // each} the mean over {self.limits.window_s:g} s reaches "
                f"{mean[index]:g} V, above {share:.0%} of the largest magnitude there; "
                "drive without a mean voltage: remove the offset, and pause before trying again."
            )

    def _check_stretches(self, volts: _Volts, each: int, ramp_samples: float) -> None:
        """Reject a stretch whose sum stays in a window when what came before has left it."""
        behind = np.cumsum(self._in_order()[::-1])
        self._highest_sum = max(0.0, float(behind.max()))
        self._lowest_sum = min(0.0, float(behind.min()))
        most = self.limits.max_dc_share * self.limits.ceiling_v * self._ring.size
        ramp = ramp_samples * volts
        highest = self._stretches(volts, -self._highest_sum, np.minimum) + ramp
        lowest = self._stretches(volts, -self._lowest_sum, np.maximum) + ramp
        over = ((highest > most) & (volts > 0.0)) | ((lowest < -most) & (volts < 0.0))
        if over.any():
            index = int(over.argmax())
            worst = highest[index] if volts[index] > 0.0 else lowest[index]
            raise LimitError(
                f"With sample {index // each} a mean of {worst / self._ring.size:g} V over "
                f"{self.limits.window_s:g} s builds up, above {self.limits.max_dc_share:.0%} of "
                "the ceiling; drive without a mean voltage: remove the offset, and pause before "
                "trying again."
            )

    def _check_current(self, volts: _Volts, each: int, steps: _Volts) -> None:
        """Reject an rms of the current ``C dV/dt`` above its limit."""
        squares = np.diff(self._in_order()) ** 2  # what came before the oldest sample is unknown
        self._count_steps(squares)
        leaving = np.concatenate([squares, steps**2])[: volts.size]
        square = self._sum_steps + np.cumsum(steps**2 - leaving)
        over = (square > self._most_steps) & (volts != 0.0)
        if over.any():
            index = int(over.argmax())
            limits = self.limits
            slew = math.sqrt(square[index] / self._ring.size) * self._sample_rate_hz
            raise LimitError(
                f"With sample {index // each} the current over {limits.window_s:g} s reaches "
                f"{slew * limits.capacitance_f * 1e3:.3g} mA rms through "
                f"{limits.capacitance_f * 1e12:.4g} pF, above the limit of "
                f"{limits.max_rms_a * 1e3:g} mA; lower the amplitude or the frequency, or pause."
            )

    def _count_steps(self, squares: _Volts) -> None:
        """Take the sum of squared steps from those within the window."""
        self._sum_steps = float(squares.sum())
        self._left_v = float(self._ring[self._next])

    @staticmethod
    def _stretches(volts: _Volts, before: float, extreme: np.ufunc) -> _Volts:
        """Return the extreme sum of the stretches that end with each sample, shape (n,)."""
        sums = np.cumsum(volts)
        begins = extreme.accumulate(np.concatenate([[extreme(before, 0.0)], sums]))
        return np.asarray(sums - begins[1:])

    def _steps(self, volts: _Volts) -> _Volts:
        """Return the change to each sample from the one before it, shape (n,)."""
        steps = np.empty_like(volts)  # np.diff takes three times as long for a short block
        steps[0] = volts[0] - self._last_v
        np.subtract(volts[1:], volts[:-1], out=steps[1:])
        return steps

    def _leaving(self, volts: _Volts) -> _Volts:
        """Return the samples that leave as `volts` come in, shape (n,)."""
        end = self._next + volts.size
        if end <= self._ring.size:
            return self._ring[self._next : end]
        return np.concatenate([self._in_order(), volts])[: volts.size]

    def _in_order(self) -> _Volts:
        """Return the window, the oldest sample first."""
        return np.concatenate([self._ring[self._next :], self._ring[: self._next]])
