"""Build a friction surface: refine the axes until held-out solver points agree."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cache
from math import isfinite
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from haptix.errors import InputError, LimitError
from haptix.friction import ContactModel
from haptix.status import Status
from haptix.surface.grid import Axis
from haptix.surface.surface import FrictionSurface
from haptix.version import __version__

PULL_IN_MARGIN = 0.9
"""Columns end at this share of the pull-in voltage: by ``1/(1 - (V/Vc)^2)`` friction is five times
that without voltage there, and doubles within the next 5 %."""

_AXES = ("normal_force_n", "frequency_hz", "h0_m", "voltage_v")
_FIRST_INTERVALS = {"normal_force_n": 4, "frequency_hz": 4, "h0_m": 4, "drive": 8}
_MOST_VALUES = 4_000_000  # 32 MB
_HELD_OUT = 4096  # points of an error estimate: the 99th percentile rests on 40 of them
_SEED = 20181127  # any; fixed, so that the same inputs give the same bytes


def read_ranges(model: ContactModel, scene: Mapping[str, Any]) -> dict[str, Any]:
    """Fill in what is missing and check the rest: ``(low, high)`` per axis, None where absent."""
    unknown = set(scene) - set(_AXES)
    if unknown:
        raise InputError(
            f"unknown range {', '.join(sorted(unknown))}: expected some of {', '.join(_AXES)}"
        )
    ranges = {
        "normal_force_n": (0.1, 1.0),
        "voltage_v": (0.0, model.screen.max_voltage_v),
        "frequency_hz": None,
        "h0_m": model.screen.h0_m,
        **scene,
    }
    checked = {name: _read_range(name, value) for name, value in ranges.items()}
    if checked["normal_force_n"] is None or checked["voltage_v"] is None:
        raise InputError("normal_force_n and voltage_v: expected a range, got None")
    if checked["h0_m"] is None:
        checked["h0_m"] = (model.screen.h0_m, model.screen.h0_m)
    if checked["voltage_v"][1] > model.screen.max_voltage_v:
        raise LimitError(
            f"voltage_v: {checked['voltage_v'][1]:g} V is above the limit of "
            f"{model.screen.max_voltage_v:g} V of screen {model.screen.name!r}; lower the range"
        )
    if checked["voltage_v"][1] <= 0:
        raise InputError("voltage_v: expected a range that reaches above 0 V")
    checked["voltage_v"] = (0.0, checked["voltage_v"][1])  # a column always starts without voltage
    return checked


def _read_range(name: str, value: Any) -> tuple[float, float] | None:
    if value is None:
        return None
    try:
        low, high = (float(v) for v in (value if isinstance(value, tuple | list) else (value,) * 2))
    except (TypeError, ValueError):
        raise InputError(f"{name}: expected (low, high) or one value, got {value!r}") from None
    least = 0.0 if name == "voltage_v" else 1e-300
    if not (isfinite(low) and isfinite(high) and least <= low <= high):
        raise InputError(
            f"{name}: expected finite low <= high, {'0 or more' if least == 0 else 'above 0'}, "
            f"got ({low:g}, {high:g})"
        )
    return low, high


def surface_key(model: ContactModel, scene: Mapping[str, Any], tolerance: float) -> str:
    """Hash of everything that decides a surface's numbers; the name of its cache entry."""
    identity = {
        "haptix": __version__,
        "code": _code_digest(),
        "model": model.describe(),
        "ranges": read_ranges(model, scene),
        "tolerance": tolerance,
    }
    return hashlib.sha256(json.dumps(identity, sort_keys=True).encode()).hexdigest()


@cache
def _code_digest() -> str:
    """Hash of the sources that make a surface's numbers: a mended solver finds no stale surface."""
    digest = hashlib.sha256()
    package = Path(__file__).parent.parent
    rooms = [package / room for room in ("contact", "electro", "fidelity", "surface")]
    for file in sorted([*package.glob("*.py"), *(f for room in rooms for f in room.glob("*.py"))]):
        digest.update(file.read_bytes())
    return digest.hexdigest()


def build_surface(
    model: ContactModel,
    scene: Mapping[str, Any],
    tolerance: float,
    on_progress: Callable[[float], None] | None,
) -> FrictionSurface:
    """See `FrictionSurface.build`."""
    if not (isfinite(tolerance) and tolerance > 0):
        raise InputError(f"tolerance: expected an error in mu above 0, got {tolerance:g}")
    if "breakdown" in model.terms:
        raise InputError(
            'terms: a surface cannot report "breakdown"; build it without that term, and ask '
            "ContactModel.solve where the field matters"
        )
    ranges = read_ranges(model, scene)
    intervals = dict(_FIRST_INTERVALS)
    while True:
        surface = _tabulate(model, ranges, intervals)
        errors = _midpoint_errors(model, surface)
        total = sum(errors.values())
        if on_progress is not None:
            on_progress(0.9 * min(1.0, tolerance / max(total, 1e-300)))
        if total <= tolerance:
            largest, p99 = _held_out_error(model, surface)
            if largest <= tolerance:
                break
        # Halving an interval quarters the error of linear interpolation: refine what is too coarse.
        coarse = [name for name, error in errors.items() if error > tolerance / len(errors)]
        coarse = coarse or [max(errors, key=lambda name: errors[name])]
        if surface.mu_table.numel() * 2 ** len(coarse) > _MOST_VALUES:
            raise InputError(
                f"tolerance {tolerance:g} cannot be met with {_MOST_VALUES} grid values: reached "
                f"{total:.2g}; ask for less, or for a narrower range of {', '.join(coarse)}"
            )
        for name in coarse:
            intervals[name] *= 2
    if on_progress is not None:
        on_progress(1.0)
    info = {
        "haptix": __version__,
        "key": surface_key(model, scene, tolerance),
        "model": model.describe(),
        "ranges": ranges,
        "screen_h0_m": model.screen.h0_m,
        "tolerance": tolerance,
        "error_max": largest,
        "error_p99": p99,
        "held_out_points": _HELD_OUT,
    }
    return replace(surface, info=info)


