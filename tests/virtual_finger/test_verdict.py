"""The verdict on what was felt."""

import numpy as np
import pytest

from haptix import FrictionSurface, InputError, Status
from haptix.perception import WEBER_FRACTION
from haptix.virtual_finger import Felt, VirtualFinger, judge

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
    verdict = judge(felt(0.33), np.full(N, 0.30))
    for value in (verdict.error_rms_mu, verdict.error_p95_mu, verdict.error_max_mu):
        assert value == pytest.approx(0.03)
    assert verdict.bias_mu == pytest.approx(0.03)
    # 10 % of what was wanted, and 11 % can just be told.
    for value in (verdict.error_rms_thresholds, verdict.error_p95_thresholds):
        assert value == pytest.approx(0.1 / WEBER_FRACTION)
    assert verdict.error_max_thresholds == pytest.approx(0.1 / 0.11)
    # A window of 10 samples loses 5 at one end and 4 at the other.
    assert (verdict.samples, verdict.judged) == (N, N - 9)
    assert verdict.share_judged == pytest.approx(1.0, abs=0.01)
    assert judge(felt(0.27), np.full(N, 0.30)).bias_mu == pytest.approx(-0.03)


def test_rms_and_percentile_of_a_known_distribution():
    ramp = np.linspace(0.0, 0.02, N)
    verdict = judge(felt(0.3 + ramp), np.full(N, 0.3), average_s=0.0)
    assert verdict.judged == N
    assert verdict.error_rms_mu == pytest.approx(0.02 / np.sqrt(3), rel=1e-3)
    assert verdict.error_p95_mu == pytest.approx(0.019, rel=1e-6)
    assert verdict.error_max_mu == pytest.approx(0.02)


def test_ripple_within_the_window_is_not_felt_and_slower_is():
    fast = felt(0.3 + 0.05 * np.sin(2 * np.pi * 1000.0 * TIME))
    assert judge(fast, np.full(N, 0.3)).error_max_mu < 1e-12
    slow = felt(0.3 + 0.05 * np.sin(2 * np.pi * 50.0 * TIME))
    # sinc(0.05) = 0.996 of its peak is left.
    assert judge(slow, np.full(N, 0.3)).error_max_mu == pytest.approx(0.05 * 0.9959, rel=1e-3)
    # The wanted one is averaged alike: to want what is felt is no error.
    assert judge(slow, slow.mu).error_max_mu == 0.0


def test_standing_unreachable_and_snapped_samples_are_counted_and_not_judged():
    mu = np.full(N, 0.3)
    mu[:500] = np.nan
    one = felt(mu)
    one.status[500:700] = int(Status.PULL_IN)
    one.status[700:900] = int(Status.BREAKDOWN)
    wanted = np.full(N, 0.3)
    wanted[900:1000] = np.nan
    reachable = np.ones(N, dtype=bool)
    reachable[1000:1300] = False
    # Where it is not to be judged friction is far off.
    one.mu[1000:1300] = 9.0
    one.mu[500:700] = 9.0
    verdict = judge(one, wanted, reachable, average_s=0.0)
    assert verdict.error_max_mu == 0.0
    assert verdict.still == 500
    assert verdict.pull_in == 200
    assert verdict.breakdown == 200
    assert verdict.unreachable == 400
    assert verdict.judged == N - 500 - 200 - 400
    # With a window, no sample is judged by what lies beyond an edge.
    averaged = judge(one, wanted, reachable, average_s=2e-3)
    assert averaged.error_max_mu < 1e-12
    assert averaged.judged == verdict.judged - 2 * 19


def test_nothing_to_judge_is_nan_and_says_so():
    verdict = judge(felt(np.nan), np.full(N, 0.3))
    assert verdict.judged == 0
    assert verdict.still == N
    assert np.isnan([verdict.error_rms_mu, verdict.error_p95_thresholds, verdict.bias_mu]).all()
    # A window longer than all there is, too.
    assert judge(felt(0.3), np.full(N, 0.3), average_s=10.0).judged == 0


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"wanted_mu_at_true_position": np.full(3, 0.3)}, "one value for each of the 2001 times"),
        ({"wanted_mu_at_true_position": np.zeros(N)}, "finite values above 0, or NaN"),
        ({"wanted_mu_at_true_position": np.full(N, np.inf)}, "finite values above 0, or NaN"),
        ({"is_reachable": np.ones(N)}, "expected bools"),
        ({"is_reachable": np.ones(3, dtype=bool)}, "is_reachable: expected one value"),
        ({"average_s": -1.0}, "average_s of 0 or more"),
        ({"average_s": np.nan}, "average_s: expected finite"),
        ({"weber_fraction": 0.0}, "weber_fraction above 0"),
    ],
)
def test_what_cannot_be_judged_is_refused(settings, message):
    given = {"wanted_mu_at_true_position": np.full(N, 0.3), **settings}
    with pytest.raises(InputError, match=message):
        judge(felt(0.3), **given)


def test_a_drive_from_the_surface_is_within_a_quarter_threshold(model):
    """Wanted friction along a path -> surface -> carrier in 16 bits -> the virtual finger."""
    surface = FrictionSurface.build(
        model,
        {"normal_force_n": (0.2, 1.0), "voltage_v": (0.0, 200.0), "frequency_hz": 4000.0},
        tolerance="0.05 thresholds",
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
    verdict = judge(felt_all, wanted(felt_all.x_mm, felt_all.normal_force_n))
    # The surface has 0.05 thresholds, and 11.5 um on waves of 5 mm are 1.4 % of a swing of 5 %.
    assert verdict.error_p95_thresholds < 0.06
    assert verdict.share_judged > 0.98
    # The reverse texture is told apart at once.
    other = judge(felt_all, wanted(felt_all.x_mm + 2.5, felt_all.normal_force_n))
    assert other.error_p95_thresholds > 0.5
