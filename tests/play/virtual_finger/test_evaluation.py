"""The evaluation of what was felt."""

import numpy as np
import pytest

from haptix import FrictionSurface, InputError, Status
from haptix.model.perception.thresholds import WEBER_FRACTION
from haptix.play.virtual_finger import Felt, VirtualFinger, evaluate

N = 2001
TIME = np.arange(N) / 10_000.0


def felt(mu, status=Status.OK):
    mu = np.broadcast_to(np.asarray(mu, dtype=float), (N,)).copy()
    zero = np.zeros(N)
    return Felt(
        TIME, TIME, zero, zero + 1.0, zero + 0.5, mu, np.nan_to_num(0.5 * mu),
        np.broadcast_to(int(status), (N,)).copy(),
    )  # fmt: skip


def test_a_constant_error_is_itself_in_every_figure():
    evaluation = evaluate(felt(0.33), np.full(N, 0.30))
    for value in (evaluation.error_rms_mu, evaluation.error_p95_mu, evaluation.error_max_mu):
        assert value == pytest.approx(0.03)
    assert evaluation.bias_mu == pytest.approx(0.03)
    # 10 % of the target; the JND is 11 % of it.
    for value in (evaluation.error_rms_jnd, evaluation.error_p95_jnd):
        assert value == pytest.approx(0.1 / WEBER_FRACTION)
    assert evaluation.error_max_jnd == pytest.approx(0.1 / 0.11)
    # A window of 10 samples loses 5 at one end and 4 at the other.
    assert (evaluation.samples, evaluation.evaluated) == (N, N - 9)
    assert evaluate(felt(0.27), np.full(N, 0.30)).bias_mu == pytest.approx(-0.03)


def test_rms_and_percentile_of_a_known_distribution():
    ramp = np.linspace(0.0, 0.02, N)
    evaluation = evaluate(felt(0.3 + ramp), np.full(N, 0.3), average_s=0.0)
    assert evaluation.evaluated == N
    assert evaluation.error_rms_mu == pytest.approx(0.02 / np.sqrt(3), rel=1e-3)
    assert evaluation.error_p95_mu == pytest.approx(0.019, rel=1e-6)
    assert evaluation.error_max_mu == pytest.approx(0.02)


def test_ripple_within_the_window_is_not_felt_and_slower_is():
    fast = felt(0.3 + 0.05 * np.sin(2 * np.pi * 1000.0 * TIME))
    assert evaluate(fast, np.full(N, 0.3)).error_max_mu < 1e-12
    slow = felt(0.3 + 0.05 * np.sin(2 * np.pi * 50.0 * TIME))
    # sinc(0.05) = 0.996 of its peak is left.
    assert evaluate(slow, np.full(N, 0.3)).error_max_mu == pytest.approx(0.05 * 0.9959, rel=1e-3)
    # The wanted one is averaged alike: to want what is felt is no error.
    assert evaluate(slow, slow.mu).error_max_mu == 0.0


