"""The friction surface: evaluated and inverted by interpolation alone."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from math import inf
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from haptix.checks import Array, instance
from haptix.errors import FileFormatError, InputError, RangeError, ToleranceError
from haptix.files import cache_folder, file_at
from haptix.finger import Finger
from haptix.friction import ContactModel
from haptix.results import ResultStore, folder_of
from haptix.status import Status
from haptix.surface.axes import AXIS_NAMES, Axis, numbers, within
from haptix.surface.boundary_elements import MeasuringJob, measured_table
from haptix.surface.build import build_table
from haptix.surface.file import export_netcdf, load_table, save_table
from haptix.surface.interpolant import Interpolant, Query
from haptix.surface.request import LARGEST_BYTES, surface_key
from haptix.surface.slice import Column, Slice
from haptix.surface.tolerance import Tolerance

_FILE = "friction.surface"


@dataclass(frozen=True)
class SurfaceSample:
    """Friction at query points, of their broadcast shape."""

    mu: Tensor
    """Friction coefficient; where the status is not OK, of the nearest point inside."""
    status: Tensor
    """Integers of `Status`: OK, OUT_OF_RANGE, or the one of `haptix.limits` that is passed."""


@dataclass(frozen=True)
class Inversion:
    """Voltages for frictions, of their broadcast shape."""

    voltage_v: Tensor
    """Amplitude [V] that gives the friction, or the nearest in the reachable range."""
    status: Tensor
    """Integers of `Status`: OK, BELOW, OUT_OF_RANGE, or what limits the friction: ABOVE (by the
    voltage limit), or one of `haptix.limits`."""


@dataclass(frozen=True)
class FrictionSurface:
    """mu(F_N, V0, f, h0), precomputed: evaluated and inverted by interpolation.

    Parameters
    ----------
    table : Interpolant
        The numbers, see `haptix.surface.interpolant`.
    info : dict
        What the surface was built from and how accurate it is; plain values.
    """

    table: Interpolant
    info: Mapping[str, Any] = field(default_factory=dict)

    @classmethod
    def build(
        cls,
        model: ContactModel,
        scene: Mapping[str, Any] | None = None,
        tolerance: Tolerance | float | str = 2e-3,
        on_progress: Callable[[float], None] | None = None,
        largest_bytes: int = LARGEST_BYTES,
        notes: Mapping[str, Any] | None = None,
        past_limits: bool = False,
    ) -> FrictionSurface:
        """Solve the model on axes that are refined until held-out solver points agree.

        A model of boundary elements is solved at few points only, see `measured`.

        Parameters
        ----------
        model : ContactModel
            The model to tabulate.
        scene : Scene or mapping, optional
            Ranges ``(low, high)`` or single values for ``normal_force_n`` (0.1 to 1 N),
            ``voltage_v`` (0 V to the screen's limit), ``frequency_hz`` (none) and ``h0_m`` (the
            screen's own); the brackets hold the defaults.
        tolerance : Tolerance, float or str
            Largest error in mu against the model at held-out points; in mu, or as
            ``"0.05 JND"`` or ``"0.2 %"``, see `Tolerance`.
        on_progress : callable, optional
            Called with the finished share of the work.
        largest_bytes : int
            Size that the surface may have.
        notes : mapping, optional
            Plain values to keep with the surface, in ``info["notes"]``.
        past_limits : bool
            Offer states past the model's limits (`haptix.limits`) as well, up to 90 % of pull-in.

        Raises
        ------
        InputError
            If a range is invalid, or lies past pull-in everywhere, or a state without voltage is
            past a limit.
        ToleranceError
            If the tolerance cannot be met within the size; it carries the best surface reached.

        Examples
        --------
        >>> import haptix
        >>> finger, screen = haptix.Finger.preset("wet"), haptix.Screen.preset("3m-sct3250")
        >>> model = haptix.ContactModel(finger, screen, fidelity="closed-form")
        >>> ranges = {"normal_force_n": (0.4, 0.6)}
        >>> surface = haptix.FrictionSurface.build(model, ranges, tolerance=0.01)
        >>> target = float(surface.mu(0.5, 60.0))
        >>> print(f"{float(surface.voltage(target, 0.5).voltage_v):.1f} V")
        60.0 V
        """
        instance("model", model, ContactModel, "the order is (model, scene)")
        if model.boxed is not None:
            job = MeasuringJob(model, scene or {}, past_limits=past_limits)
            return cls.measured(job, tolerance, on_progress, largest_bytes, notes)
        largest_error = Tolerance.read(tolerance)
        table = build_table(
            model, scene or {}, largest_error, on_progress, largest_bytes, notes, past_limits
        )
        return cls(*table)._within(largest_error, largest_bytes)

    @classmethod
    def measured(
        cls,
        job: MeasuringJob,
        tolerance: Tolerance | float | str = 2e-3,
        on_progress: Callable[[float], None] | None = None,
        largest_bytes: int = LARGEST_BYTES,
        notes: Mapping[str, Any] | None = None,
        checkpoint: str | Path | None = None,
    ) -> FrictionSurface:
        """Build from boundary elements at few points, with the mean field between them.

        ``info["boundary_elements"]`` keeps points, ratios and scatter.

        Parameters
        ----------
        job : MeasuringJob
            Model, ranges and points.
        tolerance, on_progress, largest_bytes, notes
            As for `build`; the tolerance is that of the mean field between the points.
        checkpoint : path, optional
            File (.npz) that keeps finished columns: the same call resumes from it.

        Raises
        ------
        InputError, ToleranceError
            As in `build`.
        FileFormatError
            If the checkpoint is damaged or belongs to something else.
        """
        largest_error = Tolerance.read(tolerance)
        table = measured_table(job, largest_error, on_progress, largest_bytes, notes, checkpoint)
        return cls(*table)._within(largest_error, largest_bytes)

    def _within(self, tolerance: Tolerance, largest_bytes: int) -> FrictionSurface:
        if not self.info["tolerance_met"]:
            raise ToleranceError(
                f"tolerance {tolerance} cannot be met within {largest_bytes:,} bytes: reached "
                f"{self.info['error_max_in_units']:.3g} {tolerance.unit} with {self.nbytes:,} "
                "bytes; ask for less, for a narrower range, or, if that is near the size, allow "
                "more bytes",
                self,
            )
        return self

    def save(self, path: str | Path) -> None:
        """Write the surface to one file, whole or not at all."""
        save_table(self.table, self.info, Path(path))

    def to_netcdf(self, path: str | Path) -> None:
        """Write the surface as NetCDF, for other programs; see `haptix.surface.file`."""
        export_netcdf(self.table, self.info, Path(path))

    @classmethod
    def load(cls, path: str | Path, model: ContactModel | None = None) -> FrictionSurface:
        """Read a surface, memory-mapped; nothing in the file is ever executed.

        Parameters
        ----------
        path : str or Path
            The file.
        model : ContactModel, optional
            The model that it must have been built from.

        Raises
        ------
        FileFormatError
            If the file is missing, foreign, damaged, of a later version or of another model.
        """
        return cls(*load_table(file_at("path", path), model))

    @property
    def normal_force_n(self) -> Axis:
        """Axis of normal force [N]."""
        return self.table.axes["normal_force_n"]

    @property
    def frequency_hz(self) -> Axis:
        """Axis of drive frequency [Hz]."""
        return self.table.axes["frequency_hz"]

    @property
    def h0_m(self) -> Axis:
        """Axis of the screen's effective insulator thickness [m]."""
        return self.table.axes["h0_m"]

    @property
    def mu_table(self) -> Tensor:
        """Friction coefficient at the nodes, shape (forces, frequencies, thicknesses, drives)."""
        return self.table.mu

    @property
    def voltage_limit_v(self) -> float:
        """Highest amplitude asked for [V]."""
        return self.table.voltage_limit_v

    @property
    def response_hz_per_mm_per_s(self) -> float:
        """Cut-off of the finger's response per sliding speed; see `Finger`.

        Surfaces of version 0.1 do not contain it, and get the value of the presets.
        """
        preset = Finger().response_hz_per_mm_per_s
        return float(self.info.get("response_hz_per_mm_per_s", preset))

    @property
    def nbytes(self) -> int:
        """Bytes of the table."""
        return self.table.nbytes

    def mu(
        self,
        normal_force_n: Any,
        voltage_v: Any,
        frequency_hz: Any = None,
        h0_m: Any = None,
    ) -> Tensor:
        """Friction coefficient at points that broadcast together.

        Raises
        ------
        RangeError
            If a point lies outside the surface or past its end; `evaluate` returns a status
            instead.
        """
        return self.evaluate(normal_force_n, voltage_v, frequency_hz, h0_m, strict=True).mu

    def evaluate(
        self,
        normal_force_n: Any,
        voltage_v: Any,
        frequency_hz: Any = None,
        h0_m: Any = None,
        strict: bool = False,
    ) -> SurfaceSample:
        """Friction coefficient and status at points that broadcast together.

        Raises
        ------
        RangeError
            With `strict`, if a status is not OK.
        """
        voltage = numbers("voltage_v", voltage_v, self.table.drive)
        if not within(voltage, 0.0):
            raise InputError("voltage_v: expected finite amplitudes of 0 V or more")
        mu, status = self.table.evaluate(voltage, _places(normal_force_n, frequency_hz, h0_m))
        if strict:
            self._demand_ok(status)
        return SurfaceSample(mu, status)

    def voltage(
        self,
        mu: Any,
        normal_force_n: Any,
        frequency_hz: Any = None,
        h0_m: Any = None,
        strict: bool = False,
    ) -> Inversion:
        """Amplitude [V] that gives a friction, for points that broadcast together.

        Raises
        ------
        RangeError
            With `strict`, if a status is not OK.
        """
        wanted = numbers("mu", mu, self.table.drive)
        if not within(wanted, -inf, least_counts=False):
            raise InputError("mu: expected finite friction coefficients")
        voltage, status = self.table.invert(wanted, _places(normal_force_n, frequency_hz, h0_m))
        if strict:
            self._demand_ok(status)
        return Inversion(voltage, status)

    def reachable(
        self, normal_force_n: Any, frequency_hz: Any = None, h0_m: Any = None
    ) -> tuple[Tensor, Tensor]:
        """Reachable range: lowest and highest friction coefficient."""
        places = _places(normal_force_n, frequency_hz, h0_m)
        none = torch.zeros_like(self.table.drive[0])
        low, _ = self.table.evaluate(none, places)
        high, _ = self.table.evaluate(none + inf, places)
        return low, high

    def highest_voltage(
        self, normal_force_n: Any, frequency_hz: Any = None, h0_m: Any = None
    ) -> Tensor:
        """Amplitude [V] at which the surface ends: see `Interpolant.end`."""
        return self.table.end(_places(normal_force_n, frequency_hz, h0_m))

    def at(self, frequency_hz: float | None = None, h0_m: float | None = None) -> FrictionSurface:
        """Slice at one frequency or thickness, for queries that do not vary them.

        None keeps an axis.
        """
        return FrictionSurface(self.table.at(_places(None, frequency_hz, h0_m)), self.info)

    def driven_at(self, frequency_hz: float | None, h0_m: float | None = None) -> FrictionSurface:
        """Slice at a drive's frequency and a screen's thickness.

        Parameters
        ----------
        frequency_hz : float or None
            Frequency of the drive; of no effect on a surface without frequency.
        h0_m : float, optional
            Effective thickness; without it, that of the screen for which the surface was built.

        Raises
        ------
        InputError, RangeError
            If a value is missing or lies outside the surface.
        """
        if self.h0_m.varies and h0_m is None:
            h0_m = self.info.get("screen_h0_m")
        for axis, value in ((self.frequency_hz, frequency_hz), (self.h0_m, h0_m)):
            if value is None:
                axis.read(None)  # raises where the axis varies
        return self.at(None if self.frequency_hz.is_absent else frequency_hz, h0_m)

    def column(
        self,
        normal_force_n: float,
        frequency_hz: float | None,
        h0_m: float | None = None,
        attraction: Array | None = None,
    ) -> Column:
        """Friction against voltage at one force, frequency and thickness, see `driven_at`.

        With `attraction` over a period of the drive it is the mean over it, see `Slice.averaged`.

        Raises
        ------
        InputError, RangeError
            If a value is missing or lies outside the surface.
        """
        columns = Slice.of(self.driven_at(frequency_hz, h0_m).table)
        column = (columns if attraction is None else columns.averaged(attraction)).column(
            normal_force_n
        )
        if not column.is_inside:
            axis = self.normal_force_n
            raise RangeError(
                f"normal_force_n: {normal_force_n:g} N is outside the surface's "
                f"{axis.low:g} to {axis.high:g} N; build one for it"
            )
        return column

    def to(self, dtype: torch.dtype, device: torch.device | str = "cpu") -> FrictionSurface:
        """Return a copy in another precision or on another device."""
        return FrictionSurface(self.table.to(dtype, device), self.info)

    def _demand_ok(self, status: Tensor) -> None:
        bad = status[status != int(Status.OK)]
        if len(bad) == 0:
            return
        spans = ", ".join(
            f"{axis.name} {axis.low:g} to {axis.high:g}"
            for axis in self.table.axes
            if not axis.is_absent
        )
        counts = ", ".join(
            f"{int((bad == one).sum())} {Status(one).name}" for one in bad.unique().tolist()
        )
        raise RangeError(
            f"{len(bad)} of {status.numel()} points lie outside the surface ({counts}): expected "
            f"{spans}, voltage_v 0 to {self.voltage_limit_v:g} and short of pull-in; build it for "
            "a wider range, or ask without `strict` for a status per point"
        )


def _places(*values: Any) -> Query:
    """Values by name of the axis, given in the order of `AXES`."""
    return dict(zip(AXIS_NAMES, values, strict=True))


def cached_surface(
    model: ContactModel,
    scene: Any,
    tolerance: Tolerance | float | str,
    on_progress: Callable[[float], None] | None = None,
) -> tuple[FrictionSurface, bool]:
    """Load the surface of these inputs, or build and keep it; also return whether it was found.

    An entry that is not what was written is built again. A cache that cannot be read or written is
    not used. Neither changes a result.
    """
    key = surface_key(model, scene, tolerance)
    store = ResultStore(cache_folder())
    with suppress(FileFormatError, OSError):
        if store.check(key)[0] is not None:
            return FrictionSurface.load(Path(store.where, folder_of(key), _FILE)), True
    surface = FrictionSurface.build(model, scene, tolerance, on_progress)
    with suppress(FileFormatError, OSError):
        store.publish(key, {_FILE: surface.save}, {"kind": "surface"})
    return surface, False