def _tabulate(
    model: ContactModel, ranges: Mapping[str, Any], intervals: Mapping[str, int]
) -> FrictionSurface:
    axes = (
        _axis("normal_force_n", ranges, intervals),
        _axis("frequency_hz", ranges, intervals),
        _axis("h0_m", ranges, intervals),
    )
    drive = torch.linspace(0, 1, intervals["drive"] + 1, dtype=torch.float64)
    force, frequency, h0 = torch.meshgrid(*(axis.nodes for axis in axes), indexing="ij")
    frequency_or_none = None if axes[1].is_absent else frequency
    limit = ranges["voltage_v"][1]
    pull_in = model.solve(force, 0.0, frequency_or_none, h0).pull_in_voltage_v
    end = torch.clamp(PULL_IN_MARGIN * pull_in.to("cpu", torch.float64), max=limit)
    voltage = end[..., None] * drive.sqrt()
    state = model.solve(
        force[..., None],
        voltage,
        None if frequency_or_none is None else frequency[..., None],
        h0[..., None],
    )
    # The solver rises with voltage already; this makes it true of the last bit as well.
    mu = state.mu.to("cpu", torch.float64).cummax(-1).values
    return FrictionSurface(axes, drive, mu, end, limit)


def _axis(name: str, ranges: Mapping[str, Any], intervals: Mapping[str, int]) -> Axis:
    if ranges[name] is None:
        return Axis.absent(name)
    low, high = ranges[name]
    return Axis.spanning(name, low, high, intervals[name])


def _midpoint_errors(model: ContactModel, surface: FrictionSurface) -> dict[str, float]:
    """Largest error half-way between nodes, one axis at a time.

    Where linear interpolation errs by its curvature, the sum bounds the error of all together; the
    held-out points then measure it.
    """
    errors = {}
    for name in [*(axis.name for axis in surface.axes if axis.varies), "drive"]:
        generator = torch.Generator().manual_seed(_SEED)
        coordinates = {}
        for axis in surface.axes:
            nodes = torch.log(axis.nodes)
            pick = torch.randint(len(nodes), (_HELD_OUT,), generator=generator)
            if axis.name == name:
                nodes = (nodes[1:] + nodes[:-1]) / 2
                pick = pick.clamp(max=len(nodes) - 1)
            coordinates[axis.name] = torch.exp(nodes[pick])
        drive = surface.drive
        pick = torch.randint(1, len(drive), (_HELD_OUT,), generator=generator)
        at = (drive[pick] + drive[pick - 1]) / 2 if name == "drive" else drive[pick]
        errors[name] = float(_error_at(model, surface, coordinates, at).max())
    return errors


def _held_out_error(model: ContactModel, surface: FrictionSurface) -> tuple[float, float]:
    """Largest and 99th-percentile error at points anywhere between the nodes."""
    generator = torch.Generator().manual_seed(_SEED + 1)
    coordinates = {}
    for axis in surface.axes:
        share = torch.rand(_HELD_OUT, generator=generator, dtype=torch.float64)
        low, high = torch.log(axis.nodes[0]), torch.log(axis.nodes[-1])
        coordinates[axis.name] = torch.exp(low + share * (high - low)).clamp(axis.low, axis.high)
    drive = torch.rand(_HELD_OUT, generator=generator, dtype=torch.float64)
    error = _error_at(model, surface, coordinates, drive)
    return float(error.max()), float(error.quantile(0.99))


def _error_at(
    model: ContactModel, surface: FrictionSurface, at: Mapping[str, Tensor], drive: Tensor
) -> Tensor:
    force, h0 = at["normal_force_n"], at["h0_m"]
    frequency = None if surface.frequency_hz.is_absent else at["frequency_hz"]
    # The drive is a share of the interpolated end of the column, as it is in a query.
    voltage = surface.highest_voltage(force, frequency, h0) * drive.sqrt()
    state = model.solve(force, voltage, frequency, h0)
    solved = state.mu.to("cpu", torch.float64)
    error = (surface.evaluate(force, voltage, frequency, h0).mu - solved).abs()
    return error[state.status.cpu() != int(Status.PULL_IN)]
