"""Raw recordings: the readings of the instruments during one stroke, and their file.

One stroke is one HDF5 file. Layout, schema 1::

    /            attributes: format = "haptix stroke", schema_version, stroke (JSON of the planned
                 stroke), instruments (JSON: name to serial number), temperature_c,
                 humidity_percent, operator, started (ISO 8601), is_accepted, findings (JSON),
                 assumed (JSON)
    /signals     t_s, normal_force_n, tangential_force_n, x_mm, drive_v: float64, one length,
                 each with an attribute "unit"

Times are those of the instrument's own clock. Stamps in bursts, late or rounded are taken as those
of an even clock (`calibration.measure.clocks.even_times`); ``assumed`` then has t_s. The tangential
force is positive where the finger drags the screen towards growing x.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from pydantic import TypeAdapter, ValidationError

from calibration.measure.clocks import even_times
from calibration.plan.parameters import Array
from calibration.plan.protocol import Stroke
from haptix.base.checks import first_error
from haptix.base.display import Table, axes_or_new
from haptix.base.errors import FileFormatError, InputError, from_extra
from haptix.base.files import check_schema_version, parse_json, reading, write_whole

with from_extra("calibration"):
    import h5py

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SIGNALS: Mapping[str, str] = {
    "t_s": "s",
    "normal_force_n": "N",
    "tangential_force_n": "N",
    "x_mm": "mm",
    "drive_v": "V",
}
"""Columns of a recording, and their units."""

_FORMAT = "haptix stroke"
_MOST_SAMPLES = 20_000_000  # of each signal: 20 s at 1 MHz, 160 MB


@dataclass(frozen=True)
class Conditions:
    """Circumstances of a recording."""

    instruments: Mapping[str, str] = field(default_factory=dict)
    """Name to serial number, such as ``{"force sensor": "FT12345"}``."""
    temperature_c: float | None = None
    humidity_percent: float | None = None
    """Temperature and humidity of the room."""
    operator: str = ""
    """Name of the person who measured."""
    started: str = ""
    """When, ISO 8601."""


@dataclass(frozen=True)
class StrokeRecording(Table):
    """One stroke as recorded; every signal has shape (samples,).

    Parameters
    ----------
    stroke : Stroke
        The planned stroke.
    t_s, normal_force_n, tangential_force_n, x_mm, drive_v : array
        Signals, in these units.
    conditions : Conditions
        Instruments and room.
    findings : tuple of str
        Why it was not accepted; empty where it was.
    assumed : tuple of str
        Signals that no instrument has measured: a drive as it was planned, a position from a
        stated speed, even times for uneven stamps.
    """

    stroke: Stroke
    t_s: Array
    normal_force_n: Array
    tangential_force_n: Array
    x_mm: Array
    drive_v: Array
    conditions: Conditions = field(default_factory=Conditions)
    findings: tuple[str, ...] = ()
    assumed: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        shapes = {name: np.shape(getattr(self, name)) for name in SIGNALS}
        if len(set(shapes.values())) != 1 or len(shapes["t_s"]) != 1 or shapes["t_s"][0] < 8:
            raise InputError(
                f"stroke {self.stroke.number}: expected signals of one length, 8 samples or more, "
                f"got {', '.join(f'{name} {shape}' for name, shape in shapes.items())}"
            )
        even = even_times(self.t_s)
        if even is not self.t_s:
            object.__setattr__(self, "t_s", even)
            object.__setattr__(self, "assumed", tuple(sorted({*self.assumed, "t_s"})))

    @classmethod
    def of(
        cls,
        stroke: Stroke,
        signals: Mapping[str, Array],
        conditions: Conditions | None = None,
        assumed: tuple[str, ...] = (),
    ) -> StrokeRecording:
        """Take signals by their names; other ones are ignored.

        Parameters
        ----------
        stroke : Stroke
            The readings.
        signals : mapping of str to array
            Signals by their names; other names are ignored.
        conditions : Conditions, optional
            Temperature, humidity and the like.
        assumed : tuple of str
            Signals that no instrument has measured.
        """
        t, normal, tangential, x, drive = (signals[name] for name in SIGNALS)
        room = conditions or Conditions()
        return cls(stroke, t, normal, tangential, x, drive, room, assumed=assumed)

    @property
    def sample_rate_hz(self) -> float:
        """Samples per second, from the median step in time."""
        step = float(np.median(np.diff(self.t_s)))
        return 1 / step if step > 0 else float("nan")

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw both forces along the stroke.

        Parameters
        ----------
        ax : Axes, optional
            Axes of matplotlib to draw into; without them, those of a new figure.

        Returns
        -------
        Axes
            The axes of the forces.
        """
        ax = axes_or_new(ax)
        ax.plot(self.x_mm, self.normal_force_n, label="normal")
        ax.plot(self.x_mm, self.tangential_force_n, label="tangential")
        ax.set(xlabel="x (mm)", ylabel="force (N)", title=f"stroke {self.stroke.number}")
        ax.legend()
        return ax

    def save(self, path: str | Path) -> None:
        """Write HDF5, whole or not at all.

        Raises
        ------
        FileFormatError
            If the file cannot be written.
        """
        room = self.conditions
        attributes = {
            "format": _FORMAT,
            "schema_version": 1,
            "stroke": self.stroke.model_dump_json(),
            **vars(room),
            "instruments": json.dumps(dict(room.instruments)),
            "is_accepted": not self.findings,
            "findings": json.dumps(self.findings),
            "assumed": json.dumps(self.assumed),
        }

        def write(draft: Path) -> None:
            # In memory: where a disk is full, HDF5 prints tracebacks and then crashes.
            whole = BytesIO()
            with h5py.File(whole, "w") as file:
                file.attrs.update(
                    {key: value for key, value in attributes.items() if value is not None}
                )
                signals = file.create_group("signals")
                for name, unit in SIGNALS.items():
                    values = np.asarray(getattr(self, name), dtype=np.float64)
                    data = signals.create_dataset(
                        name, data=values, compression="gzip", compression_opts=1, shuffle=True
                    )
                    data.attrs["unit"] = unit
            draft.write_bytes(whole.getbuffer())

        write_whole(path, write)

    @classmethod
    def load(cls, path: str | Path) -> StrokeRecording:
        """Read what `save` wrote.

        Raises
        ------
        FileFormatError
            If the file is missing, foreign, damaged or of a later version; it names the column
            that is missing.
        """
        with reading(path, "a recording of one stroke"), h5py.File(path, "r") as file:
            return cls._read(file, path)

    @classmethod
    def _read(cls, file: h5py.File, path: str | Path) -> StrokeRecording:
        if "format" not in file.attrs or _attribute(file, "format") != _FORMAT:
            raise FileFormatError(
                f"{path}: expected a recording of one stroke, got an HDF5 file of another kind; "
                "bring other formats in with `haptix calibrate measure --csv`"
            )
        check_schema_version(path, _attribute(file, "schema_version"))
        signals = file.get("signals")
        missing = [name for name in SIGNALS if signals is None or name not in signals]
        if missing:
            raise FileFormatError(f"{path}: expected signals {', '.join(missing)} as well")
        try:
            stroke = Stroke.model_validate(parse_json(_attribute(file, "stroke")))
            room = {
                field.name: _attribute(file, field.name)
                for field in fields(Conditions)
                if field.name in file.attrs
            }
            room["instruments"] = parse_json(_attribute(file, "instruments"))
            conditions = TypeAdapter(Conditions).validate_python(room)
            texts = TypeAdapter(tuple[str, ...]).validate_python
            findings = texts(parse_json(_attribute(file, "findings")))
            assumed = texts(parse_json(_attribute(file, "assumed")))
        except ValidationError as error:
            raise FileFormatError(f"{path}: {first_error('stroke', error)}") from None
        for name in ("signals", *(f"signals/{name}" for name in SIGNALS)):
            if not isinstance(file.get(name, getlink=True), h5py.HardLink):
                raise ValueError(f"{name} is a link, perhaps to another file")
        values = {name: _signal(signals[name]) for name in SIGNALS}
        return replace(cls.of(stroke, values, conditions, assumed), findings=findings)


def _attribute(file: h5py.File, name: str) -> Any:
    """Read an attribute that is one number or one text."""
    if name in file.attrs and file.attrs.get_id(name).shape != ():
        raise ValueError(f"{name} is no single value")
    value = file.attrs[name]
    return value.item() if isinstance(value, np.generic) else value


def _signal(data: Any) -> Array:
    """Read a signal, once its header is that of one."""
    if not isinstance(data, h5py.Dataset) or data.dtype.kind not in "fiu" or data.ndim != 1:
        raise ValueError(f"{data.name} is no row of numbers")
    largest = max(data.size, *(data.chunks or (0,)))
    if largest > _MOST_SAMPLES or data.external or data.is_virtual:
        raise ValueError(f"{data.name} has {largest} samples; expected {_MOST_SAMPLES} at most")
    return np.asarray(data[()], dtype=float)
