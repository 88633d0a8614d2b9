"""A scene solved in many ways at the same points: what an omission changes, and what it costs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import reduce
from itertools import product
from time import perf_counter
from timeit import repeat
from typing import Self

import torch
from torch import Tensor

from haptix.friction import ContactModel
from haptix.perception import WEBER_FRACTION
from haptix.planning.choices import Choice, kept_reports
from haptix.scene import Scene
from haptix.states import ContactState
from haptix.surface import PULL_IN_SHARE
from haptix.surface.axes import AXIS_NAMES, between
from haptix.terms import TERMS, Term

_SEED = 20180516  # any; fixed, so that a scene always gets the same plan
_TIMED = 3  # solves; the fastest counts, since other programs slow the others

TIMED_STATES = 2000
"""States that are timed together; a surface has some hundreds to thousands."""

_Key = tuple[frozenset[str], str]
"""Terms and fidelity of a model."""


@dataclass(frozen=True)
class Effect:
    """Difference of friction between two ways to model a scene, over its points."""

    mu_max: float = 0.0
    """Largest difference in mu."""
    mu_p99: float = 0.0
    """Difference in mu that 1 % of the points exceed."""
    thresholds_max: float = 0.0
    """Largest, in just-noticeable differences (JND) of the friction there, ``0.11 mu``."""
    thresholds_p99: float = 0.0
    overreach: float = 0.0
    """Share by which voltages exceed the true breakdown before the other's surface ends."""

    @classmethod
    def between(cls, truth: Tensor, other: Tensor, overreach: float = 0.0) -> Self:
        """Compare frictions of one shape."""
        mu = (other - truth).abs().reshape(-1)
        felt = mu / (WEBER_FRACTION * truth.reshape(-1))
        largest = float(mu.max()), float(mu.quantile(0.99))
        return cls(*largest, float(felt.max()), float(felt.quantile(0.99)), overreach)


