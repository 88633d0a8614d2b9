"""Raw force to friction: against what was put in."""

import numpy as np
import pytest

import haptix
from calibration import Reduced, Stroke, reduce_session
from calibration.measure.reduction import Point, reduce_stroke, without_drift
from calibration.measure.segmentation import full_slip, sliding_speed


def stroke(number=1, both=True, hertz=125.0, volts=100.0, force=0.5):
    return Stroke(
        number=number,
        normal_force_n=force,
        voltage_v=volts,
        frequency_hz=hertz,
        there_and_back=both,
    )


@pytest.mark.parametrize("hertz", [30.0, 125.0, 700.0])
@pytest.mark.parametrize("force", [0.1, 0.9])
def test_friction_and_ripple_are_what_was_put_in(recorded, hertz, force):
    one = stroke(hertz=hertz, force=force)
    made = recorded(one, 0.42, 0.2, crosstalk=0.02, drift_n_per_s=5e-3, offset_n=0.01, tremor=0.04)
    found = reduce_stroke(made)
    # The normal axis's cross-talk changes sign with the direction: 0.02 mu, squared, is left.
    assert found.mu == pytest.approx(0.42, rel=5e-4, abs=4 * found.mu_sd)
    assert found.ripple == pytest.approx(0.2, abs=3 * found.ripple_sd)
    assert found.mu_sd < 0.01 * found.mu
    assert found.ripple_sd < 0.03 * found.ripple
    # 0.02 F on the tangential axis: and of the friction itself on the normal one, mu^2 as much.
    assert found.crosstalk == pytest.approx(0.02 * (1 - 0.42**2), rel=0.1)
    assert found.normal_force_n == pytest.approx(force, rel=0.02)
    assert (found.voltage_v, found.speed_mm_per_s) == pytest.approx((100, 50), rel=1e-3)


def test_one_way_strokes_take_the_certificate_s_crosstalk(recorded):
    made = recorded(stroke(both=False), 0.3, 0.0, crosstalk=0.02)
    plain, corrected = reduce_stroke(made), reduce_stroke(made, crosstalk=0.02)
    assert plain.mu == pytest.approx(0.3 + 0.02, rel=0.01)
    assert corrected.mu == pytest.approx(0.3, rel=0.01)


def test_errors_are_as_large_as_they_say(recorded):
    pulls, ripple_pulls = [], []
    for seed in range(40):
        made = recorded(stroke(force=0.1), 0.3, 0.05, noise_n=0.02, seed=seed, rate_hz=3000.0)
        found = reduce_stroke(made)
        pulls.append((found.mu - 0.3) / found.mu_sd)
        ripple_pulls.append((found.ripple - 0.05) / found.ripple_sd)
    # 40 draws of a unit normal have a spread within 0.66 to 1.4 in 99.9 % of cases; the errors
    # hold a share for the gain of the sensor besides, which this one has not.
    assert 0.4 < np.std(pulls) < 1.4
    assert 0.4 < np.std(ripple_pulls) < 1.4
    assert abs(np.mean(pulls)) < 0.6
    assert abs(np.mean(ripple_pulls)) < 0.6


def test_drift_comes_off(recorded):
    made = recorded(stroke(), drift_n_per_s=0.02, offset_n=0.05, noise_n=0.0)
    normal = without_drift(made, 0.3).normal_force_n
    truth = recorded(stroke(), noise_n=0.0).normal_force_n
    np.testing.assert_allclose(normal, truth, atol=1e-9)


def test_without_voltage_there_is_no_ripple(recorded):
    found = reduce_stroke(recorded(stroke(volts=0.0), 0.3, 0.0))
    assert np.isnan(found.ripple)
    assert found.voltage_v == 0


def test_outliers_are_named_and_the_others_kept(recorded):
    good = recorded(stroke(1))
    still = recorded(stroke(2), way_share=0.0)
    backwards = recorded(stroke(3), mu=-0.3)
    reduced = reduce_session([still, good, backwards])
    assert [point.number for point in reduced.used] == [1]
    reasons = {point.number: point.outlier for point in reduced.outliers}
    assert reasons[2].startswith("no sliding: ")
    assert reasons[3].startswith("wrong sign: ")


def test_round_trip(tmp_path, recorded):
    points = [reduce_stroke(recorded(stroke(number), offset_n=3.0)) for number in (1, 2)]
    nan = float("nan")
    points.append(
        Point(3, 0.5, 0.0, 125.0, 50.0, nan, nan, nan, nan, held_out=True, outlier="a, b")
    )
    made = Reduced(tuple(points))
    made.save(tmp_path / "reduced.csv")
    found = Reduced.load(tmp_path / "reduced.csv")
    assert repr(found) == repr(made)  # NaN is not equal to itself


def test_a_table_that_is_none(tmp_path, recorded):
    path = tmp_path / "x.csv"
    path.write_text("a,b\n1,2\n")
    with pytest.raises(haptix.HaptixError, match=r"x\.csv: .*number, normal_force_n"):
        Reduced.load(path)
    Reduced((reduce_stroke(recorded(stroke())),)).save(path)
    path.write_text(path.read_text().replace("\n1,", "\none,"))
    with pytest.raises(haptix.HaptixError, match=r"x\.csv: .*reduced"):
        Reduced.load(path)


def test_nothing_to_reduce():
    with pytest.raises(haptix.InputError, match="measure first"):
        reduce_session([])


def test_speed_is_that_of_a_straight_line():
    t = 1e6 + np.arange(0.0, 1.0, 1e-3)  # a clock that has run for days
    np.testing.assert_allclose(sliding_speed(t, -30 * (t - t[0]))[20:-20], -30, rtol=1e-6)


def test_slip_leaves_starts_stops_and_lifts_out():
    t = np.arange(0, 3, 1e-3)
    x = np.interp(t, [0.5, 1.3, 1.6, 2.4], [0, 40, 40, 0])
    force = np.where(t > 1.0, 0.5, 0.0)  # touches in the middle of the first stroke
    first, second = full_slip(t, x, force)
    assert (first.direction, second.direction) == (1, -1)
    assert x[first.start] == pytest.approx(25 + 4, abs=0.3)
    assert x[first.stop - 1] == pytest.approx(40 - 1.5, abs=0.6)  # 20 ms blur the end
    assert x[second.start] == pytest.approx(40 - 4, abs=0.6)


def test_nothing_slides():
    t = np.arange(0, 1, 1e-3)
    assert full_slip(t, np.zeros_like(t)) == []
