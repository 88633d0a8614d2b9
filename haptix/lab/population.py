"""Fingers of a population, and their friction at some states."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import numpy as np
import torch

from haptix.base.checks import positive, whole
from haptix.base.documents import Part
from haptix.base.errors import InputError
from haptix.base.executors import executor_of
from haptix.base.files import csv_text
from haptix.base.task import Context, Result, Task
from haptix.model.contact.boundary_elements import estimated_bytes
from haptix.model.fidelity import BoundaryElementBox
from haptix.model.finger import Finger
from haptix.model.friction import ContactModel
from haptix.model.screen import Screen
from haptix.model.status import Status

_AXES = ("normal_force_n", "voltage_v", "frequency_hz")
_SOLVED = ("mu", "area_fraction", "pressure_pa", "mean_gap_m")


class SolveStates(Task):
    """Friction of one finger on one screen at all combinations of some values.

    With a `box` the states are solved point by point on its surfaces.
    """

    finger: Finger
    screen: Screen
    normal_force_n: tuple[float, ...]
    voltage_v: tuple[float, ...]
    frequency_hz: tuple[float, ...]
    box: BoundaryElementBox | None = None

    def columns(self) -> dict[str, list[Any]]:
        """Return a list for each column, over all combinations; the frequency is fastest."""
        grid = [*product(*(getattr(self, name) for name in _AXES))]
        at = dict(zip(_AXES, torch.tensor(grid, dtype=torch.float64).T, strict=True))
        how: dict[str, Any] = {}
        if self.box is not None:
            box = replace(self.box, most_states=len(grid))
            how = {"fidelity": "boundary-element", "boundary_elements": box}
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # the box's: the plan chose the box
            state = ContactModel(self.finger, self.screen, **how).solve(**at)
        columns = {name: values.tolist() for name, values in at.items()}
        columns |= {name: getattr(state, name).double().tolist() for name in _SOLVED}
        return {**columns, "status": [Status(int(number)).name for number in state.status]}

    def run(self, context: Context) -> Result:
        """Solve all states."""
        states = self.columns()
        mu, area = states["mu"], states["area_fraction"]
        row = {
            "mu_first": mu[0],
            "mu_last": mu[-1],
            "ratio": mu[-1] / mu[0],
            "area_first": area[0],
            "area_last": area[-1],
            "not_ok": sum(status != "OK" for status in states["status"]),
        }
        table = csv_text(states, zip(*states.values(), strict=True))
        return Result(row, files={"states.csv": table})

    @property
    def needed_bytes(self) -> int:
        """Memory of the box's surfaces, or of the mean field."""
        if self.box is None:
            return super().needed_bytes
        return estimated_bytes(self.box.points, self.box.surfaces, coupled=True)


class DrawnPeople(Part):
    """People around each finger, see `Population.around`."""

    size: int
    """People around each finger."""
    seed: int = 0
    """Seed of the draw."""
    spread: dict[str, float]
    """Standard deviation of the logarithm, by field of the finger."""


@dataclass(frozen=True)
class Population:
    """Fingers, and how they were drawn.

    Parameters
    ----------
    fingers : tuple of Finger
        All of them.
    statement : str
        The spread and its origin, for sidecars.

    Examples
    --------
    >>> spread = {"frictional_shear_stress_pa": 0.3}
    >>> people = Population.around(Finger.preset("wet"), size=3, spread=spread, seed=1)
    >>> len(people.fingers)
    3
    """

    fingers: tuple[Finger, ...]
    statement: str

    def __post_init__(self) -> None:
        if not self.fingers:
            raise InputError("fingers: expected one or more")

    @classmethod
    def around(
        cls, finger: Finger, size: int, spread: Mapping[str, float], seed: int
    ) -> Population:
        """Draw fingers whose fields vary by equal ratios (log-normally), independently.

        Parameters
        ----------
        finger : Finger
            The median of every field.
        size, seed : int
            Number of fingers, 2 or more, and seed of the draw.
        spread : mapping
            Standard deviation of the logarithm, by field: ``{"youngs_modulus_pa": 0.3,
            "roughness.h_rms_m": 0.1}``. There is no default.
        """
        fingers = tuple(drawn for drawn, _ in cls.draw(finger, size, spread, seed))
        widths = ", ".join(f"{name} {width:g}" for name, width in sorted(spread.items()))
        return cls(
            fingers,
            f"{size} fingers around {finger.name!r}, log-normal with standard deviations of the "
            f"logarithm {widths}; seed {seed}",
        )

    def run(
        self,
        screen: Screen,
        normal_force_n: Sequence[float],
        voltage_v: Sequence[float],
        frequency_hz: Sequence[float],
        executor: Any = None,
    ) -> list[dict[str, list[Any]]]:
        """Solve every finger on a screen at all combinations of some values.

        Parameters
        ----------
        screen : Screen
            The screen.
        normal_force_n, voltage_v, frequency_hz : sequence of float
            The values.
        executor : concurrent.futures.Executor or Dask client, optional
            Where fingers are solved; without it here, one after the other.

        Returns
        -------
        list of dict
            For each finger the columns of its states, in the order of the combinations (frequency
            fastest): the values, ``mu``, ``area_fraction``, ``pressure_pa``, ``mean_gap_m`` and
            ``status``.
        """
        values = dict(
            zip(_AXES, map(tuple, (normal_force_n, voltage_v, frequency_hz)), strict=True)
        )
        tasks = [SolveStates(finger=finger, screen=screen, **values) for finger in self.fingers]
        return [*executor_of(executor).map(SolveStates.columns, tasks)]

    @staticmethod
    def draw(
        finger: Finger, size: int, spread: Mapping[str, float], seed: int
    ) -> Iterator[tuple[Finger, dict[str, float]]]:
        """Yield the fingers of `around` one by one, with the value of each field that varies.

        Parameters
        ----------
        finger : Finger
            The median.
        size : int
            How many fingers, 2 or more.
        spread : mapping of str to float
            Standard deviation of the logarithm of each field that varies.
        seed : int
            The same seed gives the same fingers.
        """
        whole("size", size, 2)
        if not spread:
            raise InputError("spread: expected the spread of one field of the finger or more")
        spread = dict(sorted(spread.items()))
        for name, value in spread.items():
            positive(f"spread.{name}", value)
            _get(finger, name)
        generator = np.random.default_rng(seed)
        for _ in range(size):
            drawn = finger
            for name, width in spread.items():
                drawn = _scaled(drawn, name, float(np.exp(width * generator.standard_normal())))
            yield drawn, {name: _get(drawn, name) for name in spread}


def _get(finger: Finger, name: str) -> float:
    value: Any = finger
    for part in name.split("."):
        value = getattr(value, part, None)
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise InputError(f"spread.{name}: {finger.name!r} has no such number")
    return float(value)


def _scaled(finger: Finger, name: str, ratio: float) -> Finger:
    value = _get(finger, name) * ratio
    if "." not in name:
        return finger.replace(**{name: value})
    part, field = name.split(".", 1)
    inner = getattr(finger, part)
    return finger.replace(**{part: {**inner.model_dump(), field: value}})
