"""Tables for torch, batched and differentiable, that a contact looks up millions of times.

They hold the waves against their stress, the attraction against pressure, and the separation
integral J(y) of Persson's theory, which is tabulated once per gamma.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from math import log
from typing import Any

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor

from haptix.base.errors import InputError
from haptix.base.native import Struct, doubles, library, room
from haptix.model.contact.area import AreaLaw

# J falls as exp(-y^2). Beyond this y it is below 1e-15 of its values at y ~ 1, and is set to zero:
# a strip at such a pressure has a theoretical gap of some 1e-23 m and is closed.
Y_MAX = 5.6
_Y_MIN = 1e-6
_NODES = 2048
# Expected look-ups of each place. Where they are fewer than a table's values, the coefficients of
# their cells alone are computed.
_LOOK_UPS = 10


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
        """Value at `x` of any shape; the columns, if any, are the last axis."""
        inner = self.nodes.detach()[1:-1]
        cell = torch.searchsorted(inner, x.detach().contiguous(), right=True)
        x = x if self.slope.ndim == 1 else x[..., None]
        return self.intercept[cell] + self.slope[cell] * x


@dataclass(frozen=True)
class UniformCubic:
    """A C1 piecewise cubic through values with known slopes at uniformly spaced nodes."""

    start: float | Tensor
    """Position of the first node, a single number."""
    step: float
    """Distance between nodes."""
    values: Tensor
    slopes: Tensor
    """Node values and derivatives. Each column is a separate function with `parts` components,
    which are the first axis of its values; shape (nodes,)."""
    stencil: Tensor | None = None
    """Matrix from values to slopes. Gradients then pass through the values around a point and not
    through `slopes`, because only few of a table's many numbers are looked up; shape (nodes,
    nodes)."""

    @classmethod
    def through(cls, start: float | Tensor, step: float, values: Tensor) -> UniformCubic:
        """Estimate the slopes by fourth-order differences (second order at the two ends)."""
        count = values.shape[0]
        if count < 5:
            raise ValueError(f"expected at least 5 nodes, got {count}")
        slopes = differences(values.detach()) / step
        if not values.requires_grad:
            return cls(start, step, values, slopes)
        stencil = differences(torch.eye(count, dtype=values.dtype, device=values.device)) / step
        return cls(start, step, values, slopes, stencil)

    def _cell(self, x: Tensor) -> tuple[Tensor, Tensor]:
        position = (x - self.start) / self.step
        cell = position.detach().floor().clamp(0, self.values.shape[0] - 2).long()
        return cell, position - cell

    @cached_property
    def _cubics(self) -> Tensor:
        """Coefficients of 1, t, t^2 and t^3 in each cell, shape (4 * parts, cells * columns)."""
        values = self.values.reshape(len(self.values), self._parts, -1)
        rise, slopes = values.diff(dim=0), self.slopes.reshape(values.shape) * self.step
        cubics = _cubic(values[:-1], rise, slopes[:-1], slopes[1:])
        return torch.stack([cubic.transpose(0, 1) for cubic in cubics]).flatten(2).flatten(0, 1)

    def in_cells(self) -> npt.NDArray[np.float64]:
        """Coefficients of 1, t, t^2 and t^3 of a table of one part, shape (cells * columns, 4)."""
        return np.ascontiguousarray(self._cubics.T)

    @property
    def _parts(self) -> int:
        return self.values.shape[1] if self.values.ndim == 3 else 1

    def _coefficients(self, cell: Tensor, column: Tensor | None) -> Tensor:
        columns = 1 if self.values.ndim == 1 else self.values.shape[-1]
        shape = self.values.shape[1:-1] + cell.shape
        cell, of_column = cell.reshape(-1), 0 if column is None else column.reshape(-1)
        if self.stencil is None or not torch.is_grad_enabled():
            if self._parts == 1 and _LOOK_UPS * len(cell) < self.values.numel():
                place = cell * columns + of_column
                low, high, start, end = (
                    of.reshape(-1).index_select(0, place + more)
                    for of in (self.values, self.slopes)
                    for more in (0, columns)
                )
                cubic = _cubic(low, high - low, start * self.step, end * self.step)
                return torch.stack(cubic).view(4, *shape)
            place = (cell * columns + of_column).expand(len(self._cubics), -1)
            return self._cubics.gather(1, place).view(4, *shape)
        # The stencils of a cell's two ends lie within six nodes, which are gathered at once.
        count = self.values.shape[0]
        values = self.values.reshape(count, self._parts, -1).transpose(0, 1).flatten(1)
        first = (cell - 2).clamp(0, max(count - 6, 0))
        near = first + torch.arange(min(count, 6), device=cell.device)[:, None]
        around = values.index_select(1, (near * columns + of_column).reshape(-1))
        around = around.view(-1, *near.shape)
        at = torch.arange(len(cell), device=cell.device)
        low, high = (around[:, cell - first + k, at] for k in (0, 1))
        slope = [(self.stencil[cell + k, near] * around).sum(1) * self.step for k in (0, 1)]
        return torch.stack(_cubic(low, high - low, *slope)).view(4, *shape)

    def cubic(self, x: Tensor, column: Tensor | None = None) -> tuple[Tensor, Tensor]:
        """Coefficients of 1, t, t^2 and t^3 in the cell of each `x`, and t: x in steps."""
        cell, t = self._cell(x)
        return self._coefficients(cell, column), t

    def __call__(self, x: Tensor, column: Tensor | None = None) -> Tensor:
        """Value at `x` of any shape; `column`, of the same shape, selects each point's function."""
        cubics, t = self.cubic(x, column)
        return polynomial(cubics.unbind(), t)

    def with_slope(self, x: Tensor, column: Tensor | None = None) -> tuple[Tensor, Tensor]:
        """Value and derivative at `x`; outside the nodes those of the first or last cubic."""
        cubics, t = self.cubic(x, column)
        value, slope = polynomial_with_slope(cubics.unbind(), t)
        return value, slope / self.step


