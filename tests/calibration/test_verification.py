"""From a fit to a verdict, a profile, a page and an archive."""

import re
import warnings
import zipfile
from dataclasses import replace
from datetime import date, timedelta

import numpy as np
import pytest

import haptix
from calibration import (
    Parameters,
    StrokePredictor,
    calibrated_finger,
    calibrated_screen,
    fit_strokes,
    full_protocol,
    verify,
    write_report,
)
from calibration.predict import StrokeConditions
from calibration.profile import write_archive
from calibration.reduction import Reduced
from calibration.report import farthest_stroke
from calibration.rig import RigCheck
from haptix.perception import WEBER_FRACTION
from haptix.screen import CALIBRATION_VALID_DAYS, CalibrationWarning

H0_M = 1.6e-7


@pytest.fixture(scope="module")
def strokes(predictor, reduced_of, finger, screen):
    truth = Parameters.of(finger, screen).started_at(h0_m=H0_M)
    return reduced_of(predictor, full_protocol(), truth, np.random.default_rng(1))


@pytest.fixture(scope="module")
def fit(predictor, strokes, finger, screen):
    return fit_strokes(strokes, predictor, Parameters.of(finger, screen), bootstraps=20)


@pytest.fixture(scope="module")
def written(fit, finger, screen, predictor):
    """A predictor of the profiles that are to be signed."""
    panel = calibrated_screen(screen, fit, None, predictor)
    assert panel.calibration.verdict == "failed"
    return StrokePredictor(haptix.ContactModel(calibrated_finger(finger, fit), panel))


RIGHT = RigCheck(normal_gain=1.0, tangential_gain=1.0, voltage_gain=1.0)


@pytest.fixture(scope="module")
def passed(fit, strokes, written):
    return verify(fit, strokes, written, rig=RIGHT)


@pytest.fixture
def calibrated(screen, fit, passed, predictor):
    return calibrated_screen(screen, fit, passed, predictor, "me", ["force sensor: FT1"])


def test_good_strokes_pass(passed, strokes):
    assert passed.passed
    assert len(passed.strokes) == len(strokes.held_out) == 8
    # 1 % of repeatability is a tenth of a threshold: three times that for the worst of eight.
    assert 0 < passed.worst_jnd < 0.4
    error = [one.point.mu - one.predicted_mu for one in passed.strokes]
    assert np.sqrt(np.mean(np.square(error))) < 0.02


def test_the_profiles_are_verified_and_not_the_fit(fit, strokes, finger, written, screen):
    """A number that the profiles drop fails, however well the fit predicts."""
    dropped = calibrated_finger(finger, fit).replace(dielectric=finger.dielectric)
    doubled = dropped.replace(dielectric=dropped.dielectric.model_copy(update={"scale": 2.0}))
    model = haptix.ContactModel(doubled, written.model.screen)
    assert not verify(fit, strokes, StrokePredictor(model)).passed


def shifted(strokes, rows, thresholds):
    """The strokes with held-out ones at given distances from their prediction [JND]."""
    off = {
        row.point.number: row.predicted_mu * (1 + WEBER_FRACTION * one)
        for row, one in zip(rows, thresholds, strict=True)
    }
    return Reduced(tuple(replace(p, mu=off.get(p.number, p.mu)) for p in strokes.points))


def test_one_noisy_stroke_does_not_decide(fit, strokes, written, passed):
    """Half a JND in one of eight: the mean of no group leaves the tolerance."""
    assert verify(
        fit, shifted(strokes, passed.strokes, [0.52] + [0.0] * 7), written, rig=RIGHT
    ).passed


@pytest.mark.slow
def test_a_shift_of_the_tolerance_passes_in_one_of_twenty_at_most(fit, strokes, written, passed):
    """Friction wrong by half a JND at the carrier alone, with a repeatability of 1 %."""
    rng = np.random.default_rng(3)
    carrier = np.array([row.point.frequency_hz > 2000 for row in passed.strokes])
    count = 0
    for _ in range(40):
        noisy = 0.5 * carrier + rng.normal(0, 0.01 / WEBER_FRACTION, 8)
        found = verify(fit, shifted(strokes, passed.strokes, noisy), written, rig=RIGHT)
        assert found.passed or "at the carrier (strokes" in "".join(found.failures)
        count += found.passed
    # More than 5 of 40 at a true 5 %: a chance of 1 %.
    assert count <= 5


def test_a_group_that_is_off_fails_and_is_named(fit, strokes, written, passed):
    off = [0.6 if row.point.normal_force_n < 0.45 else 0.0 for row in passed.strokes]
    found = verify(fit, shifted(strokes, passed.strokes, off), written, rig=RIGHT)
    assert found.verdict == "failed"
    assert re.search(
        r"light strokes \(strokes [\d, ]+\): friction is \+[\d.]+ ± ", found.failures[0]
    )
    # A raised tolerance says nothing about half a JND.
    raised = verify(fit, shifted(strokes, passed.strokes, off), written, 3.0, RIGHT)
    assert raised.verdict == "provisional" and "3 JND" in raised.untested[0]


