"""Where force and position come from while a stroke is played: instruments, or files of others."""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from threading import Lock
from typing import Annotated, Any, Literal, Protocol, Self

import numpy as np
from pydantic import Field, PositiveFloat, model_validator
from scipy.interpolate import CubicSpline

from calibration.measure.recording import SIGNALS
from calibration.measure.segmentation import position_at_speed, sliding_speed
from calibration.plan.parameters import Array
from calibration.plan.protocol import Stroke
from haptix.base.display import Displayed
from haptix.base.documents import Document, Part
from haptix.base.errors import DeviceError, FileFormatError, InputError, from_extra
from haptix.base.files import read_text

_LIVE_S = 0.05  # over which force and speed are shown
_FORCE = {"N": 1.0, "mN": 1e-3, "gf": 9.80665e-3, "kgf": 9.80665, "lbf": 4.4482216}
_UNITS = {
    "t_s": {"s": 1.0, "ms": 1e-3, "us": 1e-6},
    "normal_force_n": _FORCE,
    "tangential_force_n": _FORCE,
    "x_mm": {"mm": 1.0, "m": 1e3, "cm": 10.0, "inch": 25.4, "um": 1e-3},
    "drive_v": {"V": 1.0, "mV": 1e-3, "kV": 1e3},
}
_FEWEST_SAMPLES = 8


@dataclass(frozen=True)
class StrokeDrive(Displayed):
    """Drive of one recording: volts from its first instant on."""

    volts: Array
    sample_rate_hz: float

    @property
    def duration_s(self) -> float:
        """Length of the recording [s]."""
        return len(self.volts) / self.sample_rate_hz

    def at(self, t_s: Array) -> Array:
        """Voltage on the screen [V] at times from the start [s], smooth between samples."""
        sample_t_s = np.arange(len(self.volts)) / self.sample_rate_hz
        inside = (t_s >= 0) & (t_s <= sample_t_s[-1])
        within = np.clip(t_s, 0.0, sample_t_s[-1])
        return np.where(inside, CubicSpline(sample_t_s, self.volts)(within), 0.0)


@dataclass(frozen=True)
class Live:
    """Forces and speed that the person sees while sliding."""

    normal_force_n: float
    speed_mm_per_s: float
    tangential_force_n: float

    @classmethod
    def at(cls, signals: Mapping[str, Array], t_s: float) -> Live | None:
        """Mean forces and speed of the last 50 ms before a time; None without samples."""
        t = signals["t_s"]
        inside = (t > t_s - _LIVE_S) & (t <= t_s)
        if inside.sum() < 4:
            return None
        speed = sliding_speed(t[inside], signals["x_mm"][inside])
        normal, tangential = (
            float(signals[name][inside].mean()) for name in ("normal_force_n", "tangential_force_n")
        )
        return cls(normal, float(np.abs(speed).mean()), tangential)


class ForceSource(Protocol):
    """An instrument, or a replacement of one."""

    @property
    def instruments(self) -> Mapping[str, str]:
        """Names and serial numbers."""

    is_live: bool
    """Whether it records in real time, so that playing must keep to the clock."""

    assumed: tuple[str, ...] = ()
    """Signals that no instrument measures; where it gives no drive_v, the played one is kept."""

    def start(self, stroke: Stroke, played: StrokeDrive) -> None:
        """Begin to record one stroke.

        Parameters
        ----------
        stroke : Stroke
            What is measured.
        played : StrokeDrive
            What is played meanwhile.
        """

    def live(self, t_s: float) -> Live | None:
        """Force and speed at a time since the start, if known already."""
        return None

    def finish(self) -> dict[str, Array]:
        """End the recording and return its signals, by the names of `SIGNALS`.

        Without a drive_v the voltage that was played takes its place.
        """


