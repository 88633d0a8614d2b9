"""What leaving something out does to friction, measured by solving a scene with and without it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import product
from math import log
from time import perf_counter
from typing import Self

import torch
from torch import Tensor

from haptix.friction import ContactModel
from haptix.perception import WEBER_FRACTION
from haptix.planning.choices import Choice, kept_reports, reporting_terms
from haptix.scene import Scene
from haptix.states import ContactState
from haptix.surface import PULL_IN_SHARE
from haptix.surface.axes import AXIS_NAMES
from haptix.terms import Term

_SEED = 20180516  # any; fixed, so that a scene always gets the same plan
_TIMED = 3  # solves, of which the fastest counts: the others met something else on the machine
_TIMED_TOGETHER = 2000  # states in each


@dataclass(frozen=True)
class Effect:
    """Difference of friction between two ways to model a scene, over its points.

    Parameters
    ----------
    mu_max, mu_p99 : float
        Largest, and exceeded by 1 % of the points.
    thresholds_max, thresholds_p99 : float
        The same in just-noticeable differences (JND) of the friction there, ``0.11 mu``.
    overreach : float
        Share by which voltages go past breakdown, in truth, before the other's surface ends.
    """

    mu_max: float = 0.0
    mu_p99: float = 0.0
    thresholds_max: float = 0.0
    thresholds_p99: float = 0.0
    overreach: float = 0.0

    @classmethod
    def between(cls, truth: Tensor, other: Tensor, overreach: float = 0.0) -> Self:
        """Compare friction of one shape."""
        mu = (other - truth).abs().reshape(-1)
        felt = mu / (WEBER_FRACTION * truth.reshape(-1))
        return cls(
            float(mu.max()),
            float(mu.quantile(0.99)),
            float(felt.max()),
            float(felt.quantile(0.99)),
            overreach,
        )


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
            low, high = ranges[axis]
            value = torch.exp(log(low) + share * (log(high) - log(low))).clamp(low, high)
            places[axis] = torch.cat([corner, value])
        drive = drawn[-1].sqrt()
        drive[: count // 3] = 1.0
        return cls(places, torch.cat([corners[-1], drive]))

    def at(self, rows: Tensor) -> SampledPlaces:
        """Some of the points."""
        places = {name: values[rows] for name, values in self.places.items()}
        return SampledPlaces(places, self.voltage_share[rows])


class Trials:
    """A scene solved in many ways at the same points.

    Parameters
    ----------
    scene : Scene
        The scene.
    reference : Choice
        What decides how far voltages go: to the scene's highest, or to where a surface would end,
        at breakdown or short of pull-in.
    count, seed : int
        Of the random points.
    """

    def __init__(self, scene: Scene, reference: Choice, count: int = 300, seed: int = _SEED):
        self.scene = scene
        kept = kept_reports(scene)
        self._ending = [term for term in reporting_terms(scene) if term.name in kept]
        self.points = SampledPlaces.of(scene, count, seed)
        self._models: dict[tuple[frozenset[str], str], ContactModel] = {}
        self._prepared_s: dict[tuple[frozenset[str], str], float] = {}
        self._state_s: dict[tuple[frozenset[str], str], float] = {}
        self._at_rest: dict[Choice, ContactState] = {}
        self.voltage_v = self.points.voltage_share * self.highest_voltage(reference, self.points)

    def at_rest(self, choice: Choice) -> ContactState:
        """Solve the trial's own points without voltage: where they pull in and break down."""
        if choice not in self._at_rest:
            none = torch.zeros_like(self.points.voltage_share)
            self._at_rest[choice] = self._solve(choice, self.points, none)
        return self._at_rest[choice]

    def highest_voltage(self, choice: Choice, points: SampledPlaces) -> Tensor:
        """Amplitude [V] at which a surface of this choice ends."""
        if points is self.points:
            state = self.at_rest(choice)
        else:
            state = self._solve(choice, points, torch.zeros_like(points.voltage_share))
        end = self._end(state)
        for term in self._ending:
            end = torch.minimum(end, term.voltage_limit(state))
        return end

    def friction(self, choice: Choice, points: SampledPlaces, voltage_v: Tensor) -> Tensor:
        """Friction coefficient at points and voltages [V], float64; past pull-in that of its end.

        In the precision of the choice, and with the values that it holds.
        """
        mu = self._solve(choice, points, voltage_v).mu
        return mu.to(getattr(torch, choice.dtype)).to(torch.float64)

    def effect(self, truth: Choice, other: Choice) -> Effect:
        """What it does to friction to model the scene as `other` instead of as `truth`.

        Where a surface of `other` ends earlier, its friction is that of its end. Where it ends
        later, it would reach to voltages at which there is no contact in truth: these count too.
        """
        ends = self.highest_voltage(other, self.points)
        wrong = self.friction(other, self.points, torch.minimum(self.voltage_v, ends))
        right = self.friction(truth, self.points, self.voltage_v)
        overreach = self._overreach(truth, ends)
        further = ends > self.highest_voltage(truth, self.points)
        if bool(further.any()):
            points, ends = self.points.at(further), ends[further]
            wrong = torch.cat([wrong, self.friction(other, points, ends)])
            right = torch.cat([right, self.friction(truth, points, ends)])
        return Effect.between(right, wrong, overreach)

    def _overreach(self, truth: Choice, ends: Tensor) -> float:
        state = self.at_rest(truth)
        past = [float((ends / term.voltage_limit(state)).max()) for term in self._ending]
        return max([0.0, *(share - 1 for share in past)])

    def _end(self, state: ContactState) -> Tensor:
        """Amplitude [V] up to which there is a light contact, or the scene's highest."""
        return (PULL_IN_SHARE * state.pull_in_voltage_v).clamp(max=self.scene.max_voltage_v)

    def share_of_limit(self, choice: Choice, term: Term) -> float:
        """Highest voltage short of pull-in, over that from which a term reports its status."""
        state = self.at_rest(choice)
        return float((self._end(state) / term.voltage_limit(state)).max())

    def seconds_per_state(self, choice: Choice) -> float:
        """Time to solve one of many states, tables being there."""
        key = (choice.terms, choice.fidelity)
        if key not in self._state_s:
            # A batch of many points: of few states the overhead is all there is.
            rows = torch.arange(_TIMED_TOGETHER) % len(self.voltage_v)
            points, voltage = self.points.at(rows), self.voltage_v[rows]
            times = []
            for _ in range(_TIMED):
                began = perf_counter()
                self._solve(choice, points, voltage)
                times.append(perf_counter() - began)
            self._state_s[key] = min(times) / len(rows)
        return self._state_s[key]

    def seconds_to_prepare(self, choice: Choice) -> float:
        """Time that making the model and its tables took."""
        self._model(choice)
        return self._prepared_s[choice.terms, choice.fidelity]

    def model(self, choice: Choice) -> ContactModel:
        """Return the model of a choice, in its precision, with what the scene wants reported."""
        terms = choice.terms | kept_reports(self.scene)
        model = self.scene.model(choice.fidelity, getattr(torch, choice.dtype), terms=terms)
        self._share(model, choice)
        return model

    def _solve(self, choice: Choice, points: SampledPlaces, voltage_v: Tensor) -> ContactState:
        places = {**points.places, **dict(choice.held)}
        return self._model(choice).solve(voltage_v=voltage_v, **places)

    def _model(self, choice: Choice) -> ContactModel:
        key = (choice.terms, choice.fidelity)
        if key not in self._models:
            began = perf_counter()
            model = self.scene.model(choice.fidelity, terms=choice.terms)
            self._share(model, choice)
            low, high = self.scene.ranges()["normal_force_n"]
            model.solve(torch.tensor([low, high], dtype=torch.float64), 0.0, 1e3)
            self._prepared_s[key] = perf_counter() - began
            self._models[key] = model
        return self._models[key]

    def _share(self, model: ContactModel, choice: Choice) -> None:
        """Take the table of a model with the same solid: it is the slow part of a trial.

        The models most like it come first, since their tables cover the same pressures.
        """
        known = sorted(self._models.items(), key=lambda item: len(item[0][0] ^ choice.terms))
        any(model.solver.fidelity.borrow(other.solver.fidelity) for _, other in known)