def test_what_was_not_tested_makes_the_verdict_provisional(fit, strokes, written):
    found = verify(fit, strokes, written)
    assert (found.verdict, found.failures) == ("provisional", ())
    assert "known weight" in found.untested[0]
    # A weight alone says nothing of an amplifier that is weak behind its monitor.
    found = verify(fit, strokes, written, rig=RIGHT.replace(voltage_gain=None))
    assert found.verdict == "provisional"
    day = date(2026, 3, 1)
    for days, verdict in ((0, "passed"), (31, "passed"), (-32, "provisional")):
        checked = RIGHT.replace(measured_on=day + timedelta(days=days))
        aged = verify(fit, strokes, written, rig=checked, measured_on=day)
        assert aged.verdict == verdict
    assert "2026-01-28" in aged.untested[0] and "32 days" in aged.untested[0]
    assert "no second reading" in found.untested[0]
    slow = [replace(p, frequency_hz=min(p.frequency_hz, 125.0)) for p in strokes.held_out]
    found = verify(fit, Reduced((*strokes.used, *slow)), written, rig=RIGHT)
    assert any("near 4000 Hz" in one for one in found.untested)


@pytest.mark.parametrize(
    "gains",
    [{"tangential_gain": 1.1}, {"normal_gain": 0.9}, {"voltage_gain": 0.9}, {"normal_gain": -1.0}],
    ids=str,
)
def test_a_gain_that_no_stroke_shows_fails_by_the_rig_check(fit, strokes, written, gains):
    """Friction 10 % wrong is 0.9 JND; a tenth of the volts is as much where they matter."""
    found = verify(fit, strokes, written, rig=RIGHT.replace(**gains))
    assert found.verdict == "failed"
    assert "rig" in found.failures[0] or "sign" in found.failures[0]


@pytest.mark.parametrize(
    ("creep", "verdict"), [(0.0, "passed"), (0.02, "provisional"), (0.04, "failed")]
)
def test_creep_in_contact_counts(fit, strokes, written, creep, verdict):
    """0.02 for each e-fold of time is 0.42 JND in ten times the time, 0.04 twice that."""
    points = tuple(replace(point, creep=creep) for point in strokes.points)
    found = verify(fit, Reduced(points), written, rig=RIGHT)
    assert found.verdict == verdict
    if creep:
        assert "creeps by +0" in (*found.untested, *found.failures)[0]


def test_without_held_out_strokes_nothing_passes(fit, strokes, predictor):
    found = verify(fit, Reduced(strokes.used), predictor)
    assert found.failures == ("expected 4 good strokes kept out of the fit or more, got 0",)
    assert np.isnan(found.worst_jnd)


def test_an_insulator_that_is_not_determined_fails(fit, strokes, predictor, screen):
    unknown = fit["h0_m"].model_copy(update={"value": None, "advice": "ask"})
    vague_fit = fit.replace(
        estimates=tuple(unknown if one.name == "h0_m" else one for one in fit.estimates)
    )
    found = verify(vague_fit, strokes, predictor)
    assert "h0_m is not determined" in found.failures[-1]
    with pytest.raises(haptix.InputError, match=r"h0_m.*ask"):
        calibrated_screen(screen, vague_fit, found, predictor)


def test_the_profile_is_used_without_a_word(tmp_path, calibrated, fit):
    calibrated.save(tmp_path / "screen.toml")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = haptix.Screen.load(tmp_path / "screen.toml")
    assert found == calibrated
    assert found.h0_m == pytest.approx(fit.value("h0_m"), rel=1e-12)
    assert found.h0_m == pytest.approx(H0_M, rel=0.1)
    assert not found.is_placeholder
    assert found.calibration.verdict == "passed"
    assert found.calibration.spread["h0_m"] == fit["h0_m"].spread
    assert found.calibration.instruments == ("force sensor: FT1",)
    assert "dielectric of the skin (placeholder)" in found.calibration.rests_on


OLD = date.today() - timedelta(days=CALIBRATION_VALID_DAYS + 2)