def polynomial(coefficients: Sequence[Tensor], x: Tensor) -> Tensor:
    """Value at x of a polynomial with coefficients of 1, x, x^2, ..."""
    value = coefficients[-1]
    for coefficient in reversed(coefficients[:-1]):
        value = torch.addcmul(coefficient, value, x)
    return value


def polynomial_with_slope(coefficients: Sequence[Tensor], x: Tensor) -> tuple[Tensor, Tensor]:
    """Value and derivative at x of a polynomial with coefficients of 1, x, x^2, ..."""
    *lower, value = coefficients
    if not lower:
        return value, torch.zeros_like(value)
    slope, value = value, torch.addcmul(lower.pop(), value, x)
    for coefficient in reversed(lower):
        slope = torch.addcmul(value, slope, x)
        value = torch.addcmul(coefficient, value, x)
    return value, slope


def _cubic(low: Tensor, rise: Tensor, slope: Tensor, next_slope: Tensor) -> tuple[Tensor, ...]:
    """Coefficients of 1, t, t^2 and t^3 of a cell's cubic; slopes are per cell."""
    a, b = slope - rise, rise - next_slope
    return low, slope, b - 2 * a, a - b


def differences(values: Tensor) -> Tensor:
    """Rise per step at each node."""
    near, far = values[3:-1] - values[1:-3], values[4:] - values[:-4]
    inner = torch.add(far, near, alpha=-8) / -12
    second = (values[2] - values[0]) / 2
    second_last = (values[-1] - values[-3]) / 2
    first = -1.5 * values[0] + 2 * values[1] - 0.5 * values[2]
    last = 1.5 * values[-1] - 2 * values[-2] + 0.5 * values[-3]
    ends = [end[None] for end in (first, second, second_last, last)]
    return torch.cat([*ends[:2], inner, *ends[2:]])


class SeparationIntegral:
    """``J(y) = int_y^inf dx/x [gamma + n (1 - gamma) erf(t)^(n-1)] exp(-t^2) dt/dx``.

    Source: Yang & Persson, J. Phys.: Condens. Matter 20, 215214 (2008); physics page, section 2.
    The elastic energy depends on the area A as ``gamma A + (1 - gamma) A^n``. Persson has n = 3 and
    the area erf(x), so that t = x; another law of the area gives another t(x).

    Parameters
    ----------
    gamma : float
        Share of the elastic energy that is proportional to the area, in (0, 1]; about 0.45.
    device : str
        Device of the table.
    area : AreaLaw
        Gives t at x.
    power : float
        n, above 1.
    """

    def __init__(
        self,
        gamma: float,
        device: torch.device | str = "cpu",
        area: AreaLaw | None = None,
        power: float = 3.0,
    ) -> None:
        self._area = area or AreaLaw()
        if not 0 < gamma <= 1:
            raise InputError(f"gamma: expected a number in (0, 1], got {gamma:g}")
        if not power > 1:
            raise InputError(f"power: expected a number above 1, got {power:g}")
        self.gamma, self.power = gamma, power
        self._growth = gamma * self._area.light
        log_y = torch.linspace(log(_Y_MIN), log(Y_MAX), _NODES, dtype=torch.float64)
        # Six-point Gauss in every cell, summed from the far end so that small J keep their digits;
        # the tail from Y_MAX on is summed the same way on an extension of the grid.
        step = float(log_y[1] - log_y[0])
        beyond = log_y[-1] + step * torch.arange(1, 400, dtype=torch.float64)
        edges = torch.cat([log_y, beyond])
        points, weights = (torch.from_numpy(a) for a in np.polynomial.legendre.leggauss(6))
        at = torch.exp(edges[:-1, None] + step * (points + 1) / 2)
        cells = (self._integrand(at) * weights).sum(-1) * step / 2
        total = cells.flip(0).cumsum(0).flip(0)[:_NODES]
        slope = -self._integrand(torch.exp(log_y)) / total
        self._log_j = UniformCubic(log(_Y_MIN), step, torch.log(total).to(device), slope.to(device))

    def _integrand(self, x: Tensor) -> Tensor:
        t = self._area.argument(x)
        rest = self.power * (1 - self.gamma)
        energy = self.gamma + rest * torch.erf(t) ** (self.power - 1)
        return energy * torch.exp(-t * t) * self._area.growth(x)

    def __call__(self, y: Tensor) -> Tensor:
        """J(y) for y > 0 of any shape; exactly zero beyond `Y_MAX`."""
        log_y = torch.log(y)
        inside = torch.exp(self._log_j(log_y.clamp(log(_Y_MIN), log(Y_MAX))))
        # For small y the bracket is gamma, and J grows as gamma ln(1/y) dt/dy.
        small = self._growth * torch.clamp(log(_Y_MIN) - log_y, min=0.0)
        return torch.where(y < Y_MAX, inside + small, torch.zeros_like(y))

    def in_c(self) -> dict[str, Any]:
        """Return its fields of `hx_waves` of the library in C."""
        return {
            "j_nodes": _NODES,
            "cubics": self._log_j.in_cells(),
            "start": log(_Y_MIN),
            "end": log(Y_MAX),
            "per_step": 1 / self._log_j.step,
            "growth": self._growth,
            "least": 1 / Y_MAX,
        }


