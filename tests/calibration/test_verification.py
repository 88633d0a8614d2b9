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
from calibration.keep.practice import VIRTUAL_RIG
from calibration.keep.profile import write_archive
from calibration.keep.session_report import farthest_stroke
from calibration.measure.reduction import Reduced
from calibration.measure.rig import VoltsRead
from calibration.plan.predict import StrokeConditions
from haptix.model.perception.thresholds import WEBER_FRACTION
from haptix.model.screen import CALIBRATION_VALID_DAYS, CalibrationWarning, VerifiedRange

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


RIGHT = VIRTUAL_RIG


@pytest.fixture(scope="module")
def passed(fit, strokes, written):
    return verify(fit, strokes, written, rig=RIGHT)


@pytest.fixture
def calibrated(screen, fit, passed, predictor):
    return calibrated_screen(screen, fit, passed, predictor, "me", ["force sensor: FT1"])


def test_good_strokes_pass(passed, strokes):
    assert passed.passed
    titles = [title for title, _ in passed.parts]
    assert "Why it failed" not in titles and "Not tested" not in titles
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
    assert found.verdict == "failed" and found.parts[0] == ("Why it failed", found.failures)
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
    found = verify(fit, strokes, written, rig=RIGHT.replace(volts=()))
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


def read_by(rig, reduced, volts=lambda v: 1.0):
    """The strokes as a rig of these gains reads them; the monitor shows 1/volts of the volts."""
    return Reduced(
        tuple(
            replace(
                p,
                normal_force_n=p.normal_force_n * rig.normal_gain,
                mu=p.mu * rig.tangential_gain / rig.normal_gain,
                voltage_v=p.voltage_v / volts(p.voltage_v),
            )
            for p in reduced.points
        )
    )


@pytest.mark.parametrize(
    "gains",
    [
        {"tangential_gain": 1.1},
        {"normal_gain": 0.9},
        {"normal_gain": 0.55, "tangential_gain": 0.55},
    ],
    ids=str,
)
def test_known_gains_of_the_forces_are_taken_off(fit, strokes, written, passed, gains):
    """Both forces at 0.55 leave their ratio, and are the friction of another force."""
    second = gains.get("tangential_gain", 1.0)
    rig = RIGHT.replace(**gains, second_tangential_gain=second)
    read = read_by(rig, strokes)
    off = verify(fit, read, written, rig=RIGHT).bound_jnd
    found = verify(fit, rig.corrected(read), written, rig=rig)
    assert off > 0.5 or len(gains) == 2  # which is seen by the range that is stated alone
    assert found.passed
    # The strokes' own errors, a tenth of the scatter, were not read by the rig.
    assert found.bound_jnd == pytest.approx(passed.bound_jnd, rel=0.01)
    force = found.verified.normal_force_n
    assert force == pytest.approx(passed.verified.normal_force_n)


def test_contrast_has_a_verdict_of_its_own(fit, strokes, written, passed):
    """Friction wrong by a tenth at all voltages has the right contrast, and the other way round."""
    assert passed.contrast_verdict == "passed"
    tenth = tuple(replace(p, mu=1.1 * p.mu) for p in strokes.points)
    found = verify(fit, Reduced(tenth), written, rig=RIGHT)
    assert (found.verdict, found.contrast_verdict) == ("failed", "passed")
    assert found.contrast.mean_jnd == pytest.approx(1.1 * passed.contrast.mean_jnd, abs=1e-6)
    driven = tuple(replace(p, mu=(1.1 if p.voltage_v else 1.0) * p.mu) for p in strokes.points)
    found = verify(fit, Reduced(driven), written, rig=RIGHT)
    assert found.contrast_verdict == "failed"
    # 10 % of mu are 0.91 JND.
    assert found.contrast.mean_jnd == pytest.approx(0.91, abs=0.1)
    unread = verify(fit, strokes, written, rig=RIGHT.replace(volts=()))
    assert unread.contrast_verdict == "provisional"


def test_a_wrong_sign_is_no_gain_and_fails(fit, strokes, written):
    wrong = RIGHT.replace(normal_gain=-1.0)
    found = verify(fit, wrong.corrected(strokes), written, rig=wrong)
    assert found.verdict == "failed"
    assert "sign" in found.failures[0]


def weak(volts):
    """Gain of an amplifier that is 12 % low at 200 V and right at 100 V."""
    return 1.0 - 0.12 * np.clip(volts / 100.0 - 1, 0, None)


def test_an_amplifier_that_is_weak_at_high_volts_is_read_there(fit, strokes, written, passed):
    levels = [50.0, 75.0, 100.0, 120.0, 140.0, 160.0, 180.0, 200.0]
    volts = [
        VoltsRead(frequency_hz=hertz, monitor_v=v, gain=float(weak(v)))
        for hertz in (125.0, 4000.0)
        for v in levels
    ]
    rig = RIGHT.replace(volts=volts)
    shown = np.linspace(0, 200, 2001)
    read = Reduced(
        tuple(
            replace(p, voltage_v=float(np.interp(p.voltage_v, shown * weak(shown), shown)))
            for p in strokes.points
            if p.voltage_v < 175
        )
    )
    near = passed.strokes[0].point
    assert near.voltage_v > 0
    corrected = rig.corrected(read)
    for p, one in zip(strokes.points, (p for p in corrected.points), strict=False):
        if p.number == one.number:  # linear between the readings
            assert one.voltage_v == pytest.approx(p.voltage_v, rel=2e-3)
    # Read at 100 V alone, the amplifier is not known at the strokes' volts.
    low = rig.replace(volts=[one for one in volts if one.monitor_v <= 100.0])
    found = verify(fit, strokes, written, rig=low)
    assert found.verdict == "provisional"
    assert "the volts above 100 V" in found.untested[0]


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