def signed(screen, **changes):
    calibration = screen.calibration.model_copy(update=changes)
    unsigned = screen.replace(calibration=calibration)
    own = calibration.model_copy(update={"content_hash": unsigned.content_hash()})
    return unsigned.replace(calibration=own)


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (lambda s: signed(s, date=OLD), f"more than {CALIBRATION_VALID_DAYS} days old"),
        (lambda s: signed(s, verdict="failed"), "failed verification"),
        (lambda s: signed(s, verdict="provisional"), "is provisional"),
        (lambda s: s.replace(insulator_thickness_m=2e-6), "changed after the calibration"),
        (lambda s: haptix.Screen(name="x", is_placeholder=True), "a placeholder, not calibrated"),
    ],
    ids=["old", "failed", "provisional", "edited", "placeholder"],
)
def test_a_profile_that_is_not_to_be_trusted_warns_and_is_named(
    tmp_path, calibrated, finger, spoil, said
):
    path = tmp_path / "screen.toml"
    spoil(calibrated).save(path)
    with pytest.warns(CalibrationWarning, match=rf"screen\.toml: .*{said}"):
        screen = haptix.Screen.load(path)
    model = haptix.ContactModel(finger, screen, fidelity="closed-form")
    # What figures, demos, surfaces and archives quote.
    assert any(re.search(said, one) for one in model.placeholders())
    assert model.describe()["placeholders"] == model.placeholders()


def test_presets_are_not_in_doubt(screen):
    assert screen.warnings() == []


def test_the_finger_predicts_what_the_fit_does(predictor, finger, screen, fit):
    own = calibrated_finger(finger, fit)
    model = haptix.ContactModel(own, screen.replace(insulator_thickness_m=8 * fit.best("h0_m")))
    mu = float(model.solve(0.5, 0.0).mu)
    place = StrokeConditions(*(np.array([value]) for value in (0.5, 0.0, 125.0, 50.0)))
    found = predictor(place, fit.names, fit.log_values, jacobian=False)
    assert mu == pytest.approx(float(np.exp(found.log_mu[0])), rel=1e-6)


def test_the_finger_has_the_fitted_response_and_skin(predictor, finger, screen, fit):
    """All of the fit is in the profiles: a predictor of them says what the fit's own does."""
    logs = fit.log_values.copy()
    logs[fit.names.index("response_hz_per_mm_per_s")] = np.log(9.0)
    logs[fit.names.index("skin_dielectric_scale")] = np.log(1.7)
    changed = fit.replace(log_values=logs)
    own = calibrated_finger(finger, changed)
    assert own.response_hz_per_mm_per_s == pytest.approx(9.0, rel=1e-12)
    assert own.dielectric.scale == pytest.approx(1.7, rel=1e-12)
    panel = screen.replace(insulator_thickness_m=8 * changed.best("h0_m"))
    again, known = StrokePredictor(haptix.ContactModel(own, panel)), Parameters.of(own, panel)
    places = StrokeConditions(*np.array([[0.3, 0.8], [120.0, 150.0], [30.0, 500.0], [20.0, 60.0]]))
    expected = predictor(places, fit.names, logs, jacobian=False)
    found = again(places, known.names, known.log_values, jacobian=False)
    # One table for all fingers against one of this finger's own: the tables' own error.
    np.testing.assert_allclose(found.log_mu, expected.log_mu, rtol=1e-6)
    np.testing.assert_allclose(found.ripple, expected.ripple, rtol=1e-5)


def test_the_report_stands_alone(
    tmp_path, calibrated, fit, strokes, passed, predictor, recorded, stroke
):
    path = tmp_path / "report.html"
    named = calibrated.replace(name="<panel & 7>")
    worst = recorded(stroke)
    write_report(path, named, fit, strokes, passed, predictor, recordings=[worst])
    page = path.read_text()
    assert "http" not in page
    assert not re.search(r'(src|href)="(?!data:)', page)
    assert "&lt;panel &amp; 7&gt;" in page
    assert "<script" not in page
    assert page.count("<img alt=") == 3
    assert page.count("<svg") == 1
    assert "raw trace of stroke 1" in page
    assert "@media print" in page
    assert 'src="data:image/png;base64,iVBOR' in page
    for one in fit.estimates:
        assert one.name in page


def test_the_stroke_whose_trace_is_shown_is_the_worst(fit, strokes, predictor):
    points = list(strokes.points)
    points[11] = replace(points[11], mu=0.8 * points[11].mu)
    assert farthest_stroke(fit, Reduced(tuple(points)), predictor) == points[11].number


def test_the_archive_holds_the_folder(tmp_path):
    folder = tmp_path / "s"
    (folder / "strokes").mkdir(parents=True)
    (folder / "strokes" / "stroke-001.h5").write_bytes(b"raw")
    (folder / "fit.json").write_text("{}")
    for _ in range(2):  # made again it does not hold itself
        write_archive(folder, folder / "archive.zip")
    with zipfile.ZipFile(folder / "archive.zip") as archive:
        assert sorted(archive.namelist()) == ["s/fit.json", "s/strokes/stroke-001.h5"]
        assert archive.read("s/strokes/stroke-001.h5") == b"raw"
