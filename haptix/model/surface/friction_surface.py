"""The friction surface: evaluated and inverted by interpolation alone."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from math import inf
from pathlib import Path
from typing import TYPE_CHECKING, Any

import torch
from torch import Tensor

from haptix.base.checks import Array, eager, instance, positive
from haptix.base.display import Displayed, axes_or_new
from haptix.base.errors import FileFormatError, InputError, RangeError, ToleranceError
from haptix.base.files import cache_folder, file_at
from haptix.base.results import ResultStore, folder_of
from haptix.model.finger import Finger
from haptix.model.friction import ContactModel
from haptix.model.surface.answers import (
    Intervals,
    Inversion,
    SurfaceSample,
    check_inside,
    check_ok,
    intervals_at,
)
from haptix.model.surface.axes import AXIS_NAMES, Axis, numbers, within
from haptix.model.surface.boundary_elements import MeasuringJob, measured_table
from haptix.model.surface.build import build_table
from haptix.model.surface.file import (
    LARGEST_BYTES,
    as_dataset,
    export_netcdf,
    load_table,
    of_dataset,
    save_table,
    surface_key,
)
from haptix.model.surface.interpolant import Column, Interpolant, Query, Slice
from haptix.model.surface.tolerance import Tolerance

if TYPE_CHECKING:
    import xarray
    from matplotlib.axes import Axes

_FILE = "friction.surface"


@dataclass(frozen=True)
class FrictionSurface(Displayed):
    """mu(F_N, V0, f, h0), precomputed: evaluated and inverted by interpolation.

    Parameters
    ----------
    table : Interpolant
        The numbers, see `haptix.model.surface.interpolant`.
    info : dict
        Inputs and accuracy of the surface; plain values.
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
        """Solve the model on axes, and refine these until held-out points agree.

        A model of boundary elements is solved at few points only, see `measured`.

        Parameters
        ----------
        model : ContactModel
            The model to tabulate.
        scene : Scene or mapping, optional
            Ranges ``(low, high)`` or single values, with their defaults in brackets:
            ``normal_force_n`` (0.1 to 1 N), ``voltage_v`` (0 V to the screen's limit),
            ``frequency_hz`` (none) and ``h0_m`` (the screen's).
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
            Include states past the model's limits (`status.LIMITS`), up to 90 % of pull-in.

        Raises
        ------
        InputError
            If a range is invalid or lies wholly past pull-in, or a state without voltage is past a
            limit.
        ToleranceError
            If the tolerance cannot be met within the size; it holds the best surface.

        Examples
        --------
        >>> import haptix
        >>> model = haptix.ContactModel(haptix.Finger(), haptix.Screen(), fidelity="closed-form")
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
            File (.npz) of finished columns; the same call with this file resumes the work.

        Raises
        ------
        InputError, ToleranceError
            As in `build`.
        FileFormatError
            If the checkpoint is damaged, or was made by a different call.
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
        """Write the surface to one file, whole or not at all.

        Examples
        --------
        >>> import haptix
        >>> from tempfile import TemporaryDirectory
        >>> model = haptix.ContactModel(haptix.Finger(), haptix.Screen(), fidelity="closed-form")
        >>> surface = haptix.FrictionSurface.build(model, {"normal_force_n": (0.4, 0.6)}, 0.01)
        >>> with TemporaryDirectory() as folder:
        ...     surface.save(f"{folder}/wet.surface")
        ...     loaded = haptix.FrictionSurface.load(f"{folder}/wet.surface")
        >>> loaded == surface
        True
        """
        save_table(self.table, self.info, Path(path))

    def to_netcdf(self, path: str | Path) -> None:
        """Write the surface as NetCDF, for other programs; see `haptix.model.surface.file`."""
        export_netcdf(self.table, self.info, Path(path))

    def to_xarray(self) -> xarray.Dataset:
        """Return the surface as named arrays with units (extra ``netcdf``), as in its NetCDF.

        Examples
        --------
        >>> import haptix
        >>> model = haptix.ContactModel(haptix.Finger(), haptix.Screen(), fidelity="closed-form")
        >>> surface = haptix.FrictionSurface.build(model, {"normal_force_n": (0.4, 0.6)}, 0.01)
        >>> surface.to_xarray()["mu"].dims
        ('normal_force_n', 'frequency_hz', 'h0_m', 'drive')
        """
        return as_dataset(self.table, self.info)

    @classmethod
    def from_xarray(cls, dataset: xarray.Dataset) -> FrictionSurface:
        """Return the surface that `to_xarray` or a NetCDF file describes; mu to 1e-15 of itself.

        Raises
        ------
        FileFormatError
            If the dataset is no surface of haptix.
        """
        return cls(*of_dataset(dataset))

    @classmethod
    def load(cls, path: str | Path, model: ContactModel | None = None) -> FrictionSurface:
        """Read a surface into memory; nothing in the file is ever executed. See `save`.

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

    def _shown(self) -> dict[str, Any]:
        axes = {axis.name: axis.nodes for axis in self.table.axes if not axis.is_absent}
        return {**axes, "voltage_limit_v": self.voltage_limit_v, "mu": self.mu_table}

    def plot(
        self, ax: Axes | None = None, frequency_hz: float | None = None, h0_m: float | None = None
    ) -> Axes:
        """Draw friction against voltage, a line for each of five forces; return the axes.

        Parameters
        ----------
        ax : Axes, optional
            Axes of matplotlib to draw into; without them, those of a new figure.
        frequency_hz, h0_m : float, optional
            Where to cut the surface, see `driven_at`.

        Raises
        ------
        InputError, RangeError
            As in `driven_at`.
        """
        cut = self.driven_at(frequency_hz, h0_m)
        ax = axes_or_new(ax)
        low, high = cut.normal_force_n.nodes[[0, -1]].log10()
        for force_n in torch.logspace(low, high, 5 if high > low else 1):
            voltage_v = torch.linspace(0, float(cut.highest_voltage(force_n)), 200)
            ax.plot(voltage_v, cut.evaluate(force_n, voltage_v).mu.cpu(), label=f"{force_n:.2g} N")
        ax.set(xlabel="voltage (V)", ylabel="friction coefficient")
        ax.legend(title="normal force")
        return ax

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
        """Highest amplitude of the surface [V]."""
        return self.table.voltage_limit_v

    @property
    def response_hz_per_mm_per_s(self) -> float:
        """Cut-off of the finger's response per sliding speed; see `Finger`."""
        preset = Finger().response_hz_per_mm_per_s
        return float(self.info.get("response_hz_per_mm_per_s", preset))

    @property
    def nbytes(self) -> int:
        """Bytes of the table."""
        return self.table.nbytes

    @eager
    def mu(
        self, normal_force_n: Any, voltage_v: Any, frequency_hz: Any = None, h0_m: Any = None
    ) -> Tensor:
        """Friction coefficient at points that broadcast together.

        Parameters
        ----------
        normal_force_n : float or array
            Normal force F_N [N].
        voltage_v : float or array
            Amplitude V0 [V], peak.
        frequency_hz : float or array, optional
            Frequency of the drive [Hz]; not needed where the surface has one only.
        h0_m : float or array, optional
            Insulator's thickness over permittivity [m]; likewise.

        Raises
        ------
        RangeError
            If a point lies outside the surface or past its end; `evaluate` returns a status
            instead.

        Examples
        --------
        >>> import haptix
        >>> model = haptix.ContactModel(haptix.Finger(), haptix.Screen(), fidelity="closed-form")
        >>> surface = haptix.FrictionSurface.build(model, {"normal_force_n": (0.4, 0.6)}, 0.01)
        >>> resting, driven = surface.mu(0.5, [0.0, 60.0])
        >>> bool(driven > resting)
        True
        """
        return self.evaluate(normal_force_n, voltage_v, frequency_hz, h0_m, strict=True).mu

    @eager
    def evaluate(
        self,
        normal_force_n: Any,
        voltage_v: Any,
        frequency_hz: Any = None,
        h0_m: Any = None,
        strict: bool = False,
    ) -> SurfaceSample:
        """Friction coefficient and status at points that broadcast together.

        Parameters
        ----------
        normal_force_n, voltage_v, frequency_hz, h0_m : float or array
            As in `mu`.
        strict : bool
            Raise where a status is not OK, instead of telling it.

        Raises
        ------
        RangeError
            With `strict`, if a status is not OK.

        Examples
        --------
        >>> import haptix
        >>> model = haptix.ContactModel(haptix.Finger(), haptix.Screen(), fidelity="closed-form")
        >>> surface = haptix.FrictionSurface.build(model, {"normal_force_n": (0.4, 0.6)}, 0.01)
        >>> sample = surface.evaluate(normal_force_n=[0.5, 2.0], voltage_v=60.0)
        >>> [haptix.Status(int(status)).name for status in sample.status]
        ['OK', 'OUT_OF_RANGE']
        """
        voltage = numbers("voltage_v", voltage_v, self.table.drive)
        if not within(voltage, 0.0):
            raise InputError("voltage_v: expected finite amplitudes of 0 V or more")
        mu, status = self.table.evaluate(voltage, _places(normal_force_n, frequency_hz, h0_m))
        if strict:
            check_ok(status, self.table, "evaluate")
        return SurfaceSample(mu, status)

    @eager
    def voltage(
        self,
        mu: Any,
        normal_force_n: Any,
        frequency_hz: Any = None,
        h0_m: Any = None,
        strict: bool = False,
    ) -> Inversion:
        """Amplitude [V] that gives a friction, for points that broadcast together.

        Parameters
        ----------
        mu : float or array
            Friction coefficient that is wanted.
        normal_force_n, frequency_hz, h0_m : float or array
            As in `mu`.
        strict : bool
            Raise where a status is not OK, instead of telling it.

        Raises
        ------
        RangeError
            With `strict`, if a status is not OK.

        Examples
        --------
        >>> import haptix
        >>> model = haptix.ContactModel(haptix.Finger(), haptix.Screen(), fidelity="closed-form")
        >>> surface = haptix.FrictionSurface.build(model, {"normal_force_n": (0.4, 0.6)}, 0.01)
        >>> low, high = surface.reachable(0.5)
        >>> inversion = surface.voltage(mu=(low + high) / 2, normal_force_n=0.5)
        >>> abs(float(surface.mu(0.5, inversion.voltage_v)) - float(low + high) / 2) < 1e-6
        True
        """
        wanted = numbers("mu", mu, self.table.drive)
        if not within(wanted, -inf, least_counts=False):
            raise InputError("mu: expected finite friction coefficients")
        voltage, status = self.table.invert(wanted, _places(normal_force_n, frequency_hz, h0_m))
        if strict:
            check_ok(status, self.table, "voltage")
        return Inversion(voltage, status)

    @eager
    def reachable(
        self, normal_force_n: Any, frequency_hz: Any = None, h0_m: Any = None
    ) -> tuple[Tensor, Tensor]:
        """Reachable range: lowest and highest friction coefficient.

        Parameters
        ----------
        normal_force_n, frequency_hz, h0_m : float or array
            As in `mu`.

        Raises
        ------
        RangeError
            If a place lies outside the surface.

        Examples
        --------
        >>> import haptix
        >>> model = haptix.ContactModel(haptix.Finger(), haptix.Screen(), fidelity="closed-form")
        >>> surface = haptix.FrictionSurface.build(model, {"normal_force_n": (0.4, 0.6)}, 0.01)
        >>> low, high = surface.reachable(0.5)
        >>> bool(low == surface.mu(0.5, 0.0))
        True
        """
        places = _places(normal_force_n, frequency_hz, h0_m)
        no_voltage = torch.zeros_like(self.table.drive[0])
        low, status = self.table.evaluate(no_voltage, places)
        check_inside(status, self.table)
        high, _ = self.table.evaluate(no_voltage + inf, places)
        return low, high

    @eager
    def intervals(
        self, normal_force_n: Any, frequency_hz: Any = None, h0_m: Any = None
    ) -> Intervals:
        """90 % intervals of the theory around places, in JND, at the highest voltages.

        Parameters
        ----------
        normal_force_n, frequency_hz, h0_m : float or array
            As in `mu`.

        Raises
        ------
        InputError
            If a place on one of its axes is missing.

        Examples
        --------
        >>> import haptix
        >>> model = haptix.ContactModel(haptix.Finger.preset("wet"), haptix.Screen())
        >>> surface = haptix.FrictionSurface.build(model, {"normal_force_n": (0.4, 0.6)}, 0.01)
        >>> float(surface.intervals(0.5).contrast_jnd)  # not compared for so thin an insulator
        inf
        """
        return intervals_at(self.info, _places(normal_force_n, frequency_hz, h0_m))

    @eager
    def highest_voltage(
        self, normal_force_n: Any, frequency_hz: Any = None, h0_m: Any = None
    ) -> Tensor:
        """Amplitude [V] at which the surface ends: see `Interpolant.end`.

        Parameters
        ----------
        normal_force_n, frequency_hz, h0_m : float or array
            As in `mu`.

        Raises
        ------
        RangeError
            If a place lies outside the surface.
        """
        places = _places(normal_force_n, frequency_hz, h0_m)
        _, status = self.table.evaluate(torch.zeros_like(self.table.drive[0]), places)
        check_inside(status, self.table)
        return self.table.end(places)

    def at(self, frequency_hz: float | None = None, h0_m: float | None = None) -> FrictionSurface:
        """Slice at one frequency or thickness, for queries that do not vary them.

        Parameters
        ----------
        frequency_hz : float, optional
            Frequency [Hz] to cut at; None keeps the axis.
        h0_m : float, optional
            Thickness over permittivity [m] to cut at; None keeps the axis.
        """
        return FrictionSurface(self.table.at(_places(None, frequency_hz, h0_m)), self.info)

    def driven_at(self, frequency_hz: float | None, h0_m: float | None = None) -> FrictionSurface:
        """Slice at a drive's frequency and a screen's thickness.

        Parameters
        ----------
        frequency_hz : float or None
            Frequency of the drive [Hz]; a surface without frequency ignores it.
        h0_m : float, optional
            Effective thickness [m]; by default that of the screen for which the surface was built.

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
        """Friction against voltage at one force, frequency and thickness.

        Parameters
        ----------
        normal_force_n : float
        frequency_hz, h0_m : float, optional
            Where to cut the surface, see `driven_at`.
        attraction : array, optional
            Attraction over one period of the drive: friction is the mean over it, see
            `Slice.averaged`.

        Raises
        ------
        InputError, RangeError
            If a value is missing or lies outside the surface.

        Examples
        --------
        >>> import haptix
        >>> model = haptix.ContactModel(haptix.Finger(), haptix.Screen(), fidelity="closed-form")
        >>> surface = haptix.FrictionSurface.build(model, {"normal_force_n": (0.4, 0.6)}, 0.01)
        >>> column = surface.column(0.5, None)
        >>> abs(float(column.mu([60.0])[0]) - float(surface.mu(0.5, 60.0))) < 1e-6
        True
        """
        force_n = positive("normal_force_n", normal_force_n)
        columns = Slice.of(self.driven_at(frequency_hz, h0_m).table)
        column = (columns if attraction is None else columns.averaged(attraction)).column(force_n)
        if not column.is_inside:
            axis = self.normal_force_n
            raise RangeError(
                f"normal_force_n: {force_n:g} N is outside the surface's "
                f"{axis.low:g} to {axis.high:g} N; build one for it"
            )
        return column

    def limited(self, voltage_v: float) -> FrictionSurface:
        """Return the same surface up to an amplitude [V] at most; nothing is solved again.

        Parameters
        ----------
        voltage_v : float
            Such as the ceiling of a device.

        Raises
        ------
        InputError
            If it is not above 0.

        Examples
        --------
        >>> import haptix
        >>> model = haptix.ContactModel(haptix.Finger(), haptix.Screen(), fidelity="closed-form")
        >>> surface = haptix.FrictionSurface.build(model, {"normal_force_n": (0.4, 0.6)}, 0.01)
        >>> surface.limited(150.0).voltage_limit_v
        150.0
        """
        limit_v = positive("voltage_v", voltage_v)
        if limit_v >= self.voltage_limit_v:
            return self
        return FrictionSurface(replace(self.table, voltage_limit_v=limit_v), self.info)

    def to(self, dtype: torch.dtype, device: torch.device | str = "cpu") -> FrictionSurface:
        """Return a copy in another precision or on another device.

        Parameters
        ----------
        dtype : torch.dtype
            Precision of the numbers.
        device : torch.device or str
            Where they are.
        """
        return FrictionSurface(self.table.to(dtype, device), self.info)


def _places(*values: Any) -> Query:
    """Values by name of the axis, from values in the order of `AXES`."""
    return dict(zip(AXIS_NAMES, values, strict=True))


def cached_surface(
    model: ContactModel,
    scene: Any,
    tolerance: Tolerance | float | str,
    on_progress: Callable[[float], None] | None = None,
) -> tuple[FrictionSurface, bool]:
    """Load the surface from the cache, or build and store it; also return whether it was loaded.

    A damaged entry is built again, and a cache that cannot be read or written is not used. The
    result is the same in every case.

    Parameters
    ----------
    model, scene, tolerance, on_progress
        As in `FrictionSurface.build`.
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
