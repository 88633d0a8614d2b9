"""The driver measures its current: readings, and limits that it holds by what it measures.

Deadlines are in output samples, the device's own time.
"""

from dataclasses import replace

import numpy as np
import pytest

from firmware_io import (
    CurrentReading,
    Device,
    DeviceError,
    DeviceFaultError,
    MockConverter,
    MockDriver,
    MockLink,
)
from firmware_io.firmware.core import Core, Output, Sensor
from firmware_io.protocol import FaultCode, TouchPhase

RATE_HZ, CARRIER_HZ, PANEL_F = 48_000, 4000.0, 2e-9
HALF_TICKS = RATE_HZ / CARRIER_HZ / 2
MS = RATE_HZ // 1000
CUT = 12  # the ramp of 0.25 ms


class Bench:
    """A driver in virtual time with a carrier of 4 kHz, block by block of 10 ms."""

    def __init__(self, converter, volts=100.0, carrier_hz=CARRIER_HZ, knows_touches=True, **driver):
        self.converter = converter
        self.driver = MockDriver(converter=converter, **driver)
        if not knows_touches:
            about = replace(self.driver.about, reports_touch=False)
            self.driver.core = Core(about, Sensor(converter.full_scale_a, converter.panel_f))
        self.device = Device(
            MockLink(self.driver), mode="envelope", sample_rate_hz=16_000, carrier_hz=carrier_hz
        )
        self.volts = volts
        self.device.arm()
        self.device.write(np.linspace(0.0, volts, 800))
        self.readings = self.device.readings()

    def play(self, seconds):
        for _ in range(round(seconds * 100)):
            self.device.write(np.full(160, self.volts))
            self.device.progress(is_fresh=True)
            self.readings += self.device.readings()
        return self

    def known(self):
        """Until the panel is known: 50 ms untouched, and 16 readings of 4 ms."""
        return self.play(0.2)

    def change(self, **changes):
        """Change the converter at the next sample; return that sample's place in the output."""
        for name, value in changes.items():
            setattr(self.converter, name, value)
        return self.driver.output[0].size

    def until_fault(self):
        with pytest.raises(DeviceFaultError) as caught:
            self.play(0.2)
        return caught.value

    def ticks_to_zero(self, since):
        """Output samples from one on until the output is at 0 V for good."""
        return int(np.flatnonzero(self.driver.output[0])[-1]) + 1 - since


def steps_within_slew(driver):
    codes = driver.output[0].astype(int)
    step_v = np.abs(np.diff(codes)).max() * driver.about.full_scale_mv / 1e3 / 32767
    return step_v * RATE_HZ <= driver.about.max_slew_v_per_s


@pytest.mark.parametrize("rate_hz", [250, 500, 1000, 2000, 4000])
def test_readings_are_the_current_of_a_capacitance(rate_hz):
    farads = 2e-9 - 1e-10j
    bench = Bench(MockConverter(farads, rate_hz=rate_hz)).play(0.2)
    assert bench.device.capabilities.sense_rate_hz == rate_hz
    *_, before, last = bench.readings
    assert isinstance(last, CurrentReading)
    assert last.t_s - before.t_s == pytest.approx(1 / rate_hz, rel=1e-3)
    siemens = 2j * np.pi * CARRIER_HZ * farads
    assert last.driven_v == pytest.approx(100.0, rel=1e-3)  # codes of 8 mV, cut by the carrier
    # Noise of 10 uA a sample: over n samples sqrt(2 / n) of it, and five of those.
    noise_a = 5 * 1e-5 * np.sqrt(2 * rate_hz / RATE_HZ)
    assert last.in_phase_a == pytest.approx(siemens.real * 100, abs=noise_a)
    assert last.quadrature_a == pytest.approx(siemens.imag * 100, abs=noise_a + 1e-3 * 5e-3)
    assert not last.is_saturated
    bench.device.close()


@pytest.mark.parametrize("carrier_hz", [1000.0, 1700.0, 7000.0])
def test_readings_hold_at_carriers_that_do_not_divide_the_rate(carrier_hz):
    bench = Bench(MockConverter(carrier_hz=carrier_hz), volts=60.0, carrier_hz=carrier_hz).play(0.2)
    amperes = 2 * np.pi * carrier_hz * PANEL_F * 60
    # The ends lie up to half a sample off whole periods: 1/192 of a reading, of 2 % at its ends.
    for reading in bench.readings[-20:]:
        assert reading.quadrature_a / reading.driven_v * 60 == pytest.approx(amperes, rel=0.01)
    assert bench.device.sensor_problem is None
    bench.device.close()


