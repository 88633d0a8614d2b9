"""A scene modelled in many ways: what can be left out, and the effect and time of each omission."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import reduce
from itertools import product
from math import inf, sqrt
from time import perf_counter
from timeit import repeat
from typing import Annotated, Literal, Self

import torch
from torch import Tensor

from haptix.base.report import Heading
from haptix.model.fidelity import FIDELITIES, Ability, FidelityName
from haptix.model.friction import ContactModel
from haptix.model.perception.thresholds import WEBER_FRACTION
from haptix.model.states import ContactState
from haptix.model.surface import PULL_IN_SHARE
from haptix.model.surface.axes import AXES, AXIS_NAMES, between
from haptix.model.terms import TERMS, Term
from haptix.plan.scene import Scene

Kind = Literal["term", "axis", "fidelity", "material"]

COLLAPSIBLE = tuple(axis.name for axis in AXES if axis.is_collapsible)
"""Axes that planning may hold at one value."""

COARSE, *_, FULL = (name for name, how in FIDELITIES.items() if Ability.TABULATE in how.can)
"""The fastest and the most exact of the fidelities that a surface can be tabulated from."""

TIMED_STATES = 2000
"""States that are timed together; a surface has some hundreds to thousands."""

# Share of a build's work that an omission saves. These are constants, so that a plan does not
# depend on the load of the machine. An axis has some ten nodes, and the mean field's table is most
# of a small build. Terms have their own.
_WORK: Mapping[Kind, float] = {"axis": 0.9, "fidelity": 0.7}
_OVERREACH = 0.05  # allowed share past breakdown, whose "about 350 V/um" is known no better
_SEED = 20180516  # arbitrary, but fixed: a scene always gets the same plan
_TIMED = 3  # solves, of which the fastest counts: other programs slow the others


@dataclass(frozen=True)
class Choice:
    """One way to model a scene."""

    terms: frozenset[str]
    """Terms that are on and change friction."""
    fidelity: FidelityName = FULL
    held: frozenset[tuple[str, float]] = frozenset()
    """Collapsed axes and the values at which they are held."""


@dataclass(frozen=True)
class Omission:
    """A part that can be left out of a model, named after the effect that is then lost."""

    kind: Kind
    name: str
    """Name, such as "finite-size", "h0_m" or "mean-field"."""
    value: float = 0.0
    """Value at which an axis would be held."""
    possible: frozenset[str] = frozenset()
    """Terms that the coarser fidelity can have."""

    @property
    def work(self) -> float:
        """Share of the work that it saves."""
        return TERMS[self.name].work if self.kind == "term" else _WORK[self.kind]

    def out_of(self, choice: Choice) -> Choice:
        """Return the choice without it."""
        if self.kind == "fidelity":
            return replace(choice, fidelity=COARSE, terms=choice.terms & self.possible)
        if self.kind == "axis":
            return replace(choice, held=choice.held | {(self.name, self.value)})
        return replace(choice, terms=choice.terms - {self.name})

    def into(self, choice: Choice) -> Choice:
        """Return the choice with it."""
        if self.kind == "fidelity":
            return replace(choice, fidelity=FULL)
        if self.kind == "axis":
            return replace(choice, held=choice.held - {(self.name, self.value)})
        return replace(choice, terms=choice.terms | {self.name})


def omissions(scene: Scene) -> list[Omission]:
    """Everything that a scene's model could leave out, or has left out."""
    ranges = scene.ranges()
    varying = [axis for axis in COLLAPSIBLE if ranges[axis][0] < ranges[axis][1]]
    terms = [name for name in sorted(scene.possible_terms()) if TERMS[name].changes_friction]
    return [
        *(Omission("term", name) for name in terms),
        *(Omission("axis", axis, middle(*ranges[axis])) for axis in varying),
        Omission("fidelity", FULL, possible=friction_terms(scene, COARSE)),
    ]


def middle(low: float, high: float) -> float:
    """Return the middle of a range on its logarithmic axis."""
    return low if low == high else sqrt(low * high)


def friction_terms(scene: Scene, fidelity: FidelityName = FULL) -> frozenset[str]:
    """Names of the scene's terms (`Scene.terms`) that change friction."""
    return frozenset(name for name in scene.terms(fidelity) if TERMS[name].changes_friction)


