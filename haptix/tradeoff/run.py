"""Build every setting of a scene, and measure its error, time and memory."""

from __future__ import annotations

import json
import platform
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from time import perf_counter
from timeit import repeat
from typing import Any

import torch
from torch import Tensor

from haptix.errors import ToleranceError
from haptix.executors import Here, executor_of, finished
from haptix.fidelity import BoundaryElementBox, FidelityName
from haptix.friction import ContactModel
from haptix.planning import Effect, Plan, plan_scene
from haptix.planning.choices import COLLAPSIBLE, Choice, friction_terms, kept_reports, middle
from haptix.planning.effects import SampledPlaces, Trials
from haptix.scene import Scene, plain_scene
from haptix.status import Status
from haptix.surface import FrictionSurface, MeasuredPoints, MeasuringJob
from haptix.tradeoff.settings import (
    FORMS,
    QUICK_TOLERANCES,
    TABULATED,
    TOLERANCES,
    Run,
    SurfaceSetting,
    with_fronts,
)

Progress = Callable[[str, float], None]

_SEED = 20180518  # of the held-out points; planning and building use others
# Held-out points, queries timed together, and tolerances of the surface.
_THOROUGH = (2000, 1_000_000, TOLERANCES)
_QUICK = (500, 50_000, QUICK_TOLERANCES)
_BOX = BoundaryElementBox(points=64, surfaces=2)
_MEASURED = MeasuredPoints(forces=2, drives=2, axis_values=1)
_REPEATS = 3  # of which the fastest counts


@dataclass(frozen=True)
class Tradeoff:
    """All settings of a scene."""

    scene: Scene
    runs: tuple[Run, ...]
    """The planned setting's first."""
    plan: Plan
    plan_s: float
    """Time of planning; build times exclude it."""
    points: int
    """Held-out states."""
    batch: int
    """Queries timed together."""

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
    """Describe the machine that the times were measured on."""
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
    executor: Any = None,
) -> Tradeoff:
    """Measure every setting of a scene.

    Parameters
    ----------
    scene : Scene
        The scene.
    quick : bool
        Two tolerances and small batches; their times are rough.
    on_progress : callable
        Called with the stage ("plan", "truth", "run", or "measure" for boundary elements) and its
        finished share.
    boundary_elements : bool
        Also measure a surface that boundary elements correct, from a small box and four states;
        takes minutes.
    executor : concurrent.futures.Executor or Dask client, optional
        Where settings are measured. Without it here, one after the other: times of settings that
        are measured side by side on one machine are longer.

    Raises
    ------
    InputError
        If the scene contradicts itself.
    """
    jobs = [*setting_jobs(scene, quick, boundary_elements)]
    if boundary_elements:
        _boxed(scene)  # an unsuitable box is refused before any work
    began = perf_counter()
    plan = plan_scene(scene, lambda share: on_progress("plan", share))
    plan_s = perf_counter() - began
    workers = executor_of(executor)
    work = measure_setting
    if isinstance(workers, Here):
        work = partial(measure_setting, on_progress=on_progress, plan=plan)
    found: dict[str, dict[str, Any]] = {}
    texts = [json.dumps(job) for job in jobs]
    for text, future in finished(workers, work, texts):
        found[text] = json.loads(future.result())
        on_progress("run", len(found) / len(jobs))
    runs = [Run.of(row) for text in texts for row in found[text]["runs"]]
    points, batch = found[texts[0]]["points"], (_QUICK if quick else _THOROUGH)[1]
    return Tradeoff(scene, with_fronts(runs), plan, plan_s, points, batch)


def setting_jobs(scene: Scene, quick: bool, boundary_elements: bool) -> Iterator[dict[str, Any]]:
    """Yield the documents of `measure_setting`, the planned setting's first."""
    plain = plain_scene(scene)
    tolerances = (_QUICK if quick else _THOROUGH)[2]
    settings = [("planned", "")]
    settings += [(fidelity, f"{value:g} JND") for fidelity in TABULATED for value in tolerances]
    if boundary_elements:
        settings.append(("boundary-element", f"{QUICK_TOLERANCES[0]:g} JND"))
    for model, tolerance in settings:
        yield {"scene": plain, "quick": quick, "model": model, "tolerance": tolerance}


def measure_setting(
    text: str,
    on_progress: Progress = lambda stage, share: None,
    plan: Plan | None = None,
) -> str:
    """Build the surface of one setting, and measure it in every way to ask it.

    Parameters
    ----------
    text : str
        JSON of one of `setting_jobs`.
    on_progress : callable
        As for `run_tradeoff`.
    plan : Plan, optional
        Plan of the scene, where it is known.

    Returns
    -------
    str
        JSON: ``runs``, see `Run.row`, and ``points``, the number of held-out states.
    """
    job = json.loads(text)
    model, tolerance = job["model"], job["tolerance"]
    bench = _comparison(json.dumps(job["scene"]), job["quick"])
    on_progress("truth", 1.0)
    if model == "planned":
        runs = bench.measure_planned(plan or plan_scene(bench.scene))
    elif model == "boundary-element":
        boxed = _boxed(bench.scene)
        began = perf_counter()
        surface = FrictionSurface.measured(
            MeasuringJob(boxed, bench.scene, _MEASURED),
            tolerance,
            lambda share: on_progress("measure", share),
        )
        build_s = perf_counter() - began
        runs = bench.measure(surface, model, tolerance, build_s, "float64", "cpu")
    else:
        began = perf_counter()
        full = bench.scene.model(model, terms=_terms(bench.scene, model))
        try:
            surface = FrictionSurface.build(full, bench.scene.ranges(), tolerance)
        except ToleranceError as error:  # keep the best that fits into the size
            surface, tolerance = error.best, f"{tolerance}, not met"
        runs = bench.measure(surface, model, tolerance, perf_counter() - began)
    return json.dumps({"points": bench.count, "runs": [run.row() for run in runs]})


