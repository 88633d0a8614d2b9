"""Mean and energy with a host in front: what it may ask for, and what it does between writes."""

from contextlib import suppress

import numpy as np
import pytest

from firmware_io import (
    Device,
    DeviceError,
    DriveLimits,
    LimitError,
    MockDriver,
    MockLink,
    open_device,
)
from firmware_io.links import hosted
from firmware_io.links.audio import AudioProfile
from firmware_io.links.hosted import HostedLink
from firmware_io.serve import DriverServer
from tests.waiting import wait_for


def worst(driver):
    """Largest mean and rms of any second that the driver has played, in volts."""
    rate_hz = driver.about.output_rate_hz
    volts = np.concatenate([np.zeros(rate_hz), driver.output_v, np.zeros(rate_hz)])
    sums = np.cumsum(np.concatenate([[0.0], volts]))
    squares = np.cumsum(np.concatenate([[0.0], volts**2]))
    mean = np.abs(sums[rate_hz:] - sums[:-rate_hz]).max() / rate_hz
    return mean, np.sqrt((squares[rate_hz:] - squares[:-rate_hz]).max() / rate_hz)


def assert_within_limits(driver):
    mean, rms = worst(driver)
    assert mean <= 1.01 * 10.0
    assert rms <= 1.01 * 1.01 * 200.0 / np.sqrt(2)


@pytest.mark.parametrize("carrier_hz", [0.1, 440.0, 999.9])
def test_no_carrier_below_1_khz(carrier_hz):
    with pytest.raises(DeviceError, match=r"carrier_hz .*1000"):
        open_device(f"mock:reports=yes,carrier_hz={carrier_hz}")
    with open_device("mock:reports=yes") as device, pytest.raises(DeviceError):
        device.set_up(carrier_hz=carrier_hz)


@pytest.mark.parametrize("selector", ["watchdog_s=65", "watchdog_s=0.161"])
def test_no_watchdog_above_160_ms(selector):
    with pytest.raises(DeviceError, match=r"watchdog_s .*0\.16"):
        open_device(f"mock:{selector}")
    with pytest.raises(DeviceError, match="max_watchdog_s"):
        MockDriver(max_watchdog_s=65.0)


class Output(HostedLink):
    """An output that asks for samples when it is told."""

    def __init__(self, profile):
        super().__init__(profile, "output")
        self._has_held.set()
        self.asked = [self._next(1)[0]]

    def _end(self, plays_on):
        pass

    def advance(self, seconds):
        for _ in range(round(seconds * 1000)):
            self.asked.append(self._next(48)[0])


@pytest.fixture(params=["bytes", "reports", "tcp", "in front of an output"])
def silenced(request, monkeypatch):
    """Of each link: a device, and how to end its time; returns the codes that it played then."""
    monkeypatch.setattr(hosted, "STILL_S", 300.0)
    if request.param == "tcp":
        driver = MockDriver(pace="real")
        with (
            DriverServer(driver) as server,
            open_device(f"{server.address},mode=envelope,carrier_hz=4000") as device,
        ):

            def codes():
                wait_for(lambda: not driver.is_armed)
                return driver.output[0]

            yield device, codes
        return
    if request.param == "in front of an output":
        output = Output(AudioProfile(full_scale_v=200.0))

        def asked():
            output.advance(1.0)
            return np.concatenate(output.asked)

        yield Device(output, mode="envelope", carrier_hz=4000.0), asked
        return
    link = MockLink(MockDriver(), 64 if request.param == "reports" else None)

    def played():
        link.driver.advance(1.0)
        return link.driver.output[0]

    yield Device(link, mode="envelope", carrier_hz=4000.0), played


def test_each_link_is_at_0_v_160_ms_after_the_last_word_of_its_host(silenced):
    """By the set-up that a program gets, from the first sample of its one frame on."""
    device, codes = silenced
    device.arm()
    device.write(np.full(16, 30.0))
    assert device.watchdog_s == 0.16
    played = codes()
    driven = np.flatnonzero(played)
    shown_s = (driven[-1] - driven[0]) / 48_000
    assert 0.13 < shown_s < 0.16  # what a lead of 20 ms leaves; a carrier holds its last amplitude
    with suppress(DeviceError):  # it has starved
        device.close()


def test_the_host_rejects_an_envelope_in_step_with_its_carrier():
    link = MockLink(MockDriver(sample_rate_hz=48_000))
    device = Device(link, mode="envelope", sample_rate_hz=48_000, carrier_hz=1000.0)
    gate = np.where(np.arange(48_000) % 48 < 24, 80.0, 0.0)
    with pytest.raises(LimitError, match="mean"), device:
        for piece in np.split(gate, 100):
            device.write(piece)
    assert_within_limits(link.driver)


def test_a_carrier_at_the_ceiling_passes_for_ever():
    device = open_device("mock:reports=yes,carrier_hz=1000")
    with device:
        for _ in range(60):
            device.write(np.full(800, 200.0))
    assert_within_limits(device.mock)
    assert worst(device.mock)[1] > 141.0


class Lenient(DriveLimits):
    """Limits that check nothing."""

    def __post_init__(self):
        pass

    def check(self, *arguments):
        pass

    def check_envelope(self, *arguments):
        pass

    @property
    def max_rms_slew_v_per_s(self):
        return 1e12


def test_a_subclass_of_the_limits_raises_none():
    for raised in ("max_rms_v", "max_dc_share", "window_s", "max_rms_a", "max_peak_a"):
        with pytest.raises(LimitError, match=raised):
            Device(MockLink(), Lenient(**{raised: 1e9}))
    device = Device(MockLink(), Lenient())
    with pytest.raises(LimitError), device:
        device.write([201.0])
    with pytest.raises(LimitError, match=r"0\.5 mA"), Device(MockLink(), Lenient()) as device:
        device.write(np.resize([0.0, 90.0, 0.0, -90.0], 96_000))


@pytest.mark.parametrize("limits", [200.0, "low", {"ceiling_v": 50.0}, object()])
def test_limits_that_are_none(limits):
    with pytest.raises(DeviceError, match="DriveLimits"):
        Device(MockLink(), limits)
