"""Played, felt in time, sensed badly, reduced: against the predictor, which shares none of it."""

import numpy as np
import pytest

import haptix
from calibration import Protocol, Session, SessionInfo, Stroke, measure, reduce_session
from calibration.keep.practice import Person, VirtualFingerSource
from calibration.plan.predict import StrokeConditions

STROKES = tuple(
    Stroke(
        number=number + 1, normal_force_n=force, voltage_v=volts, frequency_hz=hertz, length_mm=20.0
    )
    for number, (force, volts, hertz) in enumerate(
        [(0.1, 0.0, 125.0), (0.9, 190.0, 125.0), (0.3, 160.0, 40.0), (0.5, 180.0, 1000.0)]
    )
)


@pytest.fixture
def session(tmp_path, finger, screen):
    info = SessionInfo(screen=screen, finger=finger)
    return Session.begin(tmp_path / "s", Protocol(strokes=STROKES), info)


def test_the_predictor_agrees_with_the_finger_in_time(
    session, predictor, parameters, finger, screen
):
    model = haptix.ContactModel(finger, screen)
    source = VirtualFingerSource(model, person=Person(repeatability=0.0), seed=4)
    assert measure(session, source).accepted == len(STROKES)
    points = reduce_session(session.recordings).used
    assert len(points) == len(STROKES)
    found = predictor(
        StrokeConditions.of(points), parameters.names, parameters.log_values, jacobian=False
    )
    for index, point in enumerate(points):
        # Sensor noise, drift and 1 % of cross-talk: the errors say how much of it is left.
        wanted = float(np.exp(found.log_mu[index]))
        assert point.mu == pytest.approx(wanted, abs=4 * point.mu_sd)
        assert point.mu_sd < 0.01 * point.mu
        if np.isfinite(point.ripple):
            assert point.ripple == pytest.approx(found.ripple[index], abs=4 * point.ripple_sd)
        assert point.crosstalk == pytest.approx(0.01, abs=0.006)  # less what friction turns
    assert np.isfinite([point.ripple for point in points]).tolist() == [False, True, True, True]


@pytest.mark.slow
def test_a_person_who_cannot_hold_the_force_is_asked_again(tmp_path, finger, screen):
    info = SessionInfo(screen=screen, finger=finger)
    session = Session.begin(tmp_path / "s", Protocol(strokes=STROKES[:2]), info)
    person = Person(force_error=0.2, speed_error=0.1, tremor=0.1)
    model = haptix.ContactModel(finger, screen)
    # Followed up to 500 Hz: twice the two strokes' 125 Hz, and four times as fast.
    source = VirtualFingerSource(model, person=person, seed=2, output_rate_hz=2500.0)
    outcome = measure(session, source, most_tries=8)
    assert outcome.rejected > 0
    assert outcome.accepted == 2
    for point in reduce_session(session.recordings).points:
        wanted = STROKES[point.number - 1]
        assert not point.outlier
        assert point.normal_force_n == pytest.approx(wanted.normal_force_n, rel=0.16)
        assert point.speed_mm_per_s == pytest.approx(wanted.speed_mm_per_s, rel=0.16)
