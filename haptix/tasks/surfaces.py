"""Tasks of surfaces: build, query, invert, export and list them; plan a scene, weigh its costs."""

from __future__ import annotations

import re
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import asdict
from functools import partial
from itertools import product
from math import isfinite, prod
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import AfterValidator, Field

from haptix.base.errors import InputError, LimitError, ToleranceError
from haptix.base.fields import (
    Argument,
    FileThere,
    Folder,
    Force,
    ForceRange,
    Frequency,
    FrequencyRange,
    Local,
    NewFile,
    NotNegative,
    Positive,
    PositiveRange,
    Typed,
    check_new,
    file_to_write,
    is_there,
)
from haptix.base.files import cache_folder, reading
from haptix.base.report import record
from haptix.base.task import Context, Result, Task
from haptix.base.terminal import accuracy_note, placeholder_note, warning_note
from haptix.model.presets import (
    DEFAULT_CARRIER_HZ,
    FingerName,
    ScreenName,
    TermName,
    breakdown_note,
)

if TYPE_CHECKING:
    from haptix.model.friction import ContactModel
    from haptix.model.surface import FrictionSurface


_VERIFIED = "normal_force_n", "voltage_v", "frequency_hz"
SurfaceThere = Annotated[FileThere, Argument]


_THICKEST_M = 1e-3  # d1/eps1 of an insulator; a larger number was meant in another unit
Thickness = Annotated[Positive, Field(json_schema_extra={"exclusiveMaximum": _THICKEST_M})]


def _is_an_insulator(value: Any) -> Any:
    if value is not None and max(value) >= _THICKEST_M:
        raise ValueError(
            f"expected metres, less than {_THICKEST_M:g}, such as 0.2um, got {max(value):g}"
        )
    return value


PastLimits = Annotated[
    bool, Field(description="Offer states past the model's limits, too: docs/limits.md has them.")
]


class OfModel(Task):
    """A contact model of a finger on a screen."""

    finger: FingerName | None = Field(
        None,
        description="Finger: a preset (dry, semi-wet, wet) or a TOML file. [default: finger.toml "
        "beside a calibrated screen, or semi-wet]",
    )
    screen: ScreenName = Field(
        "3m-sct3250", description="Screen: a preset (3m-sct3250) or a TOML file."
    )
    skin_dielectric: Literal["order-of-magnitude", "gabriel-dry", "gabriel-wet"] | None = Field(
        None,
        description="Skin dielectric: order-of-magnitude, gabriel-dry or gabriel-wet. "
        "[default: the finger's own]",
    )
    fidelity: Literal["mean-field", "closed-form", "boundary-element"] = Field(
        "mean-field",
        description="mean-field; closed-form: faster and coarser; boundary-element: the "
        "reference, slow.",
    )
    theory: Literal["local", "corrected", "open-gaps", "as-published"] | None = Field(
        None,
        description="Mean field: local, by boundary elements; corrected, which spreads the "
        "attraction evenly; open-gaps; as-published. tau_f is carried over. "
        "[default: the finger's]",
    )
    with_terms: Annotated[tuple[TermName, ...], Typed("--with")] = Field(
        (), description="Switch a term on, such as finite-size; may be repeated."
    )
    without_terms: Annotated[tuple[TermName, ...], Typed("--without")] = Field(
        (), description="Switch a term off; may be repeated."
    )

    def model(self) -> ContactModel:
        """Return the contact model."""
        from haptix.model.friction import ContactModel
        from haptix.model.pair import profiles

        if both := {*self.with_terms} & {*self.without_terms}:
            raise InputError(f"--with and --without: expected one of them, both name {both.pop()}")
        chosen, screen = profiles(self.finger, self.screen)
        if self.skin_dielectric is not None:
            chosen = chosen.replace(dielectric=self.skin_dielectric)
        terms = dict.fromkeys(self.with_terms, True) | dict.fromkeys(self.without_terms, False)
        return ContactModel(chosen, screen, fidelity=self.fidelity, theory=self.theory, terms=terms)


def _tolerance(value: str) -> str:
    from haptix.model.surface.tolerance import Tolerance

    try:
        Tolerance.read(value)
    except InputError as error:
        raise ValueError(str(error).removeprefix("tolerance: ")) from None
    return value


def _scene_or_new(path: Path) -> Path:
    return is_there(path) if path.suffix == ".toml" else file_to_write(path)


