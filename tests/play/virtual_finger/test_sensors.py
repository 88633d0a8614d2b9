"""What sensors read of the truth."""

import numpy as np
import pytest

from haptix import InputError, Trajectory
from haptix.play.virtual_finger import Felt, SensorModel, TouchPanel, VirtualFinger

N = 20_001
TIME = 3.0 + np.arange(N) / 10_000.0
X = 20.0 * np.sin(2 * np.pi * (TIME - 3.0) / 2.0)
SPEED = np.abs(20.0 * np.pi * np.cos(np.pi * (TIME - 3.0)))
NORMAL = 0.5 + 0.1 * np.sin(2 * np.pi * (TIME - 3.0))
TRUTH = Felt(
    TIME, X, np.zeros(N), SPEED, NORMAL, np.full(N, 0.3), 0.3 * NORMAL, np.zeros(N, dtype=np.int64)
)


def test_a_perfect_sensor_reads_the_truth():
    read = SensorModel().read(TRUTH)
    np.testing.assert_array_equal(read.t_s, TRUTH.t_s)
    np.testing.assert_array_equal(read.tangential_force_n, TRUTH.friction_force_n)
    np.testing.assert_array_equal(read.normal_force_n, TRUTH.normal_force_n)


def test_every_fault_is_its_own():
    def tangential(**faults):
        return SensorModel(**faults).read(TRUTH).tangential_force_n

    force = TRUTH.friction_force_n
    np.testing.assert_allclose(tangential(offset_n=0.2), force + 0.2)
    np.testing.assert_allclose(tangential(drift_n_per_s=0.01), force + 0.01 * (TIME - 3.0))
    np.testing.assert_allclose(tangential(tangential_sign=-1), -force)
    np.testing.assert_allclose(tangential(crosstalk=0.02), force + 0.02 * NORMAL)
    normal = SensorModel(crosstalk=0.02).read(TRUTH).normal_force_n
    np.testing.assert_allclose(normal, NORMAL + 0.02 * force)


def test_noise_is_white_normal_and_its_seed_repeats():
    sensor = SensorModel(force_noise_n=0.01)
    noise = sensor.read(TRUTH, seed=1).tangential_force_n - TRUTH.friction_force_n
    other = sensor.read(TRUTH, seed=1).normal_force_n - NORMAL
    # 20,001 values: the deviation scatters by 0.5 %, means and correlations by 0.7 %; four of each.
    assert noise.std() == pytest.approx(0.01, rel=0.02)
    assert abs(noise.mean()) < 0.03 * 0.01
    assert abs(np.corrcoef(noise[1:], noise[:-1])[0, 1]) < 0.03
    assert abs(np.corrcoef(noise, other)[0, 1]) < 0.03
    again = sensor.read(TRUTH, seed=1).tangential_force_n
    np.testing.assert_array_equal(again, sensor.read(TRUTH, seed=1).tangential_force_n)
    assert (again != sensor.read(TRUTH, seed=2).tangential_force_n).all()


def test_latency_shows_the_past():
    read = SensorModel(latency_s=0.01).read(TRUTH)
    # 100 samples late; before there was anything, the first value.
    np.testing.assert_allclose(read.tangential_force_n[100:], TRUTH.friction_force_n[:-100])
    np.testing.assert_allclose(read.normal_force_n[:100], NORMAL[0])


def test_along_an_axis_the_force_turns_with_the_stroke():
    read = SensorModel(axis="x").read(TRUTH).tangential_force_n
    away = np.abs(np.cos(np.pi * (TIME - 3.0))) > 0.01
    expected = TRUTH.friction_force_n * np.sign(np.cos(np.pi * (TIME - 3.0)))
    # A rounding of the two parts' size, whatever the speed does from sample to sample.
    np.testing.assert_allclose(read[away], expected[away], rtol=1e-12)
    np.testing.assert_allclose(SensorModel(axis="y").read(TRUTH).tangential_force_n, 0.0)


def test_across_the_axes_the_force_has_two_parts(model):
    # A 3-4-5 stroke whose speed doubles half-way: the direction does not change there.
    felt = VirtualFinger(model).feel(
        np.zeros(8), 48_000, [0.0, 0.1, 0.2], [0.0, 3.0, 9.0], [0.0, -4.0, -12.0], 0.5
    )
    for axis, share in (("x", 0.6), ("y", -0.8)):
        read = SensorModel(axis=axis).read(felt).tangential_force_n
        np.testing.assert_allclose(read, share * felt.friction_force_n, rtol=1e-9)


def test_a_virtual_finger_reads_with_its_own_sensor(model, stroke):
    finger = VirtualFinger(model, SensorModel(force_noise_n=0.01), seed=5)
    felt = finger.feel(np.zeros(8), 48_000, **stroke(0.1))
    read = finger.read(felt)
    np.testing.assert_array_equal(
        read.tangential_force_n, finger.sensor.read(felt, 5).tangential_force_n
    )
    assert np.ptp(felt.mu) == 0.0


@pytest.mark.parametrize(
    "faults",
    [
        {"force_noise_n": -1.0},
        {"force_noise_n": np.nan},
        {"drift_n_per_s": np.inf},
        {"latency_s": -0.1},
        {"tangential_sign": 2},
        {"axis": "z"},
        {"offset_n": "1"},
    ],
)
def test_a_sensor_that_cannot_be_is_refused(faults):
    with pytest.raises(InputError, match=next(iter(faults))):
        SensorModel(**faults)


def test_a_panel_reports_at_its_rate_and_late():
    panel = TouchPanel(rate_hz=100.0, latency_s=0.03)
    seen = panel.read(Trajectory.of([1.0, 2.0], [0.0, 100.0], 5.0, 0.5))
    assert len(seen.t_s) == 101
    np.testing.assert_allclose(seen.t_s, 1.0 + np.arange(101) / 100)
    np.testing.assert_allclose(seen.arrival_s - seen.t_s, 0.03)
    np.testing.assert_allclose(seen.x_mm, np.arange(101.0))
    np.testing.assert_allclose(seen.normal_force_n, 0.5)


def test_a_panel_is_noisy_coarse_and_blind_to_a_lifted_finger():
    path = ([0.0, 10.0, 10.1, 20.0, 20.1, 100.0], 50.0, 20.0, [0.5, 0.5, 0.0, 0.0, 0.5, 0.5])
    seen = TouchPanel(place_noise_mm=0.2, force_noise_n=0.02).read(Trajectory.of(*path), seed=2)
    # Some 9,000 reports: the deviation scatters by 0.75 %.
    assert (seen.x_mm - 50.0).std() == pytest.approx(0.2, rel=0.03)
    assert seen.normal_force_n[:900].std() == pytest.approx(0.02, rel=0.1)
    assert not ((seen.t_s > 10.1) & (seen.t_s < 20.0)).any()
    assert (seen.normal_force_n > 0).all()
    coarse = TouchPanel(resolution_mm=0.25).read(Trajectory.of([0.0, 1.0], [0.0, 10.0], 0.1, 0.5))
    np.testing.assert_allclose(coarse.x_mm % 0.25, 0.0, atol=1e-9)
    assert (coarse.y_mm == 0.0).all()
    for bad in ({"rate_hz": 0.0}, {"latency_s": -1.0}, {"place_noise_mm": np.nan}):
        with pytest.raises(InputError, match=next(iter(bad))):
            TouchPanel(**bad)
