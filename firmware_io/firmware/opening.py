"""The choice between the firmware in C and its reference in Python."""

from __future__ import annotations

from firmware_io.firmware.build import find_compiler
from firmware_io.firmware.core import Core, CoreName
from firmware_io.firmware.native import NativeCore
from firmware_io.firmware.reference import ReferenceCore
from firmware_io.protocol import CapabilitiesReport


def open_core(config: CapabilitiesReport, which: CoreName = "auto") -> Core:
    """Return a device core.

    Parameters
    ----------
    config : CapabilitiesReport
        Capabilities of the device.
    which : {"auto", "c", "python"}
        The firmware compiled from C, or its reference. "auto" takes C where there is a compiler.

    Raises
    ------
    DeviceError
        If `config` describes no possible device, or "c" was asked for and cannot be built.
    """
    if which == "python" or (which == "auto" and find_compiler() is None):
        return ReferenceCore(config)
    return NativeCore(config)
