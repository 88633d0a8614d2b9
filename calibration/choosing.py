"""Fit in the theory of the contact that the strokes favour."""

from __future__ import annotations

from typing import NamedTuple

from calibration.fit import Fit
from calibration.fitting import fit_strokes
from calibration.forms import in_form, other_forms
from calibration.parameters import Parameters
from calibration.predict import StrokePredictor
from calibration.reduction import Reduced

DECISIVE = 10.0
"""Evidence, minus twice the log-likelihood, for which the theory is changed: 150 to 1."""


class ChosenFit(NamedTuple):
    """A fit, and what it was made with."""

    fit: Fit
    predictor: StrokePredictor
    parameters: Parameters


def fit_in_best_theory(
    reduced: Reduced,
    predictor: StrokePredictor,
    parameters: Parameters,
    forms: dict[str, StrokePredictor],
) -> ChosenFit:
    """Fit, and fit again in the other theory if the strokes decide for it.

    `forms` are those of `calibration.forms.other_forms`. A theory is kept where tau_f is fixed or
    has a prior, which belongs to that theory. Errors as `fit_strokes`.
    """
    fit = fit_strokes(reduced, predictor, parameters, forms=forms)
    first = ChosenFit(fit, predictor, parameters)
    shear = parameters["frictional_shear_stress_pa"]
    known = parameters.prior_spread(shear.name) is not None or shear.is_fixed
    against = {one.form: one.evidence for one in fit.forms}
    for name, other in forms.items():
        if other.model.theory == predictor.model.theory or known or against[name] > -DECISIVE:
            continue
        changed = in_form(parameters, other)
        others = other_forms(other.model, tables=predictor)
        again = fit_strokes(reduced, other, changed, forms=others)
        if again.cost < fit.cost:
            return ChosenFit(again, other, changed)
    return first
