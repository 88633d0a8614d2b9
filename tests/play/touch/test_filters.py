"""The filters against textbooks, and what holds for any input."""

import math
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import expm, solve_discrete_are

from haptix import InputError
from haptix.base.native import ffi, library
from haptix.play.touch import (
    ConstantVelocityKalman,
    InteractingSinger,
    OneEuroFilter,
    SingerKalman,
    TouchSettings,
)

FILTERS: dict[str, Any] = {
    "Kalman": ConstantVelocityKalman(),
    "One-Euro": OneEuroFilter(),
    "Singer": SingerKalman(),
    "Two Singers": InteractingSinger(),
}
NOISE = 0.1
WHITE = ConstantVelocityKalman(3e4, NOISE, 50.0)
SINGER = SingerKalman(500.0, 0.0, 0.25, NOISE, 50.0, noise_reports=0)


MEAN, COVARIANCE, VARIANCE, WEIGHT = slice(1, 7), slice(7, 13), 13, 15
"""Of a state: x, y, vx, vy, ax, ay; xx, xv, xa, vv, va, aa; noise; weight of the gentle model."""


def step(place_filter, state, report):
    """State after a report, all of its numbers; after the first one without a state."""
    settings = TouchSettings(filter=place_filter).compiled()[0]
    after = ffi.new("hx_filtered *")
    if state is None:
        library.hx_filter_start(settings, *report, after)
    else:
        ffi.buffer(after)[:] = np.array(state[:-1]).tobytes() + np.int64(state[-1]).tobytes()
        library.hx_filter_step(settings, after, *report)
    numbers = np.frombuffer(ffi.buffer(after), np.float64)[:-1].tolist()
    return (*numbers, after.recents)


def run(place_filter, reports):
    states = [None]
    for report in reports:
        states.append(step(place_filter, states[-1], report))
    return states[1:]


def ahead_of(place_filter, state, ahead_s):
    """Place and velocity some time after a state's report."""
    lasting_s = getattr(place_filter, "correlation_s", 1.0)
    track = ffi.new("hx_track *", (0.0, *state[MEAN], lasting_s))
    track.rests_s = 1e9
    following, place = ffi.new("hx_following *", (0.0, 1e9, 1.0, 1.0)), ffi.new("double[4]")
    library.hx_finger_place(following, track, ahead_s, place)
    return tuple(place)


def irregular(seed, count=60):
    random = np.random.default_rng(seed)
    t = np.cumsum(random.uniform(0.002, 0.05, count))
    places = np.cumsum(random.normal(0, 2, (count, 2)), axis=0)
    return [(float(a), float(x), float(y)) for a, (x, y) in zip(t, places, strict=True)]


def textbook(model, first, reports):
    """Means (n, states, 2) and covariances of a Kalman filter in matrices."""
    measured = np.zeros((1, len(first)))
    measured[0, 0] = 1
    mean = np.zeros((len(first), 2))
    mean[0] = reports[0][1:]
    covariance = np.diag(first)
    means, covariances = [mean], [covariance]
    for before, report in pairwise(reports):
        transition, process = model(report[0] - before[0])
        mean = transition @ mean
        covariance = transition @ covariance @ transition.T + process
        innovation = measured @ covariance @ measured.T + NOISE**2
        gain = covariance @ measured.T @ np.linalg.inv(innovation)
        mean = mean + gain @ (np.array([report[1:]]) - measured @ mean)
        # Joseph's form, another one than that of the code.
        rest = np.eye(len(first)) - gain @ measured
        covariance = rest @ covariance @ rest.T + NOISE**2 * gain @ gain.T
        means.append(mean)
        covariances.append(covariance)
    return np.array(means), np.array(covariances)


def white_acceleration(dt):
    process = WHITE.acceleration_psd * np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]])
    return np.array([[1, dt], [0, 1]]), process


def singer(dt):
    """Singer's process exactly, by Van Loan's matrix exponential."""
    tau, sigma = SINGER.correlation_s, SINGER.acceleration_mm_s2
    drift = np.array([[0, 1, 0], [0, 0, 1], [0, 0, -1 / tau]])
    spread = np.diag([0, 0, 2 * sigma**2 / tau])
    block = expm(np.block([[-drift, spread], [np.zeros((3, 3)), drift.T]]) * dt)
    transition = block[3:, 3:].T
    return transition, transition @ block[:3, 3:]


