"""Standing and lifted fingers, speeds, and what is refused."""

import numpy as np
import pytest

from haptix import ContactModel, Finger, InputError, LimitError, Screen, Status
from haptix.model.fidelity import BoundaryElementBox
from haptix.play.virtual_finger import Felt, VirtualFinger

RATE = 48_000
DRIVE = 100.0 * np.sin(2 * np.pi * 4000.0 * np.arange(RATE // 2) / RATE)
GOOD = {
    "drive_v": DRIVE,
    "sample_rate_hz": RATE,
    "t_s": [0.0, 0.5],
    "x_mm": [0.0, 20.0],
    "y_mm": [5.0, 5.0],
    "normal_force_n": [0.5, 0.5],
}


def test_the_result_has_the_path_at_the_output_rate(model):
    felt = VirtualFinger(model).feel(
        DRIVE, RATE, [0.1, 0.2, 0.4], [0.0, 3.0, 3.0], [0.0, 4.0, 24.0], [0.2, 0.4, 0.8]
    )
    assert len(felt.t_s) == 3001
    assert felt.t_s[0] == 0.1
    assert felt.t_s[-1] == pytest.approx(0.4, abs=1e-12)
    middle = np.argmin(np.abs(felt.t_s - 0.15))
    # Half-way along a 3-4-5 triangle in 0.1 s.
    assert felt.x_mm[middle] == pytest.approx(1.5)
    assert felt.y_mm[middle] == pytest.approx(2.0)
    assert felt.normal_force_n[middle] == pytest.approx(0.3)
    assert felt.speed_mm_per_s[middle] == pytest.approx(50.0)
    assert felt.speed_mm_per_s[2000] == pytest.approx(100.0)
    assert isinstance(felt, Felt)
    with pytest.raises(AttributeError):
        felt.mu = felt.mu  # type: ignore[misc]


def test_a_standing_finger_has_no_friction_coefficient_and_needs_no_friction(model):
    felt = VirtualFinger(model).feel(
        DRIVE, RATE, [0.0, 0.1, 0.2, 0.3], [0.0, 5.0, 5.0, 5.009], 0.0, 0.5
    )
    stands = felt.t_s >= 0.1
    # The last tenth of a second creeps at 0.09 mm/s, below what counts as sliding.
    assert np.isnan(felt.mu[stands]).all()
    assert (felt.friction_force_n[stands] == 0).all()
    assert (felt.status[stands] == Status.OK).all()
    assert np.isfinite(felt.mu[~stands]).all()
    np.testing.assert_array_equal(felt.is_sliding, ~stands)
    assert np.isfinite(felt.friction_force_n).all()


def test_a_lifted_finger_feels_nothing(model):
    path = [0.0, 0.1, 0.2, 0.3], [0.0, 5.0, 10.0, 15.0], 0.0, [0.5, 0.0, 0.0, 0.5]
    # The drive has been on for a tenth of a second: as it begins, friction rises.
    felt = VirtualFinger(model).feel(DRIVE, RATE, *path, start_s=-0.1)
    lifted = (felt.t_s >= 0.1) & (felt.t_s <= 0.2)
    assert np.isnan(felt.mu[lifted]).all()
    assert (felt.friction_force_n[lifted] == 0).all()
    pressed = felt.normal_force_n > 2e-3
    assert np.isfinite(felt.mu[pressed]).all()
    # Friction force falls with the force that presses.
    assert (np.diff(felt.friction_force_n[:995]) < 0).all()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"drive_v": []}, "drive_v: expected a row of at least 4 numbers, got shape"),
        ({"drive_v": [0.0, np.nan, 0.0, 0.0]}, "drive_v: expected finite numbers, but number 2"),
        ({"drive_v": "loud"}, "drive_v: expected numbers"),
        ({"drive_v": np.zeros((2, 8))}, "drive_v: expected a row of at least 4 numbers, got shape"),
        ({"sample_rate_hz": 0.0}, "sample_rate_hz: expected 100 to 1e"),
        ({"sample_rate_hz": np.nan}, "sample_rate_hz: expected 100 to 1e"),
        ({"sample_rate_hz": 1e9}, "sample_rate_hz: expected 100 to 1e"),
        ({"t_s": [0.0, 0.0]}, "t_s: expected increasing numbers"),
        ({"t_s": [0.0, -1.0]}, "t_s: expected increasing numbers"),
        ({"t_s": [0.0]}, "t_s: expected a row of at least 2 numbers"),
        ({"t_s": [0.0, 1.7e9]}, "check the path's clock"),
        ({"x_mm": [0.0, np.inf]}, "x_mm: expected finite numbers, but number 2 is inf"),
        ({"x_mm": [0.0, 1e300]}, "x_mm: expected places on a screen"),
        ({"y_mm": [0.0, 1.0, 2.0]}, "y_mm: expected one value for each of the 2 times"),
        ({"normal_force_n": [0.5, -0.1]}, r"normal_force_n: expected 0 N \(lifted\) or more"),
        ({"normal_force_n": 1e7}, "normal_force_n: expected a finger's force, 100 N at most"),
        ({"normal_force_n": [0.5, None]}, "normal_force_n: expected"),
        ({"start_s": np.nan}, "start_s: expected a finite number"),
        ({"output_rate_hz": 0.0}, "output_rate_hz: expected 10 Hz or more"),
        ({"output_rate_hz": np.nan}, "output_rate_hz: expected 10 Hz or more"),
        ({"output_rate_hz": 1e12}, "output_rate_hz: expected one that gives"),
        ({"t_s": [0.0, 1e-6]}, "output_rate_hz: expected one that gives"),
    ],
)
def test_what_cannot_be_felt_is_refused_by_name(model, change, message):
    with pytest.raises(InputError, match=message):
        VirtualFinger(model).feel(**{**GOOD, **change})


