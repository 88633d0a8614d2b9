"""Build every setting of a scene, evaluate it and time it."""

from __future__ import annotations

import platform
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from time import perf_counter
from typing import Any

import torch
from torch import Tensor

from haptix.errors import ToleranceError
from haptix.fidelity import BoundaryElementBox, FidelityName
from haptix.friction import ContactModel
from haptix.planning import Effect, Plan, plan_scene
from haptix.planning.choices import COLLAPSIBLE, Choice, friction_terms, kept_reports, middle
from haptix.planning.effects import SampledPlaces, Trials
from haptix.scene import Scene
from haptix.status import Status
from haptix.surface import FrictionSurface, MeasuredPoints, MeasuringJob
from haptix.tradeoff.pareto import pareto_front
from haptix.tradeoff.settings import (
    QUICK_TOLERANCES,
    TABULATED,
    TOLERANCES,
    Setting,
    ways_to_ask,
)

Progress = Callable[[str, float], None]

_SEED = 20180518  # of the held-out points; neither planning nor a build has it
_POINTS = 2000
_QUICK_POINTS = 500
_BATCH = 1_000_000
_QUICK_BATCH = 50_000
_BOX = BoundaryElementBox(points=64, surfaces=2)
_MEASURED = MeasuredPoints(forces=2, drives=2, axis_values=1)
_REPEATS = 3  # of which the fastest counts


