"""Fits of strokes whose truth is known, and what they refuse to say."""

from dataclasses import replace
from math import inf, log

import numpy as np
import pytest

import haptix
from calibration import Fit, Parameters, fit_strokes, full_protocol, paper_protocol
from calibration.fit.fitting import compare_terms, other_forms
from calibration.measure.reduction import Reduced
from calibration.plan.predict import StrokeConditions, StrokePredictor
from haptix.model.finger import MeasuredRoughness

TRUTH = {
    "h0_m": 1.6e-7,
    "frictional_shear_stress_pa": 1.1e7,
    "youngs_modulus_pa": 48e6,
    "h_rms_m": 20e-6,
    "apparent_area_at_1n_m2": 42e-6,
    "apparent_area_exponent": 0.15,
    "response_hz_per_mm_per_s": 13.0,
}


LEAK = ("leaky-gap",)


@pytest.fixture(scope="module")
def truth(finger, screen):
    return Parameters.of(finger, screen).started_at(**TRUTH)


@pytest.fixture(scope="module")
def strokes(predictor, truth, reduced_of):
    return reduced_of(predictor, full_protocol(), truth, np.random.default_rng(7))


@pytest.fixture(scope="module")
def full_fit(predictor, strokes, finger, screen):
    return fit_strokes(strokes, predictor, Parameters.of(finger, screen), bootstraps=40)


@pytest.fixture(scope="module")
def paper_fit(predictor, truth, reduced_of, finger, screen):
    # Of a finger of which hardly anything is known, its skin included.
    reduced = reduced_of(predictor, paper_protocol(), truth, np.random.default_rng(8))
    unknown = Parameters.of(finger, screen).known(
        youngs_modulus_pa=(None, 0.6), h_rms_m=(None, 0.4), skin_dielectric_scale=(None, 2.0)
    )
    return fit_strokes(reduced, predictor, unknown, bootstraps=40)


def test_the_insulator_is_found(full_fit):
    one = full_fit["h0_m"]
    assert one.verdict == "determined"
    # Its own error: three standard deviations, which are some 15 % with an unknown skin (6 % by
    # the theory "open-gaps", whose friction rises more with the voltage).
    assert abs(log(one.value / TRUTH["h0_m"])) < 3 * one.spread
    assert 0.005 < one.spread < 0.2
    assert one.low < TRUTH["h0_m"] < one.high
    assert 0.005 < full_fit.repeatability.log_mu < 0.015  # 0.01 was put in, 50 strokes are left
    assert full_fit["skin_dielectric_scale"].low < 1.0 < full_fit["skin_dielectric_scale"].high


def test_an_unknown_skin_does_not_move_the_insulator(predictor, truth, strokes, reduced_of):
    """Held at a wrong scale, the fit is sure of an insulator that is a third too thick."""
    dry = truth.started_at(skin_dielectric_scale=0.5)
    reduced = reduced_of(predictor, full_protocol(), dry, np.random.default_rng(7))
    start = truth.started_at(h0_m=1.25e-7)
    free = fit_strokes(reduced, predictor, start, bootstraps=0)
    held = fit_strokes(reduced, predictor, start.fixed(skin_dielectric_scale=1.0), bootstraps=0)
    assert free["h0_m"].low < TRUTH["h0_m"] < free["h0_m"].high
    assert free["skin_dielectric_scale"].low < 0.5 < free["skin_dielectric_scale"].high
    assert held["h0_m"].low > TRUTH["h0_m"]


def test_friction_over_the_range_is_found(predictor, truth, full_fit):
    force, volts = (a.ravel() for a in np.meshgrid([0.1, 0.4, 1.0], [0.0, 80.0, 160.0, 200.0]))
    places = StrokeConditions(force, volts, np.full(12, 125.0), np.full(12, 50.0))
    wanted = predictor(places, truth.names, truth.log_values, jacobian=False).log_mu
    found = predictor(places, full_fit.names, full_fit.log_values, jacobian=False).log_mu
    assert np.abs(found - wanted).max() < 0.01  # 50 strokes of 1 %