class CsvSource(ForceSource):
    """Replays recordings that another program has exported, one CSV file per stroke.

    The names of the files hold the stroke's number: ``stroke-007.csv`` or ``7.csv``.

    Parameters
    ----------
    folder : str or Path
        Where the files are.
    columns : ColumnMap
        Which column is what.
    """

    is_live = False

    def __init__(self, folder: str | Path, columns: ColumnMap) -> None:
        self._folder, self._columns = Path(folder), columns
        self._number = 0
        self.assumed = columns.assumed
        if not self._folder.is_dir():
            raise FileFormatError(f"expected a folder of CSV files, got {self._folder}")

    @property
    def instruments(self) -> Mapping[str, str]:
        return {"CSV files": self._folder.name}

    def start(self, stroke: Stroke, played: StrokeDrive) -> None:
        self._number = stroke.number

    def finish(self) -> dict[str, Array]:
        number = self._number
        names = (f"stroke-{number:03d}.csv", f"stroke-{number}.csv", f"{number}.csv")
        for name in names:
            if (self._folder / name).exists():
                return self._columns.signals(self._folder / name)
        raise FileFormatError(f"{self._folder}: expected a file {' or '.join(names)}")


class CsvColumn(Part):
    """Where one signal comes from.

    Parameters
    ----------
    column : str or None
        Heading of the column, without blanks at its ends; None where there is no column.
    unit : str or None
        Unit of the column: s, ms or us; N, mN, gf, kgf or lbf; mm, m, cm, inch or um; V, mV or kV.
        "raw" keeps the numbers of a signal without a unit.
    scale : float
        Further factor: the gain of a divider, or -1 for a sign.
    speed_mm_per_s : float or None
        For x_mm alone, where no position was kept: constant speed. In a stroke the finger slides
        while the tangential force shows friction; without forces, from the first sample on.
    value : float or None
        Constant value. A constant drive_v is none: the planned voltage takes its place.
    """

    column: str | None = None
    unit: str | None = None
    scale: float = 1.0
    speed_mm_per_s: float | None = None
    value: float | None = None

    @model_validator(mode="after")
    def _comes_from_somewhere(self) -> Self:
        if sum(x is not None for x in (self.column, self.speed_mm_per_s, self.value)) != 1:
            raise ValueError("expected one of column, speed_mm_per_s and value")
        if self.column is not None and self.unit is None:
            raise ValueError(f'expected the unit of column "{self.column}"')
        return self