@dataclass(frozen=True)
class Run:
    """One setting, measured.

    Parameters
    ----------
    setting : Setting
        What was measured.
    error : Effect
        Against the mean field with every term, at points held out.
    outside : float
        Share of those points that the surface says it does not reach.
    build_s, query_s_per_million, invert_s_per_million : float
        Times.
    memory_bytes : int
        Of the surface or slice that is asked.
    fronts : tuple of str
        Of "build", "query" and "memory": where nothing has both less error and less of it.
    """

    setting: Setting
    error: Effect
    outside: float
    build_s: float
    query_s_per_million: float
    invert_s_per_million: float
    memory_bytes: int
    fronts: tuple[str, ...] = ()

    def row(self) -> dict[str, Any]:
        """Everything as plain values, for files and tables."""
        return {
            "model": self.setting.model,
            "tolerance": self.setting.tolerance,
            "dtype": self.setting.dtype,
            "form": self.setting.form,
            "device": self.setting.device,
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


@dataclass(frozen=True)
class Tradeoff:
    """All settings of a scene.

    Parameters
    ----------
    scene : Scene
        The scene.
    runs : tuple of Run
        The plan's first.
    plan : Plan
        What planning decides.
    plan_s : float
        Time that it took, which the build time of the planned run does not hold.
    points, batch : int
        States held out, and queries timed together.
    """

    scene: Scene
    runs: tuple[Run, ...]
    plan: Plan
    plan_s: float
    points: int
    batch: int

    def record(self) -> dict[str, Any]:
        """Everything as plain values, with the machine."""
        return {
            "scene": self.scene.name,
            "budget_thresholds": self.scene.budget_thresholds,
            "held_out_points": self.points,
            "queries_timed_together": self.batch,
            "machine": machine(),
            "plan": self.plan.record(),
            "plan_s": self.plan_s,
            "runs": [run.row() for run in self.runs],
        }


def machine() -> dict[str, Any]:
    """What the times were measured on."""
    gpu = torch.cuda.get_device_name() if torch.cuda.is_available() else None
    return {
        "processor": platform.processor() or platform.machine(),
        "threads": torch.get_num_threads(),
        "gpu": gpu,
        "python": platform.python_version(),
        "torch": torch.__version__,
    }


def run_tradeoff(
    scene: Scene,
    quick: bool = False,
    on_progress: Progress = lambda stage, share: None,
    boundary_elements: bool = False,
) -> Tradeoff:
    """Measure every setting of a scene.

    Parameters
    ----------
    scene : Scene
        The scene.
    quick : bool
        Two tolerances and small batches, whose times say little.
    on_progress : callable
        Called with "plan", "truth" or "run" and the share of it that is done; with "measure" where
        there are boundary elements.
    boundary_elements : bool
        Whether a surface corrected by them is measured too, from a small box and four states, which
        takes minutes.

    Raises
    ------
    InputError
        If the scene contradicts itself.
    """
    # First, since it says at once what the box may not be, or may not hold.
    boxed = _boxed(scene) if boundary_elements else None
    began = perf_counter()
    plan = plan_scene(scene, lambda share: on_progress("plan", share))
    plan_s = perf_counter() - began
    compared = _Comparison(
        scene, _QUICK_POINTS if quick else _POINTS, _QUICK_BATCH if quick else _BATCH
    )
    on_progress("truth", 1.0)
    runs = compared.planned(plan)
    tolerances = QUICK_TOLERANCES if quick else TOLERANCES
    builds = [(fidelity, f"{value:g} JND") for fidelity in TABULATED for value in tolerances]
    on_progress("run", 1 / (1 + len(builds)))
    for number, (fidelity, tolerance) in enumerate(builds, start=2):
        began = perf_counter()
        model = scene.model(fidelity, terms=_terms(scene, fidelity))
        try:
            surface = FrictionSurface.build(model, scene.ranges(), tolerance)
        except ToleranceError as error:  # a row too: what the memory allows
            surface, tolerance = error.best, f"{tolerance}, not met"
        build_s = perf_counter() - began
        runs += [
            compared.run(surface, Setting(fidelity, tolerance, *way), build_s)
            for way in ways_to_ask()
        ]
        on_progress("run", number / (1 + len(builds)))
    if boxed is not None:
        runs += _measured(scene, boxed, compared, lambda share: on_progress("measure", share))
    return Tradeoff(scene, _with_fronts(runs), plan, plan_s, compared.count, compared.batch)


def _boxed(scene: Scene) -> ContactModel:
    """The scene solved by boundary elements in a small box."""
    return ContactModel(
        scene.finger,
        scene.screen,
        "boundary-element",
        terms=_terms(scene, "boundary-element"),
        boundary_elements=_BOX,
    )


def _measured(
    scene: Scene, model: ContactModel, compared: _Comparison, report: Callable[[float], None]
) -> list[Run]:
    """A surface that boundary elements correct, whole and as a slice."""
    began = perf_counter()
    tolerance = f"{QUICK_TOLERANCES[0]:g} JND"
    surface = FrictionSurface.measured(MeasuringJob(model, scene, _MEASURED), tolerance, report)
    build_s = perf_counter() - began
    return [
        compared.run(surface, Setting("boundary-element", tolerance, *way), build_s)
        for way in ways_to_ask()
        if way[0] == "float64" and way[2] == "cpu"
    ]


def _terms(scene: Scene, fidelity: FidelityName) -> frozenset[str]:
    return friction_terms(scene, fidelity) | kept_reports(scene)


class _Comparison:
    """SampledPlaces held out, the truth at them, and the queries that are timed."""

    def __init__(self, scene: Scene, count: int, batch: int) -> None:
        everything = Choice(friction_terms(scene))
        self.batch = batch
        self.middles = {axis: middle(*scene.ranges()[axis]) for axis in COLLAPSIBLE}
        trials = Trials(scene, everything, count, _SEED)
        self.count = len(trials.voltage_v)
        self.truths: dict[str, tuple[SampledPlaces, Tensor, Tensor]] = {}
        held = {
            name: torch.full_like(trials.voltage_v, value) for name, value in self.middles.items()
        }
        for form, points in (
            ("surface", trials.points),
            ("slice", replace(trials.points, places={**trials.points.places, **held})),
        ):
            voltage = points.voltage_share * trials.highest_voltage(everything, points)
            self.truths[form] = points, voltage, trials.friction(everything, points, voltage)

    def planned(self, plan: Plan) -> list[Run]:
        """Build as planned; evaluate the surface and a slice of it."""
        began = perf_counter()
        # A model of its own: the plan's has the tables of its trials already.
        model = plan.scene.model(plan.model.fidelity, plan.dtype, terms=plan.model.terms)
        surface = replace(plan, model=model).build()
        build_s = perf_counter() - began
        dtype = plan.record()["dtype"]
        tolerance = f"{plan.tolerance.value:.3g} {plan.tolerance.unit}"
        ways = (way for way in ways_to_ask() if way[0] == dtype)
        return [self.run(surface, Setting("planned", tolerance, *way), build_s) for way in ways]

    def run(self, surface: FrictionSurface, setting: Setting, build_s: float) -> Run:
        """Evaluate and time one surface, asked in one way."""
        dtype = getattr(torch, setting.dtype)
        points, voltage, truth = self.truths[setting.form]
        # A collapsed axis stands for its whole range: nothing is given for it.
        varying = [name for name in COLLAPSIBLE if surface.table.axes[name].varies]
        asked = surface
        place: dict[str, Any] = {name: points.places[name] for name in varying}
        if setting.form == "slice":
            asked = surface.at(**{name: self.middles[name] for name in varying})
            place = {}
        asked = asked.to(dtype, setting.device)
        sample = asked.evaluate(points.places["normal_force_n"], voltage, **place)
        error = Effect.between(truth, sample.mu.to("cpu", torch.float64))
        return Run(
            setting,
            error,
            float((sample.status != int(Status.OK)).double().mean()),
            build_s,
            *self._times(asked, points, voltage, place, dtype, setting.device),
            asked.nbytes,
        )

    def _times(
        self,
        surface: FrictionSurface,
        points: SampledPlaces,
        voltage_v: Tensor,
        place: Mapping[str, Tensor],
        dtype: torch.dtype,
        device: str,
    ) -> tuple[float, float]:
        """Seconds per million of evaluations and of inversions, in one large batch."""
        generator = torch.Generator().manual_seed(_SEED)
        rows = torch.randint(len(voltage_v), (self.batch,), generator=generator)

        def many(column: Tensor) -> Tensor:
            return column[rows].to(device, dtype)

        force, voltage = many(points.places["normal_force_n"]), many(voltage_v)
        at: dict[str, Any] = {name: many(column) for name, column in place.items()}
        mu = surface.evaluate(force, voltage, **at).mu
        return (
            self._seconds(lambda: surface.evaluate(force, voltage, **at), device),
            self._seconds(lambda: surface.voltage(mu, force, **at), device),
        )

    def _seconds(self, work: Callable[[], object], device: str) -> float:
        times = []
        for _ in range(_REPEATS):
            began = perf_counter()
            work()
            if device != "cpu":
                torch.cuda.synchronize()
            times.append(perf_counter() - began)
        return min(times) * 1e6 / self.batch


def _with_fronts(runs: list[Run]) -> tuple[Run, ...]:
    costs: Mapping[str, list[float]] = {
        "build": [run.build_s for run in runs],
        "query": [run.query_s_per_million for run in runs],
        "memory": [float(run.memory_bytes) for run in runs],
    }
    # To three digits: what float64 gains in the seventh is no reason to take it.
    errors = [float(f"{run.error.thresholds_max:.3g}") for run in runs]
    on = {name: pareto_front(list(zip(cost, errors, strict=True))) for name, cost in costs.items()}
    return tuple(
        replace(run, fronts=tuple(name for name in costs if on[name][number]))
        for number, run in enumerate(runs)
    )