def test_what_the_paper_s_strokes_do_not_determine_has_no_number(paper_fit):
    one = paper_fit["h0_m"]
    assert one.value is None
    assert one.verdict == "undetermined"
    assert one.low < TRUTH["h0_m"] < one.high
    with pytest.raises(haptix.InputError, match=r"h0_m.*other frequencies"):
        paper_fit.value("h0_m")
    # They hardly touch these: what was known before is no finding.
    assert paper_fit["apparent_area_exponent"].verdict == "prior"
    assert "ink" in paper_fit["apparent_area_exponent"].refusal()


def test_the_default_theory_finds_the_insulator_of_a_known_finger(screen, reduced_of):
    model = haptix.ContactModel(haptix.Finger.preset("semi-wet"), screen)
    assert model.theory == "local"
    predictor, start = StrokePredictor(model), Parameters.of(model.finger, screen)
    plan = full_protocol()
    few = [one for one in plan.strokes if one.normal_force_n in (0.1, 0.9)][::2]
    plan = plan.replace(strokes=tuple(few))
    true = start.started_at(h0_m=1.6e-7)
    reduced = reduced_of(predictor, plan, true, np.random.default_rng(4))
    known = start.fixed(**{n: start[n].value for n in start.free if n not in ("h0_m",)})
    fit = fit_strokes(reduced, predictor, known, bootstraps=0)
    # A dozen strokes of 1 % each leave some 0.6 % of h0: three standard deviations.
    assert fit["h0_m"].value == pytest.approx(1.6e-7, rel=0.02)


def test_a_reference_screen_tells_of_the_finger(predictor, truth, reduced_of, parameters):
    # The experiment that the refusal names: the same finger on a screen of known insulator.
    rng = np.random.default_rng(3)
    known = reduced_of(predictor, paper_protocol(), truth.started_at(h0_m=1.25e-7), rng)
    first = fit_strokes(known, predictor, parameters.fixed(h0_m=1.25e-7), bootstraps=40)
    assert first["h0_m"].verdict == "fixed"
    other = reduced_of(predictor, paper_protocol(), truth, rng)
    second = fit_strokes(
        other, predictor, parameters.with_finger(first.finger_prior()), bootstraps=40
    )
    one = second["h0_m"]
    assert one.verdict == "determined"
    assert one.value == pytest.approx(TRUTH["h0_m"], rel=0.06)  # 2 % expected, three times
    assert one.low < TRUTH["h0_m"] < one.high


def test_known_values_are_taken(predictor, strokes, parameters):
    known = parameters.fixed(youngs_modulus_pa=48e6).known(h_rms_m=(20e-6, 0.01))
    fit = fit_strokes(strokes, predictor, known, bootstraps=0)
    assert fit["youngs_modulus_pa"].value == 48e6
    assert fit.best("h_rms_m") == pytest.approx(20e-6, rel=0.03)
    # What goes as modulus x roughness is determined now.
    assert fit["frictional_shear_stress_pa"].value == pytest.approx(1.1e7, rel=0.04)


def test_one_wild_stroke_does_not_carry_the_fit_away(predictor, strokes, full_fit, parameters):
    points = list(strokes.points)
    index = next(i for i, p in enumerate(points) if p.voltage_v == 200 and not p.held_out)
    points[index] = replace(points[index], mu=1.5 * points[index].mu)
    fit = fit_strokes(Reduced(tuple(points)), predictor, parameters, bootstraps=0)
    shift = abs(log(fit.best("h0_m") / full_fit.best("h0_m")))
    assert shift < full_fit["h0_m"].spread


