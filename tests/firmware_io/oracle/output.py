"""The output of the oracle: queue, line between samples, carrier, ramp; block by block."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from firmware_io.firmware.core import Output
from firmware_io.protocol import FULL_SCALE_CODE, FaultCode, StreamMode
from tests.firmware_io.oracle.sine import sine_table
from tests.firmware_io.oracle.window import Window

Codes = npt.NDArray[np.int16]
Whats = npt.NDArray[np.uint8]
_Integers = npt.NDArray[np.int64]

_SINE = np.array(sine_table(), dtype=np.int64)
_TURN = 2**32


@dataclass(frozen=True)
class Playing:
    """How SETUP says to play a stream."""

    mode: StreamMode
    ticks_per_sample: int
    phase_step: int
    step_codes: int
    ceiling_code: int


class OracleOutput:
    """The present output and the samples after it.

    Parameters
    ----------
    ramp_ticks : int
        Length of the safety ramp.
    hold_ticks : int
        How long a waveform that has run dry is held.
    window : Window
        Energy and mean of what has left it.

    Attributes
    ----------
    broken : FaultCode
        The limit that the next sample would have broken; it was not played.
    began_at : int or None
        Where in the output samples of the last `play` a playback began.
    taken : list of (int, int, int, int)
        Runs of samples that the last `play` has taken from the queue: offset of the first in its
        output samples, index of the first, how many, and output samples of each.
    """

    def __init__(self, ramp_ticks: int, hold_ticks: int, window: Window) -> None:
        self.ramp_ticks = ramp_ticks
        self.broken = FaultCode.NONE
        self.began_at: int | None = None
        self.taken: list[tuple[int, int, int, int]] = []
        self._window = window
        self._hold_ticks = hold_ticks
        self._dry_ticks = 0
        self._gain = ramp_ticks
        self.queue: Codes = np.empty(0, np.int16)
        self.has_begun = False
        self.is_playing = False
        self.lead_ticks = 0
        self.samples_played = 0
        self.underruns = 0
        self.ramp_ticks_left = 0
        self._ramp_step = 1
        self.has_ended_ramp = False
        self._is_dry = False
        self._playing = Playing(StreamMode.WAVEFORM, 1, 0, 0, 0)
        self._next = self._playing
        self._from = self._to = self._level = self._code = 0
        self._tick_of_sample = 0
        self._phase = 0
        self._ramp_from = 0

    @property
    def pending_ticks(self) -> int:
        """Ticks until only zeros or a held sample are left to play."""
        if not self.has_begun:
            return -(-self.ramp_ticks_left // self._ramp_step)
        each = self._next.ticks_per_sample
        rest = each - self._tick_of_sample if self.is_playing else 0
        ramp = -(-self.ramp_ticks_left // self._ramp_step)
        return max(ramp, self.lead_ticks) + rest + self.queue.size * each

    def begin(self, lead_ticks: int, playing: Playing) -> None:
        """Begin to play the queue after a lead."""
        self.has_begun = True
        self.lead_ticks = lead_ticks
        self._next = playing

    def end(self, ramp_step: int = 1) -> None:
        """Begin the safety ramp, or one that is so many times shorter, and discard the queue."""
        self.has_begun = self.is_playing = False
        self.queue = self.queue[:0]
        if self.ramp_ticks_left == 0 and self._level != 0:
            self._ramp_from = self._level
            self.ramp_ticks_left = self.ramp_ticks
            self._ramp_step = ramp_step

    def play(self, ticks: int) -> tuple[Codes, Whats]:
        """Return the next output samples, and the kind of each; fewer before a broken limit."""
        codes = np.zeros(ticks, np.int16)
        what = np.zeros(ticks, np.uint8)
        done = 0
        self.broken = FaultCode.NONE
        self.began_at = None
        self.taken = []
        while done < ticks and self.broken is FaultCode.NONE:
            before = vars(self).copy()
            levels, driven, kind = self._drive(ticks - done)
            if self.is_playing:
                has_carrier = self._playing.mode is StreamMode.ENVELOPE
                step = self._playing.phase_step if has_carrier else None
                count, broken = self._window.admit(driven, levels, step)
                if count < levels.size:
                    # Again, and no further than the block of the window or the limit.
                    vars(self).update(before)
                    if count:
                        levels, driven, kind = self._drive(count)
                    else:
                        levels, driven = levels[:0], driven[:0]
                    self.broken = broken
            self._note_taken(before, done)
            if self.is_playing and not before["is_playing"]:
                self.began_at = done
            after = done + levels.size
            codes[done:after] = driven
            what[done:after] = kind
            self._window.take(driven)
            done = after
        if self.broken is not FaultCode.NONE:
            before = vars(self).copy()
            self._run(1)  # the sample that gives way to the ramp is gone
            if not before["is_playing"]:
                self.began_at = done
            self._level = before["_level"]
            self._note_taken(before, done)
        return codes[:done], what[:done]

    def _note_taken(self, before: dict[str, Any], offset: int) -> None:
        """Note the samples taken since a state, which was that at an offset."""
        index, each = before["samples_played"], self._playing.ticks_per_sample
        count = (self.samples_played - index) % 2**32
        if count:
            tick = before["_tick_of_sample"] if before["is_playing"] else each
            self.taken.append((offset + each - tick, index, count, each))

    def _drive(self, most: int) -> tuple[_Integers, _Integers, Output]:
        """Return levels and codes of up to `most` ticks that are all of one kind; at least one."""
        levels, kind = self._run(most)
        self._level = int(levels[-1])
        driven = self._times_carrier(levels) if kind is not Output.IDLE else levels
        driven = self._limited(driven)
        self._code = int(driven[-1])
        return levels, driven, kind

    def _limited(self, driven: _Integers) -> _Integers:
        """Return codes below the ceiling, none of which is too far from the one before."""
        most, step = self._playing.ceiling_code, self._playing.step_codes
        driven = np.clip(driven, -most, most)
        too_far = np.abs(np.diff(driven, prepend=self._code)) > step
        if not too_far.any():
            return driven
        limited, before = driven.copy(), self._code
        for place, code in enumerate(driven.tolist()):
            before = limited[place] = max(before - step, min(before + step, code))
        return limited

    def _run(self, most: int) -> tuple[_Integers, Output]:
        """Return the levels of up to `most` ticks that are all of one kind; at least one."""
        if self.ramp_ticks_left:
            step = self._ramp_step
            count = min(most, -(-self.ramp_ticks_left // step))
            left = np.maximum(self.ramp_ticks_left - step * np.arange(1, count + 1), 0)
            self.ramp_ticks_left = int(left[-1])
            self.has_ended_ramp |= self.ramp_ticks_left == 0
            if self.has_begun:
                self.lead_ticks = max(self.lead_ticks - count, 0)
            return _quotient(self._ramp_from * left, self.ramp_ticks), Output.RAMP
        if not self.has_begun:
            return np.zeros(most, np.int64), Output.IDLE
        if self.lead_ticks:
            count = min(most, self.lead_ticks)
            self.lead_ticks -= count
            return np.zeros(count, np.int64), Output.IDLE
        return self._run_stream(most)

    def _run_stream(self, most: int) -> tuple[_Integers, Output]:
        if not self.is_playing:
            self.is_playing, self._is_dry = True, False
            self._gain = self.ramp_ticks
            self._playing = self._next
            self._phase = self._to = 0
            self._tick_of_sample = self._playing.ticks_per_sample
        each = self._playing.ticks_per_sample
        count = min(most, each - self._tick_of_sample + self.queue.size * each)
        if count == 0:
            return self._run_dry(most)
        # Line number `line` goes from point `line` to the next; the first one is under way.
        tick = self._tick_of_sample + np.arange(count)
        line, step = tick // each, tick % each + 1
        points = np.concatenate([[self._from, self._to], self.queue]).astype(np.int64)
        levels = points[line] + _quotient((points[line + 1] - points[line]) * step, each)
        levels = self._times_gain(levels)
        taken = int(line[-1])
        self._is_dry &= taken == 0
        self._from, self._to = int(points[taken]), int(points[taken + 1])
        self._tick_of_sample = int(step[-1])
        self.queue = self.queue[taken:]
        self.samples_played = (self.samples_played + taken) % 2**32
        return levels, Output.STREAM

    def _times_gain(self, levels: _Integers) -> _Integers:
        """Let the gain rise with each level, but not where the slew would be too high."""
        before, back = self._code, 0
        levels = levels.copy()
        while self._gain < self.ramp_ticks and back < levels.size:
            higher, level = (
                int(_quotient(levels[back] * gain, self.ramp_ticks))
                for gain in (self._gain + 1, self._gain)
            )
            if abs(higher - before) <= self._playing.step_codes:
                self._gain, level = self._gain + 1, higher
            before = levels[back] = level
            back += 1
        return levels

    def _run_dry(self, most: int) -> tuple[_Integers, Output]:
        """Hold a carrier; hold a waveform for a while, then ramp it to 0 V."""
        if not self._is_dry:
            self._is_dry, self._dry_ticks = True, 0
            self.underruns += 1
        if self._playing.mode is StreamMode.ENVELOPE or self._gain == 0:
            return np.full(most, self._level, np.int64), Output.HELD
        if self._dry_ticks < self._hold_ticks:
            count = min(most, self._hold_ticks - self._dry_ticks)
            self._dry_ticks += count
            return np.full(count, self._level, np.int64), Output.HELD
        gains = self._gain - 1 - np.arange(min(most, self._gain))
        self._gain = int(gains[-1])
        return _quotient(self._to * gains, self.ramp_ticks), Output.RAMP

    def _times_carrier(self, levels: _Integers) -> _Integers:
        if self._playing.mode is not StreamMode.ENVELOPE:
            return levels
        step = self._playing.phase_step
        phase = (self._phase + step * np.arange(levels.size)) % _TURN
        self._phase = (self._phase + step * levels.size) % _TURN
        return _quotient(levels * sine_of(phase), FULL_SCALE_CODE)


def sine_of(phase: _Integers) -> _Integers:
    """Return the sine of phases, of which 2^32 are a turn, in 1/32767."""
    index, fraction = phase >> 22, phase >> 6 & 0xFFFF
    a, b = _SINE[index], _SINE[index + 1]
    return a + _quotient((b - a) * fraction, 65536)


def _quotient(a: _Integers, b: int) -> _Integers:
    """Integer division rounded toward 0, as in C."""
    quotient: _Integers = np.sign(a) * (np.abs(a) // b)
    return quotient
