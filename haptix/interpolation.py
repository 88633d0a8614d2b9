"""One-dimensional tables for torch, batched and differentiable: linear and cubic.

The contact model looks up the same smooth tables (the waves against their stress, the separation
integral, the attraction against pressure) millions of times.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import torch
from torch import Tensor


@dataclass(frozen=True)
class PiecewiseLinear:
    """A line per cell between increasing nodes; the end cells' lines go on beyond the nodes."""

    nodes: Tensor
    intercept: Tensor
    slope: Tensor

    @classmethod
    def through(cls, nodes: Tensor, values: Tensor) -> PiecewiseLinear:
        """Connect `values`, shape (nodes,) or (nodes, columns), at increasing `nodes`."""
        at = nodes if values.ndim == 1 else nodes[:, None]
        slope = values.diff(dim=0) / at.diff(dim=0)
        return cls(nodes, values[:-1] - slope * at[:-1], slope)

    def __call__(self, x: Tensor) -> Tensor:
        """Value at `x` of any shape; with columns they are the last axis."""
        inner = self.nodes.detach()[1:-1]
        cell = torch.searchsorted(inner, x.detach().contiguous(), right=True)
        x = x if self.slope.ndim == 1 else x[..., None]
        return self.intercept[cell] + self.slope[cell] * x


@dataclass(frozen=True)
class MonotoneCubic:
    """A C1 cubic that rises and falls only where its values do, and holds its ends beyond them.

    Source of the slopes: Fritsch & Butland, SIAM J. Sci. Stat. Comput. 5, 300 (1984); 0 at the
    ends, so that nothing has a corner there either.
    """

    nodes: Tensor
    values: Tensor
    slopes: Tensor

    @classmethod
    def through(cls, nodes: Tensor, values: Tensor) -> MonotoneCubic:
        """Connect `values`, shape (nodes, columns), at increasing `nodes`."""
        width = nodes.diff()[:, None]
        rise = values.diff(dim=0) / width
        before, after = width[:-1] + 2 * width[1:], 2 * width[:-1] + width[1:]
        turns = rise[:-1] * rise[1:] <= 0
        one, two = (r.masked_fill(turns, 1.0) for r in (rise[:-1], rise[1:]))
        inner = ((before + after) / (after / one + before / two)).masked_fill(turns, 0.0)
        end = torch.zeros_like(values[:1])
        return cls(nodes, values, torch.cat([end, inner, end])[: len(nodes)])

    def __call__(self, x: Tensor) -> Tensor:
        """Values at `x` of any shape, with the columns as the last axis."""
        if len(self.nodes) == 1:
            return self.values[0].expand(*x.shape, -1)
        x = x.clamp(self.nodes[0], self.nodes[-1])
        cell = torch.searchsorted(self.nodes[1:-1], x.detach().contiguous(), right=True)
        width = self.nodes.diff()[cell][..., None]
        t = (x[..., None] - self.nodes[cell][..., None]) / width
        low, high = self.values[cell], self.values[cell + 1]
        rise = high - low
        a, b = self.slopes[cell] * width - rise, rise - self.slopes[cell + 1] * width
        return low + t * (rise + (1 - t) * (a * (1 - t) + b * t))