def reporting_terms(scene: Scene, only_kept: bool = False) -> list[Term]:
    """Possible terms that report a status and change no friction.

    Planning leaves them off; the scene may switch them on. With `only_kept`, return only those.
    """
    terms = [TERMS[name] for name in sorted(scene.possible_terms())]
    on = scene.override.terms
    return [t for t in terms if not t.changes_friction and (not only_kept or on.get(t.name))]


def kept_reports(scene: Scene) -> frozenset[str]:
    """Names of the reporting terms that the scene switches on."""
    return frozenset(term.name for term in reporting_terms(scene, only_kept=True))


@dataclass(frozen=True)
class Effect:
    """Difference of friction between two ways to model a scene, over its points."""

    mu_max: Annotated[float, Heading("mu", ".2g")] = 0.0
    """Largest difference in mu."""
    mu_p99: float = 0.0
    """Difference in mu that 1 % of the points exceed."""
    jnd_max: Annotated[float, Heading("JND", ".2g")] = 0.0
    """Largest difference, in just-noticeable differences (JND) of ``0.11 mu`` at that point."""
    jnd_p99: float = 0.0
    contrast_jnd: Annotated[float, Heading("of contrast", ".2g")] = 0.0
    """Largest difference of the contrast ``mu(V)/mu(0)``, in JND of it: a change of all friction,
    such as a finger that is more slippery at any voltage, is no error of a texture."""
    overreach: float = 0.0
    """Share by which voltages exceed the true breakdown before the other way's surface ends."""

    @classmethod
    def between(
        cls,
        truth: Tensor,
        other: Tensor,
        overreach: float = 0.0,
        at_rest: tuple[Tensor, Tensor] | None = None,
    ) -> Self:
        """Compare two frictions, and their contrasts with friction without voltage.

        Parameters
        ----------
        truth, other : Tensor
            Frictions of the two ways, of one shape.
        overreach : float
            How far past breakdown the other way goes, as a share.
        at_rest : tuple of Tensor, optional
            Frictions of both without voltage, for the contrasts.
        """
        mu = (other - truth).abs().reshape(-1)
        felt = mu / (WEBER_FRACTION * truth.reshape(-1))
        largest = float(mu.max()), float(mu.quantile(0.99))
        contrast = 0.0
        if at_rest is not None:
            change = (other / truth) * (at_rest[0] / at_rest[1]) - 1
            # Equal contrasts still differ by the rounding of their quotients.
            contrast = round(float(change.abs().max()) / WEBER_FRACTION, 9)
        return cls(*largest, float(felt.max()), float(felt.quantile(0.99)), contrast, overreach)

    @property
    def is_past_breakdown(self) -> bool:
        """Whether voltages would exceed breakdown by more than its uncertainty."""
        return self.overreach > _OVERREACH

    @property
    def cost(self) -> float:
        """Largest effect [JND]; infinite if voltages would exceed breakdown."""
        return inf if self.is_past_breakdown else self.jnd_max


Points = Mapping[str, Tensor]
"""States of a scene: values by name of the axis, and ``voltage_share``, the amplitude over the
highest one at that force, frequency and thickness. Every tensor has shape (points,)."""


