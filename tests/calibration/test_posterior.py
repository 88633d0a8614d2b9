"""The mixture that strokes leave possible: closed forms, limits, and truths drawn from it."""

import numpy as np
import pytest
from scipy.stats import norm
from scipy.stats import t as student

from calibration.fit.result import Input, Posterior

ALONG = np.ones(1)


def posterior(others=(), odds=(), measured=0.0, freedom=1e9, sd=0.2):
    return Posterior(
        np.array([1.0]),
        np.array([[sd**2]]),
        (Input("what was known", 1.0, sd * np.sqrt([1 - measured])),),
        freedom,
        np.array(others, dtype=float).reshape(len(others), 1),
        np.array(odds, dtype=float),
    )


def test_a_single_component_is_student_s_interval():
    low, high = posterior(measured=1.0, freedom=5.0).interval(ALONG, 0.9)
    half = 0.2 * student.ppf(0.95, 5)
    assert (low, high) == pytest.approx((1 - half, 1 + half), rel=1e-9)


def test_a_prior_has_no_few_degrees_of_freedom():
    low, high = posterior(measured=0.0, freedom=3.0).interval(ALONG, 0.9)
    assert high - low == pytest.approx(2 * 0.2 * norm.ppf(0.95), rel=1e-3)


def test_two_forms_far_apart_have_an_end_each():
    # Each end leaves a twentieth of all, that is a tenth of its own component.
    low, high = posterior([3.0], [1.0]).interval(ALONG, 0.9)
    assert low == pytest.approx(1 + 0.2 * norm.ppf(0.1), rel=1e-4)
    assert high == pytest.approx(3 + 0.2 * norm.ppf(0.9), rel=1e-4)
    covariance = posterior([3.0], [1.0]).covariance[0, 0]
    assert covariance == pytest.approx(0.2**2 + 0.5 * 2.0**2)


def test_the_fit_lies_within_even_where_another_form_is_far_more_likely():
    low, high = posterior([3.0], [1e9]).interval(ALONG, 0.9)
    assert low == 1.0
    assert high == pytest.approx(3 + 0.2 * norm.ppf(0.95), rel=1e-4)


def test_truths_drawn_from_the_mixture_lie_within_as_often_as_stated():
    odds = np.array([0.6, 0.3])
    middles = np.array([1.0, 1.5, 0.2])
    low, high = posterior([[1.5], [0.2]], odds).interval(ALONG, 0.9)
    rng = np.random.default_rng(1)
    chosen = rng.choice(3, 40_000, p=np.array([1.0, *odds]) / (1 + odds.sum()))
    truths = middles[chosen] + 0.2 * rng.normal(size=len(chosen))
    # Of 40 000 draws the share scatters by 0.0015.
    assert np.mean((low <= truths) & (truths <= high)) == pytest.approx(0.9, abs=0.006)
