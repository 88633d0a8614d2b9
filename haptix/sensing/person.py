"""A person's finger, kept: what was learned of it, and whether a screen has changed since then."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import date
from typing import Annotated, NamedTuple

import numpy as np
from pydantic import Field

from haptix.checks import Array
from haptix.display import Displayed
from haptix.documents import Document
from haptix.errors import InputError
from haptix.sensing.contact import FORCE, LATENT, ContactCurrent

_LATENT = len(LATENT)
_Row = Annotated[tuple[float, ...], Field(min_length=_LATENT, max_length=_LATENT)]
_PART_S = 0.25  # of a slide: noise of parts so long is independent, a hand's tremor too

CHANGED = 0.06
"""Change of the contact's capacitance from which it is flagged: over half of the 10 % to be found,
since sweat and a scale differ by 2 to 3 % from day to day."""


class Averaged(NamedTuple):
    """An average of readings while a finger slid."""

    t_s: float
    normal_force_n: float
    """Force that was measured [N]; nan without."""
    voltage_v: float
    capacitance_f: complex
    """Of contact and body, without the panel [F]."""


class EnrolledFinger(Document):
    """What was learned of one person's finger on one screen, see `FingerObserver.enrolled`.

    Parameters
    ----------
    mean : tuple of float
        Of `LATENT`.
    covariance : tuple of tuple of float
        Of the same.
    screen : str
        Name of the screen.
    frequency_hz : float
        Of the carrier.
    slid : tuple of (float, float, float, float)
        Of each quarter of a second of sliding: normal force [N], amplitude [V], and capacitance
        [F], real and imaginary.
    day : date or None
        When.
    """

    mean: _Row
    covariance: Annotated[tuple[_Row, ...], Field(min_length=_LATENT, max_length=_LATENT)]
    screen: str = ""
    frequency_hz: Annotated[float, Field(gt=0)] = 4000.0
    slid: tuple[tuple[float, float, float, float], ...] = ()
    day: date | None = None

    @property
    def moments(self) -> tuple[Array, Array]:
        """Mean, shape (6,), and covariance, shape (6, 6)."""
        return np.array(self.mean), np.array(self.covariance)


def parts(averages: list[Averaged]) -> tuple[tuple[float, float, float, float], ...]:
    """Average quarters of a second of sliding whose force was measured, for `EnrolledFinger`."""
    by_part: dict[int, list[Averaged]] = {}
    for one in averages:
        if np.isfinite(one.normal_force_n):
            by_part.setdefault(int(one.t_s / _PART_S), []).append(one)
    rows = []
    for found in by_part.values():
        force, volts, farads = (np.mean([one[i] for one in found]) for i in (1, 2, 3))
        rows.append((float(force), float(volts), float(farads.real), float(farads.imag)))
    return tuple(rows)


@dataclass(frozen=True)
class ContactChange(Displayed):
    """How much the contact of one person with one screen has changed.

    Parameters
    ----------
    log_ratio : float
        Mean logarithm of the capacitance, after over before, at equal force and voltage.
    sd : float
        Its standard deviation, by the slides' own spread.
    """

    log_ratio: float
    sd: float

    @property
    def is_changed(self) -> bool:
        """Whether the change is 6 % or more."""
        return abs(self.log_ratio) > CHANGED

    @property
    def is_sure(self) -> bool:
        """Whether the slides tell a change of 10 % from none, by two standard deviations."""
        return 2 * self.sd < CHANGED

    @property
    def verdict(self) -> str:
        """In words."""
        if not self.is_sure:
            return "cannot tell: slide longer, or press more evenly"
        return "changed" if self.is_changed else "as before"


def contact_change(
    before: EnrolledFinger, after: EnrolledFinger, contact: ContactCurrent
) -> ContactChange:
    """Compare the slides of one person, by the model of the finger that was enrolled before.

    The model takes only the difference of forces and voltages between both away. What remains is a
    change of the finger, the contact, or the screen: the current does not tell these apart.

    Parameters
    ----------
    before, after : EnrolledFinger
        Of the same person on the same screen.
    contact : ContactCurrent
        Of this screen.

    Raises
    ------
    InputError
        If they are of different screens or carriers, or have less than a second of sliding.
    """
    for name in ("screen", "frequency_hz"):
        one, other = getattr(before, name), getattr(after, name)
        if one != other:
            raise InputError(f"{name}: expected the same in both, got {one} and {other}")
    logs = []
    for which, person in (("before", before), ("after", after)):
        if len(person.slid) < 4:
            raise InputError(
                f"{which}: expected a second of sliding at a known force, got {len(person.slid)} "
                "quarters; enroll with a force"
            )
        force, volts, real, imaginary = np.array(person.slid).T
        latent = np.tile(before.moments[0], (len(force), 1))
        latent[:, FORCE] = np.log(force / contact.population.force_n)
        body = contact.body_f
        found, expected = real + 1j * imaginary, contact.capacitance_f(latent, volts)
        # Of the contact alone: the body in series would hide a part of a change.
        ratio = (1 / expected - 1 / body) / (1 / found - 1 / body)
        logs.append(np.log(np.abs(ratio)))
    variance = sum(one.var(ddof=1) / len(one) for one in logs)
    return ContactChange(float(logs[1].mean() - logs[0].mean()), float(np.sqrt(variance)))
