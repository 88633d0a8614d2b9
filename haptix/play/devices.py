"""Devices for packages that do not import `firmware_io`, and the profiles installed for them.

`open_device` opens a device with its profile. Profiles of screen and finger are installed under a
driver's serial number::

    $HAPTIX_PROFILES/SERIAL/screen.toml, finger.toml     [default: in the user's data folder]

`haptix calibrate install` writes them. `haptix render` and `play` take them for the device that
they use, and every opening compares the driver's own calibration id with them.
"""

from __future__ import annotations

import os
import warnings
from pathlib import Path
from typing import NamedTuple
from urllib.parse import quote

import platformdirs

import firmware_io
from firmware_io import Capabilities, CurrentReading, Device
from firmware_io.drive_check import DriveWindow
from firmware_io.limits import (
    BODY_CAPACITANCE_F,
    MAX_PEAK_A,
    MAX_RMS_A,
    Current,
    DriveLimits,
    series_capacitance_f,
)
from haptix.base.errors import DeviceError, InputError
from haptix.base.files import write_folder
from haptix.model.finger import Finger
from haptix.model.pair import FINGER, SCREEN, check_measured_with, profile_names
from haptix.model.screen import CalibrationWarning, Screen

__all__ = [
    "BODY_CAPACITANCE_F",
    "MAX_PEAK_A",
    "MAX_RMS_A",
    "Current",
    "CurrentReading",
    "Device",
    "DriveLimits",
    "DriveWindow",
    "ProfileFiles",
    "install_profile",
    "installed_profile",
    "open_again",
    "open_device",
    "profile_of",
    "profiles_folder",
    "profiles_for",
    "series_capacitance_f",
]


class ProfileFiles(NamedTuple):
    """Files of a screen and of the finger that was measured with it."""

    screen: Path
    finger: Path


def profiles_folder() -> Path:
    """Return ``$HAPTIX_PROFILES``, or ``haptix/profiles`` in the user's data folder."""
    if chosen := os.environ.get("HAPTIX_PROFILES"):
        return Path(chosen).expanduser()
    return platformdirs.user_data_path("haptix", appauthor=False) / "profiles"


def install_profile(
    serial: str, screen: str | Path, finger: str | Path, is_mock: bool = False
) -> ProfileFiles:
    """Copy a calibrated screen and its finger for the driver of a serial number.

    Raises `InputError` if the serial number is empty; if the screen is not calibrated, failed, is
    old or was edited; if the finger is not the one that was measured with it; or if the calibration
    was a practice and the driver is not known to be a mock; `FileFormatError` if a file is not such
    a profile.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", CalibrationWarning)  # refused below
        profile = Screen.load(screen)
    if profile.calibration is None:
        raise InputError(f"{screen}: expected a profile of a calibration, got one without")
    if reasons := profile.warnings():
        raise InputError(f"{screen} is not installed: {'; '.join(reasons)}")
    if profile.calibration.is_virtual and not is_mock:
        raise InputError(
            f"{screen} is not installed: a virtual finger was measured, and no screen; install it "
            "for a mock (--device mock:serial=...), or calibrate the driver's own screen"
        )
    check_measured_with(profile, Finger.load(finger), finger)
    folder = _folder_of(serial)
    contents = {FINGER: Path(finger).read_bytes(), SCREEN: Path(screen).read_bytes()}
    write_folder(folder, contents)
    return ProfileFiles(folder / SCREEN, folder / FINGER)


def installed_profile(serial: str) -> ProfileFiles | None:
    """Return the files that are installed for a serial number; None if there are none."""
    if not serial:
        return None
    folder = _folder_of(serial)
    files = ProfileFiles(folder / SCREEN, folder / FINGER)
    return files if files.screen.exists() and files.finger.exists() else None


def profile_of(device: Device) -> ProfileFiles | None:
    """Return the files that are installed for an open device; None if there are none.

    Warns
    -----
    CalibrationWarning
        If the device names a calibration that is not the installed one.
    """
    about = device.capabilities
    files = installed_profile(about.serial)
    if about.calibration_id:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", CalibrationWarning)  # comes where the profile is used
            installed_id = "" if files is None else Screen.load(files.screen).calibration_id
        if installed_id != about.calibration_id:
            state = f"{installed_id!r} is installed" if installed_id else "none is installed here"
            warnings.warn(
                f"device {about.serial!r} was calibrated as {about.calibration_id!r}, but {state}: "
                "install that profile with `haptix calibrate install`",
                CalibrationWarning,
                stacklevel=3,
            )
    return files


def _folder_of(serial: str) -> Path:
    if not serial.strip():
        raise InputError("serial: expected the serial number of a driver, got none")
    # A driver may send any text: make it the name of one folder.
    return profiles_folder() / quote(serial, safe=" ").replace(".", "%2E")


def profiles_for(device: Device, finger: str | None, screen: str | None) -> tuple[str, str]:
    """Names or files of finger and screen: as given, installed for the device, or presets."""
    files = installed_profile(device.capabilities.serial)
    return profile_names(finger, screen or (files and str(files.screen)))


def open_device(address: str) -> Device:
    """Open the device at an address; see `firmware_io.open_device`.

    Warns
    -----
    CalibrationWarning
        If the device names a calibration other than the profile that is installed for its serial
        number (`haptix.play.devices`).

    Examples
    --------
    >>> device = open_device("mock:")
    >>> device.capabilities.ceiling_v
    200.0
    >>> device.close()
    """
    device = firmware_io.open_device(address)
    try:
        profile_of(device)
    except BaseException:
        device.close()
        raise
    return device


_PLACES = ("bus", "address", "path", "port")  # keys of an address that a replugged driver may leave


def open_again(address: str, known: Capabilities) -> Device:
    """Open the driver that was at an address, there or at another place of its bus.

    Parameters
    ----------
    address : str
    known : Capabilities
        Those that it had.

    Raises
    ------
    DeviceError
        If it cannot be opened, or another driver is there.
    """
    scheme, _, pairs = address.partition(":")
    kept = [pair for pair in pairs.split(",") if pair.partition("=")[0].strip() not in _PLACES]
    anywhere = f"{scheme}:{','.join(kept)}"
    try:
        device = open_device(address)
    except DeviceError:
        if anywhere == address:
            raise
        device = open_device(anywhere)  # the only one on its bus
    if device.capabilities != known:
        device.close()
        raise DeviceError(
            f"another driver is there, {device.capabilities.serial!r} instead of "
            f"{known.serial!r}; restart the service for it"
        )
    return device
