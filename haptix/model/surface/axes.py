"""Axes of the friction surface: names, ranges, nodes, and interpolation between the nodes."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import inf, log
from typing import TYPE_CHECKING, Any, Self

import numpy as np
import torch
from torch import Tensor

from haptix.base.display import Displayed
from haptix.base.errors import InputError, LimitError, RangeError
from haptix.base.native import Struct
from haptix.model.screen import Screen
from haptix.model.states import plain_array

if TYPE_CHECKING:
    from haptix.model.friction import ContactModel

_MOST_PLACES = 4096

_COMPLEX = (torch.complex64, torch.complex128, np.complex64, np.complex128)
PULL_IN_SHARE = 0.9
"""Share of the pull-in voltage at which a surface ends. Friction there is some five times that
without voltage, and it doubles within the next 5 % of voltage."""

PULL_IN_DRIVE = PULL_IN_SHARE**2
"""``(V / V_pull-in)^2`` at which a surface ends."""

SLACK = 1e-6  # relative; a node rounded to float32 is still on the axis


@dataclass(frozen=True)
class Cells:
    """Find the cell between increasing nodes in which a value lies, without a branch.

    A table, `guide`, has the cell of each place of an even grid that is finer than the nodes. The
    nodes that a build chooses lie on such a grid, so that one look-up suffices. For other nodes a
    fixed number of steps then corrects the cell. Bisection takes several times as long, because the
    processor cannot predict its branches for random values.
    """

    start: float
    """The first node."""
    per_width: float
    """Even places per unit."""
    guide: Tensor
    """Cell of each even place; shape (places,)."""
    upper: Tensor
    """Upper node of each cell, infinite in the last; shape (cells,)."""
    scale: Tensor
    offset: Tensor
    """``scale x + offset`` runs from 0 to 1 in the cell; shape (cells,)."""
    steps: int
    """Largest number of nodes between two even places."""

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
        if aligned:  # take the middles of the places, so that rounding cannot move a node across
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
            # Rounding may put a value into the next cell only at the node, where both cells agree.
            0 if aligned else int(guide.diff().max()),
        )

    def find(self, x: Tensor) -> tuple[Tensor, Tensor]:
        """Return the cell and the position in it, 0 to 1; values beyond an end count as the end."""
        place = ((x.detach() - self.start) * self.per_width).clamp_(0, len(self.guide) - 1)
        cell = self.guide.index_select(0, place.int())
        for _ in range(self.steps):
            cell += x.detach() >= self.upper.index_select(0, cell)
        part = torch.addcmul(self.offset.index_select(0, cell), x, self.scale.index_select(0, cell))
        return cell, part.clamp(0.0, 1.0)

    @property
    def compiled(self) -> Struct:
        """The same for the library in C.

        The arrays are its own: to send a tensor to another process, torch moves its memory.
        """
        return Struct(
            "hx_cells",
            start=self.start,
            per_width=self.per_width,
            places=len(self.guide),
            cells=len(self.scale),
            steps=self.steps,
            guide=self.guide.numpy().copy(),
            upper=self.upper.numpy().copy(),
            scale=self.scale.numpy().copy(),
            offset=self.offset.numpy().copy(),
        )


def _aligned_places(nodes: Tensor, rounding: float) -> int:
    """Number of places of the even grid on which all nodes lie; 0 if there is no such grid."""
    share = (nodes - nodes[0]) / (nodes[-1] - nodes[0])
    parts = 96  # steps between the points from which a build chooses; it doubles them if needed
    while parts < _MOST_PLACES:
        if float((share * parts - (share * parts).round()).abs().max()) < rounding:
            return parts + 1
        parts *= 2
    return 0


@dataclass(frozen=True)
class Quantity:
    """Quantity of an axis."""

    name: str
    """Name in queries, files and tables, with the unit."""
    unit: str
    text: str
    """SI unit, and a description for readers."""
    default: Callable[[Screen], Any]
    """Range, value or None (left out) for a `Screen`, if a surface's ranges do not name it."""
    is_collapsible: bool = True
    """Whether planning may replace the range by a single value."""