def test_the_profile_carries_what_was_verified(
    passed, calibrated, strokes, tmp_path, screen, fit, predictor
):
    """Force, volts, frequency and speed of the strokes that were kept out, and nothing beyond."""
    held = strokes.held_out
    verified = calibrated.verified
    for name in ("normal_force_n", "frequency_hz", "speed_mm_per_s"):
        column = [getattr(one, name) for one in held]
        assert getattr(verified, name) == (min(column), max(column))
    highest = {one.frequency_hz: 0.0 for one in held}
    for one in held:
        highest[one.frequency_hz] = max(highest[one.frequency_hz], one.voltage_v)
    assert dict(verified.voltage_v) == highest and len(highest) > 1
    inside = held[0]
    assert verified.beyond(inside.normal_force_n, inside.voltage_v, inside.frequency_hz, 50.0) == []
    calibrated.save(tmp_path / "screen.toml")
    again = haptix.Screen.load(tmp_path / "screen.toml")
    assert again == calibrated and again.warnings() == calibrated.warnings()
    failed = calibrated_screen(screen, fit, replace(passed, failures=("wrong",)), predictor)
    assert failed.verified is None


BOX = VerifiedRange(
    normal_force_n=(0.2, 0.8),
    frequency_hz=(125.0, 4000.0),
    speed_mm_per_s=(45.0, 55.0),
    voltage_v=((125.0, 180.0), (4000.0, 80.0)),
)


@pytest.mark.parametrize(
    ("used", "said"),
    [
        ((0.5, 80.0, 4000.0, 50.0), []),
        ((0.21, 195.0, 125.0, 41.0), []),  # a tenth more or less
        ((0.1, 80.0, 4000.0), ["force 0.1 N: verified 0.2 to 0.8"]),
        (([0.5, 0.9, 1.2], 80.0, 4000.0), ["force 0.9 to 1.2 N: verified 0.2 to 0.8"]),
        ((0.5, 120.0, 4000.0), ["amplitude 120 V: verified to 80"]),
        ((0.5, 120.0, 125.0), []),
        ((0.5, 150.0), ["no frequency, so that the skin conducts: verified 125 to 4e+03 Hz"]),
        ((0.5, 0.0), []),
        # Halfway in ln f: 130 V.
        ((0.5, [120.0, 150.0], 707.1), ["amplitude 150 V: verified to 130"]),
        ((0.5, 10.0, 50.0, 120.0), ["frequency 50 Hz: verified 125 to 4e+03",
                                    "speed 120 mm/s: verified 45 to 55"]),
    ],
)  # fmt: skip
def test_what_leaves_the_verified_range_is_said(used, said):
    assert BOX.beyond(*used) == said


def with_defect(strokes, defect):
    """The strokes with a friction that the model does not have."""
    rise = 0.3 if defect == "contact" else 0.0
    power = 0.15 if defect == "speed" else 0.0
    return Reduced(
        tuple(
            replace(p, mu=p.mu * (p.speed_mm_per_s / 50.0) ** power, rise=p.rise + np.log1p(rise))
            for p in strokes.points
        )
    )


@pytest.mark.parametrize(
    ("defect", "group"),
    [("contact", "late in a long contact"), ("speed", "slow strokes"), ("speed", "fast strokes")],
)
def test_friction_that_leaves_the_model_inside_the_range_fails(
    fit, strokes, written, defect, group
):
    """30 % more late in a contact, and friction that goes as speed^0.15: 2.7 and 1 JND."""
    found = verify(fit, with_defect(strokes, defect), written, rig=RIGHT)
    assert found.verdict == "failed" and not found.is_open
    assert any(one.startswith(group) for one in found.failures)


def test_what_the_strokes_did_not_try_makes_the_verdict_provisional(fit, strokes, written, passed):
    """One speed, no long contact, or a rig that was read at one level or by one weight alone."""
    one_speed = tuple(replace(p, speed_mm_per_s=50.0) for p in strokes.points)
    brief = tuple(replace(p, contact_s=2.0, rise=np.nan) for p in strokes.points)
    for points, said in ((one_speed, "other speeds"), (brief, "long contacts")):
        found = verify(fit, Reduced(points), written, rig=RIGHT)
        assert found.verdict == "provisional"
        assert any(one.startswith(said) for one in found.untested)
    # Right at 100 V and 12 % low at 200 V, or both forces by a weight that was half of its name.
    for change, said in (
        ({"volts": (), "voltage_gain": 1.0}, "the volts at three levels"),
        ({"second_tangential_gain": None}, "the tangential force by a second weight"),
    ):
        found = verify(fit, strokes, written, rig=RIGHT.replace(**change))
        assert found.verdict == "provisional"
        assert any(one.startswith(said) for one in found.untested)
    bent = verify(fit, strokes, written, rig=RIGHT.replace(second_tangential_gain=0.9))
    assert any("another, expected the same" in one for one in bent.failures)
    slow, fast = passed.verified.speed_mm_per_s
    assert slow < 30 and fast > 85
    assert passed.verified.contact_s == pytest.approx(14.0)


def test_a_second_look_has_half_the_level(fit, strokes, written, passed):
    again = verify(fit, strokes, written, rig=RIGHT, looks=2)
    # Student's quantiles of 97.5 % and 95 % at many degrees of freedom: 1.96 and 1.645.
    widths = [found.groups[0].uncertainty_jnd for found in (again, passed)]
    assert widths[0] / widths[1] == pytest.approx(1.96 / 1.645, rel=0.02)