def test_readings_come_at_their_rate_while_nothing_is_driven():
    """Silence would be that of a sensor which has failed; of 0 V there is nothing to measure."""
    bench = Bench(MockConverter()).play(0.1)
    bench.volts, bench.readings = 0.0, []
    counts = [len(bench.readings)]
    for volts in [0.0] * 10 + [100.0] * 10:
        bench.volts = volts
        bench.play(0.01)
        counts.append(len(bench.readings))
    # One in 4 ms, which ends with a whole period of 0.25 ms: two or three in each 10 ms. Counted,
    # as their times follow this computer's clock.
    assert set(np.diff(counts)) <= {2, 3}
    assert [reading.driven_v for reading in bench.readings[10:20]] == [0.0] * 10
    assert bench.readings[-1].driven_v == pytest.approx(100.0, rel=1e-3)
    assert bench.device.sensor_problem is None
    bench.device.close()


def test_a_driver_without_a_sensor_plays_and_answers_as_before():
    bench, sensing = Bench(None), Bench(MockConverter())
    for one in (bench, sensing):
        one.play(0.1)
        one.device.close()
    assert bench.readings == [] and bench.device.capabilities.sense_rate_hz == 0.0
    assert sensing.readings
    assert np.array_equal(bench.driver.output[0], sensing.driver.output[0])


def test_a_direct_drive_says_that_sensing_is_off():
    driver = MockDriver(converter=MockConverter())
    with Device(MockLink(driver), mode="waveform") as device:
        device.write(np.zeros(4800))
        device.progress(is_fresh=True)
        assert device.readings() == []
        assert "no carrier" in device.sensor_problem


@pytest.mark.parametrize(
    ("farads", "code"),
    [
        (PANEL_F + 170e-12, FaultCode.PEAK_CURRENT),  # at 180 V 0.77 mA through a body
        (PANEL_F - 170e-12j, FaultCode.PEAK_CURRENT),  # the same through a leak
        (5 * PANEL_F, FaultCode.PEAK_CURRENT),
    ],
)
def test_a_measured_peak_is_at_0_v_within_a_millisecond(farads, code):
    bench = Bench(MockConverter(full_scale_a=0.05), volts=180.0).known()
    since = bench.change(farads=farads)
    bench.until_fault()
    assert bench.driver.core.fault().code is code
    assert bench.ticks_to_zero(since) <= MS
    assert steps_within_slew(bench.driver)


def test_a_finger_and_a_person_stay_below_the_limits():
    bench = Bench(MockConverter(), volts=180.0).known()
    bench.change(farads=PANEL_F + 39e-12)  # the most that a sliding finger adds
    bench.play(0.2).change(farads=PANEL_F + 120e-12)
    bench.play(0.2)
    assert bench.driver.fault is None and bench.device.sensor_problem is None


#: From the lowest that a driver takes to just below a quarter of the output rate.
AT_EACH_CARRIER = pytest.mark.parametrize(
    ("carrier_hz", "rate_hz"),
    [(1000.0, 250), (1000.0, 4000), (1700.0, 1000), (7000.0, 250), (11_900.0, 4000)],
)


def known_bench(carrier_hz, rate_hz, phase=0, **converter):
    """A bench at the highest voltage that the slew leaves, some output samples later."""
    volts = min(180.0, 0.95 * 4.666e6 / (2 * np.pi * carrier_hz))
    one = MockConverter(carrier_hz=carrier_hz, rate_hz=rate_hz, **converter)
    bench = Bench(one, volts, carrier_hz).known()
    bench.driver.advance(phase / RATE_HZ)
    return bench


@AT_EACH_CARRIER
@pytest.mark.parametrize("turn", [1, -1j], ids=["body", "leak"])
def test_a_peak_is_at_0_v_a_millisecond_behind_its_first_sample(carrier_hz, rate_hz, turn):
    for phase in (0, 7):
        bench = known_bench(carrier_hz, rate_hz, phase, full_scale_a=0.05)
        amperes = 0.8e-3
        farads = PANEL_F + amperes / (2 * np.pi * carrier_hz * bench.volts) * turn
        since = bench.change(farads=farads)
        bench.until_fault()
        # Where a half period has two samples, the rms of both may be told first.
        assert bench.driver.core.fault().code in (FaultCode.PEAK_CURRENT, FaultCode.RMS_CURRENT)
        first = since + np.ceil(RATE_HZ / carrier_hz / 4)  # of each quarter, one is above 0.7 mA
        assert bench.ticks_to_zero(first) <= MS
        assert steps_within_slew(bench.driver)


