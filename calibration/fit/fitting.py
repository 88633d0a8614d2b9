"""Fit a screen and a finger to strokes: the model's numbers, form and terms."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from math import exp, inf, log, sqrt
from typing import NamedTuple

import numpy as np
from scipy.linalg import eigh

from calibration.fit.residuals import Residuals, fit_residuals, profile, solve
from calibration.fit.result import (
    Fit,
    FormFit,
    Need,
    ParameterEstimate,
    Posterior,
    Repeatability,
    TermNeed,
)
from calibration.measure.reduction import Reduced
from calibration.plan.parameters import (
    EXPERIMENTS,
    OPTIONAL,
    PER_RIG,
    Array,
    Parameter,
    Parameters,
    fitted_terms,
    optional_parameters,
)
from calibration.plan.predict import StrokePredictor
from haptix.base.errors import InputError
from haptix.model.contact import THEORIES, TheoryName
from haptix.model.contact.persson import GapDistribution
from haptix.model.finger import Finger, MeasuredRoughness
from haptix.model.friction import ContactModel
from haptix.model.friction.placeholders import whole_roughness
from haptix.model.perception.thresholds import WEBER_FRACTION
from haptix.model.terms import TERMS, Stage

_PRIOR_SHARE = 0.8  # of the prior's spread: above it the strokes have measured nothing new
_BOOTSTRAPS = 1000
LEVEL = 0.90
"""Probability of all intervals."""
_FEWEST_STROKES = 6
_LEAST_FREEDOM = 3.0
_CURVED = 0.4  # spread of a logarithm above which the log-likelihood is no parabola
_SAME_ANSWER = 0.5  # standard deviations within which two fits are one
_OTHER_FORM = 0.5  # odds before the strokes: the default is the form that boundary elements chose
_THEORIES: tuple[TheoryName, ...] = ("local", "corrected", "open-gaps")
_MOST_EVIDENCE = 300.0  # the exponential of more would overflow


DECISIVE = 10.0
"""Evidence, minus twice the log-likelihood, for which the theory is changed: 150 to 1."""

_DECISIVE_AICC = 6.0  # in AICc: 20 times as likely
_NEGLIGIBLE = 0.05  # JND: the planning rule's usual share of a budget


def other_forms(
    model: ContactModel,
    terms: Mapping[str, bool] | None = None,
    known: Mapping[TheoryName, StrokePredictor] | None = None,
) -> dict[str, StrokePredictor]:
    """Return predictors in the other gap distribution and the other theories for calibrations.

    For a measured roughness there is one more, with the waves that were not measured. `known` are
    those that exist already, by their theories.
    """
    is_plain = model.contact.gap_distribution == "plain"
    other: GapDistribution = "combined" if is_plain else "plain"
    finger, screen = model.finger, model.screen
    by_gaps = ContactModel(finger, screen, terms=terms, theory=model.theory, gap_distribution=other)
    forms = {f'gap distribution "{other}"': StrokePredictor(by_gaps)}
    for theory in _THEORIES:
        if theory == model.theory:
            continue
        form = (known or {}).get(theory)
        if form is None:
            # With the terms that are usual for it: finite size belongs to one of them.
            usual = THEORIES[theory].usual_terms | THEORIES[model.theory].usual_terms
            kept = {name: on for name, on in (terms or {}).items() if name not in usual}
            form = StrokePredictor(ContactModel(finger, screen, terms=kept, theory=theory))
        forms[f'theory "{theory}"'] = form
    area = finger.apparent_area_at_1n_m2
    if isinstance(finger.roughness, MeasuredRoughness) and finger.roughness.unmeasured(area):
        hurst, whole = whole_roughness(finger.roughness, area)
        extended = finger.replace(roughness=whole)
        model = ContactModel(extended, screen, terms=terms, theory=model.theory)
        forms[f"waves that were not measured, H = {hurst:g}"] = StrokePredictor(model)
    return forms


def compare_forms(
    residuals: Residuals, free: Array, others: Mapping[str, tuple[Residuals, Array]]
) -> list[FormFit]:
    """Weigh fits of the same strokes in other forms.

    Both are compared at the smaller repeatability of the two, that of the form that fits better.
    """
    mu = residuals.predict(free).log_mu
    compared = []
    for name, (other, at) in others.items():
        least = Repeatability(
            min(residuals.repeatability.log_mu, other.repeatability.log_mu),
            min(residuals.repeatability.ripple, other.repeatability.ripple),
        )
        costs = [
            Residuals(form.predictor, form.parameters, form.points, least).cost(where)
            for form, where in ((other, at), (residuals, free))
        ]
        change = np.abs(np.expm1(other.predict(at).log_mu - mu)).max() / WEBER_FRACTION
        ratio = 1.0
        if "h0_m" in residuals.parameters.free:
            index = residuals.parameters.free.index("h0_m")
            ratio = float(np.exp(at[index] - free[index]))
        compared.append(FormFit(name, costs[0] - costs[1], ratio, float(change)))
    return compared


def in_form(parameters: Parameters, predictor: StrokePredictor) -> Parameters:
    """Return the parameters with the start of tau_f that another theory has."""
    shear = float(predictor.model.finger.frictional_shear_stress_pa)
    name = "frictional_shear_stress_pa"
    if parameters[name].is_fixed or parameters[name].prior is not None:
        return parameters
    return parameters.started_at(**{name: shear})


def carried_over(other: StrokePredictor, residuals: Residuals, free: Array) -> Array:
    """Return where a fit in another form starts: at this one's, with tau_f as that form has it."""
    start, name = free.copy(), "frictional_shear_stress_pa"
    parameters = residuals.parameters
    if name in parameters.free and parameters[name].prior is None:
        of_other, of_this = (
            float(predictor.model.finger.frictional_shear_stress_pa)
            for predictor in (other, residuals.predictor)
        )
        start[parameters.free.index(name)] += np.log(of_other / of_this)
    return start


