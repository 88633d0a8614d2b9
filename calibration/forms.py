"""The error of the model's own form: the strokes fitted by another theory and gap distribution.

A profile is written in one form. Where the strokes do not tell it from another, the parameters of
both are possible, and the difference belongs to their uncertainty.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from scipy.special import expit

from calibration.parameters import Array, Parameters
from calibration.predict import StrokePredictor
from calibration.residuals import Repeatability, Residuals
from haptix.contact import THEORIES, TheoryName
from haptix.contact.meanfield import GapDistribution
from haptix.friction import ContactModel
from haptix.perception import WEBER_FRACTION
from haptix.report import Heading


@dataclass(frozen=True)
class FormFit:
    """The strokes fitted in another form.

    Parameters
    ----------
    form : str
        Its name.
    evidence : float
        Minus twice the log-likelihood in this form, less that in the fit's own: below 0 it fits
        better.
    h0_ratio : float
        d1/eps1 in this form over that of the fit.
    effect_thresholds : float
        Largest change of friction at the strokes [JND].
    """

    form: Annotated[str, Heading("form")]
    evidence: Annotated[float, Heading("evidence against it", "+.1f")]
    h0_ratio: Annotated[float, Heading("d1/eps1, over the fit's", ".3g")]
    effect_thresholds: Annotated[float, Heading("friction changes by [JND]", ".2g")]

    @property
    def weight(self) -> float:
        """Probability of this form against the fit's own, if both were as likely before."""
        return float(expit(-self.evidence / 2))


def other_forms(
    model: ContactModel,
    terms: Mapping[str, bool] | None = None,
    tables: StrokePredictor | None = None,
) -> dict[str, StrokePredictor]:
    """Predictors in the other gap distribution, and in the other theory that calibrates.

    `tables` is one that exists already, of the other theory.
    """
    is_combined = model.contact.gap_distribution == "combined"
    other: GapDistribution = "plain" if is_combined else "combined"
    theory: TheoryName = "open-gaps" if model.theory == "corrected" else "corrected"
    finger, screen = model.finger, model.screen
    by_gaps = ContactModel(finger, screen, terms=terms, theory=model.theory, gap_distribution=other)
    if tables is None:
        # The other theory with the terms that are usual for it: finite size belongs to one of them.
        usual = THEORIES[theory].usual_terms | THEORIES[model.theory].usual_terms
        kept = {name: on for name, on in (terms or {}).items() if name not in usual}
        tables = StrokePredictor(ContactModel(finger, screen, terms=kept, theory=theory))
    return {
        f'gap distribution "{other}"': StrokePredictor(by_gaps),
        f'theory "{theory}"': tables,
    }


def compare_forms(
    residuals: Residuals,
    free: Array,
    others: Mapping[str, tuple[Residuals, Array]],
) -> list[FormFit]:
    """Weigh fits of the same strokes in other forms.

    Both are compared at the smaller repeatability of the two, that of the form that fits better.
    """
    mu = residuals.predict(free).log_mu
    found = []
    for name, (other, at) in others.items():
        least = Repeatability(
            min(residuals.repeatability.log_mu, other.repeatability.log_mu),
            min(residuals.repeatability.ripple, other.repeatability.ripple),
        )
        costs = [
            Residuals(one.predictor, one.parameters, one.points, least).cost(where)
            for one, where in ((other, at), (residuals, free))
        ]
        change = np.abs(np.expm1(other.predict(at).log_mu - mu)).max() / WEBER_FRACTION
        ratio = 1.0
        if "h0_m" in residuals.parameters.free:
            index = residuals.parameters.free.index("h0_m")
            ratio = float(np.exp(at[index] - free[index]))
        found.append(FormFit(name, costs[0] - costs[1], ratio, float(change)))
    return found


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
        there, here = (
            float(one.model.finger.frictional_shear_stress_pa)
            for one in (other, residuals.predictor)
        )
        start[parameters.free.index(name)] += np.log(there / here)
    return start
