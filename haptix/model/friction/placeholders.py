"""The uncertainty that unmeasured values leave: friction with other values in their place."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from math import pi, sqrt
from typing import Any

import torch
from torch import Tensor

from haptix.model.electro import SKIN_DIELECTRICS
from haptix.model.fidelity import FidelityName
from haptix.model.finger import SHORTEST_PER_M, Finger, MeasuredRoughness, Roughness
from haptix.model.friction.model import ContactModel
from haptix.model.perception.thresholds import WEBER_FRACTION

_SHORTEST_WAVES = (1e7, 1e8, 1e9)  # q1 [1/m]: from waves of 0.6 um to the size of molecules

_TAILS = (0.7, 1e9), (0.95, 1e9), (0.86, SHORTEST_PER_M)  # H and q1 [1/m] of waves not measured

DIELECTRIC, ROUGHNESS = "skin dielectric", "roughness"


def placeholder_spread(
    model: ContactModel,
    normal_force_n: Any,
    voltage_v: Any,
    frequency_hz: Any = None,
    **more: Any,
) -> dict[str, Tensor]:
    """Change of friction when other values replace the unmeasured ones, in JND of friction.

    Each of `haptix.model.SKIN_DIELECTRICS` replaces the skin's dielectric. Spectra of equal
    h_rms, rms slope and Hurst exponent that end at other wavelengths replace the roughness. A
    measured one gets the waves that were not measured, by three laws.

    Parameters
    ----------
    model : ContactModel
        The model; one of boundary elements is replaced by its mean field.
    normal_force_n, voltage_v, frequency_hz, more
        Inputs of `ContactModel.solve`; `more` are its other inputs by name.

    Returns
    -------
    dict of str to Tensor
        The largest ``|ln(mu_other / mu)| / 0.11``, of the broadcast shape of the inputs, under
        "skin dielectric" and "roughness"; only for values that are placeholders in the model.
    """
    at = {"voltage_v": voltage_v, "frequency_hz": frequency_hz, **more}
    unchanged = with_finger(model, model.finger)
    mu = unchanged.solve(normal_force_n, **at).mu
    largest: dict[str, Tensor] = {}
    for name, finger in _others(model, has_frequency=frequency_hz is not None):
        other = with_finger(model, finger)
        other.solver.fidelity.borrow(unchanged.solver.fidelity)
        spread = (other.solve(normal_force_n, **at).mu / mu).log().abs() / WEBER_FRACTION
        largest[name] = torch.maximum(largest[name], spread) if name in largest else spread
    return largest


def largest_spread(
    model: ContactModel, places: Mapping[str, Any], voltage_v: Any
) -> dict[str, float]:
    """Largest `placeholder_spread` [JND] over voltages and places, which are named by axis."""
    spreads = placeholder_spread(model, **{"voltage_v": voltage_v, **places})
    return {name: float(spread.max()) for name, spread in spreads.items()}


def _others(model: ContactModel, has_frequency: bool) -> Iterator[tuple[str, Finger]]:
    """Yield fingers in which one placeholder has another value, with the placeholder's name."""
    finger = model.finger
    if has_frequency and "skin-dielectric" in model.terms and finger.dielectric.is_placeholder:
        for skin in SKIN_DIELECTRICS.values():
            scaled = skin.model_copy(update={"scale": finger.dielectric.scale})
            yield DIELECTRIC, finger.replace(dielectric=scaled)
    roughness = finger.roughness
    if isinstance(roughness, MeasuredRoughness):
        if roughness.unmeasured(finger.apparent_area_at_1n_m2):
            for seen in unseen_waves(roughness, finger.apparent_area_at_1n_m2):
                yield ROUGHNESS, finger.replace(roughness=seen)
    elif roughness.is_placeholder:
        for other in alike(roughness):
            yield ROUGHNESS, finger.replace(roughness=other)


def unseen_waves(
    roughness: MeasuredRoughness, apparent_area_m2: float
) -> Iterator[MeasuredRoughness]:
    """Yield a measured roughness with each of some laws for the waves that were not measured."""
    for hurst, shortest_per_m in _TAILS:
        yield _with_all_waves(roughness, apparent_area_m2, hurst, shortest_per_m)


def whole_roughness(
    roughness: MeasuredRoughness, apparent_area_m2: float
) -> tuple[float, MeasuredRoughness]:
    """Return a Hurst exponent, that of the presets, and a roughness that goes on with it."""
    hurst = Roughness().hurst
    return hurst, _with_all_waves(roughness, apparent_area_m2, hurst, Roughness().q1_per_m)


def _with_all_waves(
    roughness: MeasuredRoughness, apparent_area_m2: float, hurst: float, shortest_per_m: float
) -> MeasuredRoughness:
    seen, longest_per_m = roughness.spectrum().of_measured_band(), 2 * pi / sqrt(apparent_area_m2)
    return MeasuredRoughness.of(seen.extended(hurst, shortest_per_m, longest_per_m))


def alike(roughness: Roughness) -> list[Roughness]:
    """Spectra of the same h_rms, slope and Hurst exponent that end at other wavelengths."""
    from scipy.optimize import brentq  # here, since it takes half a second to import

    slope = _slope(roughness)
    spectra = []
    for q1 in sorted({*_SHORTEST_WAVES} - {roughness.q1_per_m}):
        with_q1 = roughness.model_copy(update={"q1_per_m": q1})

        def excess(q_rolloff: float, with_q1: Roughness = with_q1) -> float:
            return _slope(with_q1.model_copy(update={"q_rolloff_per_m": q_rolloff})) - slope

        low, high = roughness.q0_per_m, q1 / 3
        if low < high and excess(low) < 0 < excess(high):
            rolloff = brentq(excess, low, high, rtol=1e-9)
            spectra.append(with_q1.model_copy(update={"q_rolloff_per_m": rolloff}))
    return spectra


def _slope(roughness: Roughness) -> float:
    return float(roughness.spectrum().slope_rms.detach())


def with_finger(model: ContactModel, finger: Finger) -> ContactModel:
    """The model with another finger; the mean field replaces boundary elements."""
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
