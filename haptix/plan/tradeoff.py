"""Build a scene's surface in many ways, and measure the error, time and memory of each.

A trade-off writes a table, all runs as JSON, and a picture that marks the recommended runs.
"""

from __future__ import annotations

import io
import json
import platform
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import lru_cache, partial
from itertools import product
from math import inf
from pathlib import Path
from textwrap import wrap
from time import perf_counter
from timeit import repeat
from typing import TYPE_CHECKING, Annotated, Any, Literal

import torch
from torch import Tensor

from haptix.base.errors import ToleranceError, from_extra
from haptix.base.files import check_folder, csv_text, json_text, write_folder
from haptix.base.report import Heading, titles_of
from haptix.base.task import Context, Result, Task
from haptix.base.version import __version__
from haptix.model.fidelity import BoundaryElementBox, FidelityName
from haptix.model.finger import Finger
from haptix.model.friction import ContactModel
from haptix.model.screen import Screen
from haptix.model.status import Status
from haptix.model.surface import FrictionSurface, MeasuredPoints, MeasuringJob
from haptix.plan.planning import Effect, plan_scene
from haptix.plan.scene import DirectDrive, Scene
from haptix.plan.trials import (
    COARSE,
    COLLAPSIBLE,
    FULL,
    Choice,
    Points,
    Trials,
    friction_terms,
    kept_reports,
    middle,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = [
    "Run", "Tradeoff", "default_scene", "pareto_front", "run_tradeoff", "write_tradeoff",
]  # fmt: skip

Progress = Callable[[str, float], None]

TABULATED: tuple[FidelityName, ...] = (FULL, COARSE)
FORMS = ("surface", "slice")
_SEED = 20180518  # of the held-out points; planning and building use others
# Held-out points, queries timed together, and tolerances of the surface against its model [JND].
_THOROUGH = (2000, 1_000_000, (0.01, 0.02, 0.05, 0.1, 0.2, 0.5))
QUICK = (500, 50_000, (0.05, 0.5))
_BOX = BoundaryElementBox(points=64, surfaces=2)
_MEASURED = MeasuredPoints(forces=2, drives=2, axis_values=1)
_REPEATS = 3  # of which the fastest counts


@dataclass(frozen=True)
class Run:
    """One way to build and query a surface, measured."""

    model: Annotated[str, Heading("model")]
    """A fidelity with every possible term, or "planned": the choice of `plan_scene`."""
    tolerance: Annotated[str, Heading("tolerance")]
    """Tolerance of the surface against that model."""
    dtype: Annotated[str, Heading("asked as", "{0.dtype} {0.form} {0.device}")]
    """Precision of the surface."""
    form: str
    """Whether every query gives frequency and h0 ("surface"), or the surface is sliced at them."""
    device: str
    """Device of the queries."""
    error_max_jnd: Annotated[float, Heading("error [JND]", ".2g")]
    """Error against the mean field with every term, at held-out points [JND]."""
    error_p99_jnd: float
    error_max_mu: float
    error_p99_mu: float
    outside_share: float
    """Share of those points outside the surface."""
    build_s: Annotated[float, Heading("build [s]", ".2g")]
    query_s_per_million: Annotated[float, Heading("query [s/10⁶]", ".2g")]
    invert_s_per_million: Annotated[float, Heading("invert [s/10⁶]", ".2g")]
    memory_bytes: Annotated[int, Heading("memory [bytes]")]
    """Memory of the surface or slice."""
    fronts: str = ""
    """Fronts ("build", "query", "memory") that it is on: no run of its form is better in both."""
    take: Annotated[str, Heading("take")] = ""
    """Use for which it is recommended, see `TAKE`."""


COSTS: Mapping[str, str] = {
    "build": "build_s",
    "query": "query_s_per_million",
    "memory": "memory_bytes",
}
"""The field of a run that is traded against the error, by the name of its front."""

# Columns of a campaign's table for a setting, queried as a float32 surface; its file has all.
_WAY = {"dtype": "float32", "form": "surface", "device": "cpu"}
_TIMES = ("build_s", "query_s_per_million", "invert_s_per_million")
_RESULTS = ("error_max_jnd", "error_p99_jnd", "outside_share", "memory_bytes")
_ERROR, _MEMORY = "error_max_jnd", "memory_bytes"
TAKE: Mapping[str, tuple[float, tuple[str, ...]]] = {
    "as planned": (inf, ()),
    "smallest within the budget": (1.0, (_MEMORY, _ERROR)),
    "smallest within a tenth of the budget": (0.1, (_MEMORY, _ERROR)),
    "most exact": (inf, (_ERROR, _MEMORY)),
}
"""Recommended uses: the share of the budget that the error may have, and the fields to minimise.
Times are left out, since they differ from run to run; so are slices, which answer at one frequency
and h0."""


@dataclass(frozen=True)
class Tradeoff:
    """All runs of a scene."""

    scene: Scene
    runs: tuple[Run, ...]
    """All runs, those of the planned setting first."""
    points: int
    """Held-out states."""
    batch: int
    """Queries timed together."""

    def record(self) -> dict[str, Any]:
        """Everything as plain values, with the machine."""
        return {
            "scene": self.scene.name,
            "budget_jnd": self.scene.budget_jnd,
            "held_out_points": self.points,
            "queries_timed_together": self.batch,
            "machine": machine(),
            "runs": [asdict(run) for run in self.runs],
        }


def machine() -> dict[str, Any]:
    """Describe the machine that the times were measured on."""
    return {
        "processor": platform.processor() or platform.machine(),
        "threads": torch.get_num_threads(),
        "gpu": torch.cuda.get_device_name() if torch.cuda.is_available() else None,
        "python": platform.python_version(),
        "torch": torch.__version__,
    }


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


def run_tradeoff(
    scene: Scene,
    quick: bool = False,
    on_progress: Progress = lambda stage, share: None,
    boundary_elements: bool = False,
) -> Tradeoff:
    """Measure every setting of a scene, one after the other.

    Parameters
    ----------
    scene : Scene
        The scene.
    quick : bool
        Two tolerances and small batches; their times are rough.
    on_progress : callable
        Called with the stage ("run", or "measure" for boundary elements) and its finished share.
    boundary_elements : bool
        Also measure a surface that boundary elements correct, from a small box and four states;
        takes minutes.

    Raises
    ------
    InputError
        If the scene contradicts itself.
    """
    tasks = [*settings(scene, quick, boundary_elements)]
    runs: list[Run] = []
    for number, task in enumerate(tasks, start=1):
        runs += task.runs(on_progress)
        on_progress("run", number / len(tasks))
    bench = task.bench()
    return Tradeoff(scene, chosen(runs, scene.budget_jnd), bench.count, bench.batch)


def settings(scene: Scene, quick: bool, boundary_elements: bool) -> Iterator[MeasureSetting]:
    """Yield the settings of a scene, the planned one first; textures do not matter for them."""
    scene = scene.replace(textures=(), materials=())
    ways: list[tuple[Any, str]] = [("planned", "")]
    tolerances = (QUICK if quick else _THOROUGH)[2]
    ways += [(fidelity, f"{value:g} JND") for fidelity in TABULATED for value in tolerances]
    if boundary_elements:
        _boxed(scene)  # an unsuitable box is refused before any work
        ways.append(("boundary-element", f"{QUICK[2][0]:g} JND"))
    for model, tolerance in ways:
        yield MeasureSetting(scene=scene, quick=quick, model=model, tolerance=tolerance)


class MeasureSetting(Task):
    """One way to build a scene's surface, measured in every way to query it.

    The `model` is that of a `Run`, and the `tolerance` that of the surface against it.
    """

    scene: Scene
    quick: bool
    model: Literal["planned", "mean-field", "closed-form", "boundary-element"]
    tolerance: str

    def run(self, context: Context) -> Result:
        """Build and measure it; times are costs and no results."""
        runs = [asdict(run) for run in self.runs()]
        usual = next((run for run in runs if _WAY.items() <= run.items()), runs[0])
        row, costs = ({name: usual[name] for name in names} for names in (_RESULTS, _TIMES))
        for run in runs:
            way = f"{run['dtype']} {run['form']} {run['device']}"
            costs |= {f"{way} {name}": run.pop(name) for name in _TIMES}
            del run["fronts"], run["take"]  # these compare all settings
        document = {"points": self.bench().count, "runs": runs}
        return Result(row, files={"runs.json": json_text(document)}, costs=costs)

    def bench(self) -> _Bench:
        """Return what measures surfaces of the scene."""
        return _bench(self.scene.model_dump_json(), self.quick)

    def runs(self, on_progress: Progress = lambda stage, share: None) -> list[Run]:
        """Build the surface, and measure it in every way to query it."""
        model, tolerance, bench = self.model, self.tolerance, self.bench()
        dtypes: tuple[str, ...] = ("float64", "float32")
        devices: tuple[str, ...] = ("cpu", "cuda") if torch.cuda.is_available() else ("cpu",)
        if model == "planned":
            plan = plan_scene(bench.scene)
            tolerance = f"{plan.tolerance.value:.3g} {plan.tolerance.unit}"
            dtypes = (str(plan.dtype).removeprefix("torch."),)
            began = perf_counter()
            # A new model: the plan's has the tables of its trials already.
            anew = plan.scene.model(plan.model.fidelity, plan.dtype, terms=plan.model.terms)
            surface = replace(plan, model=anew).build()
        elif model == "boundary-element":
            dtypes, devices = ("float64",), ("cpu",)
            boxed, began = _boxed(bench.scene), perf_counter()
            work = MeasuringJob(boxed, bench.scene, _MEASURED)
            update = partial(on_progress, "measure")
            surface = FrictionSurface.measured(work, tolerance, update)
        else:
            began = perf_counter()
            full = bench.scene.model(model, terms=_terms(bench.scene, model))
            try:
                surface = FrictionSurface.build(full, bench.scene.ranges(), tolerance)
            except ToleranceError as error:  # keep the best of the allowed size
                surface, tolerance = error.best, f"{tolerance}, not met"
        build_s = perf_counter() - began
        return [
            Run(model, tolerance, *way, **bench.measure(surface, *way), build_s=build_s)
            for way in product(dtypes, FORMS, devices)
        ]


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
def _bench(scene: str, quick: bool) -> _Bench:
    count, batch, _ = QUICK if quick else _THOROUGH
    return _Bench(Scene(**json.loads(scene)), count, batch)


class _Bench:
    """Held-out points, the truth at them, and the queries that are timed."""

    def __init__(self, scene: Scene, count: int, batch: int) -> None:
        self.scene, self.batch = scene, batch
        everything = Choice(friction_terms(scene))
        self.middles = {axis: middle(*scene.ranges()[axis]) for axis in COLLAPSIBLE}
        trials = Trials(scene, everything, count, _SEED)
        self.count = len(trials.voltage_v)
        fixed = {axis: torch.full_like(trials.voltage_v, at) for axis, at in self.middles.items()}
        self.truths: dict[str, tuple[Points, Tensor, Tensor]] = {}
        for form, points in zip(FORMS, (trials.points, {**trials.points, **fixed}), strict=True):
            voltage = points["voltage_share"] * trials.highest_voltage(everything, points)
            self.truths[form] = points, voltage, trials.friction(everything, points, voltage)

    def measure(
        self, surface: FrictionSurface, dtype: str, form: str, device: str
    ) -> dict[str, Any]:
        """Return errors, times and memory of one way of querying a surface, by fields of `Run`."""
        points, voltage, truth = self.truths[form]
        # A collapsed axis stands for its whole range: it takes no values.
        varying = [name for name in COLLAPSIBLE if surface.table.axes[name].varies]
        if form == "slice":
            surface = surface.at(**{name: self.middles[name] for name in varying})
            varying = []
        precision = getattr(torch, dtype)
        surface = surface.to(precision, device)
        places: dict[str, Any] = {name: points[name] for name in ("normal_force_n", *varying)}
        sample = surface.evaluate(voltage_v=voltage, **places)
        error = Effect.between(truth, sample.mu.to("cpu", torch.float64))
        # The timed batch takes many random points of these.
        generator = torch.Generator().manual_seed(_SEED)
        rows = torch.randint(len(voltage), (self.batch,), generator=generator)
        at: dict[str, Any] = {name: x[rows].to(device, precision) for name, x in places.items()}
        volts = voltage[rows].to(device, precision)
        mu = surface.evaluate(voltage_v=volts, **at).mu
        return {
            "error_max_jnd": error.jnd_max,
            "error_p99_jnd": error.jnd_p99,
            "error_max_mu": error.mu_max,
            "error_p99_mu": error.mu_p99,
            "outside_share": float((sample.status != int(Status.OK)).double().mean()),
            "query_s_per_million": self._seconds(
                lambda: surface.evaluate(voltage_v=volts, **at), device
            ),
            "invert_s_per_million": self._seconds(lambda: surface.voltage(mu, **at), device),
            "memory_bytes": surface.nbytes,
        }

    def _seconds(self, ask: Callable[[], object], device: str) -> float:
        """Seconds per million queries."""

        def work() -> None:
            ask()
            if device != "cpu":
                torch.cuda.synchronize()

        return min(repeat(work, number=1, repeat=_REPEATS)) * 1e6 / self.batch


def chosen(runs: Sequence[Run], budget_jnd: float) -> tuple[Run, ...]:
    """Return the runs with the fronts that each is on, and the uses for which it is recommended."""
    # Errors are compared to three digits: the seventh is no reason to take float64.
    rounded = [replace(run, error_max_jnd=float(f"{run.error_max_jnd:.3g}")) for run in runs]
    on: dict[int, list[str]] = {}
    for form, (name, cost) in product(FORMS, COSTS.items()):
        those = [number for number, run in enumerate(rounded) if run.form == form]
        costs = [(getattr(rounded[n], cost), rounded[n].error_max_jnd) for n in those]
        for number, is_on in zip(those, pareto_front(costs), strict=True):
            on.setdefault(number, []).extend([name] * is_on)
    take: dict[int, list[str]] = {}
    for purpose, (share, least) in TAKE.items():
        ranked = [
            (*(getattr(run, name) for name in least), number)
            for number, run in enumerate(rounded)
            if run.form == "surface"
            and run.error_max_jnd <= share * budget_jnd
            and (least or run.model == "planned")
        ]
        if ranked:
            take.setdefault(min(ranked)[-1], []).append(purpose)
    return tuple(
        replace(run, fronts=" ".join(on[number]), take=", ".join(take.get(number, [])))
        for number, run in enumerate(runs)
    )


def pareto_front(costs: Sequence[tuple[float, ...]]) -> list[bool]:
    """Return which are on the front: no other is as low in every cost and lower in one.

    Parameters
    ----------
    costs : sequence of tuples of one length
        Lower is better. Equal ones are on the front together.

    Examples
    --------
    >>> pareto_front([(1.0, 5.0), (2.0, 2.0), (3.0, 3.0)])  # the second beats the third
    [True, True, False]
    """

    def beats(first: tuple[float, ...], other: tuple[float, ...]) -> bool:
        return first != other and all(a <= b for a, b in zip(first, other, strict=True))

    return [not any(beats(other, first) for other in costs) for first in costs]


_FILES = ("tradeoff.csv", "tradeoff.png", "tradeoff.json")
_COLORS = ("#ee6677", "#4477aa", "#228833", "#aa3377")  # after P. Tol
_DPI = 150


def write_tradeoff(
    scene: Scene,
    folder: Path,
    quick: bool = False,
    on_progress: Progress = lambda stage, share: None,
    boundary_elements: bool = False,
) -> Tradeoff:
    """Write `run_tradeoff` into a folder, which is made if needed; its last stage is "write".

    Parameters
    ----------
    scene : Scene
        The scene.
    folder : Path
        Where the table, the picture and the record are written.
    quick, boundary_elements : bool
        As in `run_tradeoff`.
    on_progress : callable
        Called with the stage and its finished share.

    Raises
    ------
    InputError
        If the folder cannot be used, before anything is measured; or the scene contradicts itself.
    """
    with from_extra("figures"):
        import matplotlib.figure  # noqa: F401  # its lack is an error before measuring
    check_folder(folder, _FILES)
    tradeoff = run_tradeoff(scene, quick, on_progress, boundary_elements)
    record = {"haptix": __version__, **tradeoff.record()}
    rows = record["runs"]
    table = csv_text(rows[0], (row.values() for row in rows), 6)  # names with units, then the runs
    png = io.BytesIO()
    draw(tradeoff).savefig(png, format="png", dpi=_DPI)
    contents = (table, png.getvalue(), json_text(record))
    write_folder(folder, dict(zip(_FILES, contents, strict=True)))
    on_progress("write", 1.0)
    return tradeoff


def draw(tradeoff: Tradeoff) -> Figure:
    """Draw error against build time, query time and memory: recommended runs, the rest in grey."""
    from matplotlib.figure import Figure
    from matplotlib.layout_engine import ConstrainedLayoutEngine
    from matplotlib.ticker import LogLocator, NullFormatter

    layout = ConstrainedLayoutEngine(rect=(0, 0.06, 1, 0.94))
    figure = Figure(figsize=(13, 5.6), layout=layout)
    panels, titles = figure.subplots(1, len(COSTS), sharey=True), titles_of(Run)
    for axes, name in zip(panels, COSTS, strict=True):
        _panel(axes, tradeoff, name)
        axes.set(xlabel=titles[COSTS[name]], xscale="log", yscale="log")
        for axis in (axes.xaxis, axes.yaxis):
            low, high = axis.get_view_interval()
            # Times often span less than a decade: powers of ten alone would leave them unlabelled.
            axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if high < 100 * low else (1.0,)))
            axis.set_major_formatter("{x:g}")
            axis.set_minor_formatter(NullFormatter())
        axes.grid(which="major", color="0.94", lw=0.7)
        axes.set_axisbelow(True)
    panels[0].set_ylabel(f"largest {titles['error_max_jnd']}")
    handles, labels = panels[0].get_legend_handles_labels()
    beside: dict[str, Any] = {"frameon": False, "alignment": "left"}
    figure.legend(handles[_GREY:], labels[_GREY:], loc="outside upper left", **beside)
    figure.legend(handles[:_GREY], labels[:_GREY], loc="outside upper right", **beside)
    what = machine()
    caption = (
        f"{tradeoff.scene.name}. Errors against the mean field with every term, at "
        f"{tradeoff.points} held-out points, for a slice at its own frequency and h0; times in "
        f"batches of {tradeoff.batch:,} on {what['threads']} thread(s) of {what['processor']}"
        f"{' and ' + what['gpu'] if what['gpu'] else ''}, torch {what['torch']}."
    )
    figure.text(0.01, 0.01, "\n".join(wrap(caption, 190)), fontsize=8, color="0.3", va="bottom")
    return figure


