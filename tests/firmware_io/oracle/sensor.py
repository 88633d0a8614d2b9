"""The current as the oracle measures it: half periods, readings, and what they say of the load."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
import numpy.typing as npt

from firmware_io.firmware.core import Sensor
from firmware_io.protocol import (
    FULL_SCALE_CODE,
    CapabilitiesReport,
    FaultCode,
    SenseReading,
    SensorProblem,
    Setup,
)
from tests.firmware_io.oracle.output import sine_of

Codes = npt.NDArray[np.int16]
_Integers = npt.NDArray[np.int64]

MAX_READINGS = 256  # the build for hosts; the page asks for 16
PANEL_READINGS = 16
ONE = 2**16
PEAK_NA, RMS_NA, LEARNED_NA = 700_000, 500_000, 100_000
LEAST_MV = 10_000
LATE_MS, BACK_MS, UNTOUCHED_MS = 5, 500, 50
HIGHEST_CODE = 32_752
MOST_OFFSET = 256
QUARTER = 2**30


class Output(Protocol):
    """The device, as its sensor sees it."""

    is_playing: bool

    def cut(self, code: FaultCode, expected: int, got: int) -> None:
        """End the output in the short ramp."""


@dataclass(frozen=True)
class _Sums:
    """Sums over output samples; the rest is what the panel does not draw."""

    ticks: int = 0
    drive: int = 0
    current: int = 0
    rest: int = 0
    rest_peak: int = 0
    rest_drive: int = 0
    rest_before: int = 0
    raw: int = 0
    is_saturated: bool = False

    def __add__(self, half: _Sums) -> _Sums:
        return replace(
            self,
            **{
                name: getattr(self, name) + getattr(half, name)
                for name in ("ticks", "drive", "rest_drive", "rest_before", "raw")
            },
            is_saturated=self.is_saturated or half.is_saturated,
        )


class OracleSensor:
    """Readings of the current, and faults by it.

    Parameters
    ----------
    config : CapabilitiesReport
        What the device states.
    sensor : Sensor
        Its converter.
    output : Output
        What a fault ends.
    """

    def __init__(self, config: CapabilitiesReport, sensor: Sensor, output: Output) -> None:
        self._output = output
        self._full_scale_mv = config.full_scale_mv
        self._rate_hz = config.output_rate_hz
        self._sense_hz = config.sense_rate_hz
        self._knows_touches = config.reports_touch
        self._full_scale_na = round(sensor.full_scale_a * 1e9)
        self._panel_pf = round(sensor.panel_f * 1e12)
        least = LEAST_MV * FULL_SCALE_CODE // config.full_scale_mv
        self._least = least**2 // 2
        self._top_code = min(
            config.ceiling_mv * FULL_SCALE_CODE // config.full_scale_mv, FULL_SCALE_CODE
        )
        self._first: list[int] = []
        self.readings: list[SenseReading] = []
        self._problem = SensorProblem.NONE
        self._clock = 0
        self._heard = 0
        self._has_begun = False
        self._fingers: set[int] = set()
        self._touched = 0
        self._step = self._sine = self._cosine = self._stated = 0
        self._phase_ratio = self._ahead_ratio = self._known = 0
        self._offset = 0
        self._code = self._same = 0  # the last code, and how many of it in turn
        self._well_ticks = 0
        self._in_turn = dict.fromkeys(("too much", "missing", "lies"), 0)
        self._last = 0
        self._start_over()

    def _ticks(self, ms: int) -> int:
        return -(-self._rate_hz * ms // 1000)

    # What happens to the device

    def begin(self, setup: Setup, clock: int) -> None:
        """Begin with a playback."""
        self._clock = self._heard = clock
        self._has_begun = True
        self._last = 0
        self._start_over()
        self._in_turn = dict.fromkeys(self._in_turn, 0)
        self._step = setup.carrier_mhz * 2**32 // (self._rate_hz * 1000)
        if not 0 < self._step < QUARTER:
            self._doubt(SensorProblem.DIRECT)
            return
        sine = int(sine_of(np.array([self._step]))[0])
        if self._problem is SensorProblem.DIRECT:
            self._doubt(SensorProblem.NONE)
        rad_per_s = -(-setup.carrier_mhz * 411775 // 65536000)
        coulombs = rad_per_s * self._full_scale_mv // 1000 * self._panel_pf // 1000
        stated = min(coulombs * ONE // self._full_scale_na, 2 * ONE)
        if (stated, sine) != (self._stated, self._sine):
            self._known = 0
        self._stated, self._sine = stated, sine
        self._cosine = int(sine_of(np.array([self._step + QUARTER]))[0])
        if not self._known:
            self._phase_ratio, self._ahead_ratio = 0, stated

    def pass_time(self, clock: int) -> None:
        """Note how late it is; a converter that says nothing is not believed."""
        self._clock = clock
        is_due = self._output.is_playing and self._problem is not SensorProblem.DIRECT
        if is_due and clock - self._heard > self._ticks(LATE_MS):
            self._doubt(SensorProblem.LATE)

    def touch(self, contact: int, is_down: bool) -> None:
        """Note a finger."""
        (self._fingers.add if is_down else self._fingers.discard)(contact % 32)
        self._touched = self._clock

    # Samples

    def sense(self, sent: Codes, raw: Codes) -> None:
        """Take the current of the last output samples."""
        first = self._clock - len(sent)
        if not self._has_begun or self._problem is SensorProblem.DIRECT or first < 0:
            return
        if first > self._heard:
            self._start_over()
        skip = max(0, self._heard - first)
        self._heard = self._clock
        sent, raw = sent[skip:].astype(np.int64), raw[skip:].astype(np.int64)
        before = np.concatenate([[self._last], sent])
        turns = np.flatnonzero((before[1:] < 0) != (before[:-1] < 0))
        samples = np.stack([sent, before[:-1], raw])
        clock = first + skip
        for piece in np.split(samples, turns, axis=1):
            if piece.shape[1] and (piece[0, 0] < 0) != (piece[1, 0] < 0):
                self._end_half(clock, is_rising=bool(piece[0, 0] >= 0))
            self._add(piece, clock)
            clock += piece.shape[1]
        self._last = int(before[-1])

    def _start_over(self) -> None:
        self._half = np.empty((3, 0), np.int64)  # drive, the drive before, current
        self._whole = _Sums()
        self._drive_before = self._ahead_before = 0
        self._has_risen = False

    def _add(self, samples: _Integers, clock: int) -> None:
        """Add samples of one sign to the half period, and end readings without a drive."""
        while samples.size:
            of_reading = -(-self._rate_hz // self._sense_hz) - self._whole.ticks
            due = max(of_reading, -(-(2**32) // self._step)) - self._half.shape[1]
            ends = due <= samples.shape[1] and self._output.is_playing
            count = max(due, 1) if ends else samples.shape[1]
            self._half = np.concatenate([self._half, samples[:, :count]], axis=1)
            for code in samples[2, :count].tolist():
                self._same = self._same + 1 if code == self._code else 1
                self._code = code
            samples, clock = samples[:, count:], clock + count
            if ends:
                self._keep(SenseReading(clock, 0, 0, 0, self._problem << 1))
                self._start_over()

    def _end_half(self, clock: int, *, is_rising: bool) -> None:
        half, before = self._sums(), self._drive_before
        if before and half.drive:
            is_steady = half.drive < before + before // 8 and before < half.drive + half.drive // 8
            is_driven = half.drive > self._least * half.ticks
            if is_steady and is_driven and self._output.is_playing:
                self._judge(half)
            if self._has_risen:
                self._whole += half
        self._drive_before, self._half = half.drive, self._half[:, :0]
        self._ahead_before = self._ahead(half)
        if is_rising:
            if self._has_risen and self._whole.ticks >= self._rate_hz // self._sense_hz:
                self._end_reading(clock)
                self._whole = _Sums()
            self._has_risen = True

    def _sums(self) -> _Sums:
        if not self._half.size:
            return _Sums()
        drive, before, raw = self._half
        current = raw - self._offset
        rest = np.clip(current - self._of_panel(drive, before), -32767, 32767)
        return _Sums(
            ticks=drive.size,
            drive=int(drive @ drive),
            current=int(current @ current),
            rest=int(rest @ rest),
            rest_peak=int(np.abs(rest).max()),
            rest_drive=int(rest @ drive),
            rest_before=int(rest @ before),
            raw=int(raw.sum()),
            is_saturated=bool((np.abs(raw) >= HIGHEST_CODE).any()),
        )

    def _of_panel(self, drive: _Integers, before: _Integers) -> _Integers:
        """Return the panel's current in codes."""
        back = _quotient(self._ahead_ratio * FULL_SCALE_CODE, self._sine)
        here = self._phase_ratio + _quotient(back * self._cosine, FULL_SCALE_CODE)
        shift = 16
        while max(abs(back), abs(here)) > FULL_SCALE_CODE:
            back, here, shift = _quotient(back, 2), _quotient(here, 2), shift - 1
        return (here * drive >> shift) + (-back * before >> shift)

    # What sums say

    def _ahead(self, sums: _Sums) -> int:
        """Return the part of a rest that is ahead of the drive, times the drive."""
        return _quotient(
            self._cosine * sums.rest_drive - FULL_SCALE_CODE * sums.rest_before, self._sine
        )

    @staticmethod
    def _ratio(rest: int, drive: int) -> int:
        return _quotient(max(-8 * drive, min(8 * drive, rest)) * ONE, drive)

    def _judge(self, half: _Sums) -> None:
        is_same = self._same >= half.ticks and not half.is_saturated
        if is_same and self._same >= self._rate_hz // 4000:
            self._doubt(SensorProblem.STUCK)
            return
        is_known = self._known == PANEL_READINGS
        ahead = self._ahead(half)
        least = _quotient(self._ahead_ratio, 32) * 3 if is_known else self._stated // 4 * 3
        found = {
            "too much": half.is_saturated or _exceeds(half, 2 * self._stated),
            "missing": not _exceeds(half, self._stated // 2),
        }
        period = self._ratio(ahead + self._ahead_before, half.drive + self._drive_before)
        found["lies"] = period < -least and not found["missing"]
        if self._problem is not SensorProblem.NONE:
            self._well_ticks = 0 if any(found.values()) else self._well_ticks + half.ticks
            if self._well_ticks > self._ticks(BACK_MS):
                self._doubt(SensorProblem.NONE)
            return
        steps = {"too much": 1, "missing": half.ticks, "lies": 1}
        self._in_turn = {
            name: self._in_turn[name] + steps[name] if is_so else 0 for name, is_so in found.items()
        }
        missing = self._in_turn["missing"]
        current = math.isqrt(half.current // half.ticks)
        peak, rms = (na * FULL_SCALE_CODE // self._full_scale_na for na in (PEAK_NA, RMS_NA))
        is_load = -ahead < _quotient(math.isqrt(half.rest) * math.isqrt(half.drive), 5)
        if self._in_turn["too much"] >= 2:
            self._output.cut(FaultCode.OVERLOAD, self._stated, current)
        elif missing > half.ticks and missing >= self._rate_hz // 2000:
            self._output.cut(FaultCode.NO_CURRENT, self._stated, current)
        elif self._in_turn["lies"] >= 3:
            self._doubt(SensorProblem.LIES)
        elif is_known and is_load and not is_same and half.rest_peak > peak:
            self._output.cut(FaultCode.PEAK_CURRENT, peak, half.rest_peak)
        elif is_known and is_load and not is_same and half.rest > rms**2 * half.ticks:
            self._output.cut(FaultCode.RMS_CURRENT, rms, math.isqrt(half.rest // half.ticks))

    def _end_reading(self, clock: int) -> None:
        whole = self._whole
        in_phase = self._phase_ratio + self._ratio(whole.rest_drive, whole.drive)
        ahead = self._ahead_ratio + self._ratio(self._ahead(whole), whole.drive)
        amplitude = min(math.isqrt(2 * whole.drive // whole.ticks), FULL_SCALE_CODE)
        lies = self._in_turn["lies"] or self._in_turn["missing"]
        problem = SensorProblem.LIES if lies else self._problem
        in_phase_na, ahead_na = (
            _quotient(ratio * amplitude * self._full_scale_na, ONE * FULL_SCALE_CODE)
            for ratio in (in_phase, ahead)
        )
        self._keep(
            SenseReading(clock, in_phase_na, ahead_na, amplitude, whole.is_saturated | problem << 1)
        )
        if whole.drive // whole.ticks > self._least:
            self._learn(in_phase, ahead)
        mean = _quotient(whole.raw, whole.ticks)
        self._offset = max(-MOST_OFFSET, min(MOST_OFFSET, mean))

    def _learn(self, in_phase: int, ahead: int) -> None:
        """Take a reading of the untouched panel."""
        if not self._knows_touches or self._problem is not SensorProblem.NONE or self._fingers:
            return
        if self._clock - self._touched < self._ticks(UNTOUCHED_MS):
            return
        third = self._stated // 3
        if abs(ahead - self._stated) > third or abs(in_phase) > (self._stated + third) // 2:
            return
        is_known = self._known == PANEL_READINGS
        if is_known and ahead > self._ahead_ratio + _quotient(self._ahead_ratio, 256):
            return
        self._known = min(self._known + 1, PANEL_READINGS)
        learned = [
            ratio + _quotient(reading - ratio, self._known)
            for ratio, reading in ((self._phase_ratio, in_phase), (self._ahead_ratio, ahead))
        ]
        if is_known:
            reach = LEARNED_NA * FULL_SCALE_CODE // self._full_scale_na * ONE // self._top_code
            learned = [
                max(first - reach, min(first + reach, ratio))
                for ratio, first in zip(learned, self._first, strict=True)
            ]
        else:
            self._first = learned
        self._phase_ratio, self._ahead_ratio = learned

    def _doubt(self, problem: SensorProblem) -> None:
        self._well_ticks = 0
        self._in_turn = dict.fromkeys(self._in_turn, 0)
        if problem is not self._problem:
            self._problem = problem
            if problem is not SensorProblem.NONE:
                self._keep(SenseReading(self._clock, 0, 0, 0, problem << 1))

    def _keep(self, reading: SenseReading) -> None:
        self.readings = [*self.readings, reading][-MAX_READINGS:]


def _exceeds(half: _Sums, ratio: int) -> bool:
    return half.current > half.drive * (ratio**2 >> 12) >> 20


def _quotient(a: int, b: int) -> int:
    """Integer division rounded toward 0, as in C."""
    return -(-a // b) if a < 0 else a // b
