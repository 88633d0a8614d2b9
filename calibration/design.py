"""Short protocols: strokes chosen by what they are expected to tell about the parameters."""

from __future__ import annotations

from itertools import product

import numpy as np

from calibration.parameters import Array, Mask, Parameters
from calibration.predict import StrokeConditions, StrokePredictor
from calibration.protocol import FORCES_N, FREQUENCY_HZ, Protocol
from haptix.errors import InputError

_FREQUENCIES_HZ = (30.0, 60.0, 125.0, 300.0, 1000.0, 4000.0)
_VOLTAGE_SHARES = (0.0, 0.5, 0.75, 1.0)
_HELD_OUT = ((0.4, 0.85), (0.2, 0.65), (0.8, 0.75), (0.6, 0.95))  # force [N], share of the voltage
_FEWEST_FITTED = 6

MU_ERROR = 0.01
"""Expected repeatability of mu from stroke to stroke, relative: that of a good laboratory."""
RIPPLE_ERROR = 0.02
"""The same of the ripple at 2f, relative to the ripple; an error of 0.001 in mu is added."""


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
    """Standard deviation of each parameter's logarithm that is expected after the strokes."""
    rows, is_light = expected_rows(predictor, parameters, strokes)
    light = rows[is_light]
    information = parameters.prior_information() + (light.mT @ light).sum(0)
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

    Candidates are the paper's forces with four voltages and six frequencies. Their information is
    taken at the parameters' start, from which the true values may differ as their priors say; the
    screen's insulator is therefore tried at half and at twice its value as well.

    Parameters
    ----------
    predictor, parameters
        The model, and starts and priors.
    minutes, max_voltage_v : float
        Time at the screen [min] and highest amplitude [V].
    held_out : int
        Number of the strokes that are kept for verification.

    Raises
    ------
    InputError
        If the time is too short, or the contact snaps in at all voltages.
    """
    volts = [max_voltage_v * share for share in _VOLTAGE_SHARES]
    places = np.array(list(product(FORCES_N, volts, _FREQUENCIES_HZ)))
    # Without voltage the frequency changes nothing: one of them is enough.
    places = places[(places[:, 1] > 0) | (places[:, 2] == FREQUENCY_HZ)]
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
    count = _strokes_within(minutes, held_out)
    prior = parameters.prior_information() + 1e-6 * np.eye(len(parameters.free))
    information = np.stack([prior] * len(cases))
    # What each candidate adds in each case, shape (cases, candidates, free, free).
    added = np.stack([light[:, None, None] * (rows.mT @ rows) for rows, light in cases])
    # Two without voltage come first: all others are compared with them.
    at_rest = (places[:, 1] == 0) & np.isin(places[:, 0], (FORCES_N[0], FORCES_N[-1]))
    chosen = np.flatnonzero(at_rest).tolist()
    information += added[:, chosen].sum(1)
    while len(chosen) < count - held_out:
        gain = np.zeros(len(places))
        for known, (rows, light) in zip(information, cases, strict=True):
            inner = np.einsum("sap,pq,sbq->sab", rows, np.linalg.inv(known), rows) + np.eye(2)
            gain += np.where(light, np.log(np.linalg.det(inner)), 0.0)
        gain[~usable] = -np.inf
        chosen.append(int(gain.argmax()))
        information += added[:, chosen[-1]]
    return Protocol.shuffled(
        "short",
        places[chosen].tolist(),
        [(force, share * max_voltage_v, FREQUENCY_HZ) for force, share in _HELD_OUT[:held_out]],
    )


def _strokes_within(minutes: float, held_out: int) -> int:
    """Number of strokes that fit into a time, those held out included."""
    each_s = float(Protocol.model_fields["seconds_per_stroke"].default)
    count = int(60 * minutes / each_s + 1e-9)
    least = _FEWEST_FITTED + held_out
    if count < least:
        raise InputError(
            f"minutes: expected time for {least} strokes of {each_s:g} s or more "
            f"({least * each_s / 60:.2g} minutes), got {minutes:g} minutes"
        )
    return count
