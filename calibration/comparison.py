"""Which terms of the model the strokes need: the planning rule, applied to data."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf
from typing import Literal

import numpy as np

from calibration.fitting import Fit, solve
from calibration.parameters import (
    OPTIONAL,
    Array,
    Parameters,
    fitted_terms,
    optional_parameters,
)
from calibration.predict import StrokePredictor
from calibration.reduction import Reduced
from calibration.residuals import Residuals
from haptix.errors import InputError
from haptix.friction import ContactModel
from haptix.perception import WEBER_FRACTION
from haptix.terms import TERMS, Stage

Need = Literal["needed", "contradicted", "cannot tell", "changes nothing"]

_DECISIVE = 6.0  # in AICc: 20 times as likely
_UNFELT = 0.05  # thresholds: the planning rule's usual share of a budget


@dataclass(frozen=True)
class TermNeed:
    """One term, switched the other way and everything fitted anew.

    Parameters
    ----------
    term : str
        Its name.
    is_on : bool
        Whether the fit had it.
    need : {"needed", "contradicted", "cannot tell", "changes nothing"}
        What the strokes say of the term.
    evidence : float
        AICc without the term minus with it: positive speaks for the term, 6 is 20 to 1.
    effect_thresholds : float
        Largest change of friction at the strokes, after the other parameters made up for it.
    """

    term: str
    is_on: bool
    need: Need
    evidence: float
    effect_thresholds: float


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
        Of the same strokes, predictor and parameters.
    reduced, predictor, parameters
        As `fit_strokes` had them.
    compared : sequence of str, optional
        Names of terms; `comparable_terms` without.
    """
    points = tuple(point for point in reduced.used if point.number in fit.strokes)
    best = [name for name in fit.free if parameters[name].prior is None]
    start = parameters.started_at(**{name: fit.best(name) for name in best})
    base = Residuals(predictor, start, points, fit.repeatability)
    at = solve(base, base.start)
    base_score, base_mu = _score(base, at), base.predict(at).log_mu
    found = []
    on = fitted_terms(predictor.model.terms, parameters.names)
    for term in comparable_terms() if compared is None else compared:
        is_on = term in on
        try:
            switched, changed = _switched(term, not is_on, predictor, start)
        except InputError:
            continue  # the profiles have not what the term needs
        other = Residuals(switched, changed, points, fit.repeatability)
        there = solve(other, other.start)
        score = _score(other, there)
        evidence = score - base_score if is_on else base_score - score
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
    if change < _UNFELT:
        return "changes nothing"
    if evidence > _DECISIVE:
        return "needed"
    return "contradicted" if evidence < -_DECISIVE else "cannot tell"


def _score(residuals: Residuals, free: Array) -> float:
    """AICc of the data: what is paid for a parameter is what the strokes determine of it."""
    jacobian = residuals.data_jacobian(free)
    weighted = residuals.weights(free)[:, None] * jacobian
    used_up = float(np.trace(np.linalg.solve(residuals.information(free), jacobian.T @ weighted)))
    rows = residuals.data_rows
    spare = rows - used_up - 1
    small = 2 * used_up * (used_up + 1) / spare if spare > 0 else inf
    return residuals.cost(free) + 2 * used_up + small


def _switched(
    term: str, on: bool, predictor: StrokePredictor, parameters: Parameters
) -> tuple[StrokePredictor, Parameters]:
    """Return a predictor with one term switched, and its parameters."""
    model = predictor.model
    optional = optional_parameters(term)
    if optional:  # the term is on where its parameter is fitted
        if on:
            return predictor, parameters.known(**{name: OPTIONAL[name] for name in optional})
        kept = tuple(one for one in parameters.all if one.name not in optional)
        return predictor, Parameters(kept, parameters.finger_prior)
    terms = {name: name in model.terms for name in comparable_terms()}
    changed = ContactModel(
        model.finger,
        model.screen,
        theory=model.theory,
        terms={**terms, term: on},
    )
    return predictor.with_model(changed), parameters
