"""The one error hierarchy of the distribution, in its lowest package, so that all can use it."""

from collections.abc import Iterator
from contextlib import contextmanager


class HaptixError(Exception):
    """Root of every error that haptix, firmware_io and calibration raise on purpose."""


class DeviceError(HaptixError):
    """A device was used, or described, in a way that it cannot serve."""


class DeviceNotFoundError(DeviceError):
    """No device answers to the given address."""


class DeviceBusyError(DeviceError):
    """Another process, or another object of this one, holds the device."""


class DevicePermissionError(DeviceError):
    """The operating system does not let this user open the device."""


class DeviceDisconnectedError(DeviceError):
    """The link to the device is closed or lost."""


class ProtocolError(DeviceError):
    """Bytes on the wire break this protocol, or a value cannot be put on the wire."""


class DeviceFaultError(DeviceError):
    """The driver refused a frame, brought its output to 0 V and waits to be armed again."""


class LimitError(HaptixError):
    """A voltage, slew, energy or limit beyond what is allowed: rejected, never clamped."""


class MissingExtraError(HaptixError, ModuleNotFoundError):
    """A package that an extra brings is not installed; the message names the extra."""


@contextmanager
def from_extra(extra: str) -> Iterator[None]:
    """Import, in the body, the modules that an extra of the distribution brings.

    Raises
    ------
    MissingExtraError
        If one of these packages is not installed.
    """
    try:
        yield
    except MissingExtraError:
        raise  # an import further down needs another extra
    except ModuleNotFoundError as error:
        raise MissingExtraError(
            f"expected the package {error.name}, which is not installed; run: "
            f"pip install 'haptix-electrovibration[{extra}]'",
            name=error.name,
        ) from None
