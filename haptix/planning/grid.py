"""How large the surface of a choice will be, estimated from how friction bends along each axis."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from math import ceil, log, prod, sqrt

import torch
from torch import Tensor

from haptix.perception import WEBER_FRACTION
from haptix.planning.choices import Choice
from haptix.planning.effects import SampledPlaces, Trials
from haptix.surface.axes import AXIS_NAMES

_BASES = 12  # states from which each axis is followed
_INTERVALS = 4  # of the trial grid, whose middles say how wrong it is
_SEED = 20180517
_PEAKS_APART = 1.8  # the axes' errors do not all peak at one place: so a build shares, too

Nodes = Mapping[str, int]


def estimated_nodes(trials: Trials, choice: Choice, tolerance_thresholds: float) -> Nodes:
    """Nodes that each axis and the voltage need, by name.

    ``1/mu`` is interpolated linearly, so that its error falls with the square of the number of
    intervals; each axis may take an equal share of the tolerance. An axis that does not vary has
    one node. Evenly spaced ones are counted, of which a build, which places them, needs fewer.
    """
    ranges = trials.scene.ranges()
    held = {name for name, _ in choice.held}
    varying = [
        name for name in AXIS_NAMES if name not in held and ranges[name][0] < ranges[name][1]
    ]
    allowed = _PEAKS_APART * tolerance_thresholds / (len(varying) + 1)
    nodes = dict.fromkeys(AXIS_NAMES, 1)
    for name in varying:
        nodes[name] = _needed(_bend(trials, choice, name), allowed)
    nodes["voltage_v"] = _needed(_bend(trials, choice, "voltage_v"), allowed)
    return nodes


def values(nodes: Nodes) -> int:
    """Numbers in a table with these nodes."""
    return prod(nodes.values())


def _needed(error: float, allowed: float) -> int:
    return 1 + max(1, ceil(_INTERVALS * sqrt(error / allowed)))


def _bend(trials: Trials, choice: Choice, name: str) -> float:
    """Largest error of the trial grid along one axis, in just-noticeable differences."""
    bases = SampledPlaces.of(trials.scene, _BASES, _SEED)
    count = len(bases.voltage_share)
    steps = torch.linspace(0, 1, 2 * _INTERVALS + 1, dtype=torch.float64)
    rows = torch.arange(count).repeat_interleave(len(steps))
    points = bases.at(rows)
    if name == "voltage_v":
        points = replace(points, voltage_share=steps.sqrt().repeat(count))
    else:
        low, high = trials.scene.ranges()[name]
        along = torch.exp(log(low) + steps * log(high / low)).clamp(low, high)
        points = replace(points, places={**points.places, name: along.repeat(count)})
    voltage = points.voltage_share * trials.highest_voltage(choice, points)
    return _error_between(trials.friction(choice, points, voltage).reshape(count, -1))


def _error_between(mu: Tensor) -> float:
    inverse = 1 / mu
    between = (inverse[:, :-2:2] + inverse[:, 2::2]) / 2
    relative = (inverse[:, 1::2] / between - 1).abs()
    return float(relative.max()) / WEBER_FRACTION
