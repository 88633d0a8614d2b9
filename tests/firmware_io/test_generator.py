"""A function generator by SCPI, on the instrument that PyVISA-sim plays."""

from pathlib import Path

import numpy as np
import pytest

from firmware_io import DeviceDisconnectedError, DeviceError, LimitError, open_device
from firmware_io.generator import OUTPUT_HZ, FunctionGenerator, GeneratorProfile, check_trace

pytest.importorskip("pyvisa_sim")
ResourceManager = pytest.importorskip("pyvisa").ResourceManager
InvalidSession = pytest.importorskip("pyvisa").errors.InvalidSession
BACKEND = f"{Path(__file__).parent / 'generator.yaml'}@sim"
PROFILE = GeneratorProfile(amplifier_gain=20.0, ceiling_v=150.0)
SINE = 100.0 * np.sin(2 * np.pi * 120 * np.arange(4800) / OUTPUT_HZ)


class Told:
    """What an instrument was told, and whether its output was on meanwhile."""

    def __init__(self, generator):
        self._instrument, self.lines = generator._instrument, []
        generator._instrument = self

    def write(self, command):
        self.lines.append(command)
        return self._instrument.write(command)

    def query(self, command):
        return self._instrument.query(command)

    def close(self):
        self._instrument.close()


@pytest.fixture
def generator():
    with FunctionGenerator("TCPIP0::localhost::INSTR", PROFILE, BACKEND, lambda s: None) as one:
        yield one


def test_a_stimulus_is_uploaded_as_the_firmware_plays_it_and_ends_off(generator):
    told = Told(generator)
    drive_v = generator.play(SINE)
    assert "33522B" in generator.identity
    assert drive_v[0] == drive_v[-1] == 0.0
    # One step of a code of 150 V: what leaves is what was asked for, then the ramp of 5 ms.
    np.testing.assert_allclose(drive_v[1 : SINE.size], SINE[1:], atol=150 / 32767)
    volts = float(told.query("SOUR1:VOLT?"))
    codes = np.array(told.query("SOUR1:DATA:ARB:DAC?").split(","), float)
    np.testing.assert_allclose(codes / 32767 * volts / 2 * 20.0, drive_v, atol=100 / 32767)
    assert (float(told.query("SOUR1:FUNC:ARB:SRAT?")), told.query("SOUR1:VOLT:OFFS?")) == (
        48e3,
        "0",
    )
    assert (told.query("SOUR1:BURS:NCYC?"), told.query("SOUR1:BURS:STAT?")) == ("1", "ON")
    assert told.lines[-3:] == ["OUTP1 ON", "*TRG", "OUTP1 OFF"]
    assert told.query("OUTP1?") == "OFF"


def test_an_envelope_leaves_with_its_carrier(generator):
    envelope_v = 80.0 * np.hanning(800)
    drive_v = generator.play(envelope_v, 16_000, carrier_hz=2000.0)
    t_s = np.arange(drive_v.size) / OUTPUT_HZ
    spectrum = np.abs(np.fft.rfft(drive_v))
    assert np.fft.rfftfreq(drive_v.size, 1 / OUTPUT_HZ)[spectrum.argmax()] == pytest.approx(
        2e3, 0.02
    )
    assert np.abs(drive_v).max() == pytest.approx(80.0, rel=0.02)
    assert t_s[-1] < 0.07


@pytest.mark.parametrize(
    ("samples_v", "error"),
    [
        (np.full(4800, 151.0), LimitError),  # above the ceiling
        (np.tile([0.0, 149.0], 2400), LimitError),  # above the slew
        (np.full(48_000, 149.0), LimitError),  # a mean that lasts
        (np.full(480, np.nan), LimitError),
        (np.tile(SINE, 20), DeviceError),  # longer than its memory
    ],
    ids=["ceiling", "slew", "mean", "nan", "memory"],
)
def test_what_breaks_a_limit_reaches_no_instrument(generator, samples_v, error):
    told = Told(generator)
    with pytest.raises(error):
        generator.play(samples_v)
    assert told.lines == []


def test_an_amplifier_of_too_low_a_gain_is_named():
    low = GeneratorProfile(amplifier_gain=5.0)
    with FunctionGenerator("TCPIP0::localhost::INSTR", low, BACKEND) as generator:
        told = Told(generator)
        with pytest.raises(DeviceError, match="higher gain"):
            generator.play(SINE)
        assert told.lines == []


def test_each_failure_ends_with_the_output_off(generator):
    class Refusing(Told):
        at = ""

        def query(self, command):
            if self.lines and self.lines[-1] == self.at and command == "SYST:ERR?":
                return '-222,"Data out of range"'
            return super().query(command)

    refusing = Refusing(generator)
    for at in ("SOUR1:FUNC ARB", "SOUR1:BURS:NCYC 1", "OUTP1 ON", "*TRG"):
        refusing.at, refusing.lines = at, []
        with pytest.raises(DeviceError, match="-222"):
            generator.play(SINE)
        assert refusing.lines[-1] == "OUTP1 OFF"
        assert refusing.query("OUTP1?") == "OFF"


def test_an_interrupt_while_it_plays_ends_with_the_output_off():
    def interrupted(_):
        raise KeyboardInterrupt

    generator = FunctionGenerator("TCPIP0::localhost::INSTR", PROFILE, BACKEND, interrupted)
    told = Told(generator)
    with pytest.raises(KeyboardInterrupt):
        generator.play(SINE)
    assert told.lines[-1] == "OUTP1 OFF"
    generator.close()