def reported_within(name: str) -> float:
    """Largest standard deviation of a parameter's logarithm that is still reported as a number.

    Friction depends on the sum of d1/eps1 and the skin's d2/eps2, and determines it far better than
    either. The profile states the spread.
    """
    return 0.35 if name == "h0_m" else 0.1


def fit_strokes(
    reduced: Reduced,
    predictor: StrokePredictor,
    parameters: Parameters,
    seed: int = 0,
    bootstraps: int = _BOOTSTRAPS,
    forms: Mapping[str, StrokePredictor] | None = None,
) -> Fit:
    """Fit the strokes that are neither outliers nor held out.

    Parameters
    ----------
    reduced : Reduced
    predictor : StrokePredictor
    parameters : Parameters
        Parameters to fit, with starts and priors.
    seed : int
        Seed of the bootstrap.
    bootstraps : int
        How often the strokes are resampled; 0 takes errors from the fit's curvature alone.
    forms : mapping, optional
        Other forms of the model (`other_forms`), fitted as well: what the strokes do not tell
        apart widens the uncertainty.

    Raises
    ------
    InputError
        If there are too few strokes or nothing to fit.
    """
    points = reduced.used
    left_out = {point.number: point.outlier for point in reduced.outliers}
    if len(points) < _FEWEST_STROKES:
        reasons = "; ".join(f"stroke {n}: {why}" for n, why in list(left_out.items())[:3])
        raise InputError(
            f"expected {_FEWEST_STROKES} good strokes or more, got {len(points)}"
            + (f" ({reasons})" if reasons else "")
            + "; measure more"
        )
    if not parameters.free:
        raise InputError("expected a parameter to fit, but all are fixed")
    residuals, free = fit_residuals(predictor, parameters, points)
    light = residuals.predict(free).is_light
    if not light.all() and light.sum() >= _FEWEST_STROKES:
        for point in (p for p, is_light in zip(points, light, strict=True) if not is_light):
            left_out[point.number] = (
                f"past the light contact: at {point.voltage_v:.4g} V and "
                f"{point.normal_force_n:.3g} N it snaps in; use a lower voltage"
            )
        points = tuple(point for point in points if point.number not in left_out)
        fitted = dict(zip(parameters.free, np.exp(free).tolist(), strict=True))
        residuals, free = fit_residuals(predictor, parameters.restarted_at(fitted), points)
    covariance = np.asarray(np.linalg.inv(residuals.information(free)))
    inputs = residuals.inputs(free, covariance)
    if bootstraps:
        covariance = _larger(covariance, _bootstrap(residuals, free, seed, bootstraps))
    exchanged = _exchanged(residuals, free)
    components = [] if exchanged is None else [exchanged]
    named = [] if exchanged is None else ["finger's response and sensor's pole exchanged"]
    compared: list[FormFit] = []
    if forms:
        fitted = dict(zip(parameters.free, np.exp(free).tolist(), strict=True))
        others = {}
        for name, other in forms.items():
            known = in_form(parameters.restarted_at(fitted), other)
            others[name] = fit_residuals(other, known, points, carried_over(other, residuals, free))
        compared = compare_forms(residuals, free, others)
        named += [comparison.form for comparison in compared]
        components += [
            (at, _OTHER_FORM * exp(min(-form.evidence / 2, _MOST_EVIDENCE)))
            for form, (_, at) in zip(compared, others.values(), strict=True)
        ]
    posterior = Posterior(
        free,
        covariance,
        inputs,
        max(residuals.data_rows - residuals.parameters_used(free), _LEAST_FREEDOM),
        np.array([at for at, _ in components]).reshape(len(components), len(free)),
        np.array([odds for _, odds in components]),
        tuple(named),
    )
    return Fit(
        estimates=tuple(_estimate(residuals, posterior, parameter) for parameter in parameters.all),
        names=parameters.names,
        free=parameters.free,
        log_values=residuals.all_logs(free),
        covariance=posterior.covariance,
        repeatability=residuals.repeatability,
        cost=residuals.cost(free),
        strokes=tuple(point.number for point in points),
        left_out=left_out,
        terms=tuple(sorted(predictor.model.terms)),
        theory=predictor.model.theory,
        forms=tuple(compared),
        posterior=posterior,
        unmeasured=_unmeasured(predictor.model.finger),
    )