@AT_EACH_CARRIER
@pytest.mark.parametrize(
    ("changes", "code"),
    [({"failure": "noise"}, FaultCode.NO_CURRENT), ({"farads": -1e-8j}, FaultCode.OVERLOAD)],
    ids=["broken", "short"],
)
def test_what_is_missing_or_too_much_is_at_0_v_within_a_period_and_a_millisecond(
    carrier_hz, rate_hz, changes, code
):
    for phase in (0, 7):
        bench = known_bench(carrier_hz, rate_hz, phase)
        since = bench.change(**changes)
        bench.until_fault()
        # A load that is far too much is a peak as well, and may be told as one.
        assert bench.driver.core.fault().code in (code, FaultCode.PEAK_CURRENT)
        assert bench.ticks_to_zero(since) <= RATE_HZ / carrier_hz + MS
        assert steps_within_slew(bench.driver)


@AT_EACH_CARRIER
@pytest.mark.parametrize("failure", ["dead", "stuck", "inverted", "silent"])
def test_a_failure_is_told_within_10_ms_at_each_carrier(carrier_hz, rate_hz, failure):
    for phase in (0, 7):
        bench = known_bench(carrier_hz, rate_hz, phase)
        bench.change(failure=failure)
        bench.play(0.01)
        assert bench.device.sensor_problem is not None
        assert bench.driver.fault is None


@pytest.mark.parametrize("carrier_hz", [12_000.0, 20_000.0])
def test_a_carrier_of_too_few_samples_is_not_measured(carrier_hz):
    bench = Bench(MockConverter(carrier_hz=carrier_hz), 30.0, carrier_hz).play(0.2)
    assert "quarter of the output rate" in bench.device.sensor_problem
    assert bench.driver.fault is None
    bench.device.close()


@pytest.mark.parametrize("is_known", [True, False])
def test_a_broken_electrode_is_at_0_v_within_a_period_and_a_millisecond(is_known):
    bench = Bench(MockConverter())
    if is_known:
        bench.known()
    since = bench.change(failure="noise")
    assert "broken" in str(bench.until_fault())
    assert bench.driver.core.fault().code is FaultCode.NO_CURRENT
    assert bench.ticks_to_zero(since) <= 2 * HALF_TICKS + MS
    assert steps_within_slew(bench.driver)


def test_an_rms_below_the_peak_is_a_fault_of_its_own(monkeypatch):
    """A square of 0.6 mA beside the panel: below the peak of 0.7 mA, above the rms of 0.5 mA."""
    converter = MockConverter()
    bench = Bench(converter).known()
    plain = converter._current
    square = 0.6e-3 / converter.full_scale_a * 32767

    def distorted(sent, about):
        return plain(sent, about) + square * np.where(sent >= 0, 1, -1)

    monkeypatch.setattr(converter, "_current", distorted)
    since = bench.driver.output[0].size
    bench.until_fault()
    assert bench.driver.core.fault().code is FaultCode.RMS_CURRENT
    assert bench.ticks_to_zero(since) <= 2 * HALF_TICKS + MS


def test_a_short_before_the_panel_is_known_is_an_overload():
    bench = Bench(MockConverter())
    since = bench.change(farads=-1e-8j)
    assert "short circuit" in str(bench.until_fault())
    assert bench.driver.core.fault().code is FaultCode.OVERLOAD
    assert bench.ticks_to_zero(since) <= 2 * HALF_TICKS + MS


