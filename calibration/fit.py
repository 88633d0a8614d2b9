"""The result of a fit: estimates with intervals, as a file that later steps read."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from hashlib import sha256
from math import exp, inf
from pathlib import Path
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import (
    BeforeValidator,
    Field,
    PlainSerializer,
    PlainValidator,
    model_validator,
)
from scipy.special import expit

from calibration.parameters import PER_FINGER, Array, FingerPrior
from haptix.contact import TheoryName
from haptix.documents import Document, Part, renamed
from haptix.errors import InputError
from haptix.report import Heading
from haptix.version import __version__

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
    Array,
    PlainValidator(_finite),
    PlainSerializer(lambda values: values.tolist()),
]
_Jnd = renamed("effect_jnd", "effect_thresholds")
_UpperBound = Annotated[  # JSON has no infinity
    float,
    Field(allow_inf_nan=True),
    BeforeValidator(lambda value: inf if value is None else value),
    PlainSerializer(lambda value: None if value == inf else value),
]


@dataclass(frozen=True)
class Repeatability:
    """Spread of repeated strokes beyond their own errors, relative: the finger dries and turns.

    Parameters
    ----------
    log_mu : float
        Standard deviation of ln mu.
    ripple : float
        Standard deviation of the ripple, over the ripple.
    """

    log_mu: float = 0.01
    ripple: float = 0.01


Need = Literal["needed", "contradicted", "cannot tell", "changes nothing"]


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
    effect_jnd : float
        Largest change of friction at the strokes [JND].
    """

    form: Annotated[str, Heading("form")]
    evidence: Annotated[float, Heading("evidence against it", "+.1f")]
    h0_ratio: Annotated[float, Heading("d1/eps1, over the fit's", ".3g")]
    effect_jnd: Annotated[float, _Jnd, Heading("friction changes by [JND]", ".2g")]

    @property
    def weight(self) -> float:
        """Probability of this form against the fit's own, if both were as likely before."""
        return float(expit(-self.evidence / 2))


@dataclass(frozen=True)
class TermNeed:
    """Evidence of the strokes for or against one term.

    Parameters
    ----------
    term : str
        Its name.
    is_on : bool
        Whether the term was on in the fit.
    need : {"needed", "contradicted", "cannot tell", "changes nothing"}
        The conclusion.
    evidence : float
        AICc without the term minus with it: positive speaks for the term, 6 is 20 to 1.
    effect_jnd : float
        Largest change of friction at the strokes [JND], after the other parameters were fitted
        again.
    """

    term: Annotated[str, Heading("term")]
    is_on: Annotated[bool, Heading("in the fit", "off|on")]
    need: Annotated[Need, Heading("the strokes say")]
    evidence: Annotated[float, Heading("evidence (AICc)", "+.1f")]
    effect_jnd: Annotated[float, _Jnd, Heading("effect [JND]", ".2g")]


class ParameterEstimate(Part):
    """A fit's estimate of one parameter.

    Parameters
    ----------
    name : str
        Of `calibration.parameters.NAMES`.
    value : float or None
        Value in the unit that the name ends with; None where the strokes do not determine it.
    low, high : float
        90 % interval; 0 or infinite where the strokes set no bound.
    spread : float
        Standard deviation of the logarithm.
    verdict : {"determined", "prior", "undetermined", "fixed"}
        "prior" where the strokes add nothing to what was known before.
    advice : str
        Which experiment would determine it; empty where none is needed.
    """

    name: Annotated[str, Heading("parameter")]
    value: Annotated[float | None, Heading("value", ".4g", "not determined")] = None
    low: float
    high: _UpperBound = inf
    spread: Annotated[float, Heading("spread", ".1%")]
    verdict: Annotated[Verdict, Heading("verdict")]
    advice: str = ""

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
    theory : str or None
        Theory of the contact; None in fits before there was a choice.
    forms : tuple of FormFit
        The strokes fitted in other forms of the model.
    made_from : mapping of str to str
        SHA-256 of each file of the session that the fit rests on; empty before version 0.2.
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
    repeatability: Annotated[Repeatability, renamed("repeatability", "scatter")]
    cost: float
    strokes: tuple[int, ...]
    left_out: dict[int, str]
    terms: tuple[str, ...]
    theory: TheoryName | None = None
    forms: tuple[FormFit, ...] = ()
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
        return super()._from_table(fields, folder)

    def __getitem__(self, name: str) -> ParameterEstimate:
        for one in self.estimates:
            if one.name == name:
                return one
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
                f"{file} was edited after the fit; make it anew with `haptix calibrate fit`"
            )

    def _own_hash(self) -> str:
        fields = self.model_dump(mode="json", exclude={"content_hash"})
        for form in fields["forms"]:  # as it was called, so that earlier fits keep their hash
            form["effect_thresholds"] = form.pop("effect_jnd")
        return sha256(json.dumps(fields, sort_keys=True).encode()).hexdigest()

    @property
    def undetermined(self) -> list[ParameterEstimate]:
        """Estimates without a value."""
        return [one for one in self.estimates if one.value is None]

    def parts(self, needs: Sequence[TermNeed] = ()) -> list[tuple[str, Sequence[Any]]]:
        """Return what people read of it, by title: rows of a table, or lines."""
        left_out = [f"stroke {number}: {why}" for number, why in sorted(self.left_out.items())]
        return [
            ("Results", self.estimates),
            ("Not determined", [estimate.refusal() for estimate in self.undetermined]),
            ("Other forms of the model", self.forms),
            ("Which terms the strokes need", needs),
            ("Strokes that were not used", left_out),
        ]

    def value(self, name: str) -> float:
        """Value of a parameter.

        Raises
        ------
        InputError
            If the strokes do not determine it; the message says which experiment would.
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
        """Return what was fitted of the finger, as a prior for another screen."""
        names = tuple(name for name in self.free if name in PER_FINGER)
        at = [self.free.index(name) for name in names]
        values = [self.log_values[self.names.index(name)] for name in names]
        return FingerPrior(names, np.array(values), self.covariance[np.ix_(at, at)])
