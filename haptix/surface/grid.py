"""Axes of the friction surface: where a query lies between the nodes."""

from __future__ import annotations

from dataclasses import dataclass
from math import log
from typing import Any

import torch
from torch import Tensor

from haptix.errors import InputError

_SLACK = 1e-6  # relative; a float32 copy of an axis value still counts as on the axis


def numbers(name: str, value: Any, like: Tensor) -> Tensor:
    """Return `value` as a tensor of the precision and device of `like`."""
    try:
        return torch.as_tensor(value, dtype=like.dtype, device=like.device)
    except (TypeError, ValueError, RuntimeError):
        raise InputError(f"{name}: expected numbers, got {value!r}") from None


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
    def spanning(cls, name: str, low: float, high: float, intervals: int) -> Axis:
        """Nodes evenly spaced in the logarithm, or one node where `low` equals `high`."""
        if low == high:
            return cls(name, torch.tensor([low], dtype=torch.float64))
        exponents = torch.linspace(log(low), log(high), intervals + 1, dtype=torch.float64)
        nodes = torch.exp(exponents)
        nodes[0], nodes[-1] = low, high
        return cls(name, nodes)

    @classmethod
    def absent(cls, name: str) -> Axis:
        """Return the axis of a quantity that the model was asked to leave out."""
        return cls(name, torch.tensor([torch.nan], dtype=torch.float64))

    @property
    def is_absent(self) -> bool:
        """Whether the surface was built without this quantity."""
        return bool(self.nodes.isnan().any())

    @property
    def varies(self) -> bool:
        """Whether there is more than one node."""
        return len(self.nodes) > 1

    @property
    def low(self) -> float:
        """First node."""
        return float(self.nodes[0])

    @property
    def high(self) -> float:
        """Last node."""
        return float(self.nodes[-1])

    def locate(self, value: Any) -> tuple[Tensor, Tensor, Tensor]:
        """Cell, position in the cell (0 to 1) and whether the value is on the axis.

        Values beyond the ends are held at the ends; None stands for the value of an axis that does
        not vary.
        """
        nodes = self.nodes
        if value is None:
            if self.varies:
                raise InputError(
                    f"{self.name}: expected a value, since the surface spans "
                    f"{self.low:g} to {self.high:g}"
                )
            zero = torch.zeros((), dtype=nodes.dtype, device=nodes.device)
            return zero.long(), zero, torch.ones_like(zero, dtype=torch.bool)
        x = numbers(self.name, value, nodes)
        if self.is_absent:
            raise InputError(
                f"{self.name}: the surface was built without it; leave it out, or build a surface "
                "that spans it"
            )
        if not bool((x.isfinite() & (x > 0)).all()):
            raise InputError(f"{self.name}: expected finite values above 0")
        inside = (x >= self.low * (1 - _SLACK)) & (x <= self.high * (1 + _SLACK))
        if not self.varies:
            return torch.zeros_like(x, dtype=torch.long), torch.zeros_like(x), inside
        log_nodes = torch.log(nodes)
        log_x = torch.log(x).clamp(log_nodes[0], log_nodes[-1])
        cell = torch.searchsorted(log_nodes[1:-1], log_x.detach().contiguous(), right=True)
        part = (log_x - log_nodes[cell]) / (log_nodes[cell + 1] - log_nodes[cell])
        return cell, part, inside