@pytest.mark.parametrize(
    ("failure", "why"),
    [
        ("dead", "does not change"),
        ("stuck", "does not change"),
        ("inverted", "of no load"),
        ("late", "of no load"),
        ("silent", "no samples"),
    ],
)
@pytest.mark.parametrize("phase", (0, 4, 9))
def test_a_converter_that_fails_is_told_and_the_drive_goes_on(failure, why, phase):
    bench = Bench(MockConverter()).known()
    bench.driver.advance(phase / RATE_HZ)
    good = len(bench.readings)
    since = bench.change(failure=failure)
    bench.play(0.01)
    assert why in bench.device.sensor_problem  # after 10 ms
    bench.play(0.1)
    assert len(bench.readings) - good <= 3  # what ended before
    assert bench.driver.fault is None
    codes = bench.driver.output[0]
    assert np.abs(codes[since:]).max() == np.abs(codes[since - 480 : since]).max()
    # Believed again after half a second of good samples.
    bench.change(failure=None)
    bench.play(0.45)
    assert bench.device.sensor_problem is not None
    bench.play(0.1)
    assert bench.device.sensor_problem is None


def test_a_saturated_converter_ends_at_0_v():
    bench = Bench(MockConverter()).known()
    since = bench.change(failure="saturated")
    bench.until_fault()
    assert bench.ticks_to_zero(since) <= 2 * HALF_TICKS + MS


def test_a_converter_that_stays_at_its_end_is_an_overload():
    """It may be stuck, or measure more than it can: the drive ends at 0 V."""
    bench = Bench(MockConverter())
    bench.change(_source=lambda sent: np.full(sent.size, 32_767, np.int16))
    bench.until_fault()
    assert bench.driver.core.fault().code is FaultCode.OVERLOAD


def test_a_late_converter_is_told_before_the_panel_is_known():
    """Of which a finger keeps it, if it comes before 16 readings."""
    bench = Bench(MockConverter())
    bench.driver.touch(30.0, 20.0, phase=TouchPhase.DOWN)
    bench.play(0.1).change(failure="late")
    bench.play(0.01)
    assert "of no load" in bench.device.sensor_problem


def test_a_current_below_that_of_a_known_panel_is_told():
    """No load takes any from it. Before it is known, it may be a quarter of what is stated."""
    unknown = Bench(MockConverter(0.8 * PANEL_F)).play(0.03)
    assert unknown.device.sensor_problem is None
    bench = Bench(MockConverter()).known()
    assert bench.device.sensor_problem is None
    bench.change(farads=0.8 * PANEL_F)
    bench.play(0.01)
    assert "of no load" in bench.device.sensor_problem


def test_the_panel_is_not_learned_from_a_finger():
    """With a finger from the begin, or one that is told late, its current adds to the panel's."""
    told = Bench(MockConverter(), volts=180.0)
    told.driver.touch(30.0, 20.0, phase=TouchPhase.DOWN)
    told.play(0.5).change(farads=PANEL_F + 170e-12)
    told.play(0.2)  # nothing is known to hold it against
    assert told.driver.fault is None
    told.change(farads=PANEL_F)
    told.driver.touch(30.0, 20.0, phase=TouchPhase.UP)
    told.known().change(farads=PANEL_F + 170e-12)
    told.until_fault()

    late = Bench(MockConverter(), volts=180.0).known()
    late.change(farads=PANEL_F + 60e-12)
    late.play(1.0).change(farads=PANEL_F + 170e-12)
    late.until_fault()
    assert late.driver.core.fault().code is FaultCode.PEAK_CURRENT


def test_a_converter_is_believed_only_after_half_a_second_without_a_lie():
    bench = Bench(MockConverter()).known()
    for _ in range(2):
        bench.change(failure="inverted")
        bench.play(0.02).change(failure=None)
        bench.play(0.3)  # 0.64 s behind the first lie, 0.3 s behind the last
    assert bench.device.sensor_problem is not None
    bench.play(0.25)
    assert bench.device.sensor_problem is None
    bench.change(failure="silent")
    bench.play(0.02).change(failure=None)
    bench.play(0.3).change(failure="silent")
    bench.play(0.02).change(failure=None)
    bench.play(0.3)
    assert bench.device.sensor_problem is not None


def test_a_driver_that_knows_no_touches_learns_no_panel():
    bench = Bench(MockConverter(), volts=180.0, knows_touches=False).play(0.3)
    bench.change(farads=PANEL_F + 170e-12)
    bench.play(0.1)  # whose a finger might be a part of
    assert bench.driver.fault is None


def test_readings_are_not_kept_for_the_next_host():
    bench = Bench(MockConverter()).play(0.1)
    bench.driver.advance(0.05)
    bench.driver.core.release()
    assert bench.driver.core.transmit() == b""