class ColumnMap(Document):
    """How to read a CSV file of another instrument: which column is which signal, in which unit.

    A column map is a TOML file::

        schema_version = 1
        skip_rows = 0                 # lines above the header
        delimiter = ","
        [columns]
        t_s = { column = "Time", unit = "ms" }
        normal_force_n = { column = "Fz (mN)", unit = "mN", scale = -1 }   # scale turns a sign
        tangential_force_n = { column = "Fx (mN)", unit = "mN" }
        x_mm = { speed_mm_per_s = 50 }                          # where no position was kept
        drive_v = { column = "Monitor", unit = "V", scale = 50 }           # 1:50 divider

    Where the instrument kept no drive, leave ``drive_v`` out: the planned voltage takes its place.
    What was not measured is kept with the recording, and the profile says so.

    Parameters
    ----------
    columns : mapping of str to CsvColumn
        Keys of `calibration.measure.recording.SIGNALS`, and any others to keep beside them.
    skip_rows : int
        Lines above the headings.
    delimiter : str
        One character.
    """

    skip_rows: Annotated[int, Field(ge=0)] = 0
    delimiter: Annotated[str, Field(min_length=1, max_length=1)] = ","
    columns: dict[str, CsvColumn]

    @model_validator(mode="after")
    def _units_are_known(self) -> Self:
        for name, column in self.columns.items():
            known = [*_UNITS.get(name, ()), "raw"]
            if column.column is not None and column.unit not in known:
                raise ValueError(f"{name}: expected unit {', '.join(known)}, got {column.unit!r}")
            if column.speed_mm_per_s is not None and name != "x_mm":
                raise ValueError(f"{name}: speed_mm_per_s makes a position: x_mm alone may have it")
        if "t_s" not in self.columns:
            raise ValueError("expected t_s among the columns")
        return self

    @property
    def assumed(self) -> tuple[str, ...]:
        """Signals of a recording that no column of the file gives."""
        columns = {name for name, column in self.columns.items() if column.column is not None}
        return tuple(name for name in ("x_mm", "drive_v") if name not in columns)

    def signals(self, path: str | Path) -> dict[str, Array]:
        """Read a CSV file as the signals of a recording; without drive_v where it was not kept.

        Raises
        ------
        FileFormatError, InputError
            As `read`; or if the map lacks a signal.
        """
        missing = [name for name in SIGNALS if name not in (*self.columns, "drive_v")]
        if missing:
            raise InputError(
                f"column map: expected {', '.join(missing)} as well; where the instrument kept no "
                "position give x_mm = { speed_mm_per_s = 50 }"
            )
        signals = self.read(path)
        if "drive_v" in self.assumed:
            signals.pop("drive_v", None)
        speed = self.columns["x_mm"].speed_mm_per_s
        if speed is not None:
            forces = signals["normal_force_n"], signals["tangential_force_n"]
            signals["x_mm"] = position_at_speed(signals["t_s"], *forces, speed)
        return signals

    def read(self, path: str | Path) -> dict[str, Array]:
        """Read every mapped signal of a CSV file, in SI units and mm.

        The last line may be cut short, where a recording broke off.

        Raises
        ------
        FileFormatError
            If the file cannot be read, a column is missing or a cell is not a number; the message
            names column and line.
        """
        header, rows = self._rows(path)
        used = [
            column.column.strip() for column in self.columns.values() if column.column is not None
        ]
        missing = [name for name in used if name not in header]
        if missing:
            raise FileFormatError(
                f"{path}: missing columns {', '.join(map(repr, missing))}; the file has "
                f"{', '.join(map(repr, header))}"
            )
        signals: dict[str, Array] = {}
        for name, column in self.columns.items():
            if column.column is not None:
                at = header.index(column.column.strip())
                cells = (row[at] if at < len(row) else "" for row in rows)
                values = [self._number(path, header[at], i, cell) for i, cell in enumerate(cells)]
                unit = _UNITS.get(name, {}).get(column.unit or "raw", 1.0)
                signals[name] = np.array(values) * unit * column.scale
        t = signals["t_s"]
        for name, column in self.columns.items():
            if column.speed_mm_per_s is not None:
                signals[name] = (t - t[0]) * column.speed_mm_per_s
            elif column.value is not None:
                signals[name] = np.full(len(t), column.value * column.scale)
        return signals

    def _rows(self, path: str | Path) -> tuple[list[str], list[list[str]]]:
        lines = read_text(path).splitlines()[self.skip_rows :]
        try:
            rows = [row for row in csv.reader(lines, delimiter=self.delimiter) if any(row)]
        except csv.Error as error:
            raise FileFormatError(f"{path}: expected a CSV file, got: {error}") from None
        if len(rows) <= _FEWEST_SAMPLES:
            raise FileFormatError(
                f"{path}: expected a line of headings and {_FEWEST_SAMPLES} samples or more, got "
                f"{len(rows)} lines"
            )
        header = [cell.strip() for cell in rows[0]]
        if len(rows[-1]) < len(header):
            rows.pop()
        return header, rows[1:]

    def _number(self, path: str | Path, column: str, index: int, cell: str) -> float:
        try:
            return float(cell)
        except ValueError:
            raise FileFormatError(
                f"{path}, sample {index + 1} (about line {self.skip_rows + 2 + index}): expected a "
                f"number in column {column!r}, got {cell!r}"
            ) from None


class InputChannel(Part):
    """One analog channel: ``value = scale * volts + offset``, in the signal's unit.

    `input` is the physical channel of National Instruments, such as "Dev1/ai0".
    """

    signal: Literal["normal_force_n", "tangential_force_n", "x_mm", "drive_v"]
    scale: float
    offset: float = 0.0
    input: str | None = None


