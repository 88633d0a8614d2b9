"""The result of a fit: estimates with intervals, as a file that later steps read."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from math import exp, inf, sqrt
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, Self

import numpy as np
from pydantic import BeforeValidator, Field, PlainSerializer, PlainValidator, model_validator
from scipy.optimize import brentq
from scipy.special import expit
from scipy.stats import t as student

from calibration.plan.parameters import PER_FINGER, Array, FingerPrior
from haptix.base.display import Displayed
from haptix.base.documents import Document, Part
from haptix.base.errors import InputError
from haptix.base.files import digest
from haptix.base.report import Heading
from haptix.base.version import __version__
from haptix.model.contact import TheoryName

_WIDEST = 60.0  # standard deviations within which a quantile is looked for

Verdict = Literal["determined", "prior", "undetermined", "fixed"]


def _finite(values: Any) -> Array:
    try:
        numbers = np.asarray(values, dtype=float)
    except (TypeError, OverflowError) as error:
        raise ValueError(f"expected numbers: {error}") from None
    if not np.isfinite(numbers).all():
        raise ValueError("expected finite numbers")
    return numbers


_Numbers = Annotated[
    Array, PlainValidator(_finite), PlainSerializer(lambda values: values.tolist())
]
_UpperBound = Annotated[  # JSON has no infinity
    float,
    Field(allow_inf_nan=True),
    BeforeValidator(lambda value: inf if value is None else value),
    PlainSerializer(lambda value: None if value == inf else value),
]


@dataclass(frozen=True)
class Repeatability:
    """Relative spread of repeated strokes beyond their own errors: the finger dries and turns."""

    log_mu: float = 0.01
    """Standard deviation of ln mu."""
    ripple: float = 0.01
    """Standard deviation of the ripple, over the ripple."""


Need = Literal["needed", "contradicted", "cannot tell", "changes nothing"]


@dataclass(frozen=True)
class FormFit:
    """The strokes fitted in another form."""

    form: Annotated[str, Heading("form")]
    """Its name."""
    evidence: Annotated[float, Heading("evidence against it", "+.1f")]
    """Minus twice the log-likelihood in this form, less that in the fit's own: below 0 it fits
    better."""
    h0_ratio: Annotated[float, Heading("d1/eps1, over the fit's", ".3g")]
    """d1/eps1 in this form over that of the fit."""
    effect_jnd: Annotated[float, Heading("friction changes by [JND]", ".2g")]
    """Largest change of friction at the strokes [JND]."""

    @property
    def weight(self) -> float:
        """Probability of this form against the fit's own, if both were as likely before."""
        return float(expit(-self.evidence / 2))


@dataclass(frozen=True)
class TermNeed:
    """Evidence of the strokes for or against one term."""

    term: Annotated[str, Heading("term")]
    """Its name."""
    is_on: Annotated[bool, Heading("in the fit", "off|on")]
    """Whether the term was on in the fit."""
    need: Annotated[Need, Heading("the strokes say")]
    """The conclusion."""
    evidence: Annotated[float, Heading("evidence (AICc)", "+.1f")]
    """AICc without the term minus with it: positive speaks for the term, 6 is 20 to 1."""
    effect_jnd: Annotated[float, Heading("effect [JND]", ".2g")]
    """Largest change of friction at the strokes [JND], after the other parameters were fitted
    again."""


class ParameterEstimate(Part):
    """A fit's estimate of one parameter."""

    name: Annotated[str, Heading("parameter")]
    """Of `calibration.plan.parameters.NAMES`."""
    value: Annotated[float | None, Heading("value", ".4g", "not determined")] = None
    """Value in the unit that the name ends with; None where the strokes do not determine it."""
    low: float
    high: _UpperBound = inf
    """90 % interval; 0 or infinite where the strokes set no bound."""
    spread: Annotated[float, Heading("spread", ".1%")]
    """Standard deviation of the logarithm."""
    verdict: Annotated[Verdict, Heading("verdict")]
    """"prior" where the strokes add nothing to the prior."""
    advice: str = ""
    """Which experiment would determine it; empty where none is needed."""

    @property
    def interval(self) -> Annotated[str, Heading("90 % interval")]:
        """Both ends, for people."""
        high = "∞" if self.high == inf else f"{self.high:.3g}"
        return "" if self.verdict == "fixed" else f"{self.low:.3g} to {high}"

    def refusal(self) -> str:
        """Return one sentence: why there is no value, and what would give one."""
        if self.low > 0 and self.high < inf:
            bounds = f"anything from {self.low:.3g} to {self.high:.3g} fits"
        elif self.low > 0:
            bounds = f"anything above {self.low:.3g} fits"
        elif self.high < inf:
            bounds = f"anything below {self.high:.3g} fits"
        else:
            bounds = "any value fits"
        what = "only its prior is known" if self.verdict == "prior" else bounds
        return f"{self.name} is not determined by these strokes: {what}; {self.advice}"