@dataclass(frozen=True)
class UniformCubic:
    """A C1 piecewise cubic through values with known slopes at uniformly spaced nodes.

    Parameters
    ----------
    start : float or Tensor
        Position of the first node, a single number.
    step : float
        Distance between nodes.
    values, slopes : Tensor, shape (nodes,) or (nodes, columns)
        Node values and derivatives; each column is a function of its own.
    stencil : Tensor, shape (nodes, nodes), optional
        Matrix from values to slopes. Gradients then pass through the values around a point and not
        through `slopes`: a table has far more numbers than are looked up.
    """

    start: float | Tensor
    step: float
    values: Tensor
    slopes: Tensor
    stencil: Tensor | None = None

    @classmethod
    def through(cls, start: float | Tensor, step: float, values: Tensor) -> UniformCubic:
        """Estimate the slopes by fourth-order differences (second order at the two ends)."""
        count = values.shape[0]
        if count < 5:
            raise ValueError(f"expected at least 5 nodes, got {count}")
        slopes = _differences(values.detach()) / step
        if not values.requires_grad:
            return cls(start, step, values, slopes)
        stencil = _differences(torch.eye(count, dtype=values.dtype, device=values.device)) / step
        return cls(start, step, values, slopes, stencil)

    def _cell(self, x: Tensor) -> tuple[Tensor, Tensor]:
        position = (x - self.start) / self.step
        cell = position.detach().floor().clamp(0, self.values.shape[0] - 2).long()
        return cell, position - cell

    @cached_property
    def _cubics(self) -> Tensor:
        """Coefficients of 1, t, t^2 and t^3 in each cell, shape (4, cells * columns)."""
        values = self.values if self.values.ndim == 2 else self.values[:, None]
        rise, slopes = values.diff(dim=0), self.slopes.reshape(values.shape) * self.step
        return torch.stack(_cubic(values[:-1], rise, slopes[:-1], slopes[1:])).flatten(1)

    def _coefficients(self, cell: Tensor, column: Tensor | None) -> tuple[Tensor, ...]:
        columns = 1 if self.values.ndim == 1 else self.values.shape[1]
        shape, cell = cell.shape, cell.reshape(-1)
        of_column = 0 if column is None else column.reshape(-1)
        if self.stencil is None or not torch.is_grad_enabled():
            found = self._cubics.index_select(1, cell * columns + of_column)
            return found.view(4, *shape).unbind()
        # Both stencils lie within six nodes, which are gathered at once.
        count, values = self.values.shape[0], self.values.reshape(-1)
        first = (cell - 2).clamp(0, max(count - 6, 0))
        near = first + torch.arange(min(count, 6), device=cell.device)[:, None]
        around = values.index_select(0, (near * columns + of_column).reshape(-1)).view(near.shape)
        low, high = (around.gather(0, (cell - first + k)[None])[0] for k in (0, 1))
        slope = [(self.stencil[cell + k, near] * around).sum(0) * self.step for k in (0, 1)]
        return tuple(part.reshape(shape) for part in _cubic(low, high - low, *slope))

    def __call__(self, x: Tensor, column: Tensor | None = None) -> Tensor:
        """Value at `x` (any shape; `column` of the same shape picks each point's function)."""
        cell, t = self._cell(x)
        one, t1, t2, t3 = self._coefficients(cell, column)
        return one + t * (t1 + t * (t2 + t * t3))

    def with_slope(self, x: Tensor, column: Tensor | None = None) -> tuple[Tensor, Tensor]:
        """Value and derivative at `x`; outside the nodes the end cubic goes on."""
        cell, t = self._cell(x)
        one, t1, t2, t3 = self._coefficients(cell, column)
        bend = t * t3
        value = one + t * (t1 + t * (t2 + bend))
        return value, (t1 + t * (2 * t2 + 3 * bend)) / self.step


def _cubic(low: Tensor, rise: Tensor, slope: Tensor, next_slope: Tensor) -> tuple[Tensor, ...]:
    """Coefficients of 1, t, t^2 and t^3 of a cell's cubic; slopes are per cell."""
    a, b = slope - rise, rise - next_slope
    return low, slope, b - 2 * a, a - b


def _differences(values: Tensor) -> Tensor:
    """Rise per step at each node."""
    inner = (values[:-4] - 8 * values[1:-3] + 8 * values[3:-1] - values[4:]) / 12
    second = (values[2] - values[0]) / 2
    second_last = (values[-1] - values[-3]) / 2
    first = -1.5 * values[0] + 2 * values[1] - 0.5 * values[2]
    last = 1.5 * values[-1] - 2 * values[-2] + 0.5 * values[-3]
    ends = [end[None] for end in (first, second, second_last, last)]
    return torch.cat([*ends[:2], inner, *ends[2:]])
