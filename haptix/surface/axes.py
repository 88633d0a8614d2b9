"""Axes of the friction surface: where a query lies between the nodes."""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import dataclass
from functools import cached_property
from math import inf, log
from typing import Any

import numpy as np
import torch
from torch import Tensor

from haptix.errors import InputError, RangeError

_COMPLEX = (torch.complex64, torch.complex128, np.complex64, np.complex128)
_MOST_PLACES = 4096
SLACK = 1e-6  # relative; a float32 copy of an axis value still counts as on the axis


def numbers(name: str, value: Any, like: Tensor) -> Tensor:
    """Return `value` as a tensor of the precision and device of `like`."""
    try:
        if isinstance(value, np.ndarray):
            value = np.ascontiguousarray(value)  # torch takes no negative strides
        if isinstance(value, Tensor | np.ndarray) and value.dtype in _COMPLEX:
            raise TypeError
        return torch.as_tensor(value, dtype=like.dtype, device=like.device)
    except (TypeError, ValueError, RuntimeError):
        raise InputError(f"{name}: expected real numbers, got {value!r}") from None


def within(x: Tensor, least: float, least_counts: bool = True) -> bool:
    """Whether all values are finite and above `least`, in one pass; NaN is not."""
    if x.numel() == 0:
        return True
    low, high = (float(end) for end in torch.aminmax(x.detach()))
    return (low >= least if least_counts else low > least) and high < inf


@dataclass(frozen=True)
class Cells:
    """Finds the cell between increasing nodes in which a value lies, without a branch.

    An even grid finer than the nodes knows the cell at its own places; what little a value lies
    beyond them is mended in a fixed number of steps. Bisection, whose every branch a random value
    leaves unpredictable, takes several times as long.

    Parameters
    ----------
    start : float
        The first node.
    per_width : float
        Even places per unit.
    guide : Tensor of int, shape (places,)
        Cell of each even place.
    upper : Tensor, shape (cells,)
        Upper node of each cell, infinite in the last.
    scale, offset : Tensor, shape (cells,)
        ``scale x + offset`` runs from 0 to 1 in the cell.
    steps : int
        Most nodes between two even places.
    """

    start: float
    per_width: float
    guide: Tensor
    upper: Tensor
    scale: Tensor
    offset: Tensor
    steps: int

    @classmethod
    def between(cls, nodes: Tensor) -> Cells:
        """Prepare for nodes, shape (2 or more,)."""
        low, high = float(nodes[0]), float(nodes[-1])
        # Nodes may coincide in single precision: a cell of no width is never entered.
        width = nodes.diff().clamp(min=(high - low) * 1e-7)
        narrowest = float(width.min())
        places = min(_MOST_PLACES, max(16, int((high - low) / narrowest) + 2))
        at = torch.linspace(low, high, places, dtype=nodes.dtype, device=nodes.device)
        guide = torch.bucketize(at, nodes[1:-1].contiguous(), right=True)
        scale = 1 / width
        return cls(
            low,
            (places - 1) / (high - low),
            guide,
            torch.cat([nodes[1:-1], nodes.new_tensor([torch.inf])]),
            scale,
            -nodes[:-1] * scale,
            # A value that rounding takes across a node is at the node: nothing jumps there.
            int(guide.diff().max()),
        )

    def find(self, x: Tensor) -> tuple[Tensor, Tensor]:
        """Cell, and position in it from 0 to 1; values beyond the ends are held there."""
        place = ((x.detach() - self.start) * self.per_width).long()
        cell = self.guide.index_select(0, place.clamp_(0, len(self.guide) - 1))
        for _ in range(self.steps):
            cell += x.detach() >= self.upper.index_select(0, cell)
        part = torch.addcmul(self.offset.index_select(0, cell), x, self.scale.index_select(0, cell))
        return cell, part.clamp(0.0, 1.0)


@dataclass(frozen=True)
class Axis:
    """One axis, linear in the logarithm of its quantity.

    Parameters
    ----------
    name : str
        Quantity with its unit, such as ``"normal_force_n"``.
    nodes : Tensor, shape (nodes,)
        Increasing positive values; a single node is an axis that does not vary, and a single NaN
        is a quantity that the surface was built without.
    """

    name: str
    nodes: Tensor

    @classmethod
    def absent(cls, name: str) -> Axis:
        """Return the axis of a quantity that the model was asked to leave out."""
        return cls(name, torch.tensor([torch.nan], dtype=torch.float64))

    @cached_property
    def is_absent(self) -> bool:
        """Whether the surface was built without this quantity."""
        return bool(self.nodes.isnan().any())

    @property
    def varies(self) -> bool:
        """Whether there is more than one node."""
        return len(self.nodes) > 1

    @cached_property
    def low(self) -> float:
        """First node."""
        return float(self.nodes[0])

    @cached_property
    def high(self) -> float:
        """Last node."""
        return float(self.nodes[-1])

    @cached_property
    def _cells(self) -> Cells:
        return Cells.between(torch.log(self.nodes))

    @cached_property
    def _plain_log_nodes(self) -> list[float]:
        return [log(node) for node in self.nodes.tolist()]

    def read(self, value: Any) -> Tensor | None:
        """Check a query's values; None stands for the value of an axis that does not vary."""
        if value is None:
            if self.varies:
                raise InputError(
                    f"{self.name}: expected a value, since the surface spans "
                    f"{self.low:g} to {self.high:g}"
                )
            return None
        x = numbers(self.name, value, self.nodes)
        if self.is_absent:
            raise InputError(
                f"{self.name}: the surface was built without it; leave it out, or build a surface "
                "that spans it"
            )
        if not within(x, 0.0, least_counts=False):
            raise InputError(f"{self.name}: expected finite values above 0")
        return x

    def contains(self, x: Tensor) -> Tensor:
        """Whether values lie between the first and the last node."""
        above = x >= self.low * (1 - SLACK)
        return above.logical_and_(x <= self.high * (1 + SLACK))

    def locate(self, x: Tensor) -> tuple[Tensor, Tensor]:
        """Cell and position in the cell (0 to 1); values beyond the ends are held there."""
        return self._cells.find(torch.log(x))

    def locate_one(self, value: float) -> tuple[int, float]:
        """`locate` for one number, without the cost of tensors.

        Raises
        ------
        RangeError
            If the value is not on the axis.
        """
        if not self.low * (1 - SLACK) <= value <= self.high * (1 + SLACK):
            raise RangeError(
                f"{self.name}: {value:g} is outside the surface's {self.low:g} to {self.high:g}"
            )
        nodes = self._plain_log_nodes
        x = min(max(log(value), nodes[0]), nodes[-1])
        cell = min(max(bisect_right(nodes, x) - 1, 0), len(nodes) - 2)
        return cell, (x - nodes[cell]) / (nodes[cell + 1] - nodes[cell])