@dataclass(frozen=True)
class Input(Displayed):
    """One source of uncertainty of the fit besides the strokes' scatter."""

    source: str
    """The quantity."""
    spread: float
    """Its relative standard uncertainty; 0 of a gain, which the rig's check knows."""
    response: _Numbers
    """Change of the free parameters' logarithms for each unit of its own; shape (free,)."""


@dataclass(frozen=True)
class Posterior(Displayed):
    """Posterior distribution of the free parameters' logarithms.

    A mixture of normal distributions. The fit in its own form is one component; each other form,
    and the fit with the finger's response and the sensor's pole exchanged, is another, weighed by
    its likelihood. A normal distribution as wide as their distance would hold the truth too often.
    """

    middle: _Numbers
    """The fit; shape (free,)."""
    own: _Numbers
    """Covariance about each component's middle; shape (free, free)."""
    inputs: tuple[Input, ...]
    """The prior: its part of `own` has no few degrees of freedom."""
    freedom: float
    """Degrees of freedom of the strokes' repeatability, which is itself estimated."""
    others: _Numbers
    """Middles of the other components; shape (components, free)."""
    odds: _Numbers
    """Their likelihoods over the fit's; shape (components,)."""
    forms: tuple[str, ...] = ()
    """Their names."""

    def __post_init__(self) -> None:  # a file has no shape of an empty array
        others = np.reshape(self.others, (len(self.odds), len(self.middle)))
        object.__setattr__(self, "others", others)

    @property
    def covariance(self) -> Array:
        """Second moment about the fit, shape (free, free)."""
        away = self.others - self.middle
        return np.asarray(self.own + (self.shares[:, None] * away).T @ away)

    @property
    def shares(self) -> Array:
        """Probability of each other component."""
        return np.asarray(self.odds / (1 + self.odds.sum()))

    def scatter(self, direction: Array) -> float:
        """Variance that the strokes' scatter leaves along a direction of the logarithms."""
        known = sum(
            (source.spread * float(direction @ source.response)) ** 2 for source in self.inputs
        )
        return max(float(direction @ self.own @ direction) - known, 0.0)

    def freedom_of(self, direction: Array, variance: float) -> float:
        """Degrees of freedom of a variance in which the scatter has its part.

        By Welch and Satterthwaite; prior knowledge counts with infinite degrees of freedom.
        """
        return self.freedom / max(self.scatter(direction) / variance, 1e-3) ** 2

    def interval(self, direction: Array, level: float, more: float = 0.0) -> tuple[float, float]:
        """Equal-tailed interval along a direction of the logarithms; the fit always lies within.

        `more` is a variance besides, such as that of the rig's gains.
        """
        at = np.array([direction @ place for place in (self.middle, *self.others)])
        weights = np.concatenate([[1.0], self.odds])
        weights /= weights.sum()
        variance = float(direction @ self.own @ direction) + more
        sd, freedom = sqrt(variance), self.freedom_of(direction, variance)

        def beyond(value: float, tail: float) -> float:
            return float(weights @ student.cdf((value - at) / sd, freedom)) - tail

        ends = at.min() - _WIDEST * sd, at.max() + _WIDEST * sd
        low, high = (
            float(brentq(partial(beyond, tail=tail), *ends))
            for tail in ((1 - level) / 2, (1 + level) / 2)
        )
        return min(low, float(at[0])), max(high, float(at[0]))


