"""Search for the cell between nodes, for many values at once."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from haptix.native import Struct

_MOST_PLACES = 4096


@dataclass(frozen=True)
class Cells:
    """Find the cell between increasing nodes in which a value lies, without a branch.

    An even grid, finer than the nodes, holds the cell of each of its places. Nodes that a build has
    placed lie on such a grid. For others a fixed number of steps corrects a value between two
    places. Bisection takes several times as long, since the processor cannot predict its branches
    for random values.

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
        Largest number of nodes between two even places.
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
        rounding = max(1e-6, 1e3 * torch.finfo(nodes.dtype).eps)  # of the distance between places
        aligned = _aligned_places(nodes.double(), rounding)
        # Nodes may coincide in single precision: a cell of no width is never entered.
        width = nodes.diff().clamp(min=(high - low) * 1e-7)
        narrowest = float(width.min())
        places = aligned or min(_MOST_PLACES, max(16, int((high - low) / narrowest) + 2))
        at = torch.linspace(low, high, places, dtype=nodes.dtype, device=nodes.device)
        if aligned:  # the middles of the places: no rounding puts a node beyond its own
            at = at + (high - low) / (2 * (places - 1))
        guide = torch.bucketize(at, nodes[1:-1].contiguous(), right=True, out_int32=True)
        scale = 1 / width
        return cls(
            low,
            (places - 1) / (high - low),
            guide,
            torch.cat([nodes[1:-1], nodes.new_tensor([torch.inf])]),
            scale,
            -nodes[:-1] * scale,
            # A value that rounding takes across a node is at the node: nothing jumps there.
            0 if aligned else int(guide.diff().max()),
        )

    def find(self, x: Tensor) -> tuple[Tensor, Tensor]:
        """Return cell, and position in it from 0 to 1; values beyond the ends are held there."""
        place = ((x.detach() - self.start) * self.per_width).clamp_(0, len(self.guide) - 1)
        cell = self.guide.index_select(0, place.int())
        for _ in range(self.steps):
            cell += x.detach() >= self.upper.index_select(0, cell)
        part = torch.addcmul(self.offset.index_select(0, cell), x, self.scale.index_select(0, cell))
        return cell, part.clamp(0.0, 1.0)

    @property
    def compiled(self) -> Struct:
        """The same for the library in C."""
        return Struct(
            "hx_cells",
            start=self.start,
            per_width=self.per_width,
            places=len(self.guide),
            cells=len(self.scale),
            steps=self.steps,
            guide=self.guide.numpy(),
            upper=self.upper.numpy(),
            scale=self.scale.numpy(),
            offset=self.offset.numpy(),
        )


def _aligned_places(nodes: Tensor, rounding: float) -> int:
    """Number of even places, the last node's included, among which are all nodes; 0 for none."""
    share = (nodes - nodes[0]) / (nodes[-1] - nodes[0])
    parts = 96  # of the points from which a build chooses, or a doubling of it
    while parts < _MOST_PLACES:
        if float((share * parts - (share * parts).round()).abs().max()) < rounding:
            return parts + 1
        parts *= 2
    return 0
