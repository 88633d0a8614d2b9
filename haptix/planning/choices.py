"""One way to model a scene, and what can be left out of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import sqrt
from typing import Literal

from haptix.friction import FidelityName
from haptix.scene import AxisName, DtypeName, Scene

Kind = Literal["term", "axis", "fidelity", "dtype"]

AXES: tuple[AxisName, ...] = ("frequency_hz", "h0_m")

# Share of a build's work that leaving something out saves, at most: what it may cost of the budget.
# Not timed where it is used, so that a plan does not depend on how busy a machine is. Terms: 20,000
# states took 0.158 s with finite size and 0.101 s without, and 0.101 s with plasticity and 0.080 s
# without (dry finger, one core); the others save next to nothing, and get some credit for a simpler
# model. An axis has some ten nodes, the mean field's table is most of a small build, and float32
# halves the memory.
_WORK: Mapping[tuple[Kind, str], float] = {
    ("axis", "frequency_hz"): 0.9,
    ("axis", "h0_m"): 0.9,
    ("fidelity", "mean-field"): 0.7,
    ("dtype", "float64"): 0.5,
    ("term", "finite-size"): 0.35,
    ("term", "plasticity"): 0.2,
}
_WORK_OF_OTHER_TERMS = 0.1


@dataclass(frozen=True)
class Choice:
    """One way to model a scene.

    Parameters
    ----------
    terms : frozenset of str
        Terms that are on, without "breakdown", which changes no friction.
    fidelity, dtype : str
        How the contact is solved, and in what precision its friction is kept.
    held : tuple of (axis, value)
        Axes that are collapsed, and the value that stands for them.
    """

    terms: frozenset[str]
    fidelity: FidelityName = "mean-field"
    dtype: DtypeName = "float64"
    held: tuple[tuple[AxisName, float], ...] = ()

    def holding(self, axis: AxisName, value: float) -> Choice:
        """Return the choice with an axis collapsed to a value."""
        return replace(self, held=tuple(sorted({**dict(self.held), axis: value}.items())))


@dataclass(frozen=True)
class Omission:
    """Something that can be left out of a model: named for what is lost.

    Parameters
    ----------
    kind, name : str
        Such as "term" and "finite-size", "axis" and "h0_m", "fidelity" and "mean-field".
    value : float
        Of an axis: what stands for it.
    possible : frozenset of str
        Of the fidelity: the terms that the coarser one can have.
    """

    kind: Kind
    name: str
    value: float = 0.0
    possible: frozenset[str] = frozenset()

    @property
    def work(self) -> float:
        """Share of the work that it saves."""
        return _WORK.get((self.kind, self.name), _WORK_OF_OTHER_TERMS)

    def of(self, choice: Choice) -> Choice:
        """Return the choice without it."""
        if self.kind == "term":
            return replace(choice, terms=choice.terms - {self.name})
        if self.kind == "fidelity":
            return replace(choice, fidelity="closed-form", terms=choice.terms & self.possible)
        if self.kind == "dtype":
            return replace(choice, dtype="float32")
        return choice.holding("h0_m" if self.name == "h0_m" else "frequency_hz", self.value)


def middle(low: float, high: float) -> float:
    """Return the middle of a range on its logarithmic axis."""
    return low if low == high else sqrt(low * high)


def omissions(scene: Scene) -> list[Omission]:
    """Everything that could be left out of a scene's model, in the order of its table."""
    ranges = scene.ranges()
    terms = [name for name in sorted(scene.possible_terms()) if name != "breakdown"]
    return [
        *(Omission("term", name) for name in terms),
        *(
            Omission("axis", axis, middle(*ranges[axis]))
            for axis in AXES
            if ranges[axis][0] < ranges[axis][1]
        ),
        Omission("fidelity", "mean-field", possible=scene.possible_terms("closed-form")),
        Omission("dtype", "float64"),
    ]
