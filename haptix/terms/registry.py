"""All terms by name, and which of them are on."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Protocol

from haptix.errors import InputError
from haptix.finger import Finger
from haptix.screen import Screen
from haptix.terms.apparent_area import ApparentArea
from haptix.terms.body_return import BodyReturn
from haptix.terms.breakdown import Breakdown
from haptix.terms.field_limit import FieldLimited
from haptix.terms.finite_size import FiniteSize
from haptix.terms.layered_skin import LayeredSkin
from haptix.terms.leaky_gap import LeakyGap
from haptix.terms.plasticity import Plasticity
from haptix.terms.skin_dielectric import SkinInsulation
from haptix.terms.term import Stage, Term

TERMS: dict[str, Term] = {
    term.name: term
    for term in (
        LayeredSkin(),
        ApparentArea(),
        FiniteSize(),
        Plasticity(),
        SkinInsulation(),
        LeakyGap(),
        FieldLimited(),
        BodyReturn(),
        Breakdown(),
    )
}
"""Terms act in this order."""


class Honouring(Protocol):
    """Attributes of a fidelity, class or object, that terms need."""

    @property
    def name(self) -> str: ...
    @property
    def assumes(self) -> str: ...
    @property
    def honours(self) -> frozenset[Stage]: ...


def possible_terms(finger: Finger, screen: Screen, fidelity: Honouring) -> frozenset[str]:
    """Names of all terms that the profiles have the values for and the fidelity can honour."""
    return frozenset(
        name
        for name, term in TERMS.items()
        if term.stages <= fidelity.honours and not term.missing(finger, screen)
    )


def chosen_terms(
    terms: Iterable[str] | Mapping[str, bool] | None,
    finger: Finger,
    screen: Screen,
    fidelity: Honouring,
    of_theory: frozenset[str] = frozenset(),
) -> frozenset[str]:
    """Return the names of the terms that are on.

    Parameters
    ----------
    terms : iterable of str, mapping, or None
        Names of all that are on; or a mapping that switches single ones, name to bool; or None for
        all possible ones that need no request.
    of_theory : frozenset of str
        Names that count as needing none in the theory of the contact.

    Raises
    ------
    InputError
        If a name is unknown, or a term lacks a value or contradicts the fidelity.
    """
    possible = possible_terms(finger, screen, fidelity)
    usual = {name for name in possible if not TERMS[name].on_request or name in of_theory}
    if terms is None:
        return frozenset(usual)
    if isinstance(terms, str):
        raise InputError(f"terms: expected a set of names, such as {{{terms!r}}}, got a string")
    unknown = set(terms) - set(TERMS)
    if unknown:
        raise InputError(
            f"terms: unknown {', '.join(map(repr, sorted(unknown)))}; expected any of "
            f"{', '.join(TERMS)}"
        )
    if isinstance(terms, Mapping):
        on = {name for name in TERMS if terms.get(name, name in usual)}
    else:
        on = set(terms)
    for name in sorted(on - possible):
        missing = TERMS[name].missing(finger, screen)
        if missing:
            raise InputError(
                f'terms: "{name}" needs {missing[0]}, which is None; set it or switch it off'
            )
        raise InputError(
            f'terms: "{name}" contradicts fidelity "{fidelity.name}", which {fidelity.assumes}; '
            "switch it off, or use another fidelity"
        )
    return frozenset(on)