def _unmeasured(finger: Finger) -> tuple[str, ...]:
    roughness = finger.roughness
    if not isinstance(roughness, MeasuredRoughness):
        return ()
    return (*roughness.unmeasured(finger.apparent_area_at_1n_m2), *roughness.warnings)


def _exchanged(residuals: Residuals, free: Array) -> tuple[Array, float] | None:
    """Return the fit with the finger's response and the sensor's pole exchanged, and its odds.

    Both are of first order, so at one speed the ripple alone does not tell which is which. None
    where the exchanged fit leads back to the fit itself.
    """
    names = residuals.parameters.free
    pair = "response_hz_per_mm_per_s", "sensor_pole_hz"
    if not set(pair) <= set(names):
        return None
    response, pole = (names.index(name) for name in pair)
    speed = log(float(np.mean([point.speed_mm_per_s for point in residuals.points])))
    start = free.copy()
    start[response], start[pole] = free[pole] - speed, free[response] + speed
    other = solve(residuals, start, most_steps=15)
    spread = np.sqrt(np.diag(np.linalg.inv(residuals.information(free))))
    if float(np.abs((other - free) / spread).max()) < _SAME_ANSWER:
        return None
    rise = max(residuals.cost(other) - residuals.cost(free), 0.0)
    return other, exp(-rise / 2)


