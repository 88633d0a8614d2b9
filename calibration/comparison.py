"""Which terms of the model the strokes need: each is switched and everything fitted anew."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import inf
from typing import Annotated, Literal

import numpy as np

from calibration.fit import Fit
from calibration.fitting import solve
from calibration.parameters import OPTIONAL, Array, Parameters, fitted_terms, optional_parameters
from calibration.predict import StrokePredictor
from calibration.reduction import Reduced
from calibration.residuals import Residuals
from haptix.errors import InputError
from haptix.friction import ContactModel
from haptix.perception import WEBER_FRACTION
from haptix.report import Heading
from haptix.terms import TERMS, Stage

Need = Literal["needed", "contradicted", "cannot tell", "changes nothing"]

_DECISIVE = 6.0  # in AICc: 20 times as likely
_NEGLIGIBLE = 0.05  # JND: the planning rule's usual share of a budget


@dataclass(frozen=True)
class TermNeed:
    """Evidence of the strokes for or against one term.

    Parameters
    ----------
    term : str
        Its name.
    is_on : bool
        Whether the term was on in the fit.
    need : {"needed", "contradicted", "cannot tell", "changes nothing"}
        The conclusion.
    evidence : float
        AICc without the term minus with it: positive speaks for the term, 6 is 20 to 1.
    effect_thresholds : float
        Largest change of friction at the strokes [JND], after the other parameters were fitted
        again.
    """

    term: Annotated[str, Heading("term")]
    is_on: Annotated[bool, Heading("in the fit", "off|on")]
    need: Annotated[Need, Heading("the strokes say")]
    evidence: Annotated[float, Heading("evidence (AICc)", "+.1f")]
    effect_thresholds: Annotated[float, Heading("effect [JND]", ".2g")]


def compare_terms(
    fit: Fit,
    reduced: Reduced,
    predictor: StrokePredictor,
    parameters: Parameters,
    compared: Sequence[str] | None = None,
) -> list[TermNeed]:
    """Refit with each term switched, where the profiles allow it.

    `fit` is what `fit_strokes` returned for the other arguments. Without names of terms the
    `comparable_terms` are switched.
    """
    points = tuple(point for point in reduced.used if point.number in fit.strokes)
    start = parameters.restarted_at({name: fit.best(name) for name in fit.free})
    base = Residuals(predictor, start, points, fit.repeatability)
    at = solve(base, base.start)
    fitted = dict(zip(start.free, at, strict=True))
    base_score, base_mu = _score(base, at), base.predict(at).log_mu
    found = []
    on = fitted_terms(predictor.model.terms, parameters.names)
    for term in comparable_terms() if compared is None else compared:
        is_on = term in on
        try:
            switched, changed = _switched(term, not is_on, predictor, start)
        except InputError:
            continue  # the profiles lack what the term needs
        other = Residuals(switched, changed, points, fit.repeatability)
        there = min((solve(other, one) for one in _starts(other, fitted)), key=other.cost)
        evidence = (_score(other, there) - base_score) * (1 if is_on else -1)
        change = np.abs(np.expm1(other.predict(there).log_mu - base_mu)).max() / WEBER_FRACTION
        found.append(TermNeed(term, is_on, _need(evidence, change), evidence, float(change)))
    return found


def comparable_terms() -> list[str]:
    """Names of the terms that a fit can do without: those that act on elastic skin."""
    return [
        name
        for name, term in TERMS.items()
        if term.changes_friction and Stage.HARDNESS not in term.stages
    ]


def _need(evidence: float, change: float) -> Need:
    if change < _NEGLIGIBLE:
        return "changes nothing"
    if evidence > _DECISIVE:
        return "needed"
    return "contradicted" if evidence < -_DECISIVE else "cannot tell"


def _score(residuals: Residuals, free: Array) -> float:
    """AICc of the data: a parameter costs as much as the strokes determine of it."""
    used = residuals.parameters_used(free)
    spare = residuals.data_rows - used - 1
    small = 2 * used * (used + 1) / spare if spare > 0 else inf
    return residuals.cost(free) + 2 * used + small


def _starts(residuals: Residuals, fitted: Mapping[str, float]) -> list[Array]:
    """Return where to start: at what was fitted, and at two values of a parameter that is new.

    From a gap that leaks much the way to one that hardly leaks, one standard deviation of the prior
    up, may lead through a worse fit.
    """
    parameters, own = residuals.parameters, residuals.start
    pairs = zip(parameters.free, own, strict=True)
    starts = [np.array([fitted.get(name, value) for name, value in pairs])]
    for number, name in enumerate(parameters.free):
        spread = parameters.prior_spread(name)
        if name not in fitted and spread is not None:
            starts.append(starts[0] + spread * (np.arange(len(own)) == number))
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