_GREY = 3  # legend entries that a panel draws before the recommended runs


def _panel(axes: Axes, tradeoff: Tradeoff, name: str) -> None:
    def places(runs: Sequence[Run]) -> list[tuple[float, float]]:
        return [(float(getattr(run, COSTS[name])), run.error_max_jnd) for run in runs]

    others = places([run for run in tradeoff.runs if not run.take])
    label = "other surfaces, and slices of one frequency and h0"
    axes.plot(*zip(*others, strict=True), "o", color="0.85", ms=4, zorder=2, label=label)
    surfaces = [run for run in tradeoff.runs if run.form == "surface"]
    front = sorted(places([run for run in surfaces if name in run.fronts.split()]))
    label = "no other surface is better in both"
    axes.step(*zip(*front, strict=True), where="post", color="0.7", lw=1.0, zorder=1, label=label)
    budget = tradeoff.scene.budget_jnd
    axes.axhline(budget, color="0.4", ls="--", lw=1.0, zorder=1, label="budget of the scene")
    taken = sorted((run for run in surfaces if run.take), key=lambda run: run.memory_bytes)
    for number, (run, color) in enumerate(zip(taken, _COLORS, strict=False), start=1):
        [place] = places([run])
        label = f"{number}  {run.take}: {_description(run)}"
        axes.plot(*place, "o", color=color, ms=9, zorder=4, label=label)
        axes.annotate(
            str(number), place, (7, 5 - 15 * (number % 2)), textcoords="offset points",
            color=color, fontweight="bold", zorder=5,
        )  # fmt: skip
    axes.margins(0.1)


def _description(run: Run) -> str:
    """The run's settings and costs."""
    model = "" if run.model == "planned" else f"{run.model.replace('-', ' ')}, "
    where = "" if run.device == "cpu" else ", GPU"
    return (
        f"{model}{run.tolerance}, {run.dtype}{where} "
        f"({run.error_max_jnd:.2g} JND, {run.build_s:.2g} s, "
        f"{run.query_s_per_million:.2g} s/10⁶, {run.memory_bytes:,} B)"
    )
