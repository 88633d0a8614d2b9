"""Checks that a stream which is revised plays what the host takes as played, sample by sample.

Host and board share a clock that is slower than the guest's: in software emulation no transfer
takes as short as on a machine, and the order of what happens is what counts here.
"""

import time
from typing import Any, cast

import numpy as np

from firmware_io import Device, MockDriver, MockLink, Playback, volts_to_codes
from firmware_io.firmware.core import Output
from firmware_io.links.hid import HidLink
from firmware_io.links.usb import UsbLink
from firmware_io.revisable import Revisable
from tests.devices.guest.plugged import PluggedBoard
from tests.devices.guest.ways import HID, HIDRAW, USB, check, require, same
from tests.firmware_io.oracle.device import Oracle

_SPEED = 0.1
_SECONDS = 0.5  # of the stream
_QUIET_S = 0.06  # after the last revision: by then each is obeyed or refused
_TICK_S = 5e-4
_TOUCH_S = 0.01
_REFUSED = 6  # every so many revisions, one is late


class SlowClock:
    """The computer's clock, slower; the same in every process."""

    def __call__(self):
        """Return the time in seconds."""
        return _SPEED * time.monotonic()

    def sleep(self, seconds):
        """Wait."""
        time.sleep(seconds / _SPEED)


class Record:
    """A source whose every window is another, and that keeps what it is told was played.

    Parameters
    ----------
    grid : int
        See `firmware_io.reviser.Source`.
    alternates : bool
        Change the sign with every sample, so that no mean builds up.
    clock : Clock
        On which some revisions are late.
    """

    def __init__(self, grid, alternates, clock):
        self.grid, self._alternates, self._clock = grid, alternates, clock
        self.is_live = True
        self.made = Revisable()
        self.revisions = self.undone = 0
        self._levels_v = np.random.default_rng(5)

    def window(self, first, count, at_s, is_revision):
        """Return samples that tell window and index apart, and keep the driver's limits."""
        at = np.arange(first, first + count)
        volts = self._levels_v.uniform(2.0, 30.0) + 0.5 * (at % 13)
        if self._alternates:
            volts *= 1 - 2 * (at % 2)
        if not is_revision:
            require(first == self.made.end, f"{first} is appended to {self.made.end}")
            self.made.append(volts)
            return volts
        self.made.replace(first, volts)
        self.revisions += 1
        if self.revisions % _REFUSED == 0:
            self._clock.sleep(0.03)
        return volts

    def settle(self, obeyed, undone):
        """Keep those that were obeyed, and take back the others."""
        self.made.accept(obeyed)
        if undone:
            self.undone += self.made.undo()

    def played(self, index):
        """Forget nothing: all of it is compared."""


def play(device, source, clock, reaction_s):
    """Play with touches and late revisions, then without; return the counts."""
    playback = Playback(device, source, reaction_s)

    def run(seconds, touches):
        end_s, touch_s = clock() + seconds, clock()
        while (now_s := clock()) < end_s:
            if touches and now_s >= touch_s:
                touch_s = now_s + _TOUCH_S
                playback.touch()
            clock.sleep(min(max(playback.step(), 1e-5), _TICK_S))

    with playback:
        run(_SECONDS, True)
        source.is_live = False
        run(_QUIET_S, False)
        return playback.stats


def compare(source, stats, output, plays):
    """See that what was played is the record; `plays` are the codes of a stream of voltages."""
    codes, kinds = output
    played = codes[kinds == Output.STREAM]
    require(stats.revisions + stats.refused == source.revisions, stats, source.revisions)
    require(stats.refused == source.undone and source.undone >= 3, stats, source.undone)
    require(stats.revisions >= 20, stats)
    require(stats.underruns == 0 and not np.any(kinds == Output.HELD), stats)
    expected = plays(source.made.values)
    # Without STOP's ramp, and what was queued when it came.
    require(0.8 * _SECONDS * 48_000 < played.size <= expected.size, played.size, expected.size)
    same(played, expected[: played.size])
    return {
        "samples": played.size,
        "revisions": stats.revisions,
        "refused": stats.refused,
        "late_samples": stats.late_samples,
    }


def waveform(volts):
    """The codes that a driver plays for a waveform at its own rate."""
    return volts_to_codes(volts, 250.0)


def envelope(volts):
    """The codes that the oracle of the firmware plays for amplitudes."""
    driver = MockDriver()
    cast(Any, driver).core = Oracle(driver.about)
    with Device(MockLink(driver, 64), sample_rate_hz=8000) as device:
        device.write(volts)
    codes, kinds = device.mock.output
    return codes[kinds == Output.STREAM]


def _revised(link, clock, settings, reaction_s, plays):
    """Play on a board through a link, and compare."""
    with PluggedBoard(pace="real", clock=clock) as board:
        device = Device(link(), clock=clock, **settings)
        is_waveform = device.mode == "waveform"
        require(is_waveform == (plays is waveform), device.mode)
        source = Record(4 if is_waveform else 1, is_waveform, clock)
        stats = play(device, source, clock, reaction_s)
        device.close()
        status, fault = board.about()
        require(fault is None and status.faults == 0 and status.underruns == 0, fault, status)
        return {**compare(source, stats, board.output(), plays)}


@check(USB)
def a_revised_waveform(way):
    """48 kHz."""
    return _revised(UsbLink, SlowClock(), {}, 0.003, waveform)


@check(HIDRAW, HID)
def a_revised_envelope(way):
    """8 kHz, in reports: four in a revision."""
    backend = way.address.partition("=")[2]
    settings = {"sample_rate_hz": 8000}
    return _revised(lambda: HidLink(backend=backend), SlowClock(), settings, 0.009, envelope)
