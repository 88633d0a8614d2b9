"""The analog channels of a laboratory, as a TOML file.

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

from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, PositiveFloat

from calibration.sources import (
    AnalogSource,
    AudioReader,
    Channel,
    NationalInstrumentsReader,
    SampleReader,
)
from haptix.documents import Document, Part
from haptix.errors import InputError


class InputChannel(Part):
    """One channel: its signal, its scale, and for National Instruments its input."""

    signal: str
    scale: float
    offset: float = 0.0
    input: str | None = None


class Inputs(Document):
    """All channels of one device: see the module."""

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
        If the file is none, or a channel is unknown or missing.
    DeviceError
        If the device cannot be opened.
    """
    found = Inputs.load(path)
    channels = [Channel(one.signal, one.scale, one.offset) for one in found.channels]
    reader: SampleReader
    if found.kind == "audio":
        reader = AudioReader(found.device, len(channels), found.full_scale_v, found.sample_rate_hz)
    else:
        unnamed = [one.signal for one in found.channels if one.input is None]
        if unnamed:
            raise InputError(f"{path}: expected the input of {', '.join(unnamed)}, as Dev1/ai0")
        reader = NationalInstrumentsReader(
            [one.input for one in found.channels if one.input is not None], found.sample_rate_hz
        )
    return AnalogSource(reader, channels, found.sensor)
