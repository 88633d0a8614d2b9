"""Analog inputs of a laboratory: a force sensor and a position sensor, described by a TOML file.

::

    schema_version = 1
    kind = "audio"                      # or "national-instruments"
    device = "hw:2,0"                   # for National Instruments each channel names its own input
    sample_rate_hz = 48000
    full_scale_v = 10.0                 # of the audio device
    sensor = "FT12345"                  # serial number of the force sensor
    [[channels]]
    signal = "normal_force_n"           # value = scale * volts + offset, in N, mm or V
    scale = 2.0
    [[channels]]
    signal = "tangential_force_n"
    scale = 1.0
    [[channels]]
    signal = "x_mm"
    scale = 10.0
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from importlib import import_module
from pathlib import Path
from threading import Lock
from typing import Annotated, Any, Literal, Protocol

import numpy as np
from pydantic import Field, PositiveFloat

from calibration.parameters import Array
from calibration.protocol import Stroke
from calibration.sources import ForceSource, Live, StrokeDrive
from haptix.documents import Document, Part
from haptix.errors import DeviceError, InputError, from_extra


class InputChannel(Part):
    """One analog channel: ``value = scale * volts + offset``, in the signal's unit.

    `input` is the physical channel of National Instruments, such as "Dev1/ai0".
    """

    signal: Literal["normal_force_n", "tangential_force_n", "x_mm", "drive_v"]
    scale: float
    offset: float = 0.0
    input: str | None = None


class Inputs(Document):
    """One device with its channels: see the module."""

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
    found = Inputs.load(path)
    reader: SampleReader
    if found.kind == "audio":
        count = len(found.channels)
        reader = AudioReader(found.device, count, found.full_scale_v, found.sample_rate_hz)
    else:
        unnamed = [one.signal for one in found.channels if one.input is None]
        if unnamed:
            raise InputError(f"{path}: expected the input of {', '.join(unnamed)}, as Dev1/ai0")
        names = [one.input for one in found.channels if one.input is not None]
        reader = NationalInstrumentsReader(names, found.sample_rate_hz)
    return AnalogSource(reader, found.channels, found.sensor)


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

    The reader's inputs are the `channels`, in order. `sensor` is the serial number of the force
    sensor.
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
        found: dict[str, Array] = {"t_s": np.arange(len(volts)) / self._reader.sample_rate_hz}
        for index, channel in enumerate(self._channels):
            found[channel.signal] = channel.scale * volts[:, index] + channel.offset
        return found


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
