"""Size of a surface before it is built, estimated from the curvature along each axis."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from math import ceil, sqrt

import torch

from haptix.perception import WEBER_FRACTION
from haptix.planning.choices import Choice
from haptix.planning.effects import SampledPlaces, Trials
from haptix.surface.axes import AXIS_NAMES, between

_BASES = 12  # states from which each axis is followed
_INTERVALS = 4  # of the trial grid; its error is measured at their middles
_SEED = 20180517
_PEAKS_APART = 1.8  # as in a build: the errors of the axes peak at different places


def estimated_nodes(trials: Trials, choice: Choice, tolerance_jnd: float) -> Mapping[str, int]:
    """Nodes that each axis and the voltage need, by name.

    ``1/mu`` is interpolated linearly, so that its error falls with the square of the number of
    intervals. Each axis takes an equal share of the tolerance. An axis that does not vary has one
    node. The nodes are evenly spaced; a build places them and needs fewer.
    """
    ranges = trials.scene.ranges()
    held = dict(choice.held)
    varying = [n for n in AXIS_NAMES if n not in held and ranges[n][0] < ranges[n][1]]
    allowed = _PEAKS_APART * tolerance_jnd / (len(varying) + 1)
    nodes = dict.fromkeys(AXIS_NAMES, 1)
    for name in (*varying, "voltage_v"):
        error = _bend(trials, choice, name)
        nodes[name] = 1 + max(1, ceil(_INTERVALS * sqrt(error / allowed)))
    return nodes


def _bend(trials: Trials, choice: Choice, name: str) -> float:
    """Largest error [JND] of linear 1/mu on the trial grid along one axis."""
    bases = SampledPlaces.of(trials.scene, _BASES, _SEED)
    count = len(bases.voltage_share)
    steps = torch.linspace(0, 1, 2 * _INTERVALS + 1, dtype=torch.float64)
    rows = torch.arange(count).repeat_interleave(len(steps))
    points = bases.at(rows)
    if name == "voltage_v":
        points = replace(points, voltage_share=steps.sqrt().repeat(count))
    else:
        along = between(*trials.scene.ranges()[name], steps)
        points = replace(points, places={**points.places, name: along.repeat(count)})
    voltage = points.voltage_share * trials.highest_voltage(choice, points)
    inverse = 1 / trials.friction(choice, points, voltage).reshape(count, -1)
    chord = (inverse[:, :-2:2] + inverse[:, 2::2]) / 2
    relative = (inverse[:, 1::2] / chord - 1).abs()
    return float(relative.max()) / WEBER_FRACTION