AXES = (
    Quantity("normal_force_n", "N", "normal force", lambda _: (0.1, 1.0), is_collapsible=False),
    Quantity("frequency_hz", "Hz", "drive frequency", lambda _: None),
    Quantity("h0_m", "m", "effective thickness d1/eps1 of the insulator", lambda s: s.h0_m),
)
"""Axes of every surface besides the voltage, in the order of its table."""

AXIS_NAMES = tuple(quantity.name for quantity in AXES)
_RANGES = (*AXIS_NAMES, "voltage_v")

Ranges = Mapping[str, tuple[float, float] | None]


def read_ranges(model: ContactModel, scene: Any) -> dict[str, tuple[float, float] | None]:
    """Complete and check ranges: ``(low, high)`` by name, None for an axis that is left out.

    `scene` is a mapping, or an object with ``ranges()``; the model gives the defaults.
    """
    if not isinstance(scene, Mapping) and not hasattr(scene, "ranges"):
        raise InputError(f"scene: expected a scene or ranges by name, got {scene!r}")
    named = scene if isinstance(scene, Mapping) else scene.ranges()
    unknown = set(named) - set(_RANGES)
    if unknown:
        raise InputError(
            f"unknown range {', '.join(sorted(unknown))}: expected any of {', '.join(_RANGES)}"
        )
    screen = model.screen
    ranges: dict[str, Any] = {"voltage_v": (0.0, screen.max_voltage_v), **named}
    for axis in AXES:
        if axis.name not in ranges or (axis.is_collapsible and ranges[axis.name] is None):
            ranges[axis.name] = axis.default(screen)
    checked = {name: _read_range(name, ranges[name]) for name in _RANGES}
    force, voltage = checked["normal_force_n"], checked["voltage_v"]
    if force is None or voltage is None:
        raise InputError("normal_force_n and voltage_v: expected a range, got None")
    if voltage[1] > screen.max_voltage_v:
        raise LimitError(
            f"voltage_v: {voltage[1]:g} V is above the limit of "
            f"{screen.max_voltage_v:g} V of screen {screen.name!r}; lower the range"
        )
    if voltage[1] <= 0:
        raise InputError("voltage_v: expected a range that reaches above 0 V")
    return checked


def _read_range(name: str, value: Any) -> tuple[float, float] | None:
    zero = name == "voltage_v"
    try:
        return None if value is None else low_and_high(value, zero)
    except ValueError:
        raise InputError(
            f"{name}: expected (low, high) or one value, with finite low <= high, "
            f"{'0 or more' if zero else 'above 0'}, got {value!r}"
        ) from None


def low_and_high(value: Any, zero: bool = False) -> tuple[float, float]:
    """Return a finite range above 0, or with `zero` from 0; a single number is both ends.

    Other values raise `ValueError`, which pydantic turns into its error.
    """
    if hasattr(value, "tolist"):
        value = value.tolist()
    ends = value if isinstance(value, tuple | list) else (value, value)
    try:
        if any(isinstance(end, str | bool) for end in ends):
            raise TypeError
        low, high = map(float, ends)
    except (TypeError, ValueError):
        raise ValueError("expected one number, or [low, high]") from None
    if not ((low >= 0 if zero else low > 0) and low <= high < inf):
        raise ValueError(f"expected finite 0 {'<=' if zero else '<'} low <= high")
    return low, high


def between(low: float, high: float, share: Tensor) -> Tensor:
    """Values at shares (0 to 1) of a range, linear in the logarithm."""
    return torch.exp(log(low) + share * (log(high) - log(low))).clamp(low, high)


