"""Answers of a surface: friction, voltages, and the accuracy of the theory in its cells, in JND."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from math import inf
from typing import Any

import torch
from torch import Tensor

from haptix.base.display import Displayed
from haptix.base.errors import InputError, RangeError
from haptix.model.contact import Accuracy
from haptix.model.perception.thresholds import WEBER_FRACTION
from haptix.model.states import broadcast_shape
from haptix.model.status import Status
from haptix.model.surface.axes import AXIS_NAMES, SLACK, Axes, numbers
from haptix.model.surface.interpolant import Interpolant

_DIGITS = 4  # decimals of a JND: far finer than any interval is known
_MOST_CELLS = 8  # along an axis: intervals vary slowly, and the file's header has to hold them


@dataclass(frozen=True)
class SurfaceSample(Displayed):
    """Friction at query points, of their broadcast shape."""

    mu: Tensor
    """Friction coefficient; where the status is not OK, that of the nearest point inside."""
    status: Tensor
    """Integers of `Status`: OK, OUT_OF_RANGE, or the limit of the model that is passed."""


@dataclass(frozen=True)
class Inversion(Displayed):
    """Voltages for frictions, of their broadcast shape."""

    voltage_v: Tensor
    """Amplitude [V] of the friction, or of the nearest one in the reachable range."""
    status: Tensor
    """Integers of `Status`: OK, BELOW or OUT_OF_RANGE; for a friction that is too high, ABOVE (the
    voltage limit) or the limit of the model that prevents it."""


def check_ok(status: Tensor, table: Interpolant, method: str) -> None:
    """Raise `RangeError` unless all points of a query by a method of the surface are OK."""
    bad = status[status != int(Status.OK)]
    if len(bad) == 0:
        return
    counts = ", ".join(
        f"{int((bad == code).sum())} {Status(code).name}" for code in bad.unique().tolist()
    )
    raise RangeError(
        f"{len(bad)} of {status.numel()} points lie outside the surface ({counts}): expected "
        f"{_spans(table)}, voltage_v 0 to {table.voltage_limit_v:g} and short of pull-in; build it "
        f"for a wider range, or take `{method}` without `strict`: it gives a status per point"
    )


def check_inside(status: Tensor, table: Interpolant) -> None:
    """Raise `RangeError` if a place of a query lies outside the axes of the surface."""
    outside = int((status == int(Status.OUT_OF_RANGE)).sum())
    if outside:
        raise RangeError(
            f"{outside} of {status.numel()} places lie outside the surface: expected "
            f"{_spans(table)}; build it for a wider range"
        )


def _spans(table: Interpolant) -> str:
    return ", ".join(
        f"{axis.name} {axis.low:g} to {axis.high:g}" for axis in table.axes if not axis.is_absent
    )


@dataclass(frozen=True)
class Intervals(Displayed):
    """Half-widths of 90 % intervals of the theory, the widest in each cell.

    They are taken where columns end; at lower voltages they are narrower. An axis has eight cells
    at most. Tensors have the broadcast shape of the places. They are infinite outside the surface,
    and where the theory was not compared with boundary elements.
    """

    mu_jnd: Tensor
    """Half-width for mu."""
    contrast_jnd: Tensor
    """Half-width for mu(V)/mu(0), the contrast by which a texture is felt."""
    interpolation_jnd: float
    """Largest error of the interpolation, at the lowest friction of the surface."""


def record_of(axes: Axes, accuracy: Accuracy) -> dict[str, Any]:
    """Intervals as plain values for a surface's file, from the accuracy where all columns end."""
    ends = {
        axis.name: torch.linspace(0, len(axis.nodes) - 1, min(len(axis.nodes), _MOST_CELLS + 1))
        .round()
        .long()
        for axis in axes
    }
    record: dict[str, Any] = {
        axis.name: axis.nodes[ends[axis.name]].tolist() for axis in axes if axis.varies
    }
    for name, width in (("mu_jnd", accuracy.mu), ("contrast_jnd", accuracy.ratio)):
        cells = torch.expm1(width.reshape(axes.shape).cpu()) / WEBER_FRACTION
        for dim, axis in enumerate(axes):
            if axis.varies:  # reduce the columns of a cell to their widest interval
                cells = torch.cat(
                    [
                        cells.narrow(dim, low, high - low + 1).amax(dim, keepdim=True)
                        for low, high in pairwise(ends[axis.name].tolist())
                    ],
                    dim,
                )
        record[name] = [
            round(width_jnd, _DIGITS) if width_jnd < inf else None
            for width_jnd in cells.reshape(-1).tolist()
        ]
    return record


def intervals_at(info: Mapping[str, Any], places: Mapping[str, Any]) -> Intervals:
    """Read the intervals of the cells in which places lie; they are infinite outside.

    Raises `InputError` if a place on one of its axes is missing.
    """
    known, like = info["intervals"], torch.zeros((), dtype=torch.float64)
    values = {name: numbers(name, at, like) for name, at in places.items() if at is not None}
    cell = torch.zeros(broadcast_shape(*values.values()), dtype=torch.long)
    is_inside = torch.ones_like(cell, dtype=torch.bool)
    for name in AXIS_NAMES:
        if name not in known:
            continue
        if name not in values:
            raise InputError(f"{name}: expected a value, since the surface varies with it")
        inner = torch.tensor(known[name][1:-1], dtype=torch.float64)
        at = torch.bucketize(values[name].contiguous(), inner, right=True)
        cell = cell * (len(inner) + 1) + at
        low, high = known[name][0], known[name][-1]
        is_inside &= values[name] >= low * (1 - SLACK)
        is_inside &= values[name] <= high * (1 + SLACK)
    mu, contrast = (
        torch.tensor([inf if jnd is None else jnd for jnd in known[name]], dtype=torch.float64)
        for name in ("mu_jnd", "contrast_jnd")
    )
    error = float(info["error_max"]) / (WEBER_FRACTION * float(info["mu_low"]))
    mu, contrast = (jnd[cell].where(is_inside, inf) for jnd in (mu, contrast))
    return Intervals(mu, contrast, error)
