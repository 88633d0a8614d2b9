"""Surfaces from few boundary elements: the mean-field surface, corrected by their results.

A surface needs thousands of states, and boundary elements take seconds for one. So they are solved
at a few places only. There we take the ratio of their friction to the mean field's with the same
waves, and multiply the mean-field surface by it. Between the places the logarithm of the ratio is
interpolated, linearly in the logarithms of the axes and in the squared voltage.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from itertools import product
from math import sqrt
from typing import Any, Literal, get_args

import numpy as np
import torch
from torch import Tensor

from haptix.base.checks import choice, whole
from haptix.base.errors import InputError
from haptix.base.files import digest
from haptix.model.contact.boundary_elements.ensemble import Row, run_ensemble
from haptix.model.fidelity import Ability, BoundaryElementBalance
from haptix.model.friction import ContactModel
from haptix.model.status import Status
from haptix.model.surface.axes import AXIS_NAMES, Axes, Axis, read_ranges
from haptix.model.surface.build import Progress, build_table
from haptix.model.surface.file import surface_key
from haptix.model.surface.interpolant import Interpolant
from haptix.model.surface.tolerance import Tolerance

Band = Literal["finger", "box"]
_DRIVES_BETWEEN = 4  # nodes for each solved voltage: every column bends at other drives


@dataclass(frozen=True)
class MeasuredPoints:
    """Where boundary elements are solved.

    Parameters
    ----------
    forces, drives : int
        Forces, and squared voltages from 0 to where the surface ends, at each place.
    axis_values : int
        Values along frequency and along h0, where these vary.
    band : {"finger", "box"}
        Waves of the surface: all waves of the finger, with the ratio found in the box; or only the
        waves of the box, so that the surface interpolates the boundary elements themselves.
    """

    forces: int = 3
    drives: int = 3
    axis_values: int = 2
    band: Band = "finger"

    def __post_init__(self) -> None:
        for name, least in (("forces", 1), ("drives", 2), ("axis_values", 1)):
            whole(name, getattr(self, name), least)
        choice("band", self.band, get_args(Band))


@dataclass(frozen=True)
class MeasuringJob:
    """The states that a surface needs, before they are solved.

    Parameters
    ----------
    model : ContactModel
        Model of fidelity "boundary-element".
    scene : Scene or mapping
        As for `FrictionSurface.build`.
    points : MeasuredPoints
        Where the model is solved.
    past_limits : bool
        As for `FrictionSurface.build`.
    """

    model: ContactModel
    scene: Any
    points: MeasuredPoints = MeasuredPoints()
    past_limits: bool = False

    def __post_init__(self) -> None:
        self.model.require(Ability.SCATTER, "model")

    @property
    def nodes(self) -> tuple[list[float | None], ...]:
        """Values along force, frequency and h0."""
        ranges = read_ranges(self.model, self.scene)
        counts = {"normal_force_n": self.points.forces}
        return tuple(
            _nodes(ranges[name], counts.get(name, self.points.axis_values)) for name in AXIS_NAMES
        )

    @property
    def places(self) -> list[tuple[float | None, ...]]:
        """Force, frequency and h0 of every column."""
        return list(product(*self.nodes))

    @property
    def states(self) -> int:
        """Number of states."""
        return len(self.places) * self.points.drives

    def estimated_seconds(self) -> float:
        """Rough time of the boundary elements, from the time of a transform on this machine."""
        solver = self.model.solver.fidelity
        assert isinstance(solver, BoundaryElementBalance)
        return self.states * solver.seconds_per_state()

    def mean_field(self, band: Band) -> ContactModel:
        """Return the mean field of the finger's own waves, or of those in the box."""
        model, boxed = self.model, self.model.boxed
        assert boxed is not None
        finger = model.finger
        return ContactModel(
            finger if band == "finger" else finger.replace(roughness=boxed.roughness),
            model.screen,
            dtype=model.dtype,
            device=model.contact.device,
            gap_distribution=model.contact.gap_distribution,
            gamma=model.contact.gamma,
            terms=model.terms,
        )


