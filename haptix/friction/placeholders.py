"""What values that were not measured leave open: friction with others in their place."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import torch
from torch import Tensor

from haptix.electro import SKIN_DIELECTRICS
from haptix.fidelity import FidelityName
from haptix.finger import Finger, Roughness
from haptix.friction.model import ContactModel
from haptix.perception import WEBER_FRACTION

_SHORTEST_WAVES = (1e7, 1e8, 1e9)  # q1 [1/m]: from waves of 0.6 um to what a molecule leaves

DIELECTRIC, ROUGHNESS = "skin dielectric", "roughness"


def placeholder_spread(
    model: ContactModel,
    normal_force_n: Any,
    voltage_v: Any,
    frequency_hz: Any = None,
    **more: Any,
) -> dict[str, Tensor]:
    """Difference that other values in place of unmeasured ones make, in JND of the friction.

    The skin's dielectric is replaced by each of `haptix.electro.SKIN_DIELECTRICS`, the roughness
    by spectra of equal h_rms, rms slope and Hurst exponent that end at other wavelengths.

    Parameters
    ----------
    model : ContactModel
        Boundary elements are replaced by the mean field.
    normal_force_n, voltage_v, frequency_hz, more
        As for `ContactModel.solve`, which takes others of its inputs by name.

    Returns
    -------
    dict of str to Tensor
        By "skin dielectric" and "roughness", where the model rests on a placeholder of it: the
        largest ``|ln(mu_other / mu)| / 0.11``, of the broadcast shape of the inputs.
    """
    at = {"voltage_v": voltage_v, "frequency_hz": frequency_hz, **more}
    unchanged = _with_finger(model, model.finger)
    mu = unchanged.solve(normal_force_n, **at).mu
    largest: dict[str, Tensor] = {}
    for name, finger in _others(model, has_frequency=frequency_hz is not None):
        other = _with_finger(model, finger)
        other.solver.fidelity.borrow(unchanged.solver.fidelity)
        spread = (other.solve(normal_force_n, **at).mu / mu).log().abs() / WEBER_FRACTION
        largest[name] = torch.maximum(largest[name], spread) if name in largest else spread
    return largest


def largest_spread(
    model: ContactModel, places: Mapping[str, Any], voltage_v: Any
) -> dict[str, float]:
    """Largest `placeholder_spread` [JND] over places, by name of the axis, and voltages."""
    spreads = placeholder_spread(model, **{"voltage_v": voltage_v, **places})
    return {name: float(spread.max()) for name, spread in spreads.items()}


def _others(model: ContactModel, has_frequency: bool) -> Iterator[tuple[str, Finger]]:
    """Fingers with another value in place of one placeholder each, under its name."""
    finger = model.finger
    if has_frequency and "skin-dielectric" in model.terms and finger.dielectric.is_placeholder:
        for skin in SKIN_DIELECTRICS.values():
            scaled = skin.model_copy(update={"scale": finger.dielectric.scale})
            yield DIELECTRIC, finger.replace(dielectric=scaled)
    if isinstance(finger.roughness, Roughness) and finger.roughness.is_placeholder:
        for other in alike(finger.roughness):
            yield ROUGHNESS, finger.replace(roughness=other)


def alike(roughness: Roughness) -> list[Roughness]:
    """Other spectra of the same h_rms, slope and Hurst exponent, whose waves end elsewhere."""
    from scipy.optimize import brentq  # half a second of every start

    slope = _slope(roughness)
    spectra = []
    for q1 in sorted({*_SHORTEST_WAVES} - {roughness.q1_per_m}):
        ends = roughness.model_copy(update={"q1_per_m": q1})

        def excess(q_rolloff: float, ends: Roughness = ends) -> float:
            return _slope(ends.model_copy(update={"q_rolloff_per_m": q_rolloff})) - slope

        low, high = roughness.q0_per_m, q1 / 3
        if low < high and excess(low) < 0 < excess(high):
            rolloff = brentq(excess, low, high, rtol=1e-9)
            spectra.append(ends.model_copy(update={"q_rolloff_per_m": rolloff}))
    return spectra


def _slope(roughness: Roughness) -> float:
    return float(roughness.spectrum().slope_rms.detach())


def _with_finger(model: ContactModel, finger: Finger) -> ContactModel:
    """The same model of another finger; by the mean field instead of boundary elements."""
    fidelity: FidelityName = "mean-field" if model.boxed is not None else model.fidelity
    return ContactModel(
        finger,
        model.screen,
        fidelity,
        contact_spots=model.contact_spots,
        gap_distribution=model.contact.gap_distribution,
        gamma=model.contact.gamma,
        terms=model.terms,
        theory=model.theory,
    )
