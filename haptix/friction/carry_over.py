"""Carry a finger's tau_f over to another form of the mean field."""

from __future__ import annotations

import torch
from torch import Tensor

from haptix import checks
from haptix.contact import THEORIES, TheoryName
from haptix.fidelity import Contact, MeanFieldBalance
from haptix.finger import Finger
from haptix.screen import Screen
from haptix.terms import ActiveTerms, Properties, chosen_terms

REFERENCE_FORCE_N = 0.5
"""Where friction without voltage is kept: the middle of the paper's 0.1 to 0.9 N, and the force of
its Fig. 4."""


def in_theory(finger: Finger, theory: TheoryName) -> Finger:
    """Return the finger with a tau_f that fits a form of the mean field.

    tau_f is fitted, and mu is tau_f times the area: each form has an area of its own, so that the
    same measured friction gives each its own tau_f. Friction at 0.5 N without voltage stays.

    Parameters
    ----------
    finger : Finger
        A finger with the tau_f of its own `theory`.
    theory : {"corrected", "open-gaps", "as-published"}
        The form to carry it over to.

    Raises
    ------
    InputError
        If there is no such form.
    """
    checks.choice("theory", theory, THEORIES)
    if theory == finger.theory:
        return finger
    ratio = _area_at_rest(finger, finger.theory) / _area_at_rest(finger, theory)
    stress = finger.frictional_shear_stress_pa * ratio
    kept = stress if stress.requires_grad else float(stress)
    return finger.replace(theory=theory, frictional_shear_stress_pa=kept)


def _area_at_rest(finger: Finger, theory: TheoryName) -> Tensor:
    """A/A0 at the reference force without voltage; no screen changes it."""
    screen, form = Screen(), THEORIES[theory]
    terms = chosen_terms(None, finger, screen, MeanFieldBalance)
    active = ActiveTerms(Properties(finger, screen), terms)
    field = form.mean_field(finger.roughness.spectrum(), active.solid())
    force = torch.tensor(REFERENCE_FORCE_N, dtype=torch.float64)
    applied = force / active.apparent_area_m2(force)
    contact = Contact(field, form.contact_spots, active.hardness_pa(), float(applied))
    return contact.area_fraction(applied)
