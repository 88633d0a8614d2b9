"""Uncertainty budget of a calibration, by the GUM (JCGM 100:2008) and its Supplement 1 (101:2008).

Everything is relative: the fit is in logarithms, so a sensitivity is the change of a quantity's
logarithm for each unit of an input's, and a standard uncertainty of 0.02 is 2 %. The standard
uncertainty adds all sources; the interval of 90 % is that of the mixture of the model's forms
(`calibration.fit.result.Posterior`), and k is half of it over the standard uncertainty. The
table, the JSON, the report and the certificate show these numbers.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import exp, inf, isfinite, log, sqrt
from typing import Annotated, Literal

import numpy as np

from calibration.fit.fitting import LEVEL
from calibration.fit.residuals import NORMAL_GAIN, TANGENTIAL_GAIN, VOLTAGE_GAIN
from calibration.fit.result import Fit, Input, Posterior
from calibration.measure.rig import RigCheck
from calibration.plan.parameters import Array
from calibration.plan.predict import StrokeConditions, StrokePredictor
from calibration.plan.protocol import CARRIER_HZ, FREQUENCY_HZ
from haptix.base.report import Heading
from haptix.model.perception.thresholds import WEBER_FRACTION

FORCE_N, SPEED_MM_PER_S = 0.5, 50.0
"""Where the budget states friction: the middle of the protocols."""

_SHOWN = 0.001
_STEP = 1e-3  # of a logarithm, of a numerical derivative


@dataclass(frozen=True)
class Contribution:
    """One row of a budget.

    Parameters
    ----------
    quantity, source : str
        The uncertain quantity and the source of its uncertainty.
    kind : {"A", "B"}
        A: by the statistics of the strokes; B: by other knowledge.
    sensitivity : float
        Change of the quantity's logarithm for each unit of the source's.
    standard_uncertainty : float
        Of the source, relative.
    freedom : float
        Its degrees of freedom; infinite for kind B.
    share : float
        Of the quantity's variance.
    """

    quantity: Annotated[str, Heading("quantity")]
    source: Annotated[str, Heading("source")]
    kind: Annotated[Literal["A", "B"], Heading("kind")]
    sensitivity: Annotated[float, Heading("sensitivity", "+.3g")]
    standard_uncertainty: Annotated[float, Heading("standard uncertainty", ".2%")]
    freedom: Annotated[float, Heading("degrees of freedom", ".0f", "∞")]
    share: Annotated[float, Heading("share", ".1%")]


@dataclass(frozen=True)
class Budget:
    """Uncertainty of one quantity.

    Parameters
    ----------
    quantity, unit : str
        The quantity; a unit of "1" for a ratio.
    value, low, high : float
        Value and 90 % interval, in the unit.
    standard_uncertainty : float
        Relative, of all sources together.
    freedom : float
        Effective degrees of freedom (Welch and Satterthwaite).
    coverage_factor : float
        k: half of the interval, in logarithms, over the standard uncertainty.
    contributions : tuple of Contribution
        By source, the largest share first.
    """

    quantity: Annotated[str, Heading("quantity")]
    value: Annotated[float, Heading("value", ".4g")]
    unit: Annotated[str, Heading("unit")]
    low: float
    high: Annotated[float, Heading("90 % interval", "{0.low:.4g} to {0.high:.4g}")]
    standard_uncertainty: Annotated[float, Heading("standard uncertainty", ".2%")]
    freedom: Annotated[float, Heading("degrees of freedom", ".0f", "∞")]
    coverage_factor: Annotated[float, Heading("k", ".2f")]
    contributions: tuple[Contribution, ...] = ()

    @property
    def main(self) -> list[Contribution]:
        """Contributions of a thousandth or more, as people read them."""
        return [contribution for contribution in self.contributions if contribution.share >= _SHOWN]


def uncertainty_budget(
    fit: Fit,
    predictor: StrokePredictor,
    highest_v: tuple[float, float],
    rig: RigCheck | None = None,
) -> tuple[Budget, ...]:
    """Return mu(0), mu(V)/mu(0), the reachable range, d1/eps1 and h0, with their budgets.

    Friction is that at 0.5 N and 50 mm/s. `highest_v` are the amplitudes [V] at 125 Hz and at the
    carrier to which the profile is verified. mu(V) is at 125 Hz, the range and h0 (d1/eps1 and the
    skin's d2/eps2) at the carrier. Without a `rig` check the gains are in no budget, and the
    verdict states it. Empty where no insulator was fitted.
    """
    if fit["h0_m"].value is None:
        return ()
    places = StrokeConditions(
        np.full(3, FORCE_N),
        np.array([0.0, *highest_v]),
        np.array([FREQUENCY_HZ, FREQUENCY_HZ, CARRIER_HZ]),
        np.full(3, SPEED_MM_PER_S),
    )
    free = [fit.names.index(name) for name in fit.free]
    seen = predictor(places, fit.names, fit.log_values)
    slopes = seen.log_mu_jacobian[:, free]
    made = [_budget(fit, rig, "mu(0)", "1", float(seen.log_mu[0]), slopes[0])]
    if seen.is_light[1]:
        ratio = float(seen.log_mu[1] - seen.log_mu[0])
        name = f"mu({highest_v[0]:.3g} V)/mu(0) at {FREQUENCY_HZ:g} Hz"
        made.append(_budget(fit, rig, name, "1", ratio, slopes[1] - slopes[0]))
    if seen.is_light[2] and seen.log_mu[2] > seen.log_mu[0]:
        ratio = float(seen.log_mu[2] - seen.log_mu[0])
        reached = log(np.expm1(ratio) / WEBER_FRACTION)
        slope = (slopes[2] - slopes[0]) / -np.expm1(-ratio)  # of ln(e^ratio - 1)
        made.append(_budget(fit, rig, "reachable range at the carrier", "JND", reached, slope))
    at = np.array(fit.log_values)

    def total(logs: Array) -> float:
        return log(predictor.thickness_m(fit.names, logs, CARRIER_HZ))

    steps = _STEP * np.eye(len(at))[free]
    slope = np.array([total(at + step) - total(at - step) for step in steps]) / (2 * _STEP)
    if "h0_m" in fit.free:
        unit = (np.array(fit.free) == "h0_m").astype(float)
        made.append(_budget(fit, rig, "d1/eps1", "m", log(fit.best("h0_m")), unit))
    made.append(_budget(fit, rig, "h0 at the carrier", "m", total(at), slope))
    return tuple(made)


def _budget(
    fit: Fit, rig: RigCheck | None, quantity: str, unit: str, middle: float, slope: Array
) -> Budget:
    posterior, repeats = fit.posterior, max(fit.repeatability.log_mu, 1e-9)
    scatter = sqrt(posterior.scatter(slope))
    gains = _gains(posterior, rig)
    known = [source for source in posterior.inputs if source.spread]
    of_rig = sum((gain.spread * float(slope @ gain.response)) ** 2 for gain in gains)
    variance = float(slope @ posterior.covariance @ slope) + of_rig
    sd = max(sqrt(variance), 1e-12)
    rows = [
        Contribution(
            quantity, "scatter of the strokes", "A", scatter / repeats, repeats,
            posterior.freedom, scatter**2 / sd**2,
        )
    ]  # fmt: skip
    for source in (*known, *gains, *_forms(posterior)):
        by = float(slope @ source.response)
        share = (by * source.spread / sd) ** 2
        rows.append(Contribution(quantity, source.source, "B", by, source.spread, inf, share))
    low, high = (
        end - float(slope @ posterior.middle) + middle
        for end in posterior.interval(slope, LEVEL, of_rig)
    )
    return Budget(
        quantity,
        exp(middle),
        unit,
        exp(low),
        exp(high),
        sd,
        posterior.freedom_of(slope, variance),
        (high - low) / 2 / sd,
        tuple(sorted(rows, key=lambda row: -row.share)),
    )


def _gains(posterior: Posterior, rig: RigCheck | None) -> list[Input]:
    """Gains of the rig with the spreads that its check has."""
    if rig is None:
        return []
    spreads = {NORMAL_GAIN: rig.force_gain_spread, TANGENTIAL_GAIN: rig.force_gain_spread}
    if rig.reads_volts:
        spreads[VOLTAGE_GAIN] = rig.volts_spread
    return [
        Input(source.source, spreads[source.source], source.response)
        for source in posterior.inputs
        if source.source in spreads
    ]


def _forms(posterior: Posterior) -> list[Input]:
    """Other forms of the model, at their distances from the fit, weighted by probability."""
    names = posterior.forms or ("another form of the model",) * len(posterior.odds)
    return [
        Input(name, sqrt(float(share)), away)
        for name, share, away in zip(
            names, posterior.shares, posterior.others - posterior.middle, strict=True
        )
        if isfinite(share) and share > 0
    ]