def measured_table(
    job: MeasuringJob,
    tolerance: Tolerance,
    on_progress: Progress | None,
    largest_bytes: int,
    notes: Mapping[str, Any] | None,
    checkpoint: str | os.PathLike[str] | None = None,
) -> tuple[Interpolant, dict[str, Any]]:
    """Solve a table and describe it; see `FrictionSurface.measured`."""
    report = on_progress or (lambda share: None)
    prior, info = build_table(
        job.mean_field(job.points.band),
        job.scene,
        tolerance,
        lambda share: report(0.1 * share),
        largest_bytes,
        notes,
        job.past_limits,
    )
    measured = _measure(job, prior, checkpoint, lambda share: report(0.1 + 0.9 * share))
    return _corrected(job, prior, info, measured, surface_key(job.model, job.scene, tolerance))


def _nodes(span: tuple[float, float] | None, count: int) -> list[float | None]:
    if span is None:
        return [None]
    low, high = span
    if low == high:
        return [low]
    return [sqrt(low * high)] if count == 1 else np.geomspace(low, high, count).tolist()


def _measure(
    job: MeasuringJob,
    prior: Interpolant,
    checkpoint: str | os.PathLike[str] | None,
    report: Progress,
) -> Row:
    """Solve every column; rows of shape (places, drives) and (places, drives, surfaces)."""
    model, box_field = job.model, job.mean_field("box")
    share = torch.linspace(0, 1, job.points.drives, dtype=torch.float64)

    def column(number: int) -> Row:
        place = dict(zip(AXIS_NAMES, job.places[number], strict=True))
        # Rounding must not exceed the screen's limit.
        end = prior.end(place).to("cpu", torch.float64)
        voltage = (end * share.sqrt()).clamp(max=model.screen.max_voltage_v)
        exact, mean = (m.solve(voltage_v=voltage, **place) for m in (model, box_field))
        scatter = model.scatter(voltage_v=voltage, **place)
        area = scatter.area_fraction
        return {
            "voltage_v": voltage,
            "mu": exact.mu.to("cpu", torch.float64),
            "mean_field_mu": mean.mu.to("cpu", torch.float64),
            "relative_scatter": (area.std(-1, correction=0) / area.mean(-1)).cpu(),
            "is_stable": (exact.status != int(Status.PULL_IN)).cpu()
            & (mean.status != int(Status.PULL_IN)).cpu(),
            "converged_share": scatter.converged.to(torch.float64).mean(-1).cpu(),
        }

    name = json.dumps([surface_key(model, job.scene, 1.0), asdict(job.points)])
    rows = run_ensemble(
        len(job.places),
        column,
        name,
        checkpoint=checkpoint,
        progress=lambda done, all_: report(done / all_),
    )
    return {key: torch.stack([row[key] for row in rows]) for key in rows[0]}


