"""Where force and place come from while a stroke is played: one interface, several instruments."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from threading import Lock
from typing import Any, Protocol

import numpy as np
from scipy.interpolate import CubicSpline

from calibration.column_map import ColumnMap
from calibration.parameters import Array
from calibration.protocol import Stroke
from calibration.recording import SIGNALS
from calibration.segmentation import sliding_speed
from haptix.errors import DeviceError, FileFormatError, InputError

_LIVE_S = 0.05  # over which force and speed are shown


@dataclass(frozen=True)
class Played:
    """What is played during one recording: volts from its first instant on."""

    volts: Array
    sample_rate_hz: float

    @property
    def duration_s(self) -> float:
        """Length of the recording [s]."""
        return len(self.volts) / self.sample_rate_hz

    def at(self, t_s: Array) -> Array:
        """Voltage on the screen [V] at times from the start [s], smooth between samples."""
        own = np.arange(len(self.volts)) / self.sample_rate_hz
        inside = (t_s >= 0) & (t_s <= own[-1])
        return np.where(inside, CubicSpline(own, self.volts)(np.clip(t_s, 0.0, own[-1])), 0.0)


@dataclass(frozen=True)
class Live:
    """What the person sees while sliding."""

    normal_force_n: float
    speed_mm_per_s: float


class ForceSource(Protocol):
    """An instrument, or what stands for one."""

    @property
    def instruments(self) -> Mapping[str, str]:
        """Names and serial numbers."""
        ...

    @property
    def is_live(self) -> bool:
        """Whether it records in real time, so that playing must keep to the clock."""
        ...

    def start(self, stroke: Stroke, played: Played) -> None:
        """Begin to record one stroke."""
        ...

    def live(self, t_s: float) -> Live | None:
        """Force and speed at a time since the start, if known already."""
        ...

    def finish(self) -> dict[str, Array]:
        """End the recording and return its signals, by the names of `SIGNALS`."""
        ...


def live_at(signals: Mapping[str, Array], t_s: float) -> Live | None:
    """Mean force and speed of the last 50 ms before a time."""
    t = signals["t_s"]
    inside = (t > t_s - _LIVE_S) & (t <= t_s)
    if inside.sum() < 4:
        return None
    speed = sliding_speed(t[inside], signals["x_mm"][inside])
    return Live(float(signals["normal_force_n"][inside].mean()), float(np.abs(speed).mean()))


class CsvSource:
    """Replays recordings that another program has exported, one CSV file per stroke.

    Parameters
    ----------
    folder : Path
        With files whose names hold the stroke's number: ``stroke-007.csv`` or ``7.csv``.
    columns : ColumnMap
        What is what in them.
    """

    is_live = False

    def __init__(self, folder: str | Path, columns: ColumnMap) -> None:
        self._folder, self._columns = Path(folder), columns
        self._stroke: Stroke | None = None
        if not self._folder.is_dir():
            raise FileFormatError(f"expected a folder of CSV files, got {self._folder}")

    @property
    def instruments(self) -> Mapping[str, str]:
        """The folder that was read."""
        return {"CSV files": self._folder.name}

    def start(self, stroke: Stroke, played: Played) -> None:
        """Note which file is next."""
        self._stroke = stroke

    def live(self, t_s: float) -> Live | None:
        """Nothing: it is past."""
        return None

    def finish(self) -> dict[str, Array]:
        """Read the file."""
        assert self._stroke is not None, "start comes first"
        number = self._stroke.number
        names = (f"stroke-{number:03d}.csv", f"stroke-{number}.csv", f"{number}.csv")
        for name in names:
            if (self._folder / name).exists():
                recording = self._columns.recording(self._folder / name, self._stroke)
                return {one: getattr(recording, one) for one in SIGNALS}
        raise FileFormatError(f"{self._folder}: expected a file {' or '.join(names)}")


class SampleReader(Protocol):
    """Analog inputs that are read continuously."""

    @property
    def sample_rate_hz(self) -> float:
        """Samples per second and channel."""
        ...

    @property
    def serial(self) -> str:
        """What the device calls itself."""
        ...

    def start(self) -> None:
        """Begin."""
        ...

    def read(self) -> Array:
        """Return what has come since the last call, shape (samples, channels), in volts."""
        ...

    def stop(self) -> None:
        """End."""
        ...


@dataclass(frozen=True)
class Channel:
    """What one analog channel means: ``value = scale * volts + offset``, in the signal's unit."""

    signal: str
    scale: float
    offset: float = 0.0

    def __post_init__(self) -> None:
        if self.signal not in SIGNALS or self.signal == "t_s":
            expected = ", ".join(name for name in SIGNALS if name != "t_s")
            raise InputError(f"channel: expected one of {expected}, got {self.signal!r}")


