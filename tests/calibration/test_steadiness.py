"""Repeatability, drift and creep: what was put into strokes comes out with its size."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from calibration import Parameters
from calibration.fit.result import Repeatability
from calibration.measure.reduction import Point, Reduced, reduce_stroke
from calibration.plan.predict import StrokeConditions
from calibration.verify.steadiness import steadiness
from haptix.base.report import record
from haptix.model.perception.thresholds import WEBER_FRACTION

CREEP = 0.03  # for each e-fold of the time in contact


@pytest.mark.parametrize("there_and_back", [True, False])
def test_creep_in_contact_is_found_beside_crosstalk(recorded, stroke, there_and_back):
    stroke = stroke.model_copy(update={"there_and_back": there_and_back})
    made = recorded(stroke, noise_n=0.0, crosstalk=0.05)
    touching = made.normal_force_n > 0.4 * np.median(made.normal_force_n)
    lasted = np.maximum(made.t_s - made.t_s[touching.argmax()], 1e-3)
    friction = made.tangential_force_n - 0.05 * made.normal_force_n
    crept = replace(
        made, tangential_force_n=made.tangential_force_n + friction * CREEP * np.log(lasted)
    )
    # One way, cross-talk of a sixth of the friction counts as friction that does not creep.
    share = 1.0 if there_and_back else 0.3 / (0.3 + 0.05)
    assert reduce_stroke(made).creep == pytest.approx(0.0, abs=1e-3)
    assert reduce_stroke(crept).creep == pytest.approx(CREEP * share, rel=0.05)


def test_drift_and_creep_have_their_size(predictor, finger, screen):
    own = Parameters.of(finger, screen)
    rng = np.random.default_rng(2)
    count = 20
    force = rng.uniform(0.1, 0.9, count)
    columns = force, np.zeros(count), np.full(count, 125.0), np.full(count, 50.0)
    mu = np.exp(
        predictor(StrokeConditions(*columns), own.names, own.log_values, jacobian=False).log_mu
    )
    grown = mu * (1 + 0.05 * np.linspace(0, 1, count)) * (1 + 0.002 * rng.normal(size=count))
    points = [
        Point(n + 1, *one, measured, 1e-3, np.nan, np.nan, creep=CREEP)
        for n, (one, measured) in enumerate(zip(zip(*columns, strict=True), grown, strict=True))
    ]
    fit = SimpleNamespace(repeatability=Repeatability(0.011, 0.01))
    found = steadiness(fit, Reduced(tuple(points)), predictor)
    assert found.repeatability_jnd == pytest.approx(0.1)
    off = abs(found.session_drift_jnd - np.log(1.05) / WEBER_FRACTION)
    # 90 % either side: three times as far is 1 in a million.
    assert off < 3 * found.session_drift_uncertainty_jnd < 0.1
    assert found.creep_jnd == pytest.approx(CREEP * np.log(10) / WEBER_FRACTION)
    assert found.creep_uncertainty_jnd == pytest.approx(0.0, abs=1e-9)
    assert "drifts by +0.4" in found.text


def test_of_few_strokes_there_is_no_trend(predictor):
    fit = SimpleNamespace(repeatability=Repeatability())
    found = steadiness(fit, Reduced(()), predictor)
    assert record(found)["session_drift_jnd"] is None
    assert record(found)["creep_jnd"] is None