class Build(OfModel, command="build"):
    """Solve the contact model once and write its friction surface.

    Exit code 3 means that the tolerance cannot be met within the size. Then nothing is written,
    unless you pass --accept-best.
    """

    what: Annotated[
        Path, AfterValidator(_scene_or_new), Local(), Typed("", True, "OUT|SCENE.toml")
    ] = Field(description="File to write, such as my.surface; or a scene, whose plan is built.")
    out: NewFile | None = Field(
        None, description="File to write for a scene. [default: SCENE.surface]"
    )
    normal_force_n: ForceRange | None = Field(
        None, description="Range of normal force [N]: LOW,HIGH or one value. [default: 0.1,1]"
    )
    voltage_v: Positive | None = Field(
        None, description="Highest amplitude [V]. [default: the screen's limit]"
    )
    frequency_hz: FrequencyRange | None = Field(
        None, description="Drive frequency [Hz]: LOW,HIGH or one. Without it the skin conducts."
    )
    h0_m: Annotated[PositiveRange | None, AfterValidator(_is_an_insulator)] = Field(
        None, description="Range of d1/eps1 [m]. [default: the screen's own]"
    )
    tolerance: Annotated[str, AfterValidator(_tolerance)] | None = Field(
        None,
        description='Largest error: in mu, "0.05 JND" or "0.2 %" of the range. '
        "[default: 0.002, or the plan's]",
    )
    largest_mb: Positive = Field(64.0, description="Size that the surface may have.")
    accept_best: bool = Field(
        False, description="Write the best of that size if the tolerance cannot be met."
    )
    past_limits: PastLimits = False
    overwrite: bool = Field(False, description="Replace an existing file.")

    def run(self, context: Context) -> Result:
        """Build it, and write it."""
        from haptix.model.pair import first_line

        scene = self.what if self.what.suffix == ".toml" else None
        if scene is None and self.out is not None:
            raise InputError(f"--out goes with a scene; {self.what} is the file to write")
        if scene is not None and (wrong := self.model_fields_set & _IN_A_SCENE.keys()):
            named = ", ".join(option for name, option in _IN_A_SCENE.items() if name in wrong)
            raise InputError(
                f"{named}: a scene says this itself; change it there, or in its [override]"
            )
        target = self.what if scene is None else self.out or self.what.with_suffix(".surface")
        read = [path for path in (scene, self.finger, self.screen) if path is not None]
        check_new(target, self.overwrite, *map(Path, read))
        try:
            surface = self._built(context, scene, target)
        except ToleranceError as error:
            if not self.accept_best or error.best is None:
                raise ToleranceError(f"{error}; or pass --accept-best", error.best) from None
            surface = error.best
        surface.save(target)
        share = surface.info["pull_past_breakdown"]
        about = surface.info["profiles"]
        title = f"{first_line(about)}\nfriction surface{note_of(surface, target)}"
        title += breakdown_note(share)
        row = _summary(target, surface)
        # A table has it in its title, which has no room for more.
        return Result([{**row, "pull_past_breakdown": share, **about}], [(title, [row])])

    def _built(self, context: Context, scene: Path | None, target: Path) -> FrictionSurface:
        """Tabulate a model; boundary elements correct the mean field and resume if interrupted."""
        context.progress("plan the scene" if scene else "build the surface", 0.0)
        from haptix.model.surface import FrictionSurface, MeasuringJob

        update = partial(context.progress, "build the surface")
        largest_bytes = int(min(self.largest_mb, 1e6) * 1e6)
        if scene is not None:
            from haptix.plan.planning import plan_scene
            from haptix.plan.scene import Scene

            plan = plan_scene(Scene.load(scene), partial(context.progress, "plan the scene"))
            return plan.build(update, self.tolerance, largest_bytes, self.past_limits)
        model, tolerance = self.model(), self.tolerance or "0.002"
        wanted = {name: getattr(self, name) for name in ("normal_force_n", "frequency_hz", "h0_m")}
        ranges = {name: ends for name, ends in wanted.items() if ends is not None}
        if self.voltage_v is not None:
            ranges["voltage_v"] = (0.0, self.voltage_v)
        if model.boxed is None:
            notes = {"placeholder_spread_jnd": _spread_at_corners(model, ranges)}
            return FrictionSurface.build(
                model, ranges, tolerance, update, largest_bytes, notes, self.past_limits
            )
        job = MeasuringJob(model, ranges, past_limits=self.past_limits)
        kept = target.with_name(target.name + ".partial.npz")
        target.parent.mkdir(parents=True, exist_ok=True)
        context.tell(
            step=f"{job.states} states of boundary elements, some {job.estimated_seconds():.2g} s; "
            f"an interrupted build resumes from {kept}"
        )
        surface = FrictionSurface.measured(job, tolerance, update, largest_bytes, checkpoint=kept)
        kept.unlink(missing_ok=True)
        return surface