def test_windows_side_by_side_leave_out_pulses_of_unlike_height():
    # Pulses sin^2 of 50 Hz from a zero at 3 ms on, each as high as its own target asks.
    step = np.arange(N) - 30
    phase, target = step / 200, 0.3 + 0.02 * (step // 200 % 3)
    pulses = 0.1 + 2 * (target - 0.1) * np.sin(np.pi * phase) ** 2
    periods = evaluate(felt(pulses), target, average_s=0.02, from_s=0.00295)
    assert periods.error_max_mu < 1e-12
    # From between two samples on: 30 samples before the first whole window, 170 after the last.
    assert periods.evaluated == 1800 <= N - 30 - 170
    assert evaluate(felt(pulses), target, average_s=0.02).error_max_mu > 1e-3
    above = evaluate(felt(pulses + 0.03), target, average_s=0.02, from_s=0.00295)
    assert above.bias_mu == pytest.approx(0.03)
    with pytest.raises(InputError, match="average_s"):
        evaluate(felt(pulses), target, average_s=0.0, from_s=0.0)


def test_standing_unreachable_and_snapped_samples_are_counted_and_not_evaluated():
    mu = np.full(N, 0.3)
    mu[:500] = np.nan
    one = felt(mu)
    one.status[500:700] = int(Status.PULL_IN)
    one.status[700:900] = int(Status.BREAKDOWN)
    wanted = np.full(N, 0.3)
    wanted[900:1000] = np.nan
    reachable = np.ones(N, dtype=bool)
    reachable[1000:1300] = False
    # Where it is not evaluated friction is far off.
    one.mu[1000:1300] = 9.0
    one.mu[500:700] = 9.0
    evaluation = evaluate(one, wanted, reachable, average_s=0.0)
    assert evaluation.error_max_mu == 0.0
    assert evaluation.still == 500
    assert evaluation.pull_in == 200
    assert evaluation.breakdown == 200
    assert evaluation.unreachable == 400
    assert evaluation.evaluated == N - 500 - 200 - 400
    # With a window, no sample is evaluated by what lies beyond an edge.
    averaged = evaluate(one, wanted, reachable, average_s=2e-3)
    assert averaged.error_max_mu < 1e-12
    assert averaged.evaluated == evaluation.evaluated - 2 * 19


def test_nothing_to_evaluate_is_nan_and_says_so():
    evaluation = evaluate(felt(np.nan), np.full(N, 0.3))
    assert evaluation.evaluated == 0
    assert evaluation.still == N
    assert np.isnan([evaluation.error_rms_mu, evaluation.error_p95_jnd, evaluation.bias_mu]).all()
    # A window longer than all there is, too.
    assert evaluate(felt(0.3), np.full(N, 0.3), average_s=10.0).evaluated == 0


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"target_mu": np.full(3, 0.3)}, "one value for each of the 2001 times"),
        ({"target_mu": np.zeros(N)}, "finite values above 0, or NaN"),
        ({"target_mu": np.full(N, np.inf)}, "finite values above 0, or NaN"),
        ({"is_reachable": np.ones(N)}, "expected bools"),
        ({"is_reachable": np.ones(3, dtype=bool)}, "is_reachable: expected one value"),
        ({"average_s": -1.0}, "average_s: expected a finite number of at least 0"),
        ({"average_s": np.nan}, "average_s: expected a finite"),
        ({"weber_fraction": 0.0}, "weber_fraction: expected a finite number above 0"),
    ],
)
def test_what_cannot_be_evaluated_is_refused(settings, message):
    given = {"target_mu": np.full(N, 0.3), **settings}
    with pytest.raises(InputError, match=message):
        evaluate(felt(0.3), **given)


def test_a_drive_from_the_surface_is_within_a_quarter_jnd(model):
    """Wanted friction along a path -> surface -> carrier in 16 bits -> the virtual finger."""
    surface = FrictionSurface.build(
        model,
        {"normal_force_n": (0.2, 1.0), "voltage_v": (0.0, 200.0), "frequency_hz": 4000.0},
        tolerance="0.05 JND",
    )
    rate = 48_000
    time = np.arange(rate) / rate
    place = 100.0 * time

    def wanted(x_mm, force_n):
        low = np.asarray(model.solve(force_n, 0.0, 4000.0).mu)
        return low * (1.08 + 0.05 * np.sin(2 * np.pi * x_mm / 5.0))

    force = np.full(rate, 0.5)
    amplitude = surface.voltage(wanted(place, force), force, 4000.0, None).voltage_v.numpy()
    drive = amplitude * np.sin(2 * np.pi * 4000.0 * time)
    drive = np.rint(drive / 200.0 * 32767) / 32767 * 200.0
    finger = VirtualFinger(model)
    path = ([0.002, 0.998], [0.2, 99.8], 0.0, 0.5)
    felt_all = finger.feel(drive, rate, *path)
    evaluation = evaluate(felt_all, wanted(felt_all.x_mm, felt_all.normal_force_n))
    # The surface has 0.05 JND, and 11.5 um on waves of 5 mm are 1.4 % of a swing of 5 %.
    assert evaluation.error_p95_jnd < 0.06
    assert evaluation.evaluated > 0.98 * evaluation.samples
    # The reverse texture is told apart at once.
    other = evaluate(felt_all, wanted(felt_all.x_mm + 2.5, felt_all.normal_force_n))
    assert other.error_p95_jnd > 0.5