def test_a_panel_that_drifts_is_followed():
    """1 % in 4 s, which is 0.09 mA, and then a body that is just too much for it."""
    bench = Bench(MockConverter(lambda _, t_s: PANEL_F * (1 + 0.0025 * t_s)), volts=180.0)
    bench.play(4.0)
    assert bench.driver.fault is None
    bench.change(farads=PANEL_F * 1.01 + 170e-12)
    bench.until_fault()
    assert bench.driver.core.fault().code is FaultCode.PEAK_CURRENT


@pytest.mark.parametrize("rate_hz", [250, 4000])
@pytest.mark.parametrize("turn", [1, -1j], ids=["body", "leak"])
def test_a_current_that_rises_unnoticed_is_no_panel(turn, rate_hz):
    """A board that should report touches and does not: 1 mA in 2 s is too slow to be a finger's.

    The limit of 0.7 mA, the 0.1 mA that learning may add at 200 V, and noise of four deviations.
    """
    per_v = 2 * np.pi * CARRIER_HZ
    rise = lambda _, t_s: PANEL_F + max(0.0, t_s - 0.2) * 0.5e-3 / (180 * per_v) * turn  # noqa: E731
    bench = Bench(MockConverter(rise, rate_hz=rate_hz), volts=180.0)
    with pytest.raises(DeviceFaultError):
        bench.play(3.0)
    assert bench.driver.core.fault().code in (FaultCode.PEAK_CURRENT, FaultCode.RMS_CURRENT)
    end_s = np.flatnonzero(bench.driver.output[0])[-1] / RATE_HZ
    assert 0.6e-3 <= (end_s - 0.2) * 0.5e-3 <= 0.7e-3 + 0.1e-3 + 4e-5


def test_a_full_scale_below_10_v_expects_no_current():
    """10 V are beyond its codes: no failure of a converter can be seen, and none is told."""
    driver = MockDriver(converter=MockConverter())
    small = replace(driver.about, full_scale_mv=3_500, ceiling_mv=3_500)
    driver.core = Core(small, Sensor(0.02, PANEL_F))
    device = Device(MockLink(driver), mode="envelope", sample_rate_hz=16_000, carrier_hz=CARRIER_HZ)
    device.arm()
    driver.converter.failure = "noise"
    device.write(np.linspace(0.0, 3.4, 800))
    for _ in range(10):
        device.write(np.full(160, 3.4))
        device.progress(is_fresh=True)
    assert driver.fault is None and device.sensor_problem is None
    device.close()


def test_impossible_sensors_are_refused():
    about = MockDriver(converter=MockConverter()).about
    for sensor in (Sensor(0.0, 2e-9), Sensor(0.02, 0.0), Sensor(1.0, 2e-9)):
        with pytest.raises(DeviceError):
            Core(about, sensor)
    with pytest.raises(DeviceError, match="rate_hz"):
        MockConverter(rate_hz=300)


@pytest.mark.parametrize("seed", range(8))
def test_no_raw_code_loosens_a_limit(seed):
    """Hostile codes: what plays is the drive as without a sensor, until it ends at 0 V."""
    rng = np.random.default_rng(seed)
    scale = 10 ** rng.uniform(0, 4.5)

    def source(sent):
        kind = rng.integers(6)
        noise = np.clip(rng.normal(0, scale, sent.size), -32768, 32767)
        return [
            noise,
            np.full(sent.size, rng.integers(-32768, 32768)),
            np.clip(sent * rng.uniform(-2, 2) + noise, -32768, 32767),
            np.roll(sent, 3) * 0.5,
            rng.choice([-32768, 32767], sent.size),
            np.zeros(sent.size),
        ][kind if seed % 2 else seed // 2 % 6].astype(np.int16)

    hostile, plain = Bench(MockConverter()).known(), Bench(None).known()
    hostile.change(_source=source)
    for bench in (hostile, plain):
        try:
            bench.play(0.2)
        except DeviceFaultError:
            bench.driver.advance(0.01)
            assert bench is hostile
    codes, kinds = hostile.driver.output
    reference = plain.driver.output[0]
    end = int(np.flatnonzero(kinds == Output.RAMP)[0]) if (kinds == Output.RAMP).any() else None
    n = min(codes.size, reference.size) if end is None else end
    assert np.array_equal(codes[:n], reference[:n])
    assert end is None or not codes[end + 2 * CUT :].any()
    assert steps_within_slew(hostile.driver)
