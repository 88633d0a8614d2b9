"""The rig's check: what a weight, a tap and a voltmeter say of a rig that is known."""

import json
from functools import cache

import numpy as np
import pytest
from scipy.signal import lti
from typer.testing import CliRunner

import haptix
from calibration.measure.rig import RigCheck, VoltsRead, measure_rig, tap_response
from haptix.tasks.cli.application import group_of

app = group_of("calibrate", "Calibrate a screen.")

RATE_HZ = 10_000.0


@cache
def tap(pole_hz, resonance_hz, quality, noise_n=2e-3, seed=0):
    """A blow of 0.1 ms in time, by the differential equations of sensor and pole."""
    t = np.arange(0.0, 1.0, 1 / RATE_HZ / 10)
    w = 2 * np.pi * resonance_hz
    sensor = lti([w**2], np.polymul([1 / (2 * np.pi * pole_hz), 1], [1, w / quality, w**2]))
    blow = np.where((t >= 0.3) & (t < 0.3001), 50.0, 0.0)
    _, force, _ = sensor.output(blow, t)
    noise = np.random.default_rng(seed).normal(0, noise_n, len(t[::10]))
    return t[::10], force[::10] + noise


@pytest.mark.parametrize(
    ("pole_hz", "resonance_hz", "quality"),
    [(500.0, 2500.0, 10.0), (1000.0, 1500.0, 20.0), (2500.0, 900.0, 6.0)],
)
def test_a_tap_gives_pole_and_resonance(pole_hz, resonance_hz, quality):
    found = tap_response(*tap(pole_hz, resonance_hz, quality))
    # One and a half, and two, of the spreads that a fit takes from a tap: 20 % and 5 %.
    assert found.pole_hz == pytest.approx(pole_hz, rel=0.3)
    assert found.resonance_hz == pytest.approx(resonance_hz, rel=0.1)


# Exponents of half a sine: a blow by Hertz' law has 1.5, a raised cosine 2.
@pytest.mark.parametrize(
    ("blow_s", "form"), [(5e-5, 1.0), (1e-4, 1.5), (1.9e-4, 1.0), (1.9e-4, 2.0)]
)
@pytest.mark.parametrize(
    ("pole_hz", "resonance_hz", "quality", "rate_hz"),
    [
        (1000.0, 2500.0, 20.0, 50_000),
        (800.0, 6000.0, 8.0, 50_000),
        (1500.0, 4000.0, 10.0, 20_000),
        (1500.0, 2500.0, 8.0, 10_000),
        (2500.0, 900.0, 6.0, 50_000),
    ],
)
def test_a_blow_as_long_as_allowed_does_not_look_like_a_pole(
    pole_hz, resonance_hz, quality, rate_hz, blow_s, form
):
    """The spectrum of the blow, times the sensor's response, back in time."""
    fine_hz = 20 * rate_hz
    count = round(blow_s * fine_hz)
    blow = np.zeros(fine_hz)
    blow[round(0.3 * fine_hz) :][:count] = np.sin(np.pi * (np.arange(count) + 0.5) / count) ** form
    hertz = np.fft.rfftfreq(fine_hz, 1 / fine_hz)
    ratio = hertz / resonance_hz
    response = 1 / (1 + 1j * hertz / pole_hz) / (1 - ratio**2 + 1j * ratio / quality)
    force = np.fft.irfft(np.fft.rfft(blow) * response, fine_hz)[::20]
    force *= 8.0 / np.abs(force).max()
    force += np.random.default_rng(0).normal(0, 2e-3, rate_hz)
    found = tap_response(np.arange(rate_hz) / rate_hz, force)
    # The spreads that a fit takes from a tap.
    assert found.pole_hz == pytest.approx(pole_hz, rel=0.2)
    assert found.resonance_hz == pytest.approx(resonance_hz, rel=0.05)
    assert found.quality == pytest.approx(quality, rel=0.3)


def test_no_tap_is_refused():
    t = np.arange(0.0, 1.0, 1e-4)
    with pytest.raises(haptix.InputError, match="tap harder"):  # 28 N
        tap_response(*tap(1000.0, 1500.0, 20.0, noise_n=0.5))
    with pytest.raises(haptix.InputError, match="tap harder"):
        tap_response(t, np.random.default_rng(1).normal(size=len(t)))


class Bench:
    """A rig of known gains, as its instruments record each step."""

    def __init__(self, normal=1.0, tangential=1.0, volts=1.0, slips=False):
        self.normal, self.tangential, self.volts = normal, tangential, volts
        self.slips, self.prompts = slips, []
        self.step, self.level_v = "", 0.0

    def ask(self, prompt):
        self.step = prompt.split()[0]
        self.prompts.append(prompt)
        typed = f"{self.volts * self.level_v / np.sqrt(2):.6f}"
        return typed.replace(".", ",") if self.slips and "got" not in prompt else typed

    def record(self, stroke):
        self.level_v = stroke.voltage_v
        t, tapped = tap(1500.0, 2500.0, 8.0)
        pressed = 2.0 * self.normal * (self.step == "Put" and not stroke.voltage_v)
        pulled = 2.0 * self.tangential * (self.step == "Let")
        return {
            "t_s": t,
            "normal_force_n": np.full_like(t, 0.1 + pressed),
            "tangential_force_n": -0.05 + pulled + tapped * (self.step == "Take"),
            "drive_v": stroke.voltage_v * np.sin(2 * np.pi * stroke.frequency_hz * t),
        }