@dataclass(frozen=True)
class WavesIntegral:
    """``2 int J(p/tau) dtau/(q E*)`` over waves: the inner loop of every solve of a contact."""

    separation: SeparationIntegral
    """J."""
    waves: PiecewiseLinear
    """ln T and ``ln(dT/dw / (2 q E*))`` against ``w = ln(q/q0 - 1)``."""
    panels: Sequence[tuple[float, Tensor]]
    """Ends of the panels in w, with the points and weights of each, shape (points, 2)."""

    def __call__(self, pressure: Tensor, variance: Tensor, low: Tensor) -> Tensor:
        """Return the integral over the waves from w = `low` on.

        Parameters
        ----------
        pressure, variance, low : Tensor
            Pressure [Pa], the T up to which tau is 0, and the w at which to start; they broadcast.
        """
        shape = np.broadcast_shapes(pressure.shape, variance.shape, low.shape)
        pressure, variance, low = (
            one.expand(shape).reshape(-1) for one in (pressure, variance, low)
        )
        recorded = (pressure, variance, low, self.waves.intercept, self.waves.slope)
        if not any(part.requires_grad or part.is_cuda for part in recorded):
            found, place = room(len(low))
            numbers = (doubles(one.numpy()) for one in (pressure, variance, low))
            library.hx_over_waves(self._in_c.at, len(low), *numbers, place)
            return torch.from_numpy(found).reshape(shape)
        total = torch.zeros_like(low)
        # Looping over panels and points, and not over the batch, keeps every array within the CPU's
        # cache.
        for end, rule in self.panels:
            # The others start behind this panel.
            at = (low.detach() < end).nonzero()[:, 0]
            start, load, below = low[at], pressure[at], variance[at]
            # Rounding must not take tau below its value at the start of the integral.
            least = 0.5 * (load / Y_MAX) ** 2
            part = torch.zeros_like(start)
            for point, weight in rule:
                wave = self.waves(start + (end - start) * ((1 + point) / 2))
                tau = torch.maximum(torch.exp(wave[..., 0]) - below, least).sqrt()
                opening = (end - start) * torch.exp(wave[..., 1]) / tau
                part = part + weight * opening * self.separation(load / tau)
            total = total.index_add(0, at, part)
            low = low.clamp(min=end)
        return total.reshape(shape)

    @cached_property
    def _in_c(self) -> Struct:
        nodes = self.waves.nodes.numpy()
        cells, span = len(nodes) - 1, float(nodes[-1] - nodes[0])
        even = nodes[0] + span / cells * np.arange(cells)
        hints = np.searchsorted(nodes[1:-1], even, side="right").astype(np.int32)
        lines = torch.stack([self.waves.intercept, self.waves.slope], -1).reshape(cells, 4)
        return Struct(
            "hx_waves",
            cells=cells,
            nodes=nodes,
            lines=lines.numpy(),
            hints=np.maximum(hints - 1, 0),  # one earlier, for rounding
            per_hint=cells / span,
            panels=len(self.panels),
            ends=np.array([end for end, _ in self.panels]),
            points=np.array([len(rule) for _, rule in self.panels], dtype=np.int32),
            rules=torch.cat([rule for _, rule in self.panels]).numpy(),
            **self.separation.in_c(),
        )