_IN_A_SCENE = {
    "finger": "--finger", "screen": "--screen", "skin_dielectric": "--skin-dielectric",
    "fidelity": "--fidelity", "theory": "--theory", "normal_force_n": "--normal-force-n",
    "voltage_v": "--voltage-v", "frequency_hz": "--frequency-hz", "h0_m": "--h0-m",
    "with_terms": "--with", "without_terms": "--without",
}  # fmt: skip
"""Parameters of `Build` that a scene sets itself, and their options."""


class Query(OfModel, command="query", route="queries"):
    """Friction for a force and a voltage, from the model or from a surface."""

    normal_force_n: tuple[Force, ...] = Field(description="Normal forces [N], comma-separated.")
    voltage_v: tuple[NotNegative, ...] = Field(description="Amplitudes [V], comma-separated.")
    frequency_hz: tuple[Frequency, ...] | None = Field(
        None, description="Drive frequencies [Hz]. Without them the skin is a conductor."
    )
    h0_m: Annotated[tuple[Thickness, ...] | None, AfterValidator(_is_an_insulator)] = Field(
        None, description="d1/eps1 of the insulator [m]. [default: the screen's own]"
    )
    surface: FileThere | None = Field(
        None, description="Read this surface instead of solving the model."
    )

    def run(self, context: Context) -> Result:
        """Solve all combinations."""
        from haptix.model.friction import placeholder_spread
        from haptix.model.pair import described, first_line
        from haptix.model.screen import Screen
        from haptix.model.surface import FrictionSurface

        inputs = _product(self, "normal_force_n", "voltage_v", "frequency_hz", "h0_m")
        spread: dict[str, Any] = {}
        roughness: dict[str, float] = {}
        if self.surface is None:
            model = self.model()
            state, spread = model.solve(**inputs), placeholder_spread(model, **inputs)
            largest = {name: float(jnd.max()) for name, jnd in spread.items()}
            x = float(state.x.min())
            note = placeholder_note(model.placeholders(), largest)
            h_rms_m = float(model.contact.spectrum.h_rms_m)
            note += f"; h_rms {h_rms_m * 1e6:.3g} um; x = p0/(E* slope) from {x:.2g}"
            note += f"; {state.accuracy}"
            outputs = {name: getattr(state, name) for name in _OF_A_STATE}
            share = float(state.pull_past_breakdown.max())
            status, warnings = state.status, state.warnings()
            about, screen = described(model.finger, model.screen), model.screen
            roughness["h_rms_m"] = h_rms_m
        else:
            table = FrictionSurface.load(self.surface)
            with reading(self.surface, "a surface with its model"):
                screen = Screen.model_validate(table.info["model"]["screen"])
                limit = screen.max_voltage_v
            highest = float(inputs["voltage_v"].max())
            if highest > limit:
                raise LimitError(
                    f"voltage_v: {highest:g} V is above the limit of {limit:g} V of the "
                    "surface's screen; lower it (it is rejected, not clamped)"
                )
            sample, note = table.evaluate(**inputs), note_of(table, self.surface)
            status, warnings = sample.status, []
            places = {name: value for name, value in inputs.items() if name != "voltage_v"}
            cells = table.intervals(**places)
            outputs = {
                "mu": sample.mu,
                "interval_jnd": cells.mu_jnd,
                "contrast_interval_jnd": cells.contrast_jnd,
            }
            about = dict(table.info["profiles"])
            share = float(table.info["pull_past_breakdown"])
        used = [inputs[name] for name in _VERIFIED]
        beyond = screen.verified.beyond(*used) if screen.verified else []
        if beyond:
            about["beyond_verified"] = "; ".join(beyond)
        title = f"{first_line(about)}\nfriction at the period's mean attraction{note}"
        title += breakdown_note(share) + warning_note([*warnings, *beyond])
        spreads = {f"{name.replace(' ', '_')}_spread_jnd": jnd for name, jnd in spread.items()}
        document = [row | about | roughness for row in _rows(inputs, outputs | spreads, status)]
        # A table of 80 columns has no room for the columns of its title.
        shown = {name: column for name, column in outputs.items() if name not in _IN_THE_TITLE}
        return Result(document, [(title, _rows(inputs, shown, status))])


