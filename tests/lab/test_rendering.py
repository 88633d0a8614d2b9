"""Volts for friction: against the surface, against the virtual finger, on any number of threads."""

import hashlib
from math import inf

import numpy as np
import pytest
import torch

from haptix import ContactModel, FrictionSurface, Screen
from haptix.base.errors import InputError, RangeError
from haptix.feel import Constant, Points, Sine, SteadySpeed, TimeNoise, grating
from haptix.lab import Population
from haptix.lab.stimuli import Apparatus, Rendering, Stimulus
from haptix.model.perception.thresholds import WEBER_FRACTION
from haptix.model.status import Status
from haptix.model.surface import Column
from haptix.play.virtual_finger import VirtualFinger


@pytest.mark.parametrize("force", [0.3, 0.437, 0.8])
@pytest.mark.parametrize("frequency", [120.0, 4000.0])
def test_a_column_is_its_surface(surface, force, frequency):
    response = surface.column(force, frequency)
    volts = np.linspace(0, float(surface.highest_voltage(force, frequency)), 101)
    mu = surface.mu(force, torch.from_numpy(volts), frequency).numpy()
    np.testing.assert_allclose(response.mu(volts), mu, rtol=1e-12)
    back, status = response.voltage(mu)
    assert set(status.tolist()) == {Status.OK}
    theirs = surface.voltage(torch.from_numpy(mu), force, frequency).voltage_v.numpy()
    # Near 0 V friction is flat: a rounding of mu by 1e-16 moves the voltage by 1e-6.
    np.testing.assert_allclose(back, theirs, atol=1e-5)
    low, high = (float(end) for end in surface.reachable(force, frequency))
    assert (response.lowest_mu, response.highest_mu) == pytest.approx((low, high), rel=1e-12)


def test_what_is_out_of_reach_gets_the_nearest_and_is_counted(response):
    low, high = response.lowest_mu, response.highest_mu
    volts, status = response.voltage(np.array([low - 0.1, low, high, high + 0.1, high + 1]))
    assert status.tolist() == [Status.BELOW, Status.OK, Status.OK, Status.ABOVE, Status.ABOVE]
    assert volts[0] == volts[1] == 0
    assert np.allclose(volts[2:], response.end_v)
    assert volts.max() <= response.end_v


def test_places_outside_a_surface_are_refused(surface):
    with pytest.raises(RangeError, match=r"0\.9 N.*0\.3 to 0\.8"):
        surface.column(0.9, 4000.0)
    with pytest.raises(InputError, match="frequency_hz"):
        surface.column(0.5, None)
    with pytest.raises(InputError, match="frequency_hz"):
        surface.column(0.5, 9000.0)


def test_a_response_says_what_ends_it(finger):
    strong = ContactModel(finger, Screen(max_voltage_v=400.0, insulator_thickness_m=4e-7))
    surface = FrictionSurface.build(strong, {"normal_force_n": 0.2}, 1e-2)
    response = surface.column(0.2, None)
    assert response.end_v < 400
    assert response.ends_by == Status.PULL_IN


def test_amplitude_gives_the_wanted_friction(response):
    wanted = (Sine(0.02, 11.0) + 0.29).lasting(0.4)
    rendering = Rendering(Stimulus("a", wanted, "mu"), response)
    block = rendering.block(1000, 8000)
    np.testing.assert_allclose(
        response.mu(block.amplitude_v), wanted.values(1000, 8000, 48_000.0), rtol=1e-12
    )
    carrier = np.sin(2 * np.pi * 4000 * (1000 + np.arange(8000)) / 48_000)
    np.testing.assert_allclose(block.drive_v, block.amplitude_v * carrier, atol=1e-9)
    assert (block.below, block.above) == (0, 0)
    # Contrast is friction over that without voltage, less 1.
    contrast = Stimulus("b", Constant(0.05).lasting(0.1), "contrast")
    amplitude = Rendering(contrast, response).block(0, 10).amplitude_v
    np.testing.assert_allclose(response.mu(amplitude), 1.05 * response.lowest_mu, rtol=1e-12)
    # Volts are volts.
    volts = Rendering(Stimulus("c", Constant(70.0).lasting(0.1), "volts"), response)
    assert np.abs(volts.whole()).max() == pytest.approx(70.0)


