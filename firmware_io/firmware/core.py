"""The firmware in C, called from Python."""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import IntEnum
from functools import cache
from pathlib import Path
from typing import Any

import cffi
import numpy as np
import numpy.typing as npt

from firmware_io.c_library import load
from firmware_io.device_errors import DeviceError
from firmware_io.protocol import (
    CapabilitiesReport,
    FaultCode,
    FaultReport,
    FrameKind,
    StatusReport,
    TouchReport,
)
from firmware_io.protocol.frames import LAYOUTS, read_payload

_FOLDER = Path(__file__).parent
_ANSWER_BYTES = 4096
_REPORT_BYTES = 64


class Output(IntEnum):
    """The kind of an output sample: none, of the stream, held, of the safety ramp."""

    IDLE = 0
    STREAM = 1
    HELD = 2
    RAMP = 3


@dataclass(frozen=True)
class Sensor:
    """A board's converter of the electrode's current."""

    full_scale_a: float
    """Current of its code 32767, in amperes: twice the panel's at the ceiling, or more."""
    panel_f: float
    """Capacitance of the untouched panel, within a third, in farads."""


#: Added to the kind of an output sample while the digital line is high.
LINE = 0x80


@cache
def compiled() -> tuple[cffi.FFI, Any]:
    """Return the compiled firmware, and the host's functions compiled with it.

    Raises `DeviceError` if it is not there and cannot be built, or cannot be loaded.
    """
    return load("haptix-firmware", _FOLDER / "haptix_device.h", _FOLDER / "haptix_host.h")