_IN_THE_TITLE = ("x", "pull_past_breakdown")
_OF_A_STATE = (
    "mu", "x", "area_fraction", "attraction_pa", "pull_in_voltage_v", "pull_past_breakdown",
)  # fmt: skip


_REACH_TOLERANCE = "0.02 JND"  # far less than a person feels, and less than the table's digits


class Reach(OfModel, command="reach", route="reaches"):
    """Lowest and highest friction that a surface offers for a finger, and what limits it."""

    normal_force_n: tuple[Force, ...] = Field((0.2, 0.5, 1.0), description="Normal forces [N].")
    frequency_hz: Frequency = Field(DEFAULT_CARRIER_HZ, description="Frequency of the drive.")
    past_limits: PastLimits = False

    def run(self, context: Context) -> Result:
        """Tabulate the forces, and read where the columns end."""
        from haptix.model.pair import described, first_line
        from haptix.model.perception.thresholds import WEBER_FRACTION
        from haptix.model.surface import FrictionSurface

        model, force_n = self.model(), [*self.normal_force_n]
        ends = {"normal_force_n": (min(force_n), max(force_n)), "frequency_hz": self.frequency_hz}
        update = partial(context.progress, "build the surface")
        surface = FrictionSurface.build(
            model, ends, _REACH_TOLERANCE, update, past_limits=self.past_limits
        )
        low, high = surface.reachable(force_n, self.frequency_hz)
        beyond = surface.voltage(2 * high, force_n, self.frequency_hz)
        outputs = {"voltage_v": beyond.voltage_v, "mu_low": low, "mu_high": high}
        outputs["range_jnd"] = (high / low - 1) / WEBER_FRACTION
        rows = _rows({"normal_force_n": self.normal_force_n}, outputs, beyond.status)
        for row in rows:  # no other reason is left for friction above that of the highest voltage
            status = row.pop("status")
            row["limited_by"] = "VOLTAGE" if status == "ABOVE" else status
        about = described(model.finger, model.screen)
        title = f"{first_line(about)}\nfriction within reach at {self.frequency_hz:g} Hz"
        title += accuracy_note(surface.info.get("accuracy"))
        title += breakdown_note(surface.info["pull_past_breakdown"])
        return Result([row | about for row in rows], [(title, rows)])


class Invert(Task, command="invert"):
    """Voltage for a friction, with the status of each, such as OK, BELOW, ABOVE or FRICTION."""

    surface: SurfaceThere = Field(description="Surface made by `haptix build`.")
    mu: tuple[float, ...] = Field(description="Friction coefficients, comma-separated.")
    normal_force_n: tuple[Force, ...] = Field(description="Normal forces [N], comma-separated.")
    frequency_hz: tuple[Frequency, ...] | None = Field(
        None, description="Drive frequencies [Hz]. Without them the skin is a conductor."
    )
    h0_m: Annotated[tuple[Positive, ...] | None, AfterValidator(_is_an_insulator)] = Field(
        None, description="d1/eps1 of the insulator [m]. [default: the screen's own]"
    )

    def run(self, context: Context) -> Result:
        """Invert all combinations."""
        from haptix.model.pair import first_line
        from haptix.model.surface import FrictionSurface

        inputs = _product(self, "mu", "normal_force_n", "frequency_hz", "h0_m")
        table = FrictionSurface.load(self.surface)
        inverse = table.voltage(**inputs)
        rows = _rows(inputs, {"voltage_v": inverse.voltage_v}, inverse.status)
        about = table.info["profiles"]
        title = f"{first_line(about)}\nvoltage{note_of(table, self.surface)}"
        return Result([row | about for row in rows], [(title, rows)])


class Export(Task, command="export"):
    """Write a surface's numbers as NetCDF, for other programs; needs xarray and h5netcdf."""

    surface: SurfaceThere = Field(description="Surface made by `haptix build`.")
    out: Annotated[NewFile, Argument] = Field(description="NetCDF file to write, such as my.nc.")
    overwrite: bool = Field(False, description="Replace an existing file.")

    def run(self, context: Context) -> Result:
        """Write the file."""
        from haptix.model.surface import FrictionSurface

        check_new(self.out, self.overwrite, self.surface)
        table = FrictionSurface.load(self.surface)
        table.to_netcdf(self.out)
        size = self.out.stat().st_size
        rows = [{"file": str(self.out), "values": table.mu_table.numel(), "bytes": size}]
        return Result(rows, [("exported surface", rows)])