def _boxed(scene: Scene) -> ContactModel:
    return ContactModel(
        scene.finger,
        scene.screen,
        "boundary-element",
        terms=_terms(scene, "boundary-element"),
        theory=scene.override.theory,
        boundary_elements=_BOX,
    )


def _terms(scene: Scene, fidelity: FidelityName) -> frozenset[str]:
    return friction_terms(scene, fidelity) | kept_reports(scene)


@lru_cache(maxsize=1)  # a process measures many settings of one scene
def _comparison(scene: str, quick: bool) -> _Comparison:
    count, batch, _ = _QUICK if quick else _THOROUGH
    return _Comparison(Scene(**json.loads(scene)), count, batch)


class _Comparison:
    """Held-out points, the truth at them, and the queries that are timed."""

    def __init__(self, scene: Scene, count: int, batch: int) -> None:
        self.scene = scene
        everything = Choice(friction_terms(scene))
        self.batch = batch
        self.middles = {axis: middle(*scene.ranges()[axis]) for axis in COLLAPSIBLE}
        trials = Trials(scene, everything, count, _SEED)
        self.count = len(trials.voltage_v)
        self.truths: dict[str, tuple[SampledPlaces, Tensor, Tensor]] = {}
        held = {axis: torch.full_like(trials.voltage_v, at) for axis, at in self.middles.items()}
        sliced = replace(trials.points, places={**trials.points.places, **held})
        for form, points in zip(FORMS, (trials.points, sliced), strict=True):
            voltage = points.voltage_share * trials.highest_voltage(everything, points)
            self.truths[form] = points, voltage, trials.friction(everything, points, voltage)

    def measure_planned(self, plan: Plan) -> list[Run]:
        """Build as planned, and measure the surface in the planned precision."""
        began = perf_counter()
        # A new model: the plan's has the tables of its trials already.
        model = plan.scene.model(plan.model.fidelity, plan.dtype, terms=plan.model.terms)
        surface = replace(plan, model=model).build()
        build_s = perf_counter() - began
        tolerance = f"{plan.tolerance.value:.3g} {plan.tolerance.unit}"
        return self.measure(surface, "planned", tolerance, build_s, plan.record()["dtype"])

    def measure(
        self, surface: FrictionSurface, model: str, tolerance: str, build_s: float, *only: str
    ) -> list[Run]:
        """Measure a surface in every way to ask it that has the dtype and device in `only`."""
        return [
            self._run(surface, setting, build_s)
            for setting in SurfaceSetting.every(model, tolerance)
            if {*only} <= {setting.dtype, setting.device}
        ]

    def _run(self, surface: FrictionSurface, setting: SurfaceSetting, build_s: float) -> Run:
        dtype, device = getattr(torch, setting.dtype), setting.device
        points, voltage, truth = self.truths[setting.form]
        # A collapsed axis stands for its whole range: it takes no values.
        varying = [name for name in COLLAPSIBLE if surface.table.axes[name].varies]
        if setting.form == "slice":
            surface = surface.at(**{name: self.middles[name] for name in varying})
            varying = []
        surface = surface.to(dtype, device)
        places: dict[str, Any] = {
            name: points.places[name] for name in ("normal_force_n", *varying)
        }
        sample = surface.evaluate(voltage_v=voltage, **places)
        # Many random points of these, in one batch, are timed.
        generator = torch.Generator().manual_seed(_SEED)
        rows = torch.randint(len(voltage), (self.batch,), generator=generator)
        at: dict[str, Any] = {name: x[rows].to(device, dtype) for name, x in places.items()}
        volts = voltage[rows].to(device, dtype)
        mu = surface.evaluate(voltage_v=volts, **at).mu
        return Run(
            setting,
            Effect.between(truth, sample.mu.to("cpu", torch.float64)),
            float((sample.status != int(Status.OK)).double().mean()),
            build_s,
            self._seconds(lambda: surface.evaluate(voltage_v=volts, **at), device),
            self._seconds(lambda: surface.voltage(mu, **at), device),
            surface.nbytes,
        )

    def _seconds(self, ask: Callable[[], object], device: str) -> float:
        """Seconds per million queries."""

        def work() -> None:
            ask()
            if device != "cpu":
                torch.cuda.synchronize()

        return min(repeat(work, number=1, repeat=_REPEATS)) * 1e6 / self.batch