class Inputs(Document):
    """Analog inputs of a laboratory: a force sensor and a position sensor on one device.

    ::

        schema_version = 1
        kind = "audio"                # or "national-instruments"
        device = "hw:2,0"             # for National Instruments each channel names its own input
        sample_rate_hz = 48000
        full_scale_v = 10.0           # of the audio device
        sensor = "FT12345"            # serial number of the force sensor
        [[channels]]
        signal = "normal_force_n"     # value = scale * volts + offset, in N, mm or V
        scale = 2.0
        [[channels]]
        signal = "tangential_force_n"
        scale = 1.0
        [[channels]]
        signal = "x_mm"
        scale = 10.0
    """

    kind: Literal["audio", "national-instruments"]
    device: str | int = ""
    sample_rate_hz: PositiveFloat = 10_000.0
    full_scale_v: PositiveFloat = 1.0
    sensor: str
    channels: Annotated[tuple[InputChannel, ...], Field(min_length=3)]


def open_inputs(path: str | Path) -> AnalogSource:
    """Open what a file describes.

    Raises
    ------
    FileFormatError, InputError
        If the file is not TOML, or a channel is unknown or missing.
    DeviceError
        If the device cannot be opened.
    """
    described = Inputs.load(path)
    reader: SampleReader
    rate_hz = described.sample_rate_hz
    if described.kind == "audio":
        count = len(described.channels)
        reader = AudioReader(described.device, count, described.full_scale_v, rate_hz)
    else:
        unnamed = [channel.signal for channel in described.channels if channel.input is None]
        if unnamed:
            raise InputError(f"{path}: expected the input of {', '.join(unnamed)}, as Dev1/ai0")
        names = [channel.input for channel in described.channels if channel.input is not None]
        reader = NationalInstrumentsReader(names, rate_hz)
    return AnalogSource(reader, described.channels, described.sensor)


class SampleReader(Protocol):
    """Analog inputs that are read continuously."""

    sample_rate_hz: float
    serial: str

    def start(self) -> None:
        """Begin to sample."""

    def read(self) -> Array:
        """Return the samples since the last call, shape (samples, channels), in volts."""

    def stop(self) -> None:
        """End."""


class AnalogSource(ForceSource):
    """A force sensor and a position sensor on analog inputs.

    Parameters
    ----------
    reader : SampleReader
        Reads the inputs.
    channels : sequence of InputChannel
        What each input measures, in the reader's order.
    sensor : str
        Serial number of the force sensor.
    """

    is_live = True

    def __init__(self, reader: SampleReader, channels: Sequence[InputChannel], sensor: str) -> None:
        needed = {"normal_force_n", "tangential_force_n", "x_mm"}
        missing = needed.difference(channel.signal for channel in channels)
        if missing:
            raise InputError(f"channels: expected {', '.join(sorted(missing))} as well")
        self._reader, self._channels, self._sensor = reader, tuple(channels), sensor
        self._blocks: list[Array] = []
        self._stroke: Stroke | None = None
        has_drive = any(channel.signal == "drive_v" for channel in channels)
        self.assumed = () if has_drive else ("drive_v",)

    @property
    def instruments(self) -> Mapping[str, str]:
        return {"force sensor": self._sensor, "inputs": self._reader.serial}

    def start(self, stroke: Stroke, played: StrokeDrive) -> None:
        self._blocks, self._stroke = [], stroke
        self._reader.start()

    def live(self, t_s: float) -> Live | None:
        signals = self._signals()
        if signals is None:
            return None
        if self._stroke is not None and (dead := _dead_channels(signals, self._stroke)):
            raise DeviceError(
                f"{', '.join(dead)}: the channel does not change at all while the finger slides; "
                "check sensor, cable and the channels' order, then continue with --resume"
            )
        return Live.at(signals, float(signals["t_s"][-1]))

    def finish(self) -> dict[str, Array]:
        signals = self._signals()
        self._reader.stop()
        if signals is None:
            raise DeviceError(
                "expected samples from the analog inputs, got none; check the device and its clock"
            )
        return signals

    def _signals(self) -> dict[str, Array] | None:
        block = self._reader.read()
        if len(block):
            self._blocks.append(block)
        if not self._blocks:
            return None
        volts = np.concatenate(self._blocks)
        signals: dict[str, Array] = {"t_s": np.arange(len(volts)) / self._reader.sample_rate_hz}
        for index, channel in enumerate(self._channels):
            signals[channel.signal] = channel.scale * volts[:, index] + channel.offset
        return signals