# Results are named by a hash, which tells them from files that somebody else has put there.
_IN_CACHE = re.compile(r"results/[0-9a-f]{2}/[0-9a-f]{64}/[^/]+")


class ListCache(Task, command="cache"):
    """List the results that are kept so that they are not made twice, or remove them.

    Profiles of calibrated screens and the files of apps are no cache, and are left alone.
    """

    clear: bool = Field(False, description="Remove them; they are made again when needed.")

    def run(self, context: Context) -> Result:
        """List the cache, and remove it on request."""
        try:
            folder = cache_folder()
            if folder.is_dir():
                next(folder.iterdir(), None)  # glob passes over what cannot be read
            inside = [*folder.glob("results/*/*/*")]
            names = {path: path.relative_to(folder).as_posix() for path in inside}
            surfaces = sorted(path for path in inside if _IN_CACHE.fullmatch(names[path]))
            row = {
                "kept": "surfaces",
                "files": len(surfaces),
                "bytes": sum(path.lstat().st_size for path in surfaces),
                "folder": str(folder) if surfaces else "-",
            }
        except OSError as error:
            raise InputError(f"cannot read {error.filename}: {error.strerror}") from None
        if self.clear:
            _remove(surfaces)
        title = "removed from the cache" if self.clear else "cache; --clear removes it"
        return Result([row], [(title, [row])])


def _remove(files: Iterable[Path]) -> None:
    wrong = []
    for path in files:
        try:
            path.unlink(missing_ok=True)
            with suppress(OSError):  # it is not empty yet
                path.parent.rmdir()
        except OSError as error:
            wrong.append(f"{path}: {error.strerror}")
    if wrong:
        raise InputError(
            f"cannot remove {len(wrong)} files of the cache, such as {wrong[0]}; end the programs "
            "that use them, and try again"
        )


def _spread_at_corners(model: ContactModel, ranges: dict[str, Any]) -> dict[str, float]:
    """Largest placeholder spread [JND] at the corners of a surface, at its highest voltage."""
    import torch

    from haptix.model.friction.placeholders import largest_spread
    from haptix.model.surface.axes import AXIS_NAMES, read_ranges

    whole = read_ranges(model, ranges)
    ends = {name: whole[name] for name in (*AXIS_NAMES, "voltage_v")}
    values = {name: sorted(set(pair)) for name, pair in ends.items() if pair is not None}
    values["voltage_v"] = values["voltage_v"][-1:]
    corners = torch.tensor(list(product(*values.values())), dtype=torch.float64).T
    places = dict(zip(values, corners, strict=True))
    return largest_spread(model, places, places.pop("voltage_v"))


def _summary(path: Path, surface: FrictionSurface) -> dict[str, Any]:
    info = surface.info
    return {
        "file": str(path),
        "grid": " x ".join(str(size) for size in surface.mu_table.shape if size > 1),
        "bytes": path.stat().st_size,
        **{name: info[name] for name in ("mu_low", "mu_high", "error_max", "error_p99")},
        "tolerance": info["tolerance"]["value"],
        "unit": info["tolerance"]["unit"],
        "met": info["tolerance_met"],
    }


def note_of(table: FrictionSurface, file: Path) -> str:
    """Return a title's note on the placeholders of a surface and on its accuracy."""
    with reading(file, "a surface with its model"):
        placeholders = [str(placeholder) for placeholder in table.info["model"]["placeholders"]]
        # A surface that was built in Python does not have it.
        spread = table.info["notes"].get("placeholder_spread_jnd", {})
        note = placeholder_note(placeholders, {str(k): float(v) for k, v in spread.items()})
        return note + accuracy_note(table.info["accuracy"])


#: Of one query: the model takes 2.2 KB for each, and 18 KB of JSON can ask for a million.
_MOST_STATES = 200_000