@pytest.mark.parametrize("seed", range(3))
def test_constant_velocity_against_matrices(seed):
    reports = irregular(seed)
    means, covariances = textbook(white_acceleration, [NOISE**2, 50.0**2], reports)
    found = np.array(run(WHITE, reports))
    # Rounding of two orders of the same sums.
    np.testing.assert_allclose(found[:, 1:3], means[:, 0], rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(found[:, 3:5], means[:, 1], rtol=1e-9, atol=1e-7)
    upper = covariances[:, [0, 0, 1], [0, 1, 1]]
    np.testing.assert_allclose(found[:, [7, 8, 10]], upper, rtol=1e-8, atol=1e-12)


@pytest.mark.parametrize("seed", range(3))
def test_singer_against_matrices(seed):
    reports = irregular(seed)
    first = [NOISE**2, 50.0**2, SINGER.acceleration_mm_s2**2]
    means, _ = textbook(singer, first, reports)
    found = np.array([state[:7] for state in run(SINGER, reports)])
    # The code's noise is the exact one to first order in dt / tau, here 0.2 at most. It decides how
    # reports are weighted, so the difference is a small part of what a filter does to a report.
    moved = np.abs(means[1:, 0] - np.array(reports)[1:, 1:]).max()
    assert np.abs(found[:, 1:3] - means[:, 0]).max() < 0.05 * moved
    speeds = np.abs(means[:, 1]).max()
    assert np.abs(found[:, 3:5] - means[:, 1]).max() < 0.05 * speeds


def test_two_alike_are_one():
    """With the gentle one as agile as the other, whatever their weights."""
    alike = InteractingSinger(500.0, 3.0, 0.25, gentle=math.nextafter(1.0, 0.0))
    one = run(SingerKalman(500.0, 3.0, 0.25), irregular(7))
    two = run(alike, irregular(7))
    # Rounding of means of two that are equal.
    np.testing.assert_allclose([s[:7] for s in two], [s[:7] for s in one], rtol=1e-9, atol=1e-9)


def test_two_against_the_published_recursion():
    """Mixing, both filters and their weights in matrices, for one axis that moves."""
    two = InteractingSinger(500.0, 0.0, 0.25, NOISE, 50.0, noise_reports=0, gentle=0.2, stay=0.9)
    reports = [(0.01 * i, 80 * 0.01 * i + 0.3 * math.sin(i), 0.0) for i in range(30)]
    switch = np.array([[0.9, 0.1], [0.1, 0.9]])
    singles = [SingerKalman(500.0 * share, 0.0, 0.25, NOISE, 50.0) for share in (0.2, 1.0)]
    weights = np.array([0.5, 0.5])
    means = np.zeros((2, 3, 2))
    covariances = np.array(
        [np.diag([NOISE**2, 50.0**2, (500.0 * share) ** 2]) for share in (0.2, 1.0)]
    )
    for found, report in zip(run(two, reports)[1:], reports[1:], strict=True):
        predicted = switch.T @ weights
        mixing = switch * weights[:, None] / predicted
        mixed, likely = [], []
        for j, single in enumerate(singles):
            mean = np.einsum("i,ixa->xa", mixing[:, j], means)
            apart = means - mean
            # One covariance serves both axes: the spread is their mean.
            spread = np.einsum("ixa,iya->ixy", apart, apart) / 2
            covariance = np.einsum("i,ixy->xy", mixing[:, j], covariances + spread)
            state = (
                report[0] - 0.01, *mean.ravel(), *covariance[np.triu_indices(3)],
                NOISE**2, 6.0, *(0.0,) * 40, 1,
            )  # fmt: skip
            after = step(single, state, report)
            innovation = np.array(report[1:]) - mean[0] - 0.01 * mean[1]
            to_place = 0.25 * (0.01 - 0.25 * (1 - math.exp(-0.04)))
            innovation -= to_place * mean[2]
            total = NOISE**2 / (1 - after[7] / NOISE**2)  # the gain tells the covariance
            likely.append(math.exp(-0.5 * innovation @ innovation / total) / total)
            mixed.append(after)
        weights = predicted * likely / (predicted @ likely)
        means = np.array([np.reshape(after[MEAN], (3, 2)) for after in mixed])
        for n, after in enumerate(mixed):
            covariances[n][np.triu_indices(3)] = after[COVARIANCE]
            covariances[n] = np.triu(covariances[n]) + np.triu(covariances[n], 1).T
        np.testing.assert_allclose(found[WEIGHT], weights[0], rtol=1e-6)
        wanted = np.einsum("i,ixa->xa", weights, means)
        np.testing.assert_allclose(found[MEAN], wanted.ravel(), rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize(
    ("place_filter", "model", "states"),
    [(WHITE, white_acceleration, 2), (SINGER, singer, 3)],
    ids=["Kalman", "Singer"],
)
def test_steady_state_solves_the_riccati_equation(place_filter, model, states):
    dt = 0.01
    transition, process = model(dt)
    measured = np.zeros((1, states))
    measured[0, 0] = 1
    before = solve_discrete_are(transition.T, measured.T, process, np.array([[NOISE**2]]))
    gain = before[:, 0] / (before[0, 0] + NOISE**2)
    state = run(place_filter, [(i * dt, 0.0, 0.0) for i in range(400)])[-1]
    # One report 1 mm off moves the state by the gain.
    moved = step(place_filter, state, (400 * dt, 1.0, 0.0))
    tolerance = 1e-9 if states == 2 else 0.02  # of Singer's noise: dt / tau = 0.04
    np.testing.assert_allclose(moved[1:7:2][:states], gain, rtol=tolerance)


def one_euro_as_published(reports, min_cutoff, beta, derivative_cutoff):
    """Algorithms 1 and 2 of Casiez, Roussel and Vogel (CHI 2012), one axis."""

    def alpha(cutoff, dt):
        return 1 / (1 + (1 / (2 * math.pi * cutoff)) / dt)

    smooth = reports[0][1]
    derivative = 0.0
    result = [smooth]
    for (t0, _, _), (t, x, _) in pairwise(reports):
        dt = t - t0
        weight = alpha(derivative_cutoff, dt)
        derivative = weight * (x - smooth) / dt + (1 - weight) * derivative
        weight = alpha(min_cutoff + beta * abs(derivative), dt)
        smooth = weight * x + (1 - weight) * smooth
        result.append(smooth)
    return result


@pytest.mark.parametrize("constants", [(1.0, 0.0, 1.0), (5.0, 1.0, 36.0), (0.3, 0.02, 4.0)])
def test_one_euro_on_one_axis_is_the_published_one(constants):
    reports = [(t, x, 7.0) for t, x, _ in irregular(5)]
    cutoff, beta, derivative = constants
    found = run(OneEuroFilter(cutoff, beta, derivative), reports)
    np.testing.assert_allclose(
        [state[1] for state in found],
        one_euro_as_published(reports, *constants),
        rtol=1e-12,
        atol=1e-12,
    )
    assert {state[2] for state in found} == {7.0}


@pytest.mark.parametrize("name", FILTERS)
def test_steady_motion_is_found(name):
    # Without noise and after a second the velocity is exact, up to what has not yet decayed.
    reports = [(0.01 * i, 3 + 0.8 * i, 5 - 0.6 * i) for i in range(200)]
    place_filter = FILTERS[name]
    state = run(place_filter, reports)[-1]
    np.testing.assert_allclose(state[3:5], (80.0, -60.0), rtol=1e-3)
    if name == "One-Euro":
        return  # lags by its time constant, as published
    ahead = ahead_of(place_filter, state, 0.03)
    np.testing.assert_allclose(ahead, (164.6, -116.2, 80.0, -60.0), rtol=1e-3)


@pytest.mark.parametrize("name", FILTERS)
def test_ahead_by_nothing_is_the_state(name):
    state = run(FILTERS[name], irregular(1))[-1]
    assert ahead_of(FILTERS[name], state, 0.0) == state[1:5]


coordinates = st.floats(-500, 500)
paths = st.lists(
    st.tuples(st.floats(1e-3, 0.08), coordinates, coordinates), min_size=2, max_size=12
)


def in_time(steps):
    t = np.cumsum([dt for dt, _, _ in steps]).tolist()
    return [(a, x, y) for a, (_, x, y) in zip(t, steps, strict=True)]


def close(found, wanted, scale):
    # Velocities hold differences of places over a millisecond at least: 1e3 times their rounding.
    np.testing.assert_allclose(found, wanted, rtol=1e-7, atol=1e-9 * scale)


@pytest.mark.parametrize("name", FILTERS)
@settings(deadline=None, max_examples=40)
@given(steps=paths, dx=coordinates, dy=coordinates)
def test_moving_the_screen_moves_the_result(name, steps, dx, dy):
    reports = in_time(steps)
    here = run(FILTERS[name], reports)[-1]
    there = run(FILTERS[name], [(t, x + dx, y + dy) for t, x, y in reports])[-1]
    close(there[1:3], (here[1] + dx, here[2] + dy), 1e3)
    close(there[3:5], here[3:5], 1e6)


@pytest.mark.parametrize("name", FILTERS)
@settings(deadline=None, max_examples=40)
@given(steps=paths, angle=st.floats(-4, 4))
def test_turning_the_screen_turns_the_result(name, steps, angle):
    reports = in_time(steps)
    c, s = math.cos(angle), math.sin(angle)
    here = run(FILTERS[name], reports)[-1]
    there = run(FILTERS[name], [(t, c * x - s * y, s * x + c * y) for t, x, y in reports])[-1]
    close(there[1:3], (c * here[1] - s * here[2], s * here[1] + c * here[2]), 1e3)
    close(there[3:5], (c * here[3] - s * here[4], s * here[3] + c * here[4]), 1e6)


@pytest.mark.parametrize("name", FILTERS)
@settings(deadline=None, max_examples=40)
@given(steps=paths, days=st.integers(-300, 300))
def test_any_clock_will_do(name, steps, days):
    # Times in 1/8192 s and whole seconds are exact in a float, so nothing is rounded.
    reports = [(round(t * 8192) / 8192, x, y) for t, x, y in in_time(steps)]
    later = [(t + 86400.0 * days, x, y) for t, x, y in reports]
    known = slice(1, 40)  # behind them Singer's filters keep the last reports with times
    assert run(FILTERS[name], later)[-1][known] == run(FILTERS[name], reports)[-1][known]


@pytest.mark.parametrize("name", FILTERS)
@settings(deadline=None, max_examples=60)
@given(
    steps=st.lists(
        # Intervals as a tracker passes on: 10 us at least, and lost after a while.
        st.tuples(st.floats(1e-5, 10), st.floats(-1e4, 1e4), st.floats(-1e4, 1e4)),
        min_size=1,
        max_size=20,
    ),
    ahead=st.floats(-0.1, 1),
)
def test_finite_for_everything_finite(name, steps, ahead):
    place_filter = FILTERS[name]
    state = run(place_filter, in_time(steps))[-1]
    assert np.isfinite(state).all()
    assert np.isfinite(ahead_of(place_filter, state, ahead)).all()


@pytest.mark.parametrize("place_filter", [WHITE, SINGER, SingerKalman()])
@settings(deadline=None, max_examples=40)
@given(steps=st.lists(st.floats(1e-5, 10), min_size=1, max_size=30))
def test_covariances_stay_covariances(place_filter, steps):
    state = run(place_filter, [(t, 0.0, 0.0) for t in np.cumsum(steps).tolist()])[-1]
    if place_filter is WHITE:
        matrix = np.array(state)[[7, 8, 8, 10]].reshape(2, 2)
    else:
        matrix = np.array(state)[[7, 8, 9, 8, 10, 11, 9, 11, 12]].reshape(3, 3)
    scale = np.sqrt(np.diag(matrix).clip(1e-30))
    assert np.linalg.eigvalsh(matrix / np.outer(scale, scale)).min() > -1e-6
    assert 0 < matrix[0, 0] <= NOISE**2 * (1 + 1e-12)  # a report never makes it worse than itself


@pytest.mark.parametrize("name", FILTERS)
@settings(deadline=None, max_examples=40)
@given(speeds=st.lists(st.floats(0, 300), min_size=2, max_size=30))
def test_between_reports_one_euro_does_not_overshoot(name, speeds):
    # A finger that only goes right: One-Euro, a weighted mean, never goes left. (Kalman filters
    # may: they know momentum.) All of them stay on the line.
    x = np.cumsum(np.array(speeds) * 0.01).tolist()
    states = run(FILTERS[name], [(0.01 * i, a, 2.0) for i, a in enumerate(x)])
    np.testing.assert_allclose([state[2] for state in states], 2.0, rtol=0, atol=1e-9)
    if name == "One-Euro":
        places = np.array([state[1] for state in states])
        assert (np.diff(places) >= -1e-9).all()
        assert (places <= np.array(x) + 1e-9).all()


@pytest.mark.parametrize(
    ("make", "word"),
    [
        (lambda: ConstantVelocityKalman(0.0), "acceleration_psd"),
        (lambda: ConstantVelocityKalman(1e4, -0.1), "position_noise_mm"),
        (lambda: ConstantVelocityKalman(1e4, 0.1, math.nan), "first_speed_mm_s"),
        (lambda: SingerKalman(acceleration_mm_s2=math.inf), "acceleration_mm_s2"),
        (lambda: SingerKalman(acceleration_per_speed_hz=-1), "acceleration_per_speed_hz"),
        (lambda: SingerKalman(correlation_s=0), "correlation_s"),
        (lambda: SingerKalman(noise_reports=-1), "noise_reports"),
        (lambda: OneEuroFilter(min_cutoff_hz=0), "min_cutoff_hz"),
        (lambda: OneEuroFilter(beta_per_mm=-1), "beta_per_mm"),
        (lambda: OneEuroFilter(beta_per_mm=math.nan), "beta_per_mm"),
        (lambda: OneEuroFilter(derivative_cutoff_hz=math.inf), "derivative_cutoff_hz"),
    ],
)
def test_parameters_that_cannot_be(make, word):
    with pytest.raises(InputError, match=word):
        make()


def test_a_filter_of_another_kind_is_refused():
    class Mine(SingerKalman):
        pass

    with pytest.raises(InputError, match=r"filter: expected InteractingSinger, .* got Mine"):
        TouchSettings(filter=Mine())


def sliding(noise_mm, seed, jitter_s=0.0, count=400):
    """Reports of a finger on circles of 15 mm at 100 mm/s, each 10 ms."""
    random = np.random.default_rng(seed)
    t = np.arange(count) * 0.01 + random.uniform(-jitter_s, jitter_s, count)
    place = 15 * np.column_stack([np.cos(t * 100 / 15), np.sin(t * 100 / 15)])
    place += random.normal(0, noise_mm, place.shape)
    return list(zip(t.tolist(), *place.T.tolist(), strict=True))


@pytest.mark.parametrize("noise_mm", [0.02, 0.1, 0.4])
@pytest.mark.parametrize("jitter_s", [0.0, 0.003])
def test_the_noise_of_a_panel_is_found(noise_mm, jitter_s):
    reports = sliding(noise_mm, 3, jitter_s)
    found = [state[VARIANCE] for state in run(SingerKalman(), reports)][100:]
    # Over 300 reports, two axes, neighbours not independent: a standard error of some 4 %.
    assert math.sqrt(np.mean(found)) == pytest.approx(noise_mm, rel=0.15)


def test_a_panel_that_is_exact_or_rests_is_not_taken_for_noisy():
    assert run(SingerKalman(), sliding(0.0, 0, 0.003))[-1][VARIANCE] == pytest.approx(1e-4)
    resting = run(SingerKalman(), [(0.01 * i, 5.0, 5.0) for i in range(50)])[-1]
    assert resting[VARIANCE] == NOISE**2  # a resolution hides what noise there is


@pytest.mark.parametrize("noise_mm", [0.01, 0.3])
def test_a_known_noise_predicts_better_than_an_assumed_one(noise_mm):
    """30 ms ahead, on a path that no parameter was chosen on."""

    def error_mm(place_filter):
        reports, off = sliding(noise_mm, 7), []
        for state in run(place_filter, reports)[50:]:
            x, y, _, _ = ahead_of(place_filter, state, 0.03)
            angle = (state[0] + 0.03) * 100 / 15
            off.append(math.hypot(x - 15 * math.cos(angle), y - 15 * math.sin(angle)))
        return np.percentile(off, 95)

    assert error_mm(SingerKalman()) < 0.9 * error_mm(SingerKalman(noise_reports=0))