def test_strokes_past_the_light_contact_are_left_out_and_named(predictor, strokes, parameters):
    points = list(strokes.points)
    wild = max(p.number for p in points) + 1
    # Ten times the friction at 800 V, where the contact has long snapped in.
    points.append(replace(points[0], number=wild, voltage_v=800.0, mu=2.6, held_out=False))
    fit = fit_strokes(Reduced(tuple(points)), predictor, parameters, bootstraps=0)
    assert wild not in fit.strokes
    assert "snaps in; use a lower voltage" in fit.left_out[wild]


def test_a_gap_that_does_not_leak_gives_a_bound_only(predictor, truth, reduced_of, parameters):
    reduced = reduced_of(predictor, full_protocol(), truth, np.random.default_rng(5))
    leaky = parameters.known(gap_resistivity_ohm_m=(1e7, 6.0))
    fit = fit_strokes(reduced, predictor, leaky, bootstraps=0)
    one = fit["gap_resistivity_ohm_m"]
    assert one.value is None
    # A gap of 1e6 Ohm m would have lost most of its friction at 125 Hz.
    assert one.low > 1e6
    assert one.high > 100 * one.low


@pytest.mark.slow
def test_a_gap_that_leaks_is_found_and_needed(predictor, truth, reduced_of, parameters):
    leaks = truth.known(gap_resistivity_ohm_m=(3e7, 1.0))
    reduced = reduced_of(predictor, full_protocol(), leaks, np.random.default_rng(6))
    leaky = parameters.known(gap_resistivity_ohm_m=(1e7, 6.0))
    fit = fit_strokes(reduced, predictor, leaky, bootstraps=0)
    one = fit["gap_resistivity_ohm_m"]
    assert one.value == pytest.approx(3e7, rel=0.15)
    assert one.low < 3e7 < one.high
    needs = {need.term: need for need in compare_terms(fit, reduced, predictor, leaky, LEAK)}
    assert needs["leaky-gap"].need == "needed"
    # And from the other side: a fit without it asks for it.
    blind = fit_strokes(reduced, predictor, parameters, bootstraps=0)
    needs = {need.term: need for need in compare_terms(blind, reduced, predictor, parameters, LEAK)}
    assert needs["leaky-gap"].need == "needed"
    assert not needs["leaky-gap"].is_on


@pytest.mark.slow
def test_terms_that_are_not_there_are_not_asked_for(predictor, strokes, full_fit, parameters):
    few = ("leaky-gap", "skin-dielectric", "finite-size")
    needs = {n.term: n for n in compare_terms(full_fit, strokes, predictor, parameters, few)}
    assert needs["leaky-gap"].need in ("changes nothing", "cannot tell")
    assert needs["skin-dielectric"].need == "needed"
    # The theory of the truth and the fit is of an infinite contact.
    assert not needs["finite-size"].is_on
    assert needs["finite-size"].need != "needed"


@pytest.mark.slow
def test_a_term_that_the_truth_lacks_is_contradicted(finger, screen, reduced_of):
    """The finite size in the theory "open-gaps", in which it is a cut, and off."""
    predictor = StrokePredictor(haptix.ContactModel(finger, screen, theory="open-gaps"))
    start = Parameters.of(predictor.model.finger, screen)
    truth = start.started_at(**TRUTH)
    reduced = reduced_of(predictor, full_protocol(), truth, np.random.default_rng(7))
    fit = fit_strokes(reduced, predictor, start, bootstraps=0)
    (need,) = compare_terms(fit, reduced, predictor, start, ("finite-size",))
    assert not need.is_on
    assert need.need == "contradicted"