def _product(task: Task, *names: str) -> dict[str, Any]:
    """Every combination of some parameters, one row each; a parameter without values stays None."""
    import torch

    lists = {name: values for name in names if (values := getattr(task, name)) is not None}
    if (count := prod(map(len, lists.values()))) > _MOST_STATES:
        raise LimitError(
            f"{', '.join(lists)}: expected at most {_MOST_STATES} combinations, got {count}; ask "
            "for them in parts"
        )
    columns = torch.tensor(list(product(*lists.values())), dtype=torch.float64).T
    return dict.fromkeys(names) | dict(zip(lists, columns, strict=True))


def _rows(inputs: dict[str, Any], outputs: dict[str, Any], status: Any) -> list[dict[str, Any]]:
    """Rows for JSON: None where a number is not finite, as an interval that was not shown."""
    from haptix.model.status import Status

    columns = {name: column for name, column in (inputs | outputs).items() if column is not None}
    return [
        {name: x if isfinite(x := float(column[row])) else None for name, column in columns.items()}
        | {"status": Status(int(status[row])).name}
        for row in range(len(status))
    ]


_STAGES = {
    "run": "build, query and invert",
    "measure": "solve boundary elements",
    "write": "write tables and plot",
}


class PlanScene(Task, command="plan"):
    """Measure the effect of each part of the model in a scene, and drop what its budget allows.

    An effect is the largest over points of the scene, in friction coefficient and in
    just-noticeable differences (JND). A cost is the time that it adds to the contact's table and
    2,000 states.
    """

    scene: Annotated[FileThere, Argument] = Field(description="Scene: a TOML file.")

    def run(self, context: Context) -> Result:
        """Plan it."""
        context.progress("plan the scene", 0.0)  # the bar appears before torch loads, for seconds
        from haptix.model.pair import described, first_line
        from haptix.plan.planning import plan_scene
        from haptix.plan.scene import Scene

        plan = plan_scene(Scene.load(self.scene), partial(context.progress, "plan the scene"))
        dtype = str(plan.dtype).removeprefix("torch.")
        about = described(plan.model.finger, plan.model.screen)
        title = (
            f"{first_line(about)}\n{plan.scene.name}: {plan.model.fidelity}, {dtype}, "
            f"tolerance {plan.tolerance.value:.3g} {plan.tolerance.unit}; left out "
            f"{plan.effect.jnd_max:.2g} of {plan.scene.budget_jnd:g} JND"
        )
        title += f"; x = p0/(E* slope) from {plan.lowest_x:.2g}; {plan.accuracy}"
        title += warning_note(plan.warnings)
        title += placeholder_note(plan.model.placeholders(), plan.placeholder_spread_jnd)
        title += breakdown_note(plan.pull_past_breakdown)
        spread = {"placeholder_spread_jnd": dict(plan.placeholder_spread_jnd)}
        document = []
        for row in plan.rows:
            effect = {f"effect_{name}": value for name, value in asdict(row.effect).items()}
            document.append({**row.decision, **effect, "cost_s": row.cost_s, **spread, **about})
        return Result(document, [(title, plan.rows)])


class TradeOff(Task, command="tradeoff", route="tradeoffs", keeps="results"):
    """Measure error, build time, query time and memory of many ways to build a scene's surface.

    Writes tradeoff.csv, tradeoff.json and tradeoff.png.
    """

    scene: Annotated[FileThere, Argument] | None = Field(
        None, description="Scene: a TOML file. [default: one that is built in]"
    )
    out: Folder = Field(Path("haptix-tradeoff"), description="Folder for the outputs.")
    quick: bool = Field(False, description="Few runs and short timings.")
    boundary_elements: bool = Field(
        False, description="Also measure a surface that boundary elements correct; takes minutes."
    )

    def run(self, context: Context) -> Result:
        """Measure, and write the files."""
        context.progress(_STAGES["run"], 0.0)
        from haptix.model.pair import described, first_line
        from haptix.plan.scene import Scene
        from haptix.plan.tradeoff import default_scene, write_tradeoff

        scene = default_scene() if self.scene is None else Scene.load(self.scene)
        study = write_tradeoff(
            scene,
            (context.folder or Path()) / self.out,
            self.quick,
            lambda stage, share: context.progress(_STAGES[stage], share),
            self.boundary_elements,
        )
        first = first_line(described(scene.finger, scene.screen))
        title = (
            f"{first}\nhaptix tradeoff: what to take; all {len(study.runs)} runs and the picture "
            f"in {self.out}; budget {scene.budget_jnd:g} JND"
        )
        return Result(record(study.runs), [(title, [run for run in study.runs if run.take])])
