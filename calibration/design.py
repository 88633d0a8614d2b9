"""Short protocols, chosen by what their strokes are expected to tell about the parameters."""

from __future__ import annotations

from itertools import product

import numpy as np

from calibration.parameters import Array, Mask, Parameters
from calibration.predict import StrokeConditions, StrokePredictor
from calibration.protocol import FORCES_N, Protocol, numbered, strokes_within
from haptix.errors import InputError

_FREQUENCIES_HZ = (30.0, 60.0, 125.0, 300.0, 1000.0, 4000.0)
_VOLTAGE_SHARES = (0.0, 0.5, 0.75, 1.0)

MU_ERROR = 0.01
"""Repeatability of mu from stroke to stroke that is expected, relative: a good laboratory's."""
RIPPLE_ERROR = 0.02
"""The same of the ripple at 2f, relative to the ripple; of a mean friction, 0.001 besides."""


def expected_rows(
    predictor: StrokePredictor, parameters: Parameters, strokes: StrokeConditions
) -> tuple[Array, Mask]:
    """Jacobian of each stroke by the free parameters in units of its errors.

    Returns
    -------
    rows : array, shape (strokes, 2, free)
        Of ln mu and of the ripple.
    is_light : array of bool, shape (strokes,)
        False where the light contact would end.
    """
    found = predictor(strokes, parameters.names, parameters.log_values)
    ripple_sd = np.hypot(RIPPLE_ERROR * found.ripple, 1e-3)
    rows = np.stack(
        [found.log_mu_jacobian / MU_ERROR, found.ripple_jacobian / ripple_sd[:, None]], axis=1
    )
    free = [parameters.names.index(name) for name in parameters.free]
    return rows[:, :, free], found.is_light


def expected_spread(
    predictor: StrokePredictor, parameters: Parameters, strokes: StrokeConditions
) -> dict[str, float]:
    """Standard deviation of each logarithm that strokes are expected to leave."""
    rows, is_light = expected_rows(predictor, parameters, strokes)
    information = _prior_information(parameters) + np.einsum(
        "skp,skq->pq", rows[is_light], rows[is_light]
    )
    spread = np.sqrt(np.diag(np.linalg.inv(information)))
    return dict(zip(parameters.free, spread.tolist(), strict=True))


def short_protocol(
    predictor: StrokePredictor,
    parameters: Parameters,
    minutes: float = 3.0,
    max_voltage_v: float = 200.0,
    held_out: int = 3,
) -> Protocol:
    """Choose strokes one by one, each the one that tells most (D-optimal, greedy).

    Candidates are the paper's forces with four voltages and six frequencies. They are judged at
    the parameters' start, which the true values may be away from by their priors; the screen's
    insulator is therefore tried at half and at twice its value as well.

    Parameters
    ----------
    predictor : StrokePredictor
        The model.
    parameters : Parameters
        Their start and priors.
    minutes : float
        Time at the screen.
    max_voltage_v : float
        Highest amplitude.
    held_out : int
        Strokes of these that are kept for verification.

    Raises
    ------
    InputError
        If there is no time, or the contact snaps in at all voltages.
    """
    places = np.array(
        list(product(FORCES_N, [max_voltage_v * s for s in _VOLTAGE_SHARES], _FREQUENCIES_HZ))
    )
    # Without voltage the frequency changes nothing: one of them is enough.
    places = places[(places[:, 1] > 0) | (places[:, 2] == 125.0)]
    strokes = StrokeConditions(places[:, 0], places[:, 1], places[:, 2], np.full(len(places), 50.0))
    h0 = parameters["h0_m"].value
    cases = [
        expected_rows(predictor, parameters.started_at(h0_m=factor * h0), strokes)
        for factor in (0.5, 1.0, 2.0)
    ]
    usable = cases[1][1]
    if not usable[strokes.voltage_v > 0].any():
        raise InputError(
            f"max_voltage_v: expected one that the light contact bears, got {max_voltage_v:g} V; "
            "lower it"
        )
    template = Protocol.model_fields["seconds_per_stroke"].default
    count = strokes_within(minutes, template, held_out)
    information = [_prior_information(parameters) + 1e-6 * np.eye(len(parameters.free))] * 3
    # Two without voltage come first: what everything else is compared with.
    rest_force = (places[:, 1] == 0) & np.isin(places[:, 0], (FORCES_N[0], FORCES_N[-1]))
    chosen = np.flatnonzero(rest_force).tolist()
    for index in chosen:
        information = [
            known + rows[index].T @ rows[index]
            for known, (rows, _) in zip(information, cases, strict=True)
        ]
    for _ in range(count - held_out - len(chosen)):
        gain = np.zeros(len(places))
        for known, (rows, light) in zip(information, cases, strict=True):
            inverse = np.linalg.inv(known)
            inner = np.einsum("sap,pq,sbq->sab", rows, inverse, rows) + np.eye(2)
            gain += np.where(light, np.log(np.linalg.det(inner)), 0.0)
        gain[~usable] = -np.inf
        best = int(gain.argmax())
        chosen.append(best)
        information = [
            known + light[best] * rows[best].T @ rows[best]
            for known, (rows, light) in zip(information, cases, strict=True)
        ]
    kept = [(*places[index], False) for index in chosen]
    rest = [(0.4, 0.85), (0.2, 0.65), (0.8, 0.75), (0.6, 0.95)]
    kept += [(f, share * max_voltage_v, 125.0, True) for f, share in rest[:held_out]]
    return Protocol(
        name="short",
        strokes=numbered(
            [
                {
                    "normal_force_n": float(force),
                    "voltage_v": round(float(volts), 3),
                    "frequency_hz": float(hertz),
                    "held_out": is_held_out,
                }
                for force, volts, hertz, is_held_out in kept
            ]
        ),
    )


def _prior_information(parameters: Parameters) -> Array:
    rows, _ = parameters.prior_rows()
    return rows.T @ rows