def test_equal_seeds_give_equal_bytes_on_one_thread_and_two(response):
    signal = (TimeNoise(0.01, (20.0, 300.0), seed=5) + grating(0.02, 2.0, 50.0) + 0.1).lasting(9.3)

    def digest(threads):
        rendering = Rendering(Stimulus("a", signal), response)
        found = hashlib.sha256()
        for block in rendering.stream(threads):
            found.update(block.drive_v.tobytes())
        return found.hexdigest()

    assert digest(1) == digest(2) == digest(3)


def test_an_error_in_a_thread_is_raised(response):
    broken = Stimulus("a", (Sine(0.1, 1.0) * Sine(1.0, 30_000.0)).lasting(20.0))
    with pytest.raises(InputError, match="half"):
        list(Rendering(broken, response).stream(2))


STIMULI = {
    "sine": Sine(0.05, 20.0, offset=0.08),
    "grating": grating(0.06, 2.0, 80.0, offset=0.09),
    "steps": Points((0.0, 0.2, 0.22, 0.5, 0.52, 0.8), (0.02, 0.02, 0.18, 0.18, 0.07, 0.07)),
    "noise": TimeNoise(0.02, (5.0, 60.0), seed=9, mean=0.1),
}


@pytest.mark.parametrize("name", STIMULI)
def test_the_virtual_finger_feels_what_was_wanted(model, surface, name):
    """Within 0.25 difference thresholds for 95 % of the time; the finger knows no surface."""
    rate, length, force, speed = 48_000.0, 0.8, 0.45, 80.0
    stimulus = Stimulus("a", STIMULI[name].lasting(length), normal_force_n=force)
    rendering = Rendering(stimulus, surface.column(force, 4000.0), rate)
    t = np.array([0.0, length])
    felt = VirtualFinger(model).feel(
        rendering.whole(), rate, t, speed * t, 0 * t + 20, 0 * t + force
    )
    inside = (felt.t_s > 0.05) & (felt.t_s < length - 0.02)  # the finger's response settles
    samples = np.rint(felt.t_s * rate).astype(int).clip(0, rendering.samples - 1)
    values = stimulus.signal.values(0, rendering.samples, rate)[samples]
    wanted = (1 + values) * rendering.response.lowest_mu
    error = np.abs(felt.mu - wanted)[inside] / (WEBER_FRACTION * wanted[inside])
    assert np.percentile(error, 95) < 0.25


def test_a_population_has_its_spread_and_a_median_that_is_reached(finger, screen):
    spread = {"frictional_shear_stress_pa": 0.2, "roughness.h_rms_m": 0.1}
    people = Population.around(finger, 300, spread, seed=3)
    tau = np.log(
        [
            one.frictional_shear_stress_pa / finger.frictional_shear_stress_pa
            for one in people.fingers
        ]
    )
    rough = np.log([one.roughness.h_rms_m / 22e-6 for one in people.fingers])
    # 300 draws: the standard deviation is known to 4 %, the mean to 0.012.
    assert tau.std() == pytest.approx(0.2, rel=0.15)
    assert rough.std() == pytest.approx(0.1, rel=0.15)
    assert abs(tau.mean()) < 0.05
    assert abs(np.corrcoef(tau, rough)[0, 1]) < 0.25
    assert "0.2" in people.statement and "seed 3" in people.statement
    assert Population.around(finger, 300, spread, seed=3) == people

    three = Population.around(finger, 3, spread, seed=3).fingers
    responses = [
        FrictionSurface.build(ContactModel(one, screen), {"normal_force_n": 0.5}, 2e-3).column(
            0.5, None
        )
        for one in three
    ]
    middle = Column.median(responses)
    volts = np.linspace(0, middle.end_v, 57)
    exact = np.median([one.mu(volts) for one in responses], axis=0)
    np.testing.assert_allclose(middle.mu(volts), exact, rtol=1e-5)  # 4096 pieces
    assert middle.end_v == min(one.end_v for one in responses)
    np.testing.assert_allclose(middle.voltage(exact)[0][1:], volts[1:], rtol=1e-4)


def test_wrong_populations_are_refused(finger):
    for size, spread, pattern in (
        (1, {"youngs_modulus_pa": 0.1}, "size"),
        (5, {}, "spread"),
        (5, {"colour": 0.1}, "colour"),
        (5, {"youngs_modulus_pa": -0.1}, "youngs_modulus_pa"),
        (5, {"name": 0.1}, "no such number"),
    ):
        with pytest.raises(InputError, match=pattern):
            Population.around(finger, size, spread, seed=0)


