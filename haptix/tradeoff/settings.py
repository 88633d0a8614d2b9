"""Settings of a tradeoff, and the runs that measure them with their Pareto fronts."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, fields, replace
from itertools import product
from typing import Any, Literal, Self

import torch

from haptix.fidelity import FidelityName
from haptix.finger import Finger
from haptix.planning import Effect
from haptix.planning.choices import COARSE, FULL
from haptix.scene import DirectDrive, DtypeName, Scene
from haptix.screen import Screen

TOLERANCES = (0.01, 0.02, 0.05, 0.1, 0.2, 0.5)
"""Tolerances of the surface against its own model [JND]."""

QUICK_TOLERANCES = (0.05, 0.5)

TABULATED: tuple[FidelityName, ...] = (FULL, COARSE)
DTYPES: tuple[DtypeName, ...] = ("float64", "float32")
Form = Literal["surface", "slice"]
FORMS: tuple[Form, ...] = ("surface", "slice")


@dataclass(frozen=True)
class SurfaceSetting:
    """One way to build and query a surface."""

    model: str
    """A fidelity with every possible term, or "planned": the choice of `plan_scene`."""
    tolerance: str
    """Tolerance of the surface against that model."""
    dtype: DtypeName
    """Precision of the surface."""
    form: Form
    """Whether every query gives frequency and h0, or the surface is sliced at them once."""
    device: str = "cpu"
    """Device of the queries."""

    @classmethod
    def every(cls, model: str, tolerance: str) -> Iterator[Self]:
        """All dtypes, forms and devices in which a surface can be queried."""
        devices = ("cpu", "cuda") if torch.cuda.is_available() else ("cpu",)
        for way in product(DTYPES, FORMS, devices):
            yield cls(model, tolerance, *way)


@dataclass(frozen=True)
class Run:
    """One setting, measured."""

    setting: SurfaceSetting
    error: Effect
    """Error against the mean field with every term, at held-out points."""
    outside: float
    """Share of those points outside the surface."""
    build_s: float
    query_s_per_million: float
    invert_s_per_million: float
    memory_bytes: int
    """Memory of the surface or slice."""
    fronts: tuple[str, ...] = ()
    """Pareto fronts that it is on, of "build", "query" and "memory": no other run is better in both
    error and this cost."""

    @classmethod
    def of(cls, row: Mapping[str, Any]) -> Self:
        """Return the run of a `row`."""
        setting = SurfaceSetting(**{one.name: row[one.name] for one in fields(SurfaceSetting)})
        error = Effect(
            mu_max=row["error_max_mu"],
            mu_p99=row["error_p99_mu"],
            thresholds_max=row["error_max_thresholds"],
            thresholds_p99=row["error_p99_thresholds"],
        )
        names = ("build_s", "query_s_per_million", "invert_s_per_million", "memory_bytes")
        costs = {name: row[name] for name in names}
        fronts = tuple(row["fronts"].split())
        return cls(setting, error, row["outside_share"], **costs, fronts=fronts)

    def row(self) -> dict[str, Any]:
        """Everything as plain values, for files and tables."""
        return {
            **asdict(self.setting),
            "error_max_thresholds": self.error.thresholds_max,
            "error_p99_thresholds": self.error.thresholds_p99,
            "error_max_mu": self.error.mu_max,
            "error_p99_mu": self.error.mu_p99,
            "outside_share": self.outside,
            "build_s": self.build_s,
            "query_s_per_million": self.query_s_per_million,
            "invert_s_per_million": self.invert_s_per_million,
            "memory_bytes": self.memory_bytes,
            "fronts": " ".join(self.fronts),
        }


COSTS: Mapping[str, Callable[[Run], float]] = {
    "build": lambda run: run.build_s,
    "query": lambda run: run.query_s_per_million,
    "memory": lambda run: float(run.memory_bytes),
}
"""What is traded against the error, by the name of its front."""


def with_fronts(runs: list[Run]) -> tuple[Run, ...]:
    """Return the runs with the fronts that each is on."""
    costs = {name: [cost(run) for run in runs] for name, cost in COSTS.items()}
    # Errors are compared to three digits: the seventh is no reason to take float64.
    errors = [float(f"{run.error.thresholds_max:.3g}") for run in runs]
    on = {name: pareto_front(list(zip(cost, errors, strict=True))) for name, cost in costs.items()}
    return tuple(
        replace(run, fronts=tuple(name for name in costs if on[name][number]))
        for number, run in enumerate(runs)
    )


def pareto_front(costs: Sequence[tuple[float, ...]]) -> list[bool]:
    """Return which are on the front: no other is as low in every cost and lower in one.

    Parameters
    ----------
    costs : sequence of tuples of one length
        Lower is better. Equal ones are on the front together.
    """

    def beats(one: tuple[float, ...], other: tuple[float, ...]) -> bool:
        return one != other and all(a <= b for a, b in zip(one, other, strict=True))

    return [not any(beats(other, one) for other in costs) for one in costs]


def default_scene() -> Scene:
    """Return a scene in which every axis varies: the paper's finger on several insulators.

    The drive is direct, at the frequencies of the physics page, section 7.
    """
    return Scene(
        name="semi-wet finger, 80 to 400 Hz, several screens",
        finger=Finger.preset("semi-wet"),
        screen=Screen.preset("3m-sct3250"),
        normal_force_n=(0.1, 1.0),
        drive=DirectDrive(scheme="direct", frequency_hz=(80.0, 400.0)),
        h0_m=(0.1e-6, 0.2e-6),
    )