def _corrected(
    job: MeasuringJob, prior: Interpolant, info: dict[str, Any], measured: Row, key: str
) -> tuple[Interpolant, dict[str, Any]]:
    log_ratio = torch.log(measured["mu"] / measured["mean_field_mu"])
    # Past pull-in both models give the friction at the end of light contact, so their ratio means
    # nothing there: keep the last ratio before it.
    for level in range(1, log_ratio.shape[1]):
        stable = measured["is_stable"][:, level]
        log_ratio[:, level] = torch.where(stable, log_ratio[:, level], log_ratio[:, level - 1])
    if not bool(log_ratio.isfinite().all()):
        raise InputError(
            "boundary_elements: expected contact at every place, got a surface that has none; take "
            "more points, or larger forces"
        )
    table = _refined(prior, job)
    shape = tuple(len(nodes) for nodes in job.nodes)
    ratio, ends = log_ratio.reshape(*shape, -1), measured["voltage_v"][:, -1].square()
    grid, ends = (_on_axes(values, job, table) for values in (ratio, ends.reshape(*shape, 1)))
    pull_in = table.pull_in_voltage_v.to("cpu", torch.float64)
    drive = table.drive.to("cpu", torch.float64) * pull_in[..., None].square() / ends
    at = (drive.clamp(max=1.0) * (grid.shape[-1] - 1)).contiguous()
    cell = at.long().clamp(max=grid.shape[-1] - 2)
    correction = torch.lerp(grid.gather(-1, cell), grid.gather(-1, cell + 1), at - cell)
    columns = table.columns.clone()
    inverse = columns[..., : len(table.drive)] * torch.exp(-correction).to(columns)
    rising = inverse.cummax(-1).values
    columns[..., : len(table.drive)] = rising
    described = {
        **info,
        "key": key,
        "model": job.model.describe(),
        "model_hash": digest(job.model.describe()),
        "boundary_elements": {
            **asdict(job.points),
            "theory": job.model.theory,
            "places": [dict(zip(AXIS_NAMES, place, strict=True)) for place in job.places],
            "ratio": log_ratio.exp().tolist(),
            **{name: values.tolist() for name, values in measured.items()},
        },
        "mu_low": float((-1 / rising).min()),
        "mu_high": float((-1 / rising).max()),
        "monotone_corrections": info["monotone_corrections"] + int((rising != inverse).sum()),
    }
    return replace(table, columns=columns), described


def _refined(table: Interpolant, job: MeasuringJob) -> Interpolant:
    """Return the interpolant with the nodes of the correction added to its nodes."""
    columns, axes = table.columns.to("cpu", torch.float64), list(table.axes.each)
    for dim, (axis, known) in enumerate(zip(table.axes, job.nodes, strict=True)):
        if not axis.varies:
            continue
        inner = [value for value in known if value is not None and axis.low < value < axis.high]
        nodes = axis.nodes.to("cpu", torch.float64)
        both = torch.cat([nodes, nodes.new_tensor(inner)]).unique()
        columns = _along(columns, dim, nodes.log(), both.log())
        axes[dim] = Axis(axis.name, both)
    drive = table.drive.to("cpu", torch.float64)
    even = torch.linspace(0, float(drive[-1]), _DRIVES_BETWEEN * job.points.drives).to(drive)
    finer = torch.cat([drive, even]).unique()
    inverse = _along(columns[..., : len(drive)], columns.ndim - 1, drive, finer)
    return replace(
        table,
        axes=Axes(tuple(axes)),
        drive=finer,
        columns=torch.cat([inverse, columns[..., len(drive) :]], -1),
    )


def _on_axes(grid: Tensor, job: MeasuringJob, table: Interpolant) -> Tensor:
    """Interpolate values at the solved places onto all axes of the table."""
    for dim, (known, axis) in enumerate(zip(job.nodes, table.axes, strict=True)):
        wanted = axis.nodes.to("cpu", torch.float64)
        if len(known) == 1:
            grid = grid.repeat_interleave(len(wanted), dim)
        else:
            grid = _along(grid, dim, wanted.new_tensor(known).log(), wanted.log())
    return grid


def _along(grid: Tensor, dim: int, nodes: Tensor, x: Tensor) -> Tensor:
    """Interpolate one dimension linearly between two nodes or more; constant beyond the ends."""
    x = x.clamp(nodes[0], nodes[-1])
    cell = torch.searchsorted(nodes[1:-1].contiguous(), x, right=True)
    part = (x - nodes[cell]) / (nodes[cell + 1] - nodes[cell])
    part = part.reshape([-1 if d == dim else 1 for d in range(grid.ndim)])
    return torch.lerp(grid.index_select(dim, cell), grid.index_select(dim, cell + 1), part)
