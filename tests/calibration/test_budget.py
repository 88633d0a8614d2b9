"""The budget against what it stands for: inputs are moved, and everything is fitted again."""

from dataclasses import replace
from math import log

import numpy as np
import pytest

from calibration import Parameters, fit_strokes
from calibration.fit.residuals import TANGENTIAL_GAIN, VOLTAGE_GAIN
from calibration.keep.practice import VIRTUAL_RIG, draw_parameters
from calibration.measure.reduction import Reduced
from calibration.plan.predict import StrokeConditions
from calibration.plan.protocol import short_protocol
from calibration.verify.budget import uncertainty_budget

RIG = VIRTUAL_RIG
VOLTS = 150.0
QUANTITIES = ("mu(0)", f"mu({VOLTS:g} V)/mu(0) at 125 Hz", "d1/eps1", "h0 at the carrier")


@pytest.fixture(scope="module")
def start(finger, screen):
    return Parameters.of(finger, screen)


@pytest.fixture(scope="module")
def strokes(predictor, start, reduced_of):
    plan = short_protocol(predictor, start, 3.0, VOLTS)
    return reduced_of(predictor, plan, start, np.random.default_rng(2))


def fitted(strokes, predictor, start):
    return fit_strokes(strokes, predictor, start, bootstraps=0)


@pytest.fixture(scope="module")
def fit(strokes, predictor, start):
    return fitted(strokes, predictor, start)


@pytest.fixture(scope="module")
def budget(fit, predictor):
    return {one.quantity: one for one in uncertainty_budget(fit, predictor, (VOLTS, VOLTS), RIG)}


def source(budget, quantity, name):
    return next(one for one in budget[quantity].contributions if one.source == name)


def test_shares_add_up_and_the_quantities_are_all_there(budget):
    assert set(QUANTITIES) < set(budget)
    for one in budget.values():
        assert sum(part.share for part in one.contributions) == pytest.approx(1.0, abs=1e-6)
        assert {part.kind for part in one.contributions} == {"A", "B"}
        by = [part.sensitivity * part.standard_uncertainty for part in one.contributions]
        assert np.linalg.norm(by) == pytest.approx(one.standard_uncertainty, rel=1e-6)
        assert one.low < one.value < one.high
        # Student's factor at 90 % is 1.645 for many degrees of freedom and 2.35 for three.
        assert 1.6 < one.coverage_factor < 2.4


def test_friction_is_that_of_the_contact_model(budget, fit, predictor):
    two = StrokeConditions(*np.array([[0.5, 0.5], [0, VOLTS], [125, 125], [50, 50]], dtype=float))
    mu = np.exp(predictor(two, fit.names, fit.log_values, jacobian=False).log_mu)
    assert budget["mu(0)"].value == pytest.approx(mu[0])
    assert budget[QUANTITIES[1]].value == pytest.approx(mu[1] / mu[0])


@pytest.mark.parametrize(
    ("name", "changed"),
    [
        (VOLTAGE_GAIN, lambda p: replace(p, voltage_v=1.01 * p.voltage_v)),
        (TANGENTIAL_GAIN, lambda p: replace(p, mu=1.01 * p.mu)),
    ],
)
def test_a_gain_that_is_wrong_moves_the_fit_as_its_sensitivity_says(
    strokes, predictor, start, budget, name, changed
):
    moved = fitted(Reduced(tuple(map(changed, strokes.points))), predictor, start)
    after = {one.quantity: one for one in uncertainty_budget(moved, predictor, (VOLTS, VOLTS), RIG)}
    for quantity in QUANTITIES:
        change = log(after[quantity].value / budget[quantity].value) / log(1.01)
        # The soft loss bends a little: a tenth, or 2 % of the gain where nothing moves.
        wanted = source(budget, quantity, name).sensitivity
        assert wanted == pytest.approx(change, rel=0.1, abs=0.02), quantity


def test_a_prior_moves_the_fit_as_its_sensitivity_says(strokes, predictor, start, budget):
    shifted = start.known(
        apparent_area_at_1n_m2=(1.02 * start["apparent_area_at_1n_m2"].value, 0.1)
    )
    after = fitted(strokes, predictor, shifted)
    change = log(after.best("h0_m") / budget["d1/eps1"].value) / log(1.02)
    wanted = source(budget, "d1/eps1", "what was known of apparent_area_at_1n_m2")
    assert wanted.standard_uncertainty == pytest.approx(0.1)
    assert wanted.sensitivity == pytest.approx(change, rel=0.1, abs=0.02)


def test_table_and_budget_have_one_interval(fit, predictor):
    bare = {one.quantity: one for one in uncertainty_budget(fit, predictor, (VOLTS, VOLTS))}
    one = bare["d1/eps1"]
    assert (one.low, one.high) == pytest.approx((fit["h0_m"].low, fit["h0_m"].high))
    assert one.standard_uncertainty == pytest.approx(fit["h0_m"].spread)


@pytest.mark.slow
def test_intervals_hold_their_share(predictor, start, reduced_of):
    """Sixty truths of the model's own form: fits know nothing of them but the priors."""
    plan, rng = short_protocol(predictor, start, 3.0, 100.0), np.random.default_rng(5)
    planned = StrokeConditions.of(plan.strokes)
    held = dict.fromkeys((*QUANTITIES[::2], QUANTITIES[3]), 0)
    count = 0
    while count < 60:
        true = draw_parameters(start, rng)
        if not predictor(planned, true.names, true.log_values, jacobian=False).is_light.all():
            continue
        fit = fit_strokes(reduced_of(predictor, plan, true, rng), predictor, start, bootstraps=20)
        rows = {one.quantity: one for one in uncertainty_budget(fit, predictor, (100.0, 100.0))}
        if not rows:
            continue
        count += 1
        at_rest = StrokeConditions(*np.array([[0.5], [0.0], [125.0], [50.0]]))
        truths = {
            "mu(0)": np.exp(predictor(at_rest, true.names, true.log_values).log_mu[0]),
            "d1/eps1": true["h0_m"].value,
            "h0 at the carrier": predictor.thickness_m(true.names, true.log_values, 4000.0),
        }
        for name, truth in truths.items():
            held[name] += rows[name].low <= truth <= rows[name].high
    # At a true 90 %, fewer than 47 of 60 have a probability of 0.2 %.
    assert min(held.values()) >= 47, held