def test_a_closed_one_is_named_and_not_told_anything():
    generator = FunctionGenerator("TCPIP0::localhost::INSTR", PROFILE, BACKEND)
    generator.close()
    with pytest.raises(DeviceDisconnectedError, match="closed"):
        generator.play(SINE)


def test_it_waits_while_an_upload_is_read(generator):
    """PyVISA's own 2 s are those of a short answer."""
    assert generator._instrument.timeout >= 10_000


def test_an_answer_that_is_no_text_is_no_agreement(generator, monkeypatch):
    told = Told(generator)

    def query(command):
        return b"\xff0,No error".decode("ascii")  # as PyVISA decodes it

    monkeypatch.setattr(told, "query", query)
    with pytest.raises(DeviceError, match="is no text"):
        generator.play(SINE)
    assert told.lines[-1] == "OUTP1 OFF" and "*TRG" not in told.lines


def test_one_that_refuses_its_first_commands_is_closed(monkeypatch):
    opened = []
    open_resource = ResourceManager.open_resource

    def opens(*words, **settings):
        opened.append(open_resource(*words, **settings))
        opened[0].query = lambda _: "-113,no such command"
        return opened[0]

    monkeypatch.setattr(ResourceManager, "open_resource", opens)
    with pytest.raises(DeviceError, match="-113"):
        FunctionGenerator("TCPIP0::localhost::INSTR", PROFILE, BACKEND)
    with pytest.raises(InvalidSession):
        _ = opened[0].session


@pytest.mark.parametrize("samples_v", [["1", "volt"], 5.0, np.zeros((2, 2)), None])
def test_what_is_no_list_of_volts_reaches_no_instrument(generator, samples_v):
    told = Told(generator)
    with pytest.raises(DeviceError, match="Voltages must be"):
        generator.play(samples_v)
    assert told.lines == []


def test_an_address_of_one_says_what_to_use():
    with pytest.raises(DeviceError, match="FunctionGenerator"):
        open_device("scpi:TCPIP0::10.0.0.5::INSTR")


@pytest.mark.filterwarnings("ignore:read string doesn't end")  # of PyVISA-sim for an unknown one
def test_what_does_not_answer_is_named():
    with pytest.raises(DeviceError, match="does not answer"):
        FunctionGenerator("TCPIP0::elsewhere::INSTR", PROFILE, BACKEND)


def test_a_resource_that_takes_no_commands_is_named():
    with pytest.raises(DeviceError, match="takes commands"):
        FunctionGenerator("no resource", PROFILE, BACKEND)


@pytest.mark.parametrize("rate_hz", [250_000, 1_000_000])
@pytest.mark.parametrize("probe", [1.0, 100.0])
def test_a_trace_shows_gain_offset_and_delay_of_a_rig(rate_hz, probe):
    rng = np.random.default_rng(0)
    drive_v = SINE * np.hanning(SINE.size)
    t_s = np.arange(int(0.13 * rate_hz)) / rate_hz
    there_v = np.interp(t_s - 0.01, np.arange(drive_v.size) / OUTPUT_HZ, drive_v, 0.0, 0.0)
    trace = (0.93 * there_v + 1.5 + rng.normal(0, 0.05, t_s.size)) / probe
    check = check_trace(drive_v, trace, rate_hz, probe)
    assert check.gain == pytest.approx(0.93, rel=1e-3)
    assert check.offset_v == pytest.approx(1.5, abs=0.01)
    assert check.delay_s == pytest.approx(0.01, abs=0.1 / OUTPUT_HZ)
    # Five deviations of the noise, and a tenth of a sample of the sine's slope of 1.6 V a sample.
    assert check.largest_difference_v < 5 * 0.05 + 0.1 * 1.6


@pytest.mark.parametrize("late_us", [0.0, 5.0, 10.4, 20.0])
def test_an_amplifier_that_is_late_by_a_part_of_a_sample_is_not_weak(late_us):
    rate_hz = 500_000

    def drive_v(t_s):
        inside = (t_s > 0) & (t_s < 0.1)
        return np.where(inside, 80 * np.sin(10 * np.pi * t_s) ** 2 * np.sin(8000 * np.pi * t_s), 0)

    t_s = np.arange(int(0.13 * rate_hz)) / rate_hz - 0.01
    played_v = drive_v(np.arange(4800) / OUTPUT_HZ)
    check = check_trace(played_v, drive_v(t_s - 1e-6 * late_us), rate_hz)
    assert check.gain == pytest.approx(1.0, abs=1e-3)
    assert check.delay_s == pytest.approx(0.01 + 1e-6 * late_us, abs=2e-7)
    # A straight line between two points of the trace is off by (2 pi f / rate)^2 / 8 at most.
    assert check.largest_difference_v < 2 * 80 * (2 * np.pi * 4000 / rate_hz) ** 2 / 8


def test_a_trace_that_is_too_short_is_refused():
    with pytest.raises(DeviceError, match="record all"):
        check_trace(SINE, np.zeros(100), 48_000)


@pytest.mark.parametrize(
    ("trace_v", "rate_hz"),
    [
        (np.where(np.arange(9600) == 5000, np.nan, 1.0), 48_000),
        (np.full(9600, np.inf), 48_000),  # beyond its range
        (np.zeros((9600, 2)), 48_000),  # its column of times, too
        (np.zeros(9600), 0.0),
        (np.zeros(9600), np.nan),
    ],
)
def test_a_trace_that_is_no_list_of_volts_is_refused(trace_v, rate_hz):
    with pytest.raises(DeviceError, match="finite volts"):
        check_trace(SINE, trace_v, rate_hz)