@dataclass(frozen=True)
class SampledPlaces:
    """States of a scene, every tensor of shape (points,)."""

    places: Mapping[str, Tensor]
    """Values by name of the axis."""
    voltage_share: Tensor
    """Amplitude as a share of the highest at that force, frequency and thickness."""

    @classmethod
    def of(cls, scene: Scene, count: int, seed: int = _SEED) -> Self:
        """Corners of the scene, where effects are largest, then `count` random points.

        A third of the random ones have the highest voltage; axes are uniform in their logarithm,
        and voltage in its square, in which friction is nearly linear.
        """
        ranges = scene.ranges()
        generator = torch.Generator().manual_seed(seed)
        ends = [tuple(dict.fromkeys(ranges[axis])) for axis in AXIS_NAMES]
        corners = torch.tensor(list(product(*ends, (0.0, 1.0))), dtype=torch.float64).T
        drawn = torch.rand(len(corners), count, generator=generator, dtype=torch.float64)
        places = {}
        for axis, corner, share in zip(AXIS_NAMES, corners, drawn, strict=False):
            places[axis] = torch.cat([corner, between(*ranges[axis], share)])
        drive = drawn[-1].sqrt()
        drive[: count // 3] = 1.0
        return cls(places, torch.cat([corners[-1], drive]))

    def at(self, rows: Tensor) -> SampledPlaces:
        """Select points."""
        places = {name: values[rows] for name, values in self.places.items()}
        return SampledPlaces(places, self.voltage_share[rows])


class Trials:
    """A scene solved in many ways at the same points, `count` random ones and its corners.

    The `reference` bounds the voltages: by the scene's limit, breakdown, or pull-in.
    """

    def __init__(self, scene: Scene, reference: Choice, count: int = 300, seed: int = _SEED):
        self.scene = scene
        self._ending = [TERMS[name] for name in sorted(kept_reports(scene))]
        self.points = SampledPlaces.of(scene, count, seed)
        self._models: dict[_Key, ContactModel] = {}
        self._table_s: dict[_Key, float] = {}
        self._solving_s: dict[_Key, float] = {}
        self.voltage_v = self.points.voltage_share * self.highest_voltage(reference, self.points)

    def highest_voltage(self, choice: Choice, points: SampledPlaces) -> Tensor:
        """Amplitude [V] at which a surface of this choice ends."""
        state = self._solve(choice, points, 0.0)
        limits = (term.voltage_limit(state) for term in self._ending)
        return reduce(torch.minimum, limits, self._end(state))

    def friction(self, choice: Choice, points: SampledPlaces, voltage_v: Tensor) -> Tensor:
        """Friction coefficient at points and voltages [V]; past pull-in that of the end."""
        return self._solve(choice, points, voltage_v).mu

    def effect(self, truth: Choice, other: Choice) -> Effect:
        """Compare the friction of the scene modelled as `other` with that modelled as `truth`.

        Where a surface of `other` ends earlier, its friction is that of its end. Where it ends
        later, the voltages up to its end count too.
        """
        ends = self.highest_voltage(other, self.points)
        wrong = self.friction(other, self.points, torch.minimum(self.voltage_v, ends))
        right = self.friction(truth, self.points, self.voltage_v)
        rest = self._solve(truth, self.points, 0.0)
        past = [float((ends / term.voltage_limit(rest)).max()) - 1 for term in self._ending]
        further = ends > self.highest_voltage(truth, self.points)
        if bool(further.any()):
            points, ends = self.points.at(further), ends[further]
            wrong = torch.cat([wrong, self.friction(other, points, ends)])
            right = torch.cat([right, self.friction(truth, points, ends)])
        return Effect.between(right, wrong, max([0.0, *past]))

    def _end(self, state: ContactState) -> Tensor:
        """Amplitude [V] at which a surface ends short of pull-in, or the scene's limit."""
        return (PULL_IN_SHARE * state.pull_in_voltage_v).clamp(max=self.scene.max_voltage_v)

    def share_of_limit(self, choice: Choice, term: Term) -> float:
        """Highest voltage short of pull-in, over that from which a term reports its status."""
        state = self._solve(choice, self.points, 0.0)
        return float((self._end(state) / term.voltage_limit(state)).max())

    def pull_past_breakdown(self, choice: Choice) -> float:
        """Largest share of the attraction that no gap bears, see `ContactState`, at the points."""
        highest = self.highest_voltage(choice, self.points)
        return float(self._solve(choice, self.points, highest).pull_past_breakdown.max())

    def seconds(self, choice: Choice) -> float:
        """Time to tabulate the contact, and to solve `TIMED_STATES` states."""
        self._model(choice)
        key = (choice.terms, choice.fidelity)
        if key not in self._solving_s:
            rows = torch.arange(TIMED_STATES) % len(self.voltage_v)
            points, voltage = self.points.at(rows), self.voltage_v[rows]
            times = repeat(lambda: self._solve(choice, points, voltage), number=1, repeat=_TIMED)
            self._solving_s[key] = min(times)
        return self._table_s[key] + self._solving_s[key]

    def model(self, choice: Choice, dtype: torch.dtype = torch.float64) -> ContactModel:
        """Return the model of a choice, with the scene's reporting terms."""
        terms = choice.terms | kept_reports(self.scene)
        model = self.scene.model(choice.fidelity, dtype, terms=terms)
        self._share(model, choice)
        return model

    def _solve(
        self, choice: Choice, points: SampledPlaces, voltage_v: Tensor | float
    ) -> ContactState:
        places = {**points.places, **dict(choice.held)}
        return self._model(choice).solve(voltage_v=voltage_v, **places)

    def _model(self, choice: Choice) -> ContactModel:
        key = (choice.terms, choice.fidelity)
        if key not in self._models:
            began = perf_counter()
            model = self.scene.model(choice.fidelity, terms=choice.terms)
            lender = self._share(model, choice)
            low, high = self.scene.ranges()["normal_force_n"]
            model.solve(torch.tensor([low, high], dtype=torch.float64), 0.0, 1e3)
            # A table that is borrowed took the time of the model that made it.
            self._table_s[key] = self._table_s[lender] if lender else perf_counter() - began
            self._models[key] = model
        return self._models[key]

    def _share(self, model: ContactModel, choice: Choice) -> _Key | None:
        """Borrow the table of a model with the same solid, the most similar first."""
        for key in sorted(self._models, key=lambda key: len(key[0] ^ choice.terms)):
            if model.solver.fidelity.borrow(self._models[key].solver.fidelity):
                return key
        return None