def _points(scene: Scene, count: int, seed: int) -> Points:
    """Corners of the scene, where effects are largest, then `count` random points.

    A third of the random ones have the highest voltage; axes are uniform in their logarithm, and
    voltage in its square, in which friction is nearly linear.
    """
    ranges = scene.ranges()
    generator = torch.Generator().manual_seed(seed)
    ends = [tuple(dict.fromkeys(ranges[axis])) for axis in AXIS_NAMES]
    corners = torch.tensor(list(product(*ends, (0.0, 1.0))), dtype=torch.float64).T
    drawn = torch.rand(len(corners), count, generator=generator, dtype=torch.float64)
    points = {
        axis: torch.cat([corner, between(*ranges[axis], share)])
        for axis, corner, share in zip(AXIS_NAMES, corners, drawn, strict=False)
    }
    voltage_share = drawn[-1].sqrt()
    voltage_share[: count // 3] = 1.0
    return {**points, "voltage_share": torch.cat([corners[-1], voltage_share])}


class Trials:
    """A scene solved in many ways at the same points, `count` random ones and its corners.

    The model `reference` bounds the voltages: by the scene's limit, breakdown or pull-in.
    """

    def __init__(self, scene: Scene, reference: Choice, count: int = 300, seed: int = _SEED):
        self.scene = scene
        self._ending = reporting_terms(scene, only_kept=True)
        self.points = _points(scene, count, seed)
        self._models: dict[Choice, ContactModel] = {}  # by choices that hold no axis
        self._table_s: dict[Choice, float] = {}
        self._solving_s: dict[Choice, float] = {}
        highest_v = self.highest_voltage(reference, self.points)
        self.voltage_v = self.points["voltage_share"] * highest_v

    def highest_voltage(self, choice: Choice, points: Points) -> Tensor:
        """Amplitude [V] at which a surface of this choice ends."""
        return self._end(self._solve(choice, points, 0.0), self._ending)

    def friction(self, choice: Choice, points: Points, voltage_v: Tensor) -> Tensor:
        """Friction coefficient at points and voltages [V]; past pull-in, that at pull-in."""
        return self._solve(choice, points, voltage_v).mu

    def effect(self, truth: Choice, other: Choice) -> Effect:
        """Compare the friction of the scene modelled as `other` with that modelled as `truth`.

        Voltages rise to the end of the longer surface; past its end, the other's friction stays.
        """
        rest, others = (self._solve(choice, self.points, 0.0) for choice in (truth, other))
        ends = self._end(others, self._ending)
        farthest = torch.maximum(ends, self._end(rest, self._ending))
        voltage = self.points["voltage_share"] * farthest
        wrong = self.friction(other, self.points, torch.minimum(voltage, ends))
        right = self.friction(truth, self.points, voltage)
        past = [float((ends / term.voltage_limit(rest)).max()) - 1 for term in self._ending]
        return Effect.between(right, wrong, max([0.0, *past]), (rest.mu, others.mu))

    def _end(self, state: ContactState, terms: Iterable[Term] = ()) -> Tensor:
        """Amplitude [V] short of pull-in, of the scene's limit, and of where terms report."""
        end = (PULL_IN_SHARE * state.pull_in_voltage_v).clamp(max=self.scene.max_voltage_v)
        return reduce(torch.minimum, (term.voltage_limit(state) for term in terms), end)

    def share_of_limit(self, choice: Choice, term: Term) -> float:
        """Highest voltage short of pull-in, over that from which a term reports its status."""
        state = self._solve(choice, self.points, 0.0)
        return float((self._end(state) / term.voltage_limit(state)).max())

    def highest(self, choice: Choice) -> ContactState:
        """Return the points at the highest voltages of a choice."""
        return self._solve(choice, self.points, self.highest_voltage(choice, self.points))

    def seconds(self, choice: Choice) -> float:
        """Time to tabulate the contact, and to solve `TIMED_STATES` states."""
        self._model(choice)
        key = replace(choice, held=frozenset())
        if key not in self._solving_s:
            rows = torch.arange(TIMED_STATES) % len(self.voltage_v)
            points = {name: values[rows] for name, values in self.points.items()}
            voltage = self.voltage_v[rows]
            times = repeat(lambda: self._solve(choice, points, voltage), number=1, repeat=_TIMED)
            self._solving_s[key] = min(times)
        return self._table_s[key] + self._solving_s[key]

    def model(self, choice: Choice, dtype: torch.dtype = torch.float64) -> ContactModel:
        """Return the model of a choice, with the scene's reporting terms."""
        terms = choice.terms | kept_reports(self.scene)
        model = self.scene.model(choice.fidelity, dtype, terms=terms)
        self._lend_table(model, choice)
        return model

    def _solve(self, choice: Choice, points: Points, voltage_v: Tensor | float) -> ContactState:
        places = {axis: points[axis] for axis in AXIS_NAMES} | dict(choice.held)
        return self._model(choice).solve(voltage_v=voltage_v, **places)

    def _model(self, choice: Choice) -> ContactModel:
        key = replace(choice, held=frozenset())
        if key not in self._models:
            began = perf_counter()
            model = self.scene.model(choice.fidelity, terms=choice.terms)
            lender = self._lend_table(model, choice)
            low, high = self.scene.ranges()["normal_force_n"]
            model.solve(torch.tensor([low, high], dtype=torch.float64), 0.0, 1e3)
            # For a borrowed table count the time of the model that made it.
            self._table_s[key] = self._table_s[lender] if lender else perf_counter() - began
            self._models[key] = model
        return self._models[key]

    def _lend_table(self, model: ContactModel, choice: Choice) -> Choice | None:
        """Give a model the table of the most similar model with the same solid."""
        for key in sorted(self._models, key=lambda key: len(key.terms ^ choice.terms)):
            if model.solver.fidelity.borrow(self._models[key].solver.fidelity):
                return key
        return None
