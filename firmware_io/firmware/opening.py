"""The choice between the firmware in C and its reference in Python."""

from __future__ import annotations

from firmware_io.errors import DeviceError
from firmware_io.firmware.build import can_be_had
from firmware_io.firmware.core import Core, CoreName
from firmware_io.firmware.native import NativeCore
from firmware_io.protocol import CapabilitiesReport


def open_core(config: CapabilitiesReport, which: CoreName = "auto") -> Core:
    """Return a device core.

    Parameters
    ----------
    config : CapabilitiesReport
        Capabilities of the device.
    which : {"auto", "c", "python"}
        The firmware compiled from C, or its reference. "auto" takes C where the installation has
        it compiled, or there is a compiler.

    Raises
    ------
    DeviceError
        If `config` describes no possible device, or "c" was asked for and cannot be built.
    """
    if which == "c" or (which == "auto" and can_be_had()):
        return NativeCore(config)
    try:
        from firmware_io.firmware.reference import ReferenceCore  # not in every wheel
    except ModuleNotFoundError:
        raise DeviceError(
            "This wheel has the compiled firmware only; for the reference in Python install the "
            "pure wheel, whose name ends in py3-none-any.whl."
        ) from None
    return ReferenceCore(config)