def _bootstrap(residuals: Residuals, free: Array, seed: int, count: int) -> Array:
    """Covariance from resampled strokes, each with priors drawn anew.

    A replicate takes one Gauss-Newton step from the fit, by the fit's Jacobian.
    """
    rng = np.random.default_rng(seed)
    strokes = len(residuals.points)
    jacobian = residuals.data_jacobian(free)
    # The misfits of a few strokes are smaller than their errors: the fit has absorbed some.
    spare = max(residuals.data_rows - residuals.parameters_used(free), 1.0)
    misfit = residuals.data(free) * sqrt(residuals.data_rows / spare)
    weights = residuals.weights(free)
    prior, row_of = residuals.prior_matrix, residuals.stroke_of_row
    replicates = []
    for _ in range(count):
        times = np.bincount(rng.integers(0, strokes, strokes), minlength=strokes)[row_of]
        target = residuals.prior_target + rng.normal(size=len(residuals.prior_target))
        weighted = (weights * times)[:, None] * jacobian
        slope = weighted.T @ misfit + prior.T @ (prior @ free - target)
        step = np.linalg.solve(residuals.with_prior(weighted.T @ jacobian), slope)
        replicates.append(free - step)
    return np.asarray(np.atleast_2d(np.cov(np.array(replicates).T)))


def _larger(covariance: Array, other: Array) -> Array:
    """The larger of two covariances in every direction.

    Taking the larger spread of each parameter and keeping the correlations would widen the errors
    of what they predict together, which is known far better than each parameter.
    """
    values, vectors = eigh(other, covariance)
    spread = covariance @ vectors * np.sqrt(np.maximum(values, 1.0))
    return np.asarray(spread @ spread.T)


def _estimate(
    residuals: Residuals, posterior: Posterior, parameter: Parameter
) -> ParameterEstimate:
    parameters = residuals.parameters
    estimate = partial(ParameterEstimate, name=parameter.name)
    if parameter.is_fixed:
        value = parameter.value
        return estimate(value=value, low=value, high=value, spread=0.0, verdict="fixed")
    index, free = parameters.free.index(parameter.name), posterior.middle
    middle, spread = float(free[index]), sqrt(float(posterior.covariance[index, index]))
    low, high = (
        exp(min(end, 700.0)) for end in posterior.interval(np.eye(len(free))[index], LEVEL)
    )
    before = parameters.prior_spread(parameter.name)
    is_measured = before is None or spread < _PRIOR_SHARE * before
    if is_measured and spread <= reported_within(parameter.name):
        return estimate(value=exp(middle), low=low, high=high, spread=spread, verdict="determined")
    if is_measured and spread > _CURVED and parameter.name not in PER_RIG:
        # The likelihood of this form lacks what other forms and an exchanged pole add.
        wider = profile(residuals, free, parameter.name, spread)
        low, high = min(low, wider[0]), max(high, wider[1])
    verdict = "undetermined" if is_measured else "prior"
    return estimate(
        low=low, high=high, spread=spread, verdict=verdict, advice=EXPERIMENTS[parameter.name]
    )


class ChosenFit(NamedTuple):
    """A fit, with its model and parameters."""

    fit: Fit
    predictor: StrokePredictor
    parameters: Parameters


def fit_in_best_theory(
    reduced: Reduced,
    predictor: StrokePredictor,
    parameters: Parameters,
    forms: dict[str, StrokePredictor],
) -> ChosenFit:
    """Fit, and fit again in another theory if the strokes decide for it.

    `forms` are those of `other_forms`; the one of the most evidence is tried first. A theory is
    kept where tau_f is fixed or has a prior, which belongs to that theory. Errors as `fit_strokes`.
    """
    fit = fit_strokes(reduced, predictor, parameters, forms=forms)
    first = ChosenFit(fit, predictor, parameters)
    shear = parameters["frictional_shear_stress_pa"]
    known = parameters.prior_spread(shear.name) is not None or shear.is_fixed
    against = {form.form: form.evidence for form in fit.forms}
    solved = {form.model.theory: form for form in (*forms.values(), predictor)}
    for name, other in sorted(forms.items(), key=lambda form: against[form[0]]):
        if other.model.theory == predictor.model.theory or known or against[name] > -DECISIVE:
            continue
        changed = in_form(parameters, other)
        others = other_forms(other.model, known=solved)
        again = fit_strokes(reduced, other, changed, forms=others)
        if again.cost < fit.cost:
            return ChosenFit(again, other, changed)
    return first


