"""The friction surface: evaluated and inverted in batches, by interpolation alone."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from math import inf
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from haptix.errors import InputError, RangeError
from haptix.friction import ContactModel
from haptix.status import Status
from haptix.surface.grid import Axis, numbers

Corner = tuple[Tensor, Tensor]


@dataclass(frozen=True)
class SurfaceSample:
    """Friction at query points, of their broadcast shape."""

    mu: Tensor
    """Friction coefficient; where the status is not OK, that of the nearest point inside."""
    status: Tensor
    """Integers of `Status`: OK, PULL_IN or OUT_OF_RANGE."""


@dataclass(frozen=True)
class Inversion:
    """Voltages for wanted frictions, of their broadcast shape."""

    voltage_v: Tensor
    """Amplitude [V] that gives the wanted friction, or the nearest one that can be given."""
    status: Tensor
    """Integers of `Status`: OK, BELOW, ABOVE, PULL_IN (limited by pull-in) or OUT_OF_RANGE."""


@dataclass(frozen=True)
class FrictionSurface:
    """mu(F_N, V0, f, h0) on a grid, multilinear between its nodes.

    Each column runs from 0 V to its own end, the lower of the voltage limit and a margin below
    pull-in, on nodes of ``(V0 / end)^2``: there friction is nearly linear, and no node lies where
    there is no contact. Columns rise with voltage, and so does every blend of them, which makes
    the inverse unique and exact on the interpolant.

    Parameters
    ----------
    axes : (Axis, Axis, Axis)
        Normal force, frequency and h0, in the order of the table; one that does not vary has a
        single node.
    drive : Tensor, shape (drives,)
        Nodes of ``(V0 / end)^2``, from 0 to 1.
    mu_table : Tensor, shape (forces, frequencies, thicknesses, drives)
        Friction coefficient, not falling along the last axis.
    voltage_end_v : Tensor, shape (forces, frequencies, thicknesses)
        Highest amplitude of each column [V].
    voltage_limit_v : float
        Highest amplitude asked for; a column that ends below it is limited by pull-in.
    info : dict
        What the surface was built from and how accurate it is; plain values.
    """

    axes: tuple[Axis, Axis, Axis]
    drive: Tensor
    mu_table: Tensor
    voltage_end_v: Tensor
    voltage_limit_v: float
    info: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        shape = tuple(len(axis.nodes) for axis in self.axes)
        drive, mu, end = self.drive, self.mu_table, self.voltage_end_v
        sound = {
            "axes increase": all(
                axis.is_absent or bool((axis.nodes.diff() > 0).all()) for axis in self.axes
            ),
            "drive runs from 0 to 1": len(drive) >= 2
            and float(drive[0]) == 0
            and float(drive[-1]) == 1
            and bool((drive.diff() > 0).all()),
            "the tables have the shape of the axes": tuple(end.shape) == shape
            and tuple(mu.shape) == (*shape, len(drive)),
            "mu is finite and does not fall": bool(mu.isfinite().all())
            and bool((mu.diff(dim=-1) >= 0).all()),
            "the voltage limit is finite and above 0": 0 < self.voltage_limit_v < inf,
            "columns end above 0 V and within the limit": bool(
                ((end > 0) & (end <= self.voltage_limit_v * (1 + 1e-6))).all()
            ),
        }
        wrong = [rule for rule, holds in sound.items() if not holds]
        if wrong:
            raise InputError(f"a friction surface must keep that {'; '.join(wrong)}")

    @classmethod
    def build(
        cls,
        model: ContactModel,
        scene: Mapping[str, Any] | None = None,
        tolerance: float = 2e-3,
        on_progress: Callable[[float], None] | None = None,
    ) -> FrictionSurface:
        """Solve the model on a grid that is refined until held-out points agree.

        Parameters
        ----------
        model : ContactModel
            The model to tabulate.
        scene : mapping, optional
            Ranges ``(low, high)`` or single values for ``normal_force_n`` (0.1 to 1 N),
            ``voltage_v`` (0 V to the screen's limit), ``frequency_hz`` (none) and ``h0_m`` (the
            screen's own); in brackets what a missing one means.
        tolerance : float
            Largest error in mu against the model at held-out points.
        on_progress : callable, optional
            Called with the share of the work that is done.

        Raises
        ------
        InputError
            If a range is not one, or the tolerance cannot be met on a grid of reasonable size.
        """
        from haptix.surface.build import build_surface  # which makes what this class holds

        return build_surface(model, scene or {}, tolerance, on_progress)

    def save(self, path: str | Path) -> None:
        """Write the surface to one file, whole or not at all."""
        from haptix.surface.file import save_surface

        save_surface(self, Path(path))

    @classmethod
    def load(cls, path: str | Path) -> FrictionSurface:
        """Read a surface; nothing in the file is ever executed.

        Raises
        ------
        FileFormatError
            If the file is missing, foreign, damaged or of a later version.
        """
        from haptix.surface.file import load_surface

        return load_surface(Path(path))

    @property
    def normal_force_n(self) -> Axis:
        """Axis of normal force [N]."""
        return self.axes[0]

    @property
    def frequency_hz(self) -> Axis:
        """Axis of drive frequency [Hz]."""
        return self.axes[1]

    @property
    def h0_m(self) -> Axis:
        """Axis of the screen's effective insulator thickness [m]."""
        return self.axes[2]

    def mu(
        self, normal_force_n: Any, voltage_v: Any, frequency_hz: Any = None, h0_m: Any = None
    ) -> Tensor:
        """Friction coefficient at points that broadcast together.

        Raises
        ------
        RangeError
            If a point lies outside the surface or past pull-in; `evaluate` returns a status
            instead.
        """
        sample = self.evaluate(normal_force_n, voltage_v, frequency_hz, h0_m)
        bad = sample.status != int(Status.OK)
        if bool(bad.any()):
            spans = ", ".join(
                f"{axis.name} {axis.low:g} to {axis.high:g}"
                for axis in self.axes
                if not axis.is_absent
            )
            past = int((sample.status == int(Status.PULL_IN)).sum())
            raise RangeError(
                f"{int(bad.sum())} of {bad.numel()} points lie outside the surface ({past} of them "
                f"past pull-in): expected {spans}, voltage_v 0 to {self.voltage_limit_v:g}; "
                "build it for a wider range, or use evaluate() for a status per point"
            )
        return sample.mu

    def evaluate(
        self, normal_force_n: Any, voltage_v: Any, frequency_hz: Any = None, h0_m: Any = None
    ) -> SurfaceSample:
        """Friction coefficient and status at points that broadcast together."""
        voltage = numbers("voltage_v", voltage_v, self.drive)
        if not bool((voltage.isfinite() & (voltage >= 0)).all()):
            raise InputError("voltage_v: expected finite amplitudes of 0 V or more")
        corners, inside = self._corners(voltage, normal_force_n, frequency_hz, h0_m)
        end = self._end(corners)
        drive = (voltage / end) ** 2
        sample = self._along(corners, drive.clamp(max=1.0))
        past = drive > 1 + max(1e-9, 8 * torch.finfo(drive.dtype).eps)
        beyond = torch.where(
            voltage > self.voltage_limit_v, int(Status.OUT_OF_RANGE), int(Status.PULL_IN)
        )
        status = torch.where(past, beyond, int(Status.OK))
        return SurfaceSample(
            sample, torch.where(inside, status, int(Status.OUT_OF_RANGE)).expand(sample.shape)
        )

    def voltage(
        self, mu: Any, normal_force_n: Any, frequency_hz: Any = None, h0_m: Any = None
    ) -> Inversion:
        """Amplitude that gives a wanted friction, for points that broadcast together."""
        wanted = numbers("mu", mu, self.drive)
        if not bool(wanted.isfinite().all()):
            raise InputError("mu: expected finite friction coefficients")
        corners, inside = self._corners(wanted, normal_force_n, frequency_hz, h0_m)
        end = self._end(corners)
        wanted, end, inside = torch.broadcast_tensors(wanted, end, inside)
        low = torch.zeros_like(wanted, dtype=torch.long)
        high = torch.full_like(low, len(self.drive) - 1)
        bottom, top = self._at_node(corners, low), self._at_node(corners, high)
        # A target equal to the end's own value is not out of reach by rounding.
        slack = max(1e-9, 8 * torch.finfo(top.dtype).eps) * top
        target = wanted.clamp(bottom, top)
        for _ in range((len(self.drive) - 1).bit_length()):
            middle = (low + high) // 2
            left = self._at_node(corners, middle) <= target
            low, high = torch.where(left, middle, low), torch.where(left, high, middle)
        mu_low, mu_high = self._at_node(corners, low), self._at_node(corners, high)
        rise = mu_high - mu_low
        part = torch.where(
            rise > 0, (target - mu_low) / rise.clamp(min=torch.finfo(rise.dtype).tiny), 0.0
        )
        drive = self.drive[low] + part * (self.drive[high] - self.drive[low])
        limited = torch.where(
            end < self.voltage_limit_v * (1 - 1e-9), int(Status.PULL_IN), int(Status.ABOVE)
        )
        status = torch.where(wanted > top + slack, limited, int(Status.OK))
        status = torch.where(wanted < bottom - slack, int(Status.BELOW), status)
        status = torch.where(inside, status, int(Status.OUT_OF_RANGE))
        return Inversion(end * drive.clamp(min=0.0).sqrt(), status)

    def reachable(
        self, normal_force_n: Any, frequency_hz: Any = None, h0_m: Any = None
    ) -> tuple[Tensor, Tensor]:
        """Lowest and highest friction coefficient that the surface can give."""
        corners, _ = self._corners(self.drive[0], normal_force_n, frequency_hz, h0_m)
        first = torch.zeros((), dtype=torch.long, device=self.drive.device)
        return self._at_node(corners, first), self._at_node(corners, first + len(self.drive) - 1)

    def highest_voltage(
        self, normal_force_n: Any, frequency_hz: Any = None, h0_m: Any = None
    ) -> Tensor:
        """Amplitude [V] at which the surface ends: the limit, or a margin below pull-in."""
        corners, _ = self._corners(self.drive[0], normal_force_n, frequency_hz, h0_m)
        return self._end(corners)

    def at(self, frequency_hz: Any = None, h0_m: Any = None) -> FrictionSurface:
        """Slice frequency and thickness away, once, for queries that do not vary them.

        None leaves an axis as it is.
        """
        mu, end = self.mu_table, self.voltage_end_v
        axes = list(self.axes)
        for dim, value in ((1, frequency_hz), (2, h0_m)):
            axis = axes[dim]
            if value is None:
                continue
            cell, part, inside = axis.locate(float(value))
            if not bool(inside):
                raise RangeError(
                    f"{axis.name}: {float(value):g} is outside the surface's "
                    f"{axis.low:g} to {axis.high:g}"
                )
            if axis.varies:
                pair = torch.stack([cell, cell + 1])
                weight = torch.stack([1 - part, part])
                mu = torch.tensordot(weight, mu.index_select(dim, pair), ([0], [dim]))
                end = torch.tensordot(weight, end.index_select(dim, pair), ([0], [dim]))
                mu, end = mu.unsqueeze(dim), end.unsqueeze(dim)
            axes[dim] = Axis(axis.name, axis.nodes.new_tensor([float(value)]))
        return replace(self, axes=(axes[0], axes[1], axes[2]), mu_table=mu, voltage_end_v=end)

    def to(self, dtype: torch.dtype, device: torch.device | str = "cpu") -> FrictionSurface:
        """Return a copy in another precision or on another device."""
        force, frequency, h0 = (Axis(a.name, a.nodes.to(device, dtype)) for a in self.axes)
        return replace(
            self,
            axes=(force, frequency, h0),
            drive=self.drive.to(device, dtype),
            mu_table=self.mu_table.to(device, dtype),
            voltage_end_v=self.voltage_end_v.to(device, dtype),
        )

    def _corners(self, other: Tensor, *values: Any) -> tuple[list[Corner], Tensor]:
        """Flat column numbers and weights of the columns around each point.

        `other` is the query's remaining quantity; all must broadcast together.
        """
        corners: list[Corner] = []
        everywhere = torch.ones((), dtype=torch.bool, device=self.drive.device)
        located = [axis.locate(value) for axis, value in zip(self.axes, values, strict=True)]
        shapes = [other.shape, *(part.shape for _, part, _ in located)]
        try:
            torch.broadcast_shapes(*shapes)
        except RuntimeError:
            raise InputError(
                "expected inputs that broadcast together, got shapes "
                f"{', '.join(str(tuple(shape)) for shape in shapes)}"
            ) from None
        for axis, (cell, part, inside) in zip(self.axes, located, strict=True):
            everywhere = everywhere & inside
            sides = [(cell, 1 - part), (cell + 1, part)] if axis.varies else [(cell, None)]
            if not corners:
                corners = [(i, torch.ones_like(part) if w is None else w) for i, w in sides]
            else:
                corners = [
                    (column * len(axis.nodes) + i, weight if w is None else weight * w)
                    for column, weight in corners
                    for i, w in sides
                ]
        return corners, everywhere

    def _end(self, corners: list[Corner]) -> Tensor:
        ends = self.voltage_end_v.reshape(-1)
        end: Tensor = sum((w * ends[column] for column, w in corners), start=ends.new_zeros(()))
        # A blend of equal ends may round a bit above them: never above the limit.
        return end.clamp(max=self.voltage_limit_v)

    def _at_node(self, corners: list[Corner], node: Tensor) -> Tensor:
        table = self.mu_table.reshape(-1, len(self.drive))
        return sum((w * table[column, node] for column, w in corners), start=table.new_zeros(()))

    def _along(self, corners: list[Corner], drive: Tensor) -> Tensor:
        inner = self.drive[1:-1]
        cell = torch.searchsorted(inner, drive.detach().contiguous(), right=True)
        part = (drive - self.drive[cell]) / (self.drive[cell + 1] - self.drive[cell])
        low = self._at_node(corners, cell)
        return low + part * (self._at_node(corners, cell + 1) - low)
