"""Force from the axis, from the area, or assumed."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptix import Finger, InputError
from haptix.play.touch import AreaProxy, ForceModel

PROXY = AreaProxy(1e-4, 0.5, 0.2)


def test_the_axis_comes_before_the_area_and_the_area_before_the_assumption():
    model = ForceModel(0.4, 0.3, 0.05, PROXY)
    found = model.estimate(0.8, 1e-4)
    assert found is not None
    assert list(found) == [0.8, pytest.approx(0.04), "axis"]
    found = model.estimate(None, 1e-4)
    assert found.source == "area"
    assert found.normal_force_n == pytest.approx(1.0)
    assert model.estimate(None, None) is None
    assert model.assumed == (0.4, 0.3, "assumed")
    # A screen that reports areas is of no use without a calibration.
    assert ForceModel().estimate(None, 1e-4) is None


def test_the_law_by_hand():
    # Half the area of 1 N under area ~ sqrt(F) is a quarter of the force.
    assert PROXY.force(0.5e-4).normal_force_n == pytest.approx(0.25)


def test_sigma_is_that_of_a_log_normal():
    random = np.random.default_rng(1)
    sample = np.exp(random.normal(math.log(0.25), 0.2, 400_000))
    # The standard deviation of a sample of that size is known to 0.2 %.
    assert PROXY.force(0.5e-4).sigma_n == pytest.approx(sample.std(), rel=0.01)


@pytest.mark.parametrize("area", [1e-9, 1e-5, 1.0, 1e300])
def test_an_area_beyond_belief_is_not_used(area):
    assert PROXY.force(area) is None


@given(st.floats(2e-5, 3e-4), st.floats(2e-5, 3e-4))
def test_more_area_is_more_force(a, b):
    small, large = sorted((a, b))
    assert PROXY.force(small).normal_force_n <= PROXY.force(large).normal_force_n


def test_a_fit_recovers_law_and_spread():
    random = np.random.default_rng(2)
    force = np.exp(random.uniform(math.log(0.1), math.log(2.0), 4000))
    spread = 0.25
    # Noise in force about the law, as the fit takes it.
    area = 8e-5 * (force * np.exp(random.normal(0, spread, force.size))) ** 0.4
    found = AreaProxy.fit(area, force)
    wanted = np.polyfit(np.log(area), np.log(force), 1)  # an independent least squares
    assert 1 / found.exponent == pytest.approx(wanted[0], rel=1e-9)
    at_1n = math.exp(-wanted[1] / wanted[0])
    assert found.area_at_1n_m2 == pytest.approx(at_1n, rel=1e-9)
    residual = np.log(force) - np.polyval(wanted, np.log(area))
    assert found.log_sigma == pytest.approx(residual.std(ddof=2), rel=1e-9)
    assert found.force_range_n == (force.min() / 2, 2 * force.max())
    # Two in three of forces are within one sigma of what their area says.
    inside = [
        abs(math.log(f / found.force(float(a)).normal_force_n)) < found.log_sigma
        for f, a in zip(force, area, strict=True)
    ]
    assert np.mean(inside) == pytest.approx(0.683, abs=0.03)


def test_a_fit_without_noise_is_the_law_of_the_finger():
    finger = Finger.preset("semi-wet")
    force = np.array([0.1, 0.3, 0.9])
    area = finger.apparent_area_at_1n_m2 * force**finger.apparent_area_exponent
    found = AreaProxy.fit(area, force)
    assert found.area_at_1n_m2 == pytest.approx(finger.apparent_area_at_1n_m2, rel=1e-9)
    assert found.exponent == pytest.approx(finger.apparent_area_exponent, rel=1e-9)
    assert found.log_sigma < 1e-7


@pytest.mark.parametrize(
    ("area", "force", "words"),
    [
        ([1e-4, 2e-4], [1, 2], "3 pairs"),
        ([1e-4, 2e-4, 3e-4], [1, 2], "one length"),
        ([1e-4, 0, 3e-4], [1, 2, 3], r"contact_area_m2 of pair 2.*got 0"),
        ([1e-4, 2e-4, 3e-4], [1, 2, math.nan], r"normal_force_n: .* number 3 is nan"),
        ([1e-4, 1e-4, 1e-4], [1, 2, 3], "grow with force"),
        ([3e-4, 2e-4, 1e-4], [1, 2, 3], "grow with force"),
    ],
)
def test_pairs_that_cannot_be_fitted(area, force, words):
    with pytest.raises(InputError, match=words):
        AreaProxy.fit(area, force)


@pytest.mark.parametrize(
    ("make", "word"),
    [
        (lambda: AreaProxy(0.0, 0.5, 0.2), "area_at_1n_m2"),
        (lambda: AreaProxy(1e-4, -1, 0.2), "exponent"),
        (lambda: AreaProxy(1e-4, 0.5, math.nan), "log_sigma"),
        (lambda: AreaProxy(1e-4, 0.5, 0.2, (2.0, 1.0)), "force_range_n"),
        (lambda: ForceModel(0.0), "assumed_n"),
        (lambda: ForceModel(assumed_sigma_n=-1), "assumed_sigma_n"),
        (lambda: ForceModel(axis_sigma=math.inf), "axis_sigma"),
    ],
)
def test_models_that_cannot_be(make, word):
    with pytest.raises(InputError, match=word):
        make()
