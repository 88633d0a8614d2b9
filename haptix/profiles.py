"""Profiles of screen and finger that are installed under a driver's serial number.

::

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

from firmware_io import Device
from haptix.errors import InputError
from haptix.files import write_folder
from haptix.finger import Finger
from haptix.screen import CalibrationWarning, Screen

_SCREEN, _FINGER = "screen.toml", "finger.toml"


class ProfileFiles(NamedTuple):
    """Files of a screen and of the finger that was measured with it."""

    screen: Path
    finger: Path


def profiles_folder() -> Path:
    """Return ``$HAPTIX_PROFILES``, or ``haptix/profiles`` in the user's data folder."""
    if chosen := os.environ.get("HAPTIX_PROFILES"):
        return Path(chosen).expanduser()
    return platformdirs.user_data_path("haptix", appauthor=False) / "profiles"


def install_profile(serial: str, screen: str | Path, finger: str | Path) -> ProfileFiles:
    """Copy a calibrated screen and its finger for the driver of a serial number.

    Raises
    ------
    InputError
        If the serial number is empty, the screen is not calibrated, failed, is old or was edited,
        or the finger is not the one that was measured with it.
    FileFormatError
        If a file is no such profile.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", CalibrationWarning)  # refused below
        own = Screen.load(screen)
    if own.calibration is None:
        raise InputError(f"{screen}: expected a profile of a calibration, got one without")
    if reasons := own.warnings():
        raise InputError(f"{screen} is not installed: {'; '.join(reasons)}")
    check_measured_with(own, Finger.load(finger), finger)
    folder = _folder_of(serial)
    contents = {_FINGER: Path(finger).read_bytes(), _SCREEN: Path(screen).read_bytes()}
    write_folder(folder, contents)
    return ProfileFiles(folder / _SCREEN, folder / _FINGER)


def check_measured_with(screen: Screen, finger: Finger, file: str | Path) -> None:
    """Raise `InputError` unless a finger is the one that was measured with a calibrated screen.

    Its numbers and the screen's belong together; profiles of older versions do not name a finger.
    """
    known = "" if screen.calibration is None else screen.calibration.finger_hash
    if known and finger.content_hash() != known:
        raise InputError(
            f"{file} is not the finger that was measured with screen {screen.name!r}, or was "
            "edited: take the finger.toml of the same calibration"
        )


def installed_profile(serial: str) -> ProfileFiles | None:
    """Return the files that are installed for a serial number; None without."""
    if not serial:
        return None
    folder = _folder_of(serial)
    found = ProfileFiles(folder / _SCREEN, folder / _FINGER)
    return found if found.screen.exists() and found.finger.exists() else None


def profile_of(device: Device) -> ProfileFiles | None:
    """Return the files that are installed for an open device; None without.

    Warns
    -----
    CalibrationWarning
        If the device names a calibration that is not the installed one.
    """
    about = device.capabilities
    found = installed_profile(about.serial)
    if about.calibration_id:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", CalibrationWarning)  # said where it is used
            own = "" if found is None else Screen.load(found.screen).calibration_id
        if own != about.calibration_id:
            there = f"{own!r} is installed" if own else "none is installed here"
            warnings.warn(
                f"device {about.serial!r} was calibrated as {about.calibration_id!r}, but {there}: "
                "install that profile with `haptix calibrate install`",
                CalibrationWarning,
                stacklevel=3,
            )
    return found


def _folder_of(serial: str) -> Path:
    if not serial.strip():
        raise InputError("serial: expected the serial number of a driver, got none")
    # A name of one folder, whatever the driver says it is.
    return profiles_folder() / quote(serial, safe=" ").replace(".", "%2E")


def profiles_for(device: Device, finger: str | None, screen: str | None) -> tuple[str, str]:
    """Names or files of finger and screen: as given, installed for the device, or presets."""
    found = installed_profile(device.capabilities.serial)
    if found is None:
        return finger or "semi-wet", screen or "3m-sct3250"
    return finger or str(found.finger), screen or str(found.screen)