def compare_terms(
    fit: Fit,
    reduced: Reduced,
    predictor: StrokePredictor,
    parameters: Parameters,
    compared: Sequence[str] | None = None,
) -> list[TermNeed]:
    """Refit with each term switched, where the profiles allow it.

    Parameters
    ----------
    fit : Fit
        What `fit_strokes` returned for the other arguments.
    reduced : Reduced
    predictor : StrokePredictor
    parameters : Parameters
        Parameters to fit.
    compared : sequence of str, optional
        Terms to switch; the `comparable_terms` if not given.
    """
    points = tuple(point for point in reduced.used if point.number in fit.strokes)
    start = parameters.restarted_at({name: fit.best(name) for name in fit.free})
    base = Residuals(predictor, start, points, fit.repeatability)
    at = solve(base, base.start)
    fitted = dict(zip(start.free, at, strict=True))
    base_score, base_mu = _score(base, at), base.predict(at).log_mu
    needs = []
    on = fitted_terms(predictor.model.terms, parameters.names)
    for term in comparable_terms() if compared is None else compared:
        is_on = term in on
        try:
            switched, changed = _switched(term, not is_on, predictor, start)
        except InputError:
            continue  # the profiles lack values of the term
        other = Residuals(switched, changed, points, fit.repeatability)
        refitted = min((solve(other, start) for start in _starts(other, fitted)), key=other.cost)
        evidence = (_score(other, refitted) - base_score) * (1 if is_on else -1)
        change = np.abs(np.expm1(other.predict(refitted).log_mu - base_mu)).max() / WEBER_FRACTION
        needs.append(TermNeed(term, is_on, _need(evidence, change), evidence, float(change)))
    return needs


def comparable_terms() -> list[str]:
    """Names of the terms that a fit can switch off: those that act on elastic skin."""
    return [
        name
        for name, term in TERMS.items()
        if term.changes_friction and Stage.HARDNESS not in term.stages
    ]


def _need(evidence: float, change: float) -> Need:
    if change < _NEGLIGIBLE:
        return "changes nothing"
    if evidence > _DECISIVE_AICC:
        return "needed"
    return "contradicted" if evidence < -_DECISIVE_AICC else "cannot tell"


def _score(residuals: Residuals, free: Array) -> float:
    """AICc of the data: a parameter costs as much as the strokes determine of it."""
    used = residuals.parameters_used(free)
    spare = residuals.data_rows - used - 1
    small = 2 * used * (used + 1) / spare if spare > 0 else inf
    return residuals.cost(free) + 2 * used + small


def _starts(residuals: Residuals, fitted: Mapping[str, float]) -> list[Array]:
    """Return starts: at the fitted values, and at two values of a new parameter.

    The second start is one standard deviation of the prior higher: on the way from a gap that leaks
    much to one that hardly leaks, the fit may get worse first.
    """
    parameters, values = residuals.parameters, residuals.start
    pairs = zip(parameters.free, values, strict=True)
    starts = [np.array([fitted.get(name, value) for name, value in pairs])]
    for number, name in enumerate(parameters.free):
        spread = parameters.prior_spread(name)
        if name not in fitted and spread is not None:
            starts.append(starts[0] + spread * (np.arange(len(values)) == number))
    return starts


def _switched(
    term: str, on: bool, predictor: StrokePredictor, parameters: Parameters
) -> tuple[StrokePredictor, Parameters]:
    """Return a predictor with one term switched, and its parameters."""
    optional = optional_parameters(term)
    if optional:  # the term is on where its parameter is fitted
        if on:
            return predictor, parameters.known(**{name: OPTIONAL[name] for name in optional})
        return predictor, parameters.without(optional)
    model = predictor.model
    terms = {name: name in model.terms for name in comparable_terms()} | {term: on}
    changed = ContactModel(model.finger, model.screen, terms=terms)
    return StrokePredictor(changed, predictor), parameters