def test_round_trip(tmp_path, paper_fit):
    open_ended = paper_fit.estimates[0].model_copy(update={"high": inf})
    made = paper_fit.replace(
        estimates=(open_ended, *paper_fit.estimates[1:]), left_out={3: "no sliding"}
    )
    made.save(tmp_path / "fit.json")
    found = Fit.load(tmp_path / "fit.json")
    np.testing.assert_array_equal(found.log_values, made.log_values)
    np.testing.assert_array_equal(found.covariance, made.covariance)
    arrays = {"log_values": 0.0, "covariance": 0.0}
    assert found.model_copy(update=arrays) == made.model_copy(update=arrays)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("{}", "expected the fields of a Fit, got none"),
        ('{"schema_version": 1}', "expected a fit, made by"),
        ("[", "expected a JSON file"),
        ('{"format": "haptix fit", "schema_version": 2}', "schema_version 1, got 2"),
        ('{"format": "haptix fit", "schema_version": 1}', r"Fit\.estimates: field required"),
    ],
)
def test_files_that_are_none(tmp_path, text, said):
    (tmp_path / "fit.json").write_text(text)
    with pytest.raises(haptix.HaptixError, match=rf"fit\.json: .*{said}"):
        Fit.load(tmp_path / "fit.json")


def test_too_few_strokes(predictor, strokes, parameters):
    few = Reduced(
        (*strokes.used[:3], replace(strokes.points[9], outlier="clipped force: too much"))
    )
    with pytest.raises(haptix.InputError, match=r"6 .*got 3 .*clipped force"):
        fit_strokes(few, predictor, parameters)


def test_nothing_to_fit(predictor, strokes, parameters):
    values = {name: parameters[name].value for name in parameters.free}
    with pytest.raises(haptix.InputError, match="all are fixed"):
        fit_strokes(strokes, predictor, parameters.fixed(**values))


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda p: p.fixed(h1_m=1.0), r"'h1_m': expected one of h0_m"),
        (lambda p: p.known(h0_m=(1e-7, 0.0)), "expected a prior above 0"),
        (lambda p: p.fixed(h0_m=125.0), "h0_m: expected .* got 125; give it in the unit"),
        (lambda p: p.known(h_rms_m=(20.0, 0.05)), "h_rms_m: expected .* got 20; give it"),
        (lambda p: p.started_at(h0_m=-1.0), "expected a finite number above 0"),
    ],
)
def test_wrong_parameters_are_named(parameters, change, said):
    with pytest.raises(haptix.InputError, match=said):
        change(parameters)


@pytest.mark.slow
def test_a_roughness_that_lacks_waves_is_told_beside_the_scatter(screen, reduced_of):
    """Pixels of 10 um: the strokes of a finger with all waves are fitted with those of 20 um on."""
    base = haptix.Finger.preset("semi-wet")
    law = base.roughness.spectrum()
    cut = law.wavenumber.new_tensor([law.q0, law.q_rolloff, 3.14e5])
    spectrum = haptix.model.RoughnessSpectrum.from_table(cut, law(cut))
    seen = base.replace(roughness=MeasuredRoughness.of(spectrum, "confocal"))
    plan = full_protocol()
    few = [one for one in plan.strokes if one.normal_force_n in (0.1, 0.9)][::2]
    plan = plan.replace(strokes=tuple(few))
    whole = StrokePredictor(haptix.ContactModel(base, screen))
    true = Parameters.of(base, screen)
    reduced = reduced_of(whole, plan, true, np.random.default_rng(4))
    predictor = StrokePredictor(haptix.ContactModel(seen, screen))
    forms = other_forms(predictor.model)
    (with_waves,) = {name: form for name, form in forms.items() if "waves" in name}.items()
    start = Parameters.of(seen, screen)
    names = ("h0_m", "frictional_shear_stress_pa")
    known = start.fixed(**{n: start[n].value for n in start.free if n not in names})
    fit = fit_strokes(reduced, predictor, known, bootstraps=0, forms=dict([with_waves]))
    assert fit.unmeasured == ("roughness of the finger in waves shorter than 20 um",)
    assert "repeat within" not in fit.scatter and "shorter than 20 um" in fit.scatter
    # 1 % was put in; the strokes of 0 to 200 V cannot be had of a contact without short waves.
    assert fit.repeatability.log_mu > 0.015
    (form,) = fit.forms
    assert "waves that were not measured" in form.form and form.evidence < -10
    assert Fit.model_validate(fit.model_dump()).unmeasured == fit.unmeasured