def numbers(name: str, value: Any, like: Tensor) -> Tensor:
    """Return `value` as a tensor of the precision and device of `like`."""
    value = plain_array(value)
    try:
        if isinstance(value, Tensor | np.ndarray) and value.dtype in _COMPLEX:
            raise TypeError
        return torch.as_tensor(value, dtype=like.dtype, device=like.device)
    except (TypeError, ValueError, RuntimeError, OverflowError):
        raise InputError(f"{name}: expected real numbers, got {value!r}") from None


def within(x: Tensor, least: float, least_counts: bool = True) -> bool:
    """Whether all values are finite and above `least`, or with `least_counts` at least that."""
    if x.numel() == 0:
        return True
    low, high = (float(end) for end in torch.aminmax(x.detach()))
    return (low >= least if least_counts else low > least) and high < inf


@dataclass(frozen=True)
class Axis(Displayed):
    """One axis, linear in the logarithm of its quantity."""

    name: str
    """Quantity with its unit, such as ``"normal_force_n"``."""
    nodes: Tensor
    """Increasing positive values. An axis with a single node does not vary. A single NaN means that
    the surface was built without the quantity; shape (nodes,)."""

    @classmethod
    def absent(cls, name: str) -> Axis:
        """Return the axis of a quantity that the model leaves out."""
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
    def cells(self) -> Cells:
        """Cells between the nodes' logarithms."""
        return Cells.between(torch.log(self.nodes))

    def read(self, value: Any) -> Tensor | None:
        """Check the values of a query; None means the value of an axis that does not vary."""
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
        """Cell and position in the cell (0 to 1); values beyond an end count as the end."""
        return self.cells.find(torch.log(x))

    def locate_one(self, value: Any) -> tuple[int, float]:
        """`locate` for one number on the axis; `InputError` or `RangeError` for anything else."""
        x = numbers(self.name, value, self.nodes)
        if x.numel() != 1:
            raise InputError(f"{self.name}: expected one number to slice at, got {value!r}")
        if self.is_absent:
            raise RangeError(f"{self.name}: the surface was built without it")
        if not self.contains(x):
            raise RangeError(
                f"{self.name}: {float(x):g} is outside the surface's {self.low:g} to {self.high:g}"
            )
        if not self.varies:
            return 0, 0.0
        cell, part = self.locate(x.reshape(1))
        return int(cell), float(part)


@dataclass(frozen=True)
class Corners:
    """The columns around each point that `Axes.blend` interpolates between."""

    row: Tensor
    """Row of the first column in the flat table: the one at the lower end of the cell on all axes;
    shape (points,)."""
    parts: tuple[Tensor, ...]
    """Position in the cell (0 to 1) along each axis that varies; shape (points,)."""
    offsets: tuple[int, ...]
    """Rows of all columns around the point, relative to the first; the last axis varies fastest."""

    def whole(self, columns: Tensor) -> Tensor:
        """Blend all numbers of each column, shape (points, entries)."""
        table = columns.reshape(-1, columns.shape[-1])
        if not self.parts:
            return table.expand(len(self.row), -1).contiguous()
        weight = torch.ones_like(self.parts[0])[:, None]
        for part in self.parts:
            high = weight * part[:, None]
            weight = torch.stack([weight - high, high], -1).flatten(1)
        rows = self.row[:, None] + self.row.new_tensor(self.offsets)
        first = torch.arange(0, rows.numel(), rows.shape[1], device=rows.device)
        column: Tensor = torch.nn.functional.embedding_bag(
            rows.reshape(-1), table, first, per_sample_weights=weight.reshape(-1), mode="sum"
        )
        return column

    def blend(self, columns: Tensor, first: Tensor, entry: int) -> Tensor:
        """Blend one number of each column, at `first` + `entry` in its flat table."""
        flat, width = columns.reshape(-1), columns.shape[-1]
        # Each corner has a view of the table that begins at it, so that all use the same indices.
        starts = [entry + offset * width for offset in self.offsets]
        corners = [flat.narrow(0, at, len(flat) - at).index_select(0, first) for at in starts]
        for part in reversed(self.parts):
            corners = [
                torch.lerp(low, high, part)
                for low, high in zip(corners[::2], corners[1::2], strict=True)
            ]
        return corners[0]