class Fit(Document):
    """A fitted screen and finger.

    Parameters
    ----------
    estimates : tuple of ParameterEstimate
        One for each parameter.
    names, free : tuple of str
        All parameters, and those that were fitted.
    log_values : array, shape (names,)
        Best values, those of undetermined parameters included: together they predict, alone they
        mean nothing.
    covariance : array, shape (free, free)
        Covariance of the logarithms.
    repeatability : Repeatability
        How well the strokes repeat.
    cost : float
        Minus twice the log-likelihood, priors included.
    strokes : tuple of int
        Numbers of the strokes that were used.
    left_out : mapping of int to str
        Strokes that were not used, with reasons.
    terms : tuple of str
        Terms of the model that were on.
    theory : str
        Theory of the contact.
    forms : tuple of FormFit
        The strokes fitted in other forms of the model.
    posterior : Posterior
        Parts of the covariance.
    unmeasured : tuple of str
        What the roughness of the finger lacks, and warnings about it.
    made_from : mapping of str to str
        SHA-256 of each file of the session that the fit rests on.
    made_by : str
        Version of haptix.
    content_hash : str
        SHA-256 of everything else.
    """

    format: Literal["haptix fit"] = "haptix fit"
    estimates: tuple[ParameterEstimate, ...]
    names: tuple[str, ...]
    free: tuple[str, ...]
    log_values: _Numbers
    covariance: _Numbers
    repeatability: Repeatability
    cost: float
    strokes: tuple[int, ...]
    left_out: dict[int, str]
    terms: tuple[str, ...]
    theory: TheoryName
    forms: tuple[FormFit, ...] = ()
    posterior: Posterior
    unmeasured: Annotated[tuple[str, ...], Field(exclude_if=lambda names: not names)] = ()
    made_from: dict[str, str] = Field(default={})
    made_by: str = ""
    content_hash: str = ""

    @model_validator(mode="after")
    def _belongs_together(self) -> Self:
        count = len(self.free)
        if self.log_values.shape != (len(self.names),) or not set(self.free) <= set(self.names):
            raise ValueError("log_values and free: expected a number for each of the names")
        if self.covariance.shape != (count, count):
            raise ValueError(f"covariance: expected shape ({count}, {count})")
        return self

    @classmethod
    def _from_table(cls, fields: dict[str, Any], folder: Path) -> Self:
        if fields.get("format") != "haptix fit":
            raise InputError("expected a fit, made by `haptix calibrate fit`")
        try:
            return super()._from_table(fields, folder)
        except InputError as error:
            raise InputError(f"{error}; make it anew with `haptix calibrate fit`") from None

    def __getitem__(self, name: str) -> ParameterEstimate:
        for estimate in self.estimates:
            if estimate.name == name:
                return estimate
        raise InputError(f"parameter {name!r}: expected one of {', '.join(self.names)}")

    def signed(self, made_from: Mapping[str, str]) -> Self:
        """Return a copy that is bound to the files with these hashes."""
        bound = self.replace(made_from=dict(made_from), made_by=__version__, content_hash="")
        return bound.replace(content_hash=bound._own_hash())

    def check_unchanged(self, made_from: Mapping[str, str]) -> None:
        """Raise `InputError` unless this fit is what `signed` made, of files with these hashes."""
        again = "; make it anew with `haptix calibrate fit`"
        if not self.content_hash:
            raise InputError(f"fit.json is not bound to its session{again}")
        self.check_unedited()
        if self.made_by != __version__:
            raise InputError(
                f"fit.json was made by haptix {self.made_by}, this is {__version__}{again}"
            )
        for name in sorted({*self.made_from, *made_from}):
            before, now = self.made_from.get(name), made_from.get(name)
            if now is None:
                raise InputError(f"{name} was deleted after the fit: restore it, or fit again")
            if before != now:
                what = "added" if before is None else "changed"
                raise InputError(f"{name} was {what} after the fit: reduce and fit again")

    def check_unedited(self, file: str = "fit.json") -> None:
        """Raise `InputError` if this fit was edited after it was signed."""
        if self.content_hash and self.content_hash != self._own_hash():
            raise InputError(
                f"{file} was edited after the fit, or is of another version of haptix; make it "
                "anew with `haptix calibrate fit`"
            )

    def _own_hash(self) -> str:
        return digest(self.model_dump(mode="json", exclude={"content_hash"}))

    @property
    def undetermined(self) -> list[ParameterEstimate]:
        """Estimates without a value."""
        return [estimate for estimate in self.estimates if estimate.value is None]

    def parts(self, needs: Sequence[TermNeed] = ()) -> list[tuple[str, Sequence[Any]]]:
        """Return the parts of its report, by title: rows of a table, or lines."""
        left_out = [f"stroke {number}: {why}" for number, why in sorted(self.left_out.items())]
        return [
            ("Results", self.estimates),
            ("Not determined", [estimate.refusal() for estimate in self.undetermined]),
            ("Belongs to its model", [f"{self.shear}: {self.shear_note}"]),
            ("Other forms of the model", self.forms),
            ("Which terms the strokes need", needs),
            ("Strokes that were not used", left_out),
        ]

    @property
    def scatter(self) -> str:
        """How far the strokes lie from the model, in words, and why."""
        size = f"{self.repeatability.log_mu:.1%}"
        if not self.unmeasured:
            return f"repeat within {size} in mu beyond their own errors"
        return (
            f"lie within {size} in mu of the model, beyond their own errors: how they repeat, and "
            f"what the model lacks, since it was not measured: {'; '.join(self.unmeasured)}"
        )

    shear: ClassVar[str] = "frictional_shear_stress_pa"
    """The parameter that belongs to its model."""

    @property
    def shear_note(self) -> str:
        """A note on tau_f: only its product with the model's area was measured."""
        return (
            f"by the theory {self.theory!r} and its gap distribution, which give the area of "
            "contact; another model has another tau_f for the same friction, so its interval holds "
            "within this model alone"
        )

    def value(self, name: str) -> float:
        """Value of a parameter.

        Raises
        ------
        InputError
            If the strokes do not determine it; the message names the experiment that would.
        """
        estimate = self[name]
        if estimate.value is None:
            raise InputError(estimate.refusal())
        return estimate.value

    def best(self, name: str) -> float:
        """Value with which the model predicts, determined or not."""
        try:
            return exp(float(self.log_values[self.names.index(name)]))
        except (OverflowError, ValueError):
            raise InputError(f"{name}: the fit has no such value") from None

    def finger_prior(self) -> FingerPrior:
        """Return the fitted parameters of the finger, as a prior for another screen."""
        names = tuple(name for name in self.free if name in PER_FINGER)
        at = [self.free.index(name) for name in names]
        values = [self.log_values[self.names.index(name)] for name in names]
        return FingerPrior(names, np.array(values), self.covariance[np.ix_(at, at)])