def test_a_drive_above_the_screens_limit_is_refused(model):
    finger = VirtualFinger(model)
    with pytest.raises(LimitError, match=r"drive_v: 200\.1 V .*200 V"):
        finger.feel(**{**GOOD, "drive_v": [0.0, 200.1, 0.0, 0.0]})
    # What 16 bits may read back above the limit: half a step of 200 V / 32767.
    finger.feel(**{**GOOD, "drive_v": [0.0, 200.003, 0.0, 0.0]})
    with pytest.raises(InputError, match=r"amplitude_v: .*0 V"):
        finger.feel_carrier(
            [-1.0] * 4, 100.0, 4000.0, *(GOOD[k] for k in ("t_s", "x_mm", "y_mm", "normal_force_n"))
        )


def test_what_makes_no_finger_is_refused(model):
    with pytest.raises(InputError, match="h0_m"):
        VirtualFinger(model, h0_m=0.0)
    small = BoundaryElementBox(points=32, surfaces=1)
    with pytest.warns(UserWarning, match="the box holds"):
        slow = ContactModel(
            Finger.preset("semi-wet"),
            Screen.preset("3m-sct3250"),
            fidelity="boundary-element",
            boundary_elements=small,
        )
    with pytest.raises(InputError, match='"boundary-element"'):
        VirtualFinger(slow)


def test_another_insulator_is_felt(model):
    thin, own = (VirtualFinger(model, h0_m=h0).feel(**GOOD) for h0 in (0.8e-7, None))
    np.testing.assert_allclose(
        thin.mu[2500], float(model.solve(0.5, 100.0, 4000.0, 0.8e-7).mu), rtol=1e-4
    )
    assert thin.mu[2500] > own.mu[2500]


def test_float32_models_are_felt(model, stroke):
    import torch

    single = ContactModel(model.finger, model.screen, dtype=torch.float32)
    felt = VirtualFinger(single).feel(**GOOD)
    assert felt.mu.dtype == np.float64
    np.testing.assert_allclose(felt.mu, VirtualFinger(model).feel(**GOOD).mu, rtol=1e-6)
