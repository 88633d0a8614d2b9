"""Where force and position come from while a stroke is played: instruments, or files of others."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from threading import Lock
from typing import Annotated, Any, Literal, Protocol

import numpy as np
from pydantic import Field, PositiveFloat
from scipy.interpolate import CubicSpline

from calibration.measure.columns import SUFFIXES, ColumnMap
from calibration.measure.segmentation import sliding_speed, touches
from calibration.plan.parameters import Array
from calibration.plan.protocol import Stroke
from haptix.base.display import Displayed
from haptix.base.documents import Document, Part
from haptix.base.errors import DeviceError, FileFormatError, InputError, from_extra

_LIVE_S = 0.05  # over which force and speed are shown


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
            The stroke to measure.
        played : StrokeDrive
            The samples played meanwhile.
        """

    def live(self, t_s: float) -> Live | None:
        """Force and speed at a time since the start, if known already."""
        return None

    def finish(self) -> dict[str, Array]:
        """End the recording and return its signals, by the names of `SIGNALS`.

        Without a drive_v the voltage that was played takes its place.
        """


class CsvSource(ForceSource):
    """Replays recordings that another program has exported.

    A folder has one file per stroke, whose name holds its number: ``stroke-007.csv`` or ``7.lvm``.
    One file may have all of them: by a column ``stroke`` of the map, by the groups or segments of
    the file, or else one touch after the other.

    Parameters
    ----------
    place : str or Path
        The folder, or the file.
    columns : ColumnMap
        Which column is what.
    strokes : int, optional
        Strokes that a file of all must have.

    Raises
    ------
    FileFormatError
        If there is neither, or the file has another number of touches than `strokes`.
    """

    is_live = False

    def __init__(self, place: str | Path, columns: ColumnMap, strokes: int | None = None) -> None:
        self._place, self._columns = Path(place), columns
        self._number = 0
        self.assumed = columns.assumed
        self._all: dict[int, dict[str, Array]] | None = None
        if self._place.is_file():
            self._all = self._split(strokes)
        elif not self._place.is_dir():
            raise FileFormatError(f"expected a folder of CSV files, or a file, got {self._place}")

    @property
    def instruments(self) -> Mapping[str, str]:
        return {"CSV files": self._place.name}

    def start(self, stroke: Stroke, played: StrokeDrive) -> None:
        self._number = stroke.number

    def finish(self) -> dict[str, Array]:
        number = self._number
        if self._all is not None:
            if number not in self._all:
                known = ", ".join(map(str, self._all))
                raise FileFormatError(f"{self._place}: has no stroke {number}, but {known}")
            return self._columns.completed(self._all[number])
        names = (f"stroke-{number:03d}", f"stroke-{number}", f"{number}")
        for name in names:
            for suffix in SUFFIXES:
                if (file := self._place / f"{name}{suffix}").exists():
                    return self._columns.signals(file)
        wanted = " or ".join(f"{name}.csv" for name in names)
        raise FileFormatError(
            f"{self._place}: expected a file {wanted} (or {', '.join(SUFFIXES[1:])})"
        )

    def _split(self, strokes: int | None) -> dict[int, dict[str, Array]]:
        """Signals of each stroke of the one file, by its number."""
        signals = self._columns.read(self._place)
        if "normal_force_n" not in signals:
            raise FileFormatError(f"{self._place}: expected normal_force_n in the column map")
        if (numbers := signals.pop("stroke", None)) is not None:
            parts = {int(n): np.flatnonzero(numbers == n) for n in np.unique(numbers)}
        else:
            touched = touches(signals["t_s"], signals["normal_force_n"])
            if strokes is not None and len(touched) != strokes:
                raise FileFormatError(
                    f"{self._place}: expected {strokes} strokes in it, got {len(touched)} touches; "
                    "give the column of their numbers in the column map, as stroke = "
                    '{ column = "Trial", unit = "raw" }, or a file for each stroke'
                )
            parts = {n: np.arange(*part) for n, part in enumerate(touched, 1)}
        return {n: {k: v[part] for k, v in signals.items()} for n, part in parts.items()}


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
        full_scale_v = 10.0           # audio: of a full sample, else 1; other: range, else 10
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
    full_scale_v: PositiveFloat | None = None
    sensor: str
    channels: Annotated[tuple[InputChannel, ...], Field(min_length=3)]


def open_inputs(path: str | Path) -> AnalogSource:
    """Open the inputs that a file describes.

    Raises `FileFormatError` or `InputError` if the file is not TOML, or a channel is unknown or
    missing; `DeviceError` if the device cannot be opened.
    """
    described = Inputs.load(path)
    reader: SampleReader
    rate_hz = described.sample_rate_hz
    if described.kind == "audio":
        count = len(described.channels)
        reader = AudioReader(described.device, count, described.full_scale_v or 1.0, rate_hz)
    else:
        unnamed = [channel.signal for channel in described.channels if channel.input is None]
        if unnamed:
            raise InputError(f"{path}: expected the input of {', '.join(unnamed)}, as Dev1/ai0")
        names = [channel.input for channel in described.channels if channel.input is not None]
        reader = NationalInstrumentsReader(names, rate_hz, described.full_scale_v or 10.0)
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
        Quantity of each input, in the reader's order.
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
    """Inputs of a National Instruments device, such as "Dev1/ai0", through nidaqmx.

    The device takes its smallest range that holds ``-full_scale_v`` to ``full_scale_v``.
    """

    def __init__(self, channels: Sequence[str], sample_rate_hz: float, full_scale_v: float) -> None:
        with from_extra("daq"):
            import nidaqmx as daq
        self._count = len(channels)
        try:
            self._task = daq.Task()
            for channel in channels:
                self._task.ai_channels.add_ai_voltage_chan(
                    channel, min_val=-full_scale_v, max_val=full_scale_v
                )
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