@dataclass(frozen=True)
class Axes(Displayed):
    """The axes of one surface, in the order of `AXES`."""

    each: tuple[Axis, ...]
    """One for each quantity of `AXES`."""

    @classmethod
    def of(cls, nodes: Mapping[str, Tensor]) -> Self:
        """Put nodes by name into order; other names are left out."""
        return cls(tuple(Axis(name, nodes[name]) for name in AXIS_NAMES))

    def __iter__(self) -> Iterator[Axis]:
        return iter(self.each)

    def __getitem__(self, name: str) -> Axis:
        return self.each[AXIS_NAMES.index(name)]

    @property
    def shape(self) -> tuple[int, ...]:
        """Nodes of each axis."""
        return tuple(len(axis.nodes) for axis in self.each)

    def to(self, dtype: torch.dtype, device: torch.device | str) -> Axes:
        """Return a copy in another precision or on another device."""
        return Axes(tuple(Axis(axis.name, axis.nodes.to(device, dtype)) for axis in self.each))

    def read(self, query: Mapping[str, Any]) -> list[Tensor | None]:
        """Check the values of a query by name, see `Axis.read`."""
        return [axis.read(query.get(axis.name)) for axis in self.each]

    def at(self, values: Mapping[str, Any], columns: Tensor) -> tuple[Axes, Tensor]:
        """Slice a table, shape (*shape, entries), at values by name; None leaves an axis."""
        axes = list(self.each)
        for dim, axis in enumerate(self.each):
            value = values.get(axis.name)
            if value is None:
                continue
            cell, part = axis.locate_one(value)
            if axis.varies:
                low, high = columns.narrow(dim, cell, 1), columns.narrow(dim, cell + 1, 1)
                columns = torch.lerp(low, high, part)
            axes[dim] = Axis(axis.name, axis.nodes.new_tensor([float(value)]))
        return Axes(tuple(axes)), columns

    def corners(self, places: Sequence[Tensor | None], like: Tensor) -> tuple[Corners, Tensor]:
        """Columns around each point, and whether it is on all axes; see `blend`."""
        inside: Tensor | None = None
        row: Tensor | None = None
        parts: list[Tensor] = []
        offsets = [0]
        for axis, place in zip(self.each, places, strict=True):
            if place is None:
                continue
            on_axis = axis.contains(place)
            inside = on_axis if inside is None else inside.logical_and_(on_axis)
            if not axis.varies:
                continue
            cell, part = axis.locate(place)
            row = cell if row is None else row.mul_(len(axis.nodes)).add_(cell)
            parts.append(part)
            offsets = [offset * len(axis.nodes) + end for offset in offsets for end in (0, 1)]
        if inside is None:
            inside = torch.ones_like(like, dtype=torch.bool)
        if row is None:
            row = torch.zeros_like(like, dtype=torch.long)
        return Corners(row, tuple(parts), tuple(offsets)), inside

    def blend(
        self, places: Sequence[Tensor | None], columns: Tensor, like: Tensor
    ) -> tuple[Tensor, Tensor]:
        """Blend the columns around each point, linear in the logarithm of each quantity.

        Parameters
        ----------
        places : sequence of Tensor or None
            Values along each axis, shape (points,), as `read` returns them.
        columns : Tensor, shape (*shape, entries)
            Table over the axes.
        like : Tensor, shape (points,)
            Gives the number of points, in case all places are None.

        Returns
        -------
        column : Tensor, shape (points, entries)
            The blended column; beyond an end of an axis, the column at the end.
        is_inside : Tensor of bool, shape (points,)
            Whether the point is on all axes.
        """
        corners, inside = self.corners(places, like)
        return corners.whole(columns), inside
