"""The firmware in C, called from Python."""

from __future__ import annotations

import re
from functools import cache
from typing import Any

import cffi
import numpy as np
import numpy.typing as npt

from firmware_io.errors import DeviceError
from firmware_io.firmware.build import SOURCE_DIR, library
from firmware_io.protocol import (
    CapabilitiesReport,
    FaultCode,
    FaultReport,
    FrameKind,
    StatusReport,
    TouchReport,
)
from firmware_io.protocol.payloads import LAYOUTS, read_payload

_ANSWER_BYTES = 4096
_REPORT_BYTES = 64


@cache
def compiled() -> tuple[cffi.FFI, Any]:
    """Return the compiled firmware, and what the host has compiled with it.

    Raises
    ------
    DeviceError
        If it cannot be compiled, or not be loaded.
    """
    ffi = cffi.FFI()
    for name in ("haptix_device.h", "haptix_host.h"):
        header = (SOURCE_DIR / name).read_text()
        declared = re.search(r"/\* cffi: begin \*/(.*)/\* cffi: end \*/", header, re.DOTALL)
        assert declared is not None
        ffi.cdef(declared.group(1))
    path = library()
    try:
        return ffi, ffi.dlopen(str(path))
    except OSError as error:
        raise DeviceError(
            f"The compiled firmware {path} cannot be loaded: {error}; install haptix again, or use "
            'the Python reference, core="python".'
        ) from error


class NativeCore:
    """The compiled firmware; see `firmware_io.firmware.core.Core`.

    Parameters
    ----------
    config : CapabilitiesReport
        Capabilities of the device.

    Raises
    ------
    DeviceError
        If `config` describes no possible device, or the firmware cannot be compiled.
    """

    name = "c"

    def __init__(self, config: CapabilitiesReport) -> None:
        self._ffi, self._lib = compiled()
        # Owned as bytes: only the firmware knows the structure.
        self._memory = self._ffi.new("uint64_t[]", self._lib.hx_device_bytes() // 8 + 1)
        self._device = self._ffi.cast("hx_device *", self._memory)
        if not self._lib.hx_device_init(self._device, self._configuration(config)):
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
                    "flags": config.reports_touch | config.takes_marks << 1,
                    "rate_count": len(config.rates),
                    "rates": [
                        (rate.sample_rate_hz, sum(1 << mode for mode in rate.modes))
                        for rate in config.rates
                    ],
                    "name": config.name.encode("ascii"),
                    "serial": config.serial.encode("ascii"),
                    "calibration_id": config.calibration_id.encode("ascii"),
                    "guard_ticks": config.guard_ticks,
                },
            )
        except (OverflowError, IndexError, UnicodeEncodeError) as error:
            raise DeviceError(f"Impossible values, {error}: {config}; correct them.") from error

    @property
    def pending_ticks(self) -> int:
        """Output samples until only zeros or a held sample are left to play."""
        return int(self._lib.hx_device_pending(self._device))

    def receive(self, data: bytes) -> None:
        """Take bytes from the host."""
        self._lib.hx_device_receive(self._device, data, len(data))

    def receive_report(self, report: bytes) -> None:
        """Take one HID report from the host."""
        self._lib.hx_device_receive_report(self._device, report, len(report))

    def transmit(self) -> bytes:
        """Return the frames that wait for the host."""
        size = self._lib.hx_device_transmit(self._device, self._answer, _ANSWER_BYTES)
        return bytes(self._ffi.buffer(self._answer, size))

    def transmit_report(self) -> bytes:
        """Return one HID report for the host."""
        size = self._lib.hx_device_transmit_report(self._device, self._report, _REPORT_BYTES)
        return bytes(self._ffi.buffer(self._report, size))

    def play(self, ticks: int) -> tuple[npt.NDArray[np.int16], npt.NDArray[np.uint8]]:
        """Return the next output samples, and the kind of each."""
        codes = np.empty(ticks, dtype=np.int16)
        what = np.empty(ticks, dtype=np.uint8)
        self._lib.hx_device_play(
            self._device,
            self._ffi.cast("int16_t *", codes.ctypes.data),
            self._ffi.cast("uint8_t *", what.ctypes.data),
            ticks,
        )
        return codes, what

    def status(self) -> StatusReport:
        """Return the state of the device."""
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
        """Report a finger."""
        fields = (0, touch.x_um, touch.y_um, touch.normal_force_mn, touch.contact, touch.phase)
        return bool(self._lib.hx_device_touch(self._device, self._ffi.new("hx_touch *", fields)))

    def release(self) -> None:
        """Handle the loss of the host."""
        self._lib.hx_device_release(self._device)
