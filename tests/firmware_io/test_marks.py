"""Samples that are marked: when the line rises, what the driver tells, and what the host does."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from firmware_io import Device, DeviceError, MockDriver, MockLink
from firmware_io.firmware.core import LINE, Core
from firmware_io.protocol import NEVER, FaultCode, FaultReport, Mark, MarkedReport, Stop
from tests.firmware_io.core_rig import BOARD, CARRIED, PLAIN, Rig
from tests.firmware_io.oracle.device import Oracle
from tests.firmware_io.test_differential import Pair

MARKING = replace(BOARD, takes_marks=True)
HIGH = 48  # output samples: 1 ms


@pytest.fixture
def rig():
    return Rig(MARKING)


def line(rig, ticks):
    """Output samples at which the line is high."""
    return np.flatnonzero(rig.core.play(ticks)[1] & LINE).tolist()


@pytest.mark.parametrize(("setup", "each"), [(PLAIN, 1), (CARRIED, 3)])
def test_the_line_rises_with_the_sample_and_its_clock_is_told(rig, setup, each):
    rig.ready(setup)
    rig.stream([5] * 100, setup.mode)
    assert rig.say(Mark(40, 7), Mark(150, 9)) == []  # the second is not sent yet
    rig.stream([5] * 100, setup.mode)
    # 1 tick of lead less, in pieces that do not end with samples.
    high = [at + 7 * n for n in range(600 // 7) for at in line(rig, 7)]
    assert high == [*range(40 * each, 40 * each + HIGH), *range(150 * each, 150 * each + HIGH)]
    assert rig.poll() == [MarkedReport(40 * each, 40, 7), MarkedReport(150 * each, 150, 9)]
    assert rig.say(Mark(150, 1)) == [MarkedReport(NEVER, 150, 1)]


def test_a_device_without_a_line_knows_no_mark():
    plain = Rig(BOARD).ready()
    (fault, *_) = plain.say(Mark(0))
    assert isinstance(fault, FaultReport) and (fault.code, fault.got) == (FaultCode.KIND, 8)


def test_stop_forgets_what_waits_and_keeps_what_was_played(rig):
    rig.ready()
    rig.stream([9] * 50)
    rig.say(Mark(10, 1), Mark(49, 2))
    assert line(rig, 30) == list(range(10, 30))
    answers = rig.say(Stop())
    assert [one for one in answers if isinstance(one, MarkedReport)] == [MarkedReport(10, 10, 1)]
    # The line stays high to its end, whatever becomes of the output.
    assert line(rig, 1000) == list(range(HIGH - 20))
    assert not [one for one in rig.poll() if isinstance(one, MarkedReport)]


class MarkedPair(Pair):
    """Both cores, with marks among the rest."""

    def __init__(self, seed):
        super().__init__(seed)
        about = replace(MARKING, **{name: getattr(self.board, name) for name in (
            "output_rate_hz", "full_scale_mv", "ceiling_mv", "max_slew_v_per_s", "queue_samples",
            "max_frame_samples", "rates")})  # fmt: skip
        self.cores: list[Any] = [Core(about), Oracle(about)]

    def step(self):
        for _ in range(int(self.rng.integers(0, 3))):
            self.say(Mark((self.index + int(self.rng.integers(-400, 400))) % 2**32, self.index % 9))
        return super().step()


@pytest.mark.parametrize(
    "seeds", [range(1000, 1006), pytest.param(range(1006, 1130), marks=pytest.mark.slow)]
)
def test_both_cores_agree_about_marks(seeds):
    met = set()
    for seed in seeds:
        pair = MarkedPair(seed)
        met |= {pair.step() for _ in range(int(pair.rng.integers(5, 60)))}
    assert {"none", "ENERGY", "MEAN", "QUEUE_FULL"} <= met


@pytest.mark.parametrize("reports", [None, 64])
def test_the_host_learns_the_drivers_clock(reports):
    driver = MockDriver()
    device = Device(MockLink(driver, reports), mode="waveform")
    rate, each = driver.about.output_rate_hz, 1
    with pytest.raises(DeviceError, match="armed"):
        device.mark(0)
    with device:
        each = rate // round(device.capabilities.sample_rate_hz)
        device.mark(100, 77)
        device.write(np.full(200, 3.0))
        device.progress(is_fresh=True)
        (one,) = device.marked()
        assert (one.sample_index, one.code) == (100, 77)
        # The line of the mock's record says the same as its message.
        rise = int(np.flatnonzero(driver.output[1] & LINE)[0])
        assert one.clock_ticks == rise
        later = device.marked()
        assert later == []
        for n in range(8):
            device.mark(10_000 + n)
        with pytest.raises(DeviceError, match="8 marks wait"):
            device.mark(10_009)
    assert each >= 1


def test_two_marks_are_as_far_apart_by_the_hosts_clock_as_their_samples():
    device = Device(MockLink(MockDriver()), mode="waveform", sample_rate_hz=48_000)
    with device:
        device.mark(0, 1)
        device.mark(4800, 2)
        device.write(np.zeros(6000))
        device.progress(is_fresh=True)
        first, second = device.marked()
    # Both from one mapping of the clocks: to the rounding of a double.
    assert second.time_s - first.time_s == pytest.approx(0.1, abs=1e-9)