@pytest.mark.parametrize(
    ("fields", "pattern"),
    [
        ({"signal": Constant(1.0)}, "no end"),
        ({"name": "a/b"}, "letters"),
        ({"name": ""}, "letters"),
        ({"quantity": "newtons"}, "quantity"),
        ({"carrier_hz": None}, "carrier_hz"),
        ({"normal_force_n": 0.0}, "normal_force_n"),
        ({"normal_force_n": inf}, "normal_force_n"),
        ({"drive_hz": 100.0}, "drive_hz"),
    ],
)
def test_wrong_stimuli_are_refused(fields, pattern):
    with pytest.raises(InputError, match=pattern):
        Stimulus(**{"name": "a", "signal": Constant(1.0).lasting(1.0), **fields})


def test_a_stimulus_has_the_speed_of_its_gratings():
    one = Stimulus("a", (grating(0.1, 2.0, 50.0) + grating(0.1, 3.0, 50.0)).lasting(1.0))
    assert one.speed.speed_mm_per_s == 50.0
    with pytest.raises(InputError, match="different speeds"):
        Stimulus("a", (grating(0.1, 2.0, 50.0) + grating(0.1, 3.0, 60.0)).lasting(1.0))
    assert Stimulus("a", Sine(0.1, 2.0).lasting(1.0)).speed is None


def test_a_carrier_too_fast_for_the_rate_is_refused(response):
    with pytest.raises(InputError, match="quarter"):
        Rendering(Stimulus("a", Constant(0.1).lasting(1.0)), response, 10_000.0)


def direct(volts, speed=None, frequency=120.0):
    signal = Sine(volts, frequency).lasting(0.5)
    return Stimulus("d", signal, "volts", 0.5, carrier_hz=None, drive_hz=frequency, speed=speed)


def test_friction_of_a_direct_drive_is_its_periods_mean(finger, screen, own_cache):
    model = ContactModel(finger, screen)
    fast, slow = direct(180.0), direct(180.0, SteadySpeed(5.0))
    apparatus = Apparatus.build(finger, screen, [fast])
    quick, still = (apparatus.responses(one)[0] for one in (fast, slow))
    amplitude = Rendering(fast, quick).block(0, 24_000).amplitude_v
    # Whole periods of 400 samples: the same amplitude from the first sample to the last.
    np.testing.assert_allclose(amplitude, 180.0, rtol=1e-9)
    jnd = WEBER_FRACTION * quick.lowest_mu
    # The contact model in time, without a surface or the response: a finger that follows wholly.
    whole = float(model.over_period(0.5, 180.0, 120.0).mu.mean())
    assert quick.mu(amplitude[-1:])[0] == pytest.approx(whole, abs=0.05 * jnd)
    t = np.array([0.0, 0.5])
    felt = VirtualFinger(model).feel(
        Rendering(slow, still).whole(), 48_000.0, t, 5.0 * t, 0 * t, 0 * t + 0.5
    )
    inside = (felt.t_s > 0.2) & (felt.t_s < 0.4 - 1e-9)  # 24 periods, the first ones gone by
    assert still.mu(amplitude[-1:])[0] == pytest.approx(felt.mu[inside].mean(), abs=0.05 * jnd)
    # What the mean attraction alone would give is further off than either.
    naive = float(model.solve(0.5, 180.0, 120.0).mu)
    assert whole - naive > 0.3 * jnd


def test_the_period_before_a_sample_does_not_depend_on_the_blocks(response, rng):
    drive = Points(np.linspace(0, 0.05, 41).tolist(), rng.normal(size=41).tolist())
    one = Rendering(
        Stimulus("d", drive.lasting(0.05), "volts", carrier_hz=None, drive_hz=120.0), response
    )
    whole, values = one.block(0, one.samples), drive.values(0, one.samples, 48_000.0)
    expected = [np.sqrt(2 * np.mean(values[i - 399 : i + 1] ** 2)) for i in range(399, one.samples)]
    np.testing.assert_allclose(whole.amplitude_v[399:], expected, rtol=1e-9)
    np.testing.assert_allclose(whole.amplitude_v[:399], expected[0], rtol=1e-9)
    parts = [one.block(a, b - a).amplitude_v for a, b in ((0, 10), (10, 700), (700, one.samples))]
    np.testing.assert_allclose(np.concatenate(parts), whole.amplitude_v, rtol=1e-9)
    np.testing.assert_allclose(whole.instant_v, np.abs(values) * np.sqrt(2))