class AnalogSource:
    """A force sensor, and a position sensor, on analog inputs.

    Without a channel for the drive, what was played is kept in its place.

    Parameters
    ----------
    reader : SampleReader
        `AudioReader`, `NationalInstrumentsReader` or anything like them.
    channels : sequence of Channel
        One for each input, in order.
    sensor : str
        Serial number of the force sensor.
    """

    is_live = True

    def __init__(self, reader: SampleReader, channels: Sequence[Channel], sensor: str) -> None:
        needed = {"normal_force_n", "tangential_force_n", "x_mm"}
        missing = needed - {channel.signal for channel in channels}
        if missing:
            raise InputError(f"channels: expected {', '.join(sorted(missing))} as well")
        self._reader, self._channels, self._sensor = reader, tuple(channels), sensor
        self._blocks: list[Array] = []
        self._played: Played | None = None

    @property
    def instruments(self) -> Mapping[str, str]:
        """Sensor and inputs."""
        return {"force sensor": self._sensor, "inputs": self._reader.serial}

    def start(self, stroke: Stroke, played: Played) -> None:
        """Begin to sample."""
        self._blocks, self._played = [], played
        self._reader.start()

    def live(self, t_s: float) -> Live | None:
        """Of the newest samples."""
        signals = self._signals()
        return None if signals is None else live_at(signals, float(signals["t_s"][-1]))

    def finish(self) -> dict[str, Array]:
        """Stop and scale."""
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
        t = np.arange(len(volts)) / self._reader.sample_rate_hz
        found = {"t_s": t}
        for index, channel in enumerate(self._channels):
            found[channel.signal] = channel.scale * volts[:, index] + channel.offset
        if "drive_v" not in found:
            assert self._played is not None, "start comes first"
            found["drive_v"] = self._played.at(t)
        return found


class AudioReader:
    """Inputs of an audio-class device, direct coupled, through sounddevice.

    Parameters
    ----------
    device : str or int
        As sounddevice names it.
    channels : int
        How many inputs.
    full_scale_v : float
        Voltage of a full-scale sample.
    sample_rate_hz : float
        Samples per second.

    Raises
    ------
    DeviceError
        If sounddevice or the device is missing.
    """

    def __init__(
        self, device: str | int, channels: int, full_scale_v: float, sample_rate_hz: float = 48_000
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
        self.sample_rate_hz = float(self._stream.samplerate)
        self.serial = f"audio input {device}"

    def _take(self, block: Any, frames: int, time: Any, status: Any) -> None:
        with self._lock:
            self._blocks.append(np.array(block, dtype=float) * self._full_scale_v)

    def start(self) -> None:
        """Begin."""
        self._stream.start()

    def read(self) -> Array:
        """Return what has come since the last call."""
        with self._lock:
            blocks, self._blocks = self._blocks, []
        return np.concatenate(blocks) if blocks else np.empty((0, int(self._stream.channels)))

    def stop(self) -> None:
        """End."""
        self._stream.stop()


class NationalInstrumentsReader:
    """Inputs of a National Instruments device, through nidaqmx (extra "daq").

    Parameters
    ----------
    channels : sequence of str
        Physical channels, such as "Dev1/ai0".
    sample_rate_hz : float
        Samples per second and channel.

    Raises
    ------
    DeviceError
        If nidaqmx, its driver or the device is missing.
    """

    def __init__(self, channels: Sequence[str], sample_rate_hz: float = 10_000.0) -> None:
        daq = _module("nidaqmx", "pip install nidaqmx, and NI's driver")
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
        except Exception as error:  # DaqError, or the driver's library that is not there
            raise DeviceError(f"inputs {', '.join(channels)} cannot be opened: {error}") from error
        self.sample_rate_hz = float(sample_rate_hz)
        self.serial = ", ".join(channels)

    def start(self) -> None:
        """Begin."""
        self._task.start()

    def read(self) -> Array:
        """Return what has come since the last call."""
        # -1 reads whatever is there, channel by channel; a single channel comes without its axis.
        values = np.asarray(self._task.read(number_of_samples_per_channel=-1), dtype=float)
        return np.asarray(values.reshape(self._count, -1).T)

    def stop(self) -> None:
        """End."""
        self._task.stop()


def _module(name: str, remedy: str) -> Any:
    try:
        return import_module(name)
    except (ImportError, OSError) as error:
        raise DeviceError(f"{name} cannot be loaded ({error}): {remedy}") from None
