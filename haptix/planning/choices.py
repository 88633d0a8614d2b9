"""One way to model a scene, and what can be left out of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import sqrt
from typing import Literal

from haptix.fidelity import FIDELITIES, Ability, FidelityName
from haptix.scene import Scene
from haptix.surface.axes import AXES
from haptix.terms import TERMS, Term

Kind = Literal["term", "axis", "fidelity", "material"]

COLLAPSIBLE = tuple(axis.name for axis in AXES if axis.is_collapsible)
"""Axes that planning may hold at one value."""

COARSE, *_, FULL = (name for name, how in FIDELITIES.items() if Ability.TABULATE in how.can)
"""The fastest and the most exact of the fidelities that a surface can be tabulated from."""

# Share of a build's work that leaving something out saves: constants, so that a plan does not
# depend on how busy a machine is. An axis has some ten nodes, and the mean field's table is most of
# a small build. Terms have their own.
_WORK: Mapping[Kind, float] = {"axis": 0.9, "fidelity": 0.7}


@dataclass(frozen=True)
class Choice:
    """One way to model a scene."""

    terms: frozenset[str]
    """Terms that are on, of those that change friction."""
    fidelity: FidelityName = FULL
    held: frozenset[tuple[str, float]] = frozenset()
    """Collapsed axes, each with the value that it is held at."""


@dataclass(frozen=True)
class Omission:
    """Something that can be left out of a model, under the name of what is lost."""

    kind: Kind
    name: str
    """What is left out, such as "finite-size", "h0_m" or "mean-field"."""
    value: float = 0.0
    """Value at which an axis would be held."""
    possible: frozenset[str] = frozenset()
    """Terms that the coarser fidelity can have."""

    @property
    def work(self) -> float:
        """Share of the work that it saves."""
        return TERMS[self.name].work if self.kind == "term" else _WORK[self.kind]

    def of(self, choice: Choice) -> Choice:
        """Return the choice without it."""
        if self.kind == "term":
            return replace(choice, terms=choice.terms - {self.name})
        if self.kind == "fidelity":
            return replace(choice, fidelity=COARSE, terms=choice.terms & self.possible)
        return replace(choice, held=choice.held | {(self.name, self.value)})

    def into(self, choice: Choice) -> Choice:
        """Return the choice with it."""
        if self.kind == "term":
            return replace(choice, terms=choice.terms | {self.name})
        if self.kind == "fidelity":
            return replace(choice, fidelity=FULL)
        return replace(choice, held=choice.held - {(self.name, self.value)})


def middle(low: float, high: float) -> float:
    """Return the middle of a range on its logarithmic axis."""
    return low if low == high else sqrt(low * high)


def friction_terms(scene: Scene, fidelity: FidelityName = FULL) -> frozenset[str]:
    """Names of the terms that change friction, of those that a scene has (`Scene.terms`)."""
    return frozenset(t for t in scene.terms(fidelity) if TERMS[t].changes_friction)


def reporting_terms(scene: Scene) -> list[Term]:
    """The possible terms that report a status and change no friction."""
    possible = sorted(scene.possible_terms())
    return [TERMS[name] for name in possible if not TERMS[name].changes_friction]


def kept_reports(scene: Scene) -> frozenset[str]:
    """Names of the reporting terms that the scene switches on; planning leaves them off."""
    return frozenset(t.name for t in reporting_terms(scene) if scene.override.terms.get(t.name))


def omissions(scene: Scene) -> list[Omission]:
    """Everything that a scene's model could leave out, or leaves out though it could have it."""
    terms = [t for t in sorted(scene.possible_terms()) if TERMS[t].changes_friction]
    ranges = scene.ranges()
    varying = [axis for axis in COLLAPSIBLE if ranges[axis][0] < ranges[axis][1]]
    return [
        *(Omission("term", name) for name in terms),
        *(Omission("axis", axis, middle(*ranges[axis])) for axis in varying),
        Omission("fidelity", FULL, possible=friction_terms(scene, COARSE)),
    ]