def _dead_channels(signals: Mapping[str, Array], stroke: Stroke) -> list[str]:
    """Names of the signals that stand still while the others show a slide."""
    normal = signals["normal_force_n"]
    if np.ptp(signals["x_mm"]) > 0.25 * stroke.length_mm:
        forces = ("normal_force_n", "tangential_force_n")
        return [name for name in forces if not np.ptp(signals[name]) > 0]
    pressed = np.abs(normal - normal[0]) > 0.5 * stroke.normal_force_n
    lasted = pressed.sum() * (signals["t_s"][-1] / max(len(normal) - 1, 1))
    return ["x_mm"] if lasted > 1.0 and not np.ptp(signals["x_mm"]) > 0 else []


class AudioReader:
    """Inputs of an audio-class device, direct coupled, through sounddevice.

    `full_scale_v` is the voltage of a full-scale sample.
    """

    def __init__(
        self, device: str | int, channels: int, full_scale_v: float, sample_rate_hz: float
    ) -> None:
        sound = _module("sounddevice", "pip install sounddevice, and Debian's libportaudio2")
        self._lock, self._blocks = Lock(), list[Array]()
        self._full_scale_v = full_scale_v
        try:
            self._stream = sound.InputStream(
                samplerate=sample_rate_hz,
                device=device,
                channels=channels,
                dtype="float32",
                callback=self._take,
            )
        except Exception as error:  # PortAudioError, ValueError: the library's own kinds
            raise DeviceError(f"audio input {device!r} cannot be opened: {error}") from error
        self.start, self.stop = self._stream.start, self._stream.stop
        self.sample_rate_hz = float(self._stream.samplerate)
        self.serial = f"audio input {device}"

    def _take(self, block: Any, frames: int, time: Any, status: Any) -> None:
        with self._lock:
            self._blocks.append(np.array(block, dtype=float) * self._full_scale_v)

    def read(self) -> Array:
        with self._lock:
            blocks, self._blocks = self._blocks, []
        return np.concatenate(blocks) if blocks else np.empty((0, int(self._stream.channels)))


class NationalInstrumentsReader:
    """Inputs of a National Instruments device, such as "Dev1/ai0", through nidaqmx."""

    def __init__(self, channels: Sequence[str], sample_rate_hz: float) -> None:
        with from_extra("daq"):
            import nidaqmx as daq
        self._count = len(channels)
        try:
            self._task = daq.Task()
            for channel in channels:
                self._task.ai_channels.add_ai_voltage_chan(channel)
            self._task.timing.cfg_samp_clk_timing(
                sample_rate_hz,
                sample_mode=daq.constants.AcquisitionType.CONTINUOUS,
                samps_per_chan=int(10 * sample_rate_hz),
            )
        except Exception as error:  # DaqError, or the driver's library is missing
            raise DeviceError(f"inputs {', '.join(channels)} cannot be opened: {error}") from error
        self.start, self.stop = self._task.start, self._task.stop
        self.sample_rate_hz = float(sample_rate_hz)
        self.serial = ", ".join(channels)

    def read(self) -> Array:
        # -1 reads all there are, channel by channel; a single channel comes without its axis.
        values = np.asarray(self._task.read(number_of_samples_per_channel=-1), dtype=float)
        return np.asarray(values.reshape(self._count, -1).T)


def _module(name: str, remedy: str) -> Any:
    try:
        return import_module(name)
    except (ImportError, OSError) as error:
        raise DeviceError(f"{name} cannot be loaded ({error}): {remedy}") from None