class Core:
    """The device side of the protocol: it takes bytes, answers with bytes, and plays samples.

    Its only clock is the number of samples played. It is not safe for several threads at once.
    Raises `DeviceError` if `config` describes no possible device, or the firmware is not there and
    cannot be built.

    Parameters
    ----------
    config : CapabilitiesReport
        Capabilities of the device.
    sensor : Sensor, optional
        Its converter, if it states a rate of readings.
    """

    def __init__(self, config: CapabilitiesReport, sensor: Sensor | None = None) -> None:
        self._sensor = sensor or Sensor(0.0, 0.0)
        self._ffi, self._lib = compiled()
        # Owned as bytes: only the firmware knows the structure.
        self._memory = self._ffi.new("uint64_t[]", self._lib.hx_device_bytes() // 8 + 1)
        self._device = self._ffi.cast("hx_device *", self._memory)
        chosen = self._configuration(config)
        if not self._lib.hx_device_init(self._device, chosen):
            raise DeviceError(
                f"Impossible values, see hx_config for the ranges: {config}; correct them."
            )
        self._answer = self._ffi.new("uint8_t[]", _ANSWER_BYTES)
        self._report = self._ffi.new("uint8_t[]", _REPORT_BYTES)

    def _configuration(self, config: CapabilitiesReport) -> Any:
        try:
            return self._ffi.new(
                "hx_config *",
                {
                    "output_rate_hz": config.output_rate_hz,
                    "full_scale_mv": config.full_scale_mv,
                    "ceiling_mv": config.ceiling_mv,
                    "max_slew_v_per_s": config.max_slew_v_per_s,
                    "queue_samples": config.queue_samples,
                    "max_frame_samples": config.max_frame_samples,
                    "max_watchdog_ms": config.max_watchdog_ms,
                    "report_bytes": config.report_bytes,
                    "flags": config.reports_touch
                    | config.takes_marks << 1
                    | config.has_tested_itself << 2
                    | config.reset_cause << 3,
                    "rate_count": len(config.rates),
                    "rates": [
                        (rate.sample_rate_hz, sum(1 << mode for mode in rate.modes))
                        for rate in config.rates
                    ],
                    "name": config.name.encode("ascii"),
                    "serial": config.serial.encode("ascii"),
                    "calibration_id": config.calibration_id.encode("ascii"),
                    "guard_ticks": config.guard_ticks,
                    "sense_rate_hz": config.sense_rate_hz,
                    "sense_full_scale_na": round(self._sensor.full_scale_a * 1e9),
                    "panel_pf": round(self._sensor.panel_f * 1e12),
                },
            )
        except (OverflowError, IndexError, UnicodeEncodeError) as error:
            raise DeviceError(f"Impossible values, {error}: {config}; correct them.") from error

    @property
    def pending_ticks(self) -> int:
        """Output samples until only zeros or a held sample are left to play."""
        return int(self._lib.hx_device_pending(self._device))

    def receive(self, data: bytes) -> None:
        """Take bytes from the host, in pieces of any size."""
        self._lib.hx_device_receive(self._device, data, len(data))

    def receive_report(self, report: bytes) -> None:
        """Take one HID report from the host, its id first."""
        self._lib.hx_device_receive_report(self._device, report, len(report))

    def transmit(self) -> bytes:
        """Return the frames that wait for the host; empty if there are none."""
        size = self._lib.hx_device_transmit(self._device, self._answer, _ANSWER_BYTES)
        return bytes(self._ffi.buffer(self._answer, size))

    def transmit_report(self) -> bytes:
        """Return one HID report for the host; empty if there is none."""
        size = self._lib.hx_device_transmit_report(self._device, self._report, _REPORT_BYTES)
        return bytes(self._ffi.buffer(self._report, size))

    def play(self, ticks: int) -> tuple[npt.NDArray[np.int16], npt.NDArray[np.uint8]]:
        """Return the next output samples as codes, and the kind of each: `Output`, and `LINE`."""
        codes = np.empty(ticks, dtype=np.int16)
        kinds = np.empty(ticks, dtype=np.uint8)
        self._lib.hx_device_play(
            self._device,
            self._ffi.from_buffer("int16_t[]", codes),
            self._ffi.from_buffer("uint8_t[]", kinds),
            ticks,
        )
        return codes, kinds

    def play_out(self) -> list[tuple[npt.NDArray[np.int16], npt.NDArray[np.uint8]]]:
        """Return, as `play`, all that is played until only zeros or a held sample are left."""
        played = []
        while ticks := self.pending_ticks:
            played.append(self.play(ticks))
        return played

    def status(self) -> StatusReport:
        """Return the state of the device, without a frame on the wire."""
        status: StatusReport = self._read(FrameKind.STATUS, self._lib.hx_device_status)
        return status

    def fault(self) -> FaultReport | None:
        """Return the first fault since the last accepted HELLO, SETUP or ARM."""
        fault: FaultReport = self._read(FrameKind.FAULT, self._lib.hx_device_fault)
        return None if fault.code is FaultCode.NONE else fault

    def _read(self, kind: FrameKind, write: Any) -> Any:
        payload = self._ffi.new("uint8_t[]", LAYOUTS[kind].fields.size)
        write(self._device, payload)
        return read_payload(kind, bytes(self._ffi.buffer(payload)))

    def touch(self, touch: TouchReport) -> bool:
        """Report a finger, at the present clock; False if the host has not read the last eight."""
        fields = (0, touch.x_um, touch.y_um, touch.normal_force_mn, touch.contact, touch.phase)
        return bool(self._lib.hx_device_touch(self._device, self._ffi.new("hx_touch *", fields)))

    def test_itself(self, config: CapabilitiesReport) -> CapabilitiesReport:
        """Restart with the tests of a board at power-up; return the capabilities that it states."""
        size, chosen = self._ffi.sizeof(self._memory), self._configuration(config)
        is_well = self._lib.hx_test_memory(self._memory, size) == 1 and (
            self._lib.hx_test_limits(self._device, chosen) == 0
        )
        config = replace(config, has_tested_itself=is_well)
        self._lib.hx_device_init(self._device, self._configuration(config))
        return config

    @property
    def is_whole(self) -> bool:
        """Whether its memory passes its test, and its output equals the samples sent."""
        return bool(self._lib.hx_device_is_whole(self._device))

    def read_back(
        self, sent: npt.NDArray[np.int16], measured: npt.NDArray[np.int16], tolerance: int
    ) -> None:
        """Take measured output samples; if they are too far off 8 times, it ends at 0 V."""
        codes = (self._ffi.from_buffer("int16_t[]", codes) for codes in (sent, measured))
        self._lib.hx_device_read_back(self._device, *codes, len(sent), tolerance)

    def sense(self, sent: npt.NDArray[np.int16], raw: npt.NDArray[np.int16]) -> None:
        """Take the measured current of the output samples that were played last, as codes."""
        codes = (self._ffi.from_buffer("int16_t[]", codes) for codes in (sent, raw))
        self._lib.hx_device_sense(self._device, *codes, len(sent), 0)

    def release(self) -> None:
        """Handle the loss of the host: a bus reset, a closed connection."""
        self._lib.hx_device_release(self._device)