@pytest.mark.parametrize(
    ("gains", "faults"),
    [
        ({}, []),
        ({"tangential": 1.1, "volts": 0.9}, []),
        ({"normal": -1.0}, ["wrong sign"]),
        ({"tangential": 0.2248}, ["is it in lbf?"]),
        ({"tangential": 3.597}, ["is it in ozf?"]),
        ({"tangential": 10.0}, ["check its unit"]),
        ({"volts": np.sqrt(2)}, ["in V rms"]),
        ({"volts": 2 * np.sqrt(2)}, ["in V rms"]),
        ({"volts": 10.0}, ["the scale of the drive's channel"]),
        ({"volts": 0.2}, ["the scale of the drive's channel"]),
    ],
    ids=[
        "right",
        "scales",
        "sign",
        "pounds",
        "ounces",
        "unit",
        "amplitude",
        "peak-to-peak",
        "probe",
        "weak",
    ],
)
def test_gains_are_those_of_the_rig(gains, faults):
    bench = Bench(**gains)
    with haptix.open_device("mock:") as device:
        found = measure_rig(None, 2.0, bench.ask, device, bench.record)
    assert found.normal_gain == pytest.approx(gains.get("normal", 1.0), rel=1e-6)
    assert found.tangential_gain == pytest.approx(gains.get("tangential", 1.0), rel=1e-3)
    # Three levels up to the strokes' highest, or to what the driver's slew rate allows at 4 kHz.
    assert [(one.frequency_hz, round(one.monitor_v, -1)) for one in found.volts] == [
        (125.0, 50), (125.0, 120), (125.0, 200), (4000.0, 50), (4000.0, 110), (4000.0, 180)
    ]  # fmt: skip
    for one in found.volts:
        assert one.gain == pytest.approx(gains.get("volts", 1.0), rel=1e-3)
    assert found.pole_hz == pytest.approx(1500.0, rel=0.2)
    assert len(found.faults()) == len(faults)
    assert all(said in found.faults()[0] for said in faults)


@pytest.mark.parametrize(
    ("gains", "is_refused"),
    [
        # sqrt(1/2): peak to peak recorded, an amplitude typed; 2: the other way round.
        ((0.71, 0.7, 0.715), True),
        ((2.04, 1.97, 2.0), True),
        # An amplifier that is weak at its highest frequency, or weaker with level, is no mistake.
        ((1.0, 0.98, 0.7), False),
        ((0.9, 0.8, 0.7), False),
        ((1.0, 1.01, 0.99), False),
    ],
)
def test_volts_in_another_measure_are_refused_and_a_weak_amplifier_is_not(gains, is_refused):
    volts = tuple(
        VoltsRead(frequency_hz=125.0, monitor_v=50.0 * (number + 1), gain=gain)
        for number, gain in enumerate(gains)
    )
    check = RigCheck(normal_gain=1.0, tangential_gain=1.0, volts=volts)
    assert bool(check.faults()) is is_refused


def test_a_slip_in_a_reading_is_asked_again_and_the_readings_before_it_stand():
    bench = Bench(slips=True)
    with haptix.open_device("mock:") as device:
        found = measure_rig(None, 2.0, bench.ask, device, bench.record)
    assert [one.gain for one in found.volts] == pytest.approx([1.0] * 6, rel=1e-3)
    again = [prompt for prompt in bench.prompts if "got '" in prompt]
    assert len(again) == 6
    assert "V rms" in again[0]


def test_volts_that_nothing_read_are_not_checked():
    bench = Bench(volts=0.9)
    found = measure_rig(None, 2.0, bench.ask, None, bench.record)
    assert not found.reads_volts
    assert found.highest_read_v == 0
    assert found.faults() == []


def test_readings_that_were_written_down(tmp_path):
    t, force = tap(500.0, 2500.0, 10.0)
    lines = "\n".join(f"{a:.6f},{b:.6f}" for a, b in zip(t, force, strict=True))
    (tmp_path / "tap.csv").write_text("t_s,tangential_force_n\n" + lines + "\n")
    command = ["rig", str(tmp_path / "s"), "--weight-n", "1.962", "--json"]
    made = CliRunner().invoke(app, command)
    assert made.exit_code == 2 or isinstance(made.exception, haptix.InputError)
    command += ["--normal-reading-n", "1.962", "--tangential-reading-n", "2.158"]
    command += ["--monitor-v", "100", "--voltmeter-rms-v", "63.63961"]  # 90 V of amplitude
    command += ["--tap", str(tmp_path / "tap.csv")]
    made = CliRunner().invoke(app, command)
    assert made.exit_code == 0, made.output
    (row,) = json.loads(made.stdout)
    uneven = CliRunner().invoke(app, [*command, "--monitor-v", "180"])
    assert "expected as many of each, got 2, 1 and 0" in str(uneven.exception)
    found = RigCheck.load(tmp_path / "s" / "rig.toml")
    assert (row["tangential_gain"], row["voltage_gain"]) == (
        found.tangential_gain,
        pytest.approx(0.9, rel=1e-6),
    )
    assert found.tangential_gain == pytest.approx(2.158 / 1.962)
    assert set(found.sensor()) == {"sensor_pole_hz", "sensor_resonance_hz", "sensor_quality"}
